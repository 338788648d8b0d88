"""Pairs of sides that touch or lie close to each other, found on an outline's facets before any volume is meshed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from stickslip.geometry.arrays import CLOSE, SLIGHT, TINY, Array, Bools, Ints
from stickslip.geometry.curved_facets import curved, edge_middles, normals_of
from stickslip.geometry.shape import SKIN
from stickslip.geometry.surfaces.search import pair
from stickslip.geometry.surfaces.surface import Surface
from stickslip.geometry.user_files.outline import Facets, Form, Outline, fit, sample, simplices

WITHIN = 1e-3  # of the box's diagonal: as far as faces are paired unless the user says how far
ACROSS = 24  # sample points across the part of a side that may touch
FINEST = 256  # parts into which the edge of a facet is divided, at most
BULGE = 4 / 3  # a quadratic facet bulges at most so much more than its edges
OPPOSITE = 0.7  # minus the cosine between normals of facets that face each other
AGAINST = 0.9  # the same where they meet in a point; a cone's edge on the rim of a hole is no contact
CUT, BEST, ROUNDS = 4, 64, 6  # where the gap is least, parts of facets are cut into so many, the best ones, again
ENOUGH = 16  # sample points within the distance asked for, for their area
KNOWN = ("plane", "cylinder", "sphere", "other")  # kinds of forms, in the order in which their normals count
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
        corners, between = simplices(face.corners for face in faces), [face.between for face in faces]
        known = np.concatenate([np.zeros((0, 3)), *(points for points in between if points is not None)])
        return Side(body, name, faces, fit(corners, dim, known))

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

    @cached_property
    def bulge(self) -> Array:
        """Of these facets (f, e, 3), see `curved`; zero of planes and cylinders, which are known, and without CAD."""
        parts = []
        for face in self.faces:
            straight = np.zeros_like(edge_middles(simplices([face.corners])))
            bulge = straight if face.bulge is None or self.form.kind != "other" else face.bulge
            parts.append(bulge if face.bodies[0] == self.body else bulge[:, ::-1])
        return np.concatenate(parts)

    @property
    def off(self) -> float:
        """Distance of the curved facets from the CAD kernel's faces [m]."""
        return max(face.off for face in self.faces) if self.form.kind == "other" else 0.0

    @property
    def sag(self) -> float:
        """Largest distance of straight facets from the side [m]."""
        return max(sag_of(face) for face in self.faces)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two sides, the smaller one first, and how they lie to each other."""

    one: Side
    other: Side
    area: float  # of `one` within the distance asked for [m^2], in 2D length [m]
    gap: tuple[float, float]  # smallest and largest one there [m]; negative: the bodies overlap
    points: Array  # (p, 3) on `one` there [m]
    accuracy: float = 0.0  # of a gap that is not `exact` [m]

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
        return CLOSE * float(np.ptp(self.points, axis=0).max())


def joined(outline: Outline) -> dict[tuple[str, str], tuple[int, ...]]:
    """Faces that are those of two bodies at once, which hold together there, by the names of the two."""
    found: dict[tuple[str, str], tuple[int, ...]] = {}
    for face in outline.entities:
        if len(face.bodies) > 1:
            key = (face.bodies[0], face.bodies[1])
            found[key] = (*found.get(key, ()), face.number)
    return found


def touching(outline: Outline, dim: int, within: float | None = None) -> list[Pair]:
    """All pairs of sides with a part within a distance [m] of each other, and facing it.

    Sides of one body face each other across what is open, not through it; one that is curved may face itself.
    """
    reach = WITHIN * float(np.linalg.norm(np.ptp(outline.box, axis=0))) if within is None else within
    faces = [face for face in outline.entities if len(face.bodies) == 1]
    if not faces:
        return []
    sag = np.array([sag_of(face) for face in faces])
    low, high = (np.array([face.box[i] for face in faces]) for i in (0, 1))
    body = np.array([face.bodies[0] for face in faces])
    slack = (reach + sag)[:, None]
    near = np.array([np.all((a - reach <= high + slack) & (low - slack <= b + reach), axis=1)
                     for a, b in zip(low - sag[:, None], high + sag[:, None], strict=True)])  # fmt: skip
    flat = [np.unique(_unit(face.normals()).round(1), axis=0) for face in faces]
    for i, j in zip(*np.nonzero(near & (body[:, None] == body[None, :])), strict=True):
        near[i, j] = (flat[i] @ flat[j].T).min() < -OPPOSITE / 2  # they are rounded
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
        known = one is other and one.form.kind != "other"  # a plane or a bore, which does not face itself closely
        pair_found = None if known else _measure(one, other, reach, dim)
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


def meeting(outline: Outline, one: str, other: str, reach: float) -> tuple[Array, Array]:
    """Points (p, 3) of a side where it has another one within reach [m], and unit normals there; all if none is round.

    Normals are those of the plane, cylinder or sphere that a face is, not of facets, which hold what slides on it.
    """
    own, there = ([Side(face.bodies[0], "", (face,), outline.forms[face.number]) for face in _faces(name, outline)]
                  for name in (one, other))  # fmt: skip
    found, kinds = [], set[str]()
    for pair_of in product(own, there):
        opposite = _opposite(*pair_of, reach)
        near = opposite[0].spread(opposite[1] / ACROSS) if opposite else None
        if near is not None and (near.gap <= reach).any():
            form = min((side.form for side in pair_of), key=lambda form: KNOWN.index(form.kind))
            points = near.points[near.gap <= reach]
            kinds.add(form.kind)
            flat = sample(pair_of[0].faces, pair_of[0].body) if form.kind == "other" else None
            found.append(flat or (points, form.normals(points)))
    if kinds.isdisjoint(KNOWN[1:3]):
        return sample(_faces(one, outline), one.split(".")[0])
    return np.concatenate([each[0] for each in found]), np.concatenate([each[1] for each in found])


def thinned(pairs: Sequence[Pair], spacing: float) -> Array:
    """Points (p, 3) of pairs, about this far apart [m]."""
    points = np.concatenate([np.zeros((0, 3)), *(p.points for p in pairs)])
    _, first = np.unique((points / spacing).round(), axis=0, return_index=True)
    found: Array = points[first]
    return found


def named(name: str, outline: Outline, dim: int) -> Side:
    """The side of a name that the outline has, as body.side."""
    return Side.of(name.split(".")[0], _faces(name, outline), dim, name)


def _faces(name: str, outline: Outline) -> tuple[Facets, ...]:
    """The faces of a side that the outline has, as body.side."""
    body, side = name.split(".")
    whole = side == SKIN
    faces = (f for f in outline.entities if (f.bodies == (body,) if whole else outline.side_of.get(f.number) == name))
    return tuple(faces)


def _sides(faces: Sequence[Facets], outline: Outline, dim: int) -> list[Side]:
    """Faces by the file's names, or by the plane or cylinder on which they lie."""
    names = dict.fromkeys(outline.side_of[face.number] for face in faces if face.number in outline.side_of)
    sides = [named(name, outline, dim) for name in names]
    for face in faces:
        if face.number in outline.side_of:
            continue
        form, body = fit(simplices([face.corners]), dim, face.between), face.bodies[0]
        same = next((k for k, s in enumerate(sides) if s.body == body and not s.name and form.same(s.form)), None)
        if same is None:
            sides.append(Side(body, "", (face,), form))
        else:
            sides[same] = Side(body, "", (*sides[same].faces, face), sides[same].form)
    return sides


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def sag_of(face: Facets) -> float:
    """Largest distance of a face's facets from the curved face [m]: by their bulge, and the turn of normals."""
    corners, normals = face.corners, _unit(face.normals())
    f, k = corners.shape[:2]
    low, high = face.box
    places = ((corners.reshape(-1, 3) - low) / np.ptp([low, high], axis=0).max()).round(9)
    _, node = np.unique(places, axis=0, return_inverse=True)
    node = node.ravel()
    mean = np.zeros((node.max() + 1, 3))
    np.add.at(mean, node, np.repeat(normals, k, axis=0))
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), TINY)
    cosine = np.einsum("fkd,fd->fk", mean[node].reshape(f, k, 3), normals).min(axis=1)
    length = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    turned = float((SAG * length * np.arccos(np.clip(cosine, -1, 1))).max())
    bulge = 0.0 if face.bulge is None else float(np.linalg.norm(face.bulge, axis=2).max())
    return max(turned, BULGE * bulge)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Points of a side, each of which stands for a part of a facet, and how far they are from another side."""

    facet: Ints  # (p,)
    parts: Array  # (p, k, k) barycentric coordinates of the corners of each part
    weights: Array  # (p,) area of each part [m^2], in 2D length [m]
    points: Array  # (p, 3) [m]
    gap: Array  # (p,) [m]; inf where the other side is not met, or does not face this one
    facing: Array  # (p,) cosine between the normals there

    def least(self, count: int) -> Ints:
        """Rows of the smallest gaps."""
        rows = np.argsort(self.gap, kind="stable")[:count]
        return np.asarray(rows[np.isfinite(self.gap[rows])])


@dataclass(frozen=True, eq=False)
class _Meeting:
    """The parts of two sides that may touch."""

    corners: Array  # (f, k, 3) of the first side's facets there
    bulge: Array  # (f, e, 3) of them
    forms: tuple[Form, Form]
    master: Surface  # the other side
    normals: Array  # (g, 3) unit normals of its facets
    far: float  # [m] as far as lines are followed
    least: float  # gap [m] that counts

    @staticmethod
    def of(one: Side, other: Side, low: Array, high: Array, far: float) -> _Meeting | None:
        """Of the facets that reach into a box; None if a side has none there."""
        here, there = (_within(side.corners, low, high) for side in (one, other))
        if not (here.any() and there.any()):
            return None
        corners, bulge = other.corners[there], other.bulge[there]
        dim, straight = corners.shape[1], not bulge.any()
        nodes = corners if straight else np.concatenate([corners, edge_middles(corners) + bulge], axis=1)
        number = np.arange(nodes.shape[0] * nodes.shape[1])
        master = Surface(
            shape="triangle" if dim == 3 else "interval",
            degree=1 if straight else 2,
            nodes=number,
            input=number,
            points=nodes.reshape(-1, 3)[:, :dim],
            facets=number.reshape(nodes.shape[:2]),
            outward=np.ones(len(corners)),
            axisymmetric=False,
        )
        least = -CLOSE * float(np.linalg.norm(high - low)) if one.body == other.body else -np.inf
        forms = one.form, other.form
        return _Meeting(one.corners[here], one.bulge[here], forms, master, _unit(normals_of(corners)), far, least)

    def sampled(self, facet: Ints, parts: Array, weights: Array) -> _Samples:
        """The middles of parts of facets."""
        own, other = self.forms
        dim = self.corners.shape[1]
        points, normals = curved(self.corners[facet], self.bulge[facet], parts.mean(axis=1))
        points = own.onto(points)
        if own.kind != "other":
            exact = own.normals(points)
            normals = exact * np.sign(np.einsum("pd,pd->p", exact, normals))[:, None]
        met = pair(points[:, :dim], normals[:, :dim], self.master, self.far)
        gap = met.gap if other.kind == "other" else other.distance(points)
        facing = np.einsum("pd,pd->p", normals, self.normals[met.facet])
        gap = np.where((met.facet >= 0) & (facing < -OPPOSITE) & (gap >= self.least), gap, np.inf)
        return _Samples(facet, parts, weights, points, gap, facing)

    def spread(self, spacing: float) -> _Samples:
        """Equal parts of all facets, not longer than `spacing` [m] if FINEST of them suffice."""
        k = self.corners.shape[1]
        length = np.linalg.norm(self.corners - np.roll(self.corners, 1, axis=1), axis=2).max(axis=1)
        count = np.clip(np.ceil(length / spacing), 2, FINEST).astype(int)
        area = np.linalg.norm(normals_of(self.corners), axis=1)
        facet, parts, weights = [], [], []
        for n in np.unique(count):
            rows, cut = np.flatnonzero(count == n), _parts(int(n), k)
            facet.append(np.repeat(rows, len(cut)))
            parts.append(np.tile(cut, (len(rows), 1, 1)))
            weights.append(np.repeat(area[rows] / len(cut), len(cut)))
        return self.sampled(np.concatenate(facet), np.concatenate(parts), np.concatenate(weights))

    def tips(self) -> _Samples:
        """The corners of all facets, which stand for no area."""
        f, k = self.corners.shape[:2]
        parts = np.tile(np.repeat(np.eye(k)[:, None], k, axis=1), (f, 1, 1))
        return self.sampled(np.repeat(np.arange(f), k), parts, np.zeros(f * k))

    def cut(self, samples: _Samples, rows: Ints) -> _Samples:
        """The parts of these rows, each cut into smaller ones."""
        cut = _parts(CUT, self.corners.shape[1])
        parts = np.einsum("skl,plm->pskm", cut, samples.parts[rows]).reshape(-1, *cut.shape[1:])
        weights = np.repeat(samples.weights[rows] / len(cut), len(cut))
        return self.sampled(np.repeat(samples.facet[rows], len(cut)), parts, weights)


def _opposite(one: Side, other: Side, reach: float) -> tuple[_Meeting, float] | None:
    """The parts of two sides that may touch within reach [m], and the size of the box around them [m]."""
    far = reach + one.sag + other.sag
    boxes = [(x.reshape(-1, 3).min(axis=0), x.reshape(-1, 3).max(axis=0)) for x in (one.corners, other.corners)]
    low = np.maximum(boxes[0][0], boxes[1][0]) - far
    high = np.minimum(boxes[0][1], boxes[1][1]) + far
    found = _Meeting.of(one, other, low, high, far)
    return None if found is None else (found, float(np.linalg.norm(high - low)))


def _measure(one: Side, other: Side, reach: float, dim: int, spacing: float = np.inf) -> Pair | None:
    """The pair, if a part of `one` has `other` within reach along its normals.

    Where the gap is not the same everywhere, parts of facets are cut where it is least: curved sides may touch in a
    point or along a line, which no sample point meets.

    Args:
        spacing: of sample points, at most [m].
    """
    if (opposite := _opposite(one, other, reach)) is None:
        return None
    meeting, size = opposite
    # a gap of less, relative to the part of the sides that may touch, is rounding
    accuracy = CLOSE * size + 2 * (one.off + other.off)
    kinds, samples, tips = {one.form.kind, other.form.kind}, meeting.spread(min(spacing, size / ACROSS)), meeting.tips()
    # of the smaller side's area: two planes that touch along an edge only are no pair
    if kinds == {"plane"} and samples.weights[samples.gap <= reach].sum() <= SLIGHT * one.area:
        return None
    near, least = samples, [samples]
    if len(kinds) > 1 or kinds == {"other"} or not _constant(samples.gap[samples.gap <= reach], CLOSE * size):
        for _ in range(ROUNDS):
            if not np.isfinite(samples.gap).any():
                break
            samples = meeting.cut(samples, samples.least(BEST))
            least.append(samples)
            near = samples if np.sum(near.gap <= reach) < ENOUGH else near
    area = float(near.weights[near.gap <= reach].sum())
    point = one.body != other.body  # faces of one body meet at its edges
    touch = (tips.gap <= reach) & ((area > 0) | (point & (tips.facing < -AGAINST)))
    points = np.concatenate([near.points[near.gap <= reach], tips.points[touch]])
    if not len(points):
        return None
    lowest = [found.gap.min(initial=np.inf) for found in least]
    gaps = np.concatenate([near.gap[near.gap <= reach], tips.gap[touch], lowest])
    found = Pair(one, other, area, (float(gaps.min()), float(gaps[gaps <= reach].max())), points, accuracy)
    touches = not found.exact and abs(found.gap[0]) <= accuracy
    return replace(found, gap=(0.0, max(0.0, found.gap[1]))) if touches else found


def _constant(gap: Array, within: float) -> bool:
    return len(gap) > 0 and float(np.ptp(gap)) <= within


def _within(corners: Array, low: Array, high: Array) -> Bools:
    """Whether the box of each facet meets that between two corners."""
    return np.asarray(np.all((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high), axis=1))


def _parts(n: int, corners: int) -> Array:
    """Barycentric coordinates (s, corners, corners) of the corners of n parts of an edge, or n^2 of a triangle."""
    if corners == 2:
        t = np.arange(n + 1) / n
        ends = np.stack([1 - t, t], axis=1)
        return np.stack([ends[:-1], ends[1:]], axis=1)
    i, j = np.divmod(np.arange(n * n), n)
    upright, turned = i + j < n, (i + j < n - 1)
    first = np.stack([i, j], axis=1)[upright][:, None] + np.array([[0, 0], [1, 0], [0, 1]])
    second = np.stack([i, j], axis=1)[turned][:, None] + np.array([[1, 1], [0, 1], [1, 0]])
    t = np.concatenate([first, second]) / n
    return np.concatenate([1 - t.sum(axis=2, keepdims=True), t], axis=2)
