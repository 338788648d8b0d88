"""Orthotropic bodies against closed forms: off-axis blocks, heat, a tube, a roller; and the closed forms themselves."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.solvers.metrics import mean_compliance, surface_compliance
from stickslip.solvers.scene.material import Orthotropic
from stickslip.workflows.lab.verification.cases import orthotropic as case
from stickslip.workflows.lab.verification.closed_forms import orthotropic as exact


def test_what_is_left_of_a_roller_is_the_lean_of_its_normals(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a fine mesh the pressures come closer as a / R falls: .4 % of the peak, then .03 %."""
    off = []
    monkeypatch.setattr(case, "CELLS", 24.0)
    for slim in (0.02, 0.00125):
        monkeypatch.setattr(case, "SLIM", slim)
        *_, scatter = case.on_a_half_plane(case.Rolled(30.0), "condensed-newton")
        off.append(scatter.computed)
    assert off[1] < 0.2 * off[0]
    assert off[1] < 1e-3


def test_the_grain_matters() -> None:
    """With other angles or without one of the constants the closed form is another one."""
    along, across = (exact.surface_compliance(case.Rolled(angle).beta) for angle in (0.0, 90.0))
    assert along > 3 * across  # pressed across the grain, and along it


@pytest.mark.parametrize("plane_stress", [False, True])
@pytest.mark.parametrize("degrees", [0.0, 30.0, 77.0, 90.0])
def test_the_metric_has_the_compliance_of_the_half_plane(degrees: float, plane_stress: bool) -> None:
    """Integrals over directions against the roots of the characteristic equation."""
    body = Orthotropic(**case.table(case.SPRUCE, case.rotation(2, degrees), 2))
    beta = exact.plane(exact.turned(case.SPRUCE.compliance, case.rotation(2, degrees)), plane_stress)
    found = surface_compliance(body.tensor_in(plane_stress)[:2, :2, :2, :2], *np.eye(2))
    assert_allclose(found[1, 1], exact.surface_compliance(beta), rtol=1e-9)


def test_an_isotropic_body_has_the_compliance_of_hertz_whatever_its_axes() -> None:
    G = 2 / (2 * 1.3)
    body = Orthotropic(
        E_1=2.0, E_2=2.0, E_3=2.0, G_12=G, G_13=G, G_23=G, nu_12=0.3, nu_13=0.3, nu_23=0.3,
        axis_1=(1.0, 2.0, 0.5), axis_2=(0.0, 1.0, 3.0),
    )  # fmt: skip
    assert_allclose(mean_compliance(body, np.eye(3), plane_stress=False), 2 * (1 - 0.3**2) / 2, rtol=1e-12)
    assert_allclose(body.modulus_along(np.array([[0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])), 2.0, rtol=1e-12)


def test_youngs_modulus_off_the_axes() -> None:
    """1 / E_x = cos⁴ / E_1 + sin⁴ / E_2 + (1 / G_12 - 2 nu_12 / E_1) sin² cos², Jones (1999), equation 2.97."""
    body = Orthotropic(**case.table(case.SPRUCE, np.eye(3), 2))
    c, s = np.cos(0.4), np.sin(0.4)
    give = c**4 / body.E_1 + s**4 / body.E_2 + (1 / body.G_12 - 2 * body.nu_12 / body.E_1) * s**2 * c**2
    assert_allclose(body.modulus_along(np.array([[c, s]])), 1 / give, rtol=1e-12)
