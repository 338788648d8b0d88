"""A ring pressed into another one: Lamé's closed form, of either side the slave, drawn or by gap_offset."""

from typing import Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.workflows.lab.verification.cases import shrink_fit as shrink_fit_case
from stickslip.workflows.lab.verification.cases.shrink_fit import Press, solve
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.closed_forms import shrink_fit
from stickslip.workflows.lab.verification.closed_forms.shrink_fit import (
    HUB,
    INNER,
    INTERFERENCE,
    JOINT,
    OUTER,
    SHAFT,
    RingMaterial,
)

# --- the closed form


def test_closed_form_gives_the_tabulated_figures() -> None:
    fit = shrink_fit.fit()
    assert_allclose([fit.p, fit.u_in, fit.u_out], [15.0905433, -1.700201e-4, 8.299799e-4], rtol=3e-7)  # their digits


@pytest.mark.parametrize(("law", "p"), shrink_fit.COMPLIANT.items())
def test_closed_form_gives_the_tabulated_figures_of_a_compliant_interface(law: tuple[float, float], p: float) -> None:
    assert_allclose(shrink_fit.fit(c_n=law[0], m=law[1]).p, p, rtol=5e-9)


@pytest.mark.parametrize(("material", "free"), [(SHAFT, INNER), (HUB, OUTER)])
def test_ring_gives_way_as_the_differential_equation_of_the_radius_says(material: RingMaterial, free: float) -> None:
    # u = A r + B / r; sigma_rr = c (A - (1 - 2 nu) B / r^2) is -1 at the joint, 0 where it is free
    nu, c = material.nu, material.E / ((1 + material.nu) * (1 - 2 * material.nu))
    system = [[c, -c * (1 - 2 * nu) / r**2] for r in (JOINT, free)]
    A, B = np.linalg.solve(system, [-1.0, 0.0])
    assert_allclose(shrink_fit.give(material, JOINT, free), abs(A * JOINT + B / JOINT), rtol=1e-13)


def test_stiffer_interface_tends_to_one_that_does_not_give() -> None:
    rigid = shrink_fit.fit().p
    errors = [rigid - shrink_fit.fit(c_n=c_n).p for c_n in (1e8, 1e9)]
    assert_allclose(errors[0] / errors[1], 10.0, rtol=1e-2)  # first order in 1 / c_n


def test_rings_drawn_too_large_tend_to_rings_that_fit() -> None:
    off = [shrink_fit.drawn_too_large(d)[1].p / d - shrink_fit.fit(d).p / d for d in (1e-3, 1e-4)]
    assert_allclose(off[0] / off[1], 10.0, rtol=1e-2)


# --- the scene; tolerances are the case's own, with their reasons there


def test_pressure_and_displacements_are_those_of_the_closed_form() -> None:
    assert not failures(shrink_fit_case.fits())


def test_compliant_interface_is_that_of_the_closed_form() -> None:
    assert not failures(shrink_fit_case.compliant())


def test_straight_facets_lose_the_overlap_that_geometry_says() -> None:
    assert not failures(shrink_fit_case.facets())


@pytest.mark.parametrize("slave", ["inner", "outer"])
def test_overlap_of_more_than_a_cell_is_found_on_the_right_side(
    slave: Literal["inner", "outer"],
) -> None:
    deep = Press(cells=0.08, interference=100 * INTERFERENCE, drawn=True, slave=slave)
    assert not failures(shrink_fit_case.figures(deep, 1e-5))  # 1.2e-6, of the mesh


@pytest.mark.slow
def test_overlap_of_ten_times_and_more_than_a_cell_is_so_too() -> None:
    assert not failures(shrink_fit_case.overlaps())


def test_uzawa_gives_the_same_fit() -> None:
    assert not failures(shrink_fit_case.checks("uzawa"))


def test_quadratic_rings_converge_with_their_geometry() -> None:
    exact = shrink_fit.fit().p
    errors = [abs(solve(Press(cells=cells, ratio=1.5)).p / exact - 1) for cells in (0.25, 0.125, 0.0625)]
    rate = -np.polyfit(np.log([1, 2, 4]), np.log(errors), 1)[0]
    assert 3.5 < rate < 4.5  # the gap of two meshes of one circle, order 4 where their nodes lie on it


def test_mean_pressure_differs_from_another_interference() -> None:
    found = solve(Press(cells=0.125, ratio=1.5, interference=1.001 * INTERFERENCE))
    assert found.p / shrink_fit.fit().p - 1 > 5 * 1e-4
