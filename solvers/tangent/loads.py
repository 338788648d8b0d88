"""About how far a load moves the contact surface without contact: the scale of tractions, for a multigrid cycle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Vec
from stickslip.solvers.parallel.replicated import Replicated
from stickslip.solvers.tangent.operator import TangentOperator

LOADS = 4  # that are kept
SAME = 1e-6  # relative difference of loads that counts as none


class LoadScale:
    """The last few loads: forces (owned,), and about the displacement (c,) of the contact dofs under them alone."""

    def __init__(
        self, operator: TangentOperator, contact: Replicated, loads: Sequence[tuple[Array, Array]] = ()
    ) -> None:
        """
        Args:
            contact: reads the contact dofs of a vector.
            loads: that are known.
        """
        self.operator, self.contact, self.loads = operator, contact, list(loads)

    def __call__(self, f: Vec) -> Array:
        """About the displacement (c,) [m] of the contact dofs under forces f alone; collective.

        It costs a multigrid cycle, but for loads that are sums of earlier ones.
        """
        dot, loads = self.operator.dot, self.loads
        share, left = np.zeros(len(loads)), f.array_r
        if loads:
            G = np.array([[dot(a, b) for b, _ in loads] for a, _ in loads])
            share = np.linalg.lstsq(G, np.array([dot(a, f.array_r) for a, _ in loads]), rcond=SAME**2)[0]
            left = f.array_r - share @ np.array([a for a, _ in loads])
        if dot(left, left) <= SAME**2 * dot(f.array_r, f.array_r):
            nothing = np.zeros(len(self.contact.rows))
            return np.asarray(sum((k * u for k, (_, u) in zip(share, loads, strict=True)), nothing))
        u_c = self.contact.read(self.operator.guess(f))
        self.loads = [*loads, (f.array_r.copy(), u_c)][-LOADS:]
        return u_c
