"""Friction laws beyond Coulomb's, against closed forms: the sheared column, and blocks that friction holds or not."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import record_of
from stickslip.solvers.laws.cohesion import Cohesion
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.laws.law import FrictionLaw
from stickslip.solvers.laws.orthotropic_coulomb import OrthotropicCoulomb
from stickslip.solvers.laws.pressure_dependent import PressureDependent
from stickslip.solvers.laws.slip_dependent import SlipDependent, StaticKinetic
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.results.step_result import SLIP, STICK
from stickslip.solvers.simulation.plan import warnings
from stickslip.solvers.stepping.stepper import NoEquilibriumError
from stickslip.workflows.run.doubts import doubts
from stickslip.workflows.scene_file.read import from_dict
from stickslip.workflows.verification.cases.sheared_column import K_T, PRESSURE, E, bases, compare, scene, solve
from stickslip.workflows.verification.check import failures
from stickslip.workflows.verification.closed_forms import sheared_column, weakening
from stickslip.workflows.verification.prepared import prepare

SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("surface-uzawa", "nsgs")]
METHODS = ["condensed-newton", "uzawa", *SLOW]
TOP = np.array([0.001, 0.0035, 0.01, 0.005, -0.01, 0.01])  # [m]: stick, little slip, much, unloading, back, forth
G = sheared_column.COLUMN.G  # the column is 1 m high: the stiffness of its base against slip [Pa/m]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("law", "bound"),
    [
        (Cohesion(a=1.2, mu=0.1), 2.2),
        (Cohesion(a=0.7, mu=0.0, k_T=K_T), 0.7),
        (PressureDependent(mu=((0.0, 0.4), (20.0, 0.24))), 3.2),
        (PressureDependent(mu=((1.0, 0.1), (5.0, 0.25)), k_T=K_T), 2.5),
    ],
)
def test_column_slips_at_the_bound_of_its_pressure(method: str, law: FrictionLaw, bound: float) -> None:
    states = bases(scene(dim=2, method=method, E=E, friction=law, path=sheared_column.TOP[:, None]))
    exact = replace(sheared_column.COLUMN, bound=bound, k_T=law.k_T or np.inf)
    assert not failures(compare("law", states, PRESSURE, exact, sheared_column.TOP))  # within 1e-9
    assert failures(compare("another", states, PRESSURE, replace(exact, bound=1.01 * bound), sheared_column.TOP))


SOFT = StaticKinetic(mu_s=0.3, mu_k=0.2, slip_length=3e-3)  # falls by 333 Pa/m at 10 Pa: a third of G
BRITTLE = StaticKinetic(mu_s=0.3, mu_k=0.2, slip_length=5e-4)  # twice G
HARDENING = SlipDependent(mu=((0.0, 0.1), (2e-3, 0.3), (8e-3, 0.25)))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("law", [SOFT, BRITTLE, HARDENING, replace(SOFT, k_T=2 * G), replace(BRITTLE, k_T=2 * G)])
def test_column_drops_from_static_to_kinetic_friction_as_it_slips(method: str, law: StaticKinetic) -> None:
    steps = solve(scene(dim=2, method=method, E=E, friction=law, path=TOP[:, None]))[1:]
    tau, length = weakening.drag(law.table, PRESSURE, G * (2 / 3 if law.k_T else 1.0), TOP)
    for step, t, slid in zip(steps, tau, length, strict=True):
        base = step.contacts["base"]
        assert_allclose(-base.traction[:, 0], t, atol=1e-9 * abs(tau).max())
        assert_allclose(step.slid["base"], slid, atol=1e-9 * length.max())


def test_kinetic_friction_equal_to_static_is_coulombs() -> None:
    ours, coulomb = (
        bases(scene(dim=2, method="condensed-newton", E=E, friction=law, path=TOP[:, None]))
        for law in (StaticKinetic(mu_s=0.3, mu_k=0.3, slip_length=1e-3), Coulomb(mu=0.3))
    )
    for one, other in zip(ours, coulomb, strict=True):
        assert_allclose(one.traction, other.traction, atol=1e-12)


def test_whether_the_step_keeps_one_solution_is_said_in_plan_and_result() -> None:
    top = np.linspace(5e-4, 5e-3, 10)
    for law, jumps in ((SOFT, False), (BRITTLE, True), (HARDENING, False)):
        data = scene(dim=2, method="condensed-newton", E=E, friction=law, path=top[:, None])
        simulation = prepare(data)
        steps = list(simulation.steps())
        assert any("contacts.base.friction: mu falls by" in line for line in warnings(data))
        assert any("slip jumps, in 1 of 11 steps" in line for line in doubts(simulation, steps)) == jumps
        worst = max(step.weakening for step in steps)
        assert (worst > 1) == jumps
        if law is not HARDENING:  # the fall of mu p over slip_length, by G
            assert_allclose(worst, 0.1 * PRESSURE / law.slip_length / G, rtol=1e-6)
    plain = scene(dim=2, method="condensed-newton", E=E, friction=Coulomb(mu=0.3), path=top[:, None])
    assert not any("mu falls" in line for line in warnings(plain))


@pytest.mark.parametrize("method", METHODS)
def test_the_forces_that_make_a_column_slip_are_an_ellipse(method: str) -> None:
    """Far behind the top, slip goes the way of the top V: t_i = mu_i^2 V_i p / |mu V| in the law's directions."""
    mu, axis = np.array([0.3, 0.12]), np.array([0.8, 0.6])
    frame = np.array([axis, [-axis[1], axis[0]]])
    law = OrthotropicCoulomb(mu_1=mu[0], mu_2=mu[1], axis=(1.6, 1.2, 0.7))  # the part along the normal is of no account
    angles = np.radians([0.0, 40.0, 80.0, 120.0])
    turn = np.column_stack([np.cos(angles), np.sin(angles)])
    path = np.cumsum(1e2 * np.arange(1, 5)[:, None] * turn, axis=0)
    for base, way in zip(bases(scene(dim=3, method=method, E=E, friction=law, path=path))[1:], turn, strict=True):
        v = frame @ way
        t = mu**2 * v * PRESSURE / np.linalg.norm(mu * v)
        assert_allclose(-base.traction[:, :2] @ frame.T, np.broadcast_to(t, (len(base.traction), 2)), atol=1e-3)
        assert np.all(base.status == SLIP)
        assert_allclose(np.linalg.norm(base.lam, axis=1), 1.0, rtol=1e-6)
    a, b = -base.traction[:, :2].mean(axis=0) @ frame.T / (mu * PRESSURE)
    assert_allclose(a**2 + b**2, 1.0, rtol=1e-9)  # on the ellipse itself


def test_a_column_that_slips_goes_to_the_nearest_point_of_the_ellipse() -> None:
    """From rest the isotropic column's trial traction G V is projected onto the ellipse: by its normal there."""
    mu, V = np.array([0.3, 0.15]), np.array([0.006, 0.004])
    law = OrthotropicCoulomb(mu_1=mu[0], mu_2=mu[1], axis=(1.0, 0.0, 0.0))
    _, base = bases(scene(dim=3, method="condensed-newton", E=E, friction=law, path=V[None]))
    t = -base.traction[0, :2]
    assert_allclose(np.linalg.norm(t / (mu * PRESSURE)), 1.0, rtol=1e-9)
    left, normal = G * V - t, t / mu**2
    assert_allclose(left[0] * normal[1], left[1] * normal[0], rtol=1e-9)
    assert_allclose(base.bound[0], np.linalg.norm(t), rtol=1e-9)  # the bound is that in the direction of the traction


def test_equal_coefficients_in_both_directions_are_coulombs() -> None:
    path = np.array([[0.004, 0.001], [0.01, 0.02], [-0.01, 0.0]])
    ours, coulomb = (
        bases(scene(dim=3, method="condensed-newton", E=E, friction=law, path=path))
        for law in (OrthotropicCoulomb(mu_1=0.3, mu_2=0.3, axis=(0.6, 0.8, 0.0)), Coulomb(mu=0.3))
    )
    for one, other in zip(ours, coulomb, strict=True):
        assert_allclose(one.traction, other.traction, atol=1e-9 * PRESSURE)
        assert_allclose(one.dissipation_total, other.dissipation_total, rtol=1e-9)


def block(friction: dict[str, Any], dim: int = 2, **tables: Any) -> dict[str, Any]:
    """A block of 2 m (3D: 2 m by 1 m), 1 m high, on a plane."""
    width = {"width": 1.0} if dim == 3 else {}
    return {
        "model": "plane strain" if dim == 2 else "3d",
        "geometry": {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5} | width,
        "bodies": {"block": {"E": 1.0, "nu": 0.3}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}},
        "contacts": {"base": {"surface": "block.bottom", "against": "floor", "friction": friction}},
    } | tables


def holds(friction: dict[str, Any], force: tuple[float, ...]) -> bool:
    """Whether friction holds a floating block, 0.2 Pa on its top, that traction at its base pulls with a force [N]."""
    dim = len(force) + 1
    loads = {
        "press": {"boundary": "block.top", "pressure": 0.2},
        "pull": {"boundary": "block.bottom", "traction": [f / 2.0 for f in force] + [0.0]},
    }
    simulation = prepare(from_dict(block(friction, dim, loads=loads)))
    try:
        *_, step = simulation.steps()
    except NoEquilibriumError:
        return False
    assert_allclose(step.contacts["base"].force[:-1], -np.array(force), atol=1e-8)
    assert max(asdict(Auditor(simulation.problem, simulation.mesh)(record_of(step))).values()) < 1e-7
    return True


@pytest.mark.parametrize(
    ("friction", "most", "beyond"),
    [
        ({"law": "cohesion", "a": 0.02, "mu": 0.3}, 0.04 + 0.3 * 0.4, 1.02),  # a A + mu P
        (
            {"law": "pressure_dependent", "mu": [[0.0, 0.6], [0.1, 0.35], [0.2, 0.3]]},
            0.3 * 0.4,
            2.1,
        ),  # proved by the largest mu
        ({"law": "static_kinetic", "mu_s": 0.3, "mu_k": 0.1, "slip_length": 1e3}, 0.3 * 0.4, 1.02),
        ({"law": "slip_dependent", "mu": [[0.0, 0.3], [1e3, 0.4]]}, 0.3 * 0.4, 1.02),
    ],
)
def test_a_floating_block_is_held_up_to_the_bound_and_not_beyond(
    friction: dict[str, Any], most: float, beyond: float
) -> None:
    assert holds(friction, (0.97 * most,))
    assert not holds(friction, (beyond * most,))


@pytest.mark.parametrize("angle", [0.0, 50.0, 90.0])
def test_a_floating_block_is_held_within_the_ellipse_of_forces(angle: float) -> None:
    friction = {"law": "orthotropic_coulomb", "mu_1": 0.3, "mu_2": 0.1, "axis": [1.0, 0.0, 0.0]}
    way = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    most = 0.4 / np.linalg.norm(way / [0.3, 0.1])  # P over the ellipse's inverse radius
    assert holds(friction, tuple(0.98 * most * way))
    assert not holds(friction, tuple(1.03 * most * way))


@pytest.mark.parametrize(
    ("friction", "normal"),
    [
        ({"law": "cohesion", "a": 0.004, "mu": 0.2}, {"law": "unilateral"}),
        ({"law": "pressure_dependent", "mu": [[0.0, 0.5], [0.2, 0.3]]}, {"law": "compliance", "c_n": 20.0, "m_n": 2.0}),
        ({"law": "static_kinetic", "mu_s": 0.4, "mu_k": 0.2, "slip_length": 0.2}, {"law": "unilateral"}),
        ({"law": "static_kinetic", "mu_s": 0.4, "mu_k": 0.2, "slip_length": 0.2, "k_T": 2.0}, {"law": "bilateral"}),
        ({"law": "orthotropic_coulomb", "mu_1": 0.4, "mu_2": 0.2, "axis": [1.0, 1.0, 0.0]}, {"law": "unilateral"}),
    ],
)
def test_bent_by_the_drag_a_part_sticks_a_part_slips_and_the_audit_agrees(
    friction: dict[str, Any], normal: dict[str, Any]
) -> None:
    dim = 3 if "axis" in friction else 2
    drive = {"x": [[0, 0], [1, 0], [2, 0.1]], "xyz"[dim - 1]: [[0, 0], [1, -0.08]]}
    data = block(friction, dim, supports={"top": {"boundary": "block.top", "displacement": drive}})
    data["contacts"]["base"]["normal"] = normal
    data |= {"steps": {"end": 2.0, "count": 6}, "solver": {"tolerance": 1e-11}}
    simulation = prepare(from_dict(data))
    audit, before, both = Auditor(simulation.problem, simulation.mesh), None, False
    for step in simulation.steps():
        record = record_of(step)
        assert max(asdict(audit(record, before if step.substeps == 1 else None)).values()) < 1e-9
        assert not audit.shared
        before, status = record, step.contacts["base"].status
        both = both or bool(np.any(status == SLIP) and np.any(status == STICK))
    assert both
    for name, length in record.slid.items():  # slip that is not that of the displacement is found
        lost = replace(record, slid={name: 0.5 * length})
        assert audit(lost).complementarity > 1e-3
