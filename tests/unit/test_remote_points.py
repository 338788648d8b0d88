"""Points coupled to sides, rigid or distributing: beams, columns, rigid motions, shared nodes, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit
from shared.cases import every_nth
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.step_result import StepResult, values
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan, planned
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.lab.verification.cases import beam as case
from stickslip.workflows.lab.verification.cases.beam import ARM, FX, FY, LENGTH, MZ, E, end, scene
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.prepared import prepare

MU = {"law": "coulomb", "mu": 0.3}


def solved(scene: Scene, tolerance: float = 1e-9) -> tuple[Simulation, StepResult]:
    simulation = prepare(scene)
    *_, step = simulation.steps()
    assert step.energy.external == pytest.approx(step.energy.stored + step.energy.contact, rel=1e-8, abs=1e-14)
    assert max(audit(simulation, step).values()) < tolerance
    return simulation, step


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
    simulation = prepare(scene({"p": given}, geometry=size, **({} if held else {"supports": {}})))
    (step,) = simulation.steps()
    assert_allclose(step.remote_points["p"].rotation, 1e-3, rtol=1e-12)
    assert_allclose(step.remote_points["p"].displacement, 0.0, atol=1e-15 * length)
    if not held:
        x, y = simulation.data.points[:, :2].T
        rigid = 1e-3 * np.stack([0.5 * length - y, x - length], axis=1)
        assert_allclose(step.displacement[:, :2], rigid, atol=1e-15 * length)


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


@pytest.mark.parametrize(
    ("model", "order", "surface"),
    every_nth(2, ["plane strain", "3d", "axisymmetric"], [1, 2], ["condensed", "matrix-free"]),
)
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
