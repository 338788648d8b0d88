"""Steps audited without their files."""

from dataclasses import asdict

from solvers.results.audit import Auditor, Record
from solvers.results.step_result import StepResult
from solvers.simulation.simulation import Simulation

NAMES = ("time", "displacement", "p", "w", "reference", "driven", "searched", "p_ref", "u_ref")


def record_of(step: StepResult) -> Record:
    """What is audited of a step that was just solved."""
    return Record(**{name: getattr(step, name) for name in NAMES}, external_work=step.energy.external)


def audit(simulation: Simulation, step: StepResult) -> dict[str, float]:
    """Defects by name."""
    return asdict(Auditor(simulation.problem, simulation.mesh)(record_of(step)))
