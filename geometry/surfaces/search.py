"""Search for contact: where lines from points along given directions first meet a master surface.

Facets are gathered in small patches, the patches in trees of their centres. Along each half-line goes a sample point:
where the nearest patch is far the line is clear as far as that, where it is near the facets of all patches around are
tried.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from geometry import dolfinx_versions as dx
from geometry.arrays import Array, Bools, Ints
from geometry.surfaces.surface import Surface

EDGE = 1e-8  # a line this close to a facet's edge, in reference coordinates, meets the facet: neighbours leave no slit
STEPS = 12
STILL = 1e-11  # the last Newton step, in reference coordinates, of a point that was found
AWAY = 0.5  # how far out of its reference facet an iterate may go


def cross(master: Surface, facet: Ints, points: Array, directions: Array, frames: Array) -> tuple[Bools, Array, Array]:
    """Meet the line through points[i] along directions[i] with the facet facet[i]: (c,) pairs.

    Seen along the line the facet is flat: `local` solves sum_k phi_k(local) P_k = 0, P_k its nodes in the plane
    across the line. The determinant of that map is the normal's component along the line, so it also says whether
    the facet faces the direction. One linear step is exact on straight simplices; others go on with Newton's.

    Args:
        frames: (c, d-1, d) unit vectors across the lines, from `across`.

    Returns:
        met (c,): the line meets the facet, and the facet's outward normal is against the direction;
        local (c, d-1) and gap (c,) [m], where it does.
    """
    away = master.points[master.facets[facet]] - points[:, None]
    nodes = np.einsum("ctd,ckd->ckt", frames, away)
    middle = dx.reference_nodes(master.shape, 1).mean(axis=0, keepdims=True)
    basis, gradient = dx.reference_basis(master.shape, master.degree, middle)
    step, turn = _newton_step(basis, gradient, nodes)
    local = middle + step
    found = np.isfinite(local).all(axis=1)
    if master.degree > 1 or master.shape == "quadrilateral":
        found[:] = False
        left = np.arange(len(facet))
        for _ in range(STEPS):
            local[left] = np.clip(local[left], -AWAY, 1 + AWAY)
            basis, gradient = dx.reference_basis(master.shape, master.degree, local[left])
            step, turn[left] = _newton_step(basis, gradient, nodes[left])
            local[left] += step
            size = np.abs(step).max(axis=1)
            found[left[size <= STILL]] = True
            left = left[size > STILL]
    clipped = clip(master.shape, np.where(found[:, None], local, middle))
    met = found & (np.abs(local - clipped).max(axis=1) <= EDGE) & (turn * master.outward[facet] < 0)
    basis = dx.reference_basis(master.shape, master.degree, clipped)[0]
    return met, clipped, np.einsum("cd,cd->c", directions, np.einsum("ck,ckd->cd", basis, away))


def across(directions: Array) -> Array:
    """Unit vectors (m, d-1, d) across unit directions (m, d); with the direction last, a right-handed frame.

    >>> across(np.array([[0.0, -1.0]]))
    array([[[1., 0.]]])
    """
    if directions.shape[1] == 2:
        return np.asarray(np.stack([-directions[:, 1], directions[:, 0]], axis=1)[:, None])
    axis = np.eye(3)[np.abs(directions).argmin(axis=1)]
    first = np.cross(axis, directions)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def clip(shape: str, local: Array) -> Array:
    """The reference facet's point near `local`."""
    if shape != "triangle":
        return np.asarray(np.clip(local, 0.0, 1.0))
    inside = np.maximum(local, 0.0)
    return np.asarray(inside / np.maximum(inside.sum(axis=1, keepdims=True), 1.0))


def _newton_step(basis: Array, gradient: Array, nodes: Array) -> tuple[Array, Array]:
    """Step (c, d-1) towards the zero of sum_k phi_k P_k and the determinant (c,) of its gradient.

    Basis (1 or c, k) and gradient (d-1, 1 or c, k); the step is not finite where the facet is seen edge-on.
    """
    basis = np.broadcast_to(basis, nodes.shape[:2])
    gradient = np.broadcast_to(gradient, (len(gradient), *nodes.shape[:2]))
    value = -np.einsum("ck,ckt->tc", basis, nodes)
    jacobian = np.einsum("ack,ckt->tac", gradient, nodes)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if len(value) == 1:
            return (value / jacobian[0]).T, jacobian[0, 0]
        (a, b), (c, d) = jacobian
        turn = a * d - b * c
        return np.stack([d * value[0] - b * value[1], a * value[1] - c * value[0]], axis=1) / turn[:, None], turn


BLOCK = 10_000  # points at a time: bounds the memory
PATCH = 16  # facets: fewer need more steps along a line, more have more facets to try
BULGE = 5 / 3  # max of sum_k |phi_k| of quadratic facets: so many times farther out than its nodes a bulge may be
SLACK = 1e-6  # of a facet's radius: what rounding may hide
TIE = 1e-8  # of a facet's radius: gaps this near to each other are the same, the facet with the lowest number has it
ROUGH = 0.5  # the nearest centre may be this much nearer than said: saves most of the time of that question


@dataclass(frozen=True)
class Pairing:
    """Where lines from m points along given directions meet a master surface."""

    facet: Ints  # (m,) row of master.facets, -1 where none is met within reach
    local: Array  # (m, d-1) reference coordinates on that facet; 0 where none
    gap: Array  # (m,) signed distance to the facet along the direction, positive = open [m]; inf where none

    def weights(self, master: Surface) -> sparse.csr_matrix:
        """(m, n_master) values of the master's basis where each line meets it; empty rows where it does not."""
        met = np.flatnonzero(self.facet >= 0)
        columns = master.facets[self.facet[met]]
        basis = dx.reference_basis(master.shape, master.degree, self.local[met])[0]
        rows = np.broadcast_to(met[:, None], columns.shape)
        shape = (len(self.facet), len(master.points))
        return sparse.csr_matrix((basis.ravel(), (rows.ravel(), columns.ravel())), shape=shape)


@dataclass(frozen=True)
class _Balls:
    """Facets, each within its ball."""

    centres: Array
    radii: Array


@dataclass(frozen=True)
class _Patches:
    """Patches of neighbouring facets, their radii alike to a factor of two."""

    tree: cKDTree  # of their centres
    radii: Array
    start: Ints  # patch i has the facets members[start[i] : start[i] + count[i]]
    count: Ints
    members: Ints

    def expand(self, line: Ints, patch: Ints) -> tuple[Ints, Ints]:
        """Pairs of a line and a patch to pairs of a line and a facet."""
        count = self.count[patch]
        before = np.cumsum(count) - count
        place = np.arange(count.sum()) + np.repeat(self.start[patch] - before, count)
        return np.repeat(line, count), self.members[place]


@dataclass(frozen=True)
class _Hits:
    """Lines that meet facets: one row for each meeting."""

    point: Ints
    facet: Ints
    local: Array
    gap: Array


def pair(points: Array, directions: Array, master: Surface, reach: float) -> Pairing:
    """Meet each point's line with the master, at the place with the smallest |gap| <= reach.

    Only facets that face the direction count (outward normal · direction < 0): the far side of a body, met from
    within, is no contact.

    Args:
        points: (m, d) [m].
        directions: (m, d), unit vectors, usually a slave surface's outward normals.
        reach: [m], may be inf.
    """
    found = Pairing(
        facet=np.full(len(points), -1), local=np.zeros((len(points), master.dim - 1)), gap=np.full(len(points), np.inf)
    )
    balls = _balls(master)
    patches = _patches(balls)
    for start in range(0, len(points), BLOCK):
        block = slice(start, start + BLOCK)
        hits = _search(points[block], directions[block], master, reach, balls, patches)
        first = _nearest(hits, TIE * balls.radii)
        rows = start + hits.point[first]
        found.facet[rows], found.local[rows], found.gap[rows] = hits.facet[first], hits.local[first], hits.gap[first]
    return found


def _balls(master: Surface) -> _Balls:
    nodes = master.points[master.facets]
    straight = dx.reference_basis(master.shape, 1, dx.reference_nodes(master.shape, master.degree))[0]
    corners = nodes[:, : straight.shape[1]]
    centres = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    bulge = np.linalg.norm(nodes - straight @ corners, axis=2).max(axis=1)
    return _Balls(centres, (1 + SLACK) * (reach + BULGE * bulge))


def _patches(balls: _Balls) -> list[_Patches]:
    """Facets go to the nearest of every PATCH-th centre in a tree's order, which is spread like the facets.

    A few large patches would make the neighbourhood of every point large: each size has its own tree.
    """
    seeds = balls.centres[cKDTree(balls.centres).indices[::PATCH]]
    distance, label = cKDTree(seeds).query(balls.centres)
    radii = np.zeros(len(seeds))
    np.maximum.at(radii, label, distance + balls.radii)
    count = np.bincount(label, minlength=len(seeds))
    start = np.cumsum(count) - count
    members = np.argsort(label, kind="stable")
    used = np.flatnonzero(count)  # of two seeds in one place one has nothing
    level = np.floor(np.log2(radii.max() / radii[used]))
    alike = [used[level == value] for value in np.unique(level)]
    return [_Patches(cKDTree(seeds[i]), radii[i], start[i], count[i], members) for i in alike]


def _search(
    points: Array, directions: Array, master: Surface, reach: float, balls: _Balls, patches: list[_Patches]
) -> _Hits:
    """All meetings that may be the nearest, on both half-lines of each point."""
    frames = across(directions)
    middle = balls.centres.mean(axis=0)
    extent = (np.linalg.norm(balls.centres - middle, axis=1) + balls.radii).max()
    limit = np.minimum(reach, np.linalg.norm(points - middle, axis=1) + extent)  # shrinks with every meeting
    none = np.zeros(0, np.int64)
    hits = [_Hits(none, none, np.zeros((0, master.dim - 1)), np.zeros(0))]
    for alike in patches:
        for sign in (1, -1):
            start = -sign * alike.radii.max()  # the first round sees both sides of the points
            for line, patch in _march(points, sign * directions, start, limit, alike):
                point, facet = alike.expand(line, patch)
                centres, radii = balls.centres[facet], balls.radii[facet]
                may = _may_meet(points[point], directions[point], limit[point], centres, radii)
                point, facet = point[may], facet[may]
                met, local, gap = cross(master, facet, points[point], directions[point], frames[point])
                met &= np.abs(gap) <= reach
                hits.append(_Hits(point[met], facet[met], local[met], gap[met]))
                np.minimum.at(limit, point[met], np.abs(gap[met]))
    return _Hits(*(np.concatenate([getattr(hit, name) for hit in hits]) for name in _Hits.__dataclass_fields__))


def _march(
    points: Array, directions: Array, start: float, limit: Array, patches: _Patches
) -> Iterator[tuple[Ints, Ints]]:
    """Pairs of a line and a patch that it may meet, from `start` on, until each line is seen to its limit.

    `limit` is the caller's, who lowers it between two rounds.
    """
    step = patches.radii.max()  # half the length of line that one round sees
    seen = np.full(len(points), start)
    lines = np.flatnonzero(seen <= limit)
    while len(lines):
        samples = points[lines] + (seen[lines] + step)[:, None] * directions[lines]
        clear = patches.tree.query(samples, eps=ROUGH)[0] / (1 + ROUGH) - step
        close = np.flatnonzero(clear <= step)
        if len(close):
            near = cKDTree(samples[close]).sparse_distance_matrix(patches.tree, 2 * step, output_type="ndarray")
            line, patch = lines[close[near["i"]]], near["j"]
            may = _may_meet(points[line], directions[line], limit[line], patches.tree.data[patch], patches.radii[patch])
            yield line[may], patch[may]
        seen[lines] += step + np.maximum(clear, step)
        lines = lines[seen[lines] <= limit[lines]]


def _may_meet(points: Array, directions: Array, limit: Array, centres: Array, radii: Array) -> Bools:
    """Whether each line comes into the ball, no farther from the point than `limit` (c,)."""
    away = centres - points
    along = np.einsum("cd,cd->c", away, directions)
    away -= along[:, None] * directions
    return np.asarray((np.einsum("cd,cd->c", away, away) <= radii**2) & (np.abs(along) <= limit + radii))


def _nearest(hits: _Hits, tie: Array) -> Ints:
    """The row of each point's hit with the smallest |gap|; of equals the lowest facet."""
    size = np.abs(hits.gap)
    least = np.full(hits.point.max(initial=-1) + 1, np.inf)
    np.minimum.at(least, hits.point, size)
    kept = np.flatnonzero(size <= least[hits.point] + tie[hits.facet])
    order = kept[np.lexsort((hits.facet[kept], hits.point[kept]))]
    return np.asarray(order[np.unique(hits.point[order], return_index=True)[1]])
