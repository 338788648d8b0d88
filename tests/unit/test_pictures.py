"""Pictures exist, show something, and survive whatever a contact can look like."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.image import imread
from numpy.typing import NDArray

from shared.cases import every_nth, often, slow
from shared.images import colours
from stickslip.geometry.errors import MachineError
from stickslip.geometry.obstacles.obstacle import Rotation
from stickslip.geometry.obstacles.plane import Plane
from stickslip.solvers.results.step_result import (
    OPEN,
    PARTS,
    SLIP,
    STICK,
    ContactState,
    ErrorParts,
    MeshData,
    Quantity,
    StepResult,
)
from stickslip.solvers.scene.record import CONTACT_NUMBERS, Energy
from stickslip.workflows.formats.contact_line import walk
from stickslip.workflows.pictures.body_picture import displacement_scale
from stickslip.workflows.pictures.contact_maps import dual_cells, view_of
from stickslip.workflows.pictures.draw import _said, draw
from stickslip.workflows.pictures.render import grid_of, outline_of, surface_of
from stickslip.workflows.pictures.rigid import Rigid
from stickslip.workflows.pictures.sheet import Sheet
from stickslip.workflows.pictures.view import View, focus

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
    contact = ContactState(
        points=at,
        weight=np.ones(len(at)),
        gap=np.where(p > 0, 0.0, 0.01),
        pressure=p * size,
        traction=np.outer(-0.3 * p * share, along) * size,
        slip=np.outer(share == 1.0, along) * 0.01,
        slip_increment=np.outer(share == 1.0, along) * 0.01,
        bound=0.3 * p * size,
        lam=np.outer(np.where(p > 0, share, 0.0), along),
        status=status,
        force=np.zeros(d),
        moment=np.zeros(1 if d == 2 else 3),
        **dict.fromkeys(CONTACT_NUMBERS, 0.0),
    )
    return StepResult(
        time=1.0,
        substeps=1,
        iterations=1,
        volume_solves=1,
        residual=0.0,
        displacement=displacement,
        stress=stress * size,
        contacts={"base": contact},
        supports={},
        probes={},
        energy=Energy(0.0, 0.0, 0.0, 0.0, np.zeros(1)),
        iteration_error=0.0,
        mesh_error=0.0,
        stress_error=np.abs(stress[:, d - 1, d - 1]) * size / 10,
        law_error=0.0,
        p=np.zeros(0),
        w=np.zeros(0),
        reference=np.zeros(0),
        driven=np.zeros(0),
        shortened=np.zeros(0),
        searched={},
        slid={},
        obstacles={},
        p_ref=1.0,
        u_ref=1.0,
        history=(),
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
    assert said["sticks on"] == "1 m"  # no error is known
    assert _said("base", contact, {}, per_metre=False)["sticks on"] == "1 m²"


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
    ("largest", "scale"), [(0.0, 1.0), (0.05, 1.0), (0.3, 1.0), (1e-4, 1000.0), (0.01, 10.0), (4.0, 1.0)]
)
def test_displacements_are_scaled_by_a_round_factor_unless_they_are_seen(largest: float, scale: float) -> None:
    mesh = block("quadrilateral", n=1)
    step = pressed(mesh)
    moved = np.zeros_like(mesh.points)
    moved[0, 1] = -largest
    assert displacement_scale(mesh, dataclasses.replace(step, displacement=moved)) == pytest.approx(scale)


@pytest.mark.parametrize(("gap", "scale"), [(0.0, 1000.0), (1e-9, 1000.0), (-1e-4, 100.0), (1e-3, 10.0), (1.0, 1.0)])
def test_bodies_that_touch_are_not_drawn_into_each_other(gap: float, scale: float) -> None:
    mesh = block("quadrilateral", n=1)
    step = pressed(mesh)
    (name,) = step.contacts
    contact = step.contacts[name]
    assert (contact.status != OPEN).any()
    gaps = np.where(contact.status != OPEN, gap, 2.0)  # where nothing touches it does not matter
    moved = np.zeros_like(mesh.points)
    moved[0, 1] = -1e-4
    found = displacement_scale(
        dataclasses.replace(mesh, gaps={name: gaps}), dataclasses.replace(step, displacement=moved)
    )
    assert found == pytest.approx(scale)  # (scale - 1) gap is half a per cent of 2 m at most


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
    outline = outline_of(surface_of(grid_of(mesh.points, mesh.cells, mesh.shape)), solid=True)
    assert outline.compute_cell_sizes()["Length"].sum() == pytest.approx(4 * (2 + 1 + 1))


def test_a_contact_line_is_walked_from_end_to_end() -> None:
    points = np.array([[2.0, 0.0], [0.0, 0.0], [1.0, 0.0], [3.0, 0.0]])
    line = walk(points, np.array([[2, 0], [2, 1], [0, 3]]))
    assert line.nodes.tolist() == [1, 2, 0, 3]
    assert line.place.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert line.label == "x [m]"
    assert line.tangents.tolist() == [[1.0, 0.0]] * 4


def test_middle_nodes_of_curved_facets_are_walked_too() -> None:
    points = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 0.0]])
    assert walk(points, np.array([[0, 1, 2]])).nodes.tolist() == [0, 2, 1]


def test_a_closed_contact_line_returns_to_its_start_over_its_arc_length() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    line = walk(circle, np.column_stack([np.arange(64), np.roll(np.arange(64), -1)]))
    assert line.nodes[0] == line.nodes[-1]
    assert line.label == "arc length [m]"
    assert line.place[-1] == pytest.approx(2 * np.pi, rel=1e-3)  # the polygon is shorter by (2 pi / 64)^2 / 24
    radial = np.einsum("ki,ki->k", line.tangents, circle[line.nodes])
    assert np.abs(radial).max() < 1e-12


def test_a_contact_line_in_two_pieces_has_a_break() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0], [4.0, 0.0]])
    line = walk(points, np.array([[0, 1], [2, 3]]))
    assert line.starts.tolist() == [True, False, True, False]


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
