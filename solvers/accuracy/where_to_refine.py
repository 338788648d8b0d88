"""Where the error of a run of order 2 in the plane comes from: places at which its mesh is to be cut.

These are the corners of the bodies and the changes of side where something acts on one of both sides; in every step the
facets whose nodes differ in status, and those at the largest pressure; and of the other side of a contact the facets
that they face. Elsewhere displacements are smooth.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array, Bools, Ints
from stickslip.geometry.nested_mesh import FlatMesh
from stickslip.geometry.surfaces.surface import CREASE
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.problem import Problem

TOUCHING = 0.999  # of half the lengths of two segments; midpoints that are nearer belong to segments that overlap
DIGITS = 9  # of coordinates over the size of a side, in which segments of several steps are the same
NONE = -1  # number of a boundary without a name


@dataclass(frozen=True)
class Places:
    """Where a mesh, and the meshes that are cut from it, are to be cut."""

    acted: tuple[str, ...]  # sides that contacts, supports and loads act on
    segments: Mapping[str, Array]  # by side, segments (s, 3, 2) [m]: their ends, and a point between

    @classmethod
    def of(cls, problem: Problem, contacts: Sequence[ContactRows], steps: Sequence[StepResult]) -> Places:
        """The places of a run.

        Args:
            contacts: of its mesh.
            steps: all its steps.
        """
        acted = [side for pair in problem.pairs.values() for side in (pair.slave, pair.master)]
        acted += [support.boundary for support in problem.supports.values()]
        acted += [load.boundary for load in problem.loads.values()]
        segments = dict[str, list[Array]]()
        for c in contacts:
            pair = problem.pairs[c.name]
            segments.setdefault(pair.slave, []).extend(mine for mine, _ in _changes(c, steps))
            if pair.master is not None:
                segments.setdefault(pair.master, []).extend(faced for _, faced in _changes(c, steps))
        return cls(
            tuple(sorted({side for side in acted if side is not None})),
            {side: np.concatenate([np.zeros((0, 3, 2)), *parts]) for side, parts in segments.items()},
        )

    def nodes(self, mesh: FlatMesh) -> Ints:
        """Corners of cells at these places: all cells that have one of them are to be cut."""
        found = [_corners(mesh, self.acted)]
        for side, segments in self.segments.items():
            facets = mesh.sides[side]
            found.append(facets[_overlap(mesh.points[facets], segments)][:, :2].ravel())
        return np.unique(np.concatenate(found))

    def contact_nodes(self, mesh: FlatMesh) -> int:
        """Number of nodes of all contact sides."""
        return len(np.unique(np.concatenate([mesh.sides[side].ravel() for side in self.segments])))


def _changes(c: ContactRows, steps: Sequence[StepResult]) -> Iterator[tuple[Array, Array]]:
    """By step, the facets (f, 3, 2) [m] of the slave that the contact changes in, and where they lie on the other side.

    The other side counts undeformed, like the slave: what slides by, lies elsewhere.
    """
    for step in steps:
        contact = step.contacts[c.name]
        status, facets = contact.status[c.surface.facets], c.surface.facets
        changes = (status != status[:, :1]).any(axis=1) | (facets == np.argmax(contact.pressure)).any(axis=1)
        mine = c.surface.points[facets[changes]]
        yield mine, mine + contact.slip[facets[changes]]


def _overlap(facets: Array, segments: Array) -> Bools:
    """Which facets (f, 3, 2) overlap with a segment (s, 3, 2), across a small gap."""
    found = np.zeros(len(facets), bool)
    half = np.linalg.norm(facets[:, 1] - facets[:, 0], axis=1) / 2
    size = float(np.ptp(facets[:, :2], axis=(0, 1)).max())
    for a, b, middle in segments[np.unique((segments / size).round(DIGITS), axis=0, return_index=True)[1]]:
        near = np.linalg.norm(facets[:, 2] - middle, axis=1) < TOUCHING * (half + np.linalg.norm(b - a) / 2)
        found |= near
    return found


def _corners(mesh: FlatMesh, acted: Sequence[str]) -> Ints:
    """Nodes where the boundary has a corner or passes to another side, if something acts on one of the two sides.

    Where more than two facets meet, always.
    """
    edges = mesh.boundary()
    names = list(mesh.sides)
    side_of = {m: k for k, name in enumerate(names) for m in mesh.sides[name][:, 2].tolist()}
    number = np.array([side_of.get(m, NONE) for m in edges[:, 2].tolist()])
    active = np.isin(number, [k for k, name in enumerate(names) if name in acted])
    ends, middles = edges[:, :2].ravel(), np.repeat(edges[:, 2], 2)
    order = np.argsort(ends, kind="stable")
    nodes, first, count = np.unique(ends[order], return_index=True, return_counts=True)
    two = first[count == 2]
    one, other = order[two], order[two + 1]
    away = [mesh.points[middles[k]] - mesh.points[ends[k]] for k in (one, other)]
    lengths = np.linalg.norm(away[0], axis=1) * np.linalg.norm(away[1], axis=1)
    turned = -np.einsum("nd,nd->n", *away) < np.cos(np.radians(CREASE)) * lengths
    differs = turned | (number[one // 2] != number[other // 2])
    acts = active[one // 2] | active[other // 2]
    return np.concatenate([nodes[count != 2], ends[one][differs & acts]])
