"""Bubbles at contacts: the relative displacement that they cause at the contact rows, and what sides bulge there.

`BetweenNodes` finds friction between the nodes, where the direction of slip varies along the side. Methods hold the
law at nodes: each has one direction for all of its area. Here slip is interpolated, and friction acts against it at
each integration point; the difference to the nodes' directions is of second order in the mesh size. A block on a
turning table has all of its error of the moment from it. Slip is measured along the law's directions: with those of an
orthotropic one it is Coulomb's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CLOSE, ROUNDING, Array, Bools
from stickslip.geometry.protocols import Sparse, Vec
from stickslip.geometry.surfaces.surface import Surface, of_sectors
from stickslip.solvers.accuracy.bubbles import Bubbles
from stickslip.solvers.accuracy.facet_volume_correction import bulges
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.build import along
from stickslip.solvers.contact.coupling import Points, relative_to
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.stepping.law_memory import with_memory
from stickslip.solvers.stepping.state import State
from stickslip.solvers.system.contact_interface import NodalVectors
from stickslip.solvers.system.system import System


@dataclass(frozen=True)
class BetweenNodes:
    """Work of friction between the nodes of one contact, in addition to that at its n nodes."""

    relative: Sparse  # (n, n_all)
    measures: Array  # (n, d, d): friction acts along their product with slip, at the bound
    phi: Sparse  # (n, q): values at integration points to integrals ∫ phi~_j
    weights: Array  # (q,) [m^(d-1)]
    driven: Sequence[int]  # axes along which a force drives the obstacle

    @classmethod
    def of(cls, c: ContactRows, points: Points, driven: Sequence[int] = ()) -> BetweenNodes | None:
        """None: no friction."""
        if c.friction is None or not c.friction.resists():
            return None
        return cls(c.relative, _measures(c), points.phi, points.weights, driven)

    def added(self, slips: Bools, bound: Array, increment: Array) -> tuple[Array, float] | None:
        """Nodal forces (n_all, d) [N] like B^T p, whose negatives act on the bodies, and dissipation [J].

        None where all slip around has the same direction, and where it would push an obstacle that a force drives: that
        is in balance.

        Args:
            slips: (n,) whether the multiplier is at the bound.
            bound: of friction (n,) [Pa], as the directions of the law measure it.
            increment: slip in the substep (n, d) [m].
        """
        bound = np.where(np.isfinite(bound), bound, 0.0)
        pulls, size = _measured(self.measures, increment)
        # of the largest slip in the substep: less is none
        slips = slips & (bound > 0) & (size > ROUNDING * size.max(initial=0.0))
        direction = np.divide(pulls, size[:, None], out=np.zeros_like(pulls), where=slips[:, None])
        each = np.divide(1.0, self.weights, out=np.zeros_like(self.weights), where=self.weights > 0)
        values = each[:, None] * (self.phi.T @ np.column_stack([bound, size, increment]))
        bound_at, mean_size, moved = values[:, 0], values[:, 1], values[:, 2:]
        node, point = self.phi.nonzero()
        along, length = _measured(self.measures[node], moved[point])
        turns = (length > CLOSE * np.abs(mean_size[point]))[:, None]  # else the point is the centre of a vortex
        along = np.divide(along, length[:, None], out=np.zeros_like(along), where=turns) - direction[node]
        part = np.asarray(self.phi[node, point]).ravel()
        forces = np.zeros_like(increment)
        np.add.at(forces, node, (part * bound_at[point] * slips[node])[:, None] * along)
        size_at = each * np.bincount(point, part * length, minlength=len(each))
        # of the bounds: less is no other direction
        nothing = np.linalg.norm(forces) <= ROUNDING * np.linalg.norm(self.phi @ bound_at)
        pushed = np.abs(forces.sum(axis=0)[list(self.driven)]).max(initial=0.0)
        if nothing or pushed > ROUNDING * np.abs(forces).sum():
            return None
        return np.asarray(self.relative.T @ forces), float((self.weights * bound_at) @ (size_at - mean_size))


def _measures(c: ContactRows) -> Array:
    """The projection onto each node's tangent plane; of orthotropic laws the products of `tangents`, added."""
    assert c.friction is not None
    if not c.friction.orthotropic:
        return np.asarray(np.eye(c.surface.dim) - np.einsum("nd,ne->nde", c.frames[:, 0], c.frames[:, 0]))
    squares = np.einsum("mcd,mce->mde", c.tangents, c.tangents)
    return np.asarray((c.share_t.T @ squares.reshape(len(squares), -1)).reshape(-1, c.surface.dim, c.surface.dim))


def _measured(measures: Array, slip: Array) -> tuple[Array, Array]:
    """Slips (k, d) times their measures, and their lengths (k,) by these."""
    pulls = np.einsum("kde,ke->kd", measures, slip)
    return pulls, np.sqrt(np.maximum(np.einsum("kd,kd->k", slip, pulls), 0.0))


class BubbleRows:
    """Relative displacement that bubbles cause at the contact rows: that of their mean values over psi_j.

    `closer` (rows,) [m] is by how much the gaps are smaller on the true surfaces: sides that are curved bulge out of
    their facets, and the distance of a rigid obstacle is averaged like the displacement, not taken at the node.
    """

    def __init__(self, system: System, bubbles: Bubbles, sides: dict[str, Surface]) -> None:
        normal, tangential, self.relative, numbers = [], [], [], [np.zeros(0, np.int64)]
        self._between = list[BetweenNodes | None]()
        closer = []
        for c in system.contacts:
            pair = system.problem.pairs[c.name]
            slave = _as(c.surface, sides[pair.slave])
            master = sides[pair.master] if pair.master else None
            master = master and of_sectors(master, system.problem.request.sectors)
            master = _as(c.master, master) if c.master and master else None
            points = _integration_points(c, slave)
            n, t, relative, nearer = _rows_of(c, points, slave, master)
            driven = [axis for obstacle, axis in system.obstacles.driven if obstacle == pair.obstacle]
            self._between.append(BetweenNodes.of(c, points, driven))
            straight = [(c.surface, slave)] + ([(c.master, master)] if c.master and master else [])
            bulging = np.concatenate([bulges(*side) for side in straight])
            known = c.normal.ties or pair.contact.gap is not None
            closer.append(np.zeros(len(c.W_n)) if known else n @ bulging.ravel() + nearer)
            normal.append(n)
            tangential.append(t)
            self.relative.append(relative)
            numbers += [slave.nodes, master.nodes if master else numbers[0]]
        d = system.mesh.dim
        self.closer = np.concatenate([*closer, np.zeros(sum(t.shape[0] for t in tangential))])
        self.N: Sparse = sparse.vstack([sparse.block_diag(normal), sparse.block_diag(tangential)]).tocsr()
        self._dim = d
        self._counts = np.cumsum([r.shape[1] for r in self.relative])[:-1]
        self._nodes = NodalVectors(bubbles.zero(), np.concatenate(numbers), system.problem.request.turned)

    def read(self, x: Vec) -> Array:
        """Bubbles at the contact nodes of all contacts, flat [m]; collective."""
        return self._nodes.read(x).ravel()

    def add(self, forces: Vec, at_contacts: Array) -> None:
        """Add forces at the contact nodes [N]."""
        self._nodes.add(forces, at_contacts.reshape(-1, self._dim))

    def friction(self, cone: AdmissibleSet, old: State, new: State) -> dict[str, tuple[Array, float]]:
        """Friction between nodes in a substep, by contact that has some."""
        cone, found = with_memory(cone.at(new.time), new.memory), dict[str, tuple[Array, float]]()
        for place, between in zip(cone.places, self._between, strict=True):
            c, t = place.rows, new.p[place.tangential].reshape(-1, place.components)
            if between is not None:
                bound, used = cone.bound(place, new.p[place.normal]), np.linalg.norm(t * c.free, axis=1)
                # relative: a multiplier that near to the bound slips
                slips, limit = (c.share_t.T @ np.column_stack([used >= (1 - CLOSE) * bound, bound])).T
                added = between.added(slips > 1 - CLOSE, limit, new.slip[c.name] - old.slip[c.name])
                if added is not None:
                    found[c.name] = added
        return found

    def motion(self, at_contacts: Array) -> list[Array]:
        """Relative displacement (n, d) [m] at the slave's nodes of each contact."""
        parts = np.split(at_contacts.reshape(-1, self._dim), self._counts)
        return [relative @ part for relative, part in zip(self.relative, parts, strict=True)]


def _as(side: Surface, finer: Surface) -> Surface:
    """The finer side with the facets of the other one, in its order; the ends of both are the same nodes."""
    corners = len(dx.reference_nodes(side.shape, 1))
    own, others = (np.sort(s.input[s.facets[:, :corners]], axis=1) for s in (side, finer))
    number = np.unique(np.concatenate([others, own]), axis=0, return_inverse=True)[1].ravel()
    at = np.empty(len(others), np.int64)
    at[number[: len(others)]] = np.arange(len(others))
    order = at[number[len(others) :]]
    return replace(finer, facets=finer.facets[order], outward=finer.outward[order])


def _integration_points(c: ContactRows, slave: Surface) -> Points:
    """Those at which bubbles on the slave count."""
    order = c.surface.degree
    degree = c.degree if c.normal.at_quadrature else 2 * order * (1 + (slave.shape != "interval")) + 1
    assert c.quadrature is not None
    return c.quadrature(max(degree, 2 * order + 1 + slave.axisymmetric))


def _rows_of(
    c: ContactRows, points: Points, slave: Surface, master: Surface | None
) -> tuple[Sparse, Sparse, Sparse, Array]:
    """Rows of N for the bubbles of one contact, normal and tangential; relative displacement at slave nodes; and by
    how much the mean of a rigid obstacle's distance is smaller than that at the points of the normal rows (m_n,) [m].
    """
    at_points = relative_to(points.own, slave, points.other, master)
    each = np.divide(1.0, c.node_weights, out=np.zeros_like(c.node_weights), where=c.node_weights > 0)
    relative = (sparse.diags(each) @ points.psi @ at_points).tocsr()
    if c.normal.at_quadrature:
        assert c.quadrature is not None
        points = c.quadrature(c.degree)
        n = c.at_points(along(relative_to(points.own, slave, points.other, master), points.normals[:, None]))
        nearer = np.zeros(len(c.W_n))
    else:
        mean = sparse.diags(1 / c.W_n) @ c.psi.T
        n = along(mean @ relative, c.normals[:, None])
        at_nodes = points.own.basis(c.surface) @ spsolve(c.surface.transform.tocsc(), c.node_distance)
        nearer = mean @ (each * (points.psi @ (at_nodes - points.gap))) if master is None else np.zeros(len(c.W_n))
    if not len(c.W_t):
        return n, sparse.csr_matrix((0, n.shape[1])), relative, nearer
    mean = sparse.diags(1 / c.W_t) @ c.share_t @ sparse.diags(c.node_weights)
    return n, along(mean @ relative, c.tangents * c.free[:, :, None]), relative, nearer
