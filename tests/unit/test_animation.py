"""animation.gif: made of the steps' files, with one scale for all frames; on request only."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

import stickslip
from stickslip.geometry.errors import MachineError
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.formats.steps import write_step
from stickslip.workflows.pictures.animation import animate, close_up, frames, palette, survey
from stickslip.workflows.pictures.sheet import STATUS_COLOURS
from stickslip.workflows.pictures.view import View
from stickslip.workflows.run.run import run

COARSE = ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=0.5", "steps.count=4"]


def written(scene: stickslip.Scene, folder: Path) -> tuple[Simulation, list[stickslip.StepResult]]:
    """The scene's steps in their files."""
    simulation = stickslip.prepare(scene)
    steps = list(simulation.steps())
    for index, step in enumerate(steps, start=1):
        write_step(folder, index, step)
    return simulation, steps


def opened(path: Path) -> Any:
    """A film; Pillow's own types do not know its frames."""
    return Image.open(path)


def seen(picture: Image.Image, status: int) -> int:
    """How many pixels have the colour of a contact's status."""
    pixels = np.asarray(picture.convert("RGB"), int)
    return int((np.abs(pixels - np.round(255 * np.array(to_rgb(STATUS_COLOURS[status])))).max(axis=-1) < 12).sum())


def test_a_frame_for_rest_and_one_for_each_step(tmp_path: Path) -> None:
    sets = [*COARSE, "steps.count=2", "contacts.base.friction.mu=0.05"]  # all slips in the end
    scene = stickslip.read("block", sets)
    simulation, steps = written(scene, tmp_path)
    path = animate(tmp_path, scene, simulation.data, len(steps))
    assert [p.name for p in tmp_path.glob("*.*")] == [path.name] == ["animation.gif"]
    with opened(path) as film:
        assert film.n_frames == 3
        assert film.info["loop"] == 0
        found, shown = [], []
        for k in range(film.n_frames):
            film.seek(k)
            found.append(film.info["duration"])
            shown.append([seen(film, status) for status in (0, 1, 2)])
    assert found == [500] * 2 + [1500]
    least = [min(counts) for counts in zip(*shown, strict=True)]  # of the legend alone
    line = [np.array(counts) - least for counts in shown]
    assert np.argmax(line[0]) == 0  # open at rest
    assert np.argmax(line[-1]) == 1  # slips in the end
    assert line[-1][1] > 300  # a line across the sheet


def test_one_scale_of_colours_and_one_window_serve_all_frames(tmp_path: Path) -> None:
    scene = stickslip.read("block", COARSE)
    simulation, steps = written(scene, tmp_path)
    mesh = simulation.data
    course = survey(tmp_path, mesh, [1, 2, 3, 4])
    assert course.norm.vmin == 0.0
    assert course.norm.vmax == max(step.von_mises.max() for step in steps)
    assert course.scale == 1.0
    left, right, bottom, top = course.view.extent
    for step in steps:
        x, y = (mesh.points + step.displacement).T
        assert left < x.min() < x.max() < right
        assert bottom < y.min() < y.max() < top
    rest, *moved = frames(tmp_path, mesh, [2, 4])
    assert rest.time == 0.0
    assert not rest.displacement.any()
    assert not rest.von_mises.any()
    assert [frame.time for frame in moved] == [steps[1].time, steps[3].time]
    assert_array_equal(moved[1].von_mises, steps[3].von_mises)
    assert_array_equal(moved[1].status["base"], steps[3].contacts["base"].status)


def test_many_steps_are_thinned_out_and_what_is_small_is_magnified(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = stickslip.read("block", COARSE)
    top = replace(scene.supports["top"], displacement={"x": 0.0, "y": -1e-6})
    scene = replace(scene, supports={"top": top})
    simulation, steps = written(scene, tmp_path)
    monkeypatch.setattr("stickslip.workflows.pictures.animation.FRAMES", 2)
    with opened(animate(tmp_path, scene, simulation.data, len(steps))) as film:
        assert film.n_frames == 1 + 2
    course = survey(tmp_path, simulation.data, [1, 4])
    assert course.scale == 200_000  # of 1e-6 m on 4 m, to some 8 %: 0.2 m
    assert course.view.extent[2] > -0.5


def test_a_solid_shows_its_contacts_beside_it(tmp_path: Path) -> None:
    scene = stickslip.read("cube", ["geometry.mesh_size=0.5"])
    simulation, steps = written(scene, tmp_path)
    with opened(animate(tmp_path, scene, simulation.data, len(steps))) as film:
        assert film.n_frames == len(steps) + 1
        film.seek(0)
        at_rest = seen(film, 0)
        film.seek(len(steps))
        assert seen(film, 0) < at_rest - 5000  # the map of the contact was open, and is no more
        assert max(seen(film, 1), seen(film, 2)) > 5000


def test_what_touches_is_shown_closely_if_it_is_small() -> None:
    view = View.facing(np.array([[0.0, 0.0, 0.0], [4.0, 2.0, 0.0]]))
    small = np.array([[1.0, 0.0, 0.0], [1.4, 0.1, 0.0]])
    close = close_up(view, small)
    assert close is not None
    assert_allclose(close.extent, [0.8, 1.6, -0.35, 0.45])  # 0.4 m, and half of that on every side
    assert close_up(view, small * [4.0, 1.0, 1.0]) is None
    assert close_up(view, small[:1]) is close_up(view, small[:0]) is None


def test_of_two_bodies_that_touch_the_slave_is_followed() -> None:
    scene = stickslip.read(
        "two_blocks", ["geometry.mesh_size=0.5", "geometry.lower_mesh_size=0.5", "geometry.contact_mesh_size=0.5"]
    )
    mesh = stickslip.prepare(scene).data
    ((name, contact),) = scene.contacts.items()
    own = np.unique(mesh.cells[mesh.body == mesh.bodies.index(contact.surface.split(".")[0])])
    assert np.isin(mesh.slaves[name], own).all()
    assert_array_equal(mesh.points[mesh.slaves[name]], mesh.surfaces[name][0])
    assert len(np.unique(mesh.slaves[name])) == len(mesh.slaves[name])


@pytest.mark.parametrize("solid", [False, True])
def test_colours_are_those_of_the_scale(solid: bool) -> None:
    strip = np.round(255 * colormaps["viridis"](np.linspace(0, 1, 500))[None, :, :3]).astype(np.uint8)
    shown = Image.fromarray(strip).quantize(palette=palette(solid), dither=Image.Dither.NONE).convert("RGB")
    assert_allclose(np.asarray(shown, int), strip.astype(int), atol=8)  # 3 % of 255


def test_a_step_that_cannot_be_read_is_said(tmp_path: Path) -> None:
    scene = stickslip.read("block", COARSE)
    simulation, _ = written(scene, tmp_path)
    (tmp_path / "steps" / "000003.h5").unlink()
    with pytest.raises(MachineError, match=r"000003\.h5"):
        animate(tmp_path, scene, simulation.data, 4)
    assert not (tmp_path / "animation.gif").exists()


def test_a_run_animates_on_request_only(tmp_path: Path) -> None:
    plain = ["output.pictures=false", "output.error=false", "steps.count=1"]
    run(stickslip.read("block", [*COARSE, *plain]), tmp_path / "off")
    run(stickslip.read("block", [*COARSE, *plain, 'output.animation="gif"']), tmp_path / "on")
    off, on = ({path.name for path in (tmp_path / name).iterdir()} for name in ("off", "on"))
    assert on - off == {"animation.gif"}
    with pytest.raises(stickslip.StickslipError, match=r"output\.animation"):
        stickslip.read("block", ['output.animation="film"'])
