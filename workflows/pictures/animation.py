"""animation.gif: the moving bodies, coloured by von Mises stress, and where contacts are open, slip or stick."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, to_rgb
from numpy.typing import NDArray
from PIL import Image as Pillow

from stickslip.geometry.arrays import Array
from stickslip.geometry.units import Units
from stickslip.solvers.results.step_result import OPEN, MeshData
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.formats.steps import light_files, read_step, step_name, three
from stickslip.workflows.pictures.body_picture import PlaneBodies, displacement_scale, plain, status_line
from stickslip.workflows.pictures.contact_maps import dual_cells, view_of
from stickslip.workflows.pictures.render import SolidBodies, render
from stickslip.workflows.pictures.sheet import COLOURS, STATUS_COLOURS, Sheet, show_image, span
from stickslip.workflows.pictures.view import Image, View, close_up

FRAMES = 100  # at most
Statuses = Mapping[str, NDArray[np.int8]]


@dataclass(frozen=True)
class Frame:
    """The data of a step that are shown."""

    time: float  # [s]
    displacement: Array  # (nodes, 3) [m]
    von_mises: Array  # (cells,) [Pa]
    status: Statuses  # (n,) by contact


@dataclass(frozen=True)
class Course:
    """Scales and windows that all frames share, so that they can be compared."""

    norm: Normalize  # of von Mises stress
    scale: float  # factor on displacements
    view: View
    beside: View | None  # of contacts that are hard to see: of a solid, or of a part of a plane body that is small


def animate(folder: Path, scene: Scene, mesh: MeshData, count: int) -> Path:
    """Draw animation.gif from the files of the first `count` steps with fields; of many steps, evenly chosen ones.

    Raises:
        MachineError: a step's file cannot be read, or the disk is full.
    """
    light = light_files(folder)
    there = [index for index in range(1, count + 1) if index not in light]
    chosen = np.unique(np.linspace(0, len(there) - 1, min(len(there), FRAMES)).round().astype(int))
    indices = [there[place] for place in chosen]
    course = survey(folder, mesh, indices)
    title = " ".join(scene.title.split())
    drawn = (_drawn(mesh, course, frame, title, scene.labels) for frame in frames(folder, mesh, indices))
    pictures = [*map(Pillow.fromarray, drawn)]
    each = min(500, 8000 / len(pictures))  # [ms] of a frame, of 8 s at most; the last one stays longer
    content = io.BytesIO()
    colours = palette(mesh.points.shape[1] == 3)
    first, *others = [p.quantize(palette=colours, dither=Pillow.Dither.NONE) for p in pictures]
    durations = [round(each)] * len(others) + [1500]
    first.save(content, "GIF", save_all=True, append_images=others, duration=durations, loop=0)
    path = folder / "animation.gif"
    write_aside(path, content.getvalue())
    return path


def frames(folder: Path, mesh: MeshData, indices: list[int]) -> Iterator[Frame]:
    """The bodies at rest, then the steps from their files."""
    at_rest = {name: np.zeros(len(points), np.int8) + OPEN for name, (points, *_) in mesh.surfaces.items()}
    yield Frame(0.0, np.zeros((len(mesh.points), 3)), np.zeros(len(mesh.cells)), at_rest)
    for index in indices:
        step = read_step(folder / step_name(index))
        yield Frame(step.time, step.displacement, step.von_mises, {n: c.status for n, c in step.contacts.items()})


def survey(folder: Path, mesh: MeshData, indices: list[int]) -> Course:
    """Find one colour scale, one factor on displacements and one window for all frames."""
    places, moves = [np.zeros((0, 3))], [np.zeros((0, 3))]
    solid = mesh.points.shape[1] == 3
    points = three(mesh.points)
    view = View.isometric(points) if solid else View.facing(points)
    across = np.column_stack([view.right, view.up])
    highest, scales = 0.0, [np.inf]
    low, high = np.zeros(2), np.zeros(2)  # of the displacement in the plane of the view [m]
    for index in indices:
        step = read_step(folder / step_name(index))
        highest = max(highest, float(step.von_mises.max(initial=0.0)))
        if step.displacement.any():
            scales.append(displacement_scale(mesh, step))
        for name, contact in step.contacts.items():
            there = mesh.slaves[name][contact.status != OPEN]
            places.append(points[there])
            moves.append(step.displacement[there])
        seen = step.displacement @ across
        low, high = np.minimum(low, seen.min(axis=0)), np.maximum(high, seen.max(axis=0))
    scale = min(scales) if len(scales) > 1 else 1.0
    seen = points @ across
    corners = np.stack([seen.min(axis=0) + scale * low, seen.max(axis=0) + scale * high])
    window = View.around(corners @ across.T, view.right, view.up)
    # a solid's contacts are shown on a map, where they were at the start
    touching = np.concatenate(places) + (0.0 if solid else scale) * np.concatenate(moves)
    beside = None if solid else close_up(window, touching)
    if solid and mesh.surfaces:
        whole, _ = view_of(np.concatenate([points for points, *_ in mesh.surfaces.values()]))
        beside = close_up(whole, touching) or whole
    return Course(span(np.array([highest])), scale, window, beside)


def _drawn(mesh: MeshData, course: Course, frame: Frame, title: str, units: Units) -> Image:
    """A frame: the bodies, and next to them contacts that are hard to see."""
    view, beside, scale, solid = course.view, course.beside, course.scale, mesh.points.shape[1] == 3
    width, height = (5.2, 5.2 / view.aspect) if view.aspect > 1.3 else (4.0 * view.aspect, 4.0)
    left, foot, room = (0.3, 0.3, 0.3) if solid else (0.8, 0.55, 0.75)
    wide = min(3.2, 0.75 * max(height, 2.5) * beside.aspect) if beside else -room
    high = wide / beside.aspect if beside else 0.0
    sheet = Sheet(max(5.0, left + width + 1.55 + room + wide), foot + max(height, high) + 1.0, 110, units)
    moved = frame.displacement[:, : mesh.points.shape[1]]
    bodies = (SolidBodies if solid else PlaneBodies)(mesh, moved, (), scale)
    lines = [] if solid else [status_line(mesh, name, scale * moved, status) for name, status in frame.status.items()]

    def show(view: View, *place: float) -> Any:
        axes = sheet.axes(*place)
        bodies.show(axes, view, round(place[2] * sheet.dpi), scale, frame.von_mises, course.norm)
        for segments, colours in lines:  # in front of the bodies
            axes.add_collection(LineCollection(segments, colors=colours, linewidths=6.0, zorder=3))
        return axes

    axes = show(view, left, foot, width, height)
    tall = max(0.8 * height, 1.1)
    bar = sheet.axes(left + width + 0.2, foot + (height - tall) / 2, 0.13, tall)
    sheet.colour_bar(bar, course.norm, "von Mises stress [Pa]", orientation="vertical")
    if beside:
        place = (left + width + 1.35 + room, foot, wide, high)
        close = sheet.axes(*place) if solid else show(beside, *place)
        if solid:
            show_image(close, beside, render(beside, round(wide * sheet.dpi), _map(mesh, frame.status)), None)
        close.set_title("contact", fontsize=9, loc="left")
    if mesh.surfaces:
        sheet.status_legend(axes, loc="lower left", bbox_to_anchor=(-0.01, 1.0), borderpad=0, handletextpad=0.5)
    drawn = "true displacement" if scale == 1 else f"displacement × {plain(scale)}"
    sheet.head(title, f"{drawn}; grey: undeformed", left)
    sheet.write(sheet.width - 0.2, sheet.height - 0.48, f"t = {frame.time:.4g} s", fontsize=10, ha="right")
    return sheet.pixels()


def _map(mesh: MeshData, statuses: Statuses) -> Callable[[Any], None]:
    """Draws the contact surfaces alone, the dual cell of each node in the colour of its status."""

    def add(stage: Any) -> None:
        for name, surface in mesh.surfaces.items():
            cells, owners = dual_cells(*surface)
            colours = [np.round(255 * np.array(to_rgb(STATUS_COLOURS[int(s)]))) for s in statuses[name][owners]]
            cells.cell_data["colour"] = np.array(colours, np.uint8)
            stage.add_mesh(cells, scalars="colour", rgb=True, lighting=False)

    return add


def palette(solid: bool) -> Pillow.Image:
    """256 fixed colours for all frames, 40 of them grey; by frequency, rare ones of the stress scale would be lost.

    Solids need each colour in darker shades, for sides that face away from the lights.
    """
    shades = (1.0, 0.88, 0.76) if solid else (1.0,)
    status = [to_rgb(colour) for colour in STATUS_COLOURS.values()]
    levels = (216 - len(status)) // len(shades)
    stress = colormaps[COLOURS](np.linspace(0.0, 1.0, levels))[:, :3]
    greys = np.repeat(np.linspace(0.0, 1.0, 40)[:, None], 3, axis=1)
    colours = np.concatenate([greys, status, *(shade * stress for shade in shades)])
    found = Pillow.new("P", (1, 1))
    found.putpalette(np.round(255 * colours).astype(np.uint8).tobytes())
    return found
