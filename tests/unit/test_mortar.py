"""Mortar integrals: what goes from one surface to the other is neither lost nor bent."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy import sparse

from shared.cases import every_nth
from shared.overlays import above, ball, below, both, flat, scattered
from stickslip.geometry.surfaces.facet_map import place
from stickslip.geometry.surfaces.overlap import Overlap, overlap
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.mortar import mortar_coupling, mortar_integrals

Array = NDArray[np.float64]
SHAPES = ("interval", "triangle", "quadrilateral")
KINDS = [(shape, degree) for shape in SHAPES for degree in (1, 2)]
COUNTS = [((2, 2), (3, 3)), ((1, 1), (20, 20)), ((20, 20), (1, 1)), ((5, 3), (4, 7))]
BOXES = {"whole": ((0.0, 0.0), (1.0, 1.0)), "edge": ((0.33, -0.5), (1.9, 2.0)), "inside": ((0.31, 0.12), (0.77, 0.93))}
EXACT = 8  # the degree of phi_i phi_j on a quadratic quadrilateral, the highest of all
ROUNDING = 1e-11  # of dual functions that reach 100 on a facet of which a tenth is covered


def laid(slave: Surface, master: Surface, degree: int = EXACT) -> tuple[Overlap, Array, Any, Array, Any]:
    found = overlap(slave, master, 0.5, degree)
    return found, *mortar_integrals(slave, master, found)


def at_points(surface: Surface, facets: NDArray[np.int64], local: Array, change: Array) -> Any:
    """Sparse (q, n): nodal values to values at points."""
    basis = place(surface, facets, local).basis @ change.T
    rows = np.repeat(np.arange(len(local)), basis.shape[1])
    return sparse.csr_matrix((basis.ravel(), (rows, surface.facets[facets].ravel())), (len(local), len(surface.points)))


def check(slave: Surface, master: Surface) -> None:
    """All that must hold on flat surfaces 0.1 apart."""
    found, W, P, gap, psi = laid(slave, master)
    k, covered = slave.facets.shape[1], W != 0
    phi = at_points(slave, found.slave_facet, found.slave_local, slave.change)
    onto = at_points(master, found.master_facet, found.master_local, np.eye(master.facets.shape[1]))
    assert_allclose(W, found.weights @ phi, atol=ROUNDING / len(W))
    assert_allclose((psi @ phi - sparse.diags(W)).toarray()[covered], 0, atol=ROUNDING / len(W))  # biorthogonal
    weighty = np.abs(W) > 1e-3 * W.max() / k
    assert_allclose(P.sum(axis=1)[weighty], 1.0, rtol=ROUNDING)
    assert_allclose(gap[weighty], 0.1, rtol=ROUNDING)
    assert_allclose(P.T @ W, found.weights @ onto, atol=ROUNDING / len(master.points))  # a unit pressure's forces
    slope = np.arange(1.0, slave.dim)
    moved, driven = slave.points[:, :-1] @ slope + 3.0, master.points[:, :-1] @ slope + 3.0
    assert_allclose((slave.transform @ moved)[weighty], (P @ driven)[weighty], rtol=ROUNDING)
    assert not P[~covered].nnz
    assert not psi[~covered].nnz
    assert np.all(np.isinf(gap) == ~covered)


@pytest.mark.parametrize(("kind", "counts", "box"), every_nth(4, KINDS, COUNTS, BOXES))
def test_forces_and_linear_displacements_go_over_exactly(kind: tuple[str, int], counts: Any, box: str) -> None:
    shape, degree = kind
    check(below(shape, degree, counts[0]), above(shape, degree, counts[1], box=BOXES[box]))


@pytest.mark.parametrize(("kind", "counts", "box"), every_nth(4, KINDS, COUNTS, BOXES))
def test_friction_weighs_no_pressure_of_a_law_negatively(kind: tuple[str, int], counts: Any, box: str) -> None:
    """Nor on partly covered facets, where the weights are the covered area all the same."""
    shape, degree = kind
    slave = replace(below(shape, degree, counts[0]), positive=True)
    coupling = mortar_coupling(slave, above(shape, degree, counts[1], box=BOXES[box]), 0.5)
    points = coupling.points(EXACT)
    assert points.phi.data.min() > -1e-15
    assert_allclose(points.phi.sum(axis=0).A1, points.weights, atol=ROUNDING)
    for integrals in (points.phi, points.psi):
        assert_allclose(integrals.sum(axis=1).A1, coupling.weights, atol=ROUNDING)


@pytest.mark.parametrize(("one", "other"), [(1, 1), (2, 2), (1, 2), (2, 1)])
def test_random_triangles_transfer_exactly_whatever_the_orders(one: int, other: int) -> None:
    check(scattered(one, 30, 1, flat(0.0), 1.0), scattered(other, 60, 2, flat(0.1), -1.0))


def test_a_triangular_mesh_faces_quadrilaterals() -> None:
    check(below("triangle", 2, (2, 3)), above("quadrilateral", 1, (3, 2)))
    check(below("quadrilateral", 2, (2, 3)), above("triangle", 1, (3, 2)))


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_matching_meshes_pair_their_nodes(shape: str, degree: int) -> None:
    slave, master = below(shape, degree, (3, 2)), above(shape, degree, (3, 2))
    found, W, P, _, _ = laid(slave, master)
    assert_allclose(P.toarray(), slave.transform.toarray(), atol=1e-12)  # the same nodal values: X u = P u
    assert_allclose(W, slave.node_weights(), rtol=1e-12)
    assert_allclose(found.weights.sum(), 1.0, rtol=1e-13)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_a_covered_ball_weighs_what_its_surface_says(shape: str, degree: int) -> None:
    slave = below(shape, degree, (4, 4), ball(1.0))
    master = above(shape, degree, (9, 9), ball(1.1), ((-0.5, -0.5), (1.5, 1.5)))
    _, W, P, gap, _ = laid(slave, master, 12)
    weights, basis = slave.quadrature(12)  # the area is no polynomial
    assert_allclose(W, slave.scatter(weights @ basis @ slave.change.T), rtol=1e-9)
    assert_allclose(P.sum(axis=1), 1.0, rtol=1e-12)
    assert_allclose(gap, 0.1, rtol=0.1 if degree == 1 else 0.02)  # facets sag by h^2 / 8 R, a tenth of this gap at most
    # what faces a node lies beyond it: in the mean, its nodes are further out by the gap
    inner = slave.transform @ slave.points
    assert_allclose(np.linalg.norm(P @ master.points - inner, axis=1), 0.1, rtol=0.1 if degree == 1 else 0.02)


@pytest.mark.parametrize("degree", [1, 2])
def test_axisymmetric_rows_stand_on_the_axis_too(degree: int) -> None:
    slave = replace(below("interval", degree, (3, 3)), axisymmetric=True)
    _, W, P, gap, _ = laid(slave, replace(above("interval", degree, (4, 4)), axisymmetric=True))
    assert_allclose(W, slave.node_weights(), rtol=1e-12)
    assert W.min() > 0
    assert_allclose(W.sum(), np.pi, rtol=1e-12)
    assert_allclose(P.sum(axis=1), 1.0, rtol=1e-11)
    assert_allclose(gap, 0.1, rtol=1e-11)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_narrow_strip_of_a_facet_is_covered_without_losing_digits(shape: str) -> None:
    slave, master = below(shape, 1, (1, 1)), above(shape, 1, (3, 1), box=((-1.0, 0.0), (1e-4, 1.0)))
    _, W, P, gap, _ = laid(slave, master)
    covered = W > 0
    assert_allclose(W.sum(), 1e-4, rtol=1e-8)  # the far node of a triangle weighs 1e-12 of its whole: nothing
    assert_allclose(P.sum(axis=1)[covered], 1.0, rtol=1e-8)
    assert_allclose(gap[covered], 0.1, rtol=1e-8)
    x_slave, x_master = slave.points[:, 0], master.points[:, 0]
    assert_allclose((P @ x_master)[covered], x_slave[covered], atol=1e-8)  # extrapolated from the strip


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_a_spot_inside_a_facet_makes_means_rather_than_wild_extrapolation(shape: str, degree: int) -> None:
    width = 1e-5 if shape == "interval" else 1e-4
    spot = ((0.4, 0.3), (0.4 + width, 0.3 + width))
    found, W, P, gap, psi = laid(below(shape, degree, (1, 1)), above(shape, degree, (1, 1), box=spot))
    covered = W != 0
    assert np.abs(psi / found.weights).max() <= 1e6
    assert_allclose(P.sum(axis=1)[covered], 1.0, rtol=1e-9)
    assert_allclose(gap[covered], 0.1, rtol=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
def test_slivers_and_surfaces_apart_are_not_covered(shape: str) -> None:
    slave = below(shape, 1, (1, 1))
    sliver = above(shape, 1, (1, 1), box=((-1.0, 0.0), (1e-10, 1.0)))
    apart = above(shape, 1, (1, 1), box=((2.0, 0.0), (3.0, 1.0)))
    assert len(overlap(slave, sliver, 0.5, 2).gap)  # it is seen, and weighed as nothing
    for master in (sliver, apart, above(shape, 1, (1, 1), flat(9.0))):
        found, W, P, gap, psi = laid(slave, master)
        assert P.shape == (len(slave.points), len(master.points))
        assert psi.shape == (len(slave.points), len(found.gap))
        assert W.max() == P.nnz == psi.nnz == 0
        assert np.all(np.isinf(gap))


def test_a_quadratic_node_beyond_the_edge_can_weigh_less_than_nothing() -> None:
    # phi = (1 - x)(1 - 2 x) over x from 1/2 to 1
    _, W, _, _, _ = laid(below("interval", 2, (1, 1)), above("interval", 2, (1, 1), box=((0.5, 0.0), (2.0, 1.0))))
    assert_allclose(W.min(), -1 / 24, rtol=1e-12)
    assert_allclose(W.sum(), 0.5, rtol=1e-12)


def test_the_weighted_gap_follows_a_step_of_the_master() -> None:
    slave = below("interval", 1, (2, 2))
    master = both(
        above("interval", 1, (1, 1), flat(0.1), ((0.0, 0.0), (0.5, 0.0))),
        above("interval", 1, (1, 1), flat(0.3), ((0.5, 0.0), (1.0, 0.0))),
    )
    _, _, _, gap, _ = laid(slave, master)
    assert_allclose(gap[np.argsort(slave.points[:, 0])], [0.1, 0.2, 0.3], rtol=1e-12)


def test_the_dual_basis_of_a_quadratic_strip_is_refined_to_rounding() -> None:
    slave, master = below("triangle", 2, (1, 1)), above("triangle", 2, (3, 2), box=((-1.0, -1.0), (0.01, 0.51)))
    found, W, _, _, psi = laid(slave, master)
    phi = at_points(slave, found.slave_facet, found.slave_local, slave.change)
    # M is nearly singular there: the first solution is off by 5e-13
    assert_allclose((psi @ phi).toarray(), np.diag(W), atol=5e-14 * W.max())
