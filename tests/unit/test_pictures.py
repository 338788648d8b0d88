"""Pictures, animations and curves over time show what was solved, whatever its size and number."""

from __future__ import annotations

import dataclasses
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import colormaps, pyplot
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.image import imread
from matplotlib.path import Path as Outline
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from PIL import Image
from scipy.integrate import trapezoid
from scipy.spatial import Delaunay

import stickslip
from shared.cases import every_nth, often, slow
from shared.synthetic import result_of
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import MachineError
from stickslip.geometry.obstacles.obstacle import Rotation
from stickslip.geometry.obstacles.plane import Plane
from stickslip.solvers.results.step_result import (
    OPEN,
    PARTS,
    SLIP,
    STICK,
    ErrorParts,
    MeshData,
    Quantity,
    StepResult,
)
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.formats.contact_line import walk
from stickslip.workflows.formats.steps import write_step
from stickslip.workflows.pictures.animation import animate, close_up, frames, palette, survey
from stickslip.workflows.pictures.body_picture import BodyPictures, PlaneBodies, cells_at_pixels, displacement_scale
from stickslip.workflows.pictures.contact_maps import draw_surface, dual_cells, view_of
from stickslip.workflows.pictures.draw import _said, draw, draw_course
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
from stickslip.workflows.pictures.render import grid_of, outline_of, surface_of
from stickslip.workflows.pictures.rigid import Rigid, rigids, shade
from stickslip.workflows.pictures.sheet import STATUS_COLOURS, Sheet
from stickslip.workflows.pictures.view import View, focus
from stickslip.workflows.run.run import run
from stickslip.workflows.writers.tables import StepsTable
from stickslip.workflows.writers.writer import Job


def colours(path: Path) -> int:
    """Number of colours of a picture, which must not be small."""
    pixels = imread(path)
    assert pixels.shape[0] > 300
    assert pixels.shape[1] > 600
    return len(np.unique((pixels[..., :3] * 255).astype(int) @ [65536, 256, 1]))


Ints = NDArray[np.int64]
SHAPES = ["triangle", "quadrilateral", "tetrahedron", "hexahedron"]
TETRAHEDRA = ((0, 1, 3, 7), (0, 1, 5, 7), (0, 2, 3, 7), (0, 2, 6, 7), (0, 4, 5, 7), (0, 4, 6, 7))


def block(shape: str, n: int = 4) -> MeshData:
    """A block 2 × 1 (× 1) m on its bottom: boxes in dolfinx's tensor order, cut where simplices are asked for."""
    d = 2 if shape in ("triangle", "quadrilateral") else 3
    steps = [2 * n, *[n] * (d - 1)]
    numbers = np.arange(np.prod([k + 1 for k in steps])).reshape([k + 1 for k in reversed(steps)])  # x runs fastest
    axes = [np.linspace(0.0, length, k + 1) for length, k in zip((2.0, 1.0, 1.0), steps, strict=False)]
    points = np.stack([g.ravel() for g in np.meshgrid(*reversed(axes), indexing="ij")][::-1], axis=1)
    cells = boxes(numbers)
    bottom = numbers[0]
    facets = boxes(bottom)
    if shape == "triangle":
        cells = np.vstack([cells[:, [0, 1, 3]], cells[:, [0, 2, 3]]])
    if shape == "tetrahedron":
        cells = np.vstack([cells[:, t] for t in TETRAHEDRA])
        facets = np.vstack([facets[:, [0, 1, 3]], facets[:, [0, 2, 3]]])
    facet = {"triangle": "interval", "quadrilateral": "interval", "tetrahedron": "triangle"}.get(shape, "quadrilateral")
    return MeshData(
        points=points,
        cells=cells,
        shape=shape,
        body=np.zeros(len(cells), np.int64),
        bodies=("block",),
        surfaces={"base": (points[bottom.ravel()], facets, facet)},
        slaves={"base": bottom.ravel()},
    )


def boxes(numbers: Ints) -> Ints:
    """Nodes of each box of a grid of node numbers, x fastest."""
    corners = np.ndindex(*[2] * numbers.ndim)
    cut = [numbers[tuple(slice(c, c - 1 or None) for c in corner)].ravel() for corner in corners]
    return np.stack(cut, axis=1)


def pressed(mesh: MeshData, size: float = 1.0) -> StepResult:
    """Pushed down and to the right: slips in front, sticks in the middle, opens at the back."""
    d = mesh.points.shape[1]
    x, up = mesh.points[:, 0], mesh.points[:, -1]
    displacement = np.zeros_like(mesh.points)
    displacement[:, 0], displacement[:, -1] = 0.05 * up**2, -0.04 * up * (1 + 0.3 * x)
    centre = mesh.points[mesh.cells].mean(axis=1)
    stress = np.zeros((len(mesh.cells), 3, 3))
    stress[:, d - 1, d - 1] = -(1 + centre[:, 0] ** 2)
    at = mesh.surfaces["base"][0]
    p = np.maximum(0.0, at[:, 0] - 0.4)
    share = np.clip(at[:, 0] - 0.6, -1.0, 1.0)
    along = np.eye(d)[0]
    status = np.where(p == 0, OPEN, np.where(share == 1.0, SLIP, STICK)).astype(np.int8)
    whole = result_of(mesh)
    contact = dataclasses.replace(
        whole.contacts["base"],
        gap=np.where(p > 0, 0.0, 0.01),
        pressure=p * size,
        traction=np.outer(-0.3 * p * share, along) * size,
        slip=np.outer(share == 1.0, along) * 0.01,
        slip_increment=np.outer(share == 1.0, along) * 0.01,
        bound=0.3 * p * size,
        lam=np.outer(np.where(p > 0, share, 0.0), along),
        status=status,
    )
    return dataclasses.replace(
        whole,
        time=1.0,
        displacement=displacement,
        stress=stress * size,
        contacts={"base": contact},
        probes={},
        stress_error=np.abs(stress[:, d - 1, d - 1]) * size / 10,
    )


def without_errors(step: StepResult) -> StepResult:
    """With one picture fewer."""
    return dataclasses.replace(step, stress_error=np.zeros(0))


def bodies_alone(mesh: MeshData, step: StepResult) -> tuple[MeshData, StepResult]:
    """With one picture, that of the bodies."""
    return dataclasses.replace(mesh, surfaces={}, slaves={}), dataclasses.replace(without_errors(step), contacts={})


def nothing(mesh: MeshData) -> StepResult:
    """The step before anything has happened: zero everywhere, all open."""
    step = pressed(mesh, 0.0)
    zero = {
        k: np.zeros_like(getattr(step.contacts["base"], k))
        for k in ("gap", "slip", "slip_increment", "bound", "lam", "status")
    }
    contact = dataclasses.replace(step.contacts["base"], **zero)
    return dataclasses.replace(step, displacement=np.zeros_like(mesh.points), contacts={"base": contact})


@pytest.mark.parametrize("shape", often(SHAPES, ("triangle", "hexahedron")))
def test_pictures_show_a_pressed_block(tmp_path: Path, shape: str) -> None:
    mesh, open_before = block(shape), pyplot.get_fignums()
    drawn = draw(tmp_path, mesh, pressed(mesh), "A block")
    assert [path.name for path in drawn] == ["deformed.png", "stress_error.png", "contact_base.png"]
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in drawn}
    assert all(colours(path) > 100 for path in drawn)
    assert pyplot.get_fignums() == open_before


def test_numbers_of_a_contact_are_drawn_with_their_errors() -> None:
    contact = dataclasses.replace(
        pressed(block("triangle")).contacts["base"], normal_force=0.24296, stick_area=1.0, max_pressure=0.18
    )
    parts = dict.fromkeys(PARTS, 0.0)
    errors = {
        Quantity("contacts", "base", "normal_force"): ErrorParts(**parts | {"mesh": 2e-4}),
        Quantity("contacts", "base", "max_pressure"): ErrorParts(converges=False),
    }
    said = _said("base", contact, errors, per_metre=True)
    assert said["normal force"] == "0.2430 ± 0.0002 N/m"
    assert said["largest pressure"] == "0.18 Pa (grows)"
    assert said["sticks on"] == "1 ± ? m"  # its error is not known
    assert _said("base", contact, {}, per_metre=False)["sticks on"] == "1 ± ? m²"


def test_words_of_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The largest stress beside the colours; no range of pressures where a contact is open; what is modelled."""
    said: list[str] = []
    monkeypatch.setattr(Sheet, "colour_bar", lambda self, axes, norm, label, *more, **options: said.append(label))
    monkeypatch.setattr(Sheet, "head", lambda self, title, caption, left: said.append(caption))
    monkeypatch.setattr(Sheet, "save", lambda self, path: path)
    mesh = block("hexahedron", n=2)
    for step, bars in ((pressed(mesh), 2), (nothing(mesh), 1)):
        said.clear()
        draw(tmp_path, mesh, without_errors(step), "t", part="quarter")
        labels = [label for label in said if "[Pa]" in label]
        assert len(labels) == bars
        assert labels[0] == f"von Mises stress [Pa], largest {step.von_mises.max():.3g}"
        assert any("contact base of the modelled quarter" in caption for caption in said)


def test_a_curved_surface_lies_on_the_obstacle_that_it_touches(tmp_path: Path) -> None:
    mesh = block("hexahedron", n=3)
    points, facets, shape = mesh.surfaces["base"]
    bent = points + np.outer(points[:, 0] ** 2 / 2, np.eye(3)[2])
    contact = pressed(mesh).contacts["base"]
    floor = Rigid(Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)), np.zeros(3), 0.0)
    greys = []
    for k, obstacles in enumerate(((), (floor,))):
        (tmp_path / str(k)).mkdir()
        drawn = draw_surface(tmp_path / str(k), "base", (bent, facets, shape), contact, "t\nt\nt", obstacles=obstacles)
        picture = imread(drawn)[..., :3]
        greys.append(np.sum((np.ptp(picture, axis=2) == 0) & (picture[..., 0] < 0.98) & (picture[..., 0] > 0.8)))
    assert greys[1] > 2 * greys[0]


@pytest.mark.parametrize("bound", [*slow(0.3), np.inf])
def test_traction_is_drawn_whatever_bounds_it(tmp_path: Path, bound: float) -> None:
    """Also where nothing is held back (lambda = 0), and where nothing limits it (stick, tied)."""
    mesh = block("quadrilateral")
    step = without_errors(pressed(mesh))
    plain = dataclasses.replace(step.contacts["base"], traction=0 * step.contacts["base"].traction)
    plain = dataclasses.replace(plain, lam=0 * plain.lam)
    pictures = []
    for k, size in enumerate((0.0, bound)):
        contact = dataclasses.replace(plain, bound=np.where(plain.pressure > 0, size, 0.0))
        draw(tmp_path / str(k), mesh, dataclasses.replace(step, contacts={"base": contact}), "bound")
        pictures.append(imread(tmp_path / str(k) / "contact_base.png")[..., :3])
    red = [np.sum((picture[..., 0] > 0.6) & (picture[..., 1] < 0.2)) for picture in pictures]
    assert red[0] == 0
    assert red[1] > 100  # the curve and its entry in the legend


@pytest.mark.parametrize("shape", often(SHAPES, ("quadrilateral", "tetrahedron")))
def test_nothing_at_all_is_drawn_without_a_complaint(tmp_path: Path, shape: str) -> None:
    mesh = block(shape, n=2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drawn = draw(tmp_path, mesh, nothing(mesh), "")
    assert all(colours(path) > 10 for path in drawn)


@pytest.mark.parametrize(("shape", "unit"), every_nth(2, ["quadrilateral", "hexahedron"], [1e-6, 1e6]))
def test_pictures_do_not_depend_on_the_size_of_things(tmp_path: Path, shape: str, unit: float) -> None:
    mesh = block(shape, n=2)
    points, facets, facet = mesh.surfaces["base"]
    large = dataclasses.replace(mesh, points=mesh.points * unit, surfaces={"base": (points * unit, facets, facet)})
    step = without_errors(pressed(mesh, size=1 / unit**2))
    step = dataclasses.replace(step, displacement=step.displacement * unit)
    for path in draw(tmp_path, large, step, "$ % _ { a title with strange letters } & " + "long " * 40):
        assert colours(path) > 50


def test_slim_bodies_many_contacts_and_no_contact(tmp_path: Path) -> None:
    mesh = block("quadrilateral")
    slim = dataclasses.replace(mesh, points=mesh.points * [1.0, 1e-3])
    draw(tmp_path / "slim", slim, without_errors(pressed(slim)), "slim")
    tall = dataclasses.replace(mesh, points=mesh.points * [1e-3, 1.0])
    draw(tmp_path / "tall", tall, without_errors(pressed(tall)), "tall")
    step = pressed(mesh)
    contact, surface = step.contacts["base"], mesh.surfaces["base"]
    two = dataclasses.replace(
        mesh, surfaces={"a": surface, "b": surface}, slaves=dict.fromkeys("ab", mesh.slaves["base"])
    )
    drawn = draw(tmp_path, two, dataclasses.replace(step, contacts={"a": contact, "b": contact}), "two")
    assert [path.name for path in drawn] == ["deformed.png", "stress_error.png", "contact_a.png", "contact_b.png"]
    assert [path.name for path in draw(tmp_path, *bodies_alone(mesh, step), "free")] == ["deformed.png"]


def test_curved_surfaces_are_drawn_from_the_front_right(tmp_path: Path) -> None:
    mesh = block("hexahedron")
    points, facets, facet = mesh.surfaces["base"]
    shallow, bent = (points + np.outer((points[:, 0] - 1.0) ** 2, [0.0, 0.0, depth]) for depth in (0.3, 0.8))
    assert view_of(points)[1] == view_of(shallow)[1] == ("x", "y")
    assert view_of(bent)[1] is None
    mesh = dataclasses.replace(mesh, surfaces={"base": (bent, facets, facet)})
    assert all(colours(path) > 100 for path in draw(tmp_path, mesh, without_errors(pressed(mesh)), "bent"))


def test_a_small_touching_part_is_looked_at_closely() -> None:
    x = np.stack(np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21)), axis=-1).reshape(-1, 2)
    shown = x[focus(x, np.linalg.norm(x, axis=1) < 0.21)]  # 0.2 wide, and half of that on every side
    assert np.allclose(shown.max(axis=0), 0.3)
    assert focus(x, x[:, 0] < 0.71).all()  # large
    assert focus(x, x[:, 0] < 0).all()  # nothing touches
    assert focus(x, x.sum(axis=1) == 0).all()  # one point


def test_a_picture_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    mesh = block("triangle", n=1)
    (tmp_path / "deformed.png").mkdir()
    with pytest.raises(MachineError, match=r"deformed\.png: cannot be written"):
        draw(tmp_path, mesh, pressed(mesh), "no place")


@pytest.mark.parametrize(
    ("largest", "gap", "scale"),
    [
        *((largest, 1.0, scale) for largest, scale in ((0.0, 1.0), (0.05, 1.0), (0.3, 1.0), (0.01, 10.0), (4.0, 1.0))),
        *((1e-4, gap, 1000.0) for gap in (0.0, 1e-9)),  # (scale - 1) gap is half a per cent of 2 m at most
        *((1e-4, gap, scale) for gap, scale in ((-1e-4, 100.0), (1e-3, 10.0), (1.0, 1.0))),
    ],
)
def test_displacements_are_scaled_by_a_round_factor_and_bodies_not_drawn_into_each_other(
    largest: float, gap: float, scale: float
) -> None:
    mesh = block("quadrilateral", n=1)
    step, moved = pressed(mesh), np.zeros_like(mesh.points)
    closed = step.contacts["base"].status != OPEN
    assert closed.any()
    moved[0, 1] = -largest
    if largest == 1e-4:
        mesh = dataclasses.replace(mesh, gaps={"base": np.where(closed, gap, 2.0)})  # elsewhere it does not matter
    assert displacement_scale(mesh, dataclasses.replace(step, displacement=moved)) == pytest.approx(scale)


def test_an_obstacle_is_where_its_motion_has_brought_it() -> None:
    turned = Plane(point=(0.0, 0.0), normal=(0.0, 1.0), rotation=Rotation(angle=0.02, point=(1.0, 0.0)))
    rigid = Rigid(turned, np.array([0.0, 0.5]), 0.02)
    x = np.array([0.0, 1.0, 3.0])
    surface = np.stack([x, 10 * (0.5 + 0.02 * (x - 1))], axis=1)  # drawn with ten times its motion
    assert np.abs(rigid.signed_gap(surface, 10.0)).max() < 1e-12
    assert (rigid.signed_gap(surface + np.array([0.0, 0.1]), 10.0) > 0).all()


@pytest.mark.parametrize("shape", ["quadrilateral", "tetrahedron"])
def test_obstacles_are_drawn(shape: str, tmp_path: Path) -> None:
    mesh = block(shape)
    dim = mesh.points.shape[1]
    floor = Plane(point=(0.0,) * dim, normal=(*(0.0,) * (dim - 1), 1.0))
    far = dataclasses.replace(floor, point=(-100.0,) * dim)
    grey = []
    for obstacle in (floor, far):
        draw(tmp_path, *bodies_alone(mesh, pressed(mesh)), "floor", obstacles=[Rigid(obstacle, np.zeros(dim), 0.0)])
        pixels = imread(tmp_path / "deformed.png")[..., :3]
        grey.append(int(((np.ptp(pixels, axis=2) < 0.01) & (pixels[..., 0] > 0.8) & (pixels[..., 0] < 0.93)).sum()))
    assert grey[0] > grey[1] + 10_000


def test_one_corner_does_not_take_all_colours(tmp_path: Path) -> None:
    mesh = block("quadrilateral", n=12)
    stress = np.zeros((len(mesh.cells), 3, 3))
    stress[:, 1, 1] = np.linspace(1.0, 2.0, len(stress))
    counts = []
    for corner in (2.0, 1000.0):
        stress[0, 1, 1] = corner
        draw(tmp_path, *bodies_alone(mesh, dataclasses.replace(pressed(mesh), stress=stress)), "corner")
        counts.append(colours(tmp_path / "deformed.png"))
    assert counts[1] > 0.8 * counts[0]


def test_a_small_contact_is_shown_larger_and_to_scale(tmp_path: Path) -> None:
    mesh = block("quadrilateral", n=12)
    step = without_errors(pressed(mesh))
    contact = step.contacts["base"]
    status = np.where(np.abs(mesh.surfaces["base"][0][:, 0] - 1) < 0.2, STICK, OPEN).astype(np.int8)
    wide = []
    for each in (contact, dataclasses.replace(contact, status=status)):
        draw(tmp_path, mesh, dataclasses.replace(step, contacts={"base": each}), "small")
        wide.append(imread(tmp_path / "deformed.png").shape[1])
    assert wide[1] > 1.3 * wide[0]


@pytest.mark.parametrize("shape", ["tetrahedron", "hexahedron"])
def test_only_sharp_edges_are_outlined_even_of_mirrored_cells(shape: str) -> None:
    mesh = block(shape)  # half of these tetrahedra are mirror images
    outline = outline_of(surface_of(grid_of(mesh.points, mesh.cells, mesh.shape)))
    assert outline.compute_cell_sizes()["Length"].sum() == pytest.approx(4 * (2 + 1 + 1))


@pytest.mark.parametrize(
    ("x", "facets", "nodes", "starts"),
    [
        ([2.0, 0.0, 1.0, 3.0], [[2, 0], [2, 1], [0, 3]], [1, 2, 0, 3], [True, False, False, False]),
        ([0.0, 2.0, 1.0], [[0, 1, 2]], [0, 2, 1], [True, False, False]),  # middle nodes of curved facets are walked too
        ([0.0, 1.0, 3.0, 4.0], [[0, 1], [2, 3]], [0, 1, 2, 3], [True, False, True, False]),  # in two pieces
    ],
)
def test_a_contact_line_is_walked_from_end_to_end(x: Any, facets: Any, nodes: list[int], starts: list[bool]) -> None:
    line = walk(np.column_stack([x, np.zeros(len(x))]), np.array(facets))
    assert (line.nodes.tolist(), line.starts.tolist(), line.label) == (nodes, starts, "x [m]")
    assert line.place.tolist() == [x[k] for k in nodes]
    assert line.tangents.tolist() == [[1.0, 0.0]] * len(x)


def test_a_closed_contact_line_returns_to_its_start_over_its_arc_length() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    line = walk(circle, np.column_stack([np.arange(64), np.roll(np.arange(64), -1)]))
    assert line.nodes[0] == line.nodes[-1]
    assert line.label == "arc length [m]"
    assert line.place[-1] == pytest.approx(2 * np.pi, rel=1e-3)  # the polygon is shorter by (2 pi / 64)^2 / 24
    radial = np.einsum("ki,ki->k", line.tangents, circle[line.nodes])
    assert np.abs(radial).max() < 1e-12


@pytest.mark.parametrize("shape", ["tetrahedron", "hexahedron"])
def test_each_node_owns_its_part_of_the_surface(shape: str) -> None:
    points, facets, facet = block(shape).surfaces["base"]
    dual, owners = dual_cells(points, facets, facet)
    areas = dual.compute_cell_sizes()["Area"]
    assert areas.sum() == pytest.approx(2.0)
    corner = int(np.flatnonzero((points == 0).all(axis=1))[0])
    share = {"tetrahedron": 1 / 3, "hexahedron": 1 / 4}[shape] / 16  # two triangles or one square of 1/16 meet there
    assert areas[owners == corner].sum() == pytest.approx(share)


def test_the_view_is_to_scale() -> None:
    view = View.facing(np.array([[0.0, 0.0, 0.0], [2.0, 1.0, 0.0]]))
    left, right, bottom, top = view.extent
    assert left < 0.0 < 2.0 < right
    assert bottom < 0.0 < 1.0 < top
    assert view.aspect == pytest.approx((right - left) / (top - bottom))


ROWS, COLUMNS = 60, 90


def triangles(points: Array) -> Array:
    return points[Delaunay(points).simplices]


def spread(seed: int) -> Array:
    """Points that fill the picture, its corners among them."""
    inside = np.random.default_rng(seed).uniform(0, 1, (200, 2)) * [COLUMNS, ROWS]
    return np.vstack([inside, [[0, 0], [COLUMNS, 0], [0, ROWS], [COLUMNS, ROWS]]])


def middles() -> Array:
    y, x = np.mgrid[:ROWS, :COLUMNS] + 0.5
    return np.stack([x, y], axis=-1)


@pytest.mark.parametrize("seed", range(5))
def test_each_pixel_shows_the_cell_that_it_is_in(seed: int) -> None:
    corners = triangles(spread(seed))
    found = cells_at_pixels(corners, ROWS, COLUMNS)
    assert found.min() >= 0  # no gap
    for cell in np.unique(found)[::10]:
        assert Outline(corners[cell]).contains_points(middles()[found == cell], radius=1e-9 * COLUMNS).all()


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, np.pi / 2])
def test_neighbours_leave_no_gap_where_edges_meet_middles_of_pixels(angle: float) -> None:
    n = np.arange(-80, 81) + 0.5
    x, y = np.meshgrid(n, n)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    nodes = np.stack([x, y], axis=-1) @ turn + [COLUMNS / 2, ROWS / 2]
    cells = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2).reshape(-1, 4, 2)
    assert cells_at_pixels(cells, ROWS, COLUMNS).min() >= 0
    assert cells_at_pixels(cells[:, ::-1], ROWS, COLUMNS).min() >= 0  # the other way round


def test_cells_outside_and_cells_without_area_are_not_seen() -> None:
    outside = np.array([[[-9.0, -9.0], [-1.0, -9.0], [-1.0, -1.0]], [[99.0, 2.0], [120.0, 2.0], [120.0, 70.0]]])
    flat = np.array([[[3.0, 3.5], [8.0, 3.5], [5.0, 3.5]], [[3.5, 3.0], [3.5, 8.0], [3.5, 5.0]]])
    assert (cells_at_pixels(np.concatenate([outside, flat]), ROWS, COLUMNS) == -1).all()


@pytest.mark.parametrize("scale", [0.0, 1.0])
def test_bodies_are_where_their_displacement_brings_them(scale: float) -> None:
    mesh = dataclasses.replace(block("quadrilateral", n=1), surfaces={}, slaves={})
    bodies = PlaneBodies(mesh, np.tile([2.0, 0.0], (6, 1)), (), scale)
    axes = Sheet(3.0, 3.0).axes(0.5, 0.5, 2.0, 2.0 / bodies.view.aspect)
    bodies.show(axes, bodies.view, 400, scale, np.ones(2), Normalize(0.0, 1.0))
    image = axes.images[0].get_array()
    coloured = (np.ptp(image.astype(int), axis=2) > 50).any(axis=0).nonzero()[0]
    low, high = bodies.view.extent[:2]
    ends = low + (high - low) * (coloured[[0, -1]] + [0, 1]) / image.shape[1]
    assert ends == pytest.approx([2.0 * scale, 2.0 + 2.0 * scale], abs=(high - low) / 400)


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


def test_many_steps_are_thinned_out_what_is_small_is_magnified(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    assert_allclose(close.extent, [0.8, 1.6, -0.35, 0.45])  # 0.4 m, and half of that on every side
    assert close_up(view, small * [4.0, 1.0, 1.0]) is None
    assert close_up(view, small[:1]) is close_up(view, small[:0]) is None


def test_an_obstacle_whose_map_ends_in_the_picture_is_drawn() -> None:
    height = stickslip.read("profile").obstacles["floor"].height
    ramp = stickslip.Graph(height=replace(height, rows=((0.0, 0.0), (1.0, 0.5))))
    axes = Sheet(3.0, 3.0).axes(0.5, 0.5, 2.0, 2.0)
    view = View.facing(np.array([[-1.0, -1.0, 0.0], [2.0, 1.0, 0.0]]))
    shade(axes, view, [Rigid(ramp, np.zeros(2), 0.0)], 1.0)
    assert axes.collections


def test_sides_of_order_2_are_curved_and_a_window_on_a_contact_shows_what_touches() -> None:
    """A half disc of order 2 with few cells, whose chords are up to .03 off the circle."""
    scene = stickslip.read("half_disc", ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.1", "steps.count=1"])
    simulation = stickslip.prepare(scene)
    *_, step = simulation.steps()
    mesh, radius = simulation.data, scene.geometry.radius
    bodies = PlaneBodies(mesh, step.displacement, (), 1.0)
    along = np.concatenate(bodies._edges_at(0.0 * step.displacement)[bodies._edges[1]])
    off = radius - np.linalg.norm(along - [0.0, radius], axis=1)[along[:, 1] < 0.9 * radius]
    assert mesh.cells.shape[1] in (6, 9)
    assert np.abs(off).max() < 1e-3
    pictures = BodyPictures(mesh, step, "", rigids(scene, step))
    (name,) = step.contacts
    touching = step.contacts[name].status != OPEN
    view = pictures.view_of_contact(name, touching)
    places = (mesh.points + step.displacement)[mesh.slaves[name]][touching]
    assert (np.abs(places - (view.low + view.high) / 2) < view.size / 2).all()
    assert view.size[0] < 4 * np.ptp(places[:, 0])
    axes = Sheet(4.0, 4.0).axes(0.5, 0.5, 3.0, 3.0 / view.aspect)
    pictures.show_contact(axes, view, name, 300)
    assert [*axes.get_xlim(), *axes.get_ylim()] == list(view.extent)  # obstacle and mesh reach farther
    assert len(axes.collections) > 4


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


def test_axes_of_a_history_have_the_unit_of_what_is_given() -> None:
    scene, columns = circle()
    grows = dataclasses.replace(
        scene.contacts["base"], friction=stickslip.Coulomb(mu=((0.0, 0.3), (24.0, 0.4))), gap_offset=((24.0, 1e-3),)
    )
    bolt = stickslip.Bolt(head="block.left", nut="block.right", axis=(1.0, 0.0), stiffness=1.0, force=((24.0, 2.0),))
    time = columns["time"]
    columns |= {f"contact.base.{key}": time for key in ("friction.mu", "gap_offset")} | {"bolt.m8.force": time}
    other = dataclasses.replace(scene, contacts={"base": grows}, sections={"bolts": {"m8": bolt}})
    labels = [label for label, _ in panels_of(other, from_rest(columns))]
    assert {"coefficient of friction [-]", "gap offset [m]", "force [N/m]"} <= set(labels)


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
