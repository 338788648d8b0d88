"""The audit finds what is wrong with an answer, and says which law it breaks.

A perturbed traction is given the displacement that it would cause, so that equilibrium holds; w is left alone.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from shared.audited import record_of
from solvers.parallel.gather import nodes_of
from solvers.results.audit import Audit, Auditor, Record
from solvers.results.step_result import OPEN, SLIP, STICK, StepResult
from solvers.scene.scene import Scene
from solvers.simulation.resolve import resolve
from solvers.simulation.simulation import Simulation

Array = NDArray[np.float64]
CLEAN = 1e-8  # solver.tolerance is 1e-10
PLAINLY = 1e-4  # every perturbation below is of 1 % or more


@dataclass(frozen=True)
class Case:
    """A solved block: closed and open, sticking and slipping somewhere."""

    simulation: Simulation
    audit: Auditor
    step: StepResult
    record: Record

    def where(self, status: int) -> int:
        """The node furthest inside a region of that status."""
        found = np.flatnonzero(self.step.contacts["base"].status == status)
        x = self.simulation.system.contacts[0].surface.points[:, 0]
        inside = np.abs(x[found][:, None] - x[self.step.contacts["base"].status != status]).min(axis=1)
        return int(found[np.argmax(inside)])

    def normal(self, j: int) -> int:
        """Entry of node j's pressure in p."""
        assert len(self.simulation.system.contacts[0].W_n) == len(self.simulation.system.contacts[0].surface.nodes)
        return j

    def tangential(self, j: int) -> int:
        """Entry of node j's tangential traction in p; the node on the held side has none."""
        rows = self.simulation.system.contacts[0]
        (point,) = np.flatnonzero(rows.share_t[:, j].toarray())
        return len(rows.W_n) + int(point)

    def with_p(self, p: Array) -> Record:
        """Other tractions, in equilibrium."""
        system, stepper = self.simulation.system, self.simulation.stepper
        u_s, load = system.prescribed(self.record.time), system.load(self.record.time)
        f_q = system.T.createVecRight()
        system.T.multTranspose(load - system.K * u_s - system.interface.forces(*stepper.split(p)), f_q)
        u_c = stepper.surface.displacement(stepper.attempts.volume.condense(f_q))
        u = system.T * stepper.attempts.volume.expand(f_q, u_c) + u_s
        return replace(self.record, p=p, displacement=nodes_of(system.mesh, system.nodes)(u.array.reshape(-1, 2)))

    def defects(self, record: Record) -> dict[str, float]:
        return asdict(self.audit(record))

    def broken(self, record: Record) -> set[str]:
        """Defects that rise plainly; the others stay as clean as they were."""
        found = self.defects(record)
        assert all(value < CLEAN or value > PLAINLY for value in found.values()), found
        return {name for name, value in found.items() if value > PLAINLY}


@pytest.fixture(scope="module")
def case(scene_of: Callable[..., Scene], simulation_of: Callable[[Scene], Simulation]) -> Case:
    scene = scene_of(
        geometry={"length": 4.0, "height": 1.0, "mesh_size": 0.25},
        contacts={
            "base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}
        },
        supports={
            "right": {"boundary": "block.right", "displacement": {"x": 0.0}},
            "pin": {"point": [4.0, 1.0], "displacement": {"y": -0.05}},  # held without contact: p may be anything
        },
        loads={
            "press": {"boundary": "block.top", "pressure": [[0, 0], [1, 0.1], [2, 0.1]]},
            "push": {"boundary": "block.left", "traction": [[[0, 0], [1, 0], [2, 0.13]], [[0, 0], [1, 0], [2, 0.12]]]},
        },
        steps={"end": 2.0, "count": 2},
        solver={"tolerance": 1e-10},
    )
    simulation = simulation_of(scene)
    step = list(simulation.steps())[-1]
    record = record_of(step)
    return Case(simulation, Auditor(resolve(scene), simulation.mesh), step, record)


def test_the_case_has_everything_that_can_go_wrong(case: Case) -> None:
    status = case.step.contacts["base"].status
    assert set(status) == {OPEN, SLIP, STICK}
    assert case.step.contacts["base"].dissipation > 0


def test_an_accepted_step_is_clean(case: Case) -> None:
    found = case.defects(case.record)
    assert set(found) == {"equilibrium", "penetration", "negative_pressure", "cone", "complementarity", "dissipation"}
    assert max(found.values()) < CLEAN
    assert found["equilibrium"] < 1e-12  # rounding
    assert case.broken(case.with_p(case.record.p)) == set()  # the compensation itself is clean


def test_an_interior_displacement_breaks_equilibrium(case: Case) -> None:
    u = case.record.displacement.copy()
    inside = np.flatnonzero(np.linalg.norm(case.simulation.data.points - [2.0, 0.5], axis=1) < 1e-9)
    u[inside, 0] += 0.05 * np.abs(u).max()
    assert case.broken(replace(case.record, displacement=u)) == {"equilibrium"}


def test_a_body_that_moves_as_a_whole_is_in_equilibrium_but_not_one_that_is_strained(case: Case) -> None:
    u = np.full_like(case.record.displacement, 0.3)
    still = replace(case.record, time=0.0, p=np.zeros_like(case.record.p), displacement=u)  # no load yet
    assert case.defects(still)["equilibrium"] == 0.0  # what is left of the inner forces is rounding
    u[len(u) // 2, 0] *= 1 + 1e-9
    assert case.defects(replace(still, displacement=u))["equilibrium"] > PLAINLY


def test_a_displacement_that_is_prescribed_otherwise_breaks_nothing_but_equilibrium(case: Case) -> None:
    u = case.record.displacement.copy()
    u[np.isclose(case.simulation.data.points[:, 0], 4.0), 0] += 0.05 * np.abs(u).max()
    assert case.broken(replace(case.record, displacement=u)) == {"equilibrium"}


def test_a_closed_point_that_enters_the_foundation_penetrates(case: Case) -> None:
    w = case.record.w.copy()
    w[case.normal(case.where(STICK))] += 0.02 * case.record.u_ref
    assert case.broken(replace(case.record, w=w)) == {"penetration"}
    assert_allclose(case.defects(replace(case.record, w=w))["penetration"], 0.02, rtol=1e-6)  # relative to u_ref


def test_a_closed_point_that_lifts_off_under_pressure_is_not_complementary(case: Case) -> None:
    w = case.record.w.copy()
    w[case.normal(case.where(STICK))] -= 0.02 * case.record.u_ref
    assert case.broken(replace(case.record, w=w)) == {"complementarity"}


def test_suction_at_an_open_point_is_negative_pressure(case: Case) -> None:
    p = case.record.p.copy()
    p[case.normal(case.where(OPEN))] = -0.05 * case.record.p_ref
    assert case.broken(case.with_p(p)) == {"negative_pressure"}
    assert case.broken(replace(case.record, p=p)) == {"negative_pressure", "equilibrium"}


def test_pressure_across_an_open_gap_is_not_complementary(case: Case) -> None:
    p = case.record.p.copy()
    p[case.normal(case.where(OPEN))] = 0.05 * case.record.p_ref
    assert case.broken(case.with_p(p)) == {"complementarity"}
    assert case.broken(replace(case.record, p=p)) == {"complementarity", "equilibrium"}


def test_traction_beyond_friction_leaves_the_cone(case: Case) -> None:
    p, j = case.record.p.copy(), case.where(STICK)
    s = 0.3 * p[case.normal(j)]
    p[case.tangential(j)] = 1.2 * s * np.sign(p[case.tangential(j)])
    assert case.broken(case.with_p(p)) == {"cone"}
    # where it slips, too much traction is also not what slip calls for: t . du = s |du|
    p, j = case.record.p.copy(), case.where(SLIP)
    p[case.tangential(j)] *= 1.2
    assert case.broken(case.with_p(p)) == {"cone", "complementarity"}


def test_slip_below_the_bound_is_not_complementary(case: Case) -> None:
    p, j = case.record.p.copy(), case.where(SLIP)
    p[case.tangential(j)] *= 0.8
    assert case.broken(case.with_p(p)) == {"complementarity"}


def test_slip_along_the_traction_creates_energy(case: Case) -> None:
    # the slip law t . du = s |du| cannot hold then: complementarity, which has it, rises too
    back = replace(case.record, reference=2 * case.record.w - case.record.reference)
    assert case.broken(back) == {"dissipation", "complementarity"}
    energy = case.step.energy
    last = case.step.contacts["base"].dissipation
    assert_allclose(case.defects(back)["dissipation"], last / energy.external, rtol=1e-6)


def test_an_audit_without_contact_sees_equilibrium_only(
    scene_of: Callable[..., Scene], simulation_of: Callable[[Scene], Simulation]
) -> None:
    hold: dict[str, Any] = {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}}
    scene = scene_of(supports=hold, loads={"pull": {"boundary": "block.bottom", "traction": [0.1, -0.2]}})
    simulation = simulation_of(scene)
    (step,) = simulation.steps()
    record = record_of(step)
    audit = Auditor(resolve(scene), simulation.mesh)
    found = asdict(audit(record))
    assert found.pop("equilibrium") < 1e-13
    assert set(found.values()) == {0.0}
    assert audit(replace(record, displacement=1.1 * step.displacement)).equilibrium > 0.01
    assert Audit.worst([]) == dict.fromkeys(asdict(audit(record)))


@pytest.mark.parametrize("dim", [2, 3])
def test_compliance_is_audited_by_the_form_and_by_its_law(
    dim: int, scene_of: Callable[..., Scene], simulation_of: Callable[[Scene], Simulation]
) -> None:
    law = {"law": "compliance", "c_n": 4.0, "m_n": 1.5}
    drag = dict(zip("xyz"[:dim], (0.03, -0.1) if dim == 2 else (0.03, 0.01, -0.1), strict=True))
    scene = scene_of(
        dim,
        obstacles={"foundation": {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0],
                                  "displacement": {"y" if dim == 2 else "z": 0.05}}},
        contacts={"base": {"surface": "block.bottom", "against": "foundation", "normal": law,
                           "friction": {"law": "coulomb", "mu": 0.3}}},
        supports={"top": {"boundary": "block.top", "displacement": drag}},
        solver={"tolerance": 1e-10},
    )  # fmt: skip
    simulation = simulation_of(scene)
    (step,) = simulation.steps()
    record = record_of(step)
    audit = Auditor(resolve(scene), simulation.mesh)
    assert max(asdict(audit(record)).values()) < CLEAN
    # the pressures of the rows are held against the law, those of equilibrium come from the form
    normal = simulation.stepper.cone.places[0].normal
    p = record.p.copy()
    p[normal] *= 0.9
    softer = audit(replace(record, p=p))
    assert softer.penetration > PLAINLY
    assert softer.equilibrium < 1e-9
    u = record.displacement.copy()
    bottom = np.isclose(simulation.data.points[:, dim - 1], 0.0)
    u[bottom, dim - 1] -= 0.05 * record.u_ref
    assert audit(replace(record, displacement=u)).equilibrium > PLAINLY


@pytest.mark.parametrize("law", [{"law": "unilateral"}, {"law": "compliance", "c_n": 4.0}])
def test_an_obstacle_that_a_force_drives_is_in_equilibrium_too(
    law: dict[str, Any], scene_of: Callable[..., Scene], simulation_of: Callable[[Scene], Simulation]
) -> None:
    plane = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "force": {"y": 0.2}}
    scene = scene_of(
        obstacles={"foundation": plane},
        contacts={"base": {"surface": "block.bottom", "against": "foundation", "normal": law}},
        supports={"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}},
        solver={"tolerance": 1e-10},
    )
    simulation = simulation_of(scene)
    (step,) = simulation.steps()
    record = record_of(step)
    assert max(asdict(Auditor(resolve(scene), simulation.mesh)(record)).values()) < CLEAN
    heavier = replace(scene, obstacles={"foundation": replace(scene.obstacles["foundation"], force={"y": 0.3})})
    assert Auditor(resolve(heavier), simulation.mesh)(record).equilibrium > PLAINLY


def test_rounding_is_no_traction_beyond_friction(case: Case) -> None:
    p = 1e-16 * case.record.p_ref * np.random.default_rng(3).normal(size=len(case.record.p))
    assert case.defects(replace(case.record, p=p))["cone"] < CLEAN
