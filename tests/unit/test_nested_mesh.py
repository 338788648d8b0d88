"""Plane meshes cut nested: conforming, exactly the same bodies, on the circle where sides are curved."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.nested_mesh import EDGES, FlatMesh
from stickslip.geometry.shape import Request

CORNERS = {"triangle": 3, "quadrilateral": 4}


def flat(kind: str, points: Array, corners: Ints, body: list[int], sides: dict[str, list[tuple[int, int]]]) -> FlatMesh:
    """A mesh by the corners of its cells; the other nodes are half way between them."""
    x, cells, between = list(points), list[list[int]](), dict[tuple[int, int], int]()
    for cell in corners.tolist():
        nodes = list(cell)
        for a, b, _ in EDGES[kind]:
            pair = min(cell[a], cell[b]), max(cell[a], cell[b])
            if pair not in between:
                between[pair] = len(x)
                x.append((points[pair[0]] + points[pair[1]]) / 2)
            nodes.append(between[pair])
        if kind == "quadrilateral":
            nodes.append(len(x))
            x.append(points[cell].mean(axis=0))
        cells.append(nodes)
    facets = {name: np.array([[a, b, between[min(a, b), max(a, b)]] for a, b in ends]) for name, ends in sides.items()}
    names = tuple(f"body_{k}" for k in range(max(body) + 1))
    return FlatMesh(
        kind=kind, points=np.array(x), cells=np.array(cells), body=np.array(body), names=names, sides=facets
    )


def grid(kind: str) -> FlatMesh:
    """2 x 1, the left half one body, the right half another one, in a row of four squares; both share an edge."""
    points = np.array([[x, y] for y in (0.0, 1.0) for x in (0.0, 0.5, 1.0, 1.5, 2.0)])
    squares = np.array([[k, k + 1, k + 5, k + 6] for k in range(4)])
    triangles = np.concatenate([squares[:, [0, 1, 2]], squares[:, [1, 2, 3]]])
    cells, body = (squares, [0, 0, 1, 1]) if kind == "quadrilateral" else (triangles, [0, 0, 1, 1] * 2)
    sides = {"body_0.left": [(0, 5)], "body_1.right": [(4, 9)], "body_0.bottom": [(0, 1), (1, 2)]}
    return flat(kind, points, cells, body, sides)


def areas(mesh: FlatMesh) -> Array:
    """Of the bodies, by their curved cells."""
    points, weights = dx.reference_rule(mesh.kind, 6)
    slope = dx.reference_basis(mesh.kind, 2, points)[1]
    jacobian = np.linalg.det(np.einsum("aqn,cni->cqai", slope, mesh.points[mesh.cells]))
    return np.bincount(mesh.body, np.abs(jacobian @ weights))


@pytest.mark.parametrize("kind", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("marked", [[0], [1, 2], [0, 3]])
def test_cut_cells_are_conforming_and_fill_the_same_bodies(kind: str, marked: list[int]) -> None:
    mesh = grid(kind)
    edges = mesh.edges()[0]
    shared = edges[(edges[:, :2] == [2, 7]).all(axis=1)][0, 2]
    mesh.points[shared] += 0.1, 0.05  # curved: each body has its area only if the new nodes lie on this very curve
    once = mesh.cut(np.isin(np.arange(len(mesh.cells)), marked))
    twice = once.cut(once.touching(np.array([2, 7])))
    for finer in (once, twice):
        assert len(finer.cells) > len(mesh.cells)
        assert_allclose(areas(finer), areas(mesh), rtol=1e-14)
        found, of_cells = finer.edges()
        assert len(np.unique(found[:, :2], axis=0)) == len(found)
        assert set(np.bincount(of_cells.ravel())) == {1, 2}
        assert set(np.unique(finer.cells)) == set(range(len(finer.points)))
        on_box = finer.boundary()
        x = finer.points[on_box]
        lengths = np.linalg.norm(x[:, 0] - x[:, 1], axis=1)
        assert lengths.sum() == pytest.approx(6.0)  # nothing hangs
        assert np.array_equal(finer.points[: len(mesh.points)], mesh.points)
        for name, facets in finer.sides.items():
            ends = finer.points[facets]
            assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum() == pytest.approx(1.0), name
            assert np.isin(facets[:, 2], on_box[:, 2]).all()


def test_uniform_cuts_make_four_of_each_cell() -> None:
    for kind in CORNERS:
        mesh = grid(kind)
        finer = mesh.cut(np.ones(len(mesh.cells), bool))
        assert len(finer.cells) == 4 * len(mesh.cells)
        assert [len(facets) for facets in finer.sides.values()] == [2, 2, 4]


def test_new_nodes_of_a_curved_side_lie_on_its_circle() -> None:
    points = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]])
    mesh = flat("triangle", points, np.array([[0, 1, 2]]), [0], {"body_0.arc": [(1, 2)]})
    arc = mesh.sides["body_0.arc"][0, 2]
    mesh.points[arc] = 3 / np.sqrt(2)
    for _ in range(3):
        mesh = mesh.cut(mesh.touching(np.array([1])))
    on_arc = np.unique(mesh.sides["body_0.arc"])
    assert len(on_arc) == 9
    assert_allclose(np.linalg.norm(mesh.points[on_arc], axis=1), 3.0, rtol=1e-14)


def test_periodic_sides_are_cut_alike() -> None:
    alone = grid("triangle")
    mesh = replace(alone, periodic=(("body_0.left", "body_1.right"),))
    for one, count in ((alone, 1), (mesh, 2)):
        finer = one.cut(one.touching(np.array([0, 5])))
        assert len(finer.sides["body_0.left"]) == 2
        assert len(finer.sides["body_1.right"]) == count


@pytest.mark.parametrize("kind", ["triangle", "quadrilateral"])
def test_it_becomes_a_mesh_with_the_same_names(kind: str) -> None:
    mesh = grid(kind)
    finer = mesh.cut(mesh.touching(np.array([0])))
    built = build_mesh(finer, Request(model="plane strain"), MPI.COMM_SELF)
    assert list(built.bodies) == ["body_0", "body_1"]
    assert {side: len(built.facets(side)) for side in built.sides} == {k: len(v) for k, v in finer.sides.items()}
    assert built.degree == 2
    assert np.array_equal(built.box(), [[0, 0], [2, 1]])
    assert built.part_count == 1
