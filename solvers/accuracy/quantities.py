"""Every number that a step reports, by a key, and the parts of its error: the keys that all estimates share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from geometry.arrays import Array
from solvers.results.step_result import ContactState, StepResult
from solvers.scene.quantities import CONTACT_NUMBERS, STRESSES

ENERGIES = ("external", "stored", "contact", "compliance", "dissipated")  # its parts; the remainder follows from them

Value = float | Array  # a number, or a vector by component


class Quantity(NamedTuple):
    """Key of a reported number, as it stands in result.json.

    >>> print(Quantity("contacts", "base", "normal_force"), Quantity("energy", "", "stored"))
    contacts.base.normal_force energy.stored
    """

    kind: str  # contacts, supports, obstacles, probes or energy
    name: str  # of the contact, support, obstacle or probe; empty for energy
    quantity: str

    def __str__(self) -> str:
        return ".".join(word for word in self if word)


@dataclass(frozen=True, kw_only=True)
class ErrorParts:
    """Error of one number by its sources, each >= 0 in the unit of the number; of a vector by component.

    None: that part is not computed.
    """

    mesh: Value | None = None  # of the finite element space
    geometry: Value | None = None  # of curved sides that straight ones cut
    time_step: Value | None = None  # of the finite steps of the history
    law: Value | None = None  # of a method's approximation of the contact laws
    iteration: Value | None = None  # of what iterations left
    linear_solver: Value | None = None  # of iterative volume solves
    converges: bool | None = None  # whether the number has a limit on ever finer meshes; None: not known

    @property
    def total(self) -> Value | None:
        """Sum of all parts; None if one of them is not computed."""
        parts = [getattr(self, name) for name in PARTS]
        return None if any(part is None for part in parts) else sum(parts[1:], start=parts[0])

    def joined(self, other: ErrorParts) -> ErrorParts:
        """The parts of both; where both have one, that of `other`."""
        theirs = {f.name: getattr(other, f.name) for f in fields(other)}
        mine = {f.name: getattr(self, f.name) for f in fields(self)}
        return ErrorParts(**mine | {name: part for name, part in theirs.items() if part is not None})


PARTS = tuple(f.name for f in fields(ErrorParts) if f.name != "converges")
Errors = Mapping[Quantity, ErrorParts]  # of one step


def quantities(step: StepResult) -> dict[Quantity, Value]:
    """Every number of a step, in SI units: floats, and vectors (d,) of forces, displacements and moments.

    A moment in the plane is a number, a stress has the six components of `STRESSES`.
    """
    found: dict[Quantity, Value] = {}
    for name, contact in step.contacts.items():
        found |= {Quantity("contacts", name, key): value for key, value in _of_contact(contact).items()}
    for name, support in step.supports.items():
        found[Quantity("supports", name, "force")] = support.force
        found[Quantity("supports", name, "moment")] = _moment(support.moment)
    for name, obstacle in step.obstacles.items():
        found[Quantity("obstacles", name, "displacement")] = obstacle.displacement
        found[Quantity("obstacles", name, "force")] = obstacle.force
        found[Quantity("obstacles", name, "moment")] = _moment(obstacle.moment)
    for name, probe in step.probes.items():
        found[Quantity("probes", name, "displacement")] = probe.displacement
        found[Quantity("probes", name, "stress")] = np.array([probe.stress[ij] for ij in STRESSES.values()])
    return found | {Quantity("energy", "", key): float(getattr(step.energy, key)) for key in ENERGIES}


def _of_contact(contact: ContactState) -> dict[str, Value]:
    resultants: dict[str, Value] = {"force": contact.force, "moment": _moment(contact.moment)}
    return resultants | {key: float(getattr(contact, key)) for key in CONTACT_NUMBERS}


def _moment(moment: Array) -> Value:
    """A number in the plane, three components in space."""
    return float(moment[0]) if len(moment) == 1 else moment
