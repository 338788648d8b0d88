"""A shaft in a hub, from a STEP file: Lamé's closed form."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import slow
from stickslip.workflows.lab.verification.cases import press_fit as case
from stickslip.workflows.lab.verification.cases.press_fit import HUB, SECTION, SHAFT, SOLID, Fit, figures, solve
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.closed_forms.press_fit import pressure
from stickslip.workflows.lab.verification.step_file import on_plane, read_step, step_file

SECTION_ONLY = Fit(model="axisymmetric")

# --- the closed form


def test_hub_is_in_equilibrium_and_strained_as_its_stresses_say() -> None:
    r, h = np.linspace(HUB.bore, HUB.outer, 9)[1:-1], 1e-6
    radial, hoop = HUB.stresses(1e6, r)
    up, down = HUB.stresses(1e6, r + h)[0], HUB.stresses(1e6, r - h)[0]
    assert_allclose((up - down) / (2 * h), (hoop - radial) / r, rtol=1e-6)
    u, slope = HUB.displacement(1e6, r), (HUB.displacement(1e6, r + h) - HUB.displacement(1e6, r - h)) / (2 * h)
    assert_allclose(u / r, (hoop - HUB.nu * radial) / HUB.E, rtol=1e-12)
    assert_allclose(slope, (radial - HUB.nu * hoop) / HUB.E, rtol=1e-6, atol=1e-12)
    assert_allclose(HUB.stresses(1e6, np.array([HUB.bore, HUB.outer]))[0], [-1e6, 0.0], atol=1e-3)


def test_both_together_give_way_by_the_interference_that_heat_leaves() -> None:
    at, expanded = np.array([HUB.bore]), 2e-4
    p = pressure(SHAFT, HUB, 1e-5, expanded)
    assert_allclose(HUB.displacement(p, at, expanded) - SHAFT.displacement(p, at), 1e-5, rtol=1e-12)


# --- the scene


@pytest.mark.parametrize("method", ["condensed-newton", *slow("surface-uzawa", "uzawa")])
def test_section_of_a_press_fit_has_the_pressure_of_lame(method: str) -> None:
    assert not failures(figures(Fit(model="axisymmetric", method=method), SECTION))


@pytest.mark.parametrize("fit", [Fit(drawn=True), *slow(Fit(gap="of the meshes"), Fit())], ids=str)
def test_quarter_of_a_press_fit_has_the_pressure_and_stresses_of_lame(fit: Fit) -> None:
    assert not failures(figures(fit, SOLID))


def test_hub_that_cools_grips_where_its_bore_has_become_as_small_as_the_shaft() -> None:
    assert not failures(figures(Fit(model="axisymmetric", heated=True), SECTION))
    hot, *_, cold = solve(Fit(model="axisymmetric", heated=True))
    assert hot.p == 0.0
    assert_allclose(cold.p, solve(SECTION_ONLY)[0].p, rtol=1e-9)  # the way there leaves nothing without friction


def test_quarter_of_a_hub_that_cools_is_that_of_lame() -> None:
    assert not failures(figures(Fit(heated=True), SOLID))


@pytest.mark.parametrize("name", ["INTERFERENCE", *slow("EXPANDS")])
def test_checks_notice_another_interference_or_expansion(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    found = solve(Fit(model="axisymmetric", heated=True))
    monkeypatch.setattr(case, name, 1.001 * getattr(case, name))
    other = solve(Fit(model="axisymmetric", heated=True))
    assert abs(other[2].p / found[2].p - 1) > 100 * SECTION.p


@pytest.mark.slow  # on one mesh above
def test_pressures_of_a_quarter_converge() -> None:
    errors = [abs(found.p / found.exact - 1) for size in (0.5, 1.0) for found in solve(Fit(finer=size))]
    assert 1.5 < np.log2(errors[0] / errors[1]) < 2.5  # a row has one normal, that of its node


# --- the file


def test_a_side_where_no_face_lies_is_an_error(capfd: pytest.CaptureFixture[str]) -> None:
    with step_file(SECTION_ONLY.draw) as path:
        assert path.read_text().startswith("ISO-10303-21")
        with pytest.raises(ValueError, match=r"hub\.rim: no face of part_2 lies there"):
            read_step(path, {"hub": "part_2"}, {"hub.rim": on_plane(0, 1.0)}, mesh_size=1e-3, dim=2)
    assert not Path(path).exists()
    assert capfd.readouterr().out == ""  # OpenCASCADE says nothing
