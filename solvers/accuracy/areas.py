"""Areas of contact with an edge between nodes: the edge of a touching area lies inside a facet.

Beyond the edge of a smooth contact the gap grows like the power 3/2 of the distance, and so does the slip beyond the
edge of a stuck part. So gap^(2/3) is linear: it is extrapolated to zero from the nodes outside.

Source: of the power K. L. Johnson, Contact Mechanics (1985), sections 4.2 and 7.2.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array, Bools, Ints
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.results.step_result import OPEN, SLIP, STICK, ContactState, Numbers, Quantity

PARTS: dict[str, list[tuple[int, ...]]] = {
    "interval": [(0, 1)],
    "triangle": [(0, 1, 2)],
    "quadrilateral": [(0, 1, 2), (1, 3, 2)],
}  # corners of simplices
Edge = tuple[Bools, Array, Bools | None]  # inside, outside, among: see `beyond_nodes`


class Crossing(NamedTuple):
    """Place where the edge of an area lies between two neighbouring nodes."""

    inside: int  # node
    outside: int
    at: float  # of the way from the one to the other; negative: the edge lies before the node inside


def areas_inside_facets(contacts: Iterable[ContactRows], step: Numbers) -> dict[Quantity, float]:
    """Areas of all contacts, and of their sums [m^(d-1)], whose edges lie between nodes, and mean pressures [Pa]."""
    found = dict[Quantity, float]()
    for c in contacts:
        areas = areas_between_nodes(c.surface, step.contacts[c.name], c.node_weights)
        found |= {Quantity("contacts", c.name, key): area for key, area in areas.items()}
    return _with_sums(found, step)


def _with_sums(found: dict[Quantity, float], step: Numbers) -> dict[Quantity, float]:
    """Areas of contacts, with those of their sums and mean pressures."""
    for name in step.sums:
        for key in ("contact_area", "stick_area", "slip_area"):
            found[Quantity("contacts", name, key)] = sum(found[Quantity("contacts", p, key)] for p in step.parts(name))
    for name, of in {**step.contacts, **step.sums}.items():
        area = found[Quantity("contacts", name, "contact_area")]
        found[Quantity("contacts", name, "mean_pressure")] = 0.0 if area <= 0 else of.normal_force / area
    return found


def areas_between_nodes(side: Surface, contact: ContactState, weights: Array) -> dict[str, float]:
    """Areas of a contact [m^(d-1)] whose edges lie between nodes.

    Args:
        side: n nodes; of order 2 it is taken as smaller facets of order 1.
        contact: at these nodes.
        weights: (n,) area that each node stands for [m^(d-1)]; 0 where it faces nothing.
    """
    if side.degree > 1:
        (straight, size), own = side.of_corners, side.all_weights
        share = np.divide(weights, own, out=(weights > 0).astype(float), where=own > 0)
        curved = float(own.sum() / size.sum())  # area, by that of the straight facets
        side, weights = straight, share * size * curved
    beyond_touching, *beyond_sticking = (beyond_nodes(side, *edge) for edge in _edges(contact, weights))
    touching = float(weights[contact.status != OPEN].sum()) + beyond_touching
    sticking = float(weights[contact.status == STICK].sum()) + sum(beyond_sticking)
    return {"contact_area": touching, "stick_area": sticking, "slip_area": touching - sticking}


class MovingEdges:
    """Areas of the neighbours of a solution, whose edges move beside those that it has between nodes."""

    def __init__(self, contacts: Iterable[ContactRows], step: Numbers) -> None:
        """Find the edges of the solution.

        Args:
            contacts: all of them.
            step: numbers of the solution.
        """
        contacts = tuple(contacts)
        self.own = areas_inside_facets(contacts, step)
        self._edges = {c.name: _Inside(c.surface, step.contacts[c.name]) for c in contacts}

    def __call__(self, step: Numbers) -> dict[Quantity, float]:
        """As `areas_inside_facets`; NaN where too few nodes are inside an edge."""
        found = dict[Quantity, float]()
        for name, edges in self._edges.items():
            touching, sticking = Quantity("contacts", name, "contact_area"), Quantity("contacts", name, "stick_area")
            grown = edges.grown(step.contacts[name])
            found |= {key: self.own[key] * by for key, by in zip((touching, sticking), grown, strict=True)}
            found[Quantity("contacts", name, "slip_area")] = found[touching] - found[sticking]
        return _with_sums(found, step)


class _Inside:
    """How the areas of a contact grow, by what vanishes at their edges like a square root of the distance.

    Pressure does so at the edge of contact, bound minus traction at that of what sticks. The square is linear there:
    where it is some part of its largest value the next node that touches or slips does not disturb it, and the area
    inside grows as the whole one does. What is between nodes at the edge itself goes from one to the next in jumps.

    Source: K. L. Johnson, Contact Mechanics (1985), sections 4.2 and 7.2.
    """

    def __init__(self, side: Surface, contact: ContactState) -> None:
        """Choose the parts by a solution.

        Args:
            side: of order 2: its corners count, where tractions have unknowns.
            contact: of the solution.
        """
        corners = len({"interval": "12", "triangle": "123", "quadrilateral": "1234"}[side.shape])
        self._side = side
        cut = np.concatenate([side.facets[:, :corners][:, list(part)] for part in PARTS[side.shape]])
        faces = contact.weight > 0  # not of a periodic twin, nor of what faces nothing: these are not outside
        self._cut = cut[faces[cut].all(axis=1)]
        squares = self._squares(contact)
        self._levels = [self._level(f) for f in squares]
        self._sizes = [self._above(f, level) for f, level in zip(squares, self._levels, strict=True)]

    def grown(self, contact: ContactState) -> list[float]:
        """By how much what touches and what sticks is larger than in the solution, as factors."""
        every = zip(self._squares(contact), self._levels, self._sizes, strict=True)
        return [1.0 if level == 0 else self._above(f, level) / size for f, level, size in every]

    @staticmethod
    def _squares(contact: ContactState) -> tuple[Array, Array]:
        """What vanishes at the edge of contact, and at that of what sticks, squared (n,)."""
        left = contact.bound - np.linalg.norm(contact.traction, axis=1)
        left = np.where(np.isinf(contact.bound), contact.pressure, left)
        open_, sticks = contact.status == OPEN, contact.status == STICK
        return (contact.pressure * ~open_) ** 2, (np.maximum(left, 0.0) * sticks) ** 2

    def _level(self, f: Array) -> float:
        """The square between the second and the third node inside the edge; 0: there is no edge, NaN: too few nodes."""
        inside, rings = f > 0, list[float]()
        among = inside[self._cut]
        seen = np.unique(self._cut[among.any(axis=1) & ~among.all(axis=1)])
        if not len(seen):
            return 0.0
        for _ in range(2):
            near = np.unique(self._cut[np.isin(self._cut, seen[inside[seen]]).any(axis=1)])
            ring = np.setdiff1d(near[inside[near]], seen)
            rings.append(float(f[ring].mean()) if len(ring) else np.nan)
            seen = np.union1d(seen, ring)
        return float(np.mean(rings) / f.max())

    def _above(self, f: Array, level: float) -> float:
        """Area [m^(d-1)] where a function that is linear on each simplex is above a part of its largest value.

        Args:
            f: the function (n,), not negative.
            level: that part [-].
        """
        if np.isnan(level) or not f.any():
            return np.nan
        level = level * f.max()
        order = np.argsort(-f[self._cut], axis=1)
        nodes = np.take_along_axis(self._cut, order, axis=1)
        high, *_, low = values = f[nodes].T
        some = (high > level) & (low < level)
        part, x = (low >= level).astype(float), self._side.points[nodes]
        middle = x.mean(axis=1)
        if nodes.shape[1] == 2:
            part[some] = ((high - level) / np.where(some, high - low, 1.0))[some]
            middle = x[:, 0] + part[:, None] / 2 * (x[:, 1] - x[:, 0])
        else:
            mid = values[1]
            whole = np.where(some, (high - low), 1.0)
            tip = (high - level) ** 2 / np.where(high > mid, (high - mid), 1.0) / whole
            rest = 1 - (level - low) ** 2 / np.where(mid > low, (mid - low), 1.0) / whole
            part[some] = np.where(level >= mid, tip, rest)[some]
        sizes = np.array([_size(each) for each in x])
        around = 2 * np.pi * middle[:, 0] if self._side.axisymmetric else 1.0
        return float(np.sum(part * sizes * around))


def _edges(contact: ContactState, weights: Array) -> tuple[Edge, Edge, Edge]:
    """The edge of what touches; those of what sticks, towards slip and towards what is open."""
    opened, sticks, slips = (contact.status == k for k in (OPEN, STICK, SLIP))
    gap, slip = np.where(weights > 0, contact.gap, 0.0), np.linalg.norm(contact.slip_increment, axis=1)
    return (~opened, gap, None), (sticks, slip, sticks | slips), (sticks, gap, sticks | opened)


def beyond_nodes(side: Surface, inside: Bools, outside: Array, among: Bools | None = None) -> float:
    """Area inside a smooth edge beyond the shares of the nodes inside it [m^(d-1)].

    Args:
        side: of order 1 (corners count alone), n nodes.
        inside: (n,) nodes that belong to the area.
        outside: (n,) gap or slip of the nodes that do not [m].
        among: (n,) facets that have other nodes than these are left out; None: none is.
    """
    crossed = _crossed(side, inside, outside, among)
    return float(sum(_part(side, nodes, inside, found) for nodes, found in crossed))


def _crossed(
    side: Surface, inside: Bools, outside: Array, among: Bools | None
) -> Iterator[tuple[Array, list[Crossing]]]:
    """The nodes of each simplex that the edge crosses, and where it does: in 2D once, in 3D twice."""
    simplices = np.concatenate([side.facets[:, list(part)] for part in PARTS[side.shape]])
    if among is not None:
        simplices = simplices[among[simplices].all(axis=1)]
    mixed = simplices[inside[simplices].any(axis=1) & ~inside[simplices].all(axis=1)]
    if not len(mixed):
        return
    level = np.where(inside, 0.0, np.maximum(outside, 0.0) ** (2 / 3))
    slope = _slopes(side, ~inside if among is None else among & ~inside, level, np.unique(mixed))
    least = -0.5 if side.dim == 2 else 0.0  # of a facet: a node touches as soon as its surroundings do, on average
    for nodes in mixed:
        found = []
        for a in nodes[inside[nodes]]:
            for b in nodes[~inside[nodes]]:
                fall = slope[b] @ (side.points[b] - side.points[a])
                at = 1 - level[b] / fall if fall > 0 else 0.5
                found.append(Crossing(int(a), int(b), float(np.clip(at, least, 1.0))))
        yield nodes, found


def _slopes(side: Surface, chosen: Bools, level: Array, nodes: Ints) -> Array:
    """Gradients (n, d) of the level at those of some nodes that are chosen, by least squares from chosen neighbours.

    Zero where there is none.
    """
    matrix = side.neighbours
    slope = np.zeros_like(side.points)
    for k in nodes[chosen[nodes]]:
        near = matrix.indices[matrix.indptr[k] : matrix.indptr[k + 1]]
        near = near[chosen[near]]
        if len(near):
            slope[k] = np.linalg.lstsq(side.points[near] - side.points[k], level[near] - level[k], rcond=CLOSE)[0]
    return slope


def _part(side: Surface, nodes: Array, inside: Bools, found: list[Crossing]) -> float:
    """Area inside the edge of a simplex that it crosses, minus the shares of its nodes that are inside."""
    x, count = side.points[nodes], int(inside[nodes].sum())
    share = float(np.prod([crossing.at if count == 1 else 1 - crossing.at for crossing in found]))
    inner = share if count == 1 else 1 - share
    return (inner - count / len(nodes)) * _size(x) * _around(side, nodes)


def _around(side: Surface, nodes: Array) -> float:
    """Factor on the size of a simplex: the way around the axis in axisymmetric models [m], else 1."""
    return 2 * np.pi * float(side.points[nodes, 0].mean()) if side.axisymmetric else 1.0


def _size(x: Array) -> float:
    """Length of a segment (2, d) or area of a triangle (3, 3) [m^(d-1)]."""
    sides = x[1:] - x[0]
    return float(np.sqrt(np.linalg.det(sides @ sides.T))) / (len(x) - 1)
