"""Bulges of curved sides, edges of areas between nodes, and pressures that grow without end."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import Delaunay

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.accuracy.areas import beyond_nodes, scatter, scatter_of_order_2
from stickslip.solvers.accuracy.facet_volume_correction import bulges
from stickslip.solvers.accuracy.mesh_error import grows, grows_in, without_limit
from stickslip.solvers.results.step_result import OPEN, SLIP, STICK


def side(points: Array, facets: Ints, shape: str = "interval", degree: int = 1, axisymmetric: bool = False) -> Surface:
    numbers = np.arange(len(points))
    return Surface(shape, degree, numbers, numbers, points, facets, np.ones(len(facets)), axisymmetric)


def line(x: Array, axisymmetric: bool = False) -> Surface:
    """Nodes at x on a straight line."""
    k = np.arange(len(x) - 1)
    return side(np.stack([x, 0 * x], axis=1), np.stack([k, k + 1], axis=1), axisymmetric=axisymmetric)


def with_middles(straight: Surface) -> Surface:
    """The same facets at order 2, in 2D."""
    middles = straight.points[straight.facets].mean(axis=1)
    facets = np.column_stack([straight.facets, len(straight.points) + np.arange(len(middles))])
    return side(np.concatenate([straight.points, middles]), facets, degree=2)


def arc(angles: Array) -> Surface:
    """Nodes on a circle of radius 2 m; the facets run clockwise, so that their outward normals point outward."""
    points = 2 * np.stack([np.cos(-angles), np.sin(-angles)], axis=1)
    k = np.arange(len(angles) - 1)
    return side(points, np.stack([k + 1, k], axis=1))


@pytest.mark.parametrize("angles", [np.linspace(0, 1, 9), np.linspace(0, 1, 9) ** 1.3])
def test_arcs_bulge_up_to_their_circle(angles: Array) -> None:
    straight = arc(angles)
    middles = with_middles(straight)
    moved = middles.points + bulges(straight, middles)
    off = np.abs(np.linalg.norm(moved, axis=1) - 2.0)
    flat = np.abs(np.linalg.norm(middles.points, axis=1) - 2.0)
    assert off[len(angles) :].max() < 0.02 * flat.max()
    assert_allclose(moved[: len(angles)], straight.points, rtol=0, atol=0)


def test_kinks_and_creases_do_not_bulge() -> None:
    x = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.2], [4.0, 0.4], [4.0, 1.4], [4.0, 2.4]])
    k = np.arange(6)
    straight = side(x, np.stack([k, k + 1], axis=1))
    assert not bulges(straight, with_middles(straight)).any()


def sphere(points: Array) -> Array:
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def test_a_sphere_bulges_in_3d() -> None:
    plane = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.4, 0.4, 9)), axis=-1).reshape(-1, 2)
    facets = Delaunay(plane + 1e-3 * np.sin(7 * plane[:, ::-1])).simplices
    corners = sphere(np.column_stack([plane, np.ones(len(plane))]))
    out = np.sign(
        np.einsum(
            "fd,fd->f",
            np.cross(corners[facets[:, 1]] - corners[facets[:, 0]], corners[facets[:, 2]] - corners[facets[:, 0]]),
            corners[facets].mean(axis=1),
        )
    )
    straight = Surface(
        "triangle", 1, np.arange(81), np.arange(81), corners, facets.astype(np.int64), out, axisymmetric=False
    )
    ends = [(1, 2), (0, 2), (0, 1)]
    pairs = np.sort(np.concatenate([facets[:, pair] for pair in ends]), axis=1)
    edges, number = np.unique(pairs, axis=0, return_inverse=True)
    middle = corners[edges].mean(axis=1)
    quadratic = np.column_stack([facets, 81 + number.reshape(3, -1).T])
    middles = Surface(
        "triangle",
        2,
        np.arange(81 + len(edges)),
        np.arange(81 + len(edges)),
        np.concatenate([corners, middle]),
        quadratic.astype(np.int64),
        out,
        axisymmetric=False,
    )
    moved = middles.points + bulges(straight, middles)
    inside = np.abs(plane[edges]).max(axis=(1, 2)) < 0.35  # nodes at the rim know one side of their surroundings
    off = np.abs(np.linalg.norm(moved[81:], axis=1) - 1)[inside]
    assert off.mean() < 0.25 * np.abs(np.linalg.norm(middle, axis=1) - 1)[inside].mean()


@pytest.mark.parametrize("axisymmetric", [False, True])
def test_the_edge_of_contact_lies_where_the_gap_to_the_power_two_thirds_is_zero(axisymmetric: bool) -> None:
    x = np.linspace(0, 1, 11)
    straight = line(x, axisymmetric)
    for edge in (0.31, 0.37, 0.399):
        inside = x < edge
        found = straight.node_weights()[inside].sum() + beyond_nodes(straight, inside, np.maximum(x - edge, 0) ** 1.5)
        true = np.pi * edge**2 if axisymmetric else edge
        assert found == pytest.approx(true, rel=1e-2 if axisymmetric else 1e-12)


def test_edges_of_a_disc_are_found_between_its_nodes() -> None:
    points = np.random.default_rng(0).random((800, 2)) * 2 - 1
    facets = Delaunay(points).simplices.astype(np.int64)
    disc = side(np.column_stack([points, np.zeros(800)]), facets, "triangle")
    radius = np.linalg.norm(points, axis=1)
    off = []
    for edge in (0.5, 0.6, 0.7):
        inside = radius < edge
        nodes = disc.node_weights()[inside].sum()
        found = nodes + beyond_nodes(disc, inside, np.maximum(radius - edge, 0) ** 1.5)
        off.append([abs(nodes - np.pi * edge**2), abs(found - np.pi * edge**2)])
    by_nodes, between = np.mean(off, axis=0)
    assert between < 0.5 * by_nodes


def test_facets_with_other_nodes_can_be_left_out() -> None:
    x = np.linspace(0, 1, 11)
    outside = np.maximum(x - 0.37, 0) ** 1.5
    assert beyond_nodes(line(x), x < 0.37, outside, among=x < 0.35) == 0
    assert beyond_nodes(line(x), x < 0.37, outside, among=x < 2) == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("pressure", "expected"),
    [
        (lambda r: (r + 0.02) ** -0.5, True),  # end of a punch
        (lambda r: (r + 0.01) ** -0.25, True),  # corner that sticks
        (lambda r: np.sqrt(np.maximum(1 - (r / 0.5) ** 2, 0)), False),  # Hertz
        (lambda r: np.sqrt(np.maximum(1 - (r / 0.1) ** 2, 0)), False),  # with three nodes
        (lambda r: 2 - r, False),
        (lambda r: 1 + 0 * r, False),
        (lambda r: np.exp(-2 * r), False),
    ],
)
def test_only_powers_grow(pressure: Callable[[Array], Array], expected: bool) -> None:
    x = np.linspace(0, 1, 26)
    assert grows(line(x), pressure(x)) is expected


@pytest.mark.parametrize(
    ("pressure", "expected"),
    [
        ([1.16, 1.0, 0.99, 0.99, 0.99, 0.99], True),  # less than is asked for elsewhere
        ([2.0, 1.0, 1.05, 1.0, 1.0, 1.0], True),  # it waves
        ([1.35, 1.05, 1.28, 1.37, 1.41, 1.41], True),  # towards a side that presses more elsewhere
        ([1.35, 1.05, 1.34, 1.06, 1.35, 1.05], False),  # from node to node
        ([1.0, 0.96, 0.93, 0.9, 0.87, 0.84], False),
        ([1.0, 0.99, 0.95, 0.87, 0.7, 0.5], False),  # symmetric about the end
        ([0.99, 1.16, 1.0, 0.99, 0.98, 0.98], False),  # beside the end
        ([1.16, 1.16, 1.09, 1.06, 1.04, 1.02], True),  # the end has the multiplier of its neighbour
        ([1.0, 1.0, 1.0, 1.0, 1.0, 1.0], False),
    ],
)
def test_at_the_end_of_a_side_a_smaller_fall_is_enough(pressure: list[float], expected: bool) -> None:
    assert grows(line(np.linspace(0, 1, 6)), np.array(pressure)) is expected


@pytest.mark.parametrize(("low", "expected"), [(1.0, False), (0.9, True), (0.7, False)])
def test_a_lower_pressure_that_grows_becomes_the_largest(low: float, expected: bool) -> None:
    """The end of a punch beside a smooth pressure; 1.0: it falls off no more steeply than that one."""
    x = np.linspace(0, 1, 26)
    end = np.exp(-2 * x) if low == 1.0 else low * ((x + 0.02) / 0.02) ** -0.5
    pressure = np.maximum(end, np.maximum(1 - (x - 0.7) ** 2 / 0.2, 0))
    assert grows(line(x), pressure) is expected


@pytest.mark.parametrize("shape", ["triangle", "quadrilateral"])
@pytest.mark.parametrize(("peak", "expected"), [((0, 0), True), ((0, 2), True), ((2, 2), False)])
def test_ends_of_a_square_are_its_corners_and_edges(shape: str, peak: tuple[int, int], expected: bool) -> None:
    x = np.arange(5)
    points = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((5, 5))], axis=-1).reshape(-1, 3).astype(float)
    a = (5 * x[:4, None] + x[:4]).ravel()
    quads = np.stack([a, a + 1, a + 5, a + 6], axis=1)
    facets = quads if shape == "quadrilateral" else np.concatenate([quads[:, [0, 1, 3]], quads[:, [0, 2, 3]]])
    pressure = np.ones((5, 5))
    pressure[peak] = 1.1
    assert grows(side(points, facets, shape), pressure.ravel()) is expected


@pytest.mark.parametrize("sticks", [3, 6])
def test_areas_are_uncertain_by_the_facets_that_their_edges_cross(sticks: int) -> None:
    x, zeros = np.linspace(0, 1, 11), np.zeros(11)
    status = np.full(11, OPEN)
    status[:6], status[:sticks] = SLIP, STICK
    slip = np.maximum(x - (sticks - 0.5) / 10, 0)[:, None]
    contact = SimpleNamespace(status=status, gap=np.maximum(x - 0.55, 0), slip_increment=np.c_[slip, zeros])
    found = scatter(line(x), contact, line(x).node_weights())  # type: ignore[arg-type]
    expected = pytest.approx({"contact_area": 0.1, "stick_area": 0.1, "slip_area": 0.1 * np.sqrt(2)})
    assert found == expected
    ends = np.arange(0, 10, 2)
    whole = side(line(x).points, np.stack([ends, ends + 2, ends + 1], axis=1), degree=2)
    assert scatter_of_order_2(whole, contact, line(x).node_weights()) == expected  # type: ignore[arg-type]


def test_nothing_grows_without_pressure_or_on_few_nodes() -> None:
    assert not grows(line(np.linspace(0, 1, 26)), np.zeros(26))
    assert not grows(line(np.linspace(0, 1, 2)), np.array([3.0, 1.0]))


@pytest.mark.parametrize(("power", "endless"), [(-0.5, True), (-0.3, True), (1.0, False), (0.0, False)])
def test_a_stress_grows_without_end_at_a_singular_point_alone(power: float, endless: bool) -> None:
    """A field r^power around a corner of the square, in cells of one size."""
    n = 8
    numbers = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    cells = np.stack([numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, :-1], numbers[1:, 1:]], axis=-1).reshape(-1, 4)
    middle = np.stack(np.meshgrid(*[np.arange(n) + 0.5] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    stress = np.linalg.norm(middle, axis=1)[:, None, None] ** power * np.eye(3)
    assert grows_in(cells, stress, 0) is endless
    assert not grows_in(cells, stress, n * n // 2 + n // 2)
    assert not grows_in(cells[:1], stress[:1], 0)  # nothing is beside it


@pytest.mark.parametrize("closed", [True, False])
def test_pressures_of_rounding_do_not_grow(closed: bool) -> None:
    x = np.linspace(0, 1, 26)
    status, slip = np.full(26, SLIP if closed else OPEN), np.zeros((26, 2))
    contact = SimpleNamespace(pressure=(x + 0.02) ** -0.5, slip=slip, status=status)
    rows = SimpleNamespace(name="base", surface=line(x), normal=SimpleNamespace(at_quadrature=False))
    said = without_limit(rows, contact, 1e-12)  # type: ignore[arg-type]
    assert [key.quantity for key in said] == ["max_pressure"] * closed


@pytest.mark.parametrize("shape", ["triangle", "quadrilateral"])
@pytest.mark.parametrize(("power", "expected"), [(-0.5, True), (0.5, False), (1.0, False)])
def test_along_an_edge_pressures_behind_it_count(shape: str, power: float, expected: bool) -> None:
    """Nearly as high all along the edge x = 0, with a largest one somewhere."""
    x = np.arange(7)
    points = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((7, 7))], axis=-1).reshape(-1, 3).astype(float)
    a = (7 * x[:6, None] + x[:6]).ravel()
    quads = np.stack([a, a + 1, a + 7, a + 8], axis=1)
    facets = quads if shape == "quadrilateral" else np.concatenate([quads[:, [0, 1, 3]], quads[:, [0, 2, 3]]])
    pressure = (points[:, 0] + 0.3) ** power if power < 0 else (7 - points[:, 0]) ** power
    assert grows(side(points, facets, shape), pressure * (1 + 1e-3 * np.sin(points[:, 1] / 2))) is expected
