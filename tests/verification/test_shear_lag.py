"""A strip on a frictional bed: pulled it slips from its end, let go it keeps part of the slip, cycled it only loses."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import lsq_linear

from stickslip.solvers.laws.law import FrictionLaw, NormalLaw
from stickslip.solvers.laws.unilateral import Unilateral
from stickslip.workflows.lab.verification.cases import shear_lag as shear_lag_case
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.closed_forms import shear_lag
from stickslip.workflows.lab.verification.closed_forms.shear_lag import FORCE, STRIP

METHOD = "condensed-newton"  # the others need bodies that their supports hold


def minimised(forces: tuple[float, ...], cells: int = 400) -> tuple[list[float], list[float]]:
    """Displacements of the end and dissipation so far, from the least complementary energy of each step.

    The bar force N has N(0) = F, |N'| <= q, and minimises the integral of (N - N_before)² / (2 E A): a bounded least
    squares problem in the bed's shear, which knows nothing of slip zones.
    """
    h = shear_lag.LENGTH / cells
    sums = np.tri(cells, k=-1) * h + np.eye(cells) * h / 2  # shear of the cells to N in their middles
    N, u, loss, ends, losses = np.zeros(cells), np.zeros(cells), 0.0, [], []
    for F in forces:
        shear = lsq_linear(sums, F - N, bounds=(-STRIP.q, STRIP.q), tol=1e-14).x
        change = (F - sums @ shear - N) / STRIP.EA
        N = F - sums @ shear
        du = np.cumsum(change[::-1])[::-1] * h - change * h / 2  # nothing moves at the far end
        u, loss = u + du, loss + float(np.sum(shear * du) * h)
        ends.append(float(u[0]))
        losses.append(loss)
    return ends, losses


def test_closed_form_is_the_least_energy_of_a_chain_of_cells() -> None:
    ends, losses = minimised((FORCE, 0.0, -FORCE, FORCE))
    there, back = shear_lag.pulled(STRIP, FORCE), shear_lag.let_go(STRIP, FORCE)
    leg = shear_lag.let_go(STRIP, 2 * FORCE)
    exact = [there.displacement, there.displacement - back.displacement, -there.displacement, there.displacement]
    # 400 cells: the end stands for the middle of the first, h / 2 of F / E A away
    assert_allclose(ends, exact, atol=1.2 * FORCE / STRIP.EA / 800)
    lost = [there.dissipation, there.dissipation + back.dissipation, there.dissipation + leg.dissipation]
    assert_allclose(losses, [*lost, lost[-1] + leg.dissipation], rtol=1e-3)


def test_closed_form_gives_the_tabulated_figures() -> None:
    there, back = shear_lag.pulled(STRIP, FORCE), shear_lag.let_go(STRIP, FORCE)
    assert_allclose([there.displacement, there.slip_length], [4.5e-3, 0.6], rtol=1e-14)
    assert_allclose([there.displacement - back.displacement, back.slip_length], [2.25e-3, 0.3], rtol=1e-14)
    assert_allclose(2 * shear_lag.let_go(STRIP, 2 * FORCE).dissipation, 1.8e-3, rtol=1e-14)


def test_strip_is_pulled_let_go_pushed_and_pulled_again() -> None:
    assert not failures(shear_lag_case.figures(METHOD))


@pytest.mark.parametrize(
    ("method", "friction", "normal"),
    [
        (METHOD, shear_lag_case.COULOMB, Unilateral()),
        ("surface-uzawa", shear_lag_case.TRESCA, shear_lag_case.HELD),
    ],
)
def test_cycles_repeat(method: str, friction: FrictionLaw, normal: NormalLaw) -> None:
    assert not failures(shear_lag_case.cycled(method, friction, normal, n=shear_lag_case.COARSE))


def test_cycles_repeat_on_the_tabulated_mesh_and_lose_as_much_as_tabulated() -> None:
    assert not failures(shear_lag_case.cycled(METHOD))


def test_coulomb_friction_feels_where_the_pull_presses() -> None:
    assert not failures(shear_lag_case.coulomb(METHOD))


def test_checks_notice_coulomb_in_place_of_a_fixed_bound() -> None:
    assert len(failures(shear_lag_case.figures(METHOD, friction=shear_lag_case.COULOMB))) >= 4


def test_method_that_needs_held_bodies_has_nothing_to_check() -> None:
    assert shear_lag_case.checks("uzawa") == []
