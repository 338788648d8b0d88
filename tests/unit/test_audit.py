"""The audit sees every defect of a step from its displacement and tractions, and calls no right step wrong."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import record_of, stored_by
from shared.cases import every_nth
from shared.problems import plane, scene_of
from stickslip.geometry.arrays import EPS, LAST_DIGITS, ROUNDING, SLIGHT, Array
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.build import MultiplierNodes
from stickslip.solvers.laws.friction import Coulomb, Tresca
from stickslip.solvers.laws.normal import Compliance, Unilateral
from stickslip.solvers.parallel.gather import nodes_of
from stickslip.solvers.results import audit as module
from stickslip.solvers.results.audit import Audit, Auditor, Record, Scales, _largest
from stickslip.solvers.results.step_result import OPEN, SLIP, STICK, StepResult
from stickslip.solvers.results.stored_fields import MultiplierForces, StoredFields
from stickslip.solvers.scene.record import STATUS_WORDS
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.system.system import System
from stickslip.workflows.lab.verification.prepared import prepare, system_of

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
def case() -> Case:
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
    simulation = prepare(scene)
    steps = tuple(simulation.steps())
    return Case(simulation, Auditor(resolve(scene), simulation.mesh), steps, steps[-1], record_of(steps[-1]))


def test_the_case_has_everything_that_can_go_wrong(case: Case) -> None:
    status = case.step.contacts["base"].status
    assert set(status) == {OPEN, SLIP, STICK}
    assert case.step.contacts["base"].dissipation > 0


def test_an_accepted_step_is_clean(case: Case) -> None:
    found = case.defects(case.record)
    laws = {"penetration", "negative_pressure", "cone", "complementarity", "dissipation"}
    assert set(found) == {"equilibrium", "moment", "rounding", "supports", "fields", "numbers", "files"} | laws
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


def test_a_closed_point_that_enters_or_lifts_off_and_a_stored_w_that_is_not_of_u_are_seen(case: Case) -> None:
    assert case.broken(case.lifted(STICK, -0.02)) == {"penetration", "equilibrium"}
    assert case.broken(case.lifted(STICK, 0.02)) == {"complementarity", "equilibrium"}
    assert case.broken(replace(case.record, w=1.001 * case.record.w)) == {"fields"}


@pytest.mark.parametrize(("by", "defect"), [(-0.05, "negative_pressure"), (0.05, "complementarity")])
def test_suction_at_an_open_point_or_pressure_across_its_gap_is_seen(case: Case, by: float, defect: str) -> None:
    p = case.record.p.copy()
    p[case.normal(case.where(OPEN))] = by * case.step.p_ref
    assert case.broken(case.with_p(p)) >= {defect}
    assert case.broken(replace(case.record, p=p)) == {defect, "equilibrium"}


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


def test_vectors_of_the_plane_that_a_file_has_in_space_are_read(case: Case) -> None:
    records = [replace(record_of(step), stored=stored_by(step, case.steps[0])) for step in case.steps]
    padded = []
    for record in records:
        (base,) = record.stored.contacts.values()
        space = {k: np.column_stack([v, 0 * v[:, :1]]) if np.ndim(v) == 2 else v for k, v in base.items()}
        padded.append(replace(record, stored=replace(record.stored, contacts={"base": space})))
    assert case.audit(padded[1], padded[0]) == case.audit(records[1], records[0])
    assert case.audit(records[1], records[0]).numbers < CLEAN


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


def test_the_worst_of_several_audits_is_taken_for_each_defect_and_hides_no_nan(case: Case) -> None:
    clean = case.audit(case.record)
    worst = Audit.worst([replace(clean, supports=3.0), replace(clean, cone=2.0, supports=0.0)])
    assert (worst["cone"], worst["supports"], worst["fields"]) == (2.0, 3.0, clean.fields)
    for audits in ([clean, replace(clean, cone=np.nan)], [replace(clean, cone=np.nan), clean]):
        assert np.isnan(Audit.worst(audits)["cone"] or 0.0)


@pytest.mark.parametrize("nu", [0.3, 0.499])  # whose dilatation is averaged
def test_an_audit_without_contact_sees_equilibrium_only(nu: float) -> None:
    hold: dict[str, Any] = {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}}
    pull = {"pull": {"boundary": "block.bottom", "traction": [0.1, -0.2]}}
    scene = scene_of(supports=hold, loads=pull, bodies={"block": {"E": 1.0, "nu": nu}})
    simulation = prepare(scene)
    (step,) = simulation.steps()
    record = record_of(step)
    audit = Auditor(resolve(scene), simulation.mesh)
    found = asdict(audit(record))
    assert found.pop("equilibrium") < 1e-13
    assert 0 < found.pop("rounding") < 1e-13 / (1 - 2 * nu)  # by which volumes are stiffer
    assert set(found.values()) == {0.0}
    assert audit(replace(record, displacement=1.1 * step.displacement)).equilibrium > 0.01
    assert max(asdict(audit(replace(record, stored=stored_by(step)))).values()) < 1e-12
    assert Audit.worst([]) == dict.fromkeys(asdict(audit(record)))


@pytest.mark.parametrize("dim", [2, 3])
def test_compliance_is_audited_by_form_and_by_law(dim: int) -> None:
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
    simulation = prepare(scene)
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
def test_an_obstacle_that_a_force_drives_is_in_equilibrium_too(law: dict[str, Any]) -> None:
    driven = plane() | {"force": {"y": 0.2}}
    scene = scene_of(
        obstacles={"foundation": driven},
        contacts={"base": {"surface": "block.bottom", "against": "foundation", "normal": law}},
        supports={"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}},
        solver={"tolerance": 1e-10},
    )
    simulation = prepare(scene)
    (step,) = simulation.steps()
    record = record_of(step)
    assert max(asdict(Auditor(resolve(scene), simulation.mesh)(record)).values()) < CLEAN
    heavier = replace(scene, obstacles={"foundation": replace(scene.obstacles["foundation"], force={"y": 0.3})})
    assert Auditor(resolve(heavier), simulation.mesh)(record).equilibrium > PLAINLY


def test_rounding_is_no_traction_beyond_friction(case: Case) -> None:
    case.defects(case.record)  # the step before was pressed
    p = 1e-16 * case.step.p_ref * np.random.default_rng(3).normal(size=len(case.record.p))
    assert case.defects(replace(case.record, p=p))["cone"] < CLEAN


def test_an_open_node_may_have_a_pressure_that_is_rounding_beside_the_forces_and_no_larger_one() -> None:
    scene = scene_of(
        contacts={"base": {"surface": "block.bottom", "against": "foundation", "gap_offset": 1.0}},
        supports={"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}},
        loads={"push": {"boundary": "block.left", "pressure": 1.0}},
    )
    simulation = prepare(scene)
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


MODELS: dict[str, tuple[int, str, dict[str, Any]]] = {
    "triangles": (2, "plane strain", {"contact_mesh_size": 0.11}),
    "quadratic triangles": (2, "plane strain", {"order": 2}),
    "quadratic quadrilaterals": (2, "plane strain", {"cells": "tensor", "order": 2}),
    "revolved": (2, "axisymmetric", {}),
    "quadratic, revolved": (2, "axisymmetric", {"order": 2}),
    "tetrahedra": (3, "3d", {"contact_mesh_size": 0.3}),
    "quadratic tetrahedra": (3, "3d", {"order": 2}),
    "hexahedra": (3, "3d", {"cells": "tensor"}),
    "quadratic hexahedra": (3, "3d", {"cells": "tensor", "order": 2}),
}
LAWS: dict[str, dict[str, Any]] = {
    "unilateral": {"normal": {"law": "unilateral"}},
    "unilateral, coulomb": {"normal": {"law": "unilateral"}, "friction": {"law": "coulomb", "mu": 0.3}},
    "bilateral, tresca": {"normal": {"law": "bilateral"}, "friction": {"law": "tresca", "bound": 0.05}},
    "unilateral, k_T": {"normal": {"law": "unilateral"}, "friction": {"law": "coulomb", "mu": 0.3, "k_T": 2.0}},
    "unilateral, stick": {"normal": {"law": "unilateral"}, "friction": {"law": "stick"}},
    "compliance, coulomb": {
        "normal": {"law": "compliance", "c_n": 4.0, "m_n": 1.5}, "friction": {"law": "coulomb", "mu": 0.3}
    },
    "tied": {"normal": {"law": "tied"}},
}  # fmt: skip
EDGES = ("free", "rolling", "held")
EXACT = 1e-13  # of the largest force


def scene(model: str, law: str, edge: str = "free", **more: Any) -> Scene:
    """A block pressed and dragged on a plane; `rolling` and `held` supports of a side reach into the contact's edge.

    Args:
        more: keys of the contact.
    """
    dim, name, geometry = MODELS[model]
    axes = "xyz"[:dim]
    drag = dict.fromkeys(axes, 0.0) | {"x": 0.0 if name == "axisymmetric" else 0.02, axes[-1]: -0.1}
    supports: dict[str, Any] = {"top": {"boundary": "block.top", "displacement": drag}}
    if edge == "rolling":
        supports = {"side": {"boundary": "block.right", "displacement": {"x": 0.0}}}
    if edge == "held":  # the normal motion of the edge too: its neighbours share its multiplier
        supports = {"side": {"boundary": "block.right", "displacement": dict.fromkeys(axes, 0.0)}}
    contacts = {"base": {"surface": "block.bottom", "against": "foundation", **LAWS[law], **more}}
    tables = {"supports": supports, "contacts": contacts, "solver": {"tolerance": 1e-10}}
    return scene_of(dim, geometry, model=name, **tables)


def compared(system: System, moved: Array | None = None, forces: MultiplierForces | None = None) -> tuple[Array, Array]:
    """Forces by rows and by forms of admissible random tractions; compliant pressures are no multipliers."""
    start, random = system.contacts[0], np.random.default_rng(5)
    forces = forces or MultiplierForces(system, start)
    (rows,) = system.searched({"base": moved}).contacts if moved is not None else system.contacts
    cone = AdmissibleSet((rows,), 1.0, 1.0)
    hat = random.normal(size=cone.size) + 0.2  # pressed, open, sticking and slipping somewhere
    p = cone.project(hat, np.ones(cone.size))
    (place,) = cone.places
    p_n, t = p[place.normal], p[place.tangential].reshape(rows.free.shape)
    s = cone.bound(place, p_n) if rows.friction is not None else np.zeros(0)
    found = forces(rows, p_n, t, s, 1.0, moved).array
    of_rows = np.zeros_like(p_n) if rows.normal.at_quadrature else p_n
    return found, system.interface.force_of(rows, of_rows, t).array


@pytest.mark.parametrize(("model", "law", "edge"), every_nth(4, MODELS, LAWS, EDGES))
def test_forms_of_the_tractions_are_the_forces_of_the_rows(model: str, law: str, edge: str) -> None:
    system = system_of(scene(model, law, edge))
    (rows,) = system.contacts
    if not rows.normal.at_quadrature:
        assert (len(rows.W_n) < len(rows.surface.nodes)) == (edge == "held")
    found, expected = compared(system)
    assert np.abs(expected).max() > 0
    assert_allclose(found, expected, rtol=0, atol=EXACT * np.abs(expected).max())


@pytest.mark.parametrize("model", ["triangles", "quadratic, revolved", "tetrahedra", "quadratic tetrahedra"])
def test_they_are_so_on_a_round_obstacle_and_periodic_side(model: str) -> None:
    dim, name, geometry = MODELS[model]
    ball = {"shape": "sphere", "center": [0.0, *[0.5] * (dim - 2), -3.0], "radius": 3.0}
    if name == "plane strain":
        ball = {"shape": "cylinder", "point": [1.0, -3.0], "radius": 3.0}
    contact = {"base": {"surface": "block.bottom", "against": "ball", **LAWS["unilateral, coulomb"]}}
    periodic = {} if name == "axisymmetric" else {"x": {"boundary": "block.right", "with": "block.left"}}
    system = system_of(
        scene_of(dim, geometry, model=name, obstacles={"ball": ball}, contacts=contact, periodic=periodic)
    )
    found, expected = compared(system)
    assert_allclose(found, expected, rtol=0, atol=EXACT * np.abs(expected).max())


@pytest.mark.parametrize("model", [m for m in MODELS if MODELS[m][2].get("cells") != "tensor"])
def test_a_contact_that_slides_gets_new_fields_and_areas_and_no_new_forms(model: str) -> None:
    system = system_of(scene(model, "unilateral, k_T", sliding=True))
    (rows,) = system.contacts
    forces = MultiplierForces(system, rows)
    compiled = system.counters.forms
    x = rows.surface.points
    for size in (0.05, 0.2):
        bent = size * x[:, :1] ** 2 * np.arange(1.0, x.shape[1] + 1)  # stretched and tilted
        found, expected = compared(system, bent, forces)
        assert_allclose(found, expected, rtol=0, atol=EXACT * np.abs(expected).max())
    assert system.counters.forms == compiled
    found, expected = compared(system, None, forces)  # back at the start
    assert_allclose(found, expected, rtol=0, atol=EXACT * np.abs(expected).max())


def test_a_traction_where_nothing_presses_is_a_force_too() -> None:
    """It breaks the law of friction, which is said there; equilibrium is that of the tractions as they are."""
    system = system_of(scene("triangles", "unilateral, coulomb"))
    (rows,) = system.contacts
    p_n, t = np.zeros(len(rows.W_n)), np.ones(rows.free.shape)
    found = MultiplierForces(system, rows)(rows, p_n, t, np.zeros(len(t)), 1.0, None).array
    expected = system.interface.force_of(rows, p_n, t).array
    assert_allclose(found, expected, rtol=0, atol=EXACT * np.abs(expected).max())


Change = Callable[[Any], Any]
# wrong in the solver and in the audit alike: both take the rows from the same code
WRONG: dict[str, tuple[type, str, Change]] = {
    "W": (MultiplierNodes, "rows", lambda found: (found[0], 1.1 * found[1])),
    "N": (MultiplierNodes, "rows", lambda found: (1.1 * found[0], found[1])),
    "order of rows": (MultiplierNodes, "rows", lambda found: (found[0][::-1], found[1][::-1])),
    "areas of nodes": (Surface, "node_weights", lambda found: 1.1 * found),
    "nothing": (Surface, "node_weights", lambda found: found),
}


def by_rows(auditor: Auditor, record: Record) -> float:
    """Equilibrium with the forces N^T W p of the audit's own rows."""

    def force(place: Any, u: Any, record: Record, scales: Any) -> Any:
        p_n, t = record.p[place.normal], record.p[place.tangential].reshape(-1, place.components)
        return auditor.system.interface.force_of(place.rows, p_n, t)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(auditor, "_contact_force", force)
        return auditor(record).equilibrium


@pytest.mark.parametrize(("wrong", "model"), every_nth(2, WRONG, ["triangles", "revolved", "tetrahedra"]))
def test_wrong_rows_show_in_equilibrium_though_they_agree_with_themselves(
    wrong: str, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    where, name, change = WRONG[wrong]
    right = getattr(where, name)
    monkeypatch.setattr(where, name, lambda *args: change(right(*args)))
    simulation = prepare(scene(model, "unilateral, coulomb"))
    (step,) = simulation.steps()
    auditor, record = Auditor(simulation.problem, simulation.mesh), record_of(step)
    assert by_rows(auditor, record) < 1e-10  # hidden
    found = auditor(record).equilibrium
    assert found < 1e-13 if wrong == "nothing" else found > 1e-3
    compiled = auditor.start.counters.forms
    assert auditor(record).equilibrium == found
    assert auditor.start.counters.forms == compiled  # once


HILL = {"shape": "cylinder", "point": [0.8, -4.05], "radius": 4.0}
BALL = {"shape": "sphere", "center": [0.0, -3.0], "radius": 3.0}
DRAWN = {"top": {"boundary": "block.top", "displacement": {"x": [[1, 0], [2, 0.1]], "y": [[0, 0], [1, -0.12]]}}}
DOWN = {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": [[0, 0], [2, -0.12]]}}}
SPRINGS = {"law": "coulomb", "mu": 0.3, "k_T": 7.0}
COULOMB = {"law": "coulomb", "mu": 0.1}
COMPLIANCE = {"law": "compliance", "c_n": 40.0, "m_n": 1.5}
TRESCA = {"law": "tresca", "bound": [[0, 0.01], [2, 0.03]]}


def table(contact: Mapping[str, Any], obstacle: Mapping[str, Any] = HILL, **more: Any) -> dict[str, Any]:
    base = {"surface": "block.bottom", "against": "hill", "gap_offset": -0.01, **contact}
    return {"obstacles": {"hill": obstacle}, "contacts": {"base": base}, "supports": DRAWN} | more


SCENES: dict[str, dict[str, Any]] = {
    "springs": table({"friction": SPRINGS}),
    "sliding": table({"friction": {"law": "coulomb", "mu": [[0, 0.1], [2, 0.3]]}, "sliding": True}),
    "sliding springs": table({"friction": SPRINGS, "sliding": True}),
    "compliance": table({"normal": COMPLIANCE, "friction": SPRINGS}),
    "sliding compliance": table({"normal": COMPLIANCE, "friction": TRESCA, "sliding": True}),
    "sliding compliance without friction": table({"normal": COMPLIANCE, "sliding": True}),
    "revolved": table({"friction": {"law": "coulomb", "mu": 0.3}}, BALL, supports=DOWN, model="axisymmetric"),
    "tied": table({"normal": {"law": "tied"}}, {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}),
}


TWO = {
    "geometry": {"builder": "two_blocks", "length": 2.0, "height": 0.5, "mesh_size": 0.25, "lower_mesh_size": 0.3},
    "bodies": {"upper": {"E": 2.0, "nu": 0.3}, "lower": {"E": 5.0, "nu": 0.2}},
    "obstacles": {},
    "supports": {
        "bed": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}},
        "top": {"boundary": "upper.top", "displacement": DRAWN["top"]["displacement"]},
    },
}
JOINT = {"surface": "upper.bottom", "against": "lower.top", "friction": SPRINGS}
SCENES |= {
    "between bodies": TWO | {"contacts": {"base": JOINT}},
    "between bodies, compliance": TWO | {"contacts": {"base": JOINT | {"normal": COMPLIANCE}}},
    "in 3D": table({"friction": SPRINGS}, BALL | {"center": [1.0, 0.5, -3.0]}, supports={
        "top": {"boundary": "block.top", "displacement": {"x": 0.05, "y": [[1, 0], [2, 0.04]], "z": -0.12}}
    }),
}  # fmt: skip


SHORTER = {"lower_length": 1.6, "lower_mesh_size": 0.25}  # its edges cross facets of the side above, at .2 and 1.8
OVERHANG = TWO | {"geometry": TWO["geometry"] | SHORTER, "contacts": {"base": JOINT | {"friction": COULOMB}}}
OVERHANG_3D = OVERHANG | {
    "geometry": OVERHANG["geometry"] | {"width": 0.5},
    "supports": {
        "bed": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0, "z": 0.0}},
        "top": {"boundary": "upper.top", "displacement": {"x": [[1, 0], [2, 0.1]], "z": [[0, 0], [1, -0.12]]}},
    },
}
SCENES |= {"overhang": OVERHANG, "overhang in 3D": OVERHANG_3D}


SCENES["on two sides"] = table(
    {"friction": SPRINGS}, thermal={"block": {"expansion": 1e-3, "temperature": [[0, 0], [1, 20.0], [2, -10.0]]}}
)
SCENES["on two sides"]["obstacles"]["wall"] = {"shape": "plane", "point": [2.005, 0.0], "normal": [-1.0, 0.0]}
SCENES["on two sides"]["contacts"]["side"] = {"surface": "block.right", "against": "wall"}


@dataclass(frozen=True)
class Solved:
    """Solved steps, as they are stored."""

    simulation: Simulation
    steps: tuple[StepResult, ...]
    records: tuple[Record, ...]

    def auditor(self) -> Auditor:
        return Auditor(self.simulation.problem, self.simulation.mesh)

    def audits(self) -> list[dict[str, float]]:
        """Of all steps, each after the one before."""
        audit = self.auditor()
        return [asdict(audit(now, then)) for then, now in zip((None, *self.records), self.records, strict=False)]


@pytest.fixture(scope="module")
def case_of() -> Callable[[str], Solved]:
    """A block with E = 2 Pa, pressed onto a hill and drawn across it."""
    known: dict[str, Solved] = {}

    def make(name: str) -> Solved:
        if name not in known:
            tables = {"bodies": {"block": {"E": 2.0, "nu": 0.3}}, "steps": {"end": 2.0, "count": 4}}
            tables |= {"solver": {"tolerance": 1e-10}}
            simulation = prepare(scene_of(3 if "in 3D" in name else 2, **tables | SCENES[name]))
            steps = tuple(simulation.steps())
            pairs = pairwise((None, *steps))
            records = tuple(replace(record_of(step), stored=stored_by(step, before)) for before, step in pairs if step)
            known[name] = Solved(simulation, steps, records)
        return known[name]

    return make


@pytest.mark.parametrize("name", SCENES)
def test_accepted_steps_are_clean(name: str, case_of: Callable[[str], Solved]) -> None:
    case = case_of(name)
    for found in case.audits():
        assert max(found.values()) < CLEAN, found
    assert all(step.substeps == 1 for step in case.steps)  # so that slip is followed from step to step
    assert max(step.contacts["base"].normal_force for step in case.steps) > 0.01


@pytest.mark.parametrize("name", ["overhang", "overhang in 3D"])
def test_nodes_partly_beyond_the_other_side_slip_like_the_rest(name: str, case_of: Callable[[str], Solved]) -> None:
    """What the node beyond the edge feels belongs to the neighbour that carries its multiplier."""
    case = case_of(name)
    base, (rows,) = case.steps[-1].contacts["base"], case.simulation.system.contacts
    assert ((base.weight > 0) & (base.weight < rows.surface.node_weights() * (1 - 1e-9))).any()
    assert base.contact_area == pytest.approx(1.6 * (0.5 if "3D" in name else 1.0))
    assert base.stick_area == 0
    assert base.tangential_force == pytest.approx(float(np.linalg.norm(base.force[:-1])), rel=1e-8)
    assert base.tangential_force == pytest.approx(0.1 * base.normal_force, rel=1e-3)  # in 3D not all slips along x


@pytest.mark.parametrize("name", ["compliance", "sliding compliance", "springs"])
def test_it_does_not_ask_the_laws_of_the_solver(
    name: str, case_of: Callable[[str], Solved], monkeypatch: pytest.MonkeyPatch
) -> None:
    case = case_of(name)

    def asked(self: Any, *given: Any) -> Array:
        raise AssertionError(f"the solver's own formula of {self.law}")

    # a compliance's stiffness, which its own penetration serves, decides what rounding is, and no more
    forbidden = [(Compliance, "pressure"), (Compliance, "energy"), (Coulomb, "limit"), (Tresca, "limit")]
    for law, formula in forbidden:
        monkeypatch.setattr(law, formula, asked)
    for found in case.audits():
        assert max(found.values()) < CLEAN


@pytest.mark.parametrize("name", ["compliance", "sliding compliance", "sliding springs", "revolved"])
def test_laws_and_obstacles_without_a_second_formula_are_audited_by_the_first(
    name: str, case_of: Callable[[str], Solved], monkeypatch: pytest.MonkeyPatch
) -> None:
    for formula in ("gap", "bound", "penetration", "pressure", "stored_energy"):
        monkeypatch.setattr(module, formula, lambda *given: None)
    for found in case_of(name).audits():
        assert max(found.values()) < CLEAN


@pytest.mark.parametrize("name", ["springs", "sliding"])
def test_what_slip_counts_from_is_that_of_the_step_before(name: str, case_of: Callable[[str], Solved]) -> None:
    """Differences are relative to u_top where values are smaller, and less the rounding of lengths."""
    case = case_of(name)
    audit, (before, record) = case.auditor(), case.records[-2:]
    audit(record, before)
    (place,) = audit.cone.places
    scales = Scales(p=1.0, u={"base": 100.0}, rounding=1e-3)
    moved = replace(record, reference=record.reference + 0.01)
    assert audit._history(place, record, before, scales) == [0.0] * 3
    assert_allclose(audit._history(place, moved, before, scales), [(0.01 - 1e-3) / 100, 0.0, 0.0], rtol=1e-9)
    contact = {key: np.copy(value) for key, value in record.stored.contacts["base"].items()}
    for k, key in enumerate(("slip_increment", "slip"), 1):
        wrong = replace(record, stored=replace(record.stored, contacts={"base": contact | {key: contact[key] + 0.01}}))
        found = audit._history(place, wrong, before, scales)
        assert found[k] == pytest.approx((0.01 - 1e-3) / 100, rel=1e-9)
        assert sum(found) == found[k]
    bare = replace(before, stored=replace(before.stored, contacts={}))
    assert audit._history(place, record, bare, scales) == [0.0]


WORN = {"friction": COULOMB, "slide": [[0, 0.3], [1, 0.5], [2, 0.9]], "wear": {"k": [0.5, 1.0]}}
STATE = {"law": "rate_and_state", "f0": 0.3, "a": 0.02, "b": 0.015, "Dc": "0.02 + 0.01*x", "V0": 0.01}
REMEMBERING: dict[str, tuple[int, dict[str, Any]]] = {  # dimension, and the contact
    "wear": (2, WORN),
    "wear, held": (2, WORN),
    "wear without friction": (2, {"slide": 0.3, "wear": {"k": 2.0}}),
    "wear by slip alone": (2, {"friction": COULOMB, "wear": {"k": 2.0}}),
    "wear of tables": (2, {"friction": COULOMB, "wear": {"k": [[0, 1.0], [1, 3.0]], "by": "pressure"}}),
    "wear of a path": (2, {"friction": COULOMB, "wear": {"k": [[0, 1.0], [1, 3.0]], "by": "slip"}}),
    "wear of places": (2, {"friction": COULOMB, "wear": {"k": "1 + x"}}),
    "wear of places and times": (2, {"friction": COULOMB, "wear": {"k": "1 + x*t"}}),
    "slip, springs": (3, {"friction": {"law": "slip_dependent", "mu": [[0, 0.4], [1, 0.2]], "k_T": 7.0}}),
    "bilateral": (3, {"normal": {"law": "bilateral"},
                      "friction": {"law": "static_kinetic", "mu_s": 0.4, "mu_k": 0.2, "slip_length": 0.1}}),
    "rate": (3, {"friction": {"law": "rate_dependent", "mu": [[0, 0.1], [1, 0.4]]}}),
    "state": (2, {"friction": STATE}),
}  # fmt: skip


def remembering(name: str) -> tuple[Auditor, Any, Record]:
    """Tractions and motions that no solver has seen, at 1 s."""
    dim, contact = REMEMBERING.get(name, (2, {"friction": COULOMB, "slide": 0.4}))
    held = "block.bottom" if "held" in name else "block.right"  # no row, or a row or a direction less
    supports = {"side": {"boundary": held, "displacement": {"x": 0.0}}}
    base = {"surface": "block.bottom", "against": "foundation"} | contact
    tables = {"supports": supports, "steps": {"end": 2.0, "count": 2, "seconds": True}}
    scene = scene_of(dim, {"mesh_size": 0.5 if dim == 2 else 1.0}, contacts={"base": base}, **tables)
    audit, _, record, _, _ = judged(scene, seed=2)
    audit._set_system(audit.start, record.time)
    (place,) = audit.cone.places
    return audit, place, record


def by_time(name: str, then: Array, slip: Array, rows: Any, lasts: float) -> tuple[Array, Array]:
    """Rate, after state by the aging law after a time of constant rate; and what makes lengths of them."""
    if name == "rate":
        return slip / lasts, np.asarray(lasts)
    state = then[:, 0]
    Dc = 0.02 + 0.01 * (rows.fields.to_tangential @ rows.fields.points)[:, 0]
    steady = 0.01 * lasts / np.maximum(slip, 1e-300)
    slides = steady + (np.exp(state) - steady) * np.exp(-slip / Dc)
    theta = np.where(slip > 0, slides, np.exp(state) + 0.01 * lasts / Dc)
    return np.column_stack([np.log(theta), slip / lasts]), np.column_stack([Dc, np.full(len(Dc), lasts)])


@pytest.mark.parametrize("name", REMEMBERING)
def test_what_contacts_remember_is_that_of_the_definition(name: str) -> None:
    """In a step from 0.75 s to 1 s, after which each number in turn is changed by 0.01."""
    (audit, place, record), contact = remembering(name), REMEMBERING[name][1]
    rows, law, random, lasts = place.rows, place.rows.friction, np.random.default_rng(4), 0.25
    k, size = np.arange(len(rows.W_n)), np.abs(record.p[place.normal]) + 0.01
    before = replace(record, time=1 - lasts, p=record.p.copy())
    record.p[place.normal], before.p[place.normal] = size * np.array([1, 1, 1, -1, 0])[k % 5], -size * (-1) ** k
    scales, k_T = Scales(p=1.0, u={"base": 100.0}, rounding=1e-6), (law.k_T if law else None) or np.inf
    u, p_n = record.displacement[rows.input].ravel(), record.p[place.normal]
    two, shape = rows.normal.sides == 2, rows.free.shape
    pressed, was = (rows.average @ each.p[place.normal] > 0 for each in (record, before))
    closes = np.repeat(pressed & ~was & (not two), shape[1])
    assert closes.any() == (len(rows.W_t) > 0 and not two)

    counted = np.array(record.reference)
    before = replace(before, displacement=0.5 * record.displacement + 0.01)
    start = rows.N_t @ before.displacement[rows.input].ravel() - before.p[place.tangential] / k_T
    counted[place.tangential] = np.where(closes, counted[place.tangential], start)
    moves = (rows.N_t @ u - counted[place.tangential] - record.p[place.tangential] / k_T).reshape(shape)
    slips = np.array([np.hypot.reduce(each[free]) for each, free in zip(moves, rows.free, strict=True)])
    touched, unit = np.where(pressed | two, slips, 0.0), np.ones(1)
    then, now = dict[str, Array](), dict[str, Array]()
    points, aside = np.zeros(len(rows.W_n)), 0.5 - 0.45 if contact is WORN else 0.0
    if "wear" in name:
        aside = 0.3 * lasts / 2 if name == "wear without friction" else aside
        own = [w @ slips / w.sum() if w.sum() > 0 else 0.0 for w in rows.average.T.toarray() * rows.W_t]
        path = np.hypot(own if law else 0.0, aside) + points
        then = {"base.worn": 0.1 + points} | ({"base.slid": 0.2 + points} if law else {})
        rates = {"wear of tables": 1 + 2 * np.clip(p_n, 0, 1), "wear of a path": 1 + 2 * np.clip(0.2 + path, 0, 1)}
        places = 1 + rows.surface.points[:, 0] if "places" in name else 2.0
        now = {"base.worn": 0.1 + (1.5 if contact is WORN else rates.get(name, places)) * path * p_n}
        now |= {"base.slid": 0.2 + path} if law else {}
    if law and law.remembers:
        then["base"] = random.uniform(0.0, 0.1, (len(slips), 2)[: 1 + (name == "state")])
        now["base"] = (then["base"].T + touched).T
        if contact is WORN:
            now["base"] = touched / np.hypot(touched, aside)

    shown = {"base": {"wear": rows.node_pressure(now["base.worn"])}} if "wear" in name else {}
    if name in ("rate", "state"):
        now["base"], unit = by_time(name, then["base"], touched, rows, lasts)
        shown = {"base": {"rate": rows.share_t.T @ touched / lasts}}
    record = replace(record, reference=counted, memory=now, stored=StoredFields(contacts=shown))
    before = replace(before, memory=then)

    def found(**changed: Any) -> list[float]:
        return audit._history(place, replace(record, **changed), before, scales)

    assert_allclose(found(), 0.0)
    assert len(found()) == 1 + len(now) + len(shown)
    assert len(found(stored=StoredFields())) == 1 + len(now)
    for where, name_of, instead in ((type(law or audit), "after", None), (module, "remembered", lambda *given: None)):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(where, name_of, instead, raising=False)
            assert_allclose(found(), 0.0, atol=1e-12)
    with pytest.MonkeyPatch.context() as patch:  # of pairs that were found since, the memory is carried over
        patch.setattr(audit, "_carried", lambda its, old: old.memory[its.name] + 0.02)
        assert_allclose(found(), 0.0, atol=1e-12)
        anew = {"searched": {"base": np.zeros(0)}, "memory": now | {"base": now.get("base", np.zeros(1)) + 0.02}}
        assert name not in ("slip, springs", "bilateral") or max(found(**anew)) < 1e-12
    for row, free in enumerate(closes):
        other = counted.copy()
        other[place.tangential][row] += 0.01
        assert found(reference=other)[0] == pytest.approx(0.0 if free else (0.01 - 1e-6) / 100, rel=1e-9)
    for key, values in now.items():
        by = np.broadcast_to(0.01 / (unit if key == "base" else 1.0), values.shape)
        for point in np.ndindex(values.shape):
            other = values.copy()
            other[point] += by[point]
            assert max(found(memory=now | {key: other})) >= (0.01 - 1e-6) / 100 * (1 - 1e-9)
        assert np.isclose(found(memory=now | {key: values + by}), (0.01 - 1e-6) / 100, 1e-9, 0.0).any() == (
            len(values) > 0
        )
    for contacts in shown.values():
        ((key, values),) = contacts.items()
        wrong = values + 0.01 * (np.arange(len(rows.node_gap)) == 1)
        stored = StoredFields(contacts={"base": {key: wrong}})
        expected = (0.01 - 1e-6) / np.abs([*wrong, *values]).max()
        assert max(found(stored=stored)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("name", [*REMEMBERING, "slide alone"])
def test_work_beside_friction_in_the_plane_is_that_of_the_definition(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of pressure on what wears away, and of friction on what slides out of the plane."""
    audit, place, record = remembering(name)
    rows, record = place.rows, replace(record, p=np.abs(record.p) + 0.01)
    p_n = record.p[place.normal]
    worn, share = np.linspace(0.1, 1.0, len(p_n)), np.linspace(0.5, 1.1, len(rows.W_t))  # beyond 1 as if by rounding
    memory = {"base": share} if rows.friction else {}
    record = replace(record, memory=memory | ({"base.worn": worn} if "wear" in name else {}))
    before = replace(record, time=0.75, memory={"base.worn": worn / 3})
    bounds = 0.1 * np.maximum(rows.average @ p_n, 0.0)
    both = [(before, 0.05, 2 / 3 * worn), (None, 0.2, worn)]
    for known, aside, off in both:
        audit._before = known
        expected = float(rows.W_n @ (p_n * off)) if "wear" in name else 0.0
        if rows.slides and rows.friction:
            expected += float(rows.W_t @ (bounds * np.sqrt(np.maximum(1 - share**2, 0.0)))) * aside
        assert audit._beside(place, record) == pytest.approx(expected, rel=1e-12)
        assert (expected != 0.0) is (rows.slides or rows.wears)
        with monkeypatch.context() as patch:
            patch.setattr(module, "bound", lambda *given: None)
            assert audit._beside(place, record) == pytest.approx(expected, rel=1e-12)
    unknown = replace(record, stored=StoredFields(told_before={"time": 0.75}))
    assert audit._beside(place, unknown) == (None if rows.slides or rows.wears else 0.0)


@pytest.mark.parametrize("known", [True, False])
def test_work_at_contacts_is_that_of_both_ends_of_a_step(known: bool) -> None:
    """Mean forces on what moves between them, less mean pressures on a gap that grows; at first all rests."""
    base = {"surface": "block.bottom", "against": "floor", "normal": COMPLIANCE, "friction": COULOMB}
    contacts = {"base": base | {"gap_offset": "0.1*x*t - 0.2"}}
    floor = {"floor": plane(3) | {"displacement": {"z": 0.04}}}
    audit, place, record, _, _ = judged(scene_of(3, {"mesh_size": 1.0}, obstacles=floor, contacts=contacts), seed=1)
    rows, x = place.rows, (place.rows.fields.to_points @ place.rows.fields.points)[:, 0]
    before = replace(record, time=0.75, p=0.5 * record.p + 0.1, displacement=0.3 * record.displacement)
    ends = []
    for end, part in ((record, 1.0), (before, float(known))):
        forces = rows.nodal_forces(end.p[place.normal], end.p[place.tangential].reshape(-1, 2))
        motion = end.displacement[rows.input] - [0.0, 0.0, 0.04 * end.time]
        ends.append((part * forces, part * motion, part * end.p[place.normal], 0.1 * x * end.time * part))
    means, changes = [(a + b) / 2 for a, b in zip(*ends, strict=True)], [a - b for a, b in zip(*ends, strict=True)]
    expected = float(np.sum(means[0] * changes[1]) - rows.W_n @ (means[2] * changes[3]))
    told = {"told": {"substeps": 1}, "told_before": {"energy": {"contact": 3.0}} if known else {}}

    def found(**more: Any) -> float | None:
        return audit._work(replace(record, stored=StoredFields(**told | more)))

    audit._before = before if known else None
    assert found() == pytest.approx(expected + 3.0 * known, rel=1e-12)
    assert found(told={"substeps": 2}) is None
    audit._before = None
    assert (found() is None) is known


FORMS: dict[str, tuple[bool, dict[str, Any], dict[str, Any]]] = {  # whether they know the gap; contact, and obstacle
    "plane": (True, {"gap_offset": -0.05}, plane()),
    "offset in time": (False, {"gap_offset": [[0, 0], [1, -0.05]]}, plane()),
    "wear": (False, {"slide": 0.1, "wear": {"k": 1.0}}, plane()),
    "graph": (False, {"friction": COULOMB}, {"shape": "graph", "height": "0.05*x - 0.1"}),
    "graph that wears": (False, {"slide": 0.1, "wear": {"k": 1.0}}, {"shape": "graph", "height": "0.05*x"}),
}


@pytest.mark.parametrize("name", FORMS)
def test_forces_of_compliant_pressures_are_those_of_a_form_that_knows_the_gap(name: str) -> None:
    by_form, contact, obstacle = FORMS[name]
    base = {"surface": "block.bottom", "against": "floor", "normal": COMPLIANCE} | contact
    audit, _, record, _, scales = judged(
        scene_of(
            obstacles={"floor": obstacle | {"displacement": {"y": 0.03}}}, contacts={"base": base}, supports=DRAWN
        ),
        seed=1,
    )
    worn = np.linspace(0.0, 0.05, len(record.p))
    record = replace(record, memory={"base.worn": worn} if "slide" in contact else {})
    audit._set_system(audit.start, 1.0)
    (place,) = audit.cone.places
    rows, record.p[place.tangential] = place.rows, 0.0
    closing = rows.N_n @ (record.displacement[rows.input] - [0.0, 0.03]).ravel() - rows.gap
    closing -= worn if "slide" in contact else 0.0
    pressures = 40 * np.maximum(closing, 0.0) ** 1.5
    assert 0 < np.count_nonzero(pressures) < len(pressures)
    expected = audit.system.interface.force_of(rows, pressures, np.zeros(rows.free.shape)).array
    found = audit._contact_force(place, vector_of(audit, record), record, scales).array
    assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    assert (list(audit._j_n) == ["base"]) is by_form


LEANS = {side: plane() | {"point": [1.0, 0.0], "normal": [by, 1.0]} for side, by in (("left", 0.02), ("right", -0.02))}
PARTNERS = table({"friction": COULOMB, "against": ["left", "right"]}, obstacles=LEANS)


@pytest.mark.parametrize("name", ["between bodies", "between bodies, compliance", "partners"])
def test_forces_that_no_form_has_are_those_of_the_rows(name: str) -> None:
    simulation, random = (
        prepare(scene_of(**(PARTNERS if name == "partners" else SCENES[name]))),
        np.random.default_rng(1),
    )
    audit, u = Auditor(simulation.problem, simulation.mesh), random.normal(0.0, 0.1, simulation.data.points.shape)
    record = given(simulation, displacement=u, p=random.normal(0.02, 0.05, audit.cone.size))
    audit._set_system(audit.start, 1.0)
    for place in audit.cone.places:
        rows, p_n, t = place.rows, record.p[place.normal], record.p[place.tangential].reshape(-1, 1)
        if "compliance" in name:
            p_n = 40 * np.maximum(rows.N_n @ u[rows.input].ravel() - rows.gap, 0.0) ** 1.5
        scales = Scales(p=0.2, u={}, rounding=2e-4)
        found = audit._contact_force(place, vector_of(audit, record), record, scales).array
        expected = audit.system.interface.force_of(rows, p_n, t).array
        assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    assert not audit._multiplier_forces  # no form was asked


def test_points_that_were_not_paired_before_were_not_pressed() -> None:
    """Where pairs are found anew there are other rows: what slip counts from is known where nothing presses alone."""
    base = {"surface": "block.bottom", "against": "foundation", "friction": COULOMB, "sliding": True}
    audit, place, record, _, scales = judged(scene_of(contacts={"base": base}), seed=1)
    u = place.rows.N_t @ record.displacement[place.rows.input].ravel()
    pressed = place.rows.average @ record.p[place.normal] > 0
    assert 0 < np.count_nonzero(pressed) < len(pressed)
    assert audit._searched(place.rows, record)
    before = replace(record, p=np.append(np.abs(record.p) + 1.0, 0.0))
    for wrong, told in ((pressed, False), (~pressed, True)):
        reference = record.reference.copy()
        reference[place.tangential] = u + wrong
        found = audit._history(place, replace(record, reference=reference), before, scales)
        assert (found != [0.0]) is told


def test_what_points_remember_is_read_by_the_pairs_before(monkeypatch: pytest.MonkeyPatch) -> None:
    base = {"surface": "block.bottom", "against": "foundation", "friction": COULOMB}
    audit, place, record, _, _ = judged(scene_of(contacts={"base": base}), seed=1)

    def found(system: System, moved: Any) -> Any:
        return SimpleNamespace(contacts=(replace(place.rows, share_t=moved["base"] * place.rows.share_t),))

    monkeypatch.setattr(System, "searched", found)
    for searched, factor in (({}, 1.0), ({"base": 2.0}, 2.0)):
        before = replace(record, searched=searched, memory={"base": np.full(len(place.rows.W_t), 0.3)})
        assert_allclose(audit._carried(place.rows, before), factor * 0.3)


def test_springs_of_a_sliding_contact_turn_with_it(case_of: Callable[[str], Solved]) -> None:
    """What slip counts from belongs to other frames there: it is not compared; the slip itself is."""
    case = case_of("sliding springs")
    audit, (before, record) = case.auditor(), case.records[-2:]
    audit(record, before)
    (place,) = audit.cone.places
    assert len(audit._history(place, record, before, Scales(p=1.0, u={"base": 1.0}, rounding=0.0))) == 2


@pytest.mark.parametrize(("name", "powers"), [("springs", 1), ("revolved", 2)])
def test_motion_by_unit_traction_is_the_extent_of_what_is_closed_by_e(
    name: str, powers: int, case_of: Callable[[str], Solved]
) -> None:
    """At most the depth of the body, 1 m; E is 2 Pa."""
    audit = case_of(name).auditor()
    (rows,) = audit.start.contacts
    area = float(rows.W_n.sum())
    assert area == pytest.approx(2.0 if powers == 1 else np.pi * 2.0**2)
    p = np.zeros(len(rows.W_n))
    assert audit._give(rows, p) == 0.5  # all of it, deeper than the body
    small = np.argsort(rows.W_n)
    p[small[:2]] = 3.0, 1e-3
    p[small[2]] = 1e-12  # rounding
    give = float(rows.W_n[small[:2]].sum()) ** (1 / powers) / 2
    assert give < 0.5
    assert audit._give(rows, p) == pytest.approx(give)
    assert audit._give(rows, 1e-6 * p) == pytest.approx(give)
    p[:] = 1.0
    assert audit._give(rows, p) == 0.5


def test_where_nothing_is_closed_yet_all_of_a_narrow_body_gives() -> None:
    """Along the normals, 0.5 m by E_2."""
    wood = {"E_1": 1.0, "E_2": 0.4, "E_3": 0.4, "G_12": 0.3, "nu_12": 0.3, "nu_13": 0.2, "nu_23": 0.2, "axis_1": [1, 0]}
    audit, place, record, _, _ = judged(
        scene_of(2, {"length": 0.5}, bodies={"block": wood}, **flat(2, {"law": "unilateral"})), seed=1
    )
    for part in (1.0, 0.1):  # of the side
        rows = replace(place.rows, W_n=part * place.rows.W_n)
        assert audit._give(rows, 0 * record.p[place.normal]) == pytest.approx(part * 0.5 / 0.4)


def given(simulation: Simulation, **fields: Any) -> Record:
    """A record at t = 1 of nothing but these fields."""
    none = dict.fromkeys(("p", "w", "reference", "driven", "shortened"), np.zeros(0))
    displacement = np.zeros_like(simulation.data.points)
    return Record(**{"time": 1.0, "displacement": displacement, "searched": {}} | none | fields)


def vector_of(audit: Auditor, record: Record) -> Any:
    """The record's displacement in the order of the system."""
    u = audit.system.vector()
    u.array[:] = record.displacement[audit.system.nodes.input].ravel()
    return u


def judged(scene: Scene, seed: int) -> tuple[Auditor, Any, Record, Array, Scales]:
    """A contact, and tractions and motions that no solver has seen: open, pressed, sticking and slipping somewhere."""
    simulation = prepare(scene)
    audit, random = Auditor(simulation.problem, simulation.mesh), np.random.default_rng(seed)
    (place,) = audit.cone.places
    count = audit.cone.size
    p = random.normal(0.02, 0.05, count)
    p[place.normal][::4] = 0.0
    w = random.normal(0.0, 0.1, count)
    w[place.tangential][:4] *= 1e-3  # less than rounding, some of it
    displacement = random.normal(0.0, 0.1, (len(simulation.data.points), scene.dim))
    reference = random.normal(0.0, 0.1, count) * (np.arange(count) >= place.tangential.start + 4)
    record = given(simulation, displacement=displacement, p=p, w=w, reference=reference)
    return audit, place, record, w, Scales(p=0.2, u={"base": 0.3}, rounding=2e-4)


def flat(dim: int, normal: Mapping[str, Any], friction: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A block on a plane, 0.02 m into it."""
    drive = {"top": {"boundary": "block.top", "displacement": dict.fromkeys("xyz"[:dim], -0.1)}}
    base = {"surface": "block.bottom", "against": "foundation", "gap_offset": -0.02, "normal": normal}
    return {"contacts": {"base": base | ({"friction": friction} if friction else {})}, "supports": drive}


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("law", ["unilateral", "bilateral", "compliance"])
def test_normal_defects_are_those_of_the_definition(law: str, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(**flat(2, COMPLIANCE if law == "compliance" else {"law": law}))
    audit, place, record, w, scales = judged(scene, seed)
    scales = replace(scales, rest=5e-3)
    monkeypatch.setattr(type(place.rows.normal), "penetration", None)  # which the audit has for itself
    penetration, negative, complementarity = [0.0], [0.0], [0.0]
    u = record.displacement[place.rows.input].ravel()
    for p, w_n, of_u in zip(record.p[place.normal], w[place.normal], place.rows.N_n @ u, strict=True):
        into = w_n + 0.02
        into = np.sign(into) * max(abs(into) - 2e-4, 0.0)
        if law == "bilateral":
            penetration.append(abs(into) / 0.3)
            continue
        negative.append((-p - 5e-3) / 0.2)
        if law == "unilateral":
            penetration.append(into / 0.3)
            complementarity.append(min((p - 5e-3) / 0.2, -into / 0.3))
            continue
        by_pressure = (abs(p - 40 * max(of_u + 0.02, 0.0) ** 1.5) - 5e-3) / 0.2
        apart = max(abs(w_n + 0.02 - (max(p, 0.0) / 40) ** (1 / 1.5)) - 2e-4, 0.0)
        by_depth = apart / 0.3 if p > 0 or into > 0 else 0.0
        penetration.append(min(by_pressure, by_depth))
    exact = record.p.copy()  # but at one point
    exact[place.normal] = 40 * np.maximum(place.rows.N_n @ u + 0.02, 0.0) ** 1.5
    for point, expected in enumerate(penetration[1:]) if law == "compliance" else ():
        p = np.where(np.arange(len(exact)) == point, record.p, exact)
        found = audit._normal(place, replace(record, p=p), w, scales)
        assert found[0] == pytest.approx(max(expected, 0.0), rel=1e-9)
    found = audit._normal(place, record, w, scales)
    assert_allclose(found, [max(penetration), max(negative), max(complementarity)], rtol=1e-9)
    assert found[0] > 0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("law", ["coulomb", "coulomb, k_T", "stick"])
def test_tangential_defects_are_those_of_the_definition(law: str, seed: int) -> None:
    friction = {"law": "stick"} if law == "stick" else {"law": "coulomb", "mu": 0.4}
    k_T = 7.0 if "k_T" in law else np.inf
    tables = flat(3, {"law": "unilateral"}, friction | ({"k_T": 7.0} if "k_T" in law else {}))
    tables["supports"]["side"] = {"boundary": "block.left", "displacement": {"x": -0.1}}  # no slip along x there
    audit, place, record, w, scales = judged(scene_of(3, **tables), seed)
    rows, scales = place.rows, replace(scales, rest=5e-3)
    t = record.p[place.tangential].reshape(-1, 2)
    du = ((w - record.reference)[place.tangential].reshape(-1, 2) - t / k_T) * rows.free
    assert not rows.free.all()
    pressed = np.maximum(rows.average @ record.p[place.normal], 0.0)
    bounds = np.where(pressed > 0, np.inf, 0.0) if law == "stick" else 0.4 * pressed
    s_top = max(bounds[np.isfinite(bounds)].max(), module.FRICTION * 0.2)
    excess, slip_law, work, rest, some = [0.0], [0.0], 0.0, 0.0, s_top * 0.3 * float(rows.W_t.sum())
    for t_i, du_i, s, weight in zip(t, du, bounds, rows.W_t, strict=True):
        moved = du_i if np.hypot(*du_i) > 2e-4 else 0 * du_i

        def disc(x: Array, s: float = s) -> Array:
            return x if np.hypot(*x) <= s else x * s / np.hypot(*x)

        if np.isfinite(s):
            excess.append((np.hypot(*t_i) - s - 5e-3) / s_top)
        slip_law.append((np.hypot(*(disc(t_i) - disc(disc(t_i) + s_top / 0.3 * moved))) - 5e-3) / s_top)
        work += weight * float(t_i @ moved)
        rest += weight * 5e-3 * np.hypot(*moved)
        some += weight * max(np.hypot(*t_i), module.FRICTION * 0.2) * np.hypot(*moved)
    found = audit._tangential(place, record, w, scales)
    assert_allclose(found, [max(excess), max(slip_law), max(-work - rest, 0.0) / some], rtol=1e-9)
    back = replace(record, reference=2 * w - record.reference)  # slip along the traction where it was against it
    if k_T == np.inf:
        assert_allclose(audit._tangential(place, back, w, scales)[2], max(work - rest, 0.0) / some, rtol=1e-9)
    for point, expected in enumerate(slip_law[1:]):  # where one alone slips it is the largest
        still = w.copy()
        still[place.tangential] -= t.ravel() / k_T
        still[place.tangential].reshape(t.shape)[point] = record.reference[place.tangential].reshape(t.shape)[point]
        alone = audit._tangential(place, replace(record, reference=still), w, scales)
        assert alone[1] == pytest.approx(max(expected, 0.0), rel=1e-9)


@pytest.mark.parametrize("law", ["unilateral", "bilateral"])
def test_bounds_are_those_of_the_time_and_the_memory_of_a_step(law: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of a number that is reached at the end; mu falls by 0.2 a metre of slip."""
    falls = {"law": "slip_dependent", "mu": [[0, 0.4], [1, 0.2]]}
    for friction in ({"law": "tresca", "bound": 0.1}, falls):
        scene = scene_of(**flat(2, {"law": law}, friction), steps={"end": 2.0, "count": 2})
        audit, place, record, _, _ = judged(scene, seed=1)
        mean = place.rows.average @ record.p[place.normal]
        assert 0 < np.count_nonzero(mean > 0) < len(mean)
        slips = 0.5 * np.ones(len(mean))
        for memory, given, slip in (({}, None, 0.0), ({"base": slips}, None, 0.5), ({"base": 0 * slips}, slips, 0.5)):
            expected = (0.4 - 0.2 * slip) * np.maximum(mean, 0.0)
            if friction is not falls:
                expected = np.where((mean > 0) | (law == "bilateral"), 0.05, 0.0)
            for none in (False, True):
                with monkeypatch.context() as patch:
                    if none:
                        patch.setattr(module, "bound", lambda *given: None)
                    assert_allclose(audit._bound(place, replace(record, memory=memory), given), expected)


def test_orthotropic_bounds_are_those_along_the_tractions() -> None:
    """On an ellipse four times as long along x."""
    law = {"law": "orthotropic_coulomb", "mu_1": 0.4, "mu_2": 0.1, "axis": [1.0, 0.0, 0.0]}
    audit, place, record, _, _ = judged(scene_of(3, **flat(3, {"law": "unilateral"}, law)), seed=1)
    along, across = record.p[place.tangential].reshape(-1, 2).T
    mean = np.maximum(place.rows.average @ record.p[place.normal], 0.0)
    expected = 0.4 * mean * np.hypot(along, 0.25 * across) / np.hypot(along, across)
    assert_allclose(audit._along_traction(place, record), expected)


def test_rounding_of_tractions_wastes_no_work_however_far_an_unloaded_contact_moves() -> None:
    audit, place, record, w, scales = judged(
        scene_of(**flat(2, {"law": "unilateral"}, {"law": "coulomb", "mu": 0.4})), seed=1
    )
    far = record.reference - 1e6 * scales.u["base"]
    p = np.where(np.arange(len(w)) < place.normal.stop, 0.0, module.FRICTION * scales.p)
    for traction, wasted in ((1e-6 * p, 1e-6), (p, 1.0)):
        found = audit._tangential(place, replace(record, p=traction), far, scales)[2]
        assert found == pytest.approx(wasted, rel=0.01)
    least = replace(scales, p=1e-200, u={"base": 1e-200})  # whose product is below the smallest number
    assert audit._tangential(place, replace(record, p=0 * p, reference=w), w, least) == (0.0, 0.0, 0.0)


def test_scales_are_those_of_the_largest_tractions() -> None:
    scene = scene_of(**flat(2, COMPLIANCE, SPRINGS), bodies={"block": {"E": 2.0, "nu": 0.3}})
    audit, place, record, _, _ = judged(scene, seed=1)
    u = audit.system.vector()
    largest = float(np.abs(record.p).max())
    tiny = replace(record, p=1e-5 * record.p)
    for each, p_top in ((tiny, 1e-5 * largest), (record, largest), (tiny, SLIGHT * largest)):
        scales = audit._scales(each, audit._inner(u))
        assert scales.p == pytest.approx(p_top)
        give = audit._give(place.rows, each.p[place.normal])
        assert scales.u["base"] == pytest.approx(p_top * (give + 1 / 7.0) + (p_top / 40.0) ** (1 / 1.5))
    nothing = replace(record, p=0 * record.p, displacement=0 * record.displacement, time=0.0)
    fresh = Auditor(audit.system.problem, audit.system.mesh)
    assert fresh._scales(nothing, fresh._inner(u)).p == 1.0


@pytest.mark.parametrize("stiffness", [0.0, 40.0, 4e8])
@pytest.mark.parametrize("load", [0.0, 0.5])
def test_levels_of_rounding_are_those_of_the_definition(
    load: float, stiffness: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a floor that moves by 5 m, and a side of 2 m."""
    law = {"law": "compliance", "c_n": stiffness, "m_n": 1.0} if stiffness else {"law": "unilateral"}
    push = {"push": {"boundary": "block.right", "pressure": load}} if load else {}
    floor = {"foundation": plane() | {"displacement": {"y": 5.0}}}
    audit, place, record, _, _ = judged(scene_of(**flat(2, law) | {"obstacles": floor}, loads=push), seed=1)
    monkeypatch.setattr(Unilateral, "penetration", None)  # which the audit has for itself
    stiff = stiffness * float(place.rows.W_n[record.p[place.normal] > 0].sum())
    for far in (1e-3, 1.0):
        now = replace(record, displacement=far * record.displacement, time=far)
        u, floor_moved = now.displacement, [0.0, 5.0 * far]
        motion = max(np.abs(u).max(), np.abs(u[place.rows.input] - floor_moved).max())
        assert motion > np.abs(u).max()
        inner, forces, extent = audit._inner(vector_of(audit, now)), audit.system.load(far), audit.system.extent
        digit, allowed = EPS * audit._largest_stiffness * motion / 2.0, 1e3 * EPS * stiff * motion / 2.0
        found = audit._scales(now, inner)
        rest = 0.0 if load or motion > extent else min(1e3 * digit + allowed, ROUNDING / EPS * digit)
        assert found.rest == pytest.approx(rest, rel=1e-9, abs=0)
        sizes = np.abs(inner.array).sum() + np.abs(forces.array).sum()
        assert found.noise == pytest.approx(ROUNDING * sizes / 2.0 + digit, rel=1e-9, abs=0)
        assert (found.area, found.rounding) == pytest.approx((2.0, LAST_DIGITS * max(extent, motion)), rel=EXACT, abs=0)
        give = found.p * audit._give(place.rows, now.p[place.normal])
        assert found.u["base"] == pytest.approx(give + (found.p / stiffness if stiffness else 0.0))


def test_tractions_are_no_smaller_than_rounding_of_all_forces() -> None:
    push = {"loads": {"push": {"boundary": "block.right", "pressure": 0.5}}}
    audit, place, record, _, _ = judged(scene_of(**flat(2, {"law": "unilateral"}), **push), seed=1)
    u = vector_of(audit, record)
    inner, load = audit._inner(u), audit.system.load(1.0)
    noise = ROUNDING * (np.abs(inner.array).sum() + np.abs(load.array).sum())  # on a side of 2 m
    noise += module.EPS * audit._largest_stiffness * np.abs([*u.array, *audit._motion(place.rows, record).flat]).max()
    assert audit._scales(replace(record, p=0 * record.p), inner).p == pytest.approx(noise / 2.0, rel=1e-9, abs=0)


def test_stiffness_of_laws_is_that_of_springs_alone() -> None:
    for law in ("unilateral", "compliance"):
        scene = scene_of(**flat(2, COMPLIANCE if law == "compliance" else {"law": law}))
        _, place, record, _, _ = judged(scene, seed=1)
        p = record.p[place.normal]
        slope = 40 * 1.5 * np.maximum(p / 40, 0.0) ** (0.5 / 1.5)  # of c d^m at p
        assert (p > 0).any()
        expected = float(place.rows.W_n @ slope) if law == "compliance" else 0.0
        assert module._law_stiffness(place, record.p) == pytest.approx(expected)


def test_equilibrium_is_relative_to_the_sum_of_all_forces() -> None:
    """Those within bodies, of loads, of contact, and on the obstacle that a force drives."""
    driven = plane() | {"force": {"y": 5.0}}
    push = {"loads": {"push": {"boundary": "block.right", "pressure": 0.5}}, "obstacles": {"foundation": driven}}
    scene = scene_of(**flat(2, {"law": "unilateral"}, SPRINGS), **push)
    audit, place, record, _, scales = judged(scene, seed=1)
    record = replace(record, driven=np.zeros(1))
    system, u = audit.system, vector_of(audit, record)
    inner, load, contact = audit._inner(u), system.load(1.0), audit._contact_force(place, u, record, scales)
    free = system.T.createVecRight()
    system.T.multTranspose(inner - load + contact, free)
    on_obstacle = system.interface.resultant_on_driven(place.rows, contact) + system.obstacles.driving_force(1.0)
    scale = sum(np.abs(v.array).sum() for v in (inner, load, contact)) + 5.0
    found, rounding = audit._equilibrium(record, u, inner, scales)
    assert found == pytest.approx((np.abs(free.array).sum() + np.abs(on_obstacle).sum()) / scale, rel=1e-12)
    system.T.multTranspose(audit._inner(u * audit._signs), free)
    assert rounding == pytest.approx(module.EPS * np.abs(free.array).sum() / scale, rel=0.5, abs=0)  # of last digits


@pytest.mark.parametrize(
    ("obstacle", "size"),
    [
        ({"shape": "plane", "point": [0.3, 0.0], "normal": [0.0, 1.0]}, 0.0),  # on which all coordinates are 0
        ({"shape": "plane", "point": [0.0, -0.5], "normal": [0.0, 1.0]}, 0.5),
        ({"shape": "cylinder", "point": [0.0, -9.0], "radius": 9.0}, 2.0),  # that of the scene
    ],
)
def test_the_last_digit_of_gaps_counts_by_the_stiffness_of_the_law(obstacle: dict[str, Any], size: float) -> None:
    scene = scene_of(**flat(2, {"law": "compliance", "c_n": 4e8}), obstacles={"foundation": obstacle})
    audit, place, record, _, scales = judged(scene, seed=1)
    record = replace(record, p=np.abs(record.p) + 0.01)
    u = vector_of(audit, record)
    inner, contact = audit._inner(u), audit._contact_force(place, u, record, scales)
    scale = inner.norm(0) + audit.system.load(1.0).norm(0) + contact.norm(0)
    _, rounding = audit._equilibrium(record, u, inner, scales)
    size += np.abs(record.w).max()
    assert rounding == pytest.approx(module.EPS * size * 4e8 * 2.0 / scale, rel=1e-3, abs=0)  # on a side of 2 m


SUPPORTS: dict[str, dict[str, Any]] = {
    "axes": {"supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.05, "y": -0.1}}}},
    "normal": {
        "supports": {
            "top": {"boundary": "block.top", "displacement": {"normal": -0.1}},
            "side": {"boundary": "block.left", "displacement": {"x": 0.05}},
        }
    },
    "revolved": {
        "supports": {"top": {"boundary": "block.top", "displacement": {"y": -0.1}}}, "model": "axisymmetric",
    },
    "periodic": {
        "supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.05, "y": -0.1}}},
        "periodic": {"x": {"boundary": "block.right", "with": "block.left"}},
    },
}  # fmt: skip


@pytest.mark.parametrize("name", SUPPORTS)
def test_what_is_prescribed_is_missed_relative_to_the_largest_motion(name: str) -> None:
    simulation = prepare(scene_of(**SUPPORTS[name]))
    audit, points = Auditor(simulation.problem, simulation.mesh), simulation.data.points
    moved = np.tile([0.0 if name == "revolved" else 0.05, -0.1], (len(points), 1))

    def supports(displacement: Array, time: float = 1.0) -> float:
        record = given(simulation, time=time, displacement=displacement)
        return audit._supports(record, vector_of(audit, record))

    assert supports(moved) < 1e-15
    assert supports(0 * moved, time=0.0) == 0.0
    at = {"revolved": points[:, 0] < 1e-9, "periodic": points[:, 0] > 2 - 1e-9}.get(name, points[:, 1] > 1 - 1e-9)
    axis, by = (0, 0.02) if name in ("revolved", "periodic") else (1, -0.02)
    chosen = np.flatnonzero(at & (points[:, 1] > 0.2) & ((points[:, 1] < 0.9) | (axis == 1)))[:2]
    assert len(chosen) == 2
    moved[chosen, axis] += by
    off = 0.01 if name == "periodic" else 0.02  # from the mean of both sides
    assert supports(moved) == pytest.approx(off / np.abs(moved).max(), rel=1e-9)


def test_stored_fields_are_right_up_to_rounding_of_lengths(case_of: Callable[[str], Solved]) -> None:
    case = case_of("springs")
    audit, (before, record) = case.auditor(), case.records[-2:]
    audit(record, before)
    scales = Scales(p=1.0, u={"base": 1.0}, rounding=1e-3)
    contact = {key: np.copy(value) for key, value in record.stored.contacts["base"].items()}
    for by, seen in ((0.5e-3, False), (3e-3, True)):
        for wrong in (
            replace(record, w=record.w + by),
            replace(record, stored=replace(record.stored, contacts={"base": contact | {"slip": contact["slip"] + by}})),
        ):
            for earlier in (None, before):
                assert (audit._fields(wrong, earlier, record.w, scales) > 1e-6) is seen


@pytest.mark.parametrize("law_error", [0.0, 1e-3])
def test_stored_fields_are_held_against_those_of_the_record_by_the_scales_of_the_step(
    law_error: float, case_of: Callable[[str], Solved], monkeypatch: pytest.MonkeyPatch
) -> None:
    case = case_of("springs")
    audit, given = case.auditor(), list[tuple[Any, ...]]()
    record = replace(case.records[-1], stored=replace(case.records[-1].stored, law_error=law_error))
    audit(record)
    (place,) = audit.cone.places
    rows, t = place.rows, record.p[place.tangential].reshape(-1, 1)
    monkeypatch.setattr(module, "contact_differences", lambda *every: given.append(every) or iter([0.25]))
    for noise, rest in ((1e-4, 2e-4), (3e-4, 2e-4)):
        scales = Scales(p=0.3, u={"base": 0.2}, rounding=1e-3, noise=noise, rest=rest)
        assert audit._fields(record, None, record.w, scales) == 0.25
        bound = 0.3 * np.maximum(rows.average @ record.p[place.normal], 0.0)
        moved = record.displacement[rows.input]
        known = record.p[place.normal], t, bound, rows.node_gap, moved, 0.3, 0.2, 1e-3, max(noise, rest)
        assert given[-1][0].name == "base"
        assert given[-1][1] is record.stored.contacts["base"]
        for found, expected in zip(given[-1][2:-1], known, strict=True):
            assert_allclose(found, expected, atol=1e-12)
        assert given[-1][-1] is (law_error == 0)


GAPS: dict[str, dict[str, Any]] = {
    "in time": table({"gap_offset": [[0, 0], [2, -0.04]]}),
    "by place": table({"gap_offset": "0.01*x"}, geometry={"order": 2}),
    "compliance": table({"normal": COMPLIANCE, "gap_offset": "0.01*x"}, geometry={"order": 2}),
    "tied": table({"normal": {"law": "tied"}}, SCENES["tied"]["obstacles"]["hill"]),
    "sliding": table({"sliding": True}),
    "sliding compliance": table({"normal": COMPLIANCE, "sliding": True}),
    "graph": table({}, {"shape": "graph", "height": "-0.1*x**2"}),
    "between bodies": SCENES["between bodies"],
}


@pytest.mark.parametrize("name", GAPS)
def test_gaps_of_known_obstacles_are_not_the_rows_own_and_agree_with_them(name: str) -> None:
    audit, place, record, _, _ = judged(scene_of(**GAPS[name]), seed=1)
    x = place.rows.surface.points
    searched = {"base": 0.02 * np.sin([3, 5] * x)} if "sliding" in name else {}
    audit._set_system(audit.start.searched(searched) if searched else audit.start, 1.0)
    (place,) = audit.cone.places
    rows, record = place.rows, replace(record, searched=searched)
    known = name not in ("graph", "between bodies")
    blind = replace(rows, gap=np.nan * rows.gap, node_gap=np.nan * rows.node_gap) if known else rows
    for found, own in zip(audit._gap(blind, record), (rows.gap, rows.node_gap), strict=True):
        assert_allclose(found, own, atol=1e-12)
        assert found.shape == own.shape
    worn = np.linspace(0.1, 0.2, len(rows.gap))
    found_worn = audit._gap(rows, replace(record, memory={"base.worn": worn}))
    assert_allclose(found_worn[0] - rows.gap, worn)
    assert_allclose(found_worn[1] - rows.node_gap, rows.node_pressure(worn))


MOVED = {"displacement": {"x": 0.01, "y": 0.02}}
MOMENTS: dict[str, dict[str, Any]] = {
    "hill": table({"friction": SPRINGS, "gap_offset": [[0, 0], [2, -0.02]]}, HILL | MOVED),
    "hill that wears": table({"slide": 0.1, "wear": {"k": 1.0}}, HILL | MOVED),
    "between bodies": SCENES["between bodies"],
    "roles exchanged": SCENES["between bodies"]
    | {"bodies": {"upper": {"E": 50.0, "nu": 0.3}, "lower": {"E": 1.0, "nu": 0.2}}},
    "revolved": SCENES["revolved"],
    "tied": SCENES["tied"],
    "gap that is given": TWO | {"contacts": {"base": JOINT | {"gap": 0.0}}},
}


@pytest.mark.parametrize("name", MOMENTS)
def test_a_moment_is_that_of_the_forces_on_the_other_side_up_to_slips_and_gaps(name: str) -> None:
    audit, _, record, _, _ = judged(scene_of(**MOMENTS[name]), seed=1)
    audit._set_system(audit.start, 1.0)
    (place,) = audit.cone.places
    rows, none = place.rows, np.zeros(0)
    worn = np.linspace(0.0, 0.05, len(rows.W_n))
    record = replace(record, p=record.p + 0.05, memory={"base.worn": worn} if "wears" in name else {})
    if rows.friction is None or not rows.normal.ties:
        record.p[place.normal][: len(rows.W_n) // 2] = record.p[place.tangential][: len(rows.W_t) // 2] = 0.0
    shift = np.array([0.01, 0.02]) if "hill" in name else np.zeros(2)
    u = record.displacement[rows.input]
    forces = rows.nodal_forces(record.p[place.normal], record.p[place.tangential].reshape(-1, 1))
    acts = module.acting(audit.system, rows, forces, u, {}, (1.0, none))
    size, apart = np.linalg.norm(acts.forces, axis=1), np.zeros_like(acts.points)
    assert 0 < np.count_nonzero(size) < len(size) or name == "tied"
    if "hill" in name:
        arm = acts.points - shift - [0.8, -4.05]
        far = np.linalg.norm(arm, axis=1)[:, None]
        apart = np.where(size[:, None] > 0, (far - 4.0) * arm / far, 0.0)
    elif rows.master is not None:
        apart = rows.relative @ (rows.points + u)
    x, f = acts.points - apart, acts.forces + acts.turned
    other = rows.sense * float(np.sum(x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0]))
    assert rows.sense == (-1 if name == "roles exchanged" else 1)
    n = rows.frames[:, 0]
    open_now = rows.node_gap + rows.node_pressure(worn * ("wears" in name)) - rows.node_motion(u - shift)[0]
    along = np.einsum("nd,nd->n", apart, n)[:, None] * n
    allowed = np.linalg.norm(apart - along, axis=1) + np.abs(open_now) + (0.01 if "hill" in name else 0.0)
    allowed += rows.node_pressure(worn) if "wears" in name else 0.0

    def found(told: float, **changed: Any) -> float:
        stored = StoredFields(moments={"base": np.array([told])})
        return audit._moment(place, replace(record, stored=stored) if not changed else replace(record, **changed))

    whole, least = float(size.sum()) * audit.system.extent, float(size @ allowed)
    if name == "revolved":
        assert found(-3.0) == pytest.approx(3.0 / whole)
        return
    judged_at_all = not (name == "tied" or "given" in name)
    for by in (3 * least, -2 * least):
        assert found(other + by) == pytest.approx((abs(by) - least) / whole if judged_at_all else 0.0, rel=1e-9)
    assert found(other) == 0.0
    assert found(0.0, stored=StoredFields()) == 0.0
    silent = replace(record, p=0 * record.p, stored=StoredFields(moments={"base": np.array([1.0])}))
    assert audit._moment(place, silent) == 0.0


SEEN: dict[str, tuple[int, dict[str, Any]]] = {
    "springs": (3, {"friction": SPRINGS}),
    "compliance": (3, {"normal": COMPLIANCE}),
    "wear": (2, WORN),
    "state": (2, {"friction": STATE}),
}


@pytest.mark.parametrize("name", SEEN)
def test_what_is_seen_of_a_contact_is_that_of_the_definition(name: str) -> None:
    dim, contact = SEEN[name]
    base, top = {"surface": "block.bottom", "against": "foundation"} | contact, dict.fromkeys("xyz"[:dim], 0.0)
    tables = {
        "supports": {"top": {"boundary": "block.top", "displacement": top}},
        "steps": {"end": 2.0, "seconds": True},
    }
    audit, _, record, w, _ = judged(scene_of(dim, {"mesh_size": 1.0}, contacts={"base": base}, **tables), seed=2)
    audit._set_system(audit.start, 1.0)
    (place,) = audit.cone.places
    rows, law, u = place.rows, place.rows.friction, record.displacement[place.rows.input].ravel()
    nodes, points, worn = np.arange(len(rows.node_gap)), len(rows.W_t), np.full(len(rows.W_n), 0.1)
    shown = {"pressure": 2.0 + nodes, "status": np.array([OPEN, SLIP, STICK, SLIP, STICK, STICK])[nodes % 6]}
    counts = {
        word: int(np.sum(shown["status"] == kind)) for word, kind in zip(STATUS_WORDS, (OPEN, SLIP, STICK), strict=True)
    }
    told = {"substeps": 1, "contacts": {"base": {"dissipation": 2.0, "dissipation_total": 7.0, "statuses": counts}}}
    told_before = {"contacts": {"base": {"dissipation_total": 3.0}}}
    both = np.linspace(0.1, 0.9, 2 * points).reshape(points, 2)
    memory = {"wear": {"base": both[:, 0], "base.worn": worn}, "state": {"base": both}}.get(name, {})
    record = replace(record, memory=memory)
    audit._before = replace(record, time=0.75, memory={"base.worn": worn / 2})

    def seen(*, before: Mapping[str, Any] = told_before, **more: Any) -> Any:
        stored = StoredFields(contacts={"base": shown}, told=told | more, told_before=before)
        return audit._contact(place, replace(record, stored=stored), w)

    found, t = seen(), record.p[place.tangential].reshape(rows.free.shape)
    pressures = 40 * np.maximum(rows.N_n @ u - rows.gap, 0.0) ** 1.5
    assert_allclose(found.peaks, pressures if name == "compliance" else shown["pressure"], atol=1e-12)
    assert_allclose(found.closing, w[place.normal] - rows.gap - (0.1 if name == "wear" else 0.0), atol=1e-12)
    assert_allclose(found.normal_weight, rows.W_n)
    assert_allclose(found.wear, worn if name == "wear" else [])
    assert_allclose(found.rates, {"wear": both[:, 0], "state": both[:, 1]}.get(name, []))
    Dc = 0.02 + 0.01 * rows.surface.points[:, 0]
    assert_allclose(found.ages, Dc * np.exp(both[:, 0]) / 0.01 if name == "state" else [])
    slid = (w - record.reference)[place.tangential].reshape(t.shape) - t / ((law and law.k_T) or np.inf)
    work = float(rows.W_t @ (t * slid).sum(axis=1)) + (audit._beside(place, record) or 0.0)
    assert (found.dissipation, found.dissipation_total, found.wrong) == (pytest.approx(work), 5.0, 0.0)
    assert seen(before={}).dissipation_total == 2.0
    assert not audit._unseen
    assert seen(substeps=2).dissipation == 4.0  # the parts are not known
    assert audit._unseen == {f"contacts.base.dissipation: {module.UNFOLLOWED}"}
    audit._before = None
    assert seen().dissipation == (4.0 if name == "wear" else pytest.approx(work))
    counts["open"] += 1
    assert seen().wrong == 1.0


def test_bolts_are_off_by_what_their_tension_lacks() -> None:
    """Springs of one way by the smaller one of their force and what their slack would take; those that are held not."""
    values, work = np.array([0.2, 0.3, 0.4, 0.5]), np.array([-3.0, 0.5, -7.0, -8.0])
    course = SimpleNamespace(value=lambda tension, time: {"given": 2.0, "later": 6.0}[tension] + time)
    bolts = [("given", 2.0, 0.0), (None, np.inf, -0.6), ("later", 1.0, 0.0), (None, np.inf, 0.7)]
    tightened = tuple(
        SimpleNamespace(index=index, tension=tension, held_from=held_from, gap=gap, shortening=f"of {index}")
        for index, (tension, held_from, gap) in enumerate(bolts)
    )
    initial = SimpleNamespace(
        tightened=tightened,
        coupling=np.diag([10.0, 20.0, 30.0, 4.0]) + 1.0 - np.eye(4),
        values=lambda of, time: values if (of, time) == (course, 1.5) else None,
        stress_work=lambda given, u: work if (given is values, u) == (True, "u") else None,
    )
    system: Any = SimpleNamespace(course=course, initial=initial)
    u: Any = "u"
    assert_allclose(module.tension_off(system, u, 1.5), [3.0 - 3.5, 20 * (0.3 - 0.6), min(8.0, 4 * (0.5 + 0.7))])
    values, work = values + 0.0, work * [1.0, 1.0, 1.0, 0.1]
    assert_allclose(module.tension_off(system, u, 1.5)[2], 0.8)
    initial.tightened = tightened[2:3]
    assert module.tension_off(system, u, 1.5).tolist() == []
    initial.values = lambda of, time: values
    assert_allclose(module.tension_off(system, u, 1.0), [7.0 - 7.0])  # held from then on
    initial.tightened = tightened
    module.recall(system, 1.5, np.array([1.0, 2.0, 3.0, 4.0]))
    assert course.found == {f"of {k}": ((1.5, k + 1.0),) for k in range(4)}


@pytest.mark.parametrize("many", [0.0, 100.0])  # times w, stress and what of tractions is rounding of the motions
def test_numbers_are_relative_to_the_largest_of_their_unit(
    many: float, case_of: Callable[[str], Solved], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A number that is off is said in the log, one that nothing shows is named."""
    case = case_of("springs")
    audit, record = case.auditor(), case.records[-1]
    scales = Scales(p=0.3, u={"base": 0.1}, rounding=2e-4, noise=1e-5, rest=1e-6 * many, area=3.0)
    given = dict[str, Mapping[str, float]]()

    def differences(stored: Any, seen: Any, sizes: Any, rounding: Any) -> dict[str, float | None]:
        given.update(sizes=sizes, rounding=rounding, energy=vars(seen["energy"][""]))
        return {"right": 0.0, "unseen": None, "off": 0.25}

    monkeypatch.setattr(audit, "_scales", lambda record, inner: scales)
    monkeypatch.setattr(audit._second, "differences", differences)
    stored = replace(record.stored, stress=many * record.stored.stress)
    with caplog.at_level("DEBUG", module.log.name):
        assert audit(replace(record, stored=stored, w=many * record.w)).numbers == 0.25
    assert caplog.messages == ["t = 2: {'off': 0.25}"]
    monkeypatch.setattr(audit._second, "differences", lambda *given: {"later": None})
    last = audit._last
    audit(record)
    assert [name for name in audit.shared if name.endswith(": number")] == ["later: number", "unseen: number"]
    force, length = last.size, 2.0
    motion = max(np.abs(record.displacement).max(), np.abs(many * record.w).max())
    least = 1e3 * EPS * audit._largest_stiffness * np.abs(vector_of(audit, record).array).sum()
    least += max(1e-5, 1e-6 * many) * 3.0
    sizes = {"N": force, "N m": force * length, "J": force * motion, "m": motion, "rad": motion / length, "m²": 3.0}
    assert given["sizes"] == pytest.approx(sizes | {"Pa": max(0.3, np.abs(stored.stress).max())})
    rounding = {"N": least, "N m": least * length, "J": least * motion, "m": 2e-4, "rad": 2e-4 / length}
    assert given["rounding"] == pytest.approx(rounding | {"Pa": max(1e-5, 1e-6 * many) + least / 3.0}, abs=0)
    for before, said in ((None, [f"energy.contact: {module.UNFOLLOWED}"]), (case.records[-2], [])):
        fresh = case.auditor()
        monkeypatch.setattr(fresh._second, "differences", differences)
        monkeypatch.setattr(fresh, "_terms", {"load": 0.5, "other load": None})
        assert fresh(record, before).numbers == 0.5
        keys = ("external", "stored", "contact", "compliance", "dissipated", "time_remainder")
        told = {key: record.stored.told["energy"][key] for key in keys}
        assert given["energy"] == pytest.approx(told, rel=1e-6)
        assert [name for name in fresh.shared if name.startswith("energy")] == said
    assert min(abs(told[key]) for key in keys[:-1]) > 1e-6


@pytest.mark.parametrize(("part", "judged_at_all"), [(0.8, False), (1.25, True)])
def test_forces_of_a_body_that_moves_as_a_whole_are_rounding_up_to_a_limit(part: float, judged_at_all: bool) -> None:
    """Of all |u| together, times the largest stiffness."""
    block = {"block": {"E": 3.0, "nu": 0.3}}
    audit, _, record, _, scales = judged(scene_of(**flat(2, {"law": "unilateral"}), bodies=block), 1)
    still = replace(record, time=0.0, p=0 * record.p)
    u, one = audit.system.vector(), audit.system.vector()
    one.array[len(one.array) // 2] = 1.0
    u.set(0.3)
    limit = module.SUMMED * EPS * audit._largest_stiffness * float(np.abs(u.array).sum())
    u += one * (part * limit / audit._inner(one).norm(0))
    found = audit._equilibrium(still, u, audit._inner(u), scales)
    assert (found != (0.0, 0.0)) is judged_at_all


PULL = 1e-6  # Pa, 1e5 times that rounding: it is noticed
WALL = {"wall": {"boundary": "block.right", "displacement": {"x": 0.0}}}
SLOPES = {
    "normal": {"law": "compliance", "c_n": 1e9, "m_n": 1.0},
    "friction": {"law": "coulomb", "mu": 0.3, "k_T": 1e8},
}
WITHOUT_WEIGHT: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {  # the contact, and what is held
    "compliant, square": ({"normal": SLOPES["normal"] | {"m_n": 2.0}, "friction": COULOMB}, WALL),
    "compliant": ({"normal": SLOPES["normal"], "friction": COULOMB | {"mu": 0.3}}, {}),
    "compliant, springs": (SLOPES, {}),
    "unilateral": ({"friction": COULOMB}, {}),
    "bilateral, springs": ({"normal": {"law": "bilateral"}, "friction": SLOPES["friction"]}, WALL),
}


FLOOR = plane()
HILLTOP = {"shape": "cylinder", "point": [1.0, -5.0], "radius": 5.0}
ASIDE, DOWN_UP = [[0.0, 0.0], [2.0, 0.01]], [[0.0, 0.0], [1.0, -0.01], [2.0, 0.01]]
MOVING = [
    *((name, FLOOR | {"displacement": motion}) for name in WITHOUT_WEIGHT for motion in ({"x": ASIDE}, {"y": DOWN_UP})),
    ("compliant, square", HILLTOP | {"displacement": {"x": ASIDE}}),  # it leaves the one point that touches
]


@pytest.mark.parametrize(("name", "floor"), MOVING)
def test_what_rests_without_weight_on_a_floor_that_moves_is_clean(name: str, floor: dict[str, Any]) -> None:
    """All that is found are tractions of 1e-11 Pa: rounding, however they are related to each other."""
    contact, supports = WITHOUT_WEIGHT[name]
    scene = scene_of(
        bodies={"block": {"E": 1e7, "nu": 0.3}},
        obstacles={"floor": floor},
        contacts={"base": {"surface": "block.bottom", "against": "floor", **contact}},
        supports=supports,
        steps={"end": 2.0, "count": 2},
        geometry={"cells": "tensor", "mesh_size": 0.5},
    )
    simulation = prepare(scene)
    audit, steps = Auditor(simulation.problem, simulation.mesh), [*simulation.steps()]
    assert [step.substeps for step in steps] == [1, 1]
    for step in steps:
        record = record_of(step)
        assert max(asdict(audit(replace(record, stored=stored_by(step)))).values()) < CLEAN
        assert np.abs(record.displacement).max() < 0.011  # it goes no farther than the floor
        assert audit(replace(record, p=record.p - PULL)).negative_pressure > 0.9 or name.startswith("bilateral")
