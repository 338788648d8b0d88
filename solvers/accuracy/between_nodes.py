"""Friction between the nodes of a contact, where the direction of slip varies along the side.

Methods hold the law at nodes: each has one direction for all of its area. Here slip is interpolated, and friction acts
against it at each integration point; the difference to the nodes' directions is of second order in the mesh size. A
block on a turning table has all of its error of the moment from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.coupling import Points
from stickslip.solvers.contact.rows import ContactRows

AT_BOUND = 1e-6  # relative: a multiplier that near to the bound slips
ROUNDING = 1e-9  # of the bounds: less is no other direction
CENTRE = 1e-6  # of the slip around: less has no direction
MOVING = 1e-9  # of the largest slip in the substep: less is none


@dataclass(frozen=True)
class BetweenNodes:
    """What friction between the nodes of one contact adds to that at its n nodes."""

    relative: Sparse  # (n, n_all)
    phi: Sparse  # (n, q): values at integration points to integrals ∫ phi~_j
    weights: Array  # (q,) [m^(d-1)]

    @classmethod
    def of(cls, c: ContactRows, points: Points) -> BetweenNodes | None:
        """None: no friction, or one whose direction is not that of slip."""
        if c.friction is None or c.friction.orthotropic or not c.friction.resists():
            return None
        return cls(c.relative, points.phi, points.weights)

    def added(self, multiplier: Array, bound: Array, increment: Array) -> tuple[Array, float] | None:
        """Nodal forces (n_all, d) [N] like B^T p, whose negatives act on the bodies, and dissipation [J].

        None where all slip around has the same direction.

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
        size_at = np.linalg.norm(moved, axis=1)
        turns = size_at > CENTRE * mean_size  # else the point is the centre of a vortex
        along = np.divide(moved, size_at[:, None], out=np.zeros_like(moved), where=turns[:, None])
        forces = self.phi @ (bound_at[:, None] * along) - (self.phi @ bound_at)[:, None] * direction
        forces[~slips] = 0.0
        if np.linalg.norm(forces) <= ROUNDING * np.linalg.norm(self.phi @ bound_at):
            return None
        return np.asarray(self.relative.T @ forces), float((self.weights * bound_at) @ (size_at - mean_size))
