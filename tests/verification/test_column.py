"""A column on a compliant foundation: uniform, so that any mesh gives the closed form to the solver's precision."""

from dataclasses import replace
from typing import Literal

import pytest

from stickslip.workflows.lab.verification.cases import column as column_case
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.closed_forms import column

METHODS = ("condensed-newton", "uzawa")
# all but one of the tolerances are the case's own, with their reasons there: 1e-9, or the digits of the table


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("m", [1, 1.5, 2, 2.7, 3])
def test_foundation_carries_the_pressure_of_its_penetration(method: str, dim: int, m: float) -> None:
    assert not failures(column_case.pressed(method, dim, m))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dim", [2, 3])
def test_quadrilaterals_and_hexahedra_carry_it_too(method: str, dim: int) -> None:
    assert not failures(column_case.pressed(method, dim, 2, cells="tensor"))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dim", [2, 3])
def test_column_of_one_cell_has_no_interior_to_condense(method: str, dim: int) -> None:
    scene = column_case.scene(dim=dim, method=method, c_n=1e6, m=2, g=0.002, top=0.01, mesh_size=1.0)
    exact = column.driven_by_displacement(M=column_case.M, U=0.01, g=0.002, c_n=1e6, m=2)
    assert not failures(column_case.compare("one cell", column_case.solve(scene), exact, 0.002))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("case", column.TABLE, ids=lambda case: f"m={case.m:g},U={case.U:g},nu={case.nu:g}")
def test_tabulated_columns_overlap_and_near_incompressibility_included(
    method: str, dim: int, case: column.ColumnCase
) -> None:
    assert not failures(column_case.tabulated(method, dim, case))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dim", [2, 3])
def test_nearly_incompressible_column_is_exact_too(method: str, dim: int) -> None:
    assert not failures(column_case.incompressible(method, dim))


@pytest.mark.parametrize(("dim", "order"), column_case.FORCED)
@pytest.mark.parametrize("m", column_case.EXPONENTS)
def test_column_pressed_by_a_force_finds_the_foundation_that_alone_holds_it(
    dim: int, order: Literal[1, 2], m: float
) -> None:
    # only condensed-newton: the stiffness of a body that nothing else holds is singular, and Uzawa inverts it
    assert not failures(column_case.force_driven("condensed-newton", dim, m, order))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("g", "share"), column_case.OFFSETS)
def test_gap_may_be_drawn_or_given_as_an_offset(method: str, dim: int, g: float, share: float) -> None:
    assert not failures(column_case.offset(method, dim, g, share))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("m", [1, 2, 3])
@pytest.mark.parametrize("beyond", column_case.GRAZING)
def test_grazing_column_neither_chatters_nor_invents_a_pressure(method: str, m: int, beyond: float) -> None:
    assert not failures(column_case.grazing(method, 2, m, beyond))


@pytest.mark.parametrize("m", [1, 2, 3])
def test_grazing_column_that_does_not_quite_touch_feels_exactly_nothing(m: int) -> None:
    top = column_case.GAP * (1 - 1e-9)
    scene = column_case.scene(dim=2, method="condensed-newton", c_n=column_case.C_N[m], m=m, g=column_case.GAP, top=top)
    step = column_case.solve(scene)
    assert not step.p.any()  # exactly: an open point has no pressure
    assert step.contacts["base"].contact_area == 0


@pytest.mark.parametrize("change", [{"c_n": 1.001e6}, {"m": 2.001}, {"g": 0.00201}, {"U": 0.01001}])
def test_checks_notice_a_foundation_that_is_a_little_different(change: dict[str, float]) -> None:
    case = column.TABLE[1]
    other = replace(case, **change)  # type: ignore[arg-type]
    scene = column_case.scene(dim=2, method="condensed-newton", c_n=other.c_n, m=other.m, g=other.g, top=other.U)
    exact = column.ColumnState(penetration=case.d - case.g, displacement=case.d, pressure=case.p)
    # 1e-5: a change of 1e-3 in a parameter moves both figures by more than 1e-4
    assert len(failures(column_case.compare("changed", column_case.solve(scene), exact, other.g, 1e-5))) == 3
