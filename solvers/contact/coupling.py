"""Coupling of a slave surface with what it may touch: weights, relative displacement, gap and normals.

With a rigid obstacle dual (biorthogonal) multipliers act at nodes and compliance pressure at quadrature points: the
weighted gap of a node is then the gap at that node (in the basis phi~ of `Surface`), so its row is its displacement in
the local frame. In node-to-segment (2D) and node-to-face (3D) contact each slave node is paired with the master facet
along its normal; a contact element is a slave node with the nodes of that facet: three in 2D, four or five in 3D at
order 1. Mortar coupling has a file of its own.

Source of contact elements: Pop (1999), section 4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CLOSE, ROUNDING, Array, Bools, Ints, Rows
from stickslip.geometry.errors import SceneError
from stickslip.geometry.obstacles import Obstacle
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.cells import Cells
from stickslip.geometry.surfaces.facet_map import place
from stickslip.geometry.surfaces.overlap import Overlap, overlap
from stickslip.geometry.surfaces.overlay import steepest, upright
from stickslip.geometry.surfaces.search import Pairing, pair, through_body
from stickslip.geometry.surfaces.surface import Surface

DIGITS = 9  # to which components are rounded, so that among equal ones the first is the least


@dataclass(frozen=True)
class On(Rows):
    """Places of q points on a surface."""

    facet: Ints  # (q,) row of its facets
    local: Array  # (q, d-1) reference coordinates there

    def basis(self, surface: Surface) -> Sparse:
        """Values of the surface's basis functions at the points (q, n)."""
        values = dx.reference_basis(surface.shape, surface.degree, self.local)[0]
        row = np.repeat(np.arange(len(self.facet)), values.shape[1])
        entries = (values.ravel(), (row, surface.facets[self.facet].ravel()))
        found: Sparse = sparse.csr_matrix(entries, shape=(len(self.facet), len(surface.nodes)))
        return found


def relative_to(own: On, surface: Surface, other: On | None, master: Surface | None) -> Sparse:
    """Displacements of the nodes of both sides to relative displacement at q points (q, n + n_master)."""
    if other is None or master is None:
        return own.basis(surface)
    found: Sparse = sparse.hstack([own.basis(surface), -other.basis(master)], format="csr")
    return found


def shares(own: On, surface: Surface, weights: Array) -> Sparse:
    """Values of a field at q points to its integrals ∫ phi~_j (n, q), from the points' weights (q,) [m^(d-1)]."""
    found: Sparse = surface.forces_transform @ own.basis(surface).T @ sparse.diags(weights)
    return found.tocsr()


@dataclass(frozen=True, kw_only=True)
class Points:
    """The q integration points of the slave surface at which a compliance law gives pressure by displacement."""

    weights: Array  # (q,) [m^(d-1)]
    relative: Sparse  # (q, n + n_master): nodal displacements of both sides to relative displacement
    gap: Array  # (q,) [m], positive when open
    normals: Array  # (q, d) unit, towards the other side
    psi: Sparse  # (n, q): values of a field to its integrals ∫ psi_j, psi_j the dual basis, by slave node
    phi: Sparse  # (n, q): likewise to its integrals ∫ phi~_j, see `shares`
    own: On  # where they lie on the slave
    other: On | None  # the points that they face on the master; None: a rigid obstacle
    whole: Bools | None = None  # (q,) those for which nodes may stand, see `at_nodes`; None: none

    def at_nodes(self, N: Sparse) -> tuple[Sparse, Sparse, Sparse] | None:
        """Matrix (m, q) from values at the points to means with psi, and `psi` and `phi` (n, m) of these m places.

        A side has more points than displacements along the normal, and slip along a curved one closes or opens each by
        a little of its own: a stiff law would press by that. At nodes it tends to the rigid law. Points that are not
        `whole` stay what they are.

        Args:
            N: rows (q, n_all d) of the points.

        Returns:
            None if means at the nodes tell u_n at the points, as on flat sides whose meshes match.

        Source: Oden & Kikuchi, Int. J. Numer. Meth. Engng 18 (1982), of penalties and the quadrature that they bear.
        """
        if self.whole is None:
            return None
        size, total = self.psi.sum(axis=1).A1, self.phi.sum(axis=0).A1
        there = self.whole & (total > 0)
        each, of_point = (
            sparse.diags(np.divide(1.0, sums, out=np.zeros(len(sums)), where=where))
            for sums, where in ((size, size > 0), (total, there))
        )
        means, rest = each @ self.psi, np.flatnonzero(~there)
        apart = of_point @ self.phi.T @ means @ N - sparse.diags(there.astype(float)) @ N
        if np.abs(apart.data).max(initial=0.0) < ROUNDING:  # entries of motions; those of both are about 1
            return None
        weights = np.asarray(self.phi @ there.astype(float))
        nodes = np.flatnonzero(weights > 0)
        own = sparse.diags(weights, format="csc")[:, nodes]
        of_points = sparse.vstack([means.tocsr()[nodes], sparse.identity(len(there), format="csr")[rest]], format="csr")
        psi, phi = (sparse.hstack([own, each.tocsc()[:, rest]], format="csr") for each in (self.psi, self.phi))
        return of_points, psi, phi

    def moved(self, share: Sparse) -> Points:
        """The same points, integrals at nodes (n,) moved to others: share (n, n)."""
        return replace(self, psi=(share @ self.psi).tocsr(), phi=(share @ self.phi).tocsr())


@dataclass(frozen=True, kw_only=True)
class Coupling:
    """A slave surface of n nodes and a master of n_master (a rigid obstacle: 0), in the basis phi~ of `Surface`."""

    surface: Surface
    master: Surface | None  # None: a rigid obstacle
    weights: Array  # (n,) [m^(d-1)] ∫ phi~_j over the part that faces the other side, and shares of neighbours; >= 0
    relative: Sparse  # (n, n + n_master): nodal displacements of both sides to relative displacement
    gap: Array  # (n,) [m], positive when open
    normals: Array  # (n, d) unit, towards the other side, half way between both sides' own
    carries: Bools  # (n,) nodes with a multiplier of their own; the weight of the others goes to neighbours
    points: Callable[[int], Points]  # takes a quadrature degree
    tips: Array | None = None  # (n,) 1 where a corner or an edge touches, 2 where its normal is a choice; None: none
    turning: Sparse | None = None  # (n, (n + n_master) d): as `closing`; None: `relative` along `normals`

    def closing(self, moved: Array) -> Array:
        """Relative displacement (n,) [m] along the normals, which may turn between nodes, of nodal ones (n_all, d)."""
        if self.turning is not None:
            return np.asarray(self.turning @ moved.ravel())
        return np.asarray(np.einsum("nd,nd->n", self.normals, self.relative @ moved))


@dataclass(frozen=True)
class Facing:
    """Where a slave surface faces a master, found by searches."""

    slave: Surface
    master: Surface
    reach: float  # farthest gap [m] across which facets are paired

    def points(self, degree: int) -> Overlap:
        """Integration points of the slave's part that faces the master; degree: of the quadrature."""
        return overlap(self.slave, self.master, self.reach, degree)

    def nodes(self, along: Array) -> Pairing:
        """Facets of the master that the slave's nodes meet along unit directions (n, d)."""
        slave, master = self.slave, self.master
        found = pair(slave.points, along, master, self.reach)
        if slave.faces is not None or master.faces is not None:  # sides with edges may be all of a body's skin
            away, (slope, other) = place(master, found.facet, found.local).area_normals, steepest(slave, master)
            of_nodes = np.zeros(len(slave.nodes))
            np.maximum.at(of_nodes, slave.facets, slope[:, None])
            flat = -np.einsum("md,md->m", away, along)
            flat = flat > upright(of_nodes, other[found.facet]) * np.linalg.norm(away, axis=1)
            apart = (found.facet >= 0) & flat & ~through_body(slave.points, along, found.gap, master)
            return found.only(apart)
        return found

    def first(self, on: On, along: Array, gap: Array) -> Bools:
        """Which points (q,) of the slave reach the master, at gaps [m] along unit directions, before anything else."""
        return np.ones(len(gap), bool)


def midway_normals(own: Array, other: Array, gap: Array, at_edge: Array, other_at_edge: Array) -> tuple[Array, Array]:
    """Unit normals half way between those of two sides, and the gaps measured along them.

    Neither side is preferred: equal bodies pressed against each other do not shear where they touch. Only an edge has
    no normal, and takes that of the face that it touches.

    Args:
        own: unit normals of this side (m, d).
        other: unit normals of the other side, opposite each point (m, d); 0 where nothing faces the point.
        gap: gaps along `own` (m,) [m].
        at_edge, other_at_edge: (m,) from 0 to 1, how far the point, and that opposite, are of an edge.

    Returns:
        Normals (m, d) and gaps (m,) [m].

    >>> tilted = np.array([[0.6, -0.8]])
    >>> smooth, edge = np.array([0.0]), np.array([1.0])
    >>> normals, gap = midway_normals(tilted, np.array([[0.6, 0.8]]), np.array([0.5]), smooth, smooth)
    >>> normals.tolist(), gap.tolist()
    ([[0.0, -1.0]], [0.4])
    >>> midway_normals(tilted, np.array([[0.0, 1.0]]), np.array([0.5]), edge, smooth)[1].tolist()
    [0.4]
    """
    at_edge, other_at_edge = (np.clip(at, 0.0, 1.0) for at in (at_edge * other.any(axis=1), other_at_edge))
    own_part, other_part = 1 - at_edge * (1 - other_at_edge), 1 - other_at_edge * (1 - at_edge)
    normals = own_part[:, None] * own - other_part[:, None] * other
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, gap * np.einsum("md,md->m", own, normals)


def rigid_coupling(
    surface: Surface, obstacle: Obstacle, points: Callable[[int], tuple[On, Array]] | None = None
) -> Coupling:
    """Coupling of a surface with a shape that is given by a formula and has no mesh.

    Args:
        points: integration points by degree, see `of_facets`; None: those of whole facets.
    """
    gap, normals = seen_from(obstacle, surface.points)
    of_side = points or partial(of_facets, surface, np.ones(len(surface.facets), bool), None)
    return Coupling(
        surface=surface,
        master=None,
        weights=surface.node_weights(),
        relative=surface.transform,
        gap=surface.transform @ gap,
        normals=-normals,
        carries=np.ones(len(surface.points), bool),
        points=lambda degree: _points(surface, obstacle, degree, *of_side(degree)),
    )


def seen_from(obstacle: Obstacle, points: Array) -> tuple[Array, Array]:
    """Distance (m,) [m] of points (m, d) from the obstacle, and unit normals (m, d) out of it.

    Raises:
        SceneError: its formulas give something else.
    """
    obstacle.check_points(points)
    gap, normals = obstacle.signed_gap(points), obstacle.normals(points)
    long = np.linalg.norm(normals, axis=1)
    # by which a normal may be longer or shorter than 1
    wrong = np.flatnonzero(~np.isfinite(gap) | ~(np.abs(long - 1) < CLOSE))
    if len(wrong):
        k, kind = wrong[0], type(obstacle).__name__
        place = ", ".join(f"{x:g}" for x in points[k])
        raise SceneError(
            f"obstacle {kind}: at ({place}) its distance is {gap[k]:g} and its normal {long[k]:g} long; expected a "
            "number, and a unit vector"
        )
    return gap, normals


def of_facets(surface: Surface, whole: Bools, cut: Cells | None, degree: int) -> tuple[On, Array]:
    """Integration points of whole facets (f,), then of cells of others: their places and weights (q,) [m^(d-1)]."""
    weights, facets = surface.quadrature(degree)[0][whole], np.flatnonzero(whole)
    local = np.tile(dx.reference_rule(surface.shape, degree)[0], (len(facets), 1))
    own = On(np.repeat(facets, weights.shape[1]), local)
    if cut is None:
        return own, weights.ravel()
    facet, local, more = cut.rule(surface, degree)
    return On.joined([own, On(facet, local)]), np.concatenate([weights.ravel(), more])


def _points(surface: Surface, obstacle: Obstacle, degree: int, own: On, weights: Array) -> Points:
    """The points that face an obstacle: with those of whole facets the rows give exactly the form j_n."""
    full = surface.quadrature(degree)[0]
    plain = np.bincount(own.facet, minlength=len(full)) == full.shape[1]
    plain &= np.abs(np.bincount(own.facet, weights, len(full)) - full.sum(axis=1)) <= ROUNDING * full.sum(axis=1)
    at, phi = np.flatnonzero(plain[own.facet]), shares(own, surface, weights)
    values, nodes = (
        surface.dual_basis(degree)[plain].reshape(-1, surface.facets.shape[1]),
        surface.facets[own.facet[at]],
    )
    entries = ((values * weights[at, None]).ravel(), (nodes.ravel(), np.repeat(at, nodes.shape[1])))
    psi = sparse.csr_matrix(entries, shape=phi.shape) + phi @ sparse.diags((~plain[own.facet]).astype(float))
    relative = own.basis(surface)
    gap, normals = seen_from(obstacle, relative @ surface.points)
    return Points(
        weights=weights, relative=relative, gap=gap, normals=-normals, psi=psi.tocsr(), phi=phi, own=own, other=None,
        whole=amid(psi, phi, plain[own.facet]),
    )  # fmt: skip


def amid(psi: Sparse, phi: Sparse, kept: Bools) -> Bools:
    """Which of the points (q,) have functions phi~ whose dual ones, whole facets of them, act at kept points alone."""
    return np.asarray(abs(phi.T) @ (abs(psi) @ ~kept) == 0)


def nodal_coupling(facing: Facing) -> Coupling:
    """Coupling at the slave's nodes, with their own weights; a node that meets no facet carries no multiplier."""
    slave, master, along = facing.slave, facing.master, facing.slave.node_normals()
    found = facing.nodes(along)
    partners = found.weights(master)
    missed = (found.facet < 0).astype(float)
    met = abs(slave.transform) @ missed == 0  # a coefficient of phi~ may need several nodes
    weights = np.where(met, slave.node_weights(), 0.0)
    relative = sparse.hstack([slave.transform, -(slave.transform @ partners)], format="csr")
    gap = np.where(met, slave.transform @ np.where(missed, 0.0, found.gap), 0.0)
    other = partners @ master.node_normals()
    normals, gap = midway_normals(along, other, gap, slave.at_edge, partners @ master.at_edge)

    def points(degree: int) -> Points:
        """The nodes that meet a facet, for every degree."""
        psi = sparse.diags(weights, format="csc")[:, met]
        return Points(
            weights=weights[met],
            relative=relative[met],
            gap=gap[met],
            normals=normals[met],
            psi=psi.tocsr(),
            phi=psi.tocsr(),
            own=on_nodes(slave, met),
            other=On(found.facet[met], found.local[met]),
        )

    return Coupling(
        surface=slave,
        master=master,
        weights=weights,
        relative=relative,
        gap=gap,
        normals=normals,
        carries=met,
        points=points,
    )


def on_nodes(surface: Surface, chosen: Bools | Ints) -> On:
    """Chosen nodes, by a mask (n,) or by number, of a surface as points of it, each on the first facet that has it."""
    k = surface.facets.shape[1]
    at = np.unique(surface.facets.ravel(), return_index=True)[1][chosen]
    return On(at // k, dx.reference_nodes(surface.shape, surface.degree)[at % k])
