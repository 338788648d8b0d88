"""Models and materials: bodies of revolution, orthotropic ones."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import stickslip
from shared.audited import audit, record_of, stored_by
from shared.cases import every_nth
from shared.drawn import draw, scene_data
from shared.problems import scene_of
from stickslip.geometry.errors import SceneError
from stickslip.geometry.shape import Model
from stickslip.solvers.fem.elastic_energy import stress_by_compliance
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.results.step_result import OPEN, SLIP, STICK, Errors, Quantity, StepResult, number_of, quantities
from stickslip.solvers.scene.material import Material, Orthotropic
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan, warnings
from stickslip.solvers.simulation.simulation import prepare as estimating
from stickslip.workflows.lab.verification.prepared import prepare, system_of
from stickslip.workflows.lab.verification.units import in_millimetres
from stickslip.workflows.scene_file.read import from_dict, read, to_dict

E, NU = 1.0, 0.3
GEOMETRIES: list[dict[str, Any]] = [{"order": 1}, {"order": 2}, {"order": 2, "cells": "tensor"}]
BASE = {"base": {"surface": "block.bottom", "against": "foundation"}}


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_a_pressed_cylinder_is_in_uniaxial_stress(geometry: dict[str, Any]) -> None:
    # radius 2, height 1, free to widen: sigma_yy = -E/10, u_r = nu r/10: linear, so both orders are exact
    support = {"top": {"boundary": "block.top", "displacement": {"y": -0.1}}}
    tables = {"contacts": BASE, "supports": support, "probes": {"rim": {"point": [2.0, 0.0]}}}
    scene = scene_of(geometry=geometry, model="axisymmetric", solver={"tolerance": 1e-12}, **tables)
    (step,) = prepare(scene).steps()
    force = 0.1 * E * np.pi * 4.0
    base = step.contacts["base"]
    assert_allclose(base.normal_force, force, rtol=1e-10)
    assert_allclose(base.force, [0.0, force], rtol=1e-10, atol=1e-12)
    assert_allclose(base.pressure, 0.1 * E, rtol=1e-9)  # the node on the axis included
    assert_allclose(base.contact_area, 4 * np.pi, rtol=1e-12)
    assert_allclose(step.supports["top"][0], [0.0, -force], rtol=1e-10, atol=1e-12)
    assert_allclose(step.probes["rim"][0], [NU * 0.1 * 2.0, 0.0], atol=1e-11)
    assert_allclose(step.stress, np.tile(np.diag([0.0, -0.1 * E, 0.0]), (len(step.stress), 1, 1)), atol=1e-10)
    assert_allclose(step.energy.external, step.energy.stored, rtol=1e-10)
    assert_allclose(step.energy.stored, 0.1 * force / 2, rtol=1e-10)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_pressure_around_a_cylinder_makes_hoop_stress(geometry: dict[str, Any]) -> None:
    # sigma_rr = sigma_hoop = -p in a solid cylinder between smooth plates: u_r = -(1 + nu)(1 - 2 nu) p r / E
    hold = {side: {"boundary": f"block.{side}", "displacement": {"y": 0.0}} for side in ("top", "bottom")}
    load = {"around": {"boundary": "block.right", "pressure": 0.1}}
    scene = scene_of(geometry=geometry, model="axisymmetric", supports=hold, loads=load)
    (step,) = prepare(scene).steps()
    expected = np.diag([-0.1, -2 * NU * 0.1, -0.1])
    assert_allclose(step.stress, np.tile(expected, (len(step.stress), 1, 1)), atol=1e-10)
    assert_allclose(step.displacement[:, 0].min(), -(1 + NU) * (1 - 2 * NU) * 0.1 * 2.0 / E, rtol=1e-10)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_weights_are_positive_and_make_a_disc(geometry: dict[str, Any]) -> None:
    friction = {"base": BASE["base"] | {"friction": {"law": "coulomb", "mu": 0.3}}}
    (rows,) = system_of(scene_of(geometry=geometry, model="axisymmetric", contacts=friction)).contacts
    assert rows.node_weights.min() > 0
    for weights in (rows.node_weights, rows.W_n, rows.W_t):
        assert_allclose(weights.sum(), 4 * np.pi, rtol=1e-12)
    on_axis = rows.surface.points[:, 0] == 0.0
    assert on_axis.sum() == 1
    assert len(rows.W_n) == len(on_axis)  # the axis node is pressed like any other
    assert len(rows.W_t) == len(on_axis) - 1  # but does not slip: u_r = 0 there


def test_friction_works_around_the_full_circle() -> None:
    """A disc pressed on a floor widens by nu p r / E; a small bound s works by 2 pi s nu p R^3 / (3 E)."""
    bound, R = 1e-7, 2.0
    friction = {"friction": {"law": "tresca", "bound": [[0, bound], [1, bound]]}}
    support = {"top": {"boundary": "block.top", "displacement": {"y": -0.1}}}
    scene = scene_of(
        geometry={"mesh_size": 0.1}, base=friction, model="axisymmetric", supports=support, solver={"tolerance": 1e-12}
    )
    (step,) = prepare(scene).steps()
    base = step.contacts["base"]
    assert_allclose(base.dissipation, 2 * np.pi * bound * NU * 0.1 * R**3 / 3, rtol=0.01)
    assert_allclose(step.energy.dissipated, base.dissipation, rtol=1e-12)


def test_the_full_circle_has_axial_forces_alone_and_no_moment() -> None:
    support = {"top": {"boundary": "block.top", "displacement": {"y": -0.1}}}
    simulation = prepare(scene_of(base={}, model="axisymmetric", supports=support))
    (step,) = simulation.steps()
    for acting in (step.contacts["base"], step.supports["top"], *step.obstacles.values()):
        assert_allclose([acting.force[0], *acting.moment], 0.0, atol=1e-15)
    judge, record = Auditor(simulation.problem, simulation.mesh), replace(record_of(step), stored=stored_by(step))
    assert judge(record).moment == 0
    told = {"base": step.contacts["base"].force[1:]}
    assert judge(replace(record, stored=replace(record.stored, moments=told))).moment > 1e-2


RING = """
SetFactory("OpenCASCADE");
Rectangle(1) = {FAR, 0, 0, 1, 0.5};
Mesh.MeshSizeMax = 0.1;
Physical Surface("block") = {1};
Physical Curve("block.bottom") = {1}; Physical Curve("block.top") = {3};
"""


def test_a_thin_ring_is_a_strip_around_its_circumference(tmp_path: Path) -> None:
    """Far from the axis forces, areas, works and all stated errors are those of plane strain by 2 pi r."""
    far, found, errors = 1e5, dict[str, StepResult](), dict[str, Errors]()
    (tmp_path / "ring.geo").write_text(RING.replace("FAR", f"{far:g}"))
    for model in ("plane strain", "axisymmetric"):
        scene = from_dict(
            {
                "model": model,
                "geometry": {"file": "ring.geo"},
                "bodies": {"block": {"E": 1.0, "nu": NU}},
                "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
                "contacts": {
                    "base": {
                        "surface": "block.bottom",
                        "against": "floor",
                        "normal": {"law": "compliance", "c_n": 20.0},
                        "friction": {"law": "coulomb", "mu": 0.3},
                    }
                },
                "supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.04, "y": -0.05}}},
                "solver": {"tolerance": 1e-11},
            },
            tmp_path,
        )
        simulation = estimating(scene)
        (found[model],) = simulation.steps()
        (errors[model],) = simulation.errors([found[model]])
    strip, ring = found["plane strain"], found["axisymmetric"]
    assert {OPEN, SLIP, STICK} > {*strip.contacts["base"].status} > {SLIP}
    assert_array_equal(ring.contacts["base"].status, strip.contacts["base"].status)
    around, known = 2 * np.pi * (far + 0.5), quantities(strip)
    powers = {"N": 1, "J": 1, "m²": 1}
    for key, value in quantities(ring).items():
        unit = number_of(key).unit
        if key.quantity in ("moment", "force", "tangential_force"):  # radial parts balance around the circle
            continue
        size = around ** powers.get(unit, 0)
        assert_allclose(value, size * np.asarray(known[key]), rtol=2e-3, atol=1e-6 * size, err_msg=str(key))
        one, other = errors["axisymmetric"][key], errors["plane strain"][key]
        if other.mesh is None:  # the pressure at a corner of the block grows without end
            assert one.mesh is None
        else:
            assert_allclose(one.mesh, size * np.asarray(other.mesh), rtol=0.02, atol=1e-6 * size, err_msg=str(key))
    assert ring.mesh_error == pytest.approx(strip.mesh_error, rel=1e-3)
    assert strip.mesh_error > 0.01


def test_only_the_shift_along_the_axis_is_rigid() -> None:
    system = system_of(scene_of(model="axisymmetric", contacts=BASE))
    assert system.interface.rigid_modes.shape[1] == 1
    free = scene_of(model="axisymmetric", geometry={"mesh_size": 0.5})
    with pytest.raises(SceneError, match="nothing resists the translation along y of the body"):
        make_plan(free)


def test_a_contact_side_of_which_a_part_lies_on_the_axis_is_refused(tmp_path: Path) -> None:
    def scene(*edges: str) -> Scene:
        data = scene_data(draw(tmp_path / "b.brep", 2), 2, "part", names={"part.bottom": edges, "part.top": ["edge 3"]})
        return from_dict(data | {"model": "axisymmetric"})

    make_plan(scene("edge 1"))
    make_plan(scene("edge 1", "edge 2"))  # bottom and outer rim
    with pytest.raises(SceneError, match=r"part\.bottom: a part lies on the axis of symmetry and has no area"):
        make_plan(scene("edge 1", "edge 4"))


WOOD: dict[str, Any] = {
    "E_1": 10.0, "E_2": 0.8, "E_3": 0.5, "G_12": 0.6, "nu_12": 0.4, "nu_13": 0.45, "nu_23": 0.35,
}  # fmt: skip
IN_SPACE = {"G_13": 0.6, "G_23": 0.05, "axis_1": [1.0, 0.5, 0.3], "axis_2": [0.0, 1.0, 1.0]}
NORMAL = Quantity("contacts", "base", "normal_force")
MODELS: tuple[Model, ...] = ("plane strain", "plane stress", "axisymmetric", "3d")


def block(model: Model, order: int, body: dict[str, Any], **further: Any) -> Scene:
    """A block that its top presses, and but in axisymmetry shears, on a floor with friction."""
    dim = 3 if model == "3d" else 2
    motion = dict.fromkeys("xyz"[:dim], 0.0) | {"xyz"[dim - 1]: -0.01}
    shift = {} if model == "axisymmetric" else {"x": 0.004}
    found: dict[str, Any] = {
        "bodies": {"block": body},
        "contacts": {"base": BASE["base"] | {"friction": {"law": "coulomb", "mu": 0.3}}},
        "supports": {"top": {"boundary": "block.top", "displacement": motion | shift}},
        "solver": {"tolerance": 1e-11},
        "output": {"error": False},
        "geometry": {},
    } | further
    shape = {"length": 1.0, "height": 0.5, "mesh_size": 0.25, "order": order} | found.pop("geometry")
    return scene_of(dim, shape, model=model, **found)


def wood(model: Model) -> dict[str, Any]:
    """An orthotropic body, off the axes where the model lets it."""
    if model == "axisymmetric":
        return WOOD | {"axis_1": [0.6, 0.8]}
    return WOOD | (IN_SPACE if model == "3d" else {"axis_1": {"x": 2.0, "y": 1.0}})


def isotropic(E: float, nu: float, dim: int) -> dict[str, Any]:
    """The constants of an isotropic body along odd axes."""
    G = E / (2 * (1 + nu))
    axes = {"axis_1": [1.0, 2.0, 0.5], "axis_2": [0.0, 1.0, 3.0]} if dim == 3 else {"axis_1": [0.6, 0.8]}
    found = {f"E_{i}": E for i in (1, 2, 3)} | {f"nu_{ij}": nu for ij in (12, 13, 23)}
    return found | {f"G_{ij}": G for ij in ((12, 13, 23) if dim == 3 else (12,))} | axes


@pytest.mark.parametrize(("model", "order"), every_nth(2, MODELS, [1, 2]))
def test_isotropic_constants_give_the_isotropic_answer_and_its_errors(model: Model, order: int) -> None:
    answers = []
    for body in ({"E": 2.0, "nu": 0.3}, isotropic(2.0, 0.3, 3 if model == "3d" else 2)):
        simulation = stickslip.prepare(block(model, order, body, output={}))
        steps = [*simulation.steps()]
        answers.append((steps[-1], simulation.errors(steps)[-1]))
    (one, errors), (other, same) = answers
    assert one.mesh_error > 1e-3
    for key in ("displacement", "stress", "p", "mesh_error"):
        a, b = np.asarray(getattr(one, key)), np.asarray(getattr(other, key))
        assert_allclose(b, a, rtol=1e-8, atol=1e-9 * np.abs(a).max())
    assert errors[NORMAL].mesh is not None
    for name, error in errors.items():
        assert (error.mesh is None) == (same[name].mesh is None)
        if error.mesh is not None:
            assert_allclose(same[name].mesh, error.mesh, rtol=1e-6, atol=1e-10)


@pytest.mark.parametrize(("model", "order"), every_nth(2, MODELS, [2, 1]))
def test_the_audit_agrees_in_every_model(model: Model, order: int) -> None:
    simulation = stickslip.prepare(block(model, order, wood(model)))
    (step,) = simulation.steps()
    assert max(audit(simulation, step).values()) < 1e-8
    found = Auditor(simulation.problem, simulation.mesh)(replace(record_of(step), stored=stored_by(step)))
    assert found.fields < 1e-12
    assert step.energy.stored == pytest.approx(step.energy.external - step.energy.contact, rel=1e-9)
    upright = stickslip.prepare(block(model, order, WOOD | {"G_13": 0.6, "G_23": 0.05}))
    (other,) = upright.steps()
    assert abs(other.energy.stored / step.energy.stored - 1) > 0.02  # the axes count


@pytest.fixture(scope="module")
def step() -> StepResult:
    (step,) = stickslip.prepare(block("3d", 1, wood("3d"))).steps()
    return step


@pytest.mark.parametrize("key", ["E_1", "E_2", "E_3", "G_12", "G_13", "G_23", "nu_12", "nu_13", "nu_23", "axis_1"])
def test_the_audit_notices_another_constant(key: str, step: StepResult) -> None:
    """A step solved with one body is out of balance for another, and its stress is wrong: every constant counts."""
    changed = [1.0, 0.4, 0.3] if key == "axis_1" else wood("3d")[key] * 1.05
    other = stickslip.prepare(block("3d", 1, wood("3d") | {key: changed}))
    found = Auditor(other.problem, other.mesh)(replace(record_of(step), stored=stored_by(step)))
    assert found.equilibrium > 1e-6
    assert found.fields > 1e-6


@pytest.mark.parametrize("plane_stress", [False, True])
def test_two_formulas_of_the_stress_agree(plane_stress: bool) -> None:
    strain = np.random.default_rng(5).random((7, 3, 3))
    strain = strain + np.swapaxes(strain, 1, 2)
    strain[:, 2, :2] = strain[:, :2, 2] = 0.0
    body = Orthotropic(**WOOD, axis_1=(1.0, 2.0))
    one, other = body.stress(strain, plane_stress), stress_by_compliance(body, strain, plane_stress)
    assert_allclose(one, other, rtol=1e-12, atol=1e-13)
    assert np.abs(one[:, 2, 2]).max() == 0 if plane_stress else np.abs(one[:, 2, 2]).min() > 0


def test_methods_and_forms_of_the_bodies_agree() -> None:
    forces = []
    for method, surface in (
        ("condensed-newton", "condensed"), ("surface-uzawa", "condensed"), ("surface-uzawa", "matrix-free"),
        ("gram-uzawa", "condensed"), ("tangent-cg", "matrix-free"), ("block-uzawa", ""),
        ("perturbed-lagrangian", "condensed"), ("nsgs", "condensed"),
    ):  # fmt: skip
        solver = {"method": method, "tolerance": 1e-10} | ({"surface": surface} if surface else {})
        coarse = {"mesh_size": 0.34}  # as coarse as it can be and have points that stick
        (step,) = stickslip.prepare(block("3d", 1, wood("3d"), solver=solver, geometry=coarse)).steps()
        forces.append(step.contacts["base"].force)
    assert_allclose(forces, np.broadcast_to(forces[0], np.shape(forces)), rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize("order", [1, 2])
def test_stated_errors_are_as_large_as_true_ones(order: Literal[1, 2]) -> None:
    """The ready scene `spruce` when it is pressed, against a mesh six times as fine."""
    words = [f"geometry.order={order}", "steps.end=1.0", "steps.count=1", "solver.tolerance=1e-10"]
    fine = stickslip.prepare(read("spruce", [*words, "geometry.order=2", "geometry.mesh_size=0.00125"]))
    simulation = stickslip.prepare(read("spruce", [*words, "geometry.mesh_size=0.0075"]))
    (exact,), steps = fine.steps(), [*simulation.steps()]
    stated = simulation.errors(steps)[-1][Quantity("contacts", "base", "tangential_force")].mesh
    true = abs(steps[-1].contacts["base"].tangential_force - exact.contacts["base"].tangential_force)
    assert 0.4 * true < stated < 3 * true  # .6 and 1.2 as measured


def test_a_body_of_two_materials_has_both() -> None:
    """An isotropic and an orthotropic body, the bubbles of both in one form each."""
    scene = to_dict(read("two_blocks", ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25"]))
    answers = []
    for body in ({"E": 200.0, "nu": 0.3}, isotropic(200.0, 0.3, 2)):
        changed = copy.deepcopy(scene)
        changed["bodies"]["lower"] = body
        simulation = stickslip.prepare(from_dict(changed))
        steps = [*simulation.steps()]
        answers.append(
            (steps[-1].displacement, simulation.errors(steps)[-1][Quantity("contacts", "joint", "normal_force")].mesh)
        )
    (u, stated), (same, other) = answers
    assert_allclose(same, u, atol=1e-7 * np.abs(u).max())
    assert other == pytest.approx(stated, rel=1e-4)


@pytest.mark.parametrize("model", ["plane strain", "plane stress", "3d"])
def test_a_shank_of_an_orthotropic_body_shrinks(model: Model) -> None:
    """Held at both ends, its tension is what the supports feel; the audit agrees, and so does the stress."""
    dim = 3 if model == "3d" else 2
    ends = ([0.25, 0.25, 0.25][:dim], [0.75, 0.25, 0.25][:dim])
    held = {side: {"boundary": f"block.{side}", "displacement": {"normal": 0.0}} for side in ("left", "right")}
    corner = {"foot": {"point": [0.0] * dim, "displacement": dict.fromkeys("yz"[: dim - 1], 0.0)}}
    corner |= {"edge": {"point": [0.0, 1.0, 0.0], "displacement": {"z": 0.0}}} if dim == 3 else {}
    bolts = {"bolt": {"body": "block", "shank": ends, "shortening": 0.01}}
    scene = block(model, 1, wood(model), contacts={}, obstacles={}, bolts=bolts, supports=held | corner)
    simulation = stickslip.prepare(scene)
    (step,) = simulation.steps()
    assert max(audit(simulation, step).values()) < 1e-9
    found = Auditor(simulation.problem, simulation.mesh)(replace(record_of(step), stored=stored_by(step)))
    assert found.fields < 1e-12
    assert step.bolts["bolt"].tension == pytest.approx(abs(step.supports["right"].force[0]), rel=1e-9)


def test_the_plan_has_a_row_and_nothing_is_added_without_such_a_body() -> None:
    def row(scene: Scene) -> tuple[bool, str]:
        return next((row.on, row.because) for row in make_plan(scene) if row.effect == "orthotropic")

    assert row(block("3d", 1, wood("3d"))) == (True, "bodies.block.E_1")
    assert row(block("3d", 1, {"E": 1.0, "nu": 0.3})) == (False, "not in the scene")
    assert not stickslip.prepare(read("block", ["geometry.mesh_size=0.5"])).problem.orthotropic


def test_it_survives_the_file_and_other_units() -> None:
    scene = block("3d", 1, wood("3d") | {"density": 2.0})
    assert from_dict(to_dict(scene)) == scene
    body = in_millimetres(scene).bodies["block"]
    assert isinstance(body, Orthotropic)
    own = scene.bodies["block"]
    assert isinstance(own, Orthotropic)
    assert_allclose([body.E_3, body.G_23, body.nu_23], [own.E_3 * 1e-6, own.G_23 * 1e-6, own.nu_23])
    assert body.axis_1 == own.axis_1


def test_expressions_know_its_constants_and_no_others() -> None:
    load = {"loads": {"side": {"boundary": "block.left", "traction": ["1e-3*E_1*y", "nu_12*G_12*1e-3"]}}}
    scene = block("plane strain", 1, wood("plane strain"), **load)
    (step,) = stickslip.prepare(in_millimetres(scene)).steps()
    (same,) = stickslip.prepare(scene).steps()
    assert_allclose(step.displacement, 1e3 * same.displacement, atol=1e-9)
    load["loads"]["side"]["traction"] = ["E*y", 0.0]
    with pytest.raises(SceneError, match=r'loads\.side\.traction\.x = "E\*y": E: this body has E_1, E_2, E_3, G_12'):
        block("plane strain", 1, wood("plane strain"), **load)
    load["loads"]["side"]["traction"] = ["G_12*y", 0.0]
    with pytest.raises(SceneError, match=r"G_12: this body has E, nu"):
        block("plane strain", 1, {"E": 1.0, "nu": 0.3}, **load)


def test_heat_by_axis_is_of_orthotropic_bodies() -> None:
    heat = {"thermal": {"block": {"expansion": [1e-5, 2e-5, 3e-5], "temperature": 1.0}}}
    block("plane strain", 1, wood("plane strain"), **heat)
    with pytest.raises(SceneError, match=r"block\.expansion = \[.*\]: expected a number; the body has no axes"):
        block("plane strain", 1, {"E": 1.0, "nu": 0.3}, **heat)
    heat["thermal"]["block"]["expansion"] = [1e-5, 2e-5]
    with pytest.raises(SceneError, match=r"thermal\.block\.expansion = .*: expected three, along the axes 1, 2, 3"):
        block("plane strain", 1, wood("plane strain"), **heat)


def test_a_body_that_hardly_changes_its_volume_is_warned_about_and_not_averaged() -> None:
    """As nearly incompressible as nu = .4975; order 2 does not lock."""
    stiff = isotropic(1.0, 0.4975, 2)
    (said,) = warnings(block("plane strain", 1, stiff))
    assert "bodies.block.nu_12 = 0.4975" in said
    assert "set geometry.order = 2" in said
    assert not warnings(block("plane strain", 2, stiff))
    assert not warnings(block("plane stress", 1, stiff))
    assert not stickslip.prepare(block("plane strain", 1, stiff)).problem.averaged
    body = block("plane strain", 1, stiff).bodies["block"]
    assert body.near_incompressible == pytest.approx(0.4975)


def test_python_has_it_too() -> None:
    body = stickslip.Orthotropic(**WOOD, axis_1=np.array([0.0, 2.0]))
    assert_allclose(body.axes, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert not isinstance(body, Material)
    with pytest.raises(SceneError, match=r"E_2 = -1\.0: must be positive, in pascal"):
        stickslip.Orthotropic(**WOOD | {"E_2": -1.0})


def test_shear_moduli_of_a_plane_do_not_do_in_space() -> None:
    with pytest.raises(SceneError, match=r"bodies\.block\.G_13: missing, an orthotropic body in 3D needs it"):
        block("3d", 1, WOOD | {"G_23": 0.1})
