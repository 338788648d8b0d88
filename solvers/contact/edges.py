"""Edges in contact: a corner or an edge of one side on a face of the other, and in 3D edges that cross.

An edge has no normal: on a face it takes that of the face, and where edges cross one orthogonal to both. Means over
facets, as those of mortar, do not see an edge inside a facet: each such point has a row of its own, in the place of
that of a node of the slave beside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import ROUNDING, TINY, Array, Bools, Ints, Rows
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.faces import BLUNT, RIDGES, edges_of
from stickslip.geometry.surfaces.search import pair, through_body
from stickslip.geometry.surfaces.surface import CREASE, Surface
from stickslip.solvers.contact.coupling import DIGITS, Coupling, Facing, On


@dataclass(frozen=True)
class _Points(Rows):
    """q pairs of points opposite each other."""

    facet: Ints  # (q,) of the slave
    local: Array  # (q, d-1) reference coordinates there
    other: Ints  # (q,) facet of the master
    other_local: Array  # (q, d-1)
    gap: Array  # (q,) [m]
    normals: Array  # (q, d) unit, from slave to master
    own: Bools  # (q,) whether the slave's edge touches


def with_edges(coupling: Coupling, facing: Facing | None = None) -> Coupling:
    """The same coupling with rows for the edges of both sides; it is the same where there are none.

    Of the nodes that faces have at an edge, one carries what presses on one face of the other side: that of the edge
    itself, or that whose own face lies flattest on it. The others have no weight.

    Args:
        facing: where the sides of two bodies face each other.
    """
    slave, master = coupling.surface, coupling.master
    if facing is not None and master is not None and (slave.faces is not None or master.faces is not None):
        reach = facing.reach
        turned = _turned(_tips(master, slave, reach))
        points = [_tips(slave, master, reach), turned]
        points += [_crossings(slave, master, reach)] if slave.dim == 3 else []
        found = _of_other_parts(_Points.joined(points), slave, master)
        first = facing.first(On(found.facet, found.local), found.normals, found.gap)
        coupling = _with_rows(coupling, found.at(first))
    return _once(coupling)


def _of_other_parts(points: _Points, slave: Surface, master: Surface) -> _Points:
    """The points of sides of one body that do not lie beside each other, nor behind each other; all of two bodies."""
    if slave.depth is None:
        return points
    nodes = slave.nodes[slave.facets[points.facet]], master.nodes[master.facets[points.other]]
    beside = (nodes[0][:, :, None] == nodes[1][:, None]).any(axis=(1, 2))
    return points.at(~beside & (points.gap >= -slave.depth[points.facet]))


def _tips(side: Surface, other: Surface, reach: float) -> _Points:
    """Corners and nodes of edges that touch a face of the other side, all facets around them rising from it."""
    nodes = np.flatnonzero(side.at_edge)
    _, first, group = np.unique(side.nodes[nodes], return_index=True, return_inverse=True)
    first, normals = nodes[first], other.node_normals()
    along = np.zeros((len(first), side.dim))
    np.add.at(along, group, side.node_normals()[nodes])
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), TINY)
    x = side.points[first]
    for _ in range(2):  # along the mean of the faces' normals, then along the normal met there
        found = pair(x, along, other, reach)
        met = np.flatnonzero(found.facet >= 0)
        along[met] = -(found.weights(other) @ normals)[met]
        along[met] /= np.linalg.norm(along[met], axis=1, keepdims=True)
    tip = (found.facet >= 0) & ~through_body(x, along, np.where(found.facet >= 0, found.gap, 0.0), other)
    of_node = np.full(len(side.nodes), -1)
    of_node[nodes] = group
    facet, k = np.nonzero(of_node[side.facets] >= 0)
    at = of_node[side.facets[facet, k]]
    away, flat = side.points[side.facets[facet]].mean(axis=1) - x[at], side.facet_normals()[facet, k]
    leaning = np.einsum("cd,cd->c", flat, along[at]) < np.cos(np.radians(BLUNT)) * np.linalg.norm(flat, axis=1)
    rises = np.einsum("cd,cd->c", away, along[at]) < -ROUNDING * np.linalg.norm(away, axis=1)
    tip[at[~(leaning & rises)]] = False
    on = np.zeros(len(first), np.int64)
    on[at] = facet * side.facets.shape[1] + k
    facet, k = on // side.facets.shape[1], on % side.facets.shape[1]
    local = dx.reference_nodes(side.shape, side.degree)[k]
    return _Points(facet, local, found.facet, found.local, found.gap, along, np.ones(len(first), bool)).at(tip)


def _turned(points: _Points) -> _Points:
    """The same points, of the master's edges and the slave's faces."""
    return _Points(
        points.other, points.other_local, points.facet, points.local, points.gap, -points.normals, ~points.own
    )


@dataclass(frozen=True)
class _Edges(Rows):
    """e edges of facets at which two faces of a side meet, in 3D."""

    facet: Ints  # (e,) one of both facets
    ends: Array  # (e, 2, d-1) reference coordinates there
    points: Array  # (e, 2, d) [m] of the ends
    inward: Array  # (e, 2, d) [m] from the middle to those of both facets

    @staticmethod
    def of(side: Surface) -> _Edges:
        facets, ridges = edges_of(side)
        corners = np.array([ends[:2] for ends in RIDGES[side.shape]])[ridges[:, 0]]
        points = side.points[side.facets[facets[:, :1], corners]]
        inward = side.points[side.facets[facets]].mean(axis=2) - points.mean(axis=1, keepdims=True)
        return _Edges(facets[:, 0], dx.reference_nodes(side.shape, 1)[corners], points, inward)

    def local(self, at: Array) -> Array:
        """Reference coordinates (e, d-1) of the points at the parts (e,) of the edges."""
        return np.asarray(self.ends[:, 0] + at[:, None] * (self.ends[:, 1] - self.ends[:, 0]))


def _crossings(slave: Surface, master: Surface, reach: float) -> _Points:
    """Where edges of both sides cross in 3D, each with both its faces behind the plane along both edges."""
    one, other = (_Edges.of(side) for side in (slave, master))
    half = [np.linalg.norm(x[:, 1] - x[:, 0], axis=1).max(initial=0.0) / 2 for x in (one.points, other.points)]
    trees = [cKDTree(x.mean(axis=1)) for x in (one.points, other.points)]
    pairs = trees[0].sparse_distance_matrix(trees[1], reach + sum(half), output_type="ndarray")
    order = np.lexsort((pairs["j"], pairs["i"]))
    one, other = one.at(pairs["i"][order]), other.at(pairs["j"][order])
    u, v = (x[:, 1] - x[:, 0] for x in (one.points, other.points))
    apart, normals = other.points[:, 0] - one.points[:, 0], np.cross(u, v)
    size = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(size, TINY)[:, None]
    normals *= np.where(np.einsum("ed,ed->e", one.inward[:, 0], normals) > 0, -1.0, 1.0)[:, None]
    signed = np.einsum("ed,ed->e", np.cross(u, v), normals)
    wide = size > np.sin(np.radians(BLUNT)) * np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
    s, t = (np.einsum("ed,ed->e", np.cross(apart, x), normals) / np.where(wide, signed, 1.0) for x in (v, u))
    gap = np.einsum("ed,ed->e", apart, normals)
    met = wide & (np.abs(gap) <= reach)
    for x in (s, t):
        met &= (x >= -ROUNDING) & (x <= 1 + ROUNDING)
    for x, sign in ((one.inward, -1), (other.inward, 1)):
        met &= (sign * np.einsum("epd,ed->ep", x, normals) > 0).all(axis=1)
    found = _Points(one.facet, one.local(s), other.facet, other.local(t), gap, normals, np.ones(len(gap), bool))
    return found.at(met)


def _with_rows(coupling: Coupling, points: _Points) -> Coupling:
    """Each point in the row of the node of the slave that is nearest to it; of several that with the least gap."""
    slave, master = coupling.surface, coupling.master
    assert master is not None
    basis = dx.reference_basis(slave.shape, slave.degree, points.local)[0]
    nodes = slave.facets[points.facet]
    _, same = np.unique(slave.nodes, return_inverse=True)
    best = np.full(same.max() + 1, -1)
    rising = np.argsort(coupling.weights, kind="stable")
    best[same[rising]] = rising  # of the nodes that faces have there, that with the largest weight
    node = np.take_along_axis(nodes, basis.argmax(axis=1)[:, None], axis=1)[:, 0]
    node = np.where(points.own, best[same[node]], node)
    order = np.lexsort((np.abs(points.gap), ~points.own, node))
    order = order[np.unique(node[order], return_index=True)[1]]
    points, node = points.at(order), node[order]
    at = np.zeros(len(slave.nodes))
    at[node] = 1.0
    row = sparse.csr_matrix((np.ones(len(node)), (node, np.arange(len(node)))), (len(at), len(node)))
    own, other = On(points.facet, points.local).basis(slave), On(points.other, points.other_local).basis(master)
    relative: Sparse = sparse.diags(1 - at) @ coupling.relative + row @ sparse.hstack([own, -other])
    gap, normals, weights = coupling.gap.copy(), coupling.normals.copy(), coupling.weights.copy()
    gap[node], normals[node] = points.gap, points.normals
    weights[np.isin(same, same[node[points.own]]) & (at == 0)] = 0.0
    weights[node] = np.where(weights[node] > 0, weights[node], slave.node_weights()[node])
    carries = (coupling.carries & (weights != 0)) | (at > 0)
    return replace(coupling, relative=relative.tocsr(), gap=gap, normals=normals, weights=weights, carries=carries)


def _once(coupling: Coupling) -> Coupling:
    """Let faces that meet at an edge press once on what is one face of the other side, see `with_edges`.

    Where that face is smooth, normals that differ by the angle of a crease are its own at two places. A node that is
    left out has its part in the row of the better one if their faces hardly bend.
    """
    surface, n = coupling.surface, len(coupling.weights)
    rows = np.flatnonzero((surface.at_edge > 0) & (coupling.weights != 0))
    if not len(rows):
        return coupling
    own, (crease, blunt) = surface.node_normals(), np.cos(np.radians([CREASE, BLUNT]))
    smooth = np.ones(n, bool)
    if coupling.master is not None:
        smooth = abs(coupling.relative[:, n:]) @ coupling.master.at_edge == 0
    flat = np.einsum("nd,nd->n", own[rows], coupling.normals[rows])
    rows = rows[np.lexsort((-flat.round(DIGITS), surface.nodes[rows]))]
    ends, better = np.flatnonzero(np.diff(surface.nodes[rows], append=-1)) + 1, np.arange(n)
    for group in np.split(rows, ends[:-1]):
        alike = coupling.normals[group] @ coupling.normals[group].T > np.where(smooth[group], crease, blunt)[:, None]
        for k in range(1, len(group)):
            same = np.flatnonzero(alike[k, :k] & (better[group[:k]] == group[:k]))
            better[group[k]] = group[same[0]] if len(same) else group[k]
    kept = better == np.arange(n)
    part = kept | (np.einsum("nd,nd->n", own, own[better]) > crease)
    share = sparse.csr_matrix((part * coupling.weights, (better, np.arange(n))), (n, n))
    weights = np.asarray(share.sum(axis=1)).ravel()
    each = np.where(kept & (weights != coupling.weights), 1 / np.where(weights > 0, weights, 1.0), 0.0)  # that changes
    mean = sparse.diags(each) @ share + sparse.diags((each == 0).astype(float))
    return replace(
        coupling,
        weights=weights,
        relative=(mean @ coupling.relative).tocsr(),
        gap=mean @ coupling.gap,
        carries=coupling.carries & kept,
    )
