"""animation.gif: the moving bodies, coloured by von Mises stress, and where contacts are open, slip or stick."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib import colormaps
from matplotlib.colors import Normalize, to_rgb
from numpy.typing import NDArray
from PIL import Image as Pillow

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.units import Units
from stickslip.solvers.results.step_result import OPEN, MeshData
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.formats.steps import light_files, read_step, step_name, three
from stickslip.workflows.pictures.body_picture import displacement_scale, plain
from stickslip.workflows.pictures.contact_maps import dual_cells, view_of
from stickslip.workflows.pictures.render import body_on_stage, render
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
    touching: Array  # (k, 3) [m] points, as drawn, that are in contact at any time


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
    drawn = _Film(mesh, course, " ".join(scene.title.split()), scene.labels)
    pictures = [Pillow.fromarray(drawn(frame)) for frame in frames(folder, mesh, indices)]
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
    return Course(span(np.array([highest])), scale, window, touching)


class _Film:
    """A sheet on which all frames are drawn: the bodies, and next to them contacts that are hard to see."""

    def __init__(self, mesh: MeshData, course: Course, title: str, units: Units) -> None:
        self.mesh, self.course = mesh, course
        self.solid = mesh.points.shape[1] == 3
        self.beside = self._view_beside()
        view, plain_axes = course.view, None if self.solid else ("x", "y")
        width, height = (5.2, 5.2 / view.aspect) if view.aspect > 1.3 else (4.0 * view.aspect, 4.0)
        left, foot = (0.3, 0.3) if self.solid else (0.8, 0.55)
        wide = min(3.2, 0.75 * max(height, 2.5) * self.beside.aspect) if self.beside else 0.0
        room = (0.3 if self.solid else 0.75) if self.beside else 0.0
        high = wide / self.beside.aspect if self.beside else 0.0
        size = max(5.0, left + width + 1.35 + room + wide + 0.2), foot + max(height, high) + 1.0
        self.sheet = Sheet(*size, 110, units)
        axes, self.shown = self._picture(view, (left, foot, width, height), plain_axes)
        tall = max(0.8 * height, 1.1)
        bar = self.sheet.axes(left + width + 0.2, foot + (height - tall) / 2, 0.13, tall)
        self.sheet.colour_bar(bar, course.norm, "von Mises stress [Pa]", orientation="vertical")
        if self.beside:
            place = (left + width + 1.35 + room, foot, wide, high)
            close, self.shown_beside = self._picture(self.beside, place, plain_axes)
            close.set_title("contact", fontsize=9, loc="left")
        if mesh.surfaces:
            self.sheet.status_legend(
                axes, loc="lower left", bbox_to_anchor=(-0.01, 1.0), borderpad=0, handletextpad=0.5
            )
        drawn = "true displacement" if course.scale == 1 else f"displacement × {plain(course.scale)}"
        self.sheet.head(title, f"{drawn}; grey: undeformed", left)
        self.clock = self.sheet.write(self.sheet.width - 0.2, self.sheet.height - 0.48, "", fontsize=10, ha="right")

    def __call__(self, frame: Frame) -> Image:
        moved = three(self.mesh.points) + self.course.scale * frame.displacement
        bodies = body_on_stage(self.mesh, moved, frame.von_mises, self.course.norm)
        lines = [] if self.solid else [self._line(name, moved, status) for name, status in frame.status.items()]

        def add(stage: Any) -> None:
            bodies(stage)
            for line in lines:
                stage.add_mesh(line, scalars="colour", rgb=True, lighting=False, line_width=9.0)

        self._show(self.shown, self.course.view, add)
        if self.beside:
            self._show(self.shown_beside, self.beside, self._map(frame.status) if self.solid else add)
        self.clock.set_text(f"t = {frame.time:.4g} s")
        return self.sheet.pixels()

    def _view_beside(self) -> View | None:
        """The second view: for solids a map of the contacts, for plane bodies the contact region if it is small."""
        if not self.solid:
            return close_up(self.course.view, self.course.touching)
        if not self.mesh.surfaces:
            return None
        whole, _ = view_of(np.concatenate([points for points, *_ in self.mesh.surfaces.values()]))
        return close_up(whole, self.course.touching) or whole

    def _picture(self, view: View, place: tuple[float, ...], labels: tuple[str, str] | None) -> tuple[Any, Any]:
        """Axes at a place (left, bottom, width, height) [inch], and the image in them."""
        left, bottom, width, height = place
        axes = self.sheet.axes(left, bottom, width, height)
        show_image(axes, view, np.full((2, 2, 3), 255, np.uint8), labels)
        return axes, axes.images[0]

    def _show(self, image: Any, view: View, add: Callable[[Any], None]) -> None:
        image.set_data(render(view, round(float(image.axes.get_window_extent().width)), add))

    def _map(self, statuses: Statuses) -> Callable[[Any], None]:
        """Draws the contact surfaces alone, the dual cell of each node in the colour of its status."""

        def add(stage: Any) -> None:
            for name, surface in self.mesh.surfaces.items():
                cells, owners = dual_cells(*surface)
                cells.cell_data["colour"] = _colours(statuses[name])[owners]
                stage.add_mesh(cells, scalars="colour", rgb=True, lighting=False)

        return add

    def _line(self, name: str, moved: Array, status: NDArray[np.int8]) -> pv.PolyData:
        """The deformed contact line, each half of a facet in the colour of the node at its end."""
        size = float(np.ptp(self.mesh.points, axis=0).max())
        points = moved[self.mesh.slaves[name]] + np.array([0.0, 0.0, 1e-2 * size])  # in front of the bodies
        pairs = np.concatenate(
            [np.stack(pair, axis=1) for pair in pairwise(_along(self.mesh.surfaces[name][1]))]
        )  # neighbours along the facets
        middle = points[pairs].mean(axis=1)
        ends = np.concatenate([np.stack([points[pairs[:, k]], middle], axis=1) for k in (0, 1)]).reshape(-1, 3)
        count = 2 * len(pairs)
        cells = np.column_stack([np.full(count, 2), np.arange(2 * count).reshape(-1, 2)])
        line = pv.PolyData(ends, lines=cells.ravel())
        line.cell_data["colour"] = _colours(status)[np.concatenate([pairs[:, 0], pairs[:, 1]])]
        return line


def _along(facets: Ints) -> tuple[Ints, ...]:
    """Nodes of line facets in the order along the line: dolfinx numbers middle nodes last."""
    return (facets[:, 0], *facets[:, 2:].T, facets[:, 1])


def _colours(status: NDArray[np.int8]) -> NDArray[np.uint8]:
    table = np.zeros((max(STATUS_COLOURS) + 1, 3), np.uint8)
    for s, colour in STATUS_COLOURS.items():
        table[s] = np.round(255 * np.array(to_rgb(colour)))
    return table[status]


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
