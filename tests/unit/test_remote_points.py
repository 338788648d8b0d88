"""Points coupled to sides, rigid or distributing: beams, columns, rigid motions, shared nodes, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.quantities import values
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan, planned
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.scene_file.read import from_dict
from stickslip.workflows.verification.prepared import prepare

E, LENGTH, ARM = 1000.0, 10.0, 2.0
FX, FY, MZ = 0.02, 0.01, 0.03
MU = {"law": "coulomb", "mu": 0.3}


def scene(points: dict[str, Any], model: str = "plane strain", order: int = 1, **tables: Any) -> Scene:
    """A bar 10 x 1 (x 1), nu = 0; its left end is held."""
    size = {"length": LENGTH, "height": 1.0, "mesh_size": 0.5, "order": order}
    axes = "xyz" if model == "3d" else "xy"
    data = {
        "model": model,
        "geometry": {"builder": "block", **size, **({"width": 1.0} if model == "3d" else {})},
        "bodies": {"block": {"E": E, "nu": 0.0, "density": 1.0}},
        "supports": {"left": {"boundary": "block.left", "displacement": dict.fromkeys(axes, 0.0)}},
        "remote_points": points,
    }
    return from_dict(data | tables)


def end(model: str = "plane strain", coupling: str = "rigid", **given: Any) -> dict[str, Any]:
    """A point beyond the right end, on the bar's axis."""
    across = [0.5, 0.5] if model == "3d" else [0.5]
    return {"p": {"boundary": "block.right", "point": [LENGTH + ARM, *across], "coupling": coupling, **given}}


def solved(scene: Scene, tolerance: float = 1e-9) -> tuple[Simulation, StepResult]:
    simulation = prepare(scene)
    *_, step = simulation.steps()
    assert step.energy.external == pytest.approx(step.energy.stored + step.energy.contact, rel=1e-8, abs=1e-14)
    assert max(audit(simulation, step).values()) < tolerance
    return simulation, step


@pytest.mark.parametrize("coupling", ["rigid", "distributing"])
@pytest.mark.parametrize("model", ["plane strain", "3d"])
def test_a_force_beside_a_beam_bends_and_pulls_it(model: str, coupling: str) -> None:
    """Bernoulli's beam with Timoshenko's shear, under a force and a moment at an arm; order 2 is nearly exact."""
    up, about = ("z", "y") if model == "3d" else ("y", "z")
    turn = -1.0 if model == "3d" else 1.0  # x towards z turns about -y
    given = {"force": {"x": FX, up: FY}, "moment": {about: turn * MZ}}
    _, step = solved(scene(end(model, coupling, **given), model, order=2), 1e-8)
    bend, shear = E / 12, 5 / 6 * E / 2
    moment = MZ + FY * ARM
    slope = FY * LENGTH**2 / (2 * bend) + moment * LENGTH / bend
    sag = FY * LENGTH**3 / (3 * bend) + moment * LENGTH**2 / (2 * bend) + FY * LENGTH / shear
    point, last = step.remote_points["p"], -1 if model == "3d" else 1
    assert_allclose(point.displacement[[0, last]], [FX * LENGTH / E, sag + ARM * slope], rtol=2e-3)
    assert_allclose(np.abs(point.rotation).max(), slope, rtol=2e-3)
    assert_allclose(step.supports["left"].force[[0, last]], [-FX, -FY], rtol=1e-8)
    assert_allclose([point.force[0], point.force[last]], [FX, FY], rtol=1e-12)


def test_a_rigid_side_moves_as_prescribed_and_states_its_reaction() -> None:
    """Pulled by u, turned by w about its end's centre: N = E u / L, M = 4 E I w / L, Q = 6 E I w / L²."""
    given = {"displacement": {"x": 1e-3, "y": 0.0}, "rotation": {"z": 2e-3}}
    simulation, step = solved(scene({"p": {**end(**given)["p"], "point": [LENGTH, 0.5]}}, order=2))
    point, right = step.remote_points["p"], simulation.data.points[:, 0] > LENGTH - 1e-9
    x, moved = simulation.data.points[right], step.displacement[right]
    assert_allclose(moved, np.stack([1e-3 - 2e-3 * (x[:, 1] - 0.5), 0 * x[:, 1]], axis=1), atol=1e-15)
    assert_allclose(point.displacement, [1e-3, 0.0], atol=1e-15)
    assert_allclose(point.rotation, [2e-3], rtol=1e-10)
    soft = 12 * (E / 12) / (5 / 6 * E / 2 * LENGTH**2)  # share of shear
    bend = E / 12 * 2e-3 / LENGTH / (1 + soft)
    assert_allclose(point.force, [E * 1e-3 / LENGTH, -6 * bend / LENGTH], rtol=2e-3)
    assert_allclose(point.moment, [(4 + soft) * bend], rtol=2e-3)
    assert_allclose(point.force, -step.supports["left"].force, rtol=1e-8)
    assert values(step)["remote_point.p.force.x"] == point.force[0]


def test_what_is_free_of_a_rigid_side_follows_what_is_prescribed() -> None:
    """Turned by a moment with x prescribed at an arm: as the same side under the reaction that is reported."""
    _, one = solved(scene(end(displacement={"x": 1e-3}, force={"y": FY}, moment={"z": MZ})))
    force, moment = one.remote_points["p"].force, one.remote_points["p"].moment
    _, two = solved(scene(end(force={"x": float(force[0]), "y": float(force[1])}, moment={"z": float(moment[0])})))
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
    _, step = solved(scene(end(force={"x": FX, "y": FY}), **tables))
    point = step.remote_points["p"]
    assert_allclose(point.displacement[0], FX * LENGTH / E, rtol=1e-8)
    assert_allclose(step.supports["base"].force[1], -FY, rtol=1e-8)
    assert_allclose(step.supports["left"].force[0], -FX, rtol=1e-8)
    assert_allclose(
        step.supports["left"].moment + step.supports["base"].moment, -FY * (LENGTH + ARM) + FX * 0.5, rtol=1e-8
    )


@pytest.mark.parametrize("surface", ["condensed", "matrix-free"])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("model", ["plane strain", "3d", "axisymmetric"])
def test_a_rigid_lid_presses_a_column(model: str, order: int, surface: str) -> None:
    """E A u / h, with friction that carries nothing; nu = 0."""
    last = "z" if model == "3d" else "y"
    up = [0.0, 0.0, 1.0] if model == "3d" else [0.0, 1.0]
    tables: dict[str, Any] = {
        "geometry": {"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 0.5, "order": order}
        | ({"width": 1.0} if model == "3d" else {}),
        "supports": {},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0] * len(up), "normal": up}},
        "contacts": {
            "base": {"surface": "block.bottom", "against": "floor", "friction": {"law": "coulomb", "mu": 0.3}}
        },
        "solver": {"method": "surface-uzawa", "surface": surface},
    }
    given: dict[str, Any] = {"displacement": {last: -1e-3}}
    if model != "axisymmetric":
        given |= {"force": {"x": 0.0}, "rotation": {"z": 0.0} if model == "plane strain" else dict.fromkeys("xyz", 0.0)}
    point = {"boundary": "block.top", "point": [0.3] * len(up), "coupling": "rigid", **given}
    _, step = solved(scene({"p": point}, model, **tables), 1e-6)
    area = np.pi if model == "axisymmetric" else 1.0
    assert_allclose(step.remote_points["p"].force[-1], -E * 1e-3 * area, rtol=1e-6)
    assert_allclose(step.contacts["base"].normal_force, E * 1e-3 * area, rtol=1e-6)


def test_prescribed_motion_holds_a_body() -> None:
    every = {"displacement": {"x": 1e-3, "y": 0.0}, "rotation": {"z": 1e-3}}
    free = scene(end(**every), supports={})
    assert planned(free).rigid_modes.shape == (3, 0)
    _, step = solved(free)
    assert step.energy.stored < 1e-20
    assert_allclose(step.remote_points["p"].force, 0.0, atol=1e-12)
    with pytest.raises(SceneError, match=r"supports: nothing resists the rotation"):
        make_plan(scene(end(displacement={"x": 0.0, "y": 0.0}), supports={}))


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
        (
            {"force": {"x": 1.0}, "displacement": {"x": 0.0}},
            r"\.p\.force\.x: displacement\.x is prescribed too",
        ),
        ({"moment": {"z": 1.0}, "rotation": {"z": 0.0}}, r"remote_points\.p\.moment\.z: rotation\.z is prescribed too"),
        (
            {"coupling": "distributing", "displacement": {"x": 0.0}},
            r"remote_points\.p\.displacement: a distributing coupling takes force and moment; set coupling = rigid",
        ),
        ({"torque": 1.0}, r"remote_points\.p\.torque: unknown key"),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(point: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        make_plan(scene({"p": {**end()["p"], **point}}))


def test_what_only_the_mesh_shows_is_refused() -> None:
    uneven = {"s": {"boundary": "block.right", "displacement": {"y": "1e-3*y**2"}}}
    left = {"boundary": "block.left", "displacement": {"x": 0.0, "y": 0.0}}
    for tables, message in (
        (FLOOR, r"remote_points\.p\.boundary = block\.right: has nodes in common with block\.bottom, a contact"),
        ({"supports": uneven | {"left": left}}, r"remote_points\.p: supports\.s cannot hold on its side, .* at t = 1"),
    ):
        with pytest.raises(SceneError, match=message):
            prepare(scene(end(), **tables))
