"""The verification problems by name: what `stickslip verify` runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from workflows.verification import (
    agreement_case,
    cattaneo_case,
    circular_drive_case,
    column_case,
    hertz_case,
    incline_case,
    lifted_case,
    limits_case,
    manufactured_case,
    pair_case,
    patch_case,
    punch_case,
    raous_case,
    raous_compliance_case,
    shear_lag_case,
    sheared_column_case,
    shrink_fit_case,
    slivers_case,
    units_case,
    zeros_case,
)
from workflows.verification.check import Check

TWO = ("condensed-newton", "uzawa")
METHODS = (*TWO, "surface-uzawa")  # this one where it does not take minutes


@dataclass(frozen=True, kw_only=True)
class Case:
    """A verification problem; `checks` solves it with a method."""

    about: str
    checks: Callable[[str], list[Check]]
    methods: tuple[str, ...] = METHODS


CASES: Mapping[str, Case] = {
    "column": Case(about="column on a compliant foundation, against the closed form", checks=column_case.checks),
    "sheared_column": Case(about="stick, slip, reversal, dissipation, closed form", checks=sheared_column_case.checks),
    "circular_drive": Case(about="the round friction cone in 3D, closed form", checks=circular_drive_case.checks),
    "raous": Case(about="block of Raous, Chabrand and Lebon, published figures", checks=raous_case.checks),
    "manufactured": Case(about="rates of convergence, both orders, three laws", checks=manufactured_case.checks),
    "incline": Case(about="layer that friction holds, and one that it cannot", checks=incline_case.checks),
    "slivers": Case(about="cells of aspect 1000, closed forms and iterations", checks=slivers_case.checks, methods=TWO),
    "shear_lag": Case(about="a strip slips from its end: partial slip, hysteresis", checks=shear_lag_case.checks),
    "lifted": Case(about="grazing, contact lost and regained, closed form", checks=lifted_case.checks),
    "limits": Case(about="blocks that friction holds up to a known time, statics", checks=limits_case.checks),
    "raous_compliance": Case(
        about="the same block, its face compliant: the shift", checks=raous_compliance_case.checks
    ),
    "punch": Case(about="rigid flat punch, closed forms and stick widths", checks=punch_case.checks),
    "hertz": Case(
        about="round bodies and obstacles in 2D, axisymmetry and 3D, Hertz", checks=hertz_case.checks, methods=TWO
    ),
    "patch": Case(
        about="two blocks, meshes of 1:1 to 1:20: a uniform pressure goes over", checks=patch_case.checks, methods=TWO
    ),
    "pair": Case(about="two bodies with friction, turned as a whole: nothing changes", checks=pair_case.checks),
    "shrink_fit": Case(about="a ring pressed into another one, Lamé's closed form", checks=shrink_fit_case.checks),
    "cattaneo": Case(about="two cylinders pressed and sheared: Hertz, Cattaneo, Mindlin", checks=cattaneo_case.checks),
    "zeros": Case(about="no force, friction, increment, bound or touch: nothing changes", checks=zeros_case.checks),
    "units": Case(about="every scene in mm, N, MPa: the same answers", checks=units_case.checks, methods=TWO),
    "agreement": Case(
        about="ready scenes: forces, resultants, displacements of every method are the same",
        checks=agreement_case.checks,
        methods=agreement_case.ALL,
    ),
}
