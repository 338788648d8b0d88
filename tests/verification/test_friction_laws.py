"""Friction laws against closed forms: the sheared column, and blocks that friction holds or not."""

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import record_of
from shared.failures import failures
from shared.problems import on_floor
from stickslip import SLIP, STICK, Coulomb, NoEquilibriumError, TangentialCompliance
from stickslip.solvers.laws.friction import OrthotropicCoulomb
from stickslip.solvers.laws.slip_dependent import StaticKinetic
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.simulation.plan import warnings
from stickslip.workflows.lab.verification.cases import friction_laws as case
from stickslip.workflows.lab.verification.cases import sheared_column
from stickslip.workflows.lab.verification.cases import sheared_column as sheared_column_case
from stickslip.workflows.lab.verification.cases.friction_laws import BRITTLE, HARDENING, SOFT, TOP, G
from stickslip.workflows.lab.verification.cases.sheared_column import (
    K_T,
    MU,
    PRESSURE,
    E,
    bases,
    cycled,
    driven,
    laws,
    penetrating,
    scene,
    threshold,
)
from stickslip.workflows.lab.verification.check import Check, accounted, repeats
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.warnings import doubts
from stickslip.workflows.scene_file.read import from_dict

METHODS = ("condensed-newton", "uzawa")
PATH = sheared_column.TOP[:, None]
# tolerances are the case's own, 1e-9: the state is uniform, and a step of any size is exact


def test_cycles_that_differ_are_noticed() -> None:
    steps = sheared_column_case.solve(
        scene(dim=2, method="condensed-newton", E=E, friction=Coulomb(mu=MU), path=np.tile(PATH, (5, 1)))
    )
    same = repeats("as they are", steps[1:], len(PATH))
    shifted = repeats("a step too early", steps[:-1], len(PATH))
    assert not failures(same)
    assert not failures(shifted)  # from cycle 2 on any five steps in a row come again
    grown = [*steps[:-1], replace(steps[-1], contacts=steps[-2].contacts)]
    assert {name.split(": ")[1].split(",")[0] for name in failures(repeats("another end", grown[1:], len(PATH)))} == {
        "tractions", "slip increments", "gaps", "forces",
    }  # fmt: skip
    still = [*steps[:-1], replace(steps[-1], contacts=steps[-3].contacts)]  # only sticks, and loses nothing
    assert "dissipation [J]" in " ".join(failures(repeats("another end", still[1:], len(PATH))))


@pytest.mark.parametrize(("c_T", "m_T"), [(1.001e6, 2.0), (1e6, 2.001)])
def test_threshold_notices_another_power_of_depth(c_T: float, m_T: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sheared_column_case, "TangentialCompliance", lambda **_: TangentialCompliance(c_T=c_T, m_T=m_T))
    assert failures(threshold("condensed-newton", 1e6, 2.0))
    assert len(failures(penetrating("condensed-newton", 1e6, 2.0))) > 10  # of 21; the first move only sticks


def test_a_stiff_base_is_that_of_the_rigid_law() -> None:
    rigid, stiff = (
        bases(scene(dim=2, method="condensed-newton", E=E, friction=Coulomb(mu=MU, k_T=k_T), path=PATH))
        for k_T in (None, 1e9)
    )
    for mine, theirs in zip(rigid, stiff, strict=True):
        # G / k_T = 1e-6 of what a move of 20 mm would make, 20 Pa, and of the move itself
        assert_allclose(mine.traction, theirs.traction, atol=2e-5)
        assert_allclose(mine.slip, theirs.slip, atol=2e-8)


def test_elastic_give_is_stored_and_given_back() -> None:
    law = Coulomb(mu=MU, k_T=K_T)
    steps = list(prepare(scene(dim=2, method="condensed-newton", E=E, friction=law, path=PATH)).steps())
    exact = sheared_column.drive(sheared_column.ShearedColumn(G=1000.0, bound=3.0, k_T=K_T), sheared_column.TOP)
    for step, tau in zip(steps[-len(PATH) :], exact.tau, strict=True):
        # closed form, as accurate as the states
        assert_allclose(step.energy.compliance, tau**2 / (2 * K_T), rtol=1e-9)
        assert_allclose(step.energy.external, step.energy.stored + step.energy.contact, rtol=1e-8)
    stuck = steps[-len(PATH)].energy
    assert_allclose(stuck.contact, stuck.compliance, rtol=1e-9)  # nothing has slipped: all of it is elastic
    assert_allclose(stuck.dissipated, 0.0, atol=1e-9 * stuck.compliance)


def test_bound_is_mu_times_pressure_for_coulomb_and_as_given_for_tresca() -> None:
    for law in laws(mu=MU / 2).values():
        slipping = bases(scene(dim=2, method="condensed-newton", E=E, friction=law, path=PATH))[2]
        # as above
        assert_allclose(slipping.tangential_force, MU / 2 * sheared_column_case.PRESSURE, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("law", laws())
def test_checks_fail_without_friction(method: str, law: str) -> None:
    def names(checks: list[Check], passed: Callable[[Check], bool]) -> set[str]:
        return {check.name.split(":")[1].split("[")[0].strip() for check in checks if passed(check)}

    checks = [c for c in driven(method, law, laws(mu=0.0)[law]) if "pressure" not in c.name]
    passing = names(checks, lambda check: check.passed)
    assert passing <= {"dissipation so far"}  # the moves that only stick dissipate nothing either way
    assert len(failures(checks)) == len(checks) - 1
    assert len(failures(cycled(method, mu=0.0))) == 4


def test_energy_that_is_lost_is_noticed() -> None:
    steps = sheared_column_case.solve(scene(dim=2, method="condensed-newton", E=E, friction=Coulomb(mu=MU), path=PATH))
    assert not failures(accounted("as it is", steps))
    energy, base = steps[3].energy, steps[3].contacts["base"]
    lost = replace(steps[3], energy=replace(energy, external=energy.external * (1 + 1e-8)))
    assert len(failures(accounted("work without an effect", [*steps[:3], lost]))) == 1
    driven = replace(steps[3], contacts={"base": replace(base, dissipation=-1e-9 * energy.external)})
    assert len(failures(accounted("friction that drives", [*steps[:3], driven]))) == 1


def test_dissipation_of_the_last_state_is_the_sum_over_the_moves() -> None:
    states = bases(scene(dim=2, method="condensed-newton", E=E, friction=Coulomb(mu=MU), path=PATH))
    # a sum of six terms: rounding
    assert_allclose(np.sum([s.dissipation for s in states]), states[-1].dissipation_total, rtol=1e-13)


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
    return on_floor(dim, {"mesh_size": 0.5}, {}, {"friction": friction}, **tables)


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
def test_a_floating_block_is_held_up_to_the_bound_alone(friction: dict[str, Any], most: float, beyond: float) -> None:
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
    for name, length in record.memory.items():  # slip that is not that of the displacement is found
        lost = replace(record, memory={name: 0.5 * length})
        assert audit(lost).complementarity > 1e-3
