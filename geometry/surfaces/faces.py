"""The faces of a side: its smooth parts. They meet at edges, where each has nodes of its own at the same place.

A split surface is one of several faces that share nodes of the mesh but none of their own: normals, weights, dual
bases and multipliers are then those of a face, and whatever takes a surface knows nothing of edges.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from stickslip.geometry.arrays import Array, Bools, Ints, connected
from stickslip.geometry.curved_facets import SMOOTH, angles, sharp, unit
from stickslip.geometry.surfaces.search import pair
from stickslip.geometry.surfaces.surface import Surface, joined, selected

RIDGES = {  # nodes of a facet on each of its ends (2D) or edges (3D): corners first, then of order 2 the one between
    "interval": ((0,), (1,)),
    "triangle": ((1, 2, 3), (0, 2, 4), (0, 1, 5)),
    "quadrilateral": ((0, 1, 4), (0, 2, 5), (1, 3, 6), (2, 3, 7)),
}


def split_at_edges(surface: Surface, edges: Ints | None = None) -> Surface:
    """The same surface with a node for each face at the nodes of its edges; itself where it has none.

    Faces that are smooth round the end of an edge share the node there.

    Args:
        edges: nodes (e, d-1) of ends (2D) or edges (3D) of facets that are edges, by number in the gmsh model, sorted;
            None: those that the angles between facets tell.
    """
    facets, (f, k) = surface.facets, surface.facets.shape
    ridges = np.array([nodes[: 1 + (surface.dim == 3) * surface.degree] for nodes in RIDGES[surface.shape]])
    one, other = _pairs(np.sort(facets[:, ridges[:, : surface.dim - 1]], axis=2))
    if edges is None:
        sharp = _sharp(surface, ridges, one, other)
    else:
        nodes = np.sort(surface.input[facets[one[:, :1], ridges[one[:, 1], : surface.dim - 1]]], axis=1)
        sharp = np.isin(_numbers(nodes), _numbers(edges))
    if not sharp.any():
        return surface
    edge = np.zeros(len(surface.nodes), bool)
    edge[facets[one[sharp, 0][:, None], ridges[one[sharp, 1]]]] = True
    corner = np.arange(f * k).reshape(f, k)  # a node of a facet
    smooth = [corner[at[~sharp, 0][:, None], ridges[at[~sharp, 1]]] for at in (one, other)]
    smooth = [np.take_along_axis(at, np.argsort(facets.ravel()[at], axis=1), axis=1).ravel() for at in smooth]
    first = np.zeros(len(surface.nodes), np.int64)
    first[facets.ravel()[::-1]] = corner.ravel()[::-1]
    plain = corner[~edge[facets]]
    part = connected(
        f * k, np.concatenate([smooth[0], plain]), np.concatenate([smooth[1], first[facets.ravel()[plain]]])
    )
    face = connected(f, one[~sharp, 0], other[~sharp, 0])
    _, at = np.unique(part, return_index=True)  # the first corner of each new node
    at = at[np.lexsort((at, facets.ravel()[at]))]
    number = np.empty(part.max() + 1, np.int64)
    number[part[at]] = np.arange(len(at))
    old, of_face = facets.ravel()[at], face[at // k]
    again = np.zeros(len(at), np.int64)  # a face that meets itself at an edge has several nodes there
    np.add.at(again, *_repeats(old, of_face))
    split = selected(surface, old, number[part].reshape(f, k))
    return replace(split, faces=of_face + (face.max() + 1) * again)


def with_sides_beside(sides: Mapping[str, Surface]) -> dict[str, Surface]:
    """Sides by name, each knowing where it meets another one of its body at an edge, see `Surface.ends`."""
    found = dict(sides)
    for body in dict.fromkeys(name.partition(".")[0] for name in sides):
        names = [name for name in sides if name.partition(".")[0] == body]
        every = joined([sides[name] for name in names])
        _, first, same = np.unique(every.nodes, return_index=True, return_inverse=True)
        facets = same[every.facets]
        once = np.sort(np.unique(np.sort(facets, axis=1), axis=0, return_index=True)[1])
        whole = split_at_edges(replace(selected(every, first, facets[once], once), faces=None))
        of_side = np.repeat(np.arange(len(names)), [len(sides[name].facets) for name in names])[once]
        corners, owner = whole.facets.ravel(), np.repeat(of_side, whole.facets.shape[1])
        meet = np.unique(np.column_stack([whole.nodes[corners], corners, owner]), axis=0)
        for k, name in enumerate(names):
            own = meet[meet[:, 2] == k]
            shared = np.intersect1d(own[:, 0], meet[meet[:, 2] != k][:, 0])
            smooth = np.intersect1d(own[:, 1], meet[meet[:, 2] != k][:, 1])
            ends = np.setdiff1d(shared, whole.nodes[smooth])
            if len(ends):
                side, later = sides[name], np.isin(sides[name].nodes, meet[meet[:, 2] < k][:, 0])
                at = np.isin(side.nodes, ends)
                faces = np.zeros(len(at), np.int64) if side.faces is None else side.faces
                found[name] = replace(side, ends=at * (1 + later), faces=faces, beside=whole)
    return found


def facets_near(surface: Surface, other: Surface, reach: float) -> Bools:
    """Which facets (f,) may lie within `reach` [m] of another surface."""
    away, slack = _apart(surface, other)
    return np.asarray(away <= reach + slack)


def farthest(surface: Surface, other: Surface) -> float:
    """Distance [m] at which each facet of a surface has one of another one."""
    away, slack = _apart(surface, other)
    return float((away + slack).max())


def _apart(surface: Surface, other: Surface) -> tuple[Array, Array]:
    """Distances (f,) [m] of the middles of facets from those of another surface, and the sizes of both facets."""
    parts = [side.points[side.facets] for side in (surface, other)]
    (centre, radius), (there, radius_there) = [
        (x.mean(axis=1), np.linalg.norm(x - x.mean(axis=1, keepdims=True), axis=2).max(axis=1)) for x in parts
    ]
    # curved facets bulge out of the balls around their nodes
    return cKDTree(there).query(centre)[0], 2 * (radius + radius_there.max())


def halves(surface: Surface, reach: float) -> tuple[Surface, Surface]:
    """Two parts of a surface that may touch itself, such that facets that face each other are of different ones.

    Their normals are opposed: they point to different sides of a plane across the direction in which the surface is
    nearest to itself, or where they lie in it of one across the next direction.

    Args:
        reach: farthest gap [m] across which facets count.
    """
    normals = surface.facet_normals().mean(axis=1)
    size = np.linalg.norm(normals, axis=1)
    normals /= size[:, None]
    assert surface.depth is not None
    found = pair(surface.points[surface.facets].mean(axis=1), normals, surface, reach)
    faces = (found.facet >= 0) & (found.gap >= -surface.depth)
    weight = np.where(faces, size / (np.abs(np.where(faces, found.gap, 0.0)) + surface.depth), 0.0)
    along = normals @ np.linalg.eigh(np.einsum("f,fd,fe->de", weight, normals, normals))[1][:, ::-1]
    first = (np.abs(along) > np.sin(np.radians(SMOOTH))).argmax(axis=1)
    front = np.take_along_axis(along, first[:, None], axis=1)[:, 0] > 0
    return part_of(surface, front), part_of(surface, ~front)


def part_of(surface: Surface, kept: Bools) -> Surface:
    """The part of a surface that has some of its facets (f,)."""
    nodes, facets = np.unique(surface.facets[kept], return_inverse=True)
    images = surface.images
    if images is not None:
        both = np.isin(images[:2], nodes).all(axis=0)
        here, there = np.searchsorted(nodes, np.array(images[:2])[:, both])
        images = here, there, images[2][both]
    part = selected(surface, nodes, facets.reshape(-1, surface.facets.shape[1]), kept)
    return replace(part, images=images)


def _numbers(rows: Ints) -> Ints:
    """One number for one or two numbers of nodes (e, 1 or 2)."""
    return np.asarray(rows[:, 0] if rows.shape[1] == 1 else (rows[:, 0] << 32) + rows[:, 1])


def edges_of(split: Surface) -> tuple[Ints, Ints]:
    """Facets (e, 2) that meet at each edge of a split surface, and which of their ridges (e, 2) it is."""
    ridges = np.array([nodes[: split.dim - 1] for nodes in RIDGES[split.shape]])
    nodes = split.facets[:, ridges]
    one, other = _pairs(np.sort(split.nodes[nodes], axis=2))
    own, others = (np.sort(nodes[at[:, 0], at[:, 1]], axis=1) for at in (one, other))
    apart = (own != others).any(axis=1)
    facets, ridge = np.stack([one, other], axis=1)[apart].transpose(2, 0, 1)
    return facets, ridge


def _pairs(ridges: Ints) -> tuple[Ints, Ints]:
    """Facet and ridge (p, 2) of both facets that meet at a ridge; ridges: their nodes (f, r, d-1), sorted."""
    count = ridges.shape[1]
    key = np.unique(ridges.reshape(-1, ridges.shape[2]), axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(key, kind="stable")
    beside = np.flatnonzero(key[order][1:] == key[order][:-1])
    one, other = (np.stack([rows // count, rows % count], axis=1) for rows in (order[beside], order[beside + 1]))
    return one, other


def _repeats(nodes: Ints, faces: Ints) -> tuple[Ints, Ints]:
    """Rows whose node and face (n,) have been before, and how many times."""
    _, key, count = np.unique(np.stack([nodes, faces]), axis=1, return_inverse=True, return_counts=True)
    order = np.argsort(key.ravel(), kind="stable")
    before = np.arange(len(nodes)) - np.repeat(np.cumsum(count) - count, count)
    return order, before


def _sharp(surface: Surface, ridges: Ints, one: Ints, other: Ints) -> Bools:
    """At which pairs (p, 2) of facet and ridge the facets meet at an edge."""
    normals, corners = surface.facet_normals(), surface.dim - 1
    at = [unit(normals[x[:, 0][:, None], ridges[x[:, 1], :corners]].sum(axis=1)) for x in (one, other)]
    ends = surface.facets[one[:, :1], ridges[one[:, 1], :corners]]
    middles = surface.points[ends].mean(axis=1), surface.points[surface.facets].mean(axis=1)
    return sharp(angles(*at), np.stack([one[:, 0], other[:, 0]]), unit(normals.sum(axis=1)), *middles, surface.facets)
