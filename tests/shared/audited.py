"""Steps solved and audited without their files."""

from dataclasses import asdict

from stickslip import Scene, Simulation, StepResult
from stickslip.solvers.results.audit import Auditor, Record
from stickslip.solvers.results.step_result import told
from stickslip.solvers.results.stored_fields import StoredFields
from stickslip.workflows.lab.verification.prepared import prepare

record_of = Record.of  # what is audited of a step that was just solved, without the fields for readers


def solved(scene: Scene) -> tuple[Simulation, list[StepResult]]:
    """All steps of a scene."""
    simulation = prepare(scene)
    return simulation, list(simulation.steps())


def stored_by(step: StepResult, before: StepResult | None = None) -> StoredFields:
    """The fields for readers, and the numbers of result.json; before: the step before, None of the first one."""
    contacts = {name: vars(contact) for name, contact in step.contacts.items()}
    moments = {name: contact.moment for name, contact in step.contacts.items()}
    return StoredFields(
        stress=step.stress,
        von_mises=step.von_mises,
        contacts=contacts,
        moments=moments,
        told=told(step, None),
        told_before={} if before is None else told(before, None),
        law_error=step.law_error,
    )


def audit(simulation: Simulation, step: StepResult) -> dict[str, float]:
    """Defects by name."""
    return asdict(Auditor(simulation.problem, simulation.mesh)(record_of(step)))
