"""Edges in contact: a corner or an edge of one side on a face of the other, and in 3D edges that cross.

An edge has no normal: on a face it takes that of the face, and where edges cross one orthogonal to both. Means over
facets, as those of mortar, do not see an edge inside a facet: each such point has a row of its own, in the place of
that of a node of the slave beside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CLOSE, ROUNDING, TINY, Array, Bools, Ints, Rows
from stickslip.geometry.curved_facets import SHARP, SMOOTH
from stickslip.geometry.errors import SceneError
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.cells import graded
from stickslip.geometry.surfaces.faces import RIDGES, edges_of
from stickslip.geometry.surfaces.facet_map import place
from stickslip.geometry.surfaces.search import pair, through_body
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.coupling import DIGITS, Coupling, Facing, On, Points, amid, on_nodes, relative_to


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
    edge: Bools  # (q,) whether the master's does
    halfway: Bools  # (q,) whether both do, along each other: the normal is a choice, half way between their faces


def with_edges(coupling: Coupling, facing: Facing | None = None, at_quadrature: bool = False) -> Coupling:
    """The same coupling with rows for the edges of both sides; it is the same where there are none.

    Of the nodes that faces have at an edge, one carries what presses on one face of the other side: that of the edge
    itself, or that whose own face lies flattest on it. The others have no weight.

    Args:
        facing: where the sides of two bodies face each other.
        at_quadrature: whether the normal law acts at integration points, see `_felt`.
    """
    slave, master = coupling.surface, coupling.master
    if facing is not None and master is not None and (slave.faces is not None or master.faces is not None):
        reach, tips = facing.reach, partial(_tips, each_side=at_quadrature)
        found = _Points.joined([tips(slave, master, reach), _turned(tips(master, slave, reach))])
        if slave.dim == 3:
            found = _Points.joined([found, _elsewhere(_crossings(slave, master, reach), found.at(found.edge), slave)])
        found = _of_other_parts(found, slave, master)
        first = facing.first(On(found.facet, found.local), found.normals, found.gap)
        coupling = _with_rows(coupling, found.at(first), reach if at_quadrature else None)
    return _once(coupling)


def _of_other_parts(points: _Points, slave: Surface, master: Surface) -> _Points:
    """The points of sides of one body that do not lie beside each other, nor behind each other; all of two bodies."""
    if slave.depth is None:
        return points
    nodes = slave.nodes[slave.facets[points.facet]], master.nodes[master.facets[points.other]]
    beside = (nodes[0][:, :, None] == nodes[1][:, None]).any(axis=(1, 2))
    return points.at(~beside & (points.gap >= -slave.depth[points.facet]))


def _tips(side: Surface, other: Surface, reach: float, each_side: bool) -> _Points:
    """Corners and nodes of edges that touch faces of the other side, all facets around them rising from these.

    Where the other side has an edge they touch each face of it, or if it is not hollow a plane half way.

    Args:
        each_side: whether sides that meet there have it all, or the first one alone.
    """
    nodes = np.flatnonzero((side.at_edge > 0) & (each_side or side.ends is None or side.ends < 2))
    first = nodes[np.unique(side.nodes[nodes], return_index=True)[1]]
    whole = side.beside or side
    number, place_of = np.unique(whole.nodes, return_index=True)
    at = place_of[np.searchsorted(number, side.nodes[first])]
    _, _, _, of, faces = _around(whole, _ones(at, len(whole.nodes)))
    leads = _means(of, faces, len(first)).any(axis=1)  # the end of a crack, whose sides face each other, leads nowhere
    x, t, first, at = side.points[first[leads]], np.count_nonzero(leads), first[leads], at[leads]
    own, away, flat, of, faces = _around(whole, _ones(at, len(whole.nodes)))
    mean = _means(of, faces, t)
    met = pair(x, mean, other, reach)
    there, beyond, _, tip, normals = _around(other, met.weights(other))
    size, axes = np.linalg.eigh(_spans(of, faces, t) + _spans(tip, normals, t))
    axes = axes * (size > 2 - CLOSE)[:, None]  # orthogonal to the edges of both sides
    half = np.einsum("tda,tea,te->td", axes, axes, mean - _means(tip, normals, t))
    half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), TINY)
    hollow = there[np.einsum("cd,cd->c", beyond, half[there]) < -ROUNDING * np.linalg.norm(beyond, axis=1)]
    several = np.bincount(tip, minlength=t) > 1
    halfway = several & (np.bincount(hollow, minlength=t) == 0) & half.any(axis=1)
    each = ~halfway[tip]
    tip, along = np.append(tip[each], np.flatnonzero(halfway)), np.concatenate([-normals[each], half[halfway]])
    x, facet, local = x[tip], met.facet[tip], met.local[tip]
    gap = np.einsum("rd,rd->r", place(other, facet, local).points - x, along)
    foot = pair(x, along, other, reach)
    inside = (foot.facet >= 0) & ~several[tip]
    facet, gap = np.where(inside, foot.facet, facet), np.where(inside, foot.gap, gap)
    local = np.where(inside[:, None], foot.local, local)
    touches = ~through_body(x, along, gap, other)
    i, j = (_ones(tip, t) @ _ones(own, t).T).nonzero()
    leaning = np.einsum("cd,cd->c", flat[j], along[i]) < np.cos(np.radians(SMOOTH)) * np.linalg.norm(flat[j], axis=1)
    rises = np.einsum("cd,cd->c", away[j], along[i]) < -ROUNDING * np.linalg.norm(away[j], axis=1)
    touches[i[~(leaning & rises)]] = False
    if side.ends is not None and side.beside is None and side.ends[first[tip[touches]]].any():
        raise SceneError("periodic: a corner on a cyclic side touches a face by itself; turn the sector")
    on = on_nodes(side, first[tip])
    every = np.ones(len(tip), bool)
    choice = halfway & (np.count_nonzero(axes.any(axis=1), axis=1) > 1)
    return _Points(on.facet, on.local, facet, local, gap, along, every, several[tip], choice[tip]).at(touches)


def _ones(columns: Ints, count: int) -> Sparse:
    """Matrix with a one in each row, and so many columns."""
    return sparse.csr_matrix((np.ones(len(columns)), (np.arange(len(columns)), columns)), (len(columns), count))


def _means(rows: Ints, normals: Array, count: int) -> Array:
    """Unit vectors (count, d) along the sums of unit normals (r, d) of each row; zero where there is none."""
    total = np.zeros((count, normals.shape[1]))
    np.add.at(total, rows, normals)
    size = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(size > CLOSE, total / np.maximum(size, TINY), 0.0)  # opposite ones leave rounding


def _spans(rows: Ints, normals: Array, count: int) -> Array:
    """Projectors (count, d, d) onto the spans of unit normals (r, d) of each row."""
    total = np.zeros((count, normals.shape[1], normals.shape[1]))
    np.add.at(total, rows, normals[:, :, None] * normals[:, None])
    return np.asarray(np.linalg.pinv(total, rcond=CLOSE, hermitian=True) @ total)


def _facets_around(side: Surface, share: Sparse) -> tuple[Ints, Ints, Array]:
    """Of each facet around places on a side its place (p,), its number (p,), and values of its basis there (p, k).

    Args:
        share: (t, n) values of the nodes' basis functions at the places.
    """
    _, same = np.unique(side.nodes, return_inverse=True)
    (f, k), n = side.facets.shape, same.max() + 1
    merged = (share @ _ones(same, n)).tocsr()
    merged.data[np.abs(merged.data) < CLOSE] = 0.0  # of a basis function
    merged.eliminate_zeros()
    has = sparse.csr_matrix((np.ones(f * k), same[side.facets.ravel()], np.arange(0, f * k + 1, k)), (f, n))
    shared = ((merged != 0).astype(float) @ has.T).tocoo()
    whole = shared.data == np.diff(merged.indptr)[shared.row]
    row, facet = shared.row[whole].astype(np.int64), shared.col[whole]
    return row, facet, merged[row[:, None], same[side.facets[facet]]].toarray()


def _around(side: Surface, share: Sparse) -> tuple[Ints, Array, Array, Ints, Array]:
    """Facets and faces of a side around places on it.

    Args:
        share: (t, n) values of the nodes' basis functions at the places.

    Returns:
        Of each facet there its place (p,), the way to its middle (p, d) [m], and its normal there (p, d), as long as
        its Jacobian; of each face there its place (r,) and its unit normal (r, d).
    """
    row, facet, part = _facets_around(side, share)
    nodes = side.facets[facet]
    normals = np.einsum("pk,pkd->pd", part, side.node_normals()[nodes])
    away = side.points[nodes].mean(axis=1) - np.einsum("pk,pkd->pd", part, side.points[nodes])
    flat = np.einsum("pk,pkd->pd", part, side.facet_normals()[facet])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    own = np.sort(np.where(part != 0, nodes, -1), axis=1)  # each face has nodes of its own
    once = np.unique(np.column_stack([row, own]), axis=0, return_index=True)[1]
    return row, away, flat, row[once], normals[once]


def _turned(points: _Points) -> _Points:
    """The same points, of the master's edges and the slave's faces."""
    one, other = (points.facet, points.local), (points.other, points.other_local)
    return _Points(*other, *one, points.gap, -points.normals, points.edge, points.own, points.halfway)


def _elsewhere(points: _Points, known: _Points, slave: Surface) -> _Points:
    """Those points that are at none of the known places of the slave."""
    if not len(known.facet):
        return points
    x, there = (On(p.facet, p.local).basis(slave) @ slave.points for p in (points, known))
    return points.at(cKDTree(there).query(x)[0] > CLOSE * np.ptp(slave.points, axis=0).max())


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
    """Where edges of both sides cross in 3D, each with both its faces behind the plane along both edges.

    One of four faces may lie in that plane: there the edge of the other side leaves it.
    """
    one, other = (_Edges.of(side) for side in (slave, master))
    half = [np.linalg.norm(x[:, 1] - x[:, 0], axis=1).max(initial=0.0) / 2 for x in (one.points, other.points)]
    trees = [cKDTree(x.mean(axis=1)) for x in (one.points, other.points)]
    pairs = trees[0].sparse_distance_matrix(trees[1], reach + sum(half), output_type="ndarray")
    order = np.lexsort((pairs["j"], pairs["i"]))
    one, other = one.at(pairs["i"][order]), other.at(pairs["j"][order])
    u, v = (x[:, 1] - x[:, 0] for x in (one.points, other.points))
    inward = (one.inward, -1), (other.inward, 1)
    apart, normals = other.points[:, 0] - one.points[:, 0], np.cross(u, v)
    size = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(size, TINY)[:, None]
    normals *= np.where(np.einsum("ed,ed->e", (one.inward - other.inward).sum(axis=1), normals) > 0, -1.0, 1.0)[:, None]
    signed = np.einsum("ed,ed->e", np.cross(u, v), normals)
    wide = size > CLOSE * np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)  # else they run along each other
    s, t = (np.einsum("ed,ed->e", np.cross(apart, x), normals) / np.where(wide, signed, 1.0) for x in (v, u))
    gap = np.einsum("ed,ed->e", apart, normals)
    met = wide & (np.abs(gap) <= reach)
    for x in (s, t):
        met &= (x >= -ROUNDING) & (x <= 1 + ROUNDING)
    sine = [sign * np.einsum("epd,ed->ep", x, normals) / np.linalg.norm(x, axis=2) for x, sign in inward]
    lean = [(x > np.sin(np.radians(SMOOTH))).all(axis=1) for x in sine]
    flat = [(x > -ROUNDING).all(axis=1) & (x > np.sin(np.radians(SMOOTH))).any(axis=1) for x in sine]
    met &= (lean[0] & flat[1]) | (flat[0] & lean[1])
    found = one.facet, one.local(s), other.facet, other.local(t), gap, normals
    return _Points(*found, own=np.ones(len(gap), bool), edge=met, halfway=np.zeros(len(gap), bool)).at(met)


def _with_rows(coupling: Coupling, points: _Points, reach: float | None) -> Coupling:
    """Each point in the row of the node of the slave that is nearest to it; of several that with the least gap.

    Of the nodes that faces have at an edge those with the largest weights take the points there, one each.

    Args:
        reach: for laws that act at integration points, see `_felt`; else None.
    """
    slave, master = coupling.surface, coupling.master
    assert master is not None
    points = points.at(np.lexsort((np.abs(points.gap), ~points.own)))
    basis = dx.reference_basis(slave.shape, slave.degree, points.local)[0]
    node = np.take_along_axis(slave.facets[points.facet], basis.argmax(axis=1)[:, None], axis=1)[:, 0]
    _, same, count = np.unique(slave.nodes, return_inverse=True, return_counts=True)
    here = np.lexsort((-coupling.weights, same))  # nodes by place, the heaviest first
    place, order = same[node[points.own]], np.argsort(same[node[points.own]], kind="stable")
    turn = np.empty_like(order)
    turn[order] = np.arange(len(order)) - np.searchsorted(place[order], place[order])
    first = np.cumsum(count) - count
    node[: len(order)] = np.where(turn < count[place], here[np.minimum(first[place] + turn, len(here) - 1)], -1)
    order = np.unique(node, return_index=True)[1]
    order = order[node[order] >= 0]
    points, node = points.at(order), node[order]
    at = np.zeros(len(slave.nodes))
    at[node] = 1.0
    row = sparse.csr_matrix((np.ones(len(node)), (node, np.arange(len(node)))), (len(at), len(node)))
    there = relative_to(On(points.facet, points.local), slave, On(points.other, points.other_local), master)
    relative: Sparse = (sparse.diags(1 - at) @ coupling.relative + row @ there).tocsr()
    gap, normals, weights = coupling.gap.copy(), coupling.normals.copy(), coupling.weights.copy()
    gap[node], normals[node] = points.gap, points.normals
    weights[np.isin(same, same[node[points.own]]) & (at == 0)] = 0.0
    weights[node] = np.where(weights[node] > 0, weights[node], slave.node_weights()[node])
    carries = (coupling.carries & (weights != 0)) | (at > 0)
    tips = at.copy()
    tips[node[points.halfway]] = 2.0
    felt = coupling.points if reach is None or not len(node) else partial(_felt, coupling, points, node, reach)
    changed = replace(coupling, points=felt, gap=gap, normals=normals, weights=weights, relative=relative, turning=None)
    return replace(changed, carries=carries, tips=tips)


def _felt(coupling: Coupling, tips: _Points, rows: Ints, reach: float, degree: int) -> Points:
    """Integration points of a law of compliance, with others on the facets around corners and edges that touch.

    These are finer towards what touches, and face the other side along its normal; their areas are those of the edge's
    own side, whichever it is. What the facets were paired with before is left out.

    Args:
        rows: (q,) nodes of the slave in whose rows they are.
    """
    slave, master, found = coupling.surface, coupling.master, coupling.points(degree)
    assert master is not None
    assert found.other is not None
    own, left = tips.own, np.ones(len(found.weights))  # parts of the areas of points that stay
    at_node = found.own.basis(slave).max(axis=1).toarray().ravel() > 1 - ROUNDING  # of node operators
    parts, areas, tip = list[_Points](), list[Array](), list[Ints]()
    for side, other, paired, at in (
        (slave, master, found.own, np.flatnonzero(own)),
        (master, slave, found.other, np.flatnonzero(~own)),
    ):
        each = (tips if side is slave else _turned(tips)).at(at)
        here = On(each.facet, each.local).basis(side)
        _, around, part = _facets_around(side, here)
        gone = np.isin(np.arange(len(side.facets)), around)
        part_gone = gone[paired.facet].astype(float)
        if side is slave:
            part_gone = np.where(
                at_node, found.own.basis(slave) @ (slave.node_weights(gone) / slave.node_weights()), part_gone
            )
        left -= part_gone
        cells = graded(side, around, part @ dx.reference_nodes(side.shape, side.degree))
        facet, local, weights = cells.rule(side, max(degree, 2 * (side.dim - 1)))
        x = On(facet, local).basis(side) @ side.points
        nearest = cKDTree(here @ side.points).query(x)[1] if len(at) else at
        met, of = pair(x, each.normals[nearest], other, reach), each.at(nearest)
        points = replace(of, facet=facet, local=local, other=met.facet, other_local=met.local, gap=met.gap)
        parts.append((points if side is slave else _turned(points)).at(met.facet >= 0))
        areas.append(weights[met.facet >= 0])
        tip.append(at[nearest][met.facet >= 0])
    points, weights, at = _Points.joined(parts), np.concatenate(areas), np.concatenate(tip)
    kept, whole, left = left > ROUNDING, left >= 1 - ROUNDING, sparse.diags(np.maximum(left, 0.0)).tocsc()
    row = sparse.csr_matrix((weights, (rows[at], np.arange(len(at)))), (len(slave.nodes), len(at)))
    there = On(points.facet, points.local), On(points.other, points.other_local)
    if (of_nodes := found.whole) is not None:
        of_nodes = np.append((of_nodes & amid(found.psi, found.phi, whole))[kept], np.zeros(len(at), bool))
    return Points(
        weights=np.concatenate([(left @ found.weights)[kept], weights]),
        relative=sparse.vstack([found.relative[kept], relative_to(there[0], slave, there[1], master)], format="csr"),
        gap=np.concatenate([found.gap[kept], points.gap]),
        normals=np.concatenate([found.normals[kept], points.normals]),
        psi=sparse.hstack([(found.psi @ left)[:, kept], row], format="csr"),
        phi=sparse.hstack([(found.phi @ left)[:, kept], row], format="csr"),
        own=On.joined([found.own.at(kept), there[0]]),
        other=On.joined([found.other.at(kept), there[1]]),
        whole=of_nodes,
    )


def _once(coupling: Coupling) -> Coupling:
    """Let faces that meet at an edge press once on what is one face of the other side, see `with_edges`.

    Where that face is smooth, normals that differ by less than facets do are its own at two places. A node that is left
    out has its part in the row of the better one if their faces hardly bend.
    """
    surface, n = coupling.surface, len(coupling.weights)
    rows = np.flatnonzero((surface.at_edge > 0) & (coupling.weights != 0))
    if not len(rows):
        return coupling
    own, (bent, smooth) = surface.node_normals(), np.cos(np.radians([SHARP, SMOOTH]))
    inside = np.ones(n, bool)
    if coupling.master is not None:
        inside = abs(coupling.relative[:, n:]) @ coupling.master.at_edge == 0
    flat = np.einsum("nd,nd->n", own[rows], coupling.normals[rows])
    rows = rows[np.lexsort((-flat.round(DIGITS), surface.nodes[rows]))]
    ends, better = np.flatnonzero(np.diff(surface.nodes[rows], append=-1)) + 1, np.arange(n)
    for group in np.split(rows, ends[:-1]):
        alike = coupling.normals[group] @ coupling.normals[group].T > np.where(inside[group], bent, smooth)[:, None]
        for k in range(1, len(group)):
            same = np.flatnonzero(alike[k, :k] & (better[group[:k]] == group[:k]))
            better[group[k]] = group[same[0]] if len(same) else group[k]
    kept = better == np.arange(n)
    part = kept | (np.einsum("nd,nd->n", own, own[better]) > smooth)
    share = sparse.csr_matrix((part * coupling.weights, (better, np.arange(n))), (n, n))
    weights = np.asarray(share.sum(axis=1)).ravel()
    each = np.where(kept & (weights != coupling.weights), 1 / np.where(weights > 0, weights, 1.0), 0.0)  # that changes
    mean = sparse.diags(each) @ share + sparse.diags((each == 0).astype(float))
    whole = _ones(better, n).T.tocsr()
    return replace(
        coupling,
        weights=weights,
        relative=(mean @ coupling.relative).tocsr(),
        turning=None if coupling.turning is None else (mean @ coupling.turning).tocsr(),
        gap=mean @ coupling.gap,
        carries=coupling.carries & kept,
        points=lambda degree: coupling.points(degree).moved(whole),
    )
