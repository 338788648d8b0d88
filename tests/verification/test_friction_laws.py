"""Friction laws beyond Coulomb's, against closed forms: the sheared column, and blocks that friction holds or not."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import record_of
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.laws.orthotropic_coulomb import OrthotropicCoulomb
from stickslip.solvers.laws.slip_dependent import StaticKinetic
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.results.step_result import SLIP, STICK
from stickslip.solvers.simulation.plan import warnings
from stickslip.solvers.stepping.stepper import NoEquilibriumError
from stickslip.workflows.lab.verification.cases import friction_laws as case
from stickslip.workflows.lab.verification.cases.friction_laws import BRITTLE, HARDENING, SOFT, TOP, G
from stickslip.workflows.lab.verification.cases.sheared_column import PRESSURE, E, bases, scene
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.warnings import doubts
from stickslip.workflows.scene_file.read import from_dict


def test_checks_notice_another_bound_fall_or_ellipse(monkeypatch: pytest.MonkeyPatch) -> None:
    law, bound = case.BOUNDED[0]
    assert failures(case.bounded("condensed-newton", law, 1.01 * bound))
    monkeypatch.setattr(case, "G", 1.01 * G)
    assert failures(case.weakened("condensed-newton", SOFT))
    monkeypatch.setattr(case, "MU", 1.01 * case.MU)
    assert failures(case.dragged("condensed-newton"))


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
        ({"law": "slip_dependent", "mu": [[0.0, 0.3], [1e3, 0.4]]}, 0.3 * 0.4, 1.36),  # proved by the mu of all slip
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
