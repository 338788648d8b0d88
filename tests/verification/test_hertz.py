"""Round bodies on planes and in bores, round obstacles on half-spaces: Hertz' pressures, widths and approaches."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.workflows.lab.verification.cases import hertz as hertz_case
from stickslip.workflows.lab.verification.cases.hertz import TOUCHES, Touch, solve
from stickslip.workflows.lab.verification.check import failures

# tolerances are the case's own, with their reasons there: the mesh, measured at three


@pytest.mark.parametrize("name", TOUCHES)
def test_pressures_and_widths_are_hertz(name: str) -> None:
    assert not failures(hertz_case.figures(name, TOUCHES[name]))


@pytest.mark.parametrize("method", ["condensed-newton", "uzawa"])
def test_obstacle_driven_by_displacement_makes_hertz_of_the_force_that_is_there(method: str) -> None:
    assert not failures(hertz_case.by_displacement(method))


def test_force_and_displacement_drive_the_same_contact() -> None:
    driven = solve(Touch(order=1, driven_by="displacement"))
    wider = (driven.load / hertz_case.F) ** (1 / 3)  # a of this load: with more cells in it they are as large
    forced = solve(Touch(order=1, load=driven.load, cells=12 * wider))
    # the same cells near the pole, but for where they begin to grow: a tenth of what the mesh does
    assert_allclose(forced.approach, driven.approach, rtol=5e-3)
    assert_allclose(forced.fitted.p0, driven.fitted.p0, rtol=5e-3)


def test_ball_goes_into_a_half_space_as_far_as_hertz_says() -> None:
    assert not failures(hertz_case.approaches())


def test_ball_in_3d_is_hertz() -> None:
    assert not failures(hertz_case.ball_3d(cells=3))


@pytest.mark.slow
def test_ball_in_3d_on_finer_cells() -> None:
    assert not failures(hertz_case.ball_3d())


def test_pressures_converge_as_the_cells_do() -> None:
    errors = [solve(Touch(cells=cells)).scatter for cells in (6.0, 12.0, 24.0)]
    rate = -np.polyfit(np.log([6, 12, 24]), np.log(errors), 1)[0]
    assert rate > 0.75  # the edge, where the pressure's slope is infinite, lies somewhere in a cell: about first order


def test_checks_notice_a_ball_of_another_radius(monkeypatch: pytest.MonkeyPatch) -> None:
    touch = TOUCHES["ball in a socket"]
    found = solve(replace(touch, bore=2.1 * hertz_case.R))
    monkeypatch.setattr(hertz_case, "solve", lambda touch: found)
    # 5 % in the bore's radius is 4.5 % in the radius of the difference: 3 % in p0, 1.5 % in a
    assert len(failures(hertz_case.figures("ball in a socket", touch))) >= 2
