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

from stickslip.geometry.arrays import CLOSE, SLIGHT, Array
from stickslip.geometry.user_files.outline import RAY, Outline, crossings
from stickslip.geometry.user_files.touching import sag_of, simplices

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
    _, middles = _common(a, b, low, high, FEW)
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
    volume, _ = _common(a, b, low, high, RAYS)
    return Overlap((one, other), float(depth.max()), volume, place)


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
        spans = list(_inside_both(a, b, start, along))
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
