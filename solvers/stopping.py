"""When an iterative solve is exact enough: as seen by the contact dofs, or in the energy norm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

Array = NDArray[np.float64]
SAFETY = 2.0  # of the estimated error
UNKNOWN = 0.5  # contraction of an iteration, at least, before two of them tell it
SLOWEST, FASTEST = 0.95, 0.3  # contraction that is believed
MULTIGRID = 2.0  # the error over what one multigrid cycle makes of the residual


class Goal(Protocol):
    """What a solve is asked for. Arrays are this rank's part; both questions are collective."""

    def met(self, x: Array, z: Array, energy: float) -> bool:
        """Before a step: z is the preconditioned residual, about the error, and `energy` its square in energy norm."""

    def moved(self, x: Array, change: Array) -> bool:
        """After a step from x - change to x."""


class ContactError:
    """The largest error of the contact dofs is below `error` [m], or below `relative` beside the largest of them.

    What is left after a step is that step times q / (1 - q), q the contraction seen over the last two steps; and no
    more than the energy norm of the error before it times `response`, the most that a contact dof moves beside that.
    Both must be small: the second one rests on the search directions known so far.
    """

    def __init__(
        self, comm: Any, local: NDArray[np.int64], error: float, relative: float, response: Callable[[], float]
    ) -> None:
        self.comm, self.local, self.error, self.relative, self.response = comm, local, error, relative, response
        self.steps: list[float] = []
        self._left = 0.0

    def met(self, x: Array, z: Array, energy: float) -> bool:
        self._left = float(np.sqrt(energy))
        if energy == 0.0:  # nothing is left
            return True
        return not self.steps and self._small(x, z, MULTIGRID)

    def moved(self, x: Array, change: Array) -> bool:
        return self._small(x, change, None)

    def _small(self, x: Array, change: Array, share: float | None) -> bool:
        own = [float(np.abs(v[self.local]).max(initial=0.0)) for v in (change, x)]
        step, size = (self.comm.allreduce(value, op=MPI.MAX) for value in own)
        if share is None:
            self.steps.append(float(step))
            rate = self._rate()
            share = rate / (1 - rate)
        enough = max(self.error, self.relative * size)
        # steps alone do not see an error that hardly shrinks, as that of a slender body's bending
        return bool(SAFETY * share * step <= enough) and self._left * self.response() <= enough

    def _rate(self) -> float:
        """Contraction an iteration."""
        last = self.steps[-3:]
        if len(last) < 2 or not last[0]:
            return UNKNOWN
        seen = (last[-1] / last[0]) ** (1 / (len(last) - 1))
        return float(np.clip(seen, FASTEST if len(last) == 3 else UNKNOWN, SLOWEST))


class EnergyError:
    """The error is below `relative` beside the solution, both in the energy norm; `reached` is what it came to.

    Where the solution is next to nothing, the error is measured beside that of the start: less is rounding.
    """

    def __init__(self, comm: Any, f: Array, relative: float) -> None:
        self.comm, self.f, self.relative = comm, f, relative
        self.reached, self._first = 0.0, 0.0

    def met(self, x: Array, z: Array, energy: float) -> bool:
        stored = self.comm.allreduce(float(self.f @ x))  # x . A x, but for the residual
        self._first = self._first or energy
        self.reached = float(np.sqrt(energy / max(stored, self._first))) if energy else 0.0
        return self.reached <= self.relative

    def moved(self, x: Array, change: Array) -> bool:
        return False


class ResidualNorm:
    """The residual is no larger than `allowed` of its first size, both measured by the preconditioner.

    That is about the energy norm of the error.
    """

    def __init__(self, allowed: Callable[[float], float]) -> None:
        self.allowed = allowed
        self.first: float | None = None
        self.reached = 0.0

    def met(self, x: Array, z: Array, energy: float) -> bool:
        self.reached = float(np.sqrt(energy))
        if self.first is None:
            self.first = self.reached
        return self.reached <= self.allowed(self.first)

    def moved(self, x: Array, change: Array) -> bool:
        return False
