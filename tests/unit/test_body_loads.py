"""Loads of the volume: forces by expression, rotation, and the heat of bodies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit, record_of, solved, stored_by
from shared.failures import failures
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.csv_tables import read_steps_table
from stickslip.workflows.lab.verification.cases import by_place as case
from stickslip.workflows.lab.verification.cases import warm_bars as fields_case
from stickslip.workflows.lab.verification.cases.warm_bars import scene as field_scene
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.pictures.force_displacement import from_rest
from stickslip.workflows.pictures.history import panels_of
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict
from stickslip.workflows.writers.tables import steps_row

E, NU = 200.0, 0.3
HELD = {"left": {"boundary": "block.left", "displacement": {"x": 0.0, "y": 0.0}}}
RHO = 3.0
DENSE = {"block": {"E": 1e3, "nu": 0.3, "density": RHO}}


def block(model: str, supports: dict[str, Any], **tables: Any) -> Scene:
    """A block 2 x 1 (x 1)."""
    width = {"width": 1.0} if model == "3d" else {}
    geometry = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5} | width
    data = {"model": model, "geometry": geometry, "bodies": {"block": {"E": E, "nu": NU}}, "supports": supports}
    return from_dict(data | tables)


def scene(model: str = "plane strain", **tables: Any) -> Scene:
    """A block that is held at its left side, a body of revolution at its bottom."""
    side, axes = ("bottom", "y") if model == "axisymmetric" else ("left", "xyz"[: 3 if model == "3d" else 2])
    held = {"left": {"boundary": f"block.{side}", "displacement": dict.fromkeys(axes, 0.0)}}
    return block(model, **{"supports": held} | tables)


def test_loads_and_displacements_follow_expressions() -> None:
    for simulation, steps, checks in case.problems():
        assert not failures(checks)
        for step in steps:
            assert max(audit(simulation, step).values()) < 1e-10
            assert step.energy.external == pytest.approx(step.energy.stored, rel=1e-10)


def test_in_3d_and_around_an_axis() -> None:
    force = {"block": {"force": ["x*y*z", 0.0, "z"]}}
    _, (step,) = solved(scene("3d", body_force=force))
    assert_allclose(step.supports["left"][0], [-2 * 0.25, 0.0, -1.0], rtol=1e-10, atol=1e-12)
    _, (step,) = solved(scene("axisymmetric", body_force={"block": {"force": [0.0, "x*y"]}}))
    assert_allclose(step.supports["left"][0][1], -2 * np.pi * 8 / 3 / 2, rtol=1e-10)


def test_a_sine_that_ends_at_zero_contradicts_no_support() -> None:
    supports = HELD | {"top": {"boundary": "block.top", "displacement": {"x": "1e-3*sin(pi*x)", "y": "1e-3*sin(pi*x)"}}}
    supports |= {"right": {"boundary": "block.right", "displacement": {"x": 0.0}}}
    _, (step,) = solved(scene(supports=supports))
    assert np.abs(step.displacement).max() > 0.9e-3


def test_the_start_is_solved_if_an_expression_is_not_zero_there() -> None:
    cosine, sine = ({"block": {"force": [f"x*{name}(t)", 0.0]}} for name in ("cos", "sin"))
    assert scene(body_force=cosine).requested_times() == (0.0, 1.0)
    assert scene(body_force=sine).requested_times() == (1.0,)


def test_a_script_repeats_them() -> None:
    tables: dict[str, Any] = {"body_force": {"block": {"force": ["x", "0.1*t"]}}, "steps": {"end": 2.0}}
    right = {"right": {"boundary": "block.right", "displacement": {"y": 0.0}}}
    script = prepare(scene(supports=HELD | right, **tables)).script()
    script.step(to=0.5, supports={"right": {"y": 1e-3}})
    last = script.step(to=1.0, supports={"right": {"y": 0.0}})
    _, steps = solved(script.scene)
    assert_allclose(steps[-1].displacement, last.displacement, atol=1e-12)
    assert steps[-1].energy.stored == pytest.approx(last.energy.stored, rel=1e-10)
    script.step(to=3.0)
    assert script.scene.requested_times() == (0.5, 1.0, 2.0, 3.0)  # where the ramp ends is hit
    assert scene(**tables).timeline().turns == {0.0, 2.0}


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"body_force": {"blok": {"force": [0.0, 1.0]}}}, r"body_force\.blok: no such body.*did you mean block\?"),
        ({"body_force": {"block": {"force": [1.0]}}}, r"body_force\.block\.force = \[1\.0\]: expected 2 components"),
        ({"body_force": {"block": {"force": ["x+", 0.0]}}}, r'body_force\.block\.force = "x\+": column 3: invalid'),
        ({"body_force": {"block": {"force": [True, 0.0]}}}, r"force\.0 = true: expected a number in N/m³, .*in quotes"),
        ({"body_force": {"block": {"force": [0.0, "z"]}}}, r'body_force\.block\.force\.y = "z": z: a plane model has'),
        (
            {"loads": {"a": {"boundary": "block.top", "pressure": "x*(y"}}},
            r'loads\.a\.pressure = "x\*\(y": column 3: .* never closed',
        ),
        (
            {"loads": {"a": {"boundary": "block.top", "force": ["x", 0.0]}}},
            r"loads\.a\.force\.0 = \"x\": expected a nu",
        ),
        (
            {"supports": {"p": {"point": [0.0, 0.0], "displacement": {"x": "E"}}}},
            r'supports\.p\.displacement\.x = "E": E: no body has it here',
        ),
        *(
            ({"model": model, "bodies": DENSE, "centrifugal": {"speed": 1.0} | keys}, rf"centrifugal{said}")
            for model, keys, said in (
                ("3d", {}, r"\.axis: missing, a 3D model needs it"),
                ("3d", {"axis": [0.0, 0.0, 0.0]}, r"\.axis = .*must not be zero"),
                ("3d", {"axis": [0.0, 1.0]}, r"\.axis = \[0\.0, 1\.0\]: expected 3 components"),
                ("plane strain", {"axis": [0.0, 1.0]}, r"\.axis = .*only a 3D model"),
                ("plane strain", {"point": [0.0]}, r"\.point = \[0\.0\]: expected 2 components"),
                ("axisymmetric", {"point": [0.0, 0.0]}, r"\.point = .*spins about its axis"),
                ("plane strain", {"speed": "t"}, r'\.speed = "t": expected a number'),
            )
        ),
        ({"centrifugal": {"speed": 1.0}}, "centrifugal: no body has a density"),
        (
            {"thermal": {"blok": {"expansion": 1e-5, "temperature": 1.0}}},
            r"thermal\.blok: no such body in the geometry; did you mean block\?",
        ),
        *(
            ({"thermal": {"block": {"expansion": 1e-5} | keys}}, rf"thermal\.block\.{said}")
            for keys, said in (
                ({}, "temperature: missing"),
                ({"temperature": []}, r"temperature = \[\]: a table needs"),
                ({"temprature": 1.0}, "temprature: unknown key"),
            )
        ),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(tables: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene(**tables)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"body_force": {"block": {"force": ["log(-x)", 0.0]}}}, r"body_force\.block\.force\.x: .* no finite value"),
        ({"body_force": {"block": {"force": ["x/(t-1)", 0.0]}}}, r"force\.x: .* no finite value somewhere at t = 1"),
        (
            {"supports": {"left": {"boundary": "block.left", "displacement": {"x": "t/x", "y": 0.0}}}},
            r"supports\.left\.displacement\.x: .* no finite value at the point \(0, ",
        ),
    ],
)
def test_what_has_no_finite_value_is_refused_before_any_solve(tables: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        prepare(scene(**tables))


def spinning(model: str, **centrifugal: Any) -> Scene:
    """A block that is held at its bottom."""
    held = dict.fromkeys("y" if model == "axisymmetric" else "xyz"[: 3 if model == "3d" else 2], 0.0)
    base = {"base": {"boundary": "block.bottom", "displacement": held}}
    return block(model, base, bodies=DENSE, centrifugal=centrifugal, steps={"count": 2})


def test_the_load_is_density_times_speed_squared_times_distance() -> None:
    axis = np.array([1.0, 2.0, 2.0]) / 3
    point = np.array([0.5, -1.0, 0.2])
    arm = np.array([1.0, 0.5, 0.5]) - point
    for model, centrifugal, expected in (
        ("plane strain", {"speed": 2.0, "point": [3.0, 0.0]}, np.array([-2.0, 0.5]) * 2),
        ("plane stress", {"speed": -2.0}, np.array([1.0, 0.5]) * 2),
        ("3d", {"speed": 2.0, "axis": [1.0, 2.0, 2.0], "point": point.tolist()}, 2 * (arm - arm @ axis * axis)),
    ):
        simulation = prepare(spinning(model, **centrifugal))
        for step in simulation.steps():
            pull = RHO * (2.0 * step.time) ** 2 * expected
            assert_allclose(step.supports["base"].force, -pull, rtol=1e-10, atol=1e-12, err_msg=model)
            assert max(audit(simulation, step).values()) < 1e-10
            assert step.energy.external == pytest.approx(step.energy.stored, rel=1e-10)


def test_turns_of_the_speed_are_steps() -> None:
    found = spinning("plane strain", speed=[[0.0, 0.0], [0.3, 2.0], [1.0, 1.0]])
    forces = {step.time: step.supports["base"].force[0] for step in prepare(found).steps()}
    assert sorted(forces) == [0.3, 0.5, 1.0]
    assert_allclose(forces[0.3], 4 * forces[1.0], rtol=1e-10)


ALPHA, T = 1e-3, 20.0
WARM = {"thermal": {"block": {"expansion": ALPHA, "temperature": T}}}
LAME_LAMBDA, LAME_MU = (E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU)))
EXACT = 1e-10  # uniform strains: order 1 is exact
MODELS = ("plane strain", "plane stress", "axisymmetric", "3d")
SIDES = {"plane strain": ("left", "bottom"), "axisymmetric": ("bottom",), "3d": ("left", "front", "bottom")}
AXES = {"left": "x", "right": "x", "front": "y", "back": "y"}


def axis_of(side: str, model: str) -> str:
    return AXES.get(side, "z" if model == "3d" else "y")


def heated(model: str, held: tuple[str, ...], **tables: Any) -> Scene:
    """A block 2 x 1 (x 1) whose sides `held` do not move along their normals."""
    supports = {side: {"boundary": f"block.{side}", "displacement": {axis_of(side, model): 0.0}} for side in held}
    return block(model, supports, **WARM | tables)


def free(model: str) -> Scene:
    return heated(model, SIDES.get(model, ("left", "bottom")))


def clamped(model: str) -> Scene:
    every = {"3d": ("left", "right", "front", "back", "bottom", "top"), "axisymmetric": ("right", "bottom", "top")}
    return heated(model, every.get(model, ("left", "right", "bottom", "top")))


def test_a_free_block_grows_without_stress() -> None:
    for model in MODELS:
        simulation, (step,) = solved(free(model))
        strain = ALPHA * T * (1 + NU if model == "plane strain" else 1)  # out of plane it is held there
        assert_allclose(step.displacement, strain * simulation.data.points, atol=EXACT * strain, err_msg=model)
        sigma = np.zeros((3, 3))
        if model == "plane strain":
            sigma[2, 2] = -E * ALPHA * T
        assert_allclose(step.stress, np.broadcast_to(sigma, step.stress.shape), atol=EXACT * E * ALPHA * T)
        stored = E * (ALPHA * T) ** 2 / 2 * 2.0 if model == "plane strain" else 0.0
        assert step.energy.stored == pytest.approx(stored, abs=EXACT * E * (ALPHA * T) ** 2)
        assert step.energy.external == pytest.approx(step.energy.stored, abs=EXACT * E * (ALPHA * T) ** 2)
        assert max(audit(simulation, step).values()) < EXACT


def test_a_clamped_block_is_pressed_by_its_heat() -> None:
    volume = {"axisymmetric": np.pi * 2.0**2}
    for model in MODELS:
        simulation, (step,) = solved(clamped(model))
        assert_allclose(step.displacement, 0.0, atol=EXACT * ALPHA * T, err_msg=model)
        bulk = E / (1 - 2 * NU) if model != "plane stress" else E / (1 - NU)
        sigma = -bulk * ALPHA * T * np.diag([1.0, 1.0, 0.0 if model == "plane stress" else 1.0])
        assert_allclose(
            step.stress, np.broadcast_to(sigma, step.stress.shape), rtol=EXACT, atol=EXACT * bulk * ALPHA * T
        )
        directions = 2 if model == "plane stress" else 3
        stored = directions * bulk * (ALPHA * T) ** 2 / 2 * volume.get(model, 2.0)
        assert step.energy.stored == pytest.approx(stored, rel=EXACT)
        assert step.energy.external == pytest.approx(stored, rel=EXACT)  # all of it is work of the heat
        if model == "plane strain":  # supports carry what it presses
            assert_allclose(step.supports["top"][0][1], -2.0 * bulk * ALPHA * T, rtol=EXACT)
            assert_allclose(step.supports["right"][0][0], -1.0 * bulk * ALPHA * T, rtol=EXACT)
        assert max(audit(simulation, step).values()) < EXACT


def test_a_warm_block_closes_its_gap_and_presses_on_the_foundation() -> None:
    """A column held at its sides and top, over a gap: M (alpha T (1 + nu)/(1 - nu) - g) is the pressure, M = 2G + L."""
    gap = 0.004
    found = heated(
        "plane strain",
        ("left", "right", "top"),
        obstacles={"ground": {"shape": "plane", "point": [0.0, -gap], "normal": [0.0, 1.0]}},
        contacts={"base": {"surface": "block.bottom", "against": "ground"}},
        steps={"end": 1.0, "count": 4},
    )
    _, steps = solved(found)
    modulus = LAME_LAMBDA + 2 * LAME_MU
    for step in steps:
        grown = ALPHA * T * step.time * (1 + NU) / (1 - NU)
        assert step.contacts["base"].max_pressure == pytest.approx(
            max(modulus * (grown - gap), 0.0), rel=1e-8, abs=1e-9
        )
        balance = step.energy.stored + step.energy.contact
        assert step.energy.external == pytest.approx(balance, rel=EXACT)
    assert steps[0].contacts["base"].max_pressure > 0  # it would not be, without any heat


def test_every_corner_of_the_temperature_is_hit_and_listed() -> None:
    warm = {"block": {"expansion": ALPHA, "temperature": [[0.0, 0.0], [0.37, T], [1.0, -T]]}}
    found = heated("plane strain", ("left", "right", "bottom", "top"), thermal=warm, steps={"end": 1.0, "count": 2})
    _, steps = solved(found)
    assert [step.time for step in steps] == [0.37, 0.5, 1.0]
    bulk = E / (1 - 2 * NU)
    for step, temperature in zip(steps, (T, T - 2 * T * 0.13 / 0.63, -T), strict=True):
        assert steps_row(1, found, step)["thermal.block.temperature"] == pytest.approx(temperature)
        assert_allclose(step.stress[0, 0, 0], -bulk * ALPHA * temperature, rtol=EXACT)
        assert step.energy.external == pytest.approx(step.energy.stored, rel=1e-9)


def test_bodies_have_temperatures_of_their_own() -> None:
    data = {
        "model": "plane strain",
        "geometry": {"builder": "two_blocks", "length": 1.0, "height": 1.0, "mesh_size": 0.5},
        "bodies": {"lower": {"E": E, "nu": NU}, "upper": {"E": E, "nu": NU}},
        "contacts": {"joint": {"surface": "upper.bottom", "against": "lower.top", "normal": {"law": "tied"}}},
        "supports": {
            "left": {"boundary": "lower.left", "displacement": {"x": 0.0}},
            "bottom": {"boundary": "lower.bottom", "displacement": {"y": 0.0}},
        },
    }
    both = {name: {"expansion": ALPHA, "temperature": T} for name in ("lower", "upper")}
    simulation, (step,) = solved(from_dict(data | {"thermal": both}))
    in_plane = step.stress[:, :2, :2]
    assert_allclose(in_plane, 0.0, atol=1e-7 * E * ALPHA * T)
    simulation, (step,) = solved(from_dict(data | {"thermal": {"upper": both["upper"]}}))
    assert np.abs(step.stress[:, :2, :2]).max() > 0.1 * E * ALPHA * T  # the cold one holds the warm one back
    assert step.energy.external == pytest.approx(step.energy.stored + step.energy.contact, rel=1e-8)
    assert max(audit(simulation, step).values()) < 1e-7


def test_regularised_sees_the_heat_too() -> None:
    """Held at its sides and top, warmed against the ground: the force of condensed-newton, but for smoothing."""
    ground = {"ground": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}}
    tables = {"obstacles": ground, "contacts": {"base": {"surface": "block.bottom", "against": "ground"}}}
    force = {}
    for method in ("condensed-newton", "regularised"):
        found = heated("plane strain", ("left", "right", "top"), **tables, solver={"method": method})
        simulation, (step,) = solved(found)
        force[method] = step.contacts["base"].normal_force
        assert audit(simulation, step)["equilibrium"] < 1e-8
    assert force["condensed-newton"] > 1.0
    assert force["regularised"] == pytest.approx(force["condensed-newton"], rel=1e-3)


def test_a_history_of_temperatures_is_drawn(tmp_path: Path) -> None:
    warm = {"block": {"expansion": ALPHA, "temperature": [[0.0, 0.0], [1.0, T], [2.0, 0.0]]}}
    found = heated("plane strain", ("left", "right", "bottom", "top"), thermal=warm, steps={"end": 2.0, "count": 4})
    outcome, _ = run(found, tmp_path / "out")
    assert outcome.exit_code == 0
    assert (tmp_path / "out" / "history.png").stat().st_size > 0
    labels = [label for label, _ in panels_of(found, from_rest(read_steps_table(tmp_path / "out")))]
    assert "temperature [K]" in labels


def test_bars_bend_freely_or_press_and_a_cylinder_and_two_bodies_too() -> None:
    for simulation, steps, checks in fields_case.problems():
        assert not failures(checks)
        auditor = Auditor(simulation.problem, simulation.mesh)
        for step in steps:
            found = vars(auditor(replace(record_of(step), stored=stored_by(step))))
            assert max(found.values()) < 1e-7
            balance = step.energy.stored + step.energy.contact
            assert step.energy.external == pytest.approx(balance, rel=1e-8, abs=1e-12)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"temperature": "20*t"}, r'thermal\.block\.temperature = "20\*t": t: has no place here; give its factor'),
        ({"temperature": "20*z"}, r'thermal\.block\.temperature = "20\*z": z: a plane model has x and y only'),
        ({"temperature": 20.0, "history": 1.0}, r"thermal\.block\.history = given: only of an expression"),
        ({"temperature": "20*q"}, r'thermal\.block\.temperature = "20\*q": '),
    ],
)
def test_a_wrong_field_is_refused_in_one_line(table: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        field_scene("plane strain", table)


def test_a_field_without_a_finite_value_is_refused() -> None:
    with pytest.raises(SceneError, match=r"thermal\.block\.temperature: the expression has no finite value"):
        list(prepare(field_scene("plane strain", "log(x-1)", supports=HELD)).steps())


PLACES = {"inside": {"point": [0.37, 0.29]}, "top": {"point": [1.1, 1.0]}, "axis": {"point": [0.0, 0.4]}}


def warm_column(model: str, order: int, nu: float = NU) -> Scene:
    """A block between walls, pressed by its weight and warmed along its height; its stress is linear in y."""
    up = "z" if model == "3d" else "y"
    sides = {"bottom": up, "left": "x", "right": "x"} | ({"front": "y", "back": "y"} if model == "3d" else {})
    if model == "axisymmetric":
        del sides["left"]
    places = {k: {"point": [p[0], 0.5, p[1]] if model == "3d" else p} for k, v in PLACES.items() for p in [v["point"]]}
    found = block(
        model,
        {k: {"boundary": f"block.{k}", "displacement": {axis: 0.0}} for k, axis in sides.items()},
        bodies={"block": {"E": E, "nu": nu, "density": RHO}},
        gravity={"acceleration": [*[0.0] * (2 if model == "3d" else 1), -1.0]},
        thermal={"block": {"expansion": 1e-2, "temperature": f"1 + 2*{up}"}},
        probes=places,
        output={"pictures": False, "error": False},
    )
    return replace(found, geometry=replace(found.geometry, order=order))


@pytest.mark.parametrize("model", ["plane strain", "3d", "axisymmetric"])
def test_stress_at_a_probe_is_that_of_the_point(model: str) -> None:
    """Order 2 has linear stresses exactly."""
    _, (step,) = solved(warm_column(model, 2))
    for name, place in PLACES.items():
        stress, up = step.probes[name].stress, RHO * (place["point"][1] - 1.0)
        across = NU / (1 - NU) * up - E * 1e-2 * (1 + 2 * place["point"][1]) / (1 - NU)
        expected = [across, across, up] if model == "3d" else [across, up, across]
        assert_allclose(stress, np.diag(expected), atol=1e-9)


def test_stress_at_a_probe_of_order_1_is_recovered() -> None:
    """Means at nodes, taken to the point, are nearer to it than a cell's midpoint is."""
    inside = {f"p{i}": {"point": [0.3 + 0.15 * i, 0.3 + 0.04 * i]} for i in range(10)}
    coarse = replace(warm_column("plane strain", 1), probes=scene(probes=inside).probes)
    simulation, (step,) = solved(replace(coarse, geometry=replace(coarse.geometry, mesh_size=0.125)))
    off = [each.stress[1, 1] - RHO * (inside[name]["point"][1] - 1.0) for name, each in step.probes.items()]
    middles = simulation.data.points[simulation.data.cells].mean(axis=1)
    within = ((middles > 0.25) & (middles < [1.75, 0.75])).all(axis=1)
    of_cells = step.stress[within, 1, 1] - RHO * (middles[within, 1] - 1.0)
    assert np.sqrt(np.mean(np.square(off))) < 0.5 * np.sqrt(np.mean(of_cells**2))


@pytest.mark.parametrize(("order", "nu"), [(1, NU), (2, NU), (2, 0.4999)])
def test_stress_at_a_probe_is_found_again(order: int, nu: float, tmp_path: Path) -> None:
    _, result = run(warm_column("axisymmetric", order, nu), tmp_path)
    assert result["audit"]["numbers"] < 1e-10
