"""result.json: the whole run in one file that scripts can rely on (format 1, no NaN, null where not computed).

What a step holds is a walk over its records, and so are schema and units.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired, cast, get_type_hints

import numpy as np
from pydantic import ConfigDict, TypeAdapter, with_config
from typing_extensions import TypedDict

from stickslip import VERSION
from stickslip.geometry.dolfinx_versions import DOLFINX
from stickslip.geometry.keys import Key
from stickslip.geometry.units import SI, Units
from stickslip.solvers.accuracy.budget import Choice
from stickslip.solvers.effects import is_single, records
from stickslip.solvers.iteration import Convergence
from stickslip.solvers.parallel.counters import PHASES, Counters, Row
from stickslip.solvers.results.audit import Audit
from stickslip.solvers.results.linear_reference import LinearReference
from stickslip.solvers.results.step_result import (
    PARTS,
    STATUS_WORDS,
    ErrorParts,
    Errors,
    StepResult,
    energy_norm,
    is_estimated,
    told,
    uncertainty,
)
from stickslip.solvers.results.verdict import limits
from stickslip.solvers.scene.problem import PlanRow
from stickslip.solvers.scene.record import Batch, Event, RecordType, numbers_of
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.choice import Stage
from stickslip.solvers.stepping.method_chain import Switch
from stickslip.workflows.formats.files import write_json
from stickslip.workflows.formats.results import PER_METRE, seconds_of
from stickslip.workflows.run.audit import Audited
from stickslip.workflows.run.neglect import Neglected
from stickslip.workflows.scene_file.identity import identity
from stickslip.workflows.scene_file.read import to_dict

OF_COARSE = ("factorisations", "volume_solves", "linear_iterations")  # counters of the coarse mesh beside
TYPED, DICT, LIST = cast(Any, TypedDict), cast(Any, dict), cast(Any, list)  # of types that are known at run time only
SAID, OPTIONAL = cast(Any, Annotated), cast(Any, NotRequired)
DIALECT = "https://json-schema.org/draft/2020-12/schema"
STATUSES = Literal["converged", "doubtful", "not_converged", "no_equilibrium", "inaccurate", "interrupted"]
LARGEST = ("discretisation", "law", "iteration", "linear_solver")  # errors of the run
Numbers = float | list[float]  # a number, or a vector by component
DPKG = Path("/var/lib/dpkg/status")
DEBIAN = re.compile(  # the rest of a name is the version of the library's interface
    r"lib(dolfinx-real|petsc-real|slepc-real|mumps-|hypre-|gmsh|occt-modeling-algorithms-|openblas0-pthread|openmpi|"
    r"hdf5-openmpi-|seccomp)[0-9.t-]*|python3-(dolfinx-real|ffcx|ufl|gmsh|petsc4py-real|scipy|h5py-mpi|seccomp)"
)
PYPI = ("numpy", "pydantic")
WHEEL = "dolfinx-solver-real"  # PETSc, SLEPc, MUMPS, OpenBLAS and HDF5 are in it
BESIDE_WHEEL = ("fenics-ffcx", "fenics-ufl", "gmsh", "h5py", "mpi4py", "mpich", "scipy")


@dataclass(frozen=True)
class Outcome:
    """Ending of a run."""

    status: str  # converged, doubtful, not_converged, no_equilibrium, interrupted; of rounds also inaccurate
    sentence: str  # what to tell the user, empty when converged
    folder: Path
    warnings: tuple[str, ...] = ()  # what the answer itself gives reason to doubt

    @property
    def exit_code(self) -> int:
        return {"converged": 0, "doubtful": 1, "interrupted": 130}.get(self.status, 3)


def summary(
    simulation: Simulation,
    outcome: Outcome,
    steps: Sequence[StepResult],
    audited: Audited,
    reference: LinearReference | None = None,
    errors: Sequence[Errors] | None = None,
    choice: Choice | None = None,
    left_out: Sequence[Neglected] = (),
) -> dict[str, Any]:
    """The content of result.json; what of the numbers' `errors`, and of their choice, is not there is null."""
    scene, counters, rows = simulation.scene, simulation.counters, simulation.clock.rows()
    audits = audited.audits
    contacts, chain = simulation.system.contacts, simulation.stepper.chain
    resolved, nothing = to_dict(scene), [None] * len(steps)
    return {
        "format": 1,
        "status": outcome.status,
        "sentence": outcome.sentence,
        "warnings": list(outcome.warnings),
        "units": units(plane=scene.model.startswith("plane"), of=scene.labels),
        "scene": resolved | {"hash": scene_hash(scene)},
        "version": VERSION,
        "dolfinx": DOLFINX,
        "packages": packages(),
        "ranks": simulation.mesh.comm.size,
        "method": chain.stage.method,
        "choice": {**asdict(chain.choice.stages[0]), "because": chain.choice.because},
        "switches": [asdict(switch) for switch in chain.switches],
        "dofs": simulation.system.constraints.free_total,
        "contact_points": sum(len(c.W_n) for c in contacts),
        "plan": [asdict(row) for row in simulation.plan],
        "steps": [
            told(step, each) | {"audit": audit and asdict(audit)}
            for step, each, audit in zip(steps, errors or nothing, audits or nothing, strict=True)
        ],
        "events": [event._asdict() for step in steps for event in step.events],
        "cycles": [batch._asdict() for step in steps for batch in step.batches],
        "counters": {
            "unknowns": {
                "displacement": simulation.system.constraints.free_total,
                "normal": sum(len(c.W_n) for c in contacts if not c.normal.at_quadrature),
                "tangential": sum(int(c.free.sum()) for c in contacts),
            },
            "dropped_multipliers": sum(c.dropped for c in contacts),
            **asdict(counters),
            "coarse_mesh": chain.coarse_counters and {key: getattr(chain.coarse_counters, key) for key in OF_COARSE},
        },
        "audit": Audit.worst(audit for audit in audits if audit),
        "verdict": _verdict(simulation, steps, audited) if audits else None,
        "error": {
            "discretisation": _largest([step.mesh_error for step in steps]),
            "law": _largest([step.law_error for step in steps]),
            "iteration": _largest([step.iteration_error for step in steps]),
            "linear_solver": _largest([step.linear_error for step in steps]),
            "what": "relative, energy norm",
        },
        "neglect": [asdict(row) for row in left_out],
        "estimates": choice and asdict(choice),
        "seconds": seconds_of(rows, reference.seconds if reference else None),
        "profile": [asdict(row) for row in rows],
        "linear_reference": reference and asdict(reference),
    }


def _largest(errors: Sequence[float]) -> float | None:
    """Return the sum over all steps; NaN, which becomes null, where that of a step is not known."""
    return float(np.max(errors)) if errors else None


def _verdict(simulation: Simulation, steps: Sequence[StepResult], audited: Audited) -> dict[str, Any]:
    law_error, rounding = max(s.law_error for s in steps), max((a.rounding for a in audited.audits if a), default=0.0)
    return {
        "limits": asdict(limits(simulation.scene.solver.tolerance, law_error, rounding)),
        "exceeded": list(audited.passed),
        "passed": list(audited.passed),
        "shared": list(audited.shared),
    }


def scene_hash(scene: Scene) -> str:
    """Return a hash that is the same for the same scene; a geometry file counts by its content, not by its place."""
    return hashlib.sha256(json.dumps(identity(scene, ("units",)), sort_keys=True).encode()).hexdigest()


def write_result(folder: Path, content: dict[str, Any]) -> None:
    """Write result.json."""
    write_json(folder / "result.json", content)


def units(plane: bool, of: Units = SI) -> dict[str, str]:
    """Units of the numbers of a step.

    Args:
        plane: whether forces, areas and energies are those of a metre of thickness.
        of: those of the scene.

    >>> units(plane=True)["contacts.normal_force"], units(plane=False)["contacts.normal_force"]
    ('N/m', 'N')
    """
    found = {key: number.unit for key, number in numbers_of(StepResult).items()} | {"other_solutions": "N", "jump": "J"}
    for table, record in records().items():
        found |= {f"{table}.{key}": number.unit for key, number in numbers_of(record).items()}
    return {name: of(PER_METRE.get(unit, unit) if plane else unit) for name, unit in found.items() if unit}


def result_schema() -> dict[str, Any]:
    """The schema of what this version writes; a number that is not finite is null."""
    found = TypeAdapter(_result()).json_schema()
    return {"$schema": DIALECT, **_nullable(found), "title": "result.json of stickslip"}


def _table(name: str, keys: Mapping[str, Any], said: str | None = None) -> Any:
    """A type of tables that have these keys alone."""
    found = with_config(ConfigDict(extra="forbid"))(TYPED(name, dict(keys)))
    found.__doc__ = said
    return found


def _result() -> Any:
    """The type of the whole, from the types that its tables are made of."""
    phases: dict[str, Any] = {phase: Annotated[float, Key("s", said)] for phase, said in PHASES.items()}
    phases["linear_reference"] = Annotated[float | None, Key("s", "of the fastest solver: the unit of cost")]
    phases["linear_reference_others"] = Annotated[float | None, Key("s", "of those that it was compared with")]
    unknowns = _table("Unknowns", dict.fromkeys(("displacement", "normal", "tangential"), int))
    counted = {"unknowns": unknowns, "dropped_multipliers": int, **get_type_hints(Counters)}
    counted["coarse_mesh"] = dict[str, int] | None
    shared = Annotated[list[str], Key("", "what the audit takes from the code that it judges")]
    exceeded = Annotated[list[str], Key("", "sentences on the limits that are exceeded")]
    alias = Annotated[list[str], Key("", "the same as `exceeded`")]
    judged: dict[str, Any] = {"limits": Audit, "exceeded": exceeded, "passed": alias, "shared": shared}
    goal = _table("Goal", {"value": float, "error": float, "asked": Annotated[float, Key("", "as the error")]})
    sizes: dict[str, Any] = {"order": int, "unknowns": int, "steps": int, "seconds": float}
    accuracy: dict[str, Any] = {
        "met": Annotated[bool, Key("", "false: exit code 3, the budget did not reach a goal")],
        "rounds": LIST[_table("Round", sizes | {"goals": DICT[str, goal]})],
        "scene": Annotated[str, Key("", "hash of the scene as it was asked, before refinement")],
    }
    keys: dict[str, Any] = {
        "format": Literal[1],
        "status": Annotated[STATUSES, Key("", "exit codes: converged 0, doubtful 1, interrupted 130, the others 3")],
        "sentence": Annotated[str, Key("", "what the run says at its end; empty when converged")],
        "warnings": list[str],
        "units": Annotated[dict[str, str], Key("", "of the numbers of a step, as table.number")],
        "scene": Annotated[dict[str, Any], Key("", "the resolved scene with all defaults, and its hash")],
        "version": str,
        "dolfinx": str,
        "packages": dict[str, str],
        "ranks": int,
        "method": str,
        "choice": _table(
            "Choice", get_type_hints(Stage) | {"because": str}, "The first method, and why it was chosen."
        ),
        "switches": list[Switch],
        "dofs": int,
        "contact_points": int,
        "plan": list[PlanRow],
        "steps": LIST[_reported_step()],
        "events": Annotated[list[Event], Key("", "that a clock has found")],
        "cycles": Annotated[list[Batch], Key("", "batches of load cycles that `steps.cycle` has found")],
        "counters": _table("Counters", counted, "What the run has done so many times."),
        "audit": Annotated[Audit | None, Key("", "the largest defects of all steps")],
        "verdict": _table("Verdict", judged) | None,
        "error": _table("Errors", dict.fromkeys(LARGEST, float | None) | {"what": str}, "The largest of all steps."),
        "neglect": SAID[list[Neglected], Key("", "effects that are off: what they would change in the last step")],
        "estimates": Choice | None,
        "seconds": SAID[_table("Seconds", phases | {"total": float}), Key("s", "wall time by phase")],
        "profile": list[Row],
        "linear_reference": LinearReference | None,
        "accuracy": OPTIONAL[_table("Accuracy", accuracy, "Goals of a run; all else is of the last round.")],
    }
    return _table("Result", keys, "A run. null: not computed.")


def _reported_step() -> Any:
    """The type of a step, from its records."""
    error: dict[str, Any] = {"total": Annotated[Numbers | None, Key("", "sum of the parts that are there")]}
    hints = get_type_hints(ErrorParts, include_extras=True)
    for name in (name for name in hints if name != "dear"):
        kind: Any = {"by": str, "converges": bool, "unsure": bool}.get(name, Numbers)
        error[name] = SAID[kind | None, hints[name].__metadata__[0]]
    said = "parts that the total lacks: times the run that each would cost; null: not known at any price"
    error["lacking"] = Annotated[dict[str, float | None], Key("", said)]
    errors = SAID[
        DICT[str, _table("Error", error, ErrorParts.__doc__)] | None, Key("", "by number; null: not estimated")
    ]
    sides = _table("Sides", dict.fromkeys(("below", "above"), Numbers), "Derivatives by a smaller and a larger number.")
    parts = {"inputs": Numbers | None, "combined": Numbers | None, "shares": dict[str, Numbers] | None}
    said = "by number, and by number of the scene; null: none; two sides: points are at their bound"
    inputs: dict[str, Any] = {
        "sensitivity": OPTIONAL[SAID[DICT[str, DICT[str, Numbers | sides | None]], Key("", said)]],
        "uncertainty": OPTIONAL[DICT[str, _table("Uncertainty", parts, uncertainty.__doc__)]],
    }
    shapes: dict[str, Any] = {"": float, "vector": list[float], "turn": Numbers, "stress": list[float]}
    hints = get_type_hints(StepResult, include_extras=True)
    keys = {key: hints[key] for key in numbers_of(StepResult)}
    statuses = _table("Counts", dict.fromkeys(STATUS_WORDS, int), "Number of the nodes of each status.")
    made = dict[RecordType, Any]()
    for table, record in records().items():
        if record not in made:
            own: dict[str, Any] = {
                key: OPTIONAL[SAID[float, number]] if number.needs else SAID[shapes[number.shape], number]
                for key, number in numbers_of(record).items()
            }
            own |= {"statuses": statuses} if table == "contacts" else {}
            own |= {"error": errors, **inputs} if is_estimated(record) else {}
            made[record] = _table(record.__name__, own, record.__doc__)
        single = made[record] if table == "energy" else made[record] | None  # null: the effect is off
        keys[table] = single if is_single(table) else DICT[str, made[record]]
    norm: dict[str, Any] = dict.fromkeys(("total", *PARTS), float | None) | {"converges": bool}
    keys["error"] = _table("StepErrors", {"energy_norm": _table("EnergyNorm", norm, energy_norm.__doc__)})
    keys["audit"] = Annotated[Audit | None, Key("", "relative defects; null: not audited")]
    keys["convergence"] = Annotated[Convergence | None, Key("", "of Uzawa's iteration; null: not measured")]
    keys["other_solutions"] = Annotated[list[dict[str, float]], Key("N", "normal force by contact, of those met")]
    said = "proved: one solution, whatever sticks, slips or opens; several: others are listed; not proved"
    keys["unique"] = Annotated[Literal["proved", "several", "not proved"], Key("-", said)]
    said = "energy set free where no solution goes on from the step before; null: one does"
    keys["jump"] = Annotated[float | None, Key("J", said)]
    return _table("StepRecord", keys, "A reported step.")


def _nullable(node: Any) -> Any:
    """Numbers may be null; titles repeat the keys."""
    if isinstance(node, list):
        return [_nullable(item) for item in node]
    if not isinstance(node, Mapping):
        return node
    found = {key: _nullable(value) for key, value in node.items() if not (key == "title" and isinstance(value, str))}
    return found | {"type": ["number", "null"]} if node.get("type") == "number" else found


@cache
def packages() -> dict[str, str]:
    """Version of each package by name: PyPI's alone where dolfinx is a wheel, else Debian's too where there is dpkg."""
    found = _of_pypi(*PYPI, WHEEL)
    if WHEEL in found:
        return dict(sorted((found | _of_pypi(*BESIDE_WHEEL)).items()))
    try:
        text = DPKG.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return found
    for entry in text.split("\n\n"):
        fields = dict(re.findall(r"^(Package|Status|Version): (.*)$", entry, re.MULTILINE))
        if DEBIAN.fullmatch(fields.get("Package", "")) and fields.get("Status", "").endswith(" installed"):
            found[fields["Package"]] = fields["Version"]
    return dict(sorted(found.items()))


def _of_pypi(*names: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for name in names:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found
