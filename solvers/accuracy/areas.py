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
    for name in step.sums:
        for key in ("contact_area", "stick_area", "slip_area"):
            found[Quantity("contacts", name, key)] = sum(found[Quantity("contacts", p, key)] for p in step.parts(name))
    for name, of in {**step.contacts, **step.sums}.items():
        area = found[Quantity("contacts", name, "contact_area")]
        found[Quantity("contacts", name, "mean_pressure")] = of.normal_force / area if area > 0 else 0.0
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
