"""Friction between the nodes of a contact, where the direction of slip varies along the side.

Methods hold the law at nodes: each has one direction for all of its area. Here slip is interpolated, and friction acts
against it at each integration point; the difference to the nodes' directions is of second order in the mesh size. A
block on a turning table has all of its error of the moment from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.coupling import Points
from stickslip.solvers.contact.rows import ContactRows

AT_BOUND = 1e-6  # relative: a multiplier that near to the bound slips
ROUNDING = 1e-9  # of the bounds: less is no other direction
VORTEX = 0.5  # length of the mean direction of slip on a facet: less surrounds a centre
CENTRE = 1e-6  # of the slip around: less has no direction
MOVING = 1e-9  # of the largest slip in the substep: less is none


@dataclass(frozen=True)
class BetweenNodes:
    """What friction between the nodes of one contact adds to that at its n nodes."""

    relative: Sparse  # (n, n_all)
    normals: Array  # (n, d) unit: friction acts in the tangent plane of each node
    phi: Sparse  # (n, q): values at integration points to integrals ∫ phi~_j
    weights: Array  # (q,) [m^(d-1)]
    around: Ints | None  # (q, k) nodes of each point's facet, at order 2
    driven: Sequence[int]  # axes along which a force drives the obstacle

    @classmethod
    def of(cls, c: ContactRows, points: Points, driven: Sequence[int] = ()) -> BetweenNodes | None:
        """None: no friction, or one whose direction is not that of slip."""
        if c.friction is None or c.friction.orthotropic or not c.friction.resists():
            return None
        around = c.surface.facets[points.own.facet] if c.surface.degree == 2 else None
        return cls(c.relative, c.frames[:, 0], points.phi, points.weights, around, driven)

    def added(self, multiplier: Array, bound: Array, increment: Array) -> tuple[Array, float] | None:
        """Nodal forces (n_all, d) [N] like B^T p, whose negatives act on the bodies, and dissipation [J].

        None where all slip around has the same direction, and where it would push an obstacle that a force drives: that
        is in balance.

        Args:
            multiplier: tangential (n, d) [Pa].
            bound: of friction (n,) [Pa].
            increment: slip in the substep (n, d) [m].
        """
        bound, size = np.where(np.isfinite(bound), bound, 0.0), np.linalg.norm(increment, axis=1)
        slips = (np.linalg.norm(multiplier, axis=1) >= (1 - AT_BOUND) * bound) & (bound > 0)
        slips &= size > MOVING * size.max(initial=0.0)
        direction = np.divide(increment, size[:, None], out=np.zeros_like(increment), where=slips[:, None])
        each = np.divide(1.0, self.weights, out=np.zeros_like(self.weights), where=self.weights > 0)
        values = each[:, None] * (self.phi.T @ np.column_stack([bound, size, increment]))
        bound_at, mean_size, moved = values[:, 0], values[:, 1], values[:, 2:]
        if self.around is not None:  # beside nodes that stick parabolas turn back, but for the centre of a vortex
            count = slips[self.around].sum(axis=1)
            vortex = np.linalg.norm(direction[self.around].sum(axis=1), axis=1) < VORTEX * count
            bound_at = bound_at * ((count == self.around.shape[1]) | vortex)
        node, point = self.phi.nonzero()
        along = moved[point] - np.einsum("kd,kd->k", moved[point], self.normals[node])[:, None] * self.normals[node]
        length = np.linalg.norm(along, axis=1, keepdims=True)
        turns = length > CENTRE * mean_size[point, None]  # else the point is the centre of a vortex
        along = np.divide(along, length, out=np.zeros_like(along), where=turns) - direction[node]
        share = (np.asarray(self.phi[node, point]).ravel() * bound_at[point] * slips[node])[:, None]
        forces = np.zeros_like(increment)
        np.add.at(forces, node, share * along)
        size_at = np.linalg.norm(moved, axis=1)
        nothing = np.linalg.norm(forces) <= ROUNDING * np.linalg.norm(self.phi @ bound_at)
        pushed = np.abs(forces.sum(axis=0)[list(self.driven)]).max(initial=0.0)
        if nothing or pushed > ROUNDING * np.abs(forces).sum():
            return None
        return np.asarray(self.relative.T @ forces), float((self.weights * bound_at) @ (size_at - mean_size))
