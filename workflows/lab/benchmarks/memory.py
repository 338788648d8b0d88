"""Memory of runs by stage, measured and foretold: `python -m stickslip.workflows.lab.benchmarks.memory [FILE]`.

Each case is run in a process of its own, with and without estimates of errors. Peaks of resident memory are read, and
begun anew, whenever its clock goes on to another phase (Linux: VmHWM, and 5 in /proc/self/clear_refs). FILE keeps what
was measured, a line of JSON a run, and is read if it is there. Printed are a table, and the prices of
`solvers/simulation/memory.py` that these runs give. Some fifteen minutes on one core; the largest run takes 2 GB.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any
from unittest.mock import patch

from stickslip import Simulation, Watch, read
from stickslip.geometry.memory import peak
from stickslip.solvers.parallel.counters import Clock
from stickslip.solvers.simulation.memory import (
    ENTRY,
    GMSH,
    MULTIGRID,
    OWN_POINT,
    POINT,
    PRICES,
    PROGRAM,
    STAGES,
    VIEWERS,
    Counts,
    Demand,
    memory_of,
)
from stickslip.solvers.stepping.choice import Choice, Size, Stage
from stickslip.workflows.lab.benchmarks.own_process import apart
from stickslip.workflows.run.run import run

Run = Mapping[str, Any]  # what `measure` returns
TANGENT = 'solver={ method = "tangent-cg", surface = "matrix-free" }'
UZAWA = 'solver={ method = "surface-uzawa", surface = "matrix-free" }'
CONDENSED = 'solver={ surface = "condensed" }'
SIMPLEX, TENSOR, ORDER_2 = 'geometry.cells="simplex"', 'geometry.cells="tensor"', "geometry.order=2"
FITTED = (  # one of each kind of cell
    ("cube", TANGENT, "geometry.mesh_size=0.03571428571428571"),
    ("cube", TANGENT, "geometry.mesh_size=0.05", SIMPLEX),
    ("cube", TANGENT, "geometry.mesh_size=0.08333333333333333", ORDER_2),
    ("cube", TANGENT, "geometry.mesh_size=0.08333333333333333", ORDER_2, SIMPLEX),
    ("block", CONDENSED, "geometry.mesh_size=0.016", "geometry.contact_mesh_size=0.016"),
    ("block", CONDENSED, "geometry.mesh_size=0.016", "geometry.contact_mesh_size=0.016", TENSOR),
    ("block", CONDENSED, "geometry.mesh_size=0.03", "geometry.contact_mesh_size=0.03", ORDER_2),
    ("block", CONDENSED, "geometry.mesh_size=0.03", "geometry.contact_mesh_size=0.03", ORDER_2, TENSOR),
)
HELD_AGAINST = (  # the prices, which know nothing of these
    ("cube", CONDENSED, "geometry.mesh_size=0.0625", "output.error=false"),
    ("cube", TANGENT, "geometry.mesh_size=0.05", "output.error=true"),
    ("cube", TANGENT, "geometry.mesh_size=0.025", "output.error=false"),
    ("block", UZAWA, "geometry.mesh_size=0.016", "geometry.contact_mesh_size=0.016", "output.error=false"),
)
PHASES = {  # of `Demand`: the phases of the clock, and parts of them, of which each is made; the first that fits
    "end": ("audit", "output/pictures"),
    "meshing": ("mesh",),
    "assembling": ("assemble",),
    "solving": ("prepare", "iterate", "error", "output", "other"),
}


def cases() -> Iterator[tuple[str, ...]]:
    """Yield arguments of each run."""
    for case in FITTED:
        for wanted in ("true", "false"):
            yield (*case, f"output.error={wanted}")
    yield from HELD_AGAINST


def measure(scene: str, override: list[str]) -> dict[str, Any]:
    """Return peaks by stage and by phase of the clock [bytes], its size, and what is predicted for it."""
    peaks, spent = dict[str, float](), Clock._stop
    found, sizes = list[Demand](), dict[str, Any]()

    def stop(clock: Clock) -> None:
        phase = "/".join(filter(None, clock._on[-1]))
        peaks[phase] = max(peaks.get(phase, 0.0), peak())
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
        spent(clock)

    def prepared(simulation: Simulation) -> None:
        found.append(simulation.demand)
        sizes.update(counts(simulation))

    with patch.object(Clock, "_stop", stop), tempfile.TemporaryDirectory() as folder:
        run(read(scene, override), Path(folder) / "run", Watch(on_prepared=prepared))
    return {
        "scene": scene,
        "override": override,
        **sizes,
        "peaks": peaks,
        "stages": by_stage(peaks),
        "predicted": found[0].stages,
        "parts": [asdict(part) for part in found[0].parts],
    }


def counts(simulation: Simulation) -> dict[str, Any]:
    """Return counts that the prices are divided by."""
    mesh, system, stage = simulation.mesh, simulation.system, simulation.stepper.chain.stage
    found = Counts.of(mesh)
    size = Size.of(system.problem, mesh, system.constraints, system.contacts)
    return asdict(found) | {
        "unknowns": size.dofs,
        "entries": size.entries,
        "contact_dofs": size.contact_dofs,
        "dense_bytes": size.dense_bytes,
        "form": stage.surface,
        "method": stage.method,
    }


def by_stage(peaks: dict[str, float]) -> dict[str, float]:
    """Return the peak of each stage [bytes]; "other" ends with the end, and counts for none but as that of solving."""
    found = dict[str, float]()
    for phase, value in peaks.items():
        stage = next((s for s, own in PHASES.items() if phase in own or phase.split("/")[0] in own), "solving")
        if phase not in ("other", "output"):  # they end behind the pictures
            found[stage] = max(found.get(stage, 0.0), value)
    return found


def fitted(runs: Sequence[Run]) -> Iterator[str]:
    """Yield a line of `PRICES` for each kind of cell."""
    for kind in PRICES:
        own = [run for run in runs if (run["shape"], run["order"]) == kind]
        both = {
            wanted: next((r for r in own if f"output.error={wanted}" in r["override"]), None)
            for wanted in ("true", "false")
        }
        if (with_errors := both["true"]) is None or (plain := both["false"]) is None:
            continue
        yield f"{kind}: {price(plain, with_errors)}"


def price(plain: Run, with_errors: Run) -> tuple[int, ...]:
    """Return bytes by cell while meshing and of the mesh, by unknown in steps, of errors, and at the end."""
    cells, unknowns, entries, stages = (plain[key] for key in ("cells", "unknowns", "entries", "stages"))
    meshing = (stages["meshing"] - PROGRAM - GMSH) / cells
    always = PROGRAM + GMSH + ENTRY * entries
    mesh = (stages["assembling"] - always) / cells
    free = plain["form"] == "matrix-free"
    solver = MULTIGRID * entries if free else plain["dense_bytes"]
    dim = 3 if "hedron" in plain["shape"] else 2
    held = always + max(mesh, 0.0) * cells + (POINT + OWN_POINT) * plain["contact_dofs"] / dim
    steps = (stages["solving"] - held - solver) / unknowns
    end = (stages["end"] - held - VIEWERS[dim] - (0.0 if free else solver)) / unknowns
    errors = (with_errors["stages"]["solving"] - stages["solving"]) / unknowns
    return tuple(max(0, round(value)) for value in (meshing, mesh, steps, errors, end))


def lines(runs: Sequence[Run]) -> Iterator[str]:
    """Yield the table: bytes an unknown by stage, and the peak foretold over the measured one."""
    heads = ("cells", "order", "form", "errors", "unknowns", *STAGES, "peak [GB]", "foretold / measured")
    yield f"| {' | '.join(heads)} |"
    yield f"|{' --- |' * len(heads)}"
    for one in runs:
        stages, wanted = one["stages"], "output.error=true" in one["override"]
        most = max(stages.values())
        each = [f"{stages[stage] / one['unknowns']:.0f}" for stage in STAGES]
        cells = (one["shape"], one["order"], one["form"], "yes" if wanted else "no", one["unknowns"])
        yield f"| {' | '.join(map(str, (*cells, *each, f'{most / 1e9:.2f}', f'{foretold(one) / most:.2f}')))} |"


def foretold(run: Run) -> float:
    """Return the peak [bytes] by the prices as they are now."""
    scene, kind = read(run["scene"], run["override"]), (run["shape"], run["order"])
    steps, dim = len(scene.requested_times()), scene.dim
    size = Size(dim, run["unknowns"], run["entries"], run["contact_dofs"], steps)
    choice = Choice((Stage(run["method"], run["form"]),), "")
    return memory_of(scene.output, Counts(*kind, run["cells"]), size, choice).peak


def main() -> None:
    """Measure, or read what was measured, and print."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    if path is not None and path.exists():
        runs = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    else:
        runs = [apart(measure, scene, override) for scene, *override in cases()]
    if path is not None and not path.exists():
        path.write_text("".join(json.dumps(run) + "\n" for run in runs), encoding="utf-8")
    print("\n".join((*lines(runs), "", *fitted(runs))))


if __name__ == "__main__":
    main()
