"""result.json: the whole run in one file that scripts can rely on (format 1, no NaN, null where not computed).

Its tables are the records of result_schema.py.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stickslip import VERSION
from stickslip.geometry.dolfinx_versions import DOLFINX
from stickslip.solvers.results.audit import Audit
from stickslip.solvers.results.error_parts import PARTS, ErrorParts, Errors
from stickslip.solvers.results.linear_reference import LinearReference
from stickslip.solvers.results.step_result import ContactState, StepResult
from stickslip.solvers.results.verdict import limits
from stickslip.solvers.scene.quantities import CONTACT_NUMBERS, STRESSES
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.formats.aside import write_aside
from stickslip.workflows.formats.profile import seconds_of
from stickslip.workflows.run.audit import Audited
from stickslip.workflows.run.packages import packages
from stickslip.workflows.run.result_schema import units
from stickslip.workflows.scene_file.identity import identity
from stickslip.workflows.scene_file.read import to_dict

OF_COARSE = ("factorisations", "volume_solves", "linear_iterations")  # counters of the coarse mesh beside


@dataclass(frozen=True)
class Outcome:
    """How a run ended."""

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
) -> dict[str, Any]:
    """The content of result.json; without `errors` of the numbers of each step they are null."""
    scene, counters, rows = simulation.scene, simulation.counters, simulation.clock.rows()
    audits = audited.audits
    contacts, chain = simulation.system.contacts, simulation.stepper.chain
    resolved = to_dict(scene)
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
            _step(step, errors[index] if errors else None, audits[index] if audits else None)
            for index, step in enumerate(steps)
        ],
        "counters": {
            "unknowns": {
                "displacement": simulation.system.constraints.free_total,
                "normal": sum(len(c.W_n) for c in contacts if not c.normal.at_quadrature),
                "tangential": sum(int(c.free.sum()) for c in contacts),
            },
            "dropped_multipliers": sum(c.dropped for c in contacts),
            "forms": counters.forms,
            "searches": counters.searches,
            "factorisations": counters.factorisations,
            "schur_size": counters.schur_size,
            "volume_solves": counters.volume_solves,
            "linear_iterations": counters.linear_iterations,
            "error_solves": counters.error_solves,
            "lanczos_applications": counters.lanczos_applications,
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
        "seconds": seconds_of(rows, reference.seconds if reference else None),
        "profile": [asdict(row) for row in rows],
        "linear_reference": reference and asdict(reference),
    }


def _largest(errors: Sequence[float]) -> float | None:
    """Of all steps; NaN, which becomes null, where that of a step is not known."""
    return float(np.max(errors)) if errors else None


def _verdict(simulation: Simulation, steps: Sequence[StepResult], audited: Audited) -> dict[str, Any]:
    law_error, rounding = max(s.law_error for s in steps), max((a.rounding for a in audited.audits if a), default=0.0)
    return {
        "limits": asdict(limits(simulation.scene.solver.tolerance, law_error, rounding)),
        "passed": list(audited.passed),
        "shared": list(audited.shared),
    }


def scene_hash(scene: Scene) -> str:
    """The same for the same scene; a geometry file counts by its content, not by its place."""
    return hashlib.sha256(json.dumps(identity(scene, ("units",)), sort_keys=True).encode()).hexdigest()


def write_result(folder: Path, content: dict[str, Any]) -> None:
    """Write result.json."""
    write_json(folder / "result.json", content)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a JSON file whole; see `write_aside`."""
    write_aside(path, f"{json_text(content)}\n".encode())


def json_text(content: dict[str, Any]) -> str:
    """As a JSON file has it; a number that is not finite becomes null."""
    return json.dumps(_finite(content), indent=1, ensure_ascii=False, allow_nan=False)


def _step(step: StepResult, errors: Errors | None, audit: Audit | None) -> dict[str, Any]:
    energy = step.energy

    def error(kind: str, name: str = "") -> dict[str, Any]:
        """By quantity; null: not estimated."""
        found = {
            key.quantity: _parts(parts) | {"corrected": _plain(step.corrected.get(str(key), parts.corrected))}
            for key, parts in (errors or {}).items()
            if key[:2] == (kind, name)
        }
        return {"error": found or None}

    return {
        "time": step.time,
        "substeps": step.substeps,
        "iterations": step.iterations,
        "volume_solves": step.volume_solves,
        "residual": step.residual,
        "contacts": {name: _contact(contact) | error("contacts", name) for name, contact in step.contacts.items()},
        "supports": {
            name: {"force": f.tolist(), "moment": _moment(m)} | error("supports", name)
            for name, (f, m) in step.supports.items()
        },
        "obstacles": {
            name: {"displacement": u.tolist(), "force": f.tolist(), "moment": _moment(m)} | error("obstacles", name)
            for name, (u, f, m) in step.obstacles.items()
        },
        "springs": {
            name: {"force": force.tolist()} | error("springs", name) for name, (force,) in step.springs.items()
        },
        "bolts": {name: bolt._asdict() | error("bolts", name) for name, bolt in step.bolts.items()},
        "remote_points": {
            name: {"displacement": u.tolist(), "rotation": _moment(turn), "force": f.tolist(), "moment": _moment(m)}
            | error("remote_points", name)
            for name, (u, turn, f, m) in step.remote_points.items()
        },
        "elastic_support": {
            name: {"force": f.tolist(), "moment": _moment(m)} | error("elastic_support", name)
            for name, (f, m) in step.elastic_support.items()
        },
        "probes": {
            name: {"displacement": u.tolist(), "stress": [float(sigma[ij]) for ij in STRESSES.values()]}
            | error("probes", name)
            for name, (u, sigma) in step.probes.items()
        },
        "bodies": {name: body._asdict() for name, body in step.bodies.items()},
        "energy": {
            "external": energy.external,
            "stored": energy.stored,
            "contact": energy.contact,
            "compliance": energy.compliance,
            "dissipated": energy.dissipated,
            "time_remainder": energy.time_remainder,
        }
        | error("energy"),
        "error": {"energy_norm": _energy_norm(step)},
        "audit": audit and asdict(audit),
        "convergence": step.convergence and asdict(step.convergence),
        "other_solutions": [dict(forces) for forces in step.other_solutions],
    }


def _energy_norm(step: StepResult) -> dict[str, Any]:
    """Error of the displacement, relative to the largest so far, by its parts; null: not computed, nor is the total."""
    return {
        "total": None,
        "mesh": step.mesh_error,
        "geometry": None,
        "time_step": None,
        "law": step.law_error,
        "iteration": step.iteration_error,
        "linear_solver": step.linear_error,
        "converges": True,
    }


def _parts(parts: ErrorParts) -> dict[str, Any]:
    """The error of one number, in its unit; null: not computed, nor is the total."""
    found = {name: getattr(parts, name) for name in ("total", *PARTS, "converges")}
    return {name: _plain(value) for name, value in found.items()}


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _contact(contact: ContactState) -> dict[str, Any]:
    resultants = {"force": contact.force.tolist(), "moment": _moment(contact.moment)}
    return resultants | {key: getattr(contact, key) for key in CONTACT_NUMBERS} | {"statuses": contact.counts()}


def _moment(moment: np.ndarray[Any, Any]) -> Any:
    """A number in the plane, three components in space."""
    return float(moment[0]) if len(moment) == 1 else moment.tolist()


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
