"""Bubbles at contacts: the relative displacement that they cause at the contact rows, and what sides bulge there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CLOSE, Array
from stickslip.geometry.protocols import Sparse, Vec
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.accuracy.between_nodes import BetweenNodes
from stickslip.solvers.accuracy.bubbles import Bubbles
from stickslip.solvers.accuracy.curved_sides import bulges
from stickslip.solvers.accuracy.left_out import rim_of
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.build import along
from stickslip.solvers.contact.coupling import Points, relative_to
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.parallel.replicated import Replicated
from stickslip.solvers.stepping.law_memory import with_memory
from stickslip.solvers.stepping.state import State
from stickslip.solvers.system.contact_interface import components
from stickslip.solvers.system.system import System


class BubbleRows:
    """Relative displacement that bubbles cause at the contact rows: that of their mean values over psi_j.

    `closer` (rows,) [m] is by how much the gaps are smaller on the true surfaces: sides that are curved bulge out of
    their facets, and the distance of a rigid obstacle is averaged like the displacement, not taken at the node.
    `rims` are those of `rim_of`, zero at nodes that face nothing.
    """

    def __init__(self, system: System, bubbles: Bubbles, sides: dict[str, Surface]) -> None:
        normal, tangential, self.relative, numbers = [], [], [], [np.zeros(0, np.int64)]
        self._between = list[BetweenNodes | None]()
        closer = []
        for c in system.contacts:
            pair = system.problem.pairs[c.name]
            slave = _as(c.surface, sides[pair.slave])
            master = _as(c.master, sides[pair.master]) if c.master and pair.master else None
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
        self.rims = {
            c.name: np.where(c.node_weights > 0, rim_of(c.surface, system.mesh.bulging), 0.0) for c in system.contacts
        }
        self.closer = np.concatenate([*closer, np.zeros(sum(t.shape[0] for t in tangential))])
        self.N: Sparse = sparse.vstack([sparse.block_diag(normal), sparse.block_diag(tangential)]).tocsr()
        self._dim = d
        self._counts = np.cumsum([r.shape[1] for r in self.relative])[:-1]
        self._nodes = Replicated(bubbles.zero(), components(np.concatenate(numbers), d))

    def read(self, x: Vec) -> Array:
        """Bubbles at the contact nodes of all contacts, flat [m]; collective."""
        return self._nodes.read(x)

    def add(self, forces: Vec, at_contacts: Array) -> None:
        """Add forces at the contact nodes [N]."""
        self._nodes.add(forces, at_contacts)

    def friction(self, cone: AdmissibleSet, old: State, new: State) -> dict[str, tuple[Array, float]]:
        """What friction between nodes adds in a substep, by contact that it adds something to."""
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
    """The finer side with its facets in the order of the other one; the ends of both are the same nodes."""
    corners = len(dx.reference_nodes(side.shape, 1))
    own, others = (np.sort(s.input[s.facets[:, :corners]], axis=1) for s in (side, finer))
    order = np.empty(len(own), np.int64)
    order[np.lexsort(own.T[::-1])] = np.lexsort(others.T[::-1])
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
        n, nearer = (
            along(relative_to(points.own, slave, points.other, master), c.normals[:, None]),
            np.zeros(len(c.W_n)),
        )
    else:
        mean = sparse.diags(1 / c.W_n) @ c.psi.T
        n = along(mean @ relative, c.normals[:, None])
        at_nodes = points.own.basis(c.surface) @ spsolve(c.surface.transform.tocsc(), c.node_distance)
        nearer = mean @ (each * (points.psi @ (at_nodes - points.gap))) if master is None else np.zeros(len(c.W_n))
    if not len(c.W_t):
        return n, sparse.csr_matrix((0, n.shape[1])), relative, nearer
    mean = sparse.diags(1 / c.W_t) @ c.share_t @ sparse.diags(c.node_weights)
    return n, along(mean @ relative, c.tangents * c.free[:, :, None]), relative, nearer
