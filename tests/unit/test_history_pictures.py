"""Pictures over time: curves of a history, and loops of force and displacement."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.image import imread
from numpy.testing import assert_array_equal
from scipy.integrate import trapezoid

import stickslip
from shared.images import colours
from stickslip.geometry.arrays import Array
from stickslip.workflows.pictures.draw import draw_course
from stickslip.workflows.pictures.force_displacement import (
    Panel,
    _draw,
    draw_loops,
    driving,
    from_rest,
    largest,
    sliding,
)
from stickslip.workflows.pictures.history import draw_history, errors_of, most, panels_of
from stickslip.workflows.pictures.sheet import Sheet
from stickslip.workflows.writers.steps_table import StepsTable
from stickslip.workflows.writers.writer import Job


def circle(count: int = 24) -> tuple[stickslip.Scene, dict[str, Array]]:
    """The block's top goes to and fro: what Coulomb's law makes of it with a stiffness of 2 N/m and mu N = 1 N."""
    scene = stickslip.read("block")
    time = np.arange(1.0, count + 1.0)
    x = np.sin(2 * np.pi * time / 12)
    force, slip = np.zeros(count), np.zeros(count)
    for k in range(count):
        before = slip[k - 1] if k else 0.0
        force[k] = np.clip(2 * (x[k] - before), -1.0, 1.0)
        slip[k] = x[k] - force[k] / 2
    columns = {f"support.top.{key}.{a}": np.zeros(count) for key in ("displacement", "force") for a in "xy"}
    columns |= {f"base.{key}.{a}": np.zeros(count) for key in ("force", "tangential_force", "slip") for a in "xy"}
    columns |= {f"obstacle.foundation.{key}.{a}": np.zeros(count) for key in ("displacement", "force") for a in "xy"}
    columns |= {
        f"energy.{key}": np.linspace(0.0, 9.0, count) for key in ("external", "stored", "contact", "dissipated")
    }
    columns |= {"time": time, "support.top.displacement.x": x, "support.top.force.x": force, "base.slip.x": slip}
    columns |= {"base.tangential_force.x": -force, "base.force.x": -force, "base.force.y": np.full(count, 9.0)}
    columns |= {"base.normal_force": np.full(count, 9.0), "base.tangential_force": abs(force)}
    sticks = np.where(abs(force) < 1, 4.0, 0.0)
    return scene, columns | {"base.stick_area": sticks, "base.slip_area": 4 - sticks}


def test_loops_show_what_drives_and_what_slips_with_their_signs() -> None:
    scene, columns = circle()
    steps = from_rest(columns)
    assert steps["time"][0] == steps["base.slip.x"][0] == 0.0
    (pushed,) = largest([panel for panel in driving(scene, steps) if np.ptp(panel.x) > 0])
    assert (pushed.title, pushed.x_label, pushed.y_label) == ("support top", "displacement, x [m]", "force, x [N/m]")
    (slipping,) = sliding(scene, steps)
    assert slipping.y_label == "friction on foundation, x [N/m]"
    assert slipping.y.min() == -1.0
    assert slipping.y.max() == 1.0
    second = slice(12, 25)  # the second cycle is closed: what the top puts in is what friction takes out
    work = [trapezoid(panel.y[second], panel.x[second]) for panel in (pushed, slipping)]
    assert work[0] > 0
    assert work[0] == pytest.approx(work[1], rel=1e-12)


def test_a_contact_that_only_sticks_or_goes_round_has_no_loop() -> None:
    scene, columns = circle()
    still = columns | {"base.slip.x": 1e-12 * columns["base.slip.x"]}  # things move by 9 J / 9 N = 1 m
    assert not list(sliding(scene, still))
    round_it = columns | {"base.force.y": np.full(24, 5.0)}
    assert not list(sliding(scene, round_it))


def test_a_loop_breaks_where_the_contact_is_open() -> None:
    scene, columns = circle()
    lifted = np.isin(np.arange(24), (5, 6, 12))
    slip = np.where(lifted, np.nan, 0.5 + columns["base.slip.x"])
    force = np.where(lifted, 0.0, columns["base.tangential_force.x"])
    steps = from_rest(columns | {"base.slip.x": slip, "base.tangential_force.x": force})
    (panel,) = sliding(scene, steps)
    assert panel.travel == pytest.approx(np.ptp(np.concatenate([[0.0], slip[~lifted]])))
    sheet = Sheet(3.0, 3.0)
    axes = sheet.axes(0.5, 0.5, 2.0, 2.0)
    _draw(axes, panel, steps["time"], Normalize(0.0, 24.0))
    sheet.pixels()
    (lines,) = (c for c in axes.collections if isinstance(c, LineCollection))
    ends = np.array(lines.get_segments())
    assert len(ends) == 24 - 5  # two pieces about the last one lifted, three about the others
    assert not (ends[1:] == 0.0).all(axis=-1).any()  # none runs back to the origin, where the first begins
    assert_array_equal(lines.get_array(), np.delete(steps["time"][1:], [5, 6, 7, 12, 13]))
    never = columns | {"base.slip.x": np.full(24, np.nan)}
    assert not list(sliding(scene, never))


@pytest.mark.parametrize("width", [4.85, 8.05])  # of one loop, and of history.png
@pytest.mark.parametrize("letters", [0, 5, 60, 80, 110, 500])
def test_a_title_fits_the_sheet_whole_unless_it_is_endless(width: float, letters: int) -> None:
    title = ("A Wide Model " * 50)[:letters].strip()
    sheet = Sheet(width, 3.0)
    sheet.head(title, "caption", 0.95)
    text, caption = sheet.figure.texts
    box, below = (t.get_window_extent(sheet.canvas.get_renderer()) for t in (text, caption))
    assert box.x1 <= width * sheet.dpi
    assert below.y1 <= box.y0
    assert box.y1 <= 3.0 * sheet.dpi
    if letters < 500:
        assert text.get_text().replace("\n", " ") == title
    else:
        assert text.get_text().endswith("…")
        assert text.get_fontsize() > 6  # still legible


def test_a_history_is_drawn(tmp_path: Path) -> None:
    scene, columns = circle()
    drawn = draw_history(tmp_path, scene, columns, "to and fro"), draw_loops(tmp_path, scene, columns, "to and fro")
    assert [path and path.name for path in drawn] == ["history.png", "force_displacement.png"]
    assert all(path and colours(path) > 100 for path in drawn)
    loops = imread(tmp_path / "force_displacement.png")[..., :3]
    late = np.array([253, 231, 37]) / 255  # viridis' last colour: in the colour bar, and where the loops end
    found = np.argwhere(np.abs(loops - late).max(axis=-1) < 0.05)[:, 1]
    assert (found < 0.6 * loops.shape[1]).any()
    assert [label for label, _ in panels_of(scene, columns)] == ["motion [m]", "contact force [N/m]", "energy [J/m]"]
    assert not errors_of(scene, columns)
    known = columns | {"base.normal_force.error": columns["time"], "energy.stored.error": np.nan * columns["time"]}
    assert list(errors_of(scene, known)) == [("contact force [N/m]", "base, normal")]
    (tmp_path / "known").mkdir()
    draw_history(tmp_path / "known", scene, known, "to and fro")
    plain, shaded = (imread(tmp_path / path / "history.png")[..., :3] for path in ("", "known"))
    assert plain.shape == shaded.shape
    assert not np.array_equal(plain, shaded)
    full = dataclasses.replace(scene, model="axisymmetric")
    assert [label for label, _ in panels_of(full, columns)] == ["motion [m]", "contact force [N]", "energy [J]"]


def test_gravity_and_a_given_bound_have_their_curves_also_of_contacts_with_misleading_names() -> None:
    scene, columns = circle()
    bounded = dataclasses.replace(scene.contacts["base"], friction=stickslip.Tresca(bound=((0.0, 2.0), (24.0, 5.0))))
    columns = {name.replace("base.", "load.", 1): values for name, values in columns.items()}
    time = columns["time"]
    columns |= {"contact.load.friction.bound": 2 + time / 8, "gravity.acceleration.x": 0 * time}
    columns |= {"gravity.acceleration.y": -time}
    other = dataclasses.replace(
        scene,
        bodies={"block": stickslip.Material(E=1.0, nu=0.3, density=1.0)},
        contacts={"load": bounded},
        sections={"gravity": stickslip.Gravity(acceleration=(0.0, ((24.0, -24.0),)))},
    )
    panels = dict(panels_of(other, from_rest(columns)))
    assert panels["friction bound [Pa]"]["load"][0] == 2.0  # it begins where the scene says, not at rest
    assert panels["friction bound [Pa]"]["load"][-1] == 5.0
    assert panels["gravity [m/s²]"]["y"][-1] == -24.0
    assert "contact force [N/m]" in panels


def test_a_support_and_an_obstacle_of_one_name_have_a_curve_each() -> None:
    scene, columns = circle()
    columns |= {name.replace("support.top", "support.foundation"): values for name, values in columns.items()}
    same = dataclasses.replace(scene, supports={"foundation": scene.supports["top"]})
    motions = dict(panels_of(same, from_rest(columns)))["motion [m]"]
    assert_array_equal(motions["foundation, x"], from_rest(columns)["support.foundation.displacement.x"])


def test_a_support_by_an_expression_has_no_loop() -> None:
    scene, columns = circle()
    del columns["support.top.displacement.x"]
    assert {panel.title for panel in driving(scene, from_rest(columns))} == {"support top", "obstacle foundation"}


def test_only_the_largest_curves_and_loops_are_drawn() -> None:
    curves = {f"c{k}": np.array([0.0, float(k)]) for k in range(9)}
    assert list(most(curves)) == ["c3", "c4", "c5", "c6", "c7", "c8"]
    panels = [
        Panel(str(k), np.array([0.0, 1.0]), np.array([0.0, swing]), "", "")
        for k, swing in enumerate((3, 1e-9, 5, 4, 4.5))
    ]
    assert [panel.title for panel in largest(panels)] == ["2", "3", "4"]
    assert largest([]) == []


def test_nothing_that_moves_under_a_force_is_no_picture(tmp_path: Path) -> None:
    scene, columns = circle()
    held = columns | {name: 0 * columns[name] for name in ("support.top.displacement.x", "base.slip.x")}
    assert draw_loops(tmp_path, scene, held, "held") is None
    assert not list(tmp_path.iterdir())


def test_a_history_of_a_few_steps_has_no_picture_over_time(tmp_path: Path) -> None:
    scene = stickslip.read(
        "block", ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=0.5", "steps.end=1.5", "steps.count=3"]
    )
    simulation = stickslip.prepare(scene)
    table = StepsTable(Job(folder=tmp_path, scene=scene, mesh=simulation.data, comm=simulation.mesh.comm))
    for index, step in enumerate(simulation.steps(), start=1):
        table.step(index, step)
        drawn = [path.name for path in draw_course(tmp_path, scene)]
        assert drawn == ([] if index < 3 else ["history.png", "force_displacement.png"])
