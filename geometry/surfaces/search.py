"""Contact search: where the line through a point along a given direction intersects a master surface nearest to it.

Neighbouring facets are grouped in patches, and the centres of the patches are kept in k-d trees. A sample point marches
along each half-line: if the nearest patch is far, the line is free of facets up to that distance; if it is near, the
line is intersected with the facets of all patches around.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CHUNK, CLOSE, EXACT, ROUNDING, Array, Bools, Ints, Rows
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.surface import Surface

MAX_IT = 12
OUTSIDE = 0.5  # how far outside its reference facet an iterate may lie


def intersect(
    master: Surface, facet: Ints, points: Array, directions: Array, frames: Array
) -> tuple[Bools, Array, Array]:
    """Intersect c lines with one facet each.

    The reference coordinates `local` of the intersection solve sum_k phi_k(local) P_k = 0, with P_k the facet's nodes
    projected along the line. The Jacobian determinant of that map is the component of the facet's normal along the
    line, so that its sign says whether the facet faces the direction. One Newton step is exact on straight simplices.

    Args:
        facet: (c,) rows of `master.facets`.
        points: (c, d) on the lines [m].
        directions: (c, d) unit vectors along the lines.
        frames: (c, d-1, d) unit vectors orthogonal to the lines, from `orthogonal_frames`.

    Returns:
        met (c,): the line meets the facet, and the facet's outward normal is against the direction;
        local (c, d-1) and gap (c,) [m]: reference coordinates and signed distance of the intersection, valid if met.
    """
    away = master.points[master.facets[facet]] - points[:, None]
    nodes = np.einsum("ctd,ckd->ckt", frames, away)
    middle = dx.reference_nodes(master.shape, 1).mean(axis=0, keepdims=True)
    basis, gradient = dx.reference_basis(master.shape, master.degree, middle)
    step, determinant = _newton_step(basis, gradient, nodes)
    local = middle + step
    found = np.isfinite(local).all(axis=1)
    if master.degree > 1 or master.shape == "quadrilateral":
        found[:] = False
        left = np.arange(len(facet))
        for _ in range(MAX_IT):
            local[left] = np.clip(local[left], -OUTSIDE, 1 + OUTSIDE)
            basis, gradient = dx.reference_basis(master.shape, master.degree, local[left])
            step, determinant[left] = _newton_step(basis, gradient, nodes[left])
            local[left] += step
            size = np.abs(step).max(axis=1)
            found[left[size <= EXACT]] = True  # of a Newton step, in reference coordinates
            left = left[size > EXACT]
    inside = into_reference_facet(master.shape, np.where(found[:, None], local, middle))
    # a facet is enlarged by this much, in reference coordinates: no line passes between two neighbours
    area = np.ptp(away, axis=1).max(axis=1) ** (away.shape[2] - 1)  # a facet that lies along the line is not met
    faces = determinant * master.outward[facet] < -ROUNDING * area
    met = found & (np.abs(local - inside).max(axis=1) <= ROUNDING) & faces
    basis = dx.reference_basis(master.shape, master.degree, inside)[0]
    return met, inside, np.einsum("cd,cd->c", directions, np.einsum("ck,ckd->cd", basis, away))


def orthogonal_frames(directions: Array) -> Array:
    """Unit vectors (m, d-1, d) orthogonal to unit directions (m, d); followed by the direction, right-handed frames.

    >>> orthogonal_frames(np.array([[0.0, -1.0]]))
    array([[[1., 0.]]])
    """
    if directions.shape[1] == 2:
        return np.asarray(np.stack([-directions[:, 1], directions[:, 0]], axis=1)[:, None])
    axis = np.eye(3)[np.abs(directions).argmin(axis=1)]
    first = np.cross(axis, directions)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def into_reference_facet(shape: str, local: Array) -> Array:
    """Points (c, d-1) of the reference facet near `local` (c, d-1); the same where that lies inside."""
    if shape != "triangle":
        return np.asarray(np.clip(local, 0.0, 1.0))
    inside = np.maximum(local, 0.0)
    return np.asarray(inside / np.maximum(inside.sum(axis=1, keepdims=True), 1.0))


def _newton_step(basis: Array, gradient: Array, nodes: Array) -> tuple[Array, Array]:
    """Newton step (c, d-1) for sum_k phi_k P_k = 0, and the determinant (c,) of its Jacobian.

    The step is not finite where the line is parallel to the facet.

    Args:
        basis: (1 or c, k).
        gradient: (d-1, 1 or c, k).
        nodes: P_k (c, k, d-1).
    """
    basis = np.broadcast_to(basis, nodes.shape[:2])
    gradient = np.broadcast_to(gradient, (len(gradient), *nodes.shape[:2]))
    value = -np.einsum("ck,ckt->tc", basis, nodes)
    jacobian = np.einsum("ack,ckt->tac", gradient, nodes)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if len(value) == 1:
            return (value / jacobian[0]).T, jacobian[0, 0]
        (a, b), (c, d) = jacobian
        determinant = a * d - b * c
        step = np.stack([d * value[0] - b * value[1], a * value[1] - c * value[0]], axis=1) / determinant[:, None]
        return step, determinant


PATCH = 16  # facets a patch, about: fewer take more steps along a line, more take more intersections
BULGE = 5 / 3  # max of sum_k |phi_k| of quadratic facets: a curved facet bulges at most so much more than its nodes
APPROXIMATION = 0.5  # relative error allowed in the distance to the nearest patch: saves most of the query's time


@dataclass(frozen=True)
class Pairing:
    """Intersections of the lines through m points along given directions with a master surface."""

    facet: Ints  # (m,) row of master.facets; -1 if no facet is met within reach
    local: Array  # (m, d-1) reference coordinates on that facet; 0 if there is none
    gap: Array  # (m,) signed distance to the facet along the direction, positive = open [m]; inf if there is none

    def only(self, met: Bools) -> Pairing:
        """The same where chosen points (m,) meet something, and nothing elsewhere."""
        return Pairing(np.where(met, self.facet, -1), self.local, np.where(met, self.gap, np.inf))

    def weights(self, master: Surface) -> Sparse:
        """Values (m, n_master) of the master's basis at each intersection; an empty row if there is none."""
        met = np.flatnonzero(self.facet >= 0)
        columns = master.facets[self.facet[met]]
        basis = dx.reference_basis(master.shape, master.degree, self.local[met])[0]
        rows = np.broadcast_to(met[:, None], columns.shape)
        shape = (len(self.facet), len(master.points))
        matrix: Sparse = sparse.csr_matrix((basis.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
        return matrix


@dataclass(frozen=True)
class _Balls:
    """Bounding balls of the facets (f, d), (f,) [m]."""

    centres: Array
    radii: Array


@dataclass(frozen=True)
class _Patches:
    """Patches of neighbouring facets whose radii differ by a factor of two at most."""

    tree: cKDTree  # of their centres
    radii: Array
    start: Ints  # facets of patch i: members[start[i] : start[i] + count[i]]
    count: Ints
    members: Ints

    def expand(self, line: Ints, patch: Ints) -> tuple[Ints, Ints]:
        """Turn pairs of line and patch into pairs of line and facet."""
        count = self.count[patch]
        before = np.cumsum(count) - count
        place = np.arange(count.sum()) + np.repeat(self.start[patch] - before, count)
        return np.repeat(line, count), self.members[place]


@dataclass(frozen=True)
class _Hits(Rows):
    """Intersections of lines and facets, one row each."""

    point: Ints
    facet: Ints
    local: Array
    gap: Array


def pair(points: Array, directions: Array, master: Surface, reach: float | Array) -> Pairing:
    """Find for each point the intersection of its line and the master with the smallest |gap| <= reach.

    Only facets that face the direction count (outward normal · direction < 0): the far side of a body, which a line
    meets from inside, is no contact.

    Args:
        points: (m, d) [m].
        directions: (m, d), unit vectors, usually a slave surface's outward normals.
        reach: largest |gap| [m], may be inf; of each point (m,), or of all.
    """
    reach = np.broadcast_to(reach, len(points))
    found = Pairing(
        facet=np.full(len(points), -1), local=np.zeros((len(points), master.dim - 1)), gap=np.full(len(points), np.inf)
    )
    balls = _balls(master)
    patches = _patches(balls)
    for start in range(0, len(points), CHUNK):
        block = slice(start, start + CHUNK)
        hits = _search(points[block], directions[block], master, reach[block], balls, patches)
        # of a facet's radius: gaps that differ by less are equal, and the facet with the lowest number is taken
        first = _nearest(hits, ROUNDING * balls.radii)
        rows = start + hits.point[first]
        found.facet[rows], found.local[rows], found.gap[rows] = hits.facet[first], hits.local[first], hits.gap[first]
    return found


def through_body(points: Array, directions: Array, gaps: Array, master: Surface) -> Bools:
    """Whether each line (m,) passes an averted facet of the master before it meets the facet behind its point.

    That facet is then the far side of a body: the point does not lie in the body.

    Args:
        points, directions: see `pair`.
        gaps: (m,) to the facet that is met [m], negative behind the point.
    """
    found, behind = np.zeros(len(points), bool), np.flatnonzero(gaps < 0)
    half = gaps[behind] / 2
    middles = points[behind] + half[:, None] * directions[behind]
    # of the way: at its ends lie the point, which may touch the averted facet, and the facet met
    found[behind] = pair(middles, -directions[behind], master, (1 - CLOSE) * np.abs(half)).facet >= 0
    return found


def _balls(master: Surface) -> _Balls:
    """Bounding balls of curved facets: the ball of the corners, enlarged by the bulge beyond the straight facet."""
    nodes = master.points[master.facets]
    straight = dx.reference_basis(master.shape, 1, dx.reference_nodes(master.shape, master.degree))[0]
    corners = nodes[:, : straight.shape[1]]
    centres = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    bulge = np.linalg.norm(nodes - straight @ corners, axis=2).max(axis=1)
    # relative enlargement of a facet's ball, for rounding
    return _Balls(centres, (1 + CLOSE) * (reach + BULGE * bulge))


def _patches(balls: _Balls) -> list[_Patches]:
    """Group facets around seeds: every PATCH-th facet in the order of a k-d tree, so that seeds are spread like facets.

    Patches of similar size share a tree: a few large patches in it would widen the search around all others.
    """
    seeds = balls.centres[cKDTree(balls.centres).indices[::PATCH]]
    distance, label = cKDTree(seeds).query(balls.centres)
    radii = np.zeros(len(seeds))
    np.maximum.at(radii, label, distance + balls.radii)
    count = np.bincount(label, minlength=len(seeds))
    start = np.cumsum(count) - count
    members = np.argsort(label, kind="stable")
    used = np.flatnonzero(count)  # of two seeds at the same place one stays empty
    level = np.floor(np.log2(radii.max() / radii[used]))
    alike = [used[level == value] for value in np.unique(level)]
    return [_Patches(cKDTree(seeds[i]), radii[i], start[i], count[i], members) for i in alike]


def _search(
    points: Array, directions: Array, master: Surface, reach: Array, balls: _Balls, patches: list[_Patches]
) -> _Hits:
    """All intersections that may be the nearest one, on both half-lines of each point."""
    frames = orthogonal_frames(directions)
    middle = balls.centres.mean(axis=0)
    extent = (np.linalg.norm(balls.centres - middle, axis=1) + balls.radii).max()
    limit = np.minimum(reach, np.linalg.norm(points - middle, axis=1) + extent)  # shrinks with every intersection
    none = np.zeros(0, np.int64)
    hits = [_Hits(none, none, np.zeros((0, master.dim - 1)), np.zeros(0))]
    for alike in patches:
        for sign in (1, -1):
            start = -sign * alike.radii.max()  # the first round covers both sides of the point
            for line, patch in _march(points, sign * directions, start, limit, alike):
                point, facet = alike.expand(line, patch)
                centres, radii = balls.centres[facet], balls.radii[facet]
                may = _may_meet(points[point], directions[point], limit[point], centres, radii)
                point, facet = point[may], facet[may]
                met, local, gap = intersect(master, facet, points[point], directions[point], frames[point])
                met &= np.abs(gap) <= reach[point]
                hits.append(_Hits(point, facet, local, gap).at(met))
                np.minimum.at(limit, point[met], np.abs(gap[met]))
    return _Hits.joined(hits)


def _march(
    points: Array, directions: Array, start: float, limit: Array, patches: _Patches
) -> Iterator[tuple[Ints, Ints]]:
    """March along half-lines; yield pairs of a line and a patch that it may meet.

    Args:
        start: first position along the lines [m].
        limit: last position of each line (m,) [m]; the caller lowers it between two rounds.
    """
    step = patches.radii.max()  # half the length of line that one round covers
    covered = np.full(len(points), start)
    lines = np.flatnonzero(covered <= limit)
    while len(lines):
        samples = points[lines] + (covered[lines] + step)[:, None] * directions[lines]
        clear = patches.tree.query(samples, eps=APPROXIMATION)[0] / (1 + APPROXIMATION) - step
        close = np.flatnonzero(clear <= step)
        if len(close):
            near = cKDTree(samples[close]).sparse_distance_matrix(patches.tree, 2 * step, output_type="ndarray")
            line, patch = lines[close[near["i"]]], near["j"]
            may = _may_meet(points[line], directions[line], limit[line], patches.tree.data[patch], patches.radii[patch])
            yield line[may], patch[may]
        covered[lines] += step + np.maximum(clear, step)
        lines = lines[covered[lines] <= limit[lines]]


def _may_meet(points: Array, directions: Array, limit: Array, centres: Array, radii: Array) -> Bools:
    """Whether each line enters its ball at a distance of at most `limit` (c,) from the point."""
    away = centres - points
    along = np.einsum("cd,cd->c", away, directions)
    away -= along[:, None] * directions
    return np.asarray((np.einsum("cd,cd->c", away, away) <= radii**2) & (np.abs(along) <= limit + radii))


def _nearest(hits: _Hits, tie: Array) -> Ints:
    """Row of each point's intersection with the smallest |gap|; of equal gaps that of the lowest facet."""
    size = np.abs(hits.gap)
    least = np.full(hits.point.max(initial=-1) + 1, np.inf)
    np.minimum.at(least, hits.point, size)
    kept = np.flatnonzero(size <= least[hits.point] + tie[hits.facet])
    order = kept[np.lexsort((hits.facet[kept], hits.point[kept]))]
    return np.asarray(order[np.unique(hits.point[order], return_index=True)[1]])
