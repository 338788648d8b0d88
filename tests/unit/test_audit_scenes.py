"""The audit of contacts with everything: gaps that vary, tangential springs, sliding, compliance, laws of one's own."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import record_of, stored_by
from stickslip.geometry.arrays import EPS, ROUNDING, SLIGHT, Array
from stickslip.solvers.laws.compliance import Compliance
from stickslip.solvers.laws.friction import Coulomb, Tresca
from stickslip.solvers.results import audit as module
from stickslip.solvers.results.audit import Audit, Auditor, Record, Scales
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
CLEAN = 1e-8  # solver.tolerance is 1e-10
PLAINLY = 1e-4  # what is changed by 1 % or more
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
    "sliding": table({"friction": {"law": "coulomb", "mu": 0.3}, "sliding": True}),
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
class Case:
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
def case_of(scene_of: SceneOf, simulation_of: SimulationOf) -> Callable[[str], Case]:
    """A block with E = 2 Pa, pressed onto a hill and drawn across it."""
    known: dict[str, Case] = {}

    def make(name: str) -> Case:
        if name not in known:
            tables = {"bodies": {"block": {"E": 2.0, "nu": 0.3}}, "steps": {"end": 2.0, "count": 4}}
            tables |= {"solver": {"tolerance": 1e-10}}
            simulation = simulation_of(scene_of(3 if "in 3D" in name else 2, **tables | SCENES[name]))
            steps = tuple(simulation.steps())
            records = tuple(replace(record_of(step), stored=stored_by(step)) for step in steps)
            known[name] = Case(simulation, steps, records)
        return known[name]

    return make


@pytest.mark.parametrize("name", SCENES)
def test_accepted_steps_are_clean(name: str, case_of: Callable[[str], Case]) -> None:
    case = case_of(name)
    for found in case.audits():
        assert max(found.values()) < CLEAN, found
    assert all(step.substeps == 1 for step in case.steps)  # so that slip is followed from step to step
    assert max(step.contacts["base"].normal_force for step in case.steps) > 0.01


@pytest.mark.parametrize("name", ["overhang", "overhang in 3D"])
def test_nodes_partly_beyond_the_other_side_slip_like_the_rest(name: str, case_of: Callable[[str], Case]) -> None:
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
    name: str, case_of: Callable[[str], Case], monkeypatch: pytest.MonkeyPatch
) -> None:
    case = case_of(name)

    def asked(self: Any, *given: Any) -> Array:
        raise AssertionError(f"the solver's own formula of {self.law}")

    # a compliance's stiffness, which its own penetration serves, decides what rounding is, and no more
    forbidden = [(Compliance, "pressure"), (Coulomb, "limit"), (Tresca, "limit")]
    for law, formula in forbidden:
        monkeypatch.setattr(law, formula, asked)
    for found in case.audits():
        assert max(found.values()) < CLEAN


@pytest.mark.parametrize("name", ["compliance", "sliding compliance", "sliding springs", "revolved"])
def test_laws_and_obstacles_without_a_second_formula_are_audited_by_the_first(
    name: str, case_of: Callable[[str], Case], monkeypatch: pytest.MonkeyPatch
) -> None:
    for formula in ("gap", "bound", "penetration", "pressure"):
        monkeypatch.setattr(module, formula, lambda *given: None)
    for found in case_of(name).audits():
        assert max(found.values()) < CLEAN


@pytest.mark.parametrize("name", ["springs", "sliding"])
def test_what_slip_counts_from_is_that_of_the_step_before(name: str, case_of: Callable[[str], Case]) -> None:
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


def test_springs_of_a_sliding_contact_turn_with_it(case_of: Callable[[str], Case]) -> None:
    """What slip counts from belongs to other frames there: it is not compared; the slip itself is."""
    case = case_of("sliding springs")
    audit, (before, record) = case.auditor(), case.records[-2:]
    audit(record, before)
    (place,) = audit.cone.places
    assert len(audit._history(place, record, before, Scales(p=1.0, u={"base": 1.0}, rounding=0.0))) == 2


@pytest.mark.parametrize(("name", "powers"), [("springs", 1), ("revolved", 2)])
def test_motion_by_unit_traction_is_the_extent_of_what_is_closed_by_e(
    name: str, powers: int, case_of: Callable[[str], Case]
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


def test_forces_between_bodies_are_those_of_the_displacement(case_of: Callable[[str], Case]) -> None:
    """Compliant pressures are held against their law; equilibrium takes those that the law gives."""
    case = case_of("between bodies, compliance")
    audit, record = case.auditor(), case.records[-1]
    p = record.p.copy()
    p[audit.cone.places[0].normal] *= 0.9
    found = audit(replace(record, p=p))
    assert found.equilibrium < CLEAN
    assert found.penetration > PLAINLY


def test_the_worst_of_several_audits_is_taken_for_each_defect(case_of: Callable[[str], Case]) -> None:
    audit, record = case_of("springs").auditor(), case_of("springs").records[-1]
    one = audit(record)
    other = replace(one, cone=2.0, supports=0.0)
    worst = Audit.worst([replace(one, supports=3.0), other])
    assert (worst["cone"], worst["supports"], worst["fields"]) == (2.0, 3.0, one.fields)


def judged(scene: Scene, simulation_of: SimulationOf, seed: int) -> tuple[Auditor, Any, Record, Array, Scales]:
    """A contact, and tractions and motions that no solver has seen: open, pressed, sticking and slipping somewhere."""
    simulation = simulation_of(scene)
    audit, random = Auditor(simulation.problem, simulation.mesh), np.random.default_rng(seed)
    (place,) = audit.cone.places
    count = audit.cone.size
    p = random.normal(0.02, 0.05, count)
    p[place.normal][::4] = 0.0
    w = random.normal(0.0, 0.1, count)
    w[place.tangential][:4] *= 1e-3  # less than rounding, some of it
    record = Record(
        time=1.0, displacement=random.normal(0.0, 0.1, (len(simulation.data.points), scene.dim)), p=p, w=w,
        reference=random.normal(0.0, 0.1, count) * (np.arange(count) >= place.tangential.start + 4),
        driven=np.zeros(0), shortened=np.zeros(0), searched={},
    )  # fmt: skip
    return audit, place, record, w, Scales(p=0.2, u={"base": 0.3}, rounding=2e-4)


def flat(dim: int, normal: Mapping[str, Any], friction: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A block on a plane, 0.02 m into it."""
    drive = {"top": {"boundary": "block.top", "displacement": dict.fromkeys("xyz"[:dim], -0.1)}}
    base = {"surface": "block.bottom", "against": "foundation", "gap_offset": -0.02, "normal": normal}
    return {"contacts": {"base": base | ({"friction": friction} if friction else {})}, "supports": drive}


@pytest.mark.parametrize("law", ["unilateral", "bilateral", "compliance"])
def test_normal_defects_are_those_of_the_definition(law: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = scene_of(**flat(2, COMPLIANCE if law == "compliance" else {"law": law}))
    audit, place, record, w, scales = judged(scene, simulation_of, seed=1)
    penetration, negative, complementarity = [0.0], [0.0], [0.0]
    u = record.displacement[place.rows.input].ravel()
    for p, w_n, of_u in zip(record.p[place.normal], w[place.normal], place.rows.N_n @ u, strict=True):
        into = w_n + 0.02
        into = np.sign(into) * max(abs(into) - 2e-4, 0.0)
        if law == "bilateral":
            penetration.append(abs(into) / 0.3)
            continue
        negative.append(-p / 0.2)
        if law == "unilateral":
            penetration.append(into / 0.3)
            complementarity.append(min(p / 0.2, -into / 0.3))
            continue
        by_pressure = abs(p - 40 * max(of_u + 0.02, 0.0) ** 1.5) / 0.2
        by_depth = abs(into - (max(p, 0.0) / 40) ** (1 / 1.5)) / 0.3 if p > 0 or into > 0 else 0.0
        penetration.append(min(by_pressure, by_depth))
    found = audit._normal(place, record, w, scales)
    assert_allclose(found, [max(penetration), max(negative), max(complementarity)], rtol=1e-9)
    assert found[0] > 0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("law", ["coulomb", "coulomb, k_T", "stick"])
def test_tangential_defects_are_those_of_the_definition(
    law: str, seed: int, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    friction = {"law": "stick"} if law == "stick" else {"law": "coulomb", "mu": 0.4}
    k_T = 7.0 if "k_T" in law else np.inf
    scene = scene_of(3, **flat(3, {"law": "unilateral"}, friction | ({"k_T": 7.0} if "k_T" in law else {})))
    audit, place, record, w, scales = judged(scene, simulation_of, seed)
    rows = place.rows
    t = record.p[place.tangential].reshape(-1, 2)
    du = (w - record.reference)[place.tangential].reshape(-1, 2) - t / k_T
    pressed = np.maximum(rows.average @ record.p[place.normal], 0.0)
    bounds = np.where(pressed > 0, np.inf, 0.0) if law == "stick" else 0.4 * pressed
    s_top = max(bounds[np.isfinite(bounds)].max(), module.FRICTION * 0.2)
    excess, slip_law, work, some = [0.0], [0.0], 0.0, s_top * 0.3 * float(rows.W_t.sum())
    for t_i, du_i, s, weight in zip(t, du, bounds, rows.W_t, strict=True):
        moved = du_i if np.hypot(*du_i) > 2e-4 else 0 * du_i

        def disc(x: Array, s: float = s) -> Array:
            return x if np.hypot(*x) <= s else x * s / np.hypot(*x)

        if np.isfinite(s):
            excess.append((np.hypot(*t_i) - s) / s_top)
        slip_law.append(np.hypot(*(disc(t_i) - disc(disc(t_i) + s_top / 0.3 * moved))) / s_top)
        work += weight * float(t_i @ moved)
        some += weight * max(np.hypot(*t_i), module.FRICTION * 0.2) * np.hypot(*moved)
    found = audit._tangential(place, record, w, scales)
    assert_allclose(found, [max(excess), max(slip_law), max(-work, 0.0) / some], rtol=1e-9)
    back = replace(record, reference=2 * w - record.reference)  # slip along the traction where it was against it
    if k_T == np.inf:
        assert_allclose(audit._tangential(place, back, w, scales)[2], max(work, 0.0) / some, rtol=1e-9)


def test_rounding_of_tractions_wastes_no_work_however_far_an_unloaded_contact_moves(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    audit, place, record, w, scales = judged(
        scene_of(**flat(2, {"law": "unilateral"}, {"law": "coulomb", "mu": 0.4})), simulation_of, seed=1
    )
    far = record.reference - 1e6 * scales.u["base"]
    p = np.where(np.arange(len(w)) < place.normal.stop, 0.0, module.FRICTION * scales.p)
    for traction, wasted in ((1e-6 * p, 1e-6), (p, 1.0)):
        found = audit._tangential(place, replace(record, p=traction), far, scales)[2]
        assert found == pytest.approx(wasted, rel=0.01)


def test_scales_are_those_of_the_largest_tractions(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = scene_of(**flat(2, COMPLIANCE, SPRINGS), bodies={"block": {"E": 2.0, "nu": 0.3}})
    audit, place, record, _, _ = judged(scene, simulation_of, seed=1)
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


def test_tractions_are_not_smaller_than_the_rounding_of_all_forces(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    push = {"loads": {"push": {"boundary": "block.right", "pressure": 0.5}}}
    audit, place, record, _, _ = judged(scene_of(**flat(2, {"law": "unilateral"}), **push), simulation_of, seed=1)
    u = audit.system.vector()
    u.array[:] = record.displacement[audit.system.nodes.input].ravel()
    inner, load = audit._inner(u), audit.system.load(1.0)
    noise = ROUNDING * (np.abs(inner.array).sum() + np.abs(load.array).sum())  # on a side of 2 m
    noise += module.EPS * audit._largest_stiffness * np.abs([*u.array, *audit._motion(place.rows, record).flat]).max()
    assert audit._scales(replace(record, p=0 * record.p), inner).p == pytest.approx(noise / 2.0, rel=1e-9)


def test_stiffness_of_laws_is_that_of_springs_alone(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    for law in ("unilateral", "compliance"):
        scene = scene_of(**flat(2, COMPLIANCE if law == "compliance" else {"law": law}))
        _, place, record, _, _ = judged(scene, simulation_of, seed=1)
        p = record.p[place.normal]
        slope = 40 * 1.5 * np.maximum(p / 40, 0.0) ** (0.5 / 1.5)  # of c d^m at p
        assert (p > 0).any()
        expected = float(place.rows.W_n @ slope) if law == "compliance" else 0.0
        assert module._law_stiffness(place, record.p) == pytest.approx(expected)


def test_equilibrium_is_relative_to_the_sum_of_all_forces(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """Those within bodies, of loads, of contact, and on the obstacle that a force drives."""
    plane = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "force": {"y": 5.0}}
    push = {"loads": {"push": {"boundary": "block.right", "pressure": 0.5}}, "obstacles": {"foundation": plane}}
    scene = scene_of(**flat(2, {"law": "unilateral"}, SPRINGS), **push)
    audit, place, record, _, scales = judged(scene, simulation_of, seed=1)
    record = replace(record, driven=np.zeros(1))
    system, u = audit.system, audit.system.vector()
    u.array[:] = record.displacement[system.nodes.input].ravel()
    inner, load, contact = audit._inner(u), system.load(1.0), audit._contact_force(place, u, record, scales)
    free = system.T.createVecRight()
    system.T.multTranspose(inner - load + contact, free)
    on_obstacle = system.interface.resultant_on_driven(place.rows, contact) + system.obstacles.driving_force(1.0)
    scale = sum(np.abs(v.array).sum() for v in (inner, load, contact)) + 5.0
    found, rounding = audit._equilibrium(record, u, inner, scales)
    assert found == pytest.approx((np.abs(free.array).sum() + np.abs(on_obstacle).sum()) / scale, rel=1e-12)
    system.T.multTranspose(audit._inner(u * audit._signs), free)
    assert rounding == pytest.approx(module.EPS * np.abs(free.array).sum() / scale, rel=0.5)  # of last digits


@pytest.mark.parametrize(
    ("obstacle", "size"),
    [
        ({"shape": "plane", "point": [0.3, 0.0], "normal": [0.0, 1.0]}, 0.0),  # on which all coordinates are 0
        ({"shape": "plane", "point": [0.0, -0.5], "normal": [0.0, 1.0]}, 0.5),
        ({"shape": "cylinder", "point": [0.0, -9.0], "radius": 9.0}, 2.0),  # that of the scene
    ],
)
def test_the_last_digit_of_gaps_counts_by_the_stiffness_of_the_law(
    obstacle: dict[str, Any], size: float, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    scene = scene_of(**flat(2, {"law": "compliance", "c_n": 1e9}), obstacles={"foundation": obstacle})
    audit, place, record, _, scales = judged(scene, simulation_of, seed=1)
    record = replace(record, p=np.abs(record.p) + 0.01)
    u = audit.system.vector()
    u.array[:] = record.displacement[audit.system.nodes.input].ravel()
    inner, contact = audit._inner(u), audit._contact_force(place, u, record, scales)
    scale = inner.norm(0) + audit.system.load(1.0).norm(0) + contact.norm(0)
    _, rounding = audit._equilibrium(record, u, inner, scales)
    size += np.abs(record.w).max()
    assert rounding == pytest.approx(module.EPS * size * 1e9 * 2.0 / scale, rel=1e-3)  # on a side of 2 m


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
def test_what_is_prescribed_is_missed_relative_to_the_largest_motion(
    name: str, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    simulation = simulation_of(scene_of(**SUPPORTS[name]))
    audit, points = Auditor(simulation.problem, simulation.mesh), simulation.data.points
    system = audit.system
    moved = np.tile([0.0 if name == "revolved" else 0.05, -0.1], (len(points), 1))

    def supports(displacement: Array, time: float = 1.0) -> float:
        record = Record(
            time=time, displacement=displacement, p=np.zeros(0), w=np.zeros(0), reference=np.zeros(0),
            driven=np.zeros(0), shortened=np.zeros(0), searched={},
        )  # fmt: skip
        u = system.vector()
        u.array[:] = displacement[system.nodes.input].ravel()
        return audit._supports(record, u)

    assert supports(moved) < 1e-15
    assert supports(0 * moved, time=0.0) == 0.0
    at = {"revolved": points[:, 0] < 1e-9, "periodic": points[:, 0] > 2 - 1e-9}.get(name, points[:, 1] > 1 - 1e-9)
    axis, by = (0, 0.02) if name in ("revolved", "periodic") else (1, -0.02)
    chosen = np.flatnonzero(at & (points[:, 1] > 0.2) & ((points[:, 1] < 0.9) | (axis == 1)))[:2]
    assert len(chosen) == 2
    moved[chosen, axis] += by
    off = 0.01 if name == "periodic" else 0.02  # from the mean of both sides
    assert supports(moved) == pytest.approx(off / np.abs(moved).max(), rel=1e-9)


def test_stored_fields_are_right_up_to_rounding_of_lengths(case_of: Callable[[str], Case]) -> None:
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


@pytest.mark.parametrize(("part", "judged_at_all"), [(0.8, False), (1.25, True)])
def test_forces_of_a_body_that_moves_as_a_whole_are_rounding_up_to_a_limit(
    part: float, judged_at_all: bool, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """Of all |u| together, times the largest stiffness."""
    block = {"block": {"E": 3.0, "nu": 0.3}}
    audit, _, record, _, scales = judged(scene_of(**flat(2, {"law": "unilateral"}), bodies=block), simulation_of, 1)
    still = replace(record, time=0.0, p=0 * record.p)
    u, one = audit.system.vector(), audit.system.vector()
    one.array[len(one.array) // 2] = 1.0
    u.set(0.3)
    limit = module.SUMMED * EPS * audit._largest_stiffness * float(np.abs(u.array).sum())
    u += one * (part * limit / audit._inner(one).norm(0))
    found = audit._equilibrium(still, u, audit._inner(u), scales)
    assert (found != (0.0, 0.0)) is judged_at_all
