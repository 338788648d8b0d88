"""Fretting numbers of a cycle: of two cylinders by Cattaneo and Mindlin, of strained columns by hand."""

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.command import result
from shared.problems import on_floor
from stickslip import Output, SceneError
from stickslip.geometry.arrays import Array
from stickslip.solvers.results.fretting import largest_dang_van
from stickslip.workflows.lab.verification.cases import cattaneo
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict, to_dict
from stickslip.workflows.writers.fretting import FrettingCycle

E, NU, A = 1000.0, 0.3, 0.4
PRESS, LEAST, MOST = 2.0, 1e-3, 6e-3  # pressure [Pa], ends of the strain's cycle
QUIET: dict[str, Any] = {"pictures": False, "error": False}


def table(path: Path) -> dict[str, Array]:
    rows = list(csv.DictReader(path.read_text().splitlines()))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def column(model: str, order: int = 1, **output: Any) -> dict[str, Any]:
    """A pressed block of 1 m that slides on a smooth floor as its sides stretch it, along x or all around."""
    there = [[0, 0], [1, LEAST], [2, MOST], [3, LEAST]]
    dim = 3 if model == "3d" else 2
    sides = {"left": {"x": 0.0}, "right": {"x": there}}
    sides |= {"front": {"y": 0.0}, "back": {"y": 0.0}} if dim == 3 else {}
    supports = {side: {"boundary": f"block.{side}", "displacement": given} for side, given in sides.items()}
    load = {"press": {"boundary": "block.top", "pressure": [[0, 0], [1, PRESS]]}}
    asked = {"fretting": {"base": {"cycle": [1.0, 3.0], "dang_van": A}}} | output
    steps, friction = {"end": 3.0, "count": 3}, {"friction": {"law": "coulomb", "mu": 0.0}}
    sizes = {"length": 1.0, "mesh_size": 0.5, "order": order}
    tables = {"supports": supports, "loads": load, "steps": steps, "output": QUIET | asked}
    return on_floor(dim, sizes, {"E": E, "nu": NU}, friction, **tables) | {"model": model}


@pytest.mark.parametrize(
    ("model", "order", "stiffness", "squeezed", "mean"),
    [
        ("plane strain", 1, E / (1 - NU**2), NU / (1 - NU), lambda x: (1 + NU) * (x - PRESS) / 3),
        ("plane stress", 2, E, NU, lambda x: (x - PRESS) / 3),
        ("axisymmetric", 1, E / (1 - NU), NU / (1 - NU), lambda x: (2 * x - PRESS) / 3),
        ("3d", 1, E / (1 - NU**2), NU / (1 - NU), lambda x: (1 + NU) * (x - PRESS) / 3),
    ],
)
def test_a_strained_column_has_its_numbers_by_hand(
    model: str, order: int, stiffness: float, squeezed: float, mean: Any, tmp_path: Path
) -> None:
    run(from_dict(column(model, order)), tmp_path / "out")
    found = table(tmp_path / "out/fatigue_base.csv")
    least, most = (stiffness * strain - squeezed * PRESS for strain in (LEAST, MOST))
    swing = (MOST - LEAST) / 2
    assert_allclose(found["slip_amplitude"], found["x"] * swing, atol=1e-12)
    assert_allclose(found["max_tension"], most, rtol=1e-7)
    assert_allclose(found["swt"], most * swing, rtol=1e-7)
    assert model == "axisymmetric" or np.all(found["swt_x"] == 1.0)
    assert_allclose(found["dang_van"], (most - least) / 4 + A * mean(most), rtol=1e-7)
    stress = table(tmp_path / "out/stress_base.csv")
    assert_allclose(stress["xx"][stress["time"] == 3.0], least, rtol=1e-7)
    assert_allclose(stress["zz" if model == "3d" else "yy"], -PRESS, rtol=1e-7)
    assert_allclose(stress["xy"], 0.0, atol=1e-7)


def test_two_cylinders_slip_and_dissipate_as_cattaneo_and_mindlin_say(tmp_path: Path) -> None:
    """Over a cycle of Q the slip amplitude is the slip of a single push: half of a reversal's, of twice Q and mu."""
    there, down = cattaneo.ASIDE, -cattaneo.DOWN
    scene = cattaneo.scene(cattaneo.Two(), [(0.0, down), (there, down), (-there, down), (there, down)])
    scene = replace(scene, output=Output(**QUIET, audit=False, fretting={"face": FrettingCycle(cycle=(2.0, 4.0))}))
    run(scene, tmp_path / "out")
    found, steps = table(tmp_path / "out/fatigue_face.csv"), result(tmp_path / "out")["steps"]
    E_star, face = cattaneo.hertz.plane_strain(cattaneo.E, cattaneo.NU) / 2, steps[-1]["contacts"]["face"]
    closed = cattaneo.cattaneo(face["normal_force"], face["tangential_force"], cattaneo.R / 2, E_star, cattaneo.MU)
    a, c, p0 = closed.pressed.a, closed.c, closed.pressed.p0

    def slip(x: Array) -> Array:
        """Integral of the difference of the gradients of both sides, 2 mu p0 sqrt(x^2 - c^2) / (a E*), from c on."""
        x = np.maximum(np.abs(x), c)
        return np.asarray(cattaneo.MU * p0 / (a * E_star) * (x * np.sqrt(x**2 - c**2) - c**2 * np.arccosh(x / c)))

    x = found["x"]
    inside = np.abs(x) < a
    # sides are round, a / R = .085, and cells are a / 12
    assert_allclose(found["slip_amplitude"][inside], slip(x[inside]), atol=0.05 * float(slip(np.array(a))))
    assert np.all(found["slip_amplitude"][np.abs(x) < 0.95 * c] < 1e-9)
    weight = table_of_contact(tmp_path / "out/contact_face.csv", len(x))
    dissipated = sum(step["contacts"]["face"]["dissipation"] for step in steps[2:])
    assert_allclose(weight @ found["work"], dissipated, rtol=1e-9)
    at = np.linspace(-a, a, 10001)
    work = 4 * cattaneo.MU * np.mean(closed.pressed.pressure(at) * slip(at)) * 2 * a
    assert_allclose(dissipated, work, rtol=0.02)
    # what the shear leaves along the surface, at both ends of the cycle: that of an ellipse less a smaller one
    stress = table(tmp_path / "out/stress_face.csv")
    swing = (stress["xx"][stress["time"] == 4.0] - stress["xx"][stress["time"] == 3.0]) / 2

    def along(x: Array, width: float) -> Array:
        beyond = np.sqrt(np.maximum((x / width) ** 2 - 1, 0.0))
        return np.asarray(-2 * (x / width - np.sign(x) * beyond))

    near = np.abs(x) < 1.3 * a
    shear = cattaneo.MU * p0 * (along(x, a) - c / a * along(x, c))
    assert_allclose(np.abs(swing)[near], np.abs(shear)[near], atol=0.15 * float(np.abs(shear).max()))


@pytest.mark.parametrize("order", [1, 2])
def test_the_largest_numbers_are_within_their_error_of_the_closed_form(order: Literal[1, 2], tmp_path: Path) -> None:
    """Of Cattaneo and Mindlin: the edge, where most are largest, lies between nodes. No coarser mesh, no error."""
    there, down = cattaneo.ASIDE, -cattaneo.DOWN
    scene = cattaneo.scene(cattaneo.Two(order=order), [(0.0, down), (there, down), (-there, down), (there, down)])
    asked = FrettingCycle(cycle=(2.0, 4.0), dang_van=A)
    rows = {}
    for error in ("rough", False):
        output = Output(**QUIET | {"error": error}, audit=False, fretting={"face": asked})
        run(replace(scene, output=output), tmp_path / str(error))
        lines = csv.DictReader((tmp_path / str(error) / "fretting.csv").read_text().splitlines())
        rows[error] = {line["number"]: line for line in lines}
    face = result(tmp_path / "rough")["steps"][-1]["contacts"]["face"]
    E_star = cattaneo.hertz.plane_strain(cattaneo.E, cattaneo.NU) / 2
    closed = cattaneo.cattaneo(face["normal_force"], face["tangential_force"], cattaneo.R / 2, E_star, cattaneo.MU)
    a, c, p0, mu, nu = closed.pressed.a, closed.c, closed.pressed.p0, cattaneo.MU, cattaneo.NU
    x = np.linspace(c, a, 10001)
    slip = mu * p0 / (a * E_star) * (x * np.sqrt(x**2 - c**2) - c**2 * np.arccosh(x / c))
    work = 4 * mu * closed.pressed.pressure(x) * slip
    tension = 2 * mu * p0 * np.sqrt(1 - (c / a) ** 2)
    exact = {
        "slip_amplitude": slip[-1],
        "work": work.max(),
        "max_shear": mu * closed.pressed.pressure(x)[0],
        "max_tension": tension,
        "swt": tension**2 * (1 - nu**2) / cattaneo.E,
        "dang_van": tension / 2 + A * tension * (1 + nu) / 3,
    }
    for key, value in exact.items():
        found = rows["rough"][key]
        assert abs(float(found["largest"]) - value) < float(found["error"]), key
        assert float(found["error"]) < 0.55 * value, key  # of 12 cells in a: the peaks are a cell wide
        assert rows[False][key] == {**found, "error": ""}


def table_of_contact(path: Path, nodes: int) -> Array:
    """Areas that nodes stand for."""
    rows = csv.DictReader(path.read_text().splitlines())
    return np.array([float(row["weight"]) for row in rows][:nodes])


def test_the_smallest_sphere_is_that_of_a_path_in_two_directions() -> None:
    for count in (3, 24):  # three places: no two of them are as far apart as the sphere is wide
        angle = 2 * np.pi * np.arange(count) / count
        path = np.zeros((count, 1, 3, 3))
        path[:, 0, 0, 1] = path[:, 0, 1, 0] = 5.0 + np.cos(angle)
        path[:, 0, 0, 2] = path[:, 0, 2, 0] = np.sin(angle)
        assert_allclose(largest_dang_van(path, A), 1.0, rtol=1e-2)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"output": {"fretting": {"bas": {"cycle": [1, 2]}}}}, "fretting.bas = given: no contact has this name"),
        ({"output": {"fretting": {"base": {"cycle": [1, 2.5]}}}}, "no step ends at 2.5; nearest"),
        ({"output": {"fretting": {"base": {"cycle": [2, 1]}}}}, "cycle = .*must be two times"),
        ({"output": {"fretting": {"base": {"cycle": [1, 2], "dang_van": -1.0}}}}, "dang_van = -1.0: must not be neg"),
        ({"output": {"fretting": {"base": {"cycle": [1, 3]}}, "every": 3, "step_files": "every"}}, "leaves out fields"),
        ({"thermal": {"block": {"expansion": 1e-5, "temperature": 10.0}}}, "body block expands or is a bolt"),
        ({"contacts": {"base": {"surface": "block.bottom", "against": "floor"}}}, "the contact has no friction"),
    ],
)
def test_what_has_no_such_numbers_is_refused_in_a_line(change: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=said):
        run(from_dict(column("plane strain") | change), tmp_path / "out")


def test_a_scene_keeps_what_it_asks_for_and_one_that_asks_for_nothing_has_no_table(tmp_path: Path) -> None:
    scene = from_dict(column("plane strain"))
    assert from_dict(to_dict(scene)) == scene
    run(from_dict(column("plane strain", fretting={})), tmp_path / "out")
    assert not [*(tmp_path / "out").glob("fatigue_*")]
