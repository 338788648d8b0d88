"""Pairs of sides that touch or lie close to each other, found on an outline's facets before any volume is meshed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.surfaces.search import pair
from stickslip.geometry.surfaces.surface import Surface
from stickslip.geometry.user_files.outline import Facets, Outline, normals_of
from stickslip.geometry.user_files.simple_forms import ROUGH, Form, fit

WITHIN = 1e-3  # of the box's diagonal: as far as faces are paired unless the user says how far
ACROSS = 24  # sample points across the part of a side that may touch
FINEST = 256  # parts into which the edge of a facet is divided, at most
LEAST = 1e-3  # of the smaller side's area: two planes that touch along an edge only are no pair
OPPOSITE = 0.7  # minus the cosine between normals of facets that face each other
SAG = 0.3  # bulge of a curved facet relative to its length times the turn of its normals; 1/4 on a circle


@dataclass(frozen=True, eq=False)
class Side:
    """Faces of a body that form one side: those of a name in the file, or all on one plane or cylinder."""

    body: str
    name: str  # as body.side; "" if it has none yet
    faces: tuple[Facets, ...]
    form: Form

    @staticmethod
    def of(body: str, faces: tuple[Facets, ...], dim: int, name: str = "") -> Side:
        """The side of these faces; a name as body.side."""
        return Side(body, name, faces, fit(simplices(face.corners for face in faces), dim))

    @property
    def area(self) -> float:
        """[m^2], in 2D length [m]."""
        return sum(face.size for face in self.faces)

    @property
    def numbers(self) -> tuple[int, ...]:
        return tuple(face.number for face in self.faces)

    @cached_property
    def corners(self) -> Array:
        """Corners (f, d, 3) of facets whose normals point outward; a quadrilateral is two triangles."""
        return simplices(face.corners if face.bodies[0] == self.body else face.corners[:, ::-1] for face in self.faces)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two sides, the smaller one first, and how they lie to each other."""

    one: Side
    other: Side
    area: float  # of `one` within the distance asked for [m^2], in 2D length [m]
    gap: tuple[float, float]  # smallest and largest one there [m]; negative: the bodies overlap
    points: Array  # (p, 3) on `one` there [m]

    @property
    def kind(self) -> str:
        """plane, cylinder or other; in 2D a line and an arc are a plane and a cylinder."""
        return self.one.form.kind if self.one.form.kind == self.other.form.kind else "other"

    @property
    def exact(self) -> bool:
        """Whether the gap is that of the exact shapes, and the same everywhere."""
        return self.kind != "other" and self.gap[1] - self.gap[0] <= self._small

    @property
    def fit(self) -> float:
        """The gap where it is the same everywhere [m]; rounding is zero."""
        gap = sum(self.gap) / 2
        return 0.0 if abs(gap) <= self._small else gap

    @property
    def _small(self) -> float:
        return ROUGH * float(np.ptp(self.points, axis=0).max())


def simplices(faces: Iterable[Array]) -> Array:
    """Corners (f, d, 3) of all facets; a quadrilateral is two triangles."""
    parts = [x if x.shape[1] < 4 else np.concatenate([x[:, :3], x[:, [0, 2, 3]]]) for x in faces]
    return np.concatenate(parts)


def joined(outline: Outline) -> dict[tuple[str, str], tuple[int, ...]]:
    """Faces that are those of two bodies at once, which hold together there, by the names of the two."""
    found: dict[tuple[str, str], tuple[int, ...]] = {}
    for face in outline.entities:
        if len(face.bodies) > 1:
            key = (face.bodies[0], face.bodies[1])
            found[key] = (*found.get(key, ()), face.number)
    return found


def touching(outline: Outline, dim: int, within: float | None = None) -> list[Pair]:
    """All pairs of sides of different bodies with a part within a distance [m] of each other, and facing it."""
    reach = WITHIN * float(np.linalg.norm(np.ptp(outline.box, axis=0))) if within is None else within
    faces = [face for face in outline.entities if len(face.bodies) == 1]
    if not faces:
        return []
    sag = np.array([_sag(face.corners) for face in faces])
    low, high = (np.array([face.box[i] for face in faces]) for i in (0, 1))
    body = np.array([face.bodies[0] for face in faces])
    slack = (reach + sag)[:, None]
    near = np.array([np.all((a - reach <= high + slack) & (low - slack <= b + reach), axis=1)
                     for a, b in zip(low - sag[:, None], high + sag[:, None], strict=True)])  # fmt: skip
    near &= body[:, None] != body[None, :]
    used = np.flatnonzero(near.any(axis=1))
    sides = _sides([faces[i] for i in used], outline, dim)
    of = {face.number: side for side in sides for face in side.faces}
    candidates = {
        tuple(sorted((sides.index(of[faces[i].number]), sides.index(of[faces[j].number]))))
        for i, j in zip(*np.nonzero(near), strict=True)
    }
    found = []
    for i, j in sorted(candidates):
        one, other = sorted((sides[i], sides[j]), key=lambda side: side.area)
        pair_found = _measure(one, other, reach, dim)
        if pair_found is not None:
            found.append(pair_found)
    return found


def close_pairs(
    outline: Outline, dim: int, facing: Sequence[tuple[str, str]], fine: float, spacing: float = np.inf
) -> list[Pair]:
    """Pairs of named sides where they are closer than a cell of size `fine` [m], or than WITHIN of the geometry.

    Args:
        spacing: of `points`, at most [m].
    """
    reach = max(fine, WITHIN * float(np.linalg.norm(np.ptp(outline.box, axis=0))))
    sides = {name: named(name, outline, dim) for names in facing for name in names}
    pairs = (sorted((sides[a], sides[b]), key=lambda side: side.area) for a, b in facing)
    found = (_measure(one, other, reach, dim, spacing) for one, other in pairs)
    return [pair_found for pair_found in found if pair_found is not None]


def thinned(pairs: Sequence[Pair], spacing: float) -> Array:
    """Points (p, 3) of pairs, about this far apart [m]."""
    points = np.concatenate([np.zeros((0, 3)), *(p.points for p in pairs)])
    _, first = np.unique((points / spacing).round(), axis=0, return_index=True)
    found: Array = points[first]
    return found


def named(name: str, outline: Outline, dim: int) -> Side:
    """The side of a name that the outline has, as body.side."""
    faces = tuple(f for f in outline.entities if outline.side_of.get(f.number) == name)
    return Side.of(name.split(".")[0], faces, dim, name)


def _sides(faces: Sequence[Facets], outline: Outline, dim: int) -> list[Side]:
    """Faces by the file's names, or by the plane or cylinder on which they lie."""
    names = dict.fromkeys(outline.side_of[face.number] for face in faces if face.number in outline.side_of)
    sides = [named(name, outline, dim) for name in names]
    for face in faces:
        if face.number in outline.side_of:
            continue
        form, body = fit(face.corners, dim), face.bodies[0]
        same = next((k for k, s in enumerate(sides) if s.body == body and not s.name and form.same(s.form)), None)
        if same is None:
            sides.append(Side(body, "", (face,), form))
        else:
            sides[same] = Side(body, "", (*sides[same].faces, face), sides[same].form)
    return sides


def _sag(corners: Array) -> float:
    """How far the facets (f, k, 3) of a face may be from the curved face [m]: by the turn of neighbours' normals."""
    normals = normals_of(corners)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    f, k = corners.shape[:2]
    _, node = np.unique(corners.reshape(-1, 3).round(12), axis=0, return_inverse=True)
    node = node.ravel()
    mean = np.zeros((node.max() + 1, 3))
    np.add.at(mean, node, np.repeat(normals, k, axis=0))
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    cosine = np.einsum("fkd,fd->fk", mean[node].reshape(f, k, 3), normals).min(axis=1)
    length = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return float((SAG * length * np.arccos(np.clip(cosine, -1, 1))).max())


def _measure(one: Side, other: Side, reach: float, dim: int, spacing: float = np.inf) -> Pair | None:
    """The pair, if a part of `one` has `other` within reach along its normals.

    Args:
        spacing: of sample points, at most [m].
    """
    sag = _sag(one.corners) + _sag(other.corners)
    far = reach + sag
    boxes = [(x.reshape(-1, 3).min(axis=0), x.reshape(-1, 3).max(axis=0)) for x in (one.corners, other.corners)]
    low = np.maximum(boxes[0][0], boxes[1][0]) - far
    high = np.minimum(boxes[0][1], boxes[1][1]) + far
    here, there = (_within(x, low, high) for x in (one.corners, other.corners))
    if not (len(here) and len(there)):
        return None
    points, normals, weights = _samples(here, min(spacing, float(np.linalg.norm(high - low)) / ACROSS))
    nodes = there.reshape(-1, 3)[:, :dim]
    number = np.arange(len(nodes))
    master = Surface(
        shape="triangle" if dim == 3 else "interval",
        degree=1,
        nodes=number,
        input=number,
        points=nodes,
        facets=number.reshape(-1, dim),
        outward=np.ones(len(there)),
        axisymmetric=False,
    )
    met = pair(points[:, :dim], normals[:, :dim], master, far)
    exact = one.form.onto(points)
    gap = met.gap if other.form.kind == "other" else other.form.distance(exact)
    facing = normals_of(there)[met.facet]
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    kept = (met.facet >= 0) & (gap <= reach) & (np.einsum("pd,pd->p", normals, facing) < -OPPOSITE)
    area, flat = float(weights[kept].sum()), one.form.kind == other.form.kind == "plane"
    if area <= (LEAST * one.area if flat else 0.0):
        return None
    return Pair(one, other, area, (float(gap[kept].min()), float(gap[kept].max())), exact[kept])


def _within(corners: Array, low: Array, high: Array) -> Array:
    """Facets whose box meets that between two corners."""
    found: Array = corners[np.all((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high), axis=1)]
    return found


def _samples(corners: Array, spacing: float) -> tuple[Array, Array, Array]:
    """Points (p, 3), unit normals (p, 3) and weights (p,): the middles of equal parts of all facets."""
    length = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    parts = np.clip(np.ceil(length / spacing), 2, FINEST).astype(int)
    normals = normals_of(corners)
    area = np.linalg.norm(normals, axis=1)
    points, units, weights = [], [], []
    for n in np.unique(parts):
        rows = parts == n
        at = _middles(int(n), corners.shape[1])
        points.append(np.einsum("sk,fkd->fsd", at, corners[rows]).reshape(-1, 3))
        units.append(np.repeat(normals[rows] / area[rows, None], len(at), axis=0))
        weights.append(np.repeat(area[rows] / len(at), len(at)))
    return np.concatenate(points), np.concatenate(units), np.concatenate(weights)


def _middles(n: int, corners: int) -> Array:
    """Barycentric coordinates (s, corners) of the middles of n parts of an edge, or of n^2 parts of a triangle."""
    if corners == 2:
        t = (np.arange(n) + 0.5) / n
        return np.stack([1 - t, t], axis=1)
    i, j = np.divmod(np.arange(n * n), n)
    upright, turned = i + j < n, (i + j < n - 1)
    first = np.stack([i[upright] + 1 / 3, j[upright] + 1 / 3], axis=1)
    second = np.stack([i[turned] + 2 / 3, j[turned] + 2 / 3], axis=1)
    t = np.concatenate([first, second]) / n
    return np.column_stack([1 - t.sum(axis=1), t])
