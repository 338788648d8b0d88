"""Cells of quadrature: facets of a side cut into intervals or triangles, each integrated by itself.

They are parts that face another side, what such parts leave of a facet, and parts that become smaller towards a corner:
a law of compliance that is felt near a corner only is then felt however little the corner is pressed in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import Delaunay

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CLOSE, LAST_DIGITS, ROUNDING, Array, Bools, Ints
from stickslip.geometry.surfaces.facet_map import place
from stickslip.geometry.surfaces.overlay import fan, half_of
from stickslip.geometry.surfaces.surface import Surface


@dataclass(frozen=True)
class Cells:
    """c intervals or triangles, each on one slave facet and facing one master facet."""

    slave_facet: Ints  # (c,)
    master_facet: Ints  # (c,) -1: none
    corners: Array  # (c, d, d-1) in slave reference coordinates
    directions: Array | None = None  # (c, d) of projection; None: the slave's interpolated normals

    def __getitem__(self, rows: Ints | Bools) -> Cells:
        along = None if self.directions is None else self.directions[rows]
        return Cells(self.slave_facet[rows], self.master_facet[rows], self.corners[rows], along)

    @staticmethod
    def of(facets: Ints, corners: Array) -> Cells:
        """Cells that face nothing; those without an area are left out."""
        found = Cells(facets, np.full(len(facets), -1), corners)
        return found[found.areas > LAST_DIGITS]

    @staticmethod
    def joined(parts: Sequence[Cells]) -> Cells:
        """The cells of all parts, which face nothing."""
        return Cells.of(*(np.concatenate(x) for x in zip(*((c.slave_facet, c.corners) for c in parts), strict=True)))

    def at(self, points: Array) -> Array:
        """Map points (g, d-1) of the reference interval or triangle to slave reference coordinates (c, g, d-1)."""
        return np.asarray(self.corners[:, :1] + points @ (self.corners[:, 1:] - self.corners[:, :1]))

    @property
    def areas(self) -> Array:
        """Areas (c,) in reference coordinates, relative to the reference interval or triangle."""
        return np.asarray(np.abs(np.linalg.det(self.corners[:, 1:] - self.corners[:, :1])))

    def rule(self, surface: Surface, degree: int) -> tuple[Ints, Array, Array]:
        """Facets (q,), reference coordinates (q, d-1) and weights (q,) [m^(d-1)] of quadrature, 2 pi r included.

        Args:
            degree: of the integrand in the coordinates of an interval, a triangle, or each of a quadrilateral's.
        """
        total = degree * (1 + (surface.shape == "quadrilateral"))
        points, weights = dx.reference_rule("interval" if surface.dim == 2 else "triangle", total)
        facet, local = np.repeat(self.slave_facet, len(weights)), self.at(points).reshape(-1, surface.dim - 1)
        here = place(surface, facet, local)
        found = np.outer(self.areas, weights).ravel() * here.stretch
        return facet, local, found * 2 * np.pi * here.points[:, 0] if surface.axisymmetric else found


def uncovered(surface: Surface, cells: Cells) -> tuple[Bools, Cells]:
    """What cells that do not cover each other leave of a surface: whole facets (f,), and cells of the others."""
    corners, count = dx.reference_nodes(surface.shape, 1), len(surface.facets)
    size = np.bincount(cells.slave_facet, cells.areas, count) / (1 + (surface.shape == "quadrilateral"))
    cut = np.flatnonzero((size > ROUNDING) & (size < 1 - ROUNDING))
    cells = cells[np.isin(cells.slave_facet, cut)]
    if surface.dim == 2:
        ends = np.sort(cells.corners[:, :, 0], axis=1)
        owner = np.concatenate([cut, cells.slave_facet, cut])
        low, high = np.concatenate([np.zeros((len(cut), 2)), ends, np.ones((len(cut), 2))]).T
        order = np.lexsort((high, low, owner))
        owner, low, high = owner[order], low[order], high[order]
        at = np.flatnonzero((np.diff(owner) == 0) & (low[1:] - high[:-1] > LAST_DIGITS))
        return size <= ROUNDING, Cells.of(owner[at], np.stack([high[at], low[at + 1]], axis=1)[:, :, None])
    around = corners[[0, 1, 3, 2] if surface.shape == "quadrilateral" else [0, 1, 2]]
    owner, left = cut, np.repeat(around[None], len(cut), axis=0)
    order = np.argsort(cells.slave_facet, kind="stable")
    of_cell, start = cells.slave_facet[order], np.searchsorted(cells.slave_facet[order], cut)
    for turn in range(int(np.bincount(of_cell).max(initial=0))):
        at = np.minimum(start[np.searchsorted(cut, owner)] + turn, len(order) - 1)
        meets = of_cell[at] == owner
        parts, owners = [left[~meets]], [owner[~meets]]
        inside, own, cell = left[meets], owner[meets], cells.corners[order[at[meets]]]
        for k in range(3):
            one, other, third = (cell[:, (k + j) % 3, None] for j in range(3))
            across = (other - one)[..., ::-1] * [-1.0, 1.0]
            side = np.sign(np.einsum("pvd,pvd->pv", across, third - one))
            depth = side * np.einsum("pvd,pvd->pv", np.broadcast_to(across, inside.shape), inside - one)
            depth[np.abs(depth) < LAST_DIGITS] = 0.0  # of reference coordinates
            beyond, outside = half_of(inside, -depth)
            parts, owners = [*parts, outside], [*owners, own[beyond]]
            met, inside = half_of(inside, depth)
            own, cell = own[met], cell[met]
        most = max(part.shape[1] for part in parts)
        left = np.concatenate([part[:, np.minimum(np.arange(most), part.shape[1] - 1)] for part in parts])
        owner = np.concatenate(owners)
        used = (left != left[:, -1:]).any(axis=(0, 2))
        left = left[:, : int(used.sum()) + 1]
    row, corners = fan(left)
    return size <= ROUNDING, Cells.of(owner[row], corners)


def graded(surface: Surface, facets: Ints, places: Array) -> Cells:
    """Cells of facets that become smaller by halves towards places on them, down to a `CLOSE` part of a facet.

    Facets are divided into simplices whose vertices are their corners and the places. In each cells become larger along
    lines from a place, or from an edge between two places.

    Args:
        facets: (p,) that have a place each.
        places: reference coordinates (p, d-1).
    """
    corners, d = dx.reference_nodes(surface.shape, 1), surface.dim
    simplices, near, owner = [np.zeros((0, d, d - 1))], [np.zeros((0, d), bool)], [np.zeros(0, np.int64)]
    for facet in np.unique(facets):
        here = places[facets == facet]
        same = (np.abs(here[:, None] - corners) < CLOSE).all(axis=2)
        points = np.concatenate([corners, here[~same.any(axis=1)]])
        is_place = np.arange(len(points)) >= len(corners)
        is_place[: len(corners)] = same.any(axis=0)
        rows = (
            np.stack([x := points[:, 0].argsort(), np.roll(x, -1)], axis=1)[:-1]
            if d == 2
            else Delaunay(points).simplices
        )
        simplices.append(points[rows])
        near.append(is_place[rows])
        owner.append(np.full(len(rows), facet))
    x, is_place, of = np.concatenate(simplices), np.concatenate(near), np.concatenate(owner)
    every = is_place.all(axis=1)  # these are divided at their middles
    middles = np.where(np.eye(d, dtype=bool)[:, :, None], x[every].mean(axis=1)[:, None, None], x[every][:, None])
    x = np.concatenate([x[~every], middles.reshape(-1, d, d - 1)])
    is_place = np.concatenate([is_place[~every], np.tile(~np.eye(d, dtype=bool), (every.sum(), 1))])
    of = np.concatenate([of[~every], np.repeat(of[every], d)])
    big = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) > ROUNDING
    x, is_place, of = x[big], is_place[big], of[big]
    x = np.take_along_axis(x, np.argsort(~is_place, axis=1)[:, :, None], axis=1)
    deep, edge = is_place.any(axis=1), (is_place.sum(axis=1) > 1)[:, None, None, None]
    one, two = x[:, [[0, k] for k in range(1, d)]], x[:, [[k, d - 1] for k in range(d - 1)]]
    lines, of, deep = _narrow(surface, np.where(edge, two, one), of, deep)
    parts, owners = [], []
    halves = [*0.5 ** np.arange(np.ceil(-np.log2(CLOSE)) + 1), 0.0]
    for rows, ends in ((deep, halves), (~deep, [1.0, 0.0])):
        for high, low in pairwise(ends):
            a, b = (lines[rows, :, 0] + t * (lines[rows, :, 1] - lines[rows, :, 0]) for t in (low, high))
            quadrilateral = ((a, 0), (a, 1), (b, 1)), ((a, 0), (b, 1), (b, 0))
            for corner in quadrilateral if d == 3 else (((a, 0), (b, 0)),):
                parts.append(np.stack([x[:, k] for x, k in corner], axis=1))
                owners.append(of[rows])
    return Cells.of(np.concatenate(owners), np.concatenate(parts))


def _narrow(surface: Surface, lines: Array, owner: Ints, deep: Bools) -> tuple[Array, Ints, Bools]:
    """Divide triangles whose cells are small towards one point, by halves of the angle there, until it is narrow.

    Args:
        lines: (c, 2, 2, 2) two of each triangle, by their ends in reference coordinates.
        owner: (c,) facets.
        deep: (c,) whether cells become smaller at all.
    """
    while surface.dim == 3:
        arms = place(surface, np.repeat(owner, 4), lines.reshape(-1, 2)).points.reshape(len(lines), 2, 2, 3)
        arms = arms[:, :, 1] - arms[:, :, 0]
        long = np.linalg.norm(arms, axis=2)
        wide = deep & (lines[:, 0, 0] == lines[:, 1, 0]).all(axis=1)
        wide &= np.einsum("cd,cd->c", arms[:, 0], arms[:, 1]) < np.cos(np.pi / 4) * long.prod(axis=1)
        wide &= np.abs(np.linalg.det(lines[:, :, 1] - lines[:, :, 0])) > LAST_DIGITS
        if not wide.any():
            break
        one, two = lines[wide].copy(), lines[wide].copy()
        one[:, 1, 1] = np.einsum("cr,crd->cd", long[wide, ::-1] / long[wide].sum(axis=1, keepdims=True), one[:, :, 1])
        two[:, 0, 1] = one[:, 1, 1]
        lines = np.concatenate([lines[~wide], one, two])
        owner, deep = (np.concatenate([x[~wide], x[wide], x[wide]]) for x in (owner, deep))
    return lines, owner, deep
