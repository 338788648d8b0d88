"""Coarse motions: the sides of each contact slide on each other as rigid, and the bodies behind them follow.

Where hardly a point sticks, multigrid of bodies whose contact nodes are held does not see these motions. For a body
that floats they are its rigid motions.
"""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array, Ints
from stickslip.solvers.system.floating_modes import near_nullspace
from stickslip.solvers.system.system import System
from stickslip.solvers.tangent.operator import TangentOperator

CYCLES = 3  # of conjugate gradients for each motion


class CoarseMotions:
    """The k motions D (k, owned), orthonormal at the slave nodes, and K D."""

    def __init__(self, system: System, operator: TangentOperator, pressing: Ints) -> None:
        """Extend the motions of the sides into the bodies; collective.

        Args:
            pressing: numbers of the coordinates that rigid pressures hold.
        """
        self.operator = operator
        self.slides = ~np.isin(operator.at + operator.K_B.getOwnershipRange()[0], pressing)
        found = [self._extended(side) for side in self._sides(system)]
        self.D = np.array([d for d, _ in found])
        self.K_D = np.array([K_d for _, K_d in found])

    def _sides(self, system: System) -> list[Array]:
        """Relative rigid motions (m d,) at this rank's slave nodes, as far as they slide."""
        operator, motions = self.operator, near_nullspace(system)
        low, high = operator.K_B.getOwnershipRange()
        found = []
        for c in system.contacts:
            numbers = np.unique(system.constraints.numbers(c.surface.nodes).ravel())
            own = numbers[(numbers >= low) & (numbers < high)] - low
            of_side = np.zeros_like(motions)
            of_side[own] = motions[own]
            jumps = np.array([operator.jump(column) * self.slides for column in of_side.T])
            sizes, mixed = np.linalg.eigh(operator.comm.allreduce(jumps @ jumps.T))
            keep = sizes > CLOSE * sizes.max(initial=0.0)  # relative; motions that differ by less are one
            found += list((mixed[:, keep] / np.sqrt(sizes[keep])).T @ jumps)
        return found

    def _extended(self, side: Array) -> tuple[Array, Array]:
        """The motion of a side with that of the bodies behind it, and K times it: a few conjugate gradients."""
        operator = self.operator
        x, K_x, d, K_d = np.zeros((4, operator.count))
        operator.slaves.move(side, x, K_x)
        before = 0.0
        for _ in range(CYCLES):
            z = operator.cycle(-K_x)
            energy = -operator.dot(K_x, z)
            if not energy > 0:
                break
            d = z + (energy / before if before else 0.0) * d
            K_d, before = operator.product(d), energy
            step = energy / operator.dot(d, K_d)
            x, K_x = x + step * d, K_x + step * K_d
        return x, K_x
