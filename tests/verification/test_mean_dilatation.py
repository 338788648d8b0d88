"""Materials against closed forms: nearly incompressible and orthotropic bodies."""

from dataclasses import asdict, replace
from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.audited import record_of, stored_by
from shared.failures import failures
from shared.problems import on_floor
from stickslip import Orthotropic, Simulation
from stickslip.geometry.shape import Model
from stickslip.solvers.metrics import mean_compliance, surface_compliance
from stickslip.solvers.results.audit import Audit, Auditor
from stickslip.solvers.simulation.plan import make_plan, warnings
from stickslip.workflows.lab.verification.cases import orthotropic as case
from stickslip.workflows.lab.verification.cases import orthotropic as exact
from stickslip.workflows.lab.verification.cases.hertz import Touch
from stickslip.workflows.lab.verification.cases.rubber import heated, off
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

AUTO: dict[str, Any] = {}
ALONE = {"formulation": "displacement"}


@pytest.mark.parametrize(
    ("model", "order", "cells", "within"),
    [
        ("plane strain", 1, 16, 0.01),
        ("plane strain", 2, 16, 0.01),
        ("axisymmetric", 1, 16, 0.01),
        ("axisymmetric", 2, 16, 0.003),
        pytest.param("3d", 1, 8, 0.06, marks=pytest.mark.slow),  # at nu = .3: .033
        pytest.param("3d", 2, 5, 0.015, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("nu", [0.4999, pytest.param(0.5, marks=pytest.mark.slow)])
def test_round_bodies_are_of_hertz(nu: float, model: Model, order: Literal[1, 2], cells: int, within: float) -> None:
    assert off(Touch(model=model, order=order, cells=float(cells), nu=nu)) < within


def block(nu: float, dim: int = 2, cells: str = "simplex", order: int = 1, h: float = 0.125, **body: Any) -> Simulation:
    """A block of 2 m by 1 m whose top is bonded to a plate that presses it on a plane, with friction."""
    held = dict.fromkeys("xyz"[:dim], 0.0) | {"xyz"[dim - 1]: -0.01}
    tables = on_floor(
        dim,
        {"mesh_size": h, "order": order, "cells": cells},
        {"nu": nu} | body,
        {"friction": {"law": "coulomb", "mu": 0.3}},
        supports={"top": {"boundary": "block.top", "displacement": held}},
        probes={"middle": {"point": [0.93] * (dim - 1) + [0.41]}},
        solver={"tolerance": 1e-10},
    )
    return prepare(from_dict(tables))


def audited(simulation: Simulation) -> tuple[Any, Audit]:
    (step,) = simulation.steps()
    record = replace(record_of(step), stored=stored_by(step))
    return step, Auditor(simulation.problem, simulation.mesh)(record)


@pytest.mark.parametrize("dim", [2, 3])
def test_all_cells_and_orders_resist_alike_and_the_audit_agrees(dim: int) -> None:
    """At order 1 and cells of an eighth (3D: a quarter) of the height, forces are within 5 (3D: 9) %."""
    nu, found = {2: 0.4999, 3: 0.5}[dim], []
    for cells, order in (("simplex", 2), ("tensor", 2), ("simplex", 1), ("tensor", 1)):
        step, audit = audited(block(nu, dim, cells, order, h=0.125 if dim == 2 else 0.25))
        assert max(asdict(audit).values()) < 1e-7
        found.append(step.contacts["base"].normal_force)
    assert_allclose(found, found[0], rtol=0.05 if dim == 2 else 0.09)
    locked = audited(block(0.4999, dim, "simplex", h=0.125 if dim == 2 else 0.25, **ALONE))[0]
    assert locked.contacts["base"].normal_force > 5 * found[0]


def test_without_locking_both_formulations_are_near_and_ordinary_bodies_are_as_they_were() -> None:
    ordinary, alone = (audited(block(0.3, order=2, **body))[0] for body in (AUTO, ALONE))
    assert_array_equal(ordinary.displacement, alone.displacement)
    mean = audited(block(0.3, order=2, formulation="mean-dilatation"))[0]
    assert_allclose(mean.contacts["base"].normal_force, ordinary.contacts["base"].normal_force, rtol=2e-3)
    assert_allclose(mean.probes["middle"].stress, ordinary.probes["middle"].stress, atol=2e-3 * 0.02)
    assert np.abs(mean.displacement - ordinary.displacement).max() > 1e-6


def test_the_plan_names_the_bodies_and_what_locks_is_warned_of() -> None:
    def row(scene: Any) -> tuple[bool, str]:
        (found,) = (row for row in make_plan(scene) if row.effect == "mean_dilatation")
        return found.on, found.because

    soft, ordinary, alone = (
        block(nu, h=0.5, **body).scene for nu, body in ((0.4999, AUTO), (0.3, AUTO), (0.4999, ALONE))
    )
    assert row(soft) == (True, "bodies.block.nu = 0.4999")
    assert not row(ordinary)[0]
    assert not row(alone)[0]
    assert not row(replace(soft, model="plane stress"))[0]
    assert [len(warnings(each)) for each in (soft, ordinary, alone)] == [0, 0, 1]


@pytest.mark.parametrize("sides", [("left", "right", "top"), ()])
def test_rubber_between_supports_that_heats_presses_by_its_bulk_modulus(sides: tuple[str, ...]) -> None:
    simulation, step, checks = heated(0.499, sides)
    assert not failures(checks)
    record = replace(record_of(step), stored=stored_by(step))
    assert max(asdict(Auditor(simulation.problem, simulation.mesh)(record)).values()) < 1e-9


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
