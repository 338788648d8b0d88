"""Lines from slave points meet the right facet of a master surface, at the right place."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from shared.cases import every_nth
from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.surfaces import search
from stickslip.geometry.surfaces.search import Pairing, intersect, orthogonal_frames, pair
from stickslip.geometry.surfaces.surface import Surface

Map = Callable[[Array], Array]
KINDS = [(shape, degree) for shape in ("interval", "triangle", "quadrilateral") for degree in (1, 2)]
DIM = {"interval": 1, "triangle": 2, "quadrilateral": 2}


def image(shape: str, degree: int, cells: int, mapping: Map) -> Surface:
    """The surface that `mapping` makes of the unit interval or square; the outward normal is up for the identity."""
    dim = DIM[shape]
    corner, turn = np.zeros((1, dim)), np.array([np.eye(dim)])
    if shape == "triangle":
        corner, turn = np.array([[0.0, 0.0], [1.0, 1.0]]), np.array([np.eye(2), -np.eye(2)])
    grid = np.stack(np.meshgrid(*[np.arange(cells)] * dim, indexing="ij"), axis=-1).reshape(-1, 1, 1, dim)
    at = grid + corner[:, None] + dx.reference_nodes(shape, degree) @ turn
    nodes, rows = np.unique(np.rint(degree * at).astype(int).reshape(-1, dim), axis=0, return_inverse=True)
    points = mapping(nodes / (degree * cells))
    facets = rows.reshape(len(grid) * len(corner), -1)
    outward = np.full(len(facets), -1.0 if dim == 1 else 1.0)
    number = np.arange(len(points))
    return Surface(shape, degree, number, number, points, facets, outward, axisymmetric=False)


def flat(height: float) -> Map:
    return lambda u: np.column_stack([u, np.full(len(u), height)])


def cap(radius: float) -> Map:
    """A part of the circle or sphere around the origin, 90 degrees wide."""

    def mapping(u: Array) -> Array:
        v = np.column_stack([2 * u - 1, np.ones(len(u))])
        return np.asarray(radius * v / np.linalg.norm(v, axis=1, keepdims=True))

    return mapping


def rough(height: float, seed: int, shift: float = 0.02) -> Map:
    """Random heights over a grid that is shifted at random."""

    def mapping(u: Array) -> Array:
        inside = np.random.default_rng(seed)
        moved = u + inside.uniform(-shift, shift, u.shape)
        return np.column_stack([moved, inside.uniform(-height, height, len(u))])

    return mapping


def both(first: Surface, second: Surface) -> Surface:
    """Two surfaces of a kind as one."""
    n = len(first.points) + len(second.points)
    return replace(
        first,
        nodes=np.arange(n),
        input=np.arange(n),
        points=np.concatenate([first.points, second.points]),
        facets=np.concatenate([first.facets, second.facets + len(first.points)]),
        outward=np.concatenate([first.outward, second.outward]),
    )


def unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def down(m: int, dim: int) -> Array:
    return np.tile(np.append(np.zeros(dim - 1), -1.0), (m, 1))


def random_lines(m: int, dim: int, height: float, seed: int = 0) -> tuple[Array, Array]:
    """Points in the unit box, mostly over the master; directions mostly down."""
    inside = np.random.default_rng(seed)
    points = np.column_stack([inside.uniform(-0.1, 1.1, (m, dim - 1)), inside.uniform(-height, height, m)])
    return points, unit(np.column_stack([inside.uniform(-0.6, 0.6, (m, dim - 1)), -np.ones(m)]))


def assert_on_the_lines(found: Pairing, points: Array, directions: Array, master: Surface) -> None:
    met = found.facet >= 0
    place = found.weights(master) @ master.points
    assert_allclose(place[met], (points + np.where(met, found.gap, 0)[:, None] * directions)[met], atol=1e-7)


def brute_force(points: Array, directions: Array, master: Surface, reach: float) -> tuple[Array, NDArray[np.bool_]]:
    """Smallest |gap| over all facets (m,), and which facets have it (m, f)."""
    m, f = len(points), len(master.facets)
    i, j = np.repeat(np.arange(m), f), np.tile(np.arange(f), m)
    met, _, gap = intersect(master, j, points[i], directions[i], orthogonal_frames(directions)[i])
    size = np.where(met & (np.abs(gap) <= reach), np.abs(gap), np.inf).reshape(m, f)
    least = size.min(axis=1)
    return least, np.isfinite(size) & (size <= least[:, None] + 1e-12)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
@pytest.mark.parametrize("gap", [0.3, 0.0, -0.3])  # facets are 0.1 long: overlaps of several
def test_gap_over_a_plane_is_the_height_along_the_direction(shape: str, degree: int, gap: float) -> None:
    master = image(shape, degree, 10, flat(0.0))
    inside = np.random.default_rng(3)
    points = np.column_stack([inside.uniform(0.3, 0.7, (50, DIM[shape])), np.full(50, gap)])
    directions = unit(np.column_stack([inside.uniform(-0.5, 0.5, (50, DIM[shape])), -np.ones(50)]))
    found = pair(points, directions, master, 1.0)
    assert_allclose(found.gap, gap / -directions[:, -1], atol=1e-12)
    assert_on_the_lines(found, points, directions, master)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_gap_to_a_circle_or_sphere_has_the_order_of_the_facets(shape: str, degree: int) -> None:
    inside = np.random.default_rng(5)
    rays = unit(np.column_stack([inside.uniform(-0.5, 0.5, (200, DIM[shape])), np.ones(200)]))
    start = inside.uniform(0.7, 1.3, 200)  # overlaps and openings of several facets
    errors = []
    for cells in (8, 16):
        master = image(shape, degree, cells, cap(1.0))
        found = pair(start[:, None] * rays, -rays, master, 1.0)
        errors.append(np.abs(found.gap - (start - 1)).max())
        assert_on_the_lines(found, start[:, None] * rays, -rays, master)
    # interpolation: h^2 and h^3; a chord c has the sagitta c^2 / 8, chords are 2/8 long, diagonals sqrt(2) times that
    assert np.log2(errors[0] / errors[1]) > degree + 0.8
    assert errors[0] < ((2 / 8) ** 2 * DIM[shape] / 8 if degree == 1 else 1e-3)


@pytest.mark.parametrize(("kind", "height"), every_nth(2, KINDS, [0.02, 0.3]))
def test_search_agrees_with_trying_all_facets(
    kind: tuple[str, int], height: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    shape, degree = kind
    monkeypatch.setattr(search, "BLOCK", 70)  # several blocks
    dim = DIM[shape] + 1
    master = image(shape, degree, 60 if dim == 2 else 7, rough(height, seed=1))
    points, directions = random_lines(300, dim, height=0.4)
    for reach in (0.2, np.inf):
        found = pair(points, directions, master, reach)
        least, which = brute_force(points, directions, master, reach)
        met = np.isfinite(least)
        assert 20 < np.count_nonzero(met) < 300
        assert_array_equal(found.facet >= 0, met)
        assert_allclose(np.abs(found.gap), least, atol=1e-8)
        assert which[met, found.facet[met]].all()


@pytest.mark.parametrize("shape", ["interval", "triangle", "quadrilateral"])
def test_graded_master_is_searched_in_all_its_sizes(shape: str) -> None:
    # facets from 1 to 1e-6 of the side
    master = image(shape, 1, 30, lambda u: np.column_stack([u**4, np.zeros(len(u))]))
    at = np.geomspace(1e-6, 0.999, 400)
    points = np.column_stack([*[at] * DIM[shape], np.full(400, 0.1)])
    assert_allclose(pair(points, down(400, master.dim), master, 1.0).gap, 0.1)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
@pytest.mark.parametrize("gap", [1e-3, -0.4, 50.0])
def test_lines_through_nodes_and_edges_meet_a_facet(shape: str, degree: int, gap: float) -> None:
    # a graph without folds, whose lines meet it once; turned, so that no coordinate of an edge is exact
    master = image(shape, degree, 9, rough(0.02, seed=2, shift=0.005))
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.eye(master.dim)
    turn[np.ix_([0, -1], [0, -1])] = [[c, -s], [s, c]]
    nodes = master.points[master.facets].reshape(-1, master.dim)
    direction = down(len(nodes), master.dim)
    found = pair(
        (nodes - gap * direction) @ turn.T, direction @ turn.T, replace(master, points=master.points @ turn.T), 60.0
    )
    assert (found.facet >= 0).all()
    assert_allclose(found.gap, gap, atol=1e-6)
    of_node = [set(np.flatnonzero((master.facets == j).any(axis=1)).tolist()) for j in master.facets.ravel()]
    assert all(facet == min(of) for facet, of in zip(found.facet.tolist(), of_node, strict=True))


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_far_side_of_a_thin_plate_is_never_met(shape: str, degree: int) -> None:
    # 0.01 thick: the far face is nearer to a point 0.007 deep
    top, bottom = image(shape, degree, 8, flat(0.0)), image(shape, degree, 8, flat(-0.01))
    plate = both(replace(bottom, outward=-bottom.outward), top)
    points = np.full((5, plate.dim), 0.4)
    points[:, -1] = [0.1, 0.0, -0.007, -0.01, -0.3]
    found = pair(points, down(5, plate.dim), plate, 1.0)
    assert (found.facet >= len(bottom.facets)).all()
    assert_allclose(found.gap, points[:, -1], atol=1e-12)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_lines_beside_or_along_the_master_or_out_of_reach_meet_nothing(shape: str, degree: int) -> None:
    master = image(shape, degree, 5, flat(0.0))
    points = np.full((4, master.dim), 0.5)
    points[:, -1] = 0.2
    points[0, 0] = 1.001
    directions = down(4, master.dim)
    directions[1] = np.eye(master.dim)[0]
    directions[2] *= -1
    found = pair(points, directions, master, 0.1999)
    assert_array_equal(found.facet, -1)
    assert_array_equal(found.gap, np.inf)
    assert found.weights(master).nnz == 0
    assert_array_equal(pair(points, directions, master, 0.2001).facet >= 0, [False, False, False, True])


@pytest.mark.parametrize("shape", ["interval", "triangle", "quadrilateral"])
def test_points_far_beyond_reach_meet_nothing(shape: str) -> None:
    master = image(shape, 1, 5, flat(0.0))
    points = np.full((2, master.dim), 0.5)
    points[:, -1] = [1e3, -1e3]
    assert_array_equal(pair(points, down(2, master.dim), master, 0.1).facet, -1)
    assert_allclose(pair(points, down(2, master.dim), master, np.inf).gap, points[:, -1])


def test_of_two_layers_the_nearer_is_met_whichever_side_the_point_is() -> None:
    layers = both(image("triangle", 1, 6, flat(0.0)), image("triangle", 1, 6, flat(1.0)))
    points = np.array([[0.4, 0.3, 0.4], [0.4, 0.3, 0.6], [0.4, 0.3, 3.0], [0.4, 0.3, -3.0]])
    assert_allclose(pair(points, down(4, 3), layers, 5.0).gap, [0.4, -0.4, 2.0, -3.0], atol=1e-12)


def test_long_lines_close_to_a_wall_end() -> None:
    # a point whose line runs along 2000 facets that do not face it, to the floor
    wall = image("interval", 1, 2000, lambda u: np.column_stack([np.zeros(len(u)), u]))
    floor = image("interval", 1, 10, flat(0.0))
    found = pair(np.array([[1e-4, 0.9]]), np.array([[0.0, -1.0]]), both(wall, floor), np.inf)
    assert_array_equal(found.facet, [2000])
    assert_allclose(found.gap, 0.9)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_order_of_points_and_facets_does_not_matter(shape: str, degree: int) -> None:
    master = image(shape, degree, 9, rough(0.1, seed=4))
    points, directions = random_lines(200, master.dim, height=0.4)
    found = pair(points, directions, master, 1.0)
    inside = np.random.default_rng(6)
    rows, facets = inside.permutation(200), inside.permutation(len(master.facets))
    turned = pair(points[rows], directions[rows], replace(master, facets=master.facets[facets]), 1.0)
    assert_array_equal(np.append(facets, -1)[turned.facet], found.facet[rows])
    assert_allclose(turned.gap, found.gap[rows])


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_millimetres_and_metres_meet_the_same_facets(shape: str, degree: int) -> None:
    master = image(shape, degree, 9, rough(0.1, seed=7))
    points, directions = random_lines(200, master.dim, height=0.4)
    points = np.concatenate([points, master.points - 0.1 * down(1, master.dim)])
    directions = np.concatenate([directions, down(len(master.points), master.dim)])
    metres = pair(points, directions, master, 1.0)
    millimetres = pair(1e3 * points, directions, replace(master, points=1e3 * master.points), 1e3)
    assert_array_equal(millimetres.facet, metres.facet)
    assert_allclose(millimetres.gap, 1e3 * metres.gap)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_weights_are_the_masters_basis(shape: str, degree: int) -> None:
    # a field of the basis' own degree is met exactly on a plane
    master = image(shape, degree, 6, flat(0.0))
    points, directions = random_lines(100, master.dim, height=0.1)
    found = pair(points, directions, master, 1.0)
    met = found.facet >= 0
    weights = found.weights(master)
    assert weights.shape == (100, len(master.points))
    assert_allclose(weights.sum(axis=1).A1, met, atol=1e-12)
    at = points + np.where(met, found.gap, 0)[:, None] * directions
    field = master.points[:, 0] ** degree
    assert_allclose((weights @ field)[met], at[met, 0] ** degree, atol=1e-7)


def test_no_points_meet_nothing() -> None:
    found = pair(np.zeros((0, 3)), np.zeros((0, 3)), image("triangle", 1, 2, flat(0.0)), 1.0)
    assert found.facet.shape == (0,)
