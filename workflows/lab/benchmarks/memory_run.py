"""One measurement of memory: `python -m stickslip.workflows.lab.benchmarks.memory_run SCENE KEY=VALUE...`.

A run of a scene whose peaks of resident memory are read, and begun anew, whenever its clock goes on to another phase
(Linux: VmHWM, and 5 in /proc/self/clear_refs). Prints them in JSON, with the size of the problem and what
`memory_of` predicts for it. Set OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stickslip.geometry.memory import peak
from stickslip.solvers.parallel.counters import Clock
from stickslip.solvers.simulation.memory import Counts, Demand
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.choice import Size
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

STAGES = {  # of `Demand`: the phases of the clock, and parts of them, of which each is made; the first that fits
    "end": ("audit", "output/pictures"),
    "meshing": ("mesh",),
    "assembling": ("assemble",),
    "solving": ("prepare", "iterate", "error", "output", "other"),
}


def measure(scene: str, override: list[str]) -> dict[str, Any]:
    """Peaks by stage, and by phase of the clock [bytes]; the size of the problem, and what is predicted for it."""
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

    Clock._stop = stop  # type: ignore[method-assign, assignment]
    try:
        with tempfile.TemporaryDirectory() as folder:
            run(read(scene, override), Path(folder) / "run", Watch(on_prepared=prepared))
    finally:
        Clock._stop = spent  # type: ignore[method-assign]
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
    """Counts that the prices are divided by."""
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
    """The peak of each stage [bytes]; "other" ends with the end, and counts for none but as that of solving."""
    found = dict[str, float]()
    for phase, value in peaks.items():
        stage = next((s for s, own in STAGES.items() if phase in own or phase.split("/")[0] in own), "solving")
        if phase not in ("other", "output"):  # they end behind the pictures
            found[stage] = max(found.get(stage, 0.0), value)
    return found


def main() -> None:
    """Measure the scene that the arguments name, and print the result in JSON."""
    print(json.dumps(measure(sys.argv[1], sys.argv[2:])))


if __name__ == "__main__":
    main()
