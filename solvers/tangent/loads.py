"""About how far a load moves the contact surface without contact: the scale of tractions, for a multigrid cycle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array
from stickslip.geometry.protocols import Vec
from stickslip.solvers.parallel.replicated import Replicated
from stickslip.solvers.tangent.operator import TangentOperator

LOADS = 4  # that are kept


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
        dot, share, left = self.operator.dot, np.zeros(len(self.loads)), f.array_r
        if self.loads:
            F = np.array([known for known, _ in self.loads])
            products = self.operator.comm.allreduce(F @ np.vstack([F, f.array_r]).T)
            # relative difference of loads that counts as none
            share = np.linalg.lstsq(products[:, :-1], products[:, -1], rcond=CLOSE**2)[0]
            left = f.array_r - share @ F
        if dot(left, left) <= CLOSE**2 * dot(f.array_r, f.array_r):
            nothing = np.zeros(len(self.contact.rows))
            return np.asarray(sum((k * u for k, (_, u) in zip(share, self.loads, strict=True)), nothing))
        u_c = self.contact.read(self.operator.guess(f))
        self.loads = [*self.loads, (f.array_r.copy(), u_c)][-LOADS:]
        return u_c
