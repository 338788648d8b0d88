"""Thermal expansion: stress, energy and audit are exact where the bodies are free, and where they are held."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit, solved
from stickslip.geometry.errors import SceneError
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.steps_csv import read_steps_table
from stickslip.workflows.pictures.force_displacement import from_rest
from stickslip.workflows.pictures.history import panels_of
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict
from stickslip.workflows.writers.steps_table import steps_row

E, NU, ALPHA, T = 200.0, 0.3, 1e-3, 20.0
BODY = {"block": {"E": E, "nu": NU}}
WARM = {"thermal": {"block": {"expansion": ALPHA, "temperature": T}}}
LAME_LAMBDA, LAME_MU = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
EXACT = 1e-10  # uniform strains: order 1 is exact
MODELS = ("plane strain", "plane stress", "axisymmetric", "3d")
SIDES = {"plane strain": ("left", "bottom"), "axisymmetric": ("bottom",), "3d": ("left", "front", "bottom")}
AXES = {"left": "x", "right": "x", "front": "y", "back": "y"}


def axis_of(side: str, model: str) -> str:
    return AXES.get(side, "z" if model == "3d" else "y")


def scene(model: str, held: tuple[str, ...], **tables: Any) -> Scene:
    """A block 2 x 1 (x 1) whose sides `held` do not move along their normals."""
    geometry = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5}
    supports = {side: {"boundary": f"block.{side}", "displacement": {axis_of(side, model): 0.0}} for side in held}
    if model == "3d":
        geometry["width"] = 1.0
    data = {"model": model, "geometry": geometry, "bodies": BODY, "supports": supports} | WARM | tables
    return from_dict(data)


def free(model: str) -> Scene:
    return scene(model, SIDES.get(model, ("left", "bottom")))


def clamped(model: str) -> Scene:
    every = {"3d": ("left", "right", "front", "back", "bottom", "top"), "axisymmetric": ("right", "bottom", "top")}
    return scene(model, every.get(model, ("left", "right", "bottom", "top")))


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
        assert max(audit(simulation, step).values()) < EXACT


def test_supports_carry_what_the_heat_presses() -> None:
    _, (step,) = solved(clamped("plane strain"))
    pressure = E / (1 - 2 * NU) * ALPHA * T
    assert_allclose(step.supports["top"][0][1], -2.0 * pressure, rtol=EXACT)
    assert_allclose(step.supports["right"][0][0], -1.0 * pressure, rtol=EXACT)


def test_a_warm_block_closes_its_gap_and_presses_on_the_foundation() -> None:
    """A column held at its sides and top, over a gap: M (alpha T (1 + nu)/(1 - nu) - g) is the pressure, M = 2G + L."""
    gap = 0.004
    found = scene(
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
    found = scene("plane strain", ("left", "right", "bottom", "top"), thermal=warm, steps={"end": 1.0, "count": 2})
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
        found = scene("plane strain", ("left", "right", "top"), **tables, solver={"method": method})
        simulation, (step,) = solved(found)
        force[method] = step.contacts["base"].normal_force
        assert audit(simulation, step)["equilibrium"] < 1e-8
    assert force["condensed-newton"] > 1.0
    assert force["regularised"] == pytest.approx(force["condensed-newton"], rel=1e-3)


def test_a_history_of_temperatures_is_drawn(tmp_path: Path) -> None:
    warm = {"block": {"expansion": ALPHA, "temperature": [[0.0, 0.0], [1.0, T], [2.0, 0.0]]}}
    found = scene("plane strain", ("left", "right", "bottom", "top"), thermal=warm, steps={"end": 2.0, "count": 4})
    outcome, _ = run(found, tmp_path / "out")
    assert outcome.exit_code == 0
    assert (tmp_path / "out" / "history.png").stat().st_size > 0
    labels = [label for label, _ in panels_of(found, from_rest(read_steps_table(tmp_path / "out")))]
    assert "temperature [K]" in labels


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            {"blok": {"expansion": 1e-5, "temperature": 1.0}},
            r"thermal\.blok: no such body in the geometry; did you mean block\?",
        ),
        ({"block": {"expansion": 1e-5}}, r"thermal\.block\.temperature: missing"),
        ({"block": {"expansion": 1e-5, "temperature": []}}, r"thermal\.block\.temperature = \[\]: a table needs"),
        ({"block": {"expansion": 1e-5, "temprature": 1.0}}, r"thermal\.block\.temprature: unknown key"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(table: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene("plane strain", ("left", "bottom"), thermal=table)
