"""The audit finds what is wrong with an answer, and says which law it breaks.

A perturbed traction is given the displacement that it would cause, so that equilibrium holds: what that displacement
breaks in its turn is named too.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.audited import record_of, stored_by
from stickslip.solvers.parallel.gather import nodes_of
from stickslip.solvers.results.audit import Audit, Auditor, Record, _largest
from stickslip.solvers.results.step_result import OPEN, SLIP, STICK, StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.simulation.simulation import Simulation

Array = NDArray[np.float64]
CLEAN = 1e-8  # solver.tolerance is 1e-10
PLAINLY = 1e-4  # every perturbation below is of 1 % or more


@dataclass(frozen=True)
class Case:
    """A solved block: closed and open, sticking and slipping somewhere."""

    simulation: Simulation
    audit: Auditor
    steps: tuple[StepResult, ...]
    step: StepResult  # the last one
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
        u_c = stepper.surface.displacement(stepper.chain.volume.condense(f_q))
        u = system.T * stepper.chain.volume.expand(f_q, u_c) + u_s
        return self.moved(nodes_of(system.mesh, system.nodes)(u.array.reshape(-1, 2)), p)

    def moved(self, u: Array, p: Array | None = None) -> Record:
        """Another displacement, and the w that belongs to it."""
        (rows,) = self.simulation.system.contacts
        w = np.concatenate([rows.N_n @ u[rows.input].ravel(), rows.N_t @ u[rows.input].ravel()])
        return replace(self.record, displacement=u, w=w, p=self.record.p if p is None else p)

    def lifted(self, status: int, by: float) -> Record:
        """A node of that status moved upwards by so much of the largest displacement."""
        u = self.record.displacement.copy()
        node = self.simulation.system.contacts[0].input[self.where(status)]
        u[node, 1] += by * np.abs(u).max()
        return self.moved(u)

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
    steps = tuple(simulation.steps())
    return Case(simulation, Auditor(resolve(scene), simulation.mesh), steps, steps[-1], record_of(steps[-1]))


def test_the_case_has_everything_that_can_go_wrong(case: Case) -> None:
    status = case.step.contacts["base"].status
    assert set(status) == {OPEN, SLIP, STICK}
    assert case.step.contacts["base"].dissipation > 0


def test_an_accepted_step_is_clean(case: Case) -> None:
    found = case.defects(case.record)
    laws = {"penetration", "negative_pressure", "cone", "complementarity", "dissipation"}
    assert set(found) == {"equilibrium", "rounding", "supports", "fields"} | laws
    assert max(found.values()) < CLEAN
    assert found["equilibrium"] < 1e-12  # rounding
    assert case.broken(case.with_p(case.record.p)) == set()  # the compensation itself is clean


def test_an_interior_displacement_breaks_equilibrium(case: Case) -> None:
    u = case.record.displacement.copy()
    inside = np.flatnonzero(np.linalg.norm(case.simulation.data.points - [2.0, 0.5], axis=1) < 1e-9)
    u[inside, 0] += 0.05 * np.abs(u).max()
    assert case.broken(case.moved(u)) == {"equilibrium"}


def test_a_body_that_moves_as_a_whole_is_in_equilibrium_but_not_one_that_is_strained(case: Case) -> None:
    u = np.full_like(case.record.displacement, 0.3)
    still = replace(case.record, time=0.0, p=np.zeros_like(case.record.p), displacement=u)  # no load yet
    assert case.defects(still)["equilibrium"] == 0.0  # what is left of the inner forces is rounding
    u[len(u) // 2, 0] *= 1 + 1e-9
    assert case.defects(replace(still, displacement=u))["equilibrium"] > PLAINLY


def test_a_prescribed_displacement_that_is_not_met_is_seen(case: Case) -> None:
    u = case.record.displacement.copy()
    inner = np.isclose(case.simulation.data.points[:, 0], 4.0) & (case.simulation.data.points[:, 1] > 0.1)
    u[inner, 0] += 0.05 * np.abs(u).max()
    assert case.broken(case.moved(u)) == {"equilibrium", "supports"}


def test_a_closed_point_that_enters_the_foundation_penetrates(case: Case) -> None:
    assert case.broken(case.lifted(STICK, -0.02)) == {"penetration", "equilibrium"}


def test_a_closed_point_that_lifts_off_under_pressure_is_not_complementary(case: Case) -> None:
    assert case.broken(case.lifted(STICK, 0.02)) == {"complementarity", "equilibrium"}


def test_a_stored_relative_displacement_that_is_not_of_the_displacement_is_seen(case: Case) -> None:
    assert case.broken(replace(case.record, w=1.001 * case.record.w)) == {"fields"}


def test_suction_at_an_open_point_is_negative_pressure(case: Case) -> None:
    p = case.record.p.copy()
    p[case.normal(case.where(OPEN))] = -0.05 * case.step.p_ref
    assert case.broken(case.with_p(p)) >= {"negative_pressure"}
    assert case.broken(replace(case.record, p=p)) == {"negative_pressure", "equilibrium"}


def test_pressure_across_an_open_gap_is_not_complementary(case: Case) -> None:
    p = case.record.p.copy()
    p[case.normal(case.where(OPEN))] = 0.05 * case.step.p_ref
    assert case.broken(case.with_p(p)) >= {"complementarity"}
    assert case.broken(replace(case.record, p=p)) == {"complementarity", "equilibrium"}


def test_traction_beyond_friction_leaves_the_cone(case: Case) -> None:
    for status in (STICK, SLIP):
        p, j = case.record.p.copy(), case.where(status)
        s = 0.3 * p[case.normal(j)]
        p[case.tangential(j)] = 1.2 * s * np.sign(p[case.tangential(j)])
        assert case.broken(replace(case.record, p=p)) == {"cone", "equilibrium"}


def test_slip_below_the_bound_is_not_complementary(case: Case) -> None:
    p, j = case.record.p.copy(), case.where(SLIP)
    p[case.tangential(j)] *= 0.8
    assert case.broken(replace(case.record, p=p)) == {"complementarity", "equilibrium"}
    assert case.broken(case.with_p(p)) >= {"complementarity"}


def test_slip_along_the_traction_creates_energy(case: Case) -> None:
    # the slip law t . du = s |du| cannot hold then: complementarity, which has it, rises too
    back = replace(case.record, reference=2 * case.record.w - case.record.reference)
    assert case.broken(back) == {"dissipation", "complementarity"}


def test_slip_that_is_not_counted_from_the_step_before_is_seen(case: Case) -> None:
    first, last = (record_of(step) for step in case.steps)
    assert case.audit(last, first).fields < CLEAN
    later = replace(last, reference=last.reference + 0.01 * np.abs(last.w).max())
    assert case.audit(later, first).fields > PLAINLY


FIELDS = ("weight", "gap", "pressure", "traction", "slip", "lam", "slip_increment")


@pytest.mark.parametrize("name", FIELDS)
def test_every_stored_field_of_a_contact_is_read(case: Case, name: str) -> None:
    records = [replace(record_of(step), stored=stored_by(step)) for step in case.steps]
    assert case.audit(records[1], records[0]).fields < 1e-12
    contact = dict(records[1].stored.contacts["base"])
    j = case.where(SLIP)
    contact[name] = contact[name].copy()
    contact[name][j] += 1e-3 * np.abs(contact[name]).max()
    stored = replace(records[1].stored, contacts={"base": contact})
    assert case.audit(replace(records[1], stored=stored), records[0]).fields > 1e-6


def test_stress_equivalent_stress_and_status_are_read(case: Case) -> None:
    record = replace(case.record, stored=stored_by(case.step))
    stored = record.stored
    stress, von_mises = stored.stress.copy(), stored.von_mises.copy()
    stress[5, 0, 1] += 1e-3 * np.abs(stress).max()
    von_mises[7] *= 1.01
    contact = {**stored.contacts["base"], "status": np.full_like(stored.contacts["base"]["status"], OPEN)}
    assert case.audit(record).fields < 1e-12
    for wrong in ({"stress": stress}, {"von_mises": von_mises}, {"contacts": {"base": contact}}):
        assert case.audit(replace(record, stored=replace(stored, **wrong))).fields > 1e-6


def test_no_number_that_is_not_finite_passes(case: Case) -> None:
    u = case.record.displacement.copy()
    u[3, 0] = np.nan
    assert set(case.defects(replace(case.record, displacement=u)).values()) == {np.inf}
    stored = stored_by(case.step)
    contact, none = stored.contacts["base"], [replace(case.record, reference=case.record.reference * np.nan)]
    for name in FIELDS:
        spoilt = {"base": {**contact, name: np.full_like(contact[name], np.nan)}}
        none.append(replace(case.record, stored=replace(stored, contacts=spoilt)))
    none.append(replace(case.record, stored=replace(stored, von_mises=stored.von_mises * np.nan)))
    for record in none:
        assert set(case.defects(record).values()) == {np.inf}


def test_the_worst_of_several_steps_hides_no_nan(case: Case) -> None:
    clean = case.audit(case.record)
    for audits in ([clean, replace(clean, cone=np.nan)], [replace(clean, cone=np.nan), clean]):
        worst = Audit.worst(audits)["cone"]
        assert worst is not None
        assert np.isnan(worst)


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
    assert 0 < found.pop("rounding") < 1e-13
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
    u[bottom, dim - 1] -= 0.05 * step.u_ref
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
    case.defects(case.record)  # the step before was pressed
    p = 1e-16 * case.step.p_ref * np.random.default_rng(3).normal(size=len(case.record.p))
    assert case.defects(replace(case.record, p=p))["cone"] < CLEAN


def test_an_open_node_may_have_a_pressure_that_is_rounding_beside_the_forces_and_no_larger_one(
    scene_of: Callable[..., Scene], simulation_of: Callable[[Scene], Simulation]
) -> None:
    scene = scene_of(
        contacts={"base": {"surface": "block.bottom", "against": "foundation", "gap_offset": 1.0}},
        supports={"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}},
        loads={"push": {"boundary": "block.left", "pressure": 1.0}},
    )
    simulation = simulation_of(scene)
    (step,) = simulation.steps()
    audit, p = Auditor(resolve(scene), simulation.mesh), np.zeros(len(step.p))
    for pressure, least, most in ((0.0, 0.0, 1e-12), (1e-16, 0.0, 1e-12), (1e-7, 0.1, 1.0)):  # a force of 1 N/m
        p[3] = pressure
        contact = replace(step.contacts["base"], pressure=p[: len(step.contacts["base"].pressure)].copy())
        assert (contact.status == OPEN).all()
        solved = replace(step, p=p.copy(), contacts={"base": contact})
        assert least <= audit(replace(record_of(solved), stored=stored_by(solved))).fields <= most


def test_the_largest_of_nothing_is_zero() -> None:
    assert _largest(np.zeros(0)) == 0.0
    assert _largest(np.array([-3.0])) == 0.0
    assert str(_largest(np.array([-0.0]))) == "0.0"
