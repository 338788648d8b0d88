"""Mortar: surfaces that face each other are cut into triangles, and forces and displacements go over exactly."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial.transform import Rotation

from shared.cases import every_nth, often
from shared.overlays import above, ball, below, both, flat, scattered, shaken
from stickslip.geometry.arrays import Array
from stickslip.geometry.surfaces import overlay
from stickslip.geometry.surfaces.facet_map import locate, place
from stickslip.geometry.surfaces.overlap import Overlap, overlap
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.coupling import Facing
from stickslip.solvers.contact.mortar import mortar_coupling, mortar_integrals

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
    coupling = mortar_coupling(Facing(slave, above(shape, degree, counts[1], box=BOXES[box]), 0.5))
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


TURNED = [((3, 2), (3, 2)), ((2, 2), (3, 3)), ((1, 1), (20, 20)), ((20, 20), (1, 1)), ((5, 3), (4, 7))]
PRODUCTS = 8  # the degree of phi_i phi_j on a quadratic quadrilateral, the highest of all
DIGITS = 1e-12  # some hundred cells a facet


def master_forces(master: Surface, found: Overlap) -> Array:
    """What each master node gets of a unit pressure."""
    basis = place(master, found.master_facet, found.master_local).basis
    total = np.zeros(len(master.points))
    np.add.at(total, master.facets[found.master_facet], found.weights[:, None] * basis)
    return total


def own_forces(surface: Surface) -> Array:
    weights, basis = surface.quadrature(4)
    return surface.scatter(weights @ basis)


def facet_masses(surface: Surface, found: Overlap) -> Array:
    """∫ phi_i phi_j on each slave facet."""
    basis = place(surface, found.slave_facet, found.slave_local).basis
    k = basis.shape[1]
    total = np.zeros((len(surface.facets), k, k))
    np.add.at(total, found.slave_facet, found.weights[:, None, None] * basis[:, :, None] * basis[:, None])
    return total


def own_masses(surface: Surface, degree: int = 6) -> Array:
    weights, basis = surface.quadrature(degree)
    return np.asarray(np.einsum("fq,qi,qj->fij", weights, basis, basis))


@pytest.mark.parametrize(("kind", "counts"), every_nth(3, KINDS, TURNED))
def test_flat_surfaces_face_each_other_exactly(kind: tuple[str, int], counts: Any) -> None:
    shape, degree = kind
    slave, master = below(shape, degree, counts[0]), above(shape, degree, counts[1])
    found = overlap(slave, master, 0.2, PRODUCTS)
    assert_allclose(facet_masses(slave, found), own_masses(slave), atol=DIGITS / len(slave.facets))
    assert_allclose(master_forces(master, found), own_forces(master), atol=DIGITS / len(master.facets))
    assert_allclose(found.gap, 0.1, rtol=DIGITS)
    assert_allclose(found.normals, np.tile(np.eye(slave.dim)[-1], (len(found.gap), 1)), atol=1e-14)
    points = place(slave, found.slave_facet, found.slave_local).points
    partners = place(master, found.master_facet, found.master_local).points
    assert_allclose(partners - points, found.gap[:, None] * found.normals, atol=DIGITS)
    assert np.all(np.diff(found.slave_facet) >= 0)
    assert found.weights.min() > 0


@pytest.mark.parametrize("box", [((0.3, -0.4), (1.7, 0.6)), ((0.31, 0.12), (0.77, 0.93))], ids=["shifted", "inside"])
@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_partly_covered_surfaces_have_the_moments_of_the_common_box(shape: str, degree: int, box: Any) -> None:
    slave, master = below(shape, degree, (3, 4)), above(shape, degree, (5, 2), box=box)
    low, high = np.maximum(box[0], 0.0)[: slave.dim - 1], np.minimum(box[1], 1.0)[: slave.dim - 1]
    area, centre, spread = np.prod(high - low), (low + high) / 2, (high - low) ** 2 / 12
    for one, other in ((slave, master), (master, slave)):
        found = overlap(one, other, 0.2, 4)
        x = place(one, found.slave_facet, found.slave_local).points[:, :-1]
        assert_allclose(found.weights.sum(), area, rtol=DIGITS)
        assert_allclose(found.weights @ x / area, centre, rtol=DIGITS)
        assert_allclose(found.weights @ (x - centre) ** 2 / area, spread, rtol=DIGITS)


@pytest.mark.parametrize("shape", SHAPES[1:])
def test_a_square_and_its_turned_image_have_an_octagon_in_common(shape: str) -> None:
    slave, master = below(shape, 1, (3, 3)), above(shape, 2, (4, 5))
    turn = Rotation.from_euler("z", 45, degrees=True).as_matrix()
    middle = np.array([0.5, 0.5, 0.0])
    master = replace(master, points=(master.points - middle) @ turn.T + middle)
    assert_allclose(overlap(slave, master, 0.2, 2).weights.sum(), 2 * (np.sqrt(2) - 1), rtol=DIGITS)


@pytest.mark.parametrize("degree", [1, 2])
def test_random_triangulations_of_a_square_cover_each_other(degree: int) -> None:
    slave, master = scattered(degree, 60, 1, flat(0.0), 1.0), scattered(degree, 150, 2, flat(0.1), -1.0)
    for one, other in ((slave, master), (master, slave)):
        found = overlap(one, other, 0.2, 4)
        assert_allclose(facet_masses(one, found), own_masses(one), atol=1e-14)
        assert_allclose(master_forces(other, found), own_forces(other), atol=1e-14)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_turning_both_or_measuring_in_millimetres_changes_nothing(shape: str, degree: int) -> None:
    slave, master = below(shape, degree, (3, 3), ball(1.0)), above(shape, degree, (4, 4), ball(1.1))
    found = overlap(slave, master, 0.5, 4)
    turn, d = Rotation.random(random_state=3).as_matrix(), slave.dim
    if d == 2:
        turn = Rotation.from_euler("z", 1.0).as_matrix()[:2, :2]
    images = [replace(side, points=1e3 * (side.points @ turn.T + 0.7)) for side in (slave, master)]
    image = overlap(images[0], images[1], 500.0, 4)
    for value, scale in ((lambda one: one.weights, 1.0), (lambda one: one.weights * one.gap, 1e3)):
        sums = [np.bincount(one.slave_facet, value(one)) for one in (found, image)]
        assert_allclose(sums[1], scale * 1e3 ** (d - 1) * sums[0], rtol=DIGITS)
    assert_allclose(np.einsum("qd,qd->q", image.normals, image.normals), 1.0, rtol=1e-14)
    mean = 1e-3 ** (d - 1) * (image.weights @ image.normals)
    assert_allclose(mean @ turn, found.weights @ found.normals, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("kind", often(KINDS, [KINDS[0], KINDS[1], KINDS[3], KINDS[4]]))
def test_area_and_gap_of_concentric_balls_converge(kind: tuple[str, int]) -> None:
    shape, degree = kind
    # the angle of an interval, the solid angle of a square of side 1 seen from a distance of 1
    area = 2 * np.arctan(0.5) if shape == "interval" else 4 * np.arcsin(0.25 / 1.25)
    wide = ((-0.5, -0.5), (1.5, 1.5))
    errors = []
    for n in (4, 8, 16):
        slave = below(shape, degree, (n, n), ball(1.0))
        found = overlap(slave, above(shape, degree, (3 * n, 3 * n), ball(1.1), wide), 0.5, 6)
        assert_allclose(found.weights.sum(), slave.quadrature(10)[0].sum(), rtol=1e-9)  # covered as a whole
        mean = np.sqrt(found.weights @ (found.gap - 0.1) ** 2 / area)
        errors.append((abs(found.weights.sum() / area - 1), mean))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])[-1]
    assert np.all(rates > (1.8 if degree == 1 else 2.8)), rates  # P_k: facets leave the ball by h^(k+1)


@pytest.mark.parametrize("degree", [1, 2])
def test_skewed_quadrilaterals_are_covered_once(degree: int) -> None:
    slave = below("quadrilateral", 1, (5, 5))
    master = shaken(above("quadrilateral", 1, (7, 7)), 0.05, seed=1)
    if degree == 2:  # the same facets, curved by midnodes off their edges
        slave, master = below("quadrilateral", 2, (3, 3)), shaken(above("quadrilateral", 2, (4, 4)), 0.02, seed=1)
    slave = shaken(slave, 0.08 / degree**2)
    found = overlap(slave, master, 0.2, 6 if degree == 1 else 14)  # products of degree 4 or 8, area of 1 or 6
    assert_allclose(facet_masses(slave, found), own_masses(slave, 14), atol=1e-14)
    # straight edges of the one are curves in the coordinates of the other: 1e-4 here, and 1e-2 with affine corners
    limit = 1e-3 if degree == 1 else 0.05
    assert_allclose(master_forces(master, found), own_forces(master), rtol=limit)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_the_nearest_of_two_layers_counts(shape: str, degree: int) -> None:
    slave = below(shape, degree, (4, 4))
    near = above(shape, degree, (3, 2), flat(0.1), ((0.25, 0.0), (0.75, 1.0)))
    far = above(shape, degree, (7, 3), flat(0.2))
    if slave.dim == 3:  # whole cells: in space a cell is judged at its centre
        near = above(shape, degree, (2, 4), flat(0.1), ((0.25, 0.0), (0.75, 1.0)))
        far = above(shape, degree, (8, 4), flat(0.2))
    found = overlap(slave, both(far, near), 0.5, PRODUCTS)
    x = place(slave, found.slave_facet, found.slave_local).points[:, 0]
    assert_allclose(facet_masses(slave, found), own_masses(slave), atol=1e-14)
    wrong = np.abs(found.gap - np.where(np.abs(x - 0.5) < 0.25, 0.1, 0.2))
    assert found.weights @ wrong < DIGITS


def test_in_the_plane_layers_are_cut_apart_where_the_nearer_one_ends() -> None:
    slave, far = below("interval", 1, (2, 2)), above("interval", 1, (3, 3), flat(0.3))
    near = above("interval", 1, (2, 2), flat(0.1), ((0.123, 0.0), (0.456, 0.0)))
    found = overlap(slave, both(near, far), 0.5, 4)
    assert_allclose(found.weights.sum(), 1.0, rtol=DIGITS)
    assert_allclose(found.weights[found.gap < 0.2].sum(), 0.456 - 0.123, rtol=DIGITS)


@pytest.mark.parametrize(("shape", "degree"), KINDS)
def test_only_what_faces_the_slave_within_reach_counts(shape: str, degree: int) -> None:
    slave, master = below(shape, degree, (2, 2)), above(shape, degree, (3, 3))
    assert_allclose(overlap(slave, master, 0.11, 2).weights.sum(), 1.0, rtol=DIGITS)
    assert len(overlap(slave, master, 0.09, 2).gap) == 0
    assert len(overlap(slave, replace(master, outward=-master.outward), 0.2, 2).gap) == 0
    sunk = overlap(slave, above(shape, degree, (3, 3), flat(-0.05)), 0.2, 2)
    assert_allclose(sunk.gap, -0.05, rtol=DIGITS)
    assert len(overlap(slave, above(shape, degree, (3, 3), box=((2.0, 2.0), (3.0, 3.0))), 0.2, 2).gap) == 0


def test_either_way_round_a_facet_the_normal_points_outward() -> None:
    slave, master = below("triangle", 2, (2, 2)), above("triangle", 2, (3, 3))
    turned = replace(slave, facets=slave.facets[:, [0, 2, 1, 3, 5, 4]], outward=-slave.outward)
    found = overlap(turned, master, 0.2, 4)
    assert_allclose(found.gap, 0.1, rtol=DIGITS)
    assert_allclose(facet_masses(turned, found), own_masses(turned), atol=1e-14)


@pytest.mark.parametrize("degree", [1, 2])
def test_axisymmetric_surfaces_weigh_full_circles(degree: int) -> None:
    slave, master = (
        replace(side, axisymmetric=True)
        for side in (below("interval", degree, (3, 3)), above("interval", degree, (4, 4)))
    )
    found = overlap(slave, master, 0.2, 2 * degree + 1)
    assert_allclose(found.weights.sum(), np.pi, rtol=DIGITS)
    assert_allclose(master_forces(master, found), own_forces(master), rtol=DIGITS, atol=1e-14)


def test_facets_of_very_different_sizes_find_each_other() -> None:
    slave, fine = below("triangle", 1, (2, 2)), above("triangle", 1, (50, 50), box=((0.0, 0.0), (0.5, 1.0)))
    master = both(fine, above("triangle", 1, (1, 1), box=((0.5, 0.0), (1.0, 1.0))))
    for one, other in ((slave, master), (master, slave)):
        assert_allclose(overlap(one, other, 0.3, 2).weights.sum(), 1.0, rtol=DIGITS)


def test_a_line_that_misses_a_curved_facet_finds_nothing() -> None:
    master = above("interval", 2, (1, 1), ball(1.0))
    past = np.array([[0.0, 5.0]])
    local = locate(master, np.array([0]), np.array([[0.4]]), past, np.array([[1.0, 0.0]]))
    assert np.isnan(local).all()


POLYGON = np.array([[0.1, 0.1], [0.6, 0.05], [0.7, 0.2], [0.3, 0.6], [0.05, 0.4]])
AGAIN = POLYGON[[0, 1, 1, 2, 3, 4]]  # as clipping leaves a corner that lies on an edge: there twice


@pytest.mark.parametrize("first", range(6))
def test_triangles_do_not_depend_on_the_first_corner(first: int) -> None:
    _, parts = overlay.fan(np.roll(AGAIN, -first, axis=0)[None])
    _, expected = overlay.fan(POLYGON[None])
    found = sorted(np.sort(part, axis=0).tolist() for part in parts)
    assert found == sorted(np.sort(part, axis=0).tolist() for part in expected)
    assert len(found) == 3


def quarter(x: Array) -> Array:
    """A quarter circle from the axis of symmetry on."""
    return np.stack([np.sin(np.pi / 2 * x[:, 0]), -np.cos(np.pi / 2 * x[:, 0])], axis=1)


@pytest.mark.parametrize("axisymmetric", [False, True])
def test_a_uniform_pressure_on_a_curved_side_turns_between_nodes(axisymmetric: bool) -> None:
    """Its forces are ∫ p n phi of both sides, though psi reproduces constants only. On a flat side nothing turns."""
    shape, bend = ("interval", quarter) if axisymmetric else ("triangle", ball(1.0))
    slave, master = (
        replace(make(shape, 2, counts, bend), axisymmetric=axisymmetric)
        for make, counts in ((below, (5, 4)), (above, (7, 3)))
    )
    coupling = mortar_coupling(Facing(slave, master, 0.5))
    points = coupling.points(EXACT)
    pushed = points.relative.T @ (points.weights[:, None] * points.normals)
    assert coupling.turning is not None
    found = (coupling.turning.T @ coupling.weights).reshape(pushed.shape)
    assert_allclose(found, pushed, atol=1e-5 * np.abs(pushed).max())
    nodal = coupling.relative.T @ (coupling.weights[:, None] * coupling.normals)
    assert np.abs(nodal - pushed).max() > 1e-3 * np.abs(pushed).max()  # with the normals of the nodes they are others
    flats = (replace(make(shape, 2, (2, 3)), axisymmetric=axisymmetric) for make in (below, above))
    assert mortar_coupling(Facing(*flats, 0.5)).turning is None
