"""Errors of the numbers that a step reports: a key for each number, and the parts of its error by their source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import reduce
from operator import add
from typing import NamedTuple

from stickslip.geometry.arrays import Array

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
    corrected: Value | None = None  # the number with most of the mesh's error removed, where that is found at the end

    @property
    def total(self) -> Value | None:
        """Sum of all parts; None if one of them is not computed."""
        parts = [getattr(self, name) for name in PARTS]
        # not sum(): from Python 3.12 on it rounds floats, which a resumed run reads, otherwise than numpy's numbers
        return None if any(part is None for part in parts) else reduce(add, parts)

    def joined(self, other: ErrorParts) -> ErrorParts:
        """The parts of both; where both have one, that of `other`."""
        theirs = {f.name: getattr(other, f.name) for f in fields(other)}
        mine = {f.name: getattr(self, f.name) for f in fields(self)}
        return ErrorParts(**mine | {name: part for name, part in theirs.items() if part is not None})


PARTS = tuple(f.name for f in fields(ErrorParts) if f.name not in ("converges", "corrected"))
Errors = Mapping[Quantity, ErrorParts]  # of one step
