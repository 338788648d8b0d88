"""Springs, elastic supports and remote points hold and drive bodies, and are refused where they cannot."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit
from shared.cases import every_nth
from shared.failures import failures
from shared.problems import followed as with_errors
from stickslip import Scene, SceneError, Simulation
from stickslip.solvers.results.step_result import Quantity, StepResult, values
from stickslip.solvers.simulation.plan import make_plan, planned
from stickslip.workflows.lab.verification.cases import beam as case
from stickslip.workflows.lab.verification.cases.beam import ARM, FX, FY, LENGTH, MZ, end
from stickslip.workflows.lab.verification.cases.beam import E as MODULUS
from stickslip.workflows.lab.verification.cases.beam import scene as beam_scene
from stickslip.workflows.lab.verification.cases.springs import AREA, CORNERS, K, alone, between, floor, pressed, scene
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict


@pytest.mark.parametrize(("model", "order", "surface"), every_nth(2, AREA, [1, 2], ["condensed", "matrix-free"]))
def test_a_spring_presses_a_column_on_the_floor(model: str, order: Literal[1, 2], surface: str) -> None:
    simulation, step, checks = pressed(model, order, "surface-uzawa", surface)
    assert not failures(checks)
    assert max(audit(simulation, step).values()) < 1e-6
    along = "z" if model == "3d" else "y"
    assert values(step)[f"spring.s.force.{along}"] == step.springs["s"].force[-1]


def test_springs_hold_a_body_and_pull_on_two() -> None:
    assert planned(scene(CORNERS)).rigid_modes.shape == (3, 0)
    for simulation, step, checks in (alone(1), alone(2), between()):
        assert not failures(checks)
        assert max(audit(simulation, step).values()) < 1e-9


def test_a_mean_resists_no_rotation_about_its_centre() -> None:
    """One spring under the whole base holds it up, not upright."""
    with pytest.raises(SceneError, match=r"supports: nothing resists the rotation"):
        make_plan(scene({"s": {"at": "block.bottom", "stiffness": [K, K]}}))


def test_stated_errors_of_spring_forces_hold_and_points_have_none() -> None:
    """A block that a spring presses and another one drags over the floor, against a mesh four times as fine."""
    springs: dict[str, Any] = {
        "down": {"at": "block.top", "stiffness": [0.0, 800.0], "displacement": [0.0, -0.01]},
        "side": {"at": "block.left", "stiffness": 500.0, "direction": [1.0, 0.5], "displacement": [0.004, 0.0]},
        "tip": {"at": [2.0, 1.0], "stiffness": [50.0, 0.0]},
    }
    tables = rough_floor("plane strain")
    answers = []
    for size in (0.25, 0.0625):
        shape = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": size}
        simulation = with_errors(scene(springs, **tables, geometry=shape))
        steps = [*simulation.steps()]
        answers.append((steps[-1], simulation.errors(steps)[-1]))
    (coarse, errors), (fine, _) = answers
    for name in ("down", "side"):
        parts = errors[Quantity("springs", name, "force")]
        off = np.abs(coarse.springs[name].force - fine.springs[name].force)
        assert np.all(off <= parts.mesh + 1e-12)
        assert np.all(parts.mesh < 4 * off + 1e-12)
    assert errors[Quantity("springs", "tip", "force")].mesh is None


@pytest.mark.parametrize(
    ("spring", "message"),
    [
        ({"at": "block.botom"}, r"springs\.s\.at = block\.botom: no such side; did you mean"),
        ({"to": "block.tp"}, r"springs\.s\.to = block\.tp: no such side; did you mean"),
        ({"to": "block.bottom"}, r"springs\.s\.to = block\.bottom: a spring has two different ends"),
        ({"at": [0.0]}, r"springs\.s\.at = \[0\.0\]: expected 2 components"),
        ({"stiffness": 5.0}, r"springs\.s\.direction: missing, a single stiffness needs it"),
        ({"direction": [1.0, 0.0]}, r"springs\.s\.direction = \[1\.0, 0\.0\]: a stiffness by component has none"),
        ({"stiffness": 5.0, "direction": [0.0, 0.0]}, r"springs\.s\.direction = .*must not be zero"),
        ({"stiffness": [0.0, 0.0]}, r"springs\.s\.stiffness = .*must not be negative, and one be positive"),
        ({"stiffness": [K, -1.0]}, r"springs\.s\.stiffness = .*must not be negative"),
        ({"stiffness": [K]}, r"springs\.s\.stiffness = \[300\.0\]: expected 2 components"),
        ({"stiffness": [1e-9, 0.0]}, r"springs\.s\.stiffness = 1e-09: too soft beside the bodies"),
        ({"stiffness": [1e12, 0.0]}, r"springs\.s\.stiffness = 1000000000000\.0: too stiff beside the bodies"),
        ({"acts": "compression"}, r"springs\.s\.direction: missing, a spring that acts in one way needs it"),
        ({"gap": 0.1}, r"springs\.s\.gap = 0\.1: belongs to acts"),
        (
            {"stiffness": K, "direction": [0.0, 1.0], "acts": "tension", "gap": -0.1},
            r"springs\.s\.gap = -0\.1: must not be negative",
        ),
        ({"acts": "pull"}, r"springs\.s\.acts = .*pull"),
        ({"to": "block.top", "displacement": [0.0, 1.0]}, r"springs\.s\.displacement = given: moves the ground"),
        ({"displacement": [0.0]}, r"springs\.s\.displacement = \[0\.0\]: expected 2 components"),
        ({"force": 1.0}, r"springs\.s\.force: unknown key"),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(spring: dict[str, Any], message: str) -> None:
    supports = {"foot": {"boundary": "block.bottom", "displacement": {"x": 0.0, "y": 0.0}}}
    with pytest.raises(SceneError, match=message):
        make_plan(scene({"s": {"at": "block.bottom", "stiffness": [K, K], **spring}}, supports=supports))


def test_what_only_the_mesh_shows_is_refused() -> None:
    foot = {"foot": {"boundary": "block.bottom", "displacement": {"x": 0.0, "y": 0.0}}}
    with pytest.raises(SceneError, match=r"springs\.s\.at = \[0\.3, 0\.0\]: no mesh vertex there; the nearest is"):
        prepare(scene({"s": {"at": [0.3, 0.0], "stiffness": [K, K]}}, supports=foot))


def test_an_axisymmetric_model_has_springs_along_its_axis() -> None:
    for spring, message in (
        ({"at": [1.0, 0.0], "stiffness": [0.0, K]}, r"springs\.s\.at = .*an axisymmetric model has rings; use a side"),
        ({"at": "block.top", "stiffness": [K, K]}, r"springs\.s = radial: .*act along the axis y"),
    ):
        with pytest.raises(SceneError, match=message):
            scene({"s": spring}, "axisymmetric")


def test_a_point_belongs_to_the_body_with_the_nearest_of_all_sides() -> None:
    """The lower block's left side is farther from its own right corner than the upper block's left side is."""
    wide = {"builder": "two_blocks", "length": 1.0, "height": 0.5, "lower_length": 3.0, "mesh_size": 0.25}
    tables = {
        "model": "plane strain",
        "geometry": wide,
        "bodies": {name: {"E": 1.0, "nu": 0.3} for name in ("lower", "upper")},
        "contacts": {"joint": {"surface": "upper.bottom", "against": "lower.top"}},
        "supports": {
            "base": {"boundary": "lower.bottom", "displacement": {"y": 0.0}},
            "corner": {"point": [2.0, 0.0], "displacement": {"x": 0.0}},
            "top": {"boundary": "upper.top", "displacement": {"x": 0.0, "y": -0.01}},
        },
    }
    assert planned(from_dict(tables)).rigid_modes.shape == (6, 0)


STIFF, E, MU = 500.0, 1000.0, {"law": "coulomb", "mu": 0.3}
NORMAL, WHOLE = {"normal": STIFF}, {"normal": STIFF, "tangential": STIFF}


def solved(scene: Scene, tolerance: float = 1e-9) -> tuple[Simulation, StepResult]:
    simulation = prepare(scene)
    *_, step = simulation.steps()
    assert step.energy.external == pytest.approx(step.energy.stored + step.energy.contact, rel=1e-8, abs=1e-14)
    assert max(audit(simulation, step).values()) < tolerance
    return simulation, step


def rough_floor(model: str) -> dict[str, Any]:
    """The floor of the case with friction, and no supports."""
    tables = floor(model)
    return tables | {"contacts": {"base": tables["contacts"]["base"] | {"friction": MU}}, "supports": {}}


def bedded_scene(
    model: str = "plane strain", bed: dict[str, Any] = WHOLE, side: str = "bottom", **tables: Any
) -> Scene:
    """A block 2 x 1 on springs."""
    data = {
        "model": model,
        "geometry": {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5},
        "bodies": {"block": {"E": E, "nu": 0.0, "density": 1.0}},
        "elastic_support": {"bed": {"boundary": f"block.{side}", **bed}},
    }
    return from_dict(data | tables)


def test_a_floating_block_needs_springs_in_every_direction() -> None:
    assert planned(bedded_scene()).rigid_modes.shape == (3, 0)
    assert planned(bedded_scene("axisymmetric", NORMAL)).rigid_modes.shape == (1, 0)
    with pytest.raises(SceneError, match=r"supports: nothing resists the translation along x"):
        make_plan(bedded_scene(bed=NORMAL))
    with pytest.raises(SceneError, match=r"supports: nothing resists the translation along y"):
        make_plan(bedded_scene(bed={"tangential": STIFF}))
    (row,) = (row for row in make_plan(bedded_scene()) if row.effect == "elastic_support")
    assert (row.on, row.because) == (True, "elastic_support.bed")


def test_what_springs_leave_free_is_held_by_contact_and_friction() -> None:
    """A floor on springs beside it: the motion along x is left to friction, and costs no spring."""
    tables: dict[str, Any] = {
        "obstacles": {
            "lid": {"shape": "plane", "point": [0.0, 1.0], "normal": [0.0, -1.0], "displacement": {"y": -0.03}}
        },
        "contacts": {"top": {"surface": "block.top", "against": "lid", "friction": {"law": "coulomb", "mu": 0.5}}},
        "loads": {"push": {"boundary": "block.right", "traction": [-0.5, 0.0]}},
    }
    found = bedded_scene(bed=NORMAL, **tables)
    assert planned(found).rigid_modes.shape == (3, 1)
    _, step = solved(found, 1e-8)
    assert_allclose(step.contacts["top"].force, [0.5, -2.0 * 0.03 / (1 / STIFF + 1 / E)], rtol=1e-8)


def test_springs_carry_the_weight() -> None:
    simulation, step = solved(bedded_scene(gravity={"acceleration": [3.0, -2.0]}), 1e-10)
    base = np.flatnonzero(simulation.data.points[:, 1] < 1e-9)
    base = base[np.argsort(simulation.data.points[base, 0])]
    u = step.displacement[base]
    mean = (u[1:] + u[:-1]).mean(axis=0) / 2  # of equal facets
    assert_allclose(mean, [3.0 / STIFF, -2.0 / STIFF], rtol=1e-10)
    bed = step.elastic_support["bed"]
    assert_allclose(bed.force, [-6.0, 4.0], rtol=1e-10)
    assert_allclose(bed.moment, 1.0 * 4.0 + 0.5 * 6.0, rtol=1e-10)
    assert step.energy.external == pytest.approx(step.energy.stored, rel=1e-10)


def test_a_rigid_motion_that_supports_prescribe_strains_the_springs_that_resist_it() -> None:
    lid = {"lid": {"boundary": "block.top", "displacement": {"x": 0.01, "y": 0.0}}}
    for bed, resisted in ((NORMAL, False), (WHOLE, True)):
        _, step = solved(bedded_scene(bed=bed, supports=lid))
        assert step.energy.stored == pytest.approx(step.energy.external, rel=1e-9, abs=1e-15)
        assert (step.energy.stored > 1e-6) == resisted


@pytest.mark.parametrize(
    ("bed", "side", "message"),
    [
        (WHOLE, "botom", r"elastic_support\.bed\.boundary = block\.botom: no such side; did you mean"),
        ({}, "bottom", r"elastic_support\.bed\.normal = 0\.0: springs need a stiffness"),
        ({"normal": -1.0}, "bottom", r"elastic_support\.bed\.normal = -1\.0: must not be negative"),
        ({"normal": 1e-8, "tangential": STIFF}, "bottom", r"elastic_support\.bed = 1e-08: too soft beside the bodies"),
        ({"stiffness": STIFF}, "bottom", r"elastic_support\.bed\.stiffness: unknown key"),
    ],
)
def test_a_wrong_bed_is_refused_in_one_line(bed: dict[str, float], side: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        make_plan(bedded_scene(bed=bed, side=side))


@pytest.mark.parametrize("form", ["condensed", "matrix-free"])
def test_springs_that_hardly_hold_do_not_hide_what_sticks(form: str) -> None:
    """Without contact the block would move by a kilometre: statuses are judged by the tractions that there are."""
    tables: dict[str, Any] = {
        "bodies": {"block": {"E": 2.1e11, "nu": 0.3}},
        **rough_floor("plane strain"),
        "loads": {
            "top": {"boundary": "block.top", "pressure": "1e6*(1+x)"},
            "side": {"boundary": "block.left", "pressure": 4e5},
        },
        "solver": {"surface": form},
    }
    weak = {"normal": 1e3, "tangential": 1e3}
    (held,) = prepare(bedded_scene(bed=weak, side="top", **tables)).steps()
    (free,) = prepare(bedded_scene(bed=weak, side="top", **(tables | {"elastic_support": {}}))).steps()
    assert held.p_ref > 1e6 * free.p_ref
    for key in ("contact_area", "stick_area", "slip_area"):
        assert getattr(held.contacts["base"], key) == getattr(free.contacts["base"], key)
    assert free.contacts["base"].slip_area > 0


def bedded(model: str, mesh_size: float = 0.5, order: int = 1, part: float = 1.0, **tables: Any) -> StepResult:
    """A block on springs, pressed beside its middle by a lid with friction; the last of two steps.

    Args:
        part: of all that moves and loads it.
    """
    up, width = ("z", {"width": 1.0}) if model == "3d" else ("y", {})
    point, normal = ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]) if model == "3d" else ([0.0, 1.0], [0.0, -1.0])
    shape = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": mesh_size, "order": order} | width
    pressed: dict[str, Any] = {up: [[1, -0.03 * part], [2, -0.03 * part]]}
    data: dict[str, Any] = {
        "geometry": shape,
        "bodies": {"block": {"E": E, "nu": 0.3, "density": 1.0}},
        "obstacles": {"lid": {"shape": "plane", "point": point, "normal": normal, "displacement": pressed}},
        "contacts": {"top": {"surface": "block.top", "against": "lid", "friction": {"law": "coulomb", "mu": 0.2}}},
        "steps": {"end": 2.0, "count": 2},
    }
    if model != "axisymmetric":
        pressed["x"] = [[1, 0], [2, 0.02 * part]]
        data["loads"] = {"push": {"boundary": "block.right", "pressure": [[1, 0], [2, 2.0 * part]]}}
    bed = WHOLE if model != "axisymmetric" else NORMAL
    *_, last = with_errors(bedded_scene(model, bed, **(data | tables))).steps()
    return last


@pytest.mark.parametrize(("model", "order"), every_nth(2, ["plane strain", "axisymmetric", "3d"], [1, 2]))
def test_what_springs_exert_is_in_balance(model: str, order: int) -> None:
    """As it is, and with bubbles: with the contact, and the pressure on the right side; moments to a small motion."""
    last = bedded(model, order=order, part=1e-6)
    bed, top = last.elastic_support["bed"], last.contacts["top"]
    push = np.zeros(len(bed.force))
    push[0] = -2e-6 if model != "axisymmetric" else 0.0
    size = top.normal_force
    assert_allclose(bed.force + top.force + push, 0.0, atol=1e-7 * size)
    turned = -push[0] / 2 if model == "plane strain" else push[0] * np.array([0.0, 0.5, -0.5]) if model == "3d" else 0.0
    assert_allclose(bed.moment + top.moment + turned, 0.0, atol=2e-7 * size)
    if order == 1:
        for key, loads, most in (("force", push, 1e-3), ("moment", turned, 2e-3)):
            names = (str(Quantity(*of, key)) for of in (("elastic_support", "bed"), ("contacts", "top")))
            left = sum(np.asarray(last.corrected[name]) for name in names) + loads
            assert_allclose(left, 0.0, atol=most * size)


def test_its_error_is_stated() -> None:
    """A wall carries a part: how much is not a matter of balance."""
    wall = {"wall": {"boundary": "block.left", "displacement": {"x": 0.0, "y": 0.0, "z": 0.0}}}
    found, fine = bedded("3d", 0.5, supports=wall), bedded("3d", 0.25, order=2, supports=wall)
    for key in ("force", "moment"):
        name = str(Quantity("elastic_support", "bed", key))
        own, true = (getattr(step.elastic_support["bed"], key) for step in (found, fine))
        stated, corrected = (np.asarray(part) for part in (found.errors[name].mesh, found.corrected[name]))
        assert 0.8 < np.linalg.norm(stated) / np.linalg.norm(own - true) < 2.5
        assert np.linalg.norm(corrected - true) < 0.5 * np.linalg.norm(own - true)


def test_a_beam_bends_and_turns_as_its_end_is_loaded_or_driven() -> None:
    for simulation, step, checks in case.problems():
        assert not failures(checks)
        assert step.energy.external == pytest.approx(step.energy.stored, rel=1e-8)
        assert max(audit(simulation, step).values()) < 1e-8
        assert values(step)["remote_point.p.force.x"] == step.remote_points["p"].force[0]


def test_every_node_of_a_rigid_side_moves_as_prescribed() -> None:
    simulation, step, _ = case.driven()
    right = simulation.data.points[:, 0] > LENGTH - 1e-9
    y, point = simulation.data.points[right, 1], step.remote_points["p"]
    exact = np.stack([case.PULLED - case.TURNED * (y - 0.5), 0 * y], axis=1)
    assert_allclose(step.displacement[right], exact, atol=1e-15)
    assert_allclose(point.displacement, [case.PULLED, 0.0], atol=1e-15)


@pytest.mark.parametrize("length", [1e-12, 1e11])
@pytest.mark.parametrize("held", [True, False], ids=["strained", "moved"])
def test_rotations_of_bodies_of_any_size_are_prescribed(held: bool, length: float) -> None:
    """A side's motions have two units, whose ratio grows with the bodies."""
    size = {"builder": "block", "length": length, "height": length, "mesh_size": 0.5 * length}
    given = {"boundary": "block.right", "point": [length, 0.5 * length], "coupling": "rigid"}
    given |= {"displacement": {"x": 0.0, "y": 0.0}, "rotation": {"z": 1e-3}}
    simulation = prepare(beam_scene({"p": given}, geometry=size, **({} if held else {"supports": {}})))
    (step,) = simulation.steps()
    assert_allclose(step.remote_points["p"].rotation, 1e-3, rtol=1e-12)
    assert_allclose(step.remote_points["p"].displacement, 0.0, atol=1e-15 * length)
    if not held:
        x, y = simulation.data.points[:, :2].T
        rigid = 1e-3 * np.stack([0.5 * length - y, x - length], axis=1)
        assert_allclose(step.displacement[:, :2], rigid, atol=1e-15 * length)


def test_what_is_free_of_a_rigid_side_follows_what_is_prescribed() -> None:
    """Turned by a moment with x prescribed at an arm: as the same side under the reaction that is reported."""
    _, one = solved(beam_scene(end(displacement={"x": 1e-3}, force={"y": FY}, moment={"z": MZ})))
    force, moment = one.remote_points["p"].force, one.remote_points["p"].moment
    _, two = solved(beam_scene(end(force={"x": float(force[0]), "y": float(force[1])}, moment={"z": float(moment[0])})))
    assert_allclose(one.displacement, two.displacement, atol=1e-9 * np.abs(one.displacement).max())
    assert_allclose(one.remote_points["p"].rotation, two.remote_points["p"].rotation, rtol=1e-8)


def test_a_support_may_share_nodes_with_a_rigid_side() -> None:
    """The bar slides along its base: its end then neither turns nor rises, and the base carries the moment."""
    tables = {
        "supports": {
            "left": {"boundary": "block.left", "displacement": {"x": 0.0}},
            "base": {"boundary": "block.bottom", "displacement": {"y": 0.0}},
        }
    }
    x, y = 1e-6 * FX, 1e-6 * FY  # points hardly move
    _, step = solved(beam_scene(end(force={"x": x, "y": y}), **tables))
    point = step.remote_points["p"]
    assert_allclose(point.displacement[0], x * LENGTH / MODULUS, rtol=1e-8)
    assert_allclose(step.supports["base"].force[1], -y, rtol=1e-8)
    assert_allclose(step.supports["left"].force[0], -x, rtol=1e-8)
    moment = step.supports["left"].moment + step.supports["base"].moment
    assert_allclose(moment, -y * (LENGTH + ARM) + x * 0.5, rtol=1e-6)


@pytest.mark.parametrize(
    ("model", "order", "surface"),
    every_nth(2, ["plane strain", "3d", "axisymmetric"], [1, 2], ["condensed", "matrix-free"]),
)
def test_a_rigid_lid_presses_a_column(model: str, order: int, surface: str) -> None:
    """E A u / h, with friction that carries nothing; nu = 0."""
    last, dim = ("z", 3) if model == "3d" else ("y", 2)
    shape = {"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 0.5, "order": order}
    tables: dict[str, Any] = {
        "geometry": shape | ({"width": 1.0} if model == "3d" else {}),
        **rough_floor(model),
        "solver": {"method": "surface-uzawa", "surface": surface},
    }
    given: dict[str, Any] = {"displacement": {last: -1e-3}}
    if model != "axisymmetric":
        given |= {"force": {"x": 0.0}, "rotation": {"z": 0.0} if model == "plane strain" else dict.fromkeys("xyz", 0.0)}
    point = {"boundary": "block.top", "point": [0.3] * dim, "coupling": "rigid", **given}
    _, step = solved(beam_scene({"p": point}, model, **tables), 1e-6)
    area = np.pi if model == "axisymmetric" else 1.0
    assert_allclose(step.remote_points["p"].force[-1], -MODULUS * 1e-3 * area, rtol=1e-6)
    assert_allclose(step.contacts["base"].normal_force, MODULUS * 1e-3 * area, rtol=1e-6)


def test_prescribed_motion_holds_a_body() -> None:
    every = {"displacement": {"x": 1e-3, "y": 0.0}, "rotation": {"z": 1e-3}}
    free = beam_scene(end(**every), supports={})
    assert planned(free).rigid_modes.shape == (3, 0)
    _, step = solved(free)
    assert step.energy.stored < 1e-20
    assert_allclose(step.remote_points["p"].force, 0.0, atol=1e-12)
    with pytest.raises(SceneError, match=r"supports: nothing resists the rotation"):
        make_plan(beam_scene(end(displacement={"x": 0.0, "y": 0.0}), supports={}))


FLOOR: dict[str, Any] = {
    "obstacles": {"wall": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
    "contacts": {"base": {"surface": "block.bottom", "against": "wall"}},
}


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ({"boundary": "block.rihgt"}, r"remote_points\.p\.boundary = block\.rihgt: no such side; did you mean"),
        ({"point": [0.0]}, r"remote_points\.p\.point = \[0\.0\]: expected 2 components"),
        ({"coupling": "stiff"}, r'remote_points\.p\.coupling = "stiff": .*known: rigid, distributing|"stiff"'),
        ({"moment": {"x": 1.0}}, r"remote_points\.p\.moment\.x = given: this model has x and y, and turns about z"),
        ({"force": {"z": 1.0}}, r"remote_points\.p\.force\.z = given: this model has x and y"),
        ({"force": {"x": 1.0}, "displacement": {"x": 0.0}}, r"\.p\.force\.x: displacement\.x is prescribed too"),
        ({"moment": {"z": 1.0}, "rotation": {"z": 0.0}}, r"remote_points\.p\.moment\.z: rotation\.z is prescribed too"),
        (
            {"coupling": "distributing", "displacement": {"x": 0.0}},
            r"remote_points\.p\.displacement: a distributing coupling takes force and moment; set coupling = rigid",
        ),
        ({"torque": 1.0}, r"remote_points\.p\.torque: unknown key"),
    ],
)
def test_a_wrong_remote_point_is_refused_in_one_line(point: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        make_plan(beam_scene({"p": {**end()["p"], **point}}))


def test_what_only_the_mesh_shows_of_a_remote_point_is_refused() -> None:
    uneven = {"s": {"boundary": "block.right", "displacement": {"y": "1e-3*y**2"}}}
    left = {"boundary": "block.left", "displacement": {"x": 0.0, "y": 0.0}}
    for tables, message in (
        (FLOOR, r"remote_points\.p\.boundary = block\.right: has nodes in common with block\.bottom, a contact"),
        ({"supports": uneven | {"left": left}}, r"remote_points\.p: supports\.s cannot hold on its side, .* at t = 1"),
    ):
        with pytest.raises(SceneError, match=message):
            prepare(beam_scene(end(), **tables))
