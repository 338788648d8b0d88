"""A rigid flat punch: closed forms without friction and bonded, stick widths between the two."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from stickslip.solvers.simulation.plan import warnings
from stickslip.workflows.lab.verification.cases import punch as punch_case
from stickslip.workflows.lab.verification.cases.punch import BONDED, REFERENCE, Cut
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.closed_forms import punch

# tolerances are the case's own, with their reasons there: the mesh, or the digits of the source


def test_tractions_are_the_closed_forms_of_a_half_plane() -> None:
    assert not failures(punch_case.tractions(REFERENCE))


def test_far_sides_do_not_matter() -> None:
    assert not failures(punch_case.far(REFERENCE))


def test_a_block_of_forty_half_widths_would_matter_to_the_shear() -> None:
    exact = punch.bonded(punch.X, punch.NU)[1][1]
    q = [punch_case.solve(Cut(method=REFERENCE, normal=BONDED, size=size)).at(punch.X)[1][1] for size in (40.0, 80.0)]
    # it falls as 1 / size, and the mesh adds .1 %
    np.testing.assert_allclose(q, exact * np.array([1 - 0.092, 1 - 0.046]), rtol=0.005)


@pytest.mark.parametrize("mu", punch.STICK)
def test_stick_widths_are_those_of_the_half_plane(mu: float) -> None:
    assert not failures(punch_case.stick(REFERENCE, fine=0.01, mus=(mu,)))


@pytest.mark.slow
def test_stick_widths_on_half_the_cells() -> None:
    assert not failures(punch_case.stick(REFERENCE))


def test_pressure_and_shear_are_coupled() -> None:
    # neglecting that shear tilts and pressure stretches the surface gives .744
    cut = Cut(
        method=REFERENCE,
        normal=punch_case.PRESSED,
        friction=punch_case.Coulomb(mu=0.3),
        fine=0.01,
        edge=0.005,
        symmetric=True,
    )
    assert abs(punch_case.solve(cut).stick - 0.744) > 10 * punch.STICK_DIGITS


@pytest.mark.parametrize("order", [1, 2])
def test_nearly_incompressible_bonded_punch_presses_as_the_frictionless_one(order: Literal[1, 2]) -> None:
    assert not failures(punch_case.incompressible(REFERENCE, order=order))


def test_linear_triangles_of_displacements_alone_lock_there_and_the_plan_says_so() -> None:
    assert len(failures(punch_case.incompressible(REFERENCE, order=1, formulation="displacement"))) == len(punch.X)
    soft = Cut(method=REFERENCE, normal=BONDED, nu=0.4999, order=1, formulation="displacement")
    assert not warnings(punch_case.scene(replace(soft, formulation="auto")))
    (warning,) = warnings(punch_case.scene(soft))
    assert "bodies.half_space.nu = 0.4999" in warning


def test_uzawa_gives_the_same_punch() -> None:
    assert not failures(punch_case.agree("uzawa"))


def test_checks_of_the_bonded_punch_notice_a_surface_that_is_held_in_the_normal_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(punch_case, "BONDED", punch_case.HELD)
    assert len(failures(punch_case.tractions(REFERENCE))) >= 4
