"""Bodies that lie in each other, found on an outline's facets by rays: how deep, how much of them, and where.

Rays along the axes fill the box that two bodies have in common; between an odd and an even crossing of its skin a ray
is inside a body. The depth at a point is the shortest way through both bodies along the axes and between them. What is
thinner than the facets' distance from the curved faces is left to the exact shapes of pairs, see `touching`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from scipy.spatial import cKDTree

from stickslip.geometry.arrays import CLOSE, SLIGHT, Array, connected
from stickslip.geometry.user_files.outline import RAY, Outline, crossings, simplices
from stickslip.geometry.user_files.touching import sag_of

FEW, RAYS = 8, 32  # across the common box, to find overlaps and their volume; depth is measured at as many points


@dataclass(frozen=True, eq=False)
class Overlap:
    """Two bodies that lie in each other."""

    bodies: tuple[str, str]
    depth: float  # [m]
    volume: float  # [m^3], in 2D area [m^2]
    place: Array  # (d,) of the depth [m]

    def said(self, length: str) -> str:
        """Return it in words, with the name of the unit of length."""
        one, other = self.bodies
        plane = len(self.place) == 2
        at, of = ", ".join(f"{x:.3g}" for x in self.place), "an area" if plane else "a volume"
        return (
            f"{one} and {other} lie in each other, up to about {self.depth:.2g} {length} deep at ({at}), in {of} of "
            f"about {self.volume:.2g} {length}{'²' if plane else '³'}"
        )


def overlaps(outline: Outline, dim: int) -> list[Overlap]:
    """Return the pairs of bodies that lie in each other, the deepest ones first; not those that share nodes."""
    skins = {
        body: (simplices(face.corners for face in faces)[..., :dim], max(map(sag_of, faces)))
        for body in outline.bodies
        if (faces := [face for face in outline.entities if body in face.bodies])
    }
    found = []
    for one, other in combinations(skins, 2):
        if (one, other) not in outline.shared and (overlap := _overlap(one, other, skins, dim)):
            found.append(overlap)
    return sorted(found, key=lambda overlap: -overlap.depth)


def _overlap(one: str, other: str, skins: dict[str, tuple[Array, float]], dim: int) -> Overlap | None:
    (a, sag_a), (b, sag_b) = skins[one], skins[other]
    low = np.maximum(*(x.reshape(-1, dim).min(axis=0) for x in (a, b)))
    high = np.minimum(*(x.reshape(-1, dim).max(axis=0) for x in (a, b)))
    least = sag_a + sag_b + CLOSE * float(np.ptp(np.concatenate([a, b]).reshape(-1, dim), axis=0).max())
    if np.any(high - low <= least):
        return None
    _, starts = _common(a, b, low, high, FEW)
    boxes = _regions(a, b, starts if len(starts) else _corners_inside(a, b, low, high, least), least)
    if len(starts) and boxes:
        boxes = [(np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0))]
    found = [each for each in (_in_box(a, b, *box, least) for box in boxes) if each is not None]
    if not found:
        return None
    depth, _, place = max(found, key=lambda each: each[0])
    return Overlap((one, other), depth, sum(volume for _, volume, _ in found), place)


def _corners_inside(a: Array, b: Array, low: Array, high: Array, least: float) -> Array:
    """Return corners and middles (p, d) of facets of two skins (f, d, d) that lie in the other body, near its skin.

    Those that lie less than `least` [m] behind it are left out.
    """
    dim, inside = len(low), [np.zeros((0, len(low)))]
    for one, other in ((a, b), (b, a)):
        points, middles = np.concatenate([one.reshape(-1, dim), one.mean(axis=1)]), other.mean(axis=1)
        points = np.unique(points[np.all((points >= low) & (points <= high), axis=1)], axis=0)
        near = np.linalg.norm(other - middles[:, None], axis=2).max()
        points = points[cKDTree(middles).query(points)[0] <= near]
        ways = [np.array(way) for way in crossings(other, points, RAY[:dim])] if len(points) else []
        far = least / float(np.linalg.norm(RAY[:dim]))
        inside.append(points[[np.sum(x > 0) % 2 == 1 and float(np.abs(x).min()) > far for x in ways]])
    return np.concatenate(inside)


def _regions(a: Array, b: Array, points: Array, least: float) -> list[tuple[Array, Array]]:
    """Return boxes around what two skins have in common at points (p, d) of it, where it is `least` [m] wide."""
    points = points[:: max(1, len(points) // (FEW * RAYS))]
    slack = CLOSE * float(np.ptp(np.concatenate([a, b]).reshape(-1, points.shape[1]), axis=0).max())

    def spans(points: Array) -> Iterator[tuple[int, int, float, float]]:
        for axis, along in enumerate(np.eye(points.shape[1])):
            for ray, begin, end in _inside_both(a, b, points, along) if len(points) else ():
                if begin <= slack and end >= -slack and end - begin > least:
                    yield ray, axis, begin, end

    middles = points[[ray for ray, *_ in spans(points)]]
    for row, (_, axis, begin, end) in zip(middles, spans(points), strict=True):
        row[axis] += (begin + end) / 2
    low, high = middles.copy(), middles.copy()
    for ray, axis, begin, end in spans(middles):
        low[ray, axis] += begin
        high[ray, axis] += end
    wide = np.all(high - low > least, axis=1)
    low, high = low[wide], high[wide]
    meet = np.all((low[:, None] <= high + slack) & (high[:, None] >= low - slack), axis=2)
    part = connected(len(low), *np.nonzero(meet))
    return [(low[part == k].min(axis=0), high[part == k].max(axis=0)) for k in np.unique(part)]


def _in_box(a: Array, b: Array, low: Array, high: Array, least: float) -> tuple[float, float, Array] | None:
    """Return depth [m], volume [m^d] and place (d,) [m] of what two skins have in common within a box.

    Nothing is found where they lie in each other by `least` [m] at most.
    """
    dim, (_, middles) = len(low), _common(a, b, low, high, FEW)
    if not len(middles):
        return None
    chosen = middles[:: max(1, len(middles) // RAYS)]
    directions = np.array([d for d in product((-1, 0, 1), repeat=dim) if d > (0,) * dim], float)
    ways = np.zeros((len(directions), len(chosen)))
    for k, direction in enumerate(directions / np.linalg.norm(directions, axis=1, keepdims=True)):
        for ray, begin, end in _inside_both(a, b, chosen, direction):
            if begin < 0 < end:
                ways[k, ray] = end - begin
    depth = ways.min(axis=0)
    if depth.max() <= least:
        return None
    deep = chosen[depth >= (1 - SLIGHT) * depth.max()]  # of equally deep ones the one in their middle
    place = deep[np.argmin(np.linalg.norm(deep - deep.mean(axis=0), axis=1))]
    return float(depth.max()), _common(a, b, low, high, RAYS)[0], place


def _common(a: Array, b: Array, low: Array, high: Array, rays: int) -> tuple[float, Array]:
    """Return the volume that two skins (f, d, d) have in common within a box, and the middles (m, d) of rays there.

    Args:
        rays: across the box in each direction.
    """
    dim, volumes, middles = len(low), list[float](), [np.zeros((0, len(low)))]
    for axis, along in enumerate(np.eye(dim)):
        across = np.delete(np.arange(dim), axis)
        step = (high - low)[across] / rays
        ticks = [low[k] + (np.arange(rays) + RAY[0]) * d for k, d in zip(across, step, strict=True)]
        start = np.full((rays ** (dim - 1), dim), low[axis])
        start[:, across] = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, dim - 1)
        width = float(high[axis] - low[axis])
        spans = [(k, max(p, 0.0), min(q, width)) for k, p, q in _inside_both(a, b, start, along) if p < width and q > 0]
        volumes.append(sum(end - begin for _, begin, end in spans) * float(np.prod(step)))
        middles += [(start[ray] + (begin + end) / 2 * along)[None] for ray, begin, end in spans]
    return float(np.median(volumes)), np.concatenate(middles)


def _inside_both(a: Array, b: Array, start: Array, direction: Array) -> Iterator[tuple[int, float, float]]:
    """Yield the spans of rays (r, d), by distance from their start, that lie inside both of two skins (f, d, d)."""
    ways = [crossings(skin, start, direction) for skin in (a, b)]
    for ray, (one, other) in enumerate(zip(*ways, strict=True)):
        for (p, q), (r, s) in product(
            zip(one[::2], one[1::2], strict=False), zip(other[::2], other[1::2], strict=False)
        ):
            if max(p, r) < min(q, s):
                yield ray, max(p, r), min(q, s)
