"""Friction between the nodes of a contact, where the direction of slip varies along the side.

Methods hold the law at nodes: each has one direction for all of its area. Here slip is interpolated, and friction acts
against it at each integration point; the difference to the nodes' directions is of second order in the mesh size. A
block on a turning table has all of its error of the moment from it. Slip is measured along the law's directions: with
those of an orthotropic one it is Coulomb's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import CLOSE, ROUNDING, Array, Bools, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.coupling import Points
from stickslip.solvers.contact.rows import ContactRows

VORTEX = 0.5  # length of the mean direction of slip on a facet: less surrounds a centre


@dataclass(frozen=True)
class BetweenNodes:
    """What friction between the nodes of one contact adds to that at its n nodes."""

    relative: Sparse  # (n, n_all)
    measures: Array  # (n, d, d): friction acts along their product with slip, at the bound
    phi: Sparse  # (n, q): values at integration points to integrals ∫ phi~_j
    weights: Array  # (q,) [m^(d-1)]
    around: Ints | None  # (q, k) nodes of each point's facet, at order 2
    driven: Sequence[int]  # axes along which a force drives the obstacle

    @classmethod
    def of(cls, c: ContactRows, points: Points, driven: Sequence[int] = ()) -> BetweenNodes | None:
        """None: no friction."""
        if c.friction is None or not c.friction.resists():
            return None
        around = c.surface.facets[points.own.facet] if c.surface.degree == 2 else None
        return cls(c.relative, _measures(c), points.phi, points.weights, around, driven)

    def added(self, slips: Bools, bound: Array, increment: Array) -> tuple[Array, float] | None:
        """Nodal forces (n_all, d) [N] like B^T p, whose negatives act on the bodies, and dissipation [J].

        None where all slip around has the same direction, and where it would push an obstacle that a force drives: that
        is in balance.

        Args:
            slips: (n,) whether the multiplier is at the bound.
            bound: of friction (n,) [Pa], as the directions of the law measure it.
            increment: slip in the substep (n, d) [m].
        """
        bound = np.where(np.isfinite(bound), bound, 0.0)
        pulls, size = _measured(self.measures, increment)
        # of the largest slip in the substep: less is none
        slips = slips & (bound > 0) & (size > ROUNDING * size.max(initial=0.0))
        direction = np.divide(pulls, size[:, None], out=np.zeros_like(pulls), where=slips[:, None])
        each = np.divide(1.0, self.weights, out=np.zeros_like(self.weights), where=self.weights > 0)
        values = each[:, None] * (self.phi.T @ np.column_stack([bound, size, increment]))
        bound_at, mean_size, moved = values[:, 0], values[:, 1], values[:, 2:]
        if self.around is not None:  # beside nodes that stick parabolas turn back, but for the centre of a vortex
            count = slips[self.around].sum(axis=1)
            mean = direction[self.around].sum(axis=1)
            vortex = np.linalg.norm(mean, axis=1) < VORTEX * np.linalg.norm(direction[self.around], axis=2).sum(axis=1)
            bound_at = bound_at * ((count == self.around.shape[1]) | vortex)
        node, point = self.phi.nonzero()
        along, length = _measured(self.measures[node], moved[point])
        turns = (length > CLOSE * np.abs(mean_size[point]))[:, None]  # else the point is the centre of a vortex
        along = np.divide(along, length[:, None], out=np.zeros_like(along), where=turns) - direction[node]
        part = np.asarray(self.phi[node, point]).ravel()
        forces = np.zeros_like(increment)
        np.add.at(forces, node, (part * bound_at[point] * slips[node])[:, None] * along)
        size_at = each * np.bincount(point, part * length, minlength=len(each))
        # of the bounds: less is no other direction
        nothing = np.linalg.norm(forces) <= ROUNDING * np.linalg.norm(self.phi @ bound_at)
        pushed = np.abs(forces.sum(axis=0)[list(self.driven)]).max(initial=0.0)
        if nothing or pushed > ROUNDING * np.abs(forces).sum():
            return None
        return np.asarray(self.relative.T @ forces), float((self.weights * bound_at) @ (size_at - mean_size))


def _measures(c: ContactRows) -> Array:
    """The projection onto each node's tangent plane; of orthotropic laws the products of `tangents`, added."""
    assert c.friction is not None
    if not c.friction.orthotropic:
        return np.asarray(np.eye(c.surface.dim) - np.einsum("nd,ne->nde", c.frames[:, 0], c.frames[:, 0]))
    squares = np.einsum("mcd,mce->mde", c.tangents, c.tangents)
    return np.asarray((c.share_t.T @ squares.reshape(len(squares), -1)).reshape(-1, c.surface.dim, c.surface.dim))


def _measured(measures: Array, slip: Array) -> tuple[Array, Array]:
    """Slips (k, d) times their measures, and their lengths (k,) by these."""
    pulls = np.einsum("kde,ke->kd", measures, slip)
    return pulls, np.sqrt(np.maximum(np.einsum("kd,kd->k", slip, pulls), 0.0))
