"""Every number that a step reports, by its key."""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.results.error_parts import Quantity, Value
from stickslip.solvers.results.step_result import ContactState, Numbers, StepResult
from stickslip.solvers.scene.quantities import CONTACT_NUMBERS, STRESSES

ENERGIES = ("external", "stored", "contact", "compliance", "dissipated")  # its parts; the remainder follows from them


def quantities(step: StepResult | Numbers) -> dict[Quantity, Value]:
    """Every number of a step, in SI units: floats, and vectors (d,) of forces, displacements and moments.

    A moment in the plane is a number, a stress has the six components of `STRESSES`.
    """
    found: dict[Quantity, Value] = {}
    for name, contact in step.contacts.items():
        found |= {Quantity("contacts", name, key): value for key, value in _of_contact(contact).items()}
    for name, support in step.supports.items():
        found[Quantity("supports", name, "force")] = support.force
        found[Quantity("supports", name, "moment")] = _moment(support.moment)
    for name, support in step.elastic_support.items():
        found[Quantity("elastic_support", name, "force")] = support.force
        found[Quantity("elastic_support", name, "moment")] = _moment(support.moment)
    for name, obstacle in step.obstacles.items():
        found[Quantity("obstacles", name, "displacement")] = obstacle.displacement
        found[Quantity("obstacles", name, "force")] = obstacle.force
        found[Quantity("obstacles", name, "moment")] = _moment(obstacle.moment)
    for name, spring in step.springs.items():
        found[Quantity("springs", name, "force")] = spring.force
    for name, bolt in step.bolts.items():
        found[Quantity("bolts", name, "tension")] = bolt.tension
    for name, point in step.remote_points.items():
        found[Quantity("remote_points", name, "displacement")] = point.displacement
        found[Quantity("remote_points", name, "rotation")] = _moment(point.rotation)
        found[Quantity("remote_points", name, "force")] = point.force
        found[Quantity("remote_points", name, "moment")] = _moment(point.moment)
    for name, probe in step.probes.items() if isinstance(step, StepResult) else ():
        found[Quantity("probes", name, "displacement")] = probe.displacement
        found[Quantity("probes", name, "stress")] = np.array([probe.stress[ij] for ij in STRESSES.values()])
    return found | {Quantity("energy", "", key): float(getattr(step.energy, key)) for key in ENERGIES}


def _of_contact(contact: ContactState) -> dict[str, Value]:
    resultants: dict[str, Value] = {"force": contact.force, "moment": _moment(contact.moment)}
    return resultants | {key: float(getattr(contact, key)) for key in CONTACT_NUMBERS}


def _moment(moment: Array) -> Value:
    """A number in the plane, three components in space."""
    return float(moment[0]) if len(moment) == 1 else moment
