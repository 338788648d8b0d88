"""`stickslip verify`: solve the verification problems with every method, and hold computed against expected figures."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from stickslip.geometry.errors import SceneError, StickslipError, nearest
from stickslip.workflows.lab.verification.cases import agreement as agreement_case
from stickslip.workflows.lab.verification.cases import beam as beam_case
from stickslip.workflows.lab.verification.cases import bearing as bearing_case
from stickslip.workflows.lab.verification.cases import bolted_joint as bolted_joint_case
from stickslip.workflows.lab.verification.cases import by_place as by_place_case
from stickslip.workflows.lab.verification.cases import cattaneo as cattaneo_case
from stickslip.workflows.lab.verification.cases import circular_drive as circular_drive_case
from stickslip.workflows.lab.verification.cases import column as column_case
from stickslip.workflows.lab.verification.cases import elastic_bed as elastic_bed_case
from stickslip.workflows.lab.verification.cases import friction_laws as friction_laws_case
from stickslip.workflows.lab.verification.cases import hertz as hertz_case
from stickslip.workflows.lab.verification.cases import incline as incline_case
from stickslip.workflows.lab.verification.cases import lifted as lifted_case
from stickslip.workflows.lab.verification.cases import limits as limits_case
from stickslip.workflows.lab.verification.cases import manufactured as manufactured_case
from stickslip.workflows.lab.verification.cases import orthotropic as orthotropic_case
from stickslip.workflows.lab.verification.cases import pair as pair_case
from stickslip.workflows.lab.verification.cases import patch as patch_case
from stickslip.workflows.lab.verification.cases import press_fit as press_fit_case
from stickslip.workflows.lab.verification.cases import punch as punch_case
from stickslip.workflows.lab.verification.cases import raous as raous_case
from stickslip.workflows.lab.verification.cases import raous_compliance as raous_compliance_case
from stickslip.workflows.lab.verification.cases import rubber as rubber_case
from stickslip.workflows.lab.verification.cases import shear_lag as shear_lag_case
from stickslip.workflows.lab.verification.cases import sheared_column as sheared_column_case
from stickslip.workflows.lab.verification.cases import shrink_fit as shrink_fit_case
from stickslip.workflows.lab.verification.cases import slivers as slivers_case
from stickslip.workflows.lab.verification.cases import spinning_rings as spinning_rings_case
from stickslip.workflows.lab.verification.cases import springs as springs_case
from stickslip.workflows.lab.verification.cases import two_bars as two_bars_case
from stickslip.workflows.lab.verification.cases import two_materials as two_materials_case
from stickslip.workflows.lab.verification.cases import units as units_case
from stickslip.workflows.lab.verification.cases import warm_bars as warm_bars_case
from stickslip.workflows.lab.verification.cases import zeros as zeros_case
from stickslip.workflows.lab.verification.check import Check

TWO = ("condensed-newton", "uzawa")
METHODS = (*TWO, "surface-uzawa")  # surface-uzawa where it does not take minutes
ONE = ("condensed-newton",)  # where there is little contact, or none
FLOATING = ("condensed-newton", "surface-uzawa")  # where contact alone holds the bodies


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
    "incline": Case(
        about="layer that friction holds, and one that it cannot", checks=incline_case.checks, methods=FLOATING
    ),
    "slivers": Case(about="cells of aspect 1000, closed forms and iterations", checks=slivers_case.checks, methods=TWO),
    "shear_lag": Case(
        about="a strip slips from its end: partial slip, hysteresis", checks=shear_lag_case.checks, methods=FLOATING
    ),
    "lifted": Case(about="grazing, contact lost and regained, closed form", checks=lifted_case.checks),
    "limits": Case(
        about="blocks that friction holds up to a known time, statics", checks=limits_case.checks, methods=FLOATING
    ),
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
    "press_fit": Case(
        about="a shaft pressed into a hub, from a STEP file, Lamé's closed form", checks=press_fit_case.checks
    ),
    "heated_hub": Case(
        about="a hub from a STEP file shrinks onto its shaft, Lamé", checks=press_fit_case.heated, methods=TWO
    ),
    "bearing": Case(
        about="a ball on a groove, from a STEP file: Hertz' ellipse", checks=bearing_case.checks, methods=ONE
    ),
    "two_bars": Case(about="bars that sinusoidal body forces push together, closed form", checks=two_bars_case.checks),
    "spinning_rings": Case(
        about="a ring, a cylinder and a shrink fit spin: closed form", checks=spinning_rings_case.checks, methods=TWO
    ),
    "elastic_bed": Case(about="a column that only springs hold, pressed and sheared", checks=elastic_bed_case.checks),
    "bolted_joint": Case(about="a bolt tightened, held, its joint drawn apart", checks=bolted_joint_case.checks),
    "springs": Case(
        about="springs in series with a column, alone, between bodies, of one way", checks=springs_case.checks
    ),
    "beam": Case(
        about="a beam bent through a remote point, rigid and distributing", checks=beam_case.checks, methods=ONE
    ),
    "warm_bars": Case(
        about="temperatures in space and by body: bars, a cylinder, a gap", checks=warm_bars_case.checks, methods=ONE
    ),
    "by_place": Case(
        about="water on a wall; loads and displacements by place", checks=by_place_case.checks, methods=ONE
    ),
    "two_materials": Case(
        about="two materials that share nodes: in series, side by side", checks=two_materials_case.checks, methods=ONE
    ),
    "rubber": Case(about="nearly incompressible: Hertz at nu = .4999, heat", checks=rubber_case.checks, methods=ONE),
    "orthotropic": Case(
        about="orthotropic: uniform stress off the axes, a tube, a roller on half-planes",
        checks=orthotropic_case.checks,
        methods=TWO,
    ),
    "friction_laws": Case(
        about="cohesion, tables of mu, static and kinetic, two coefficients", checks=friction_laws_case.checks
    ),
    "cattaneo": Case(about="two cylinders pressed and sheared: Hertz, Cattaneo, Mindlin", checks=cattaneo_case.checks),
    "zeros": Case(about="no force, friction, increment, bound or touch: nothing changes", checks=zeros_case.checks),
    "units": Case(about="every scene in mm, N, MPa: the same answers", checks=units_case.checks, methods=TWO),
    "agreement": Case(
        about="ready scenes: forces, resultants, displacements of every method are the same",
        checks=agreement_case.checks,
        methods=agreement_case.ALL,
    ),
}


Row = tuple[str, str, Check]  # case, method, result


def verify(names: Sequence[str], every_row: bool = False) -> bool:
    """Run the named problems, or all if no name is given, and print a line of each, and its figures that fail.

    Args:
        every_row: print all figures.

    Returns:
        Whether every check passed.

    Raises:
        SceneError: a verification problem of that name does not exist.
    """
    for name in names:
        if name not in CASES:
            raise SceneError(f"{name}: no such verification problem; {nearest(name, CASES)}")
    console = Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else 160)
    total, failed = 0, 0
    for name in dict.fromkeys(names or CASES):
        rows = list(solve(name))
        wrong = [row for row in rows if not row[2].passed]
        console.print(line(name, len(rows), len(wrong)), soft_wrap=True)
        if shown := rows if every_row else wrong:
            console.print(table(shown, CASES[name].about))
        total += len(rows)
        failed += len(wrong)
    console.print(f"{failed} of {total} checks failed" if failed else f"all {total} checks passed")
    return failed == 0


def line(name: str, count: int, failed: int) -> str:
    """What is said of a problem.

    >>> line("zeros", 9, 2)
    'zeros              2 of 9 FAILED  no force, friction, increment, bound or touch: nothing changes'
    """
    said = f"{failed} of {count} FAILED" if failed else f"{count} passed"
    return f"{name:<{max(map(len, CASES))}}  {said:>14}  {CASES[name].about}"


def solve(name: str) -> Iterator[Row]:
    """The checks of one problem with its methods; a method that raises an error yields one failed check with it."""
    for method in CASES[name].methods:
        try:
            for check in CASES[name].checks(method):
                yield name, method, check
        except StickslipError as error:
            yield name, method, Check(f"not solved: {error}", float("nan"), 0.0, 0.0, relative=False)


def table(rows: Sequence[Row], about: str) -> Table:
    """Rows as a rich table."""
    drawn = Table(title=about, title_justify="left")
    for heading in ("case", "quantity", "method"):
        drawn.add_column(heading, overflow="fold")
    for heading in ("computed", "reference", "deviation", "allowed", "pass"):
        drawn.add_column(heading, justify="right", no_wrap=True)
    for name, method, check in rows:
        kind = "rel" if check.relative else "abs"
        drawn.add_row(
            name,
            check.name,
            method,
            f"{check.computed:.9g}",
            f"{check.reference:.9g}",
            f"{check.deviation:.1e} {kind}",
            f"{check.tolerance:.1e}",
            "yes" if check.passed else "NO",
            style=None if check.passed else "bold red",
        )
    return drawn
