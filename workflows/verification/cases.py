"""The verification problems by name: what `stickslip verify` runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from workflows.verification import (
    block_case,
    circular_drive_case,
    column_case,
    raous_case,
    regularised_case,
    sheared_column_case,
    zeros_case,
)
from workflows.verification.check import Check

METHODS = ("condensed-newton", "uzawa")


@dataclass(frozen=True, kw_only=True)
class Case:
    """A verification problem; `checks` solves it with a method."""

    about: str
    checks: Callable[[str], list[Check]]


CASES: Mapping[str, Case] = {
    "column": Case(about="column on a compliant foundation, against the closed form", checks=column_case.checks),
    "sheared_column": Case(about="stick, slip, reversal, dissipation, closed form", checks=sheared_column_case.checks),
    "circular_drive": Case(about="the round friction cone in 3D, closed form", checks=circular_drive_case.checks),
    "raous": Case(about="block of Raous, Chabrand and Lebon, published figures", checks=raous_case.checks),
    "zeros": Case(about="no force, friction, increment, bound or touch: nothing changes", checks=zeros_case.checks),
    "block": Case(about="the ready scene, one method against the other", checks=block_case.checks),
    "regularised": Case(about="smoothed laws, off by no more than stated", checks=regularised_case.checks),
}
