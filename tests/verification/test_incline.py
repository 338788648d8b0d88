"""A layer on an incline rests below the angle of friction, and has no equilibrium above it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import slow
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.stepping.stepper import NoEquilibriumError, StepError
from stickslip.workflows.lab.verification.cases import incline as incline_case
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.closed_forms import incline
from stickslip.workflows.lab.verification.closed_forms.incline import HOLDS, LAYER, SLIDES
from stickslip.workflows.lab.verification.prepared import observed, system_of
from stickslip.workflows.run.run import run

METHOD = "condensed-newton"  # the layer is held by contact alone


def test_closed_form_gives_the_tabulated_figures() -> None:
    assert_allclose([LAYER.pressure, LAYER.shear], [incline.PRESSURE, incline.SHEAR], atol=5e-8)  # 8 and 7 digits
    assert_allclose(LAYER.top, incline.TOP, rtol=1e-5)  # 5 digits
    assert SLIDES < LAYER.slope < HOLDS
    assert_allclose(LAYER.shear / LAYER.pressure, LAYER.slope, rtol=1e-15)
    assert_allclose(np.hypot(LAYER.along, LAYER.across), LAYER.weight, rtol=1e-15)


@pytest.mark.parametrize("method", [METHOD, "surface-uzawa"])
def test_layer_rests_on_a_slope_that_friction_can_just_hold(method: str) -> None:
    """Iteratively too: fewer unknowns than search directions, so that solves end at rounding."""
    assert not failures(incline_case.holds(method))


def test_layer_on_a_slope_a_little_steeper_is_not_called_solved() -> None:
    assert not failures(incline_case.slides(METHOD))
    with pytest.raises(NoEquilibriumError, match=r"cannot balance the loads: bodies\.block moves along x"):
        list(observed(system_of(incline_case.scene(METHOD, SLIDES))))


@pytest.mark.parametrize("case", [(HOLDS, "converged", 0), *slow((SLIDES, "no_equilibrium", 3))])
def test_run_of_the_layer_ends_as_its_threshold_says(case: tuple[float, str, int], tmp_path: Path) -> None:
    mu, status, exit_code = case
    scene = replace(incline_case.scene(METHOD, mu), output=Output(pictures=False))
    outcome, content = run(scene, tmp_path / "out")
    assert (outcome.status, outcome.exit_code, content["status"]) == (status, exit_code, status)
    assert len(content["steps"]) == (exit_code == 0)


def test_checks_notice_the_other_side_of_the_threshold() -> None:
    with pytest.raises(StepError):
        incline_case.holds(METHOD, SLIDES)
    assert failures(incline_case.slides(METHOD, HOLDS))
