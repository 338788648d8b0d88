"""An equilibrium: everything the next step needs of the past."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.arrays import Array
from solvers.contact.rows import ContactRows


@dataclass(frozen=True)
class Energy:
    """Totals since t = 0 [J], per metre of thickness in plane models."""

    external: float  # loads, supports and obstacle motion
    stored: float  # elastic energy of the bodies
    contact: float  # work of the contact tractions on the relative displacement
    compliance: float  # energy stored in the contacts' laws: normal compliance, and k_T
    dissipation: Array  # (contacts,) by friction, end-of-step rule

    @property
    def dissipated(self) -> float:
        return float(self.dissipation.sum())

    @property
    def time_remainder(self) -> float:
        """Contact work that neither compliance nor dissipation explains.

        First order in the step, but for the work of closing an initial interference, which no step size removes.
        """
        return self.contact - self.compliance - self.dissipated


HALVINGS = 8  # a step is cut to 1/256 before it is given up
ROUNDING = 1e-9
ENOUGH = 3  # easy substeps in a row: where each second one is hard, twice the size would fail again at once


@dataclass(frozen=True)
class Pace:
    """What the steps so far have taught; it goes on from one requested time to the next.

    >>> Pace().part(2.0, smallest=0.1), Pace(size=0.5).part(2.0, smallest=0.1)
    (2.0, 0.5)
    """

    size: float = np.inf  # largest substep that is worth a try [s]
    easy: int = 0  # substeps of that size that were easy, in a row

    def part(self, left: float, smallest: float) -> float:
        """Length of the next substep [s], of those that are left; no sliver remains at the end."""
        size = max(self.size, smallest)
        if left <= size * (1 + ROUNDING):
            return left
        return size if left > 2 * size * (1 - ROUNDING) else left / 2

    def failed(self, tried: float, smallest: float) -> Pace:
        """After a substep [s] that failed."""
        return Pace(max(tried / 2, smallest))

    def succeeded(self, tried: float, step: float, easy: bool) -> Pace:
        """After a substep [s] that was accepted, on the way through a step [s]."""
        if np.isinf(self.size) or (easy and tried <= self.size / 2):  # one so short proves nothing
            return self
        if not easy:
            return Pace(self.size)
        if self.easy + 1 < ENOUGH:
            return Pace(self.size, self.easy + 1)
        return Pace(2 * self.size) if 2 * self.size < step * (1 - ROUNDING) else Pace()


@dataclass(frozen=True)
class Before:
    """The state before a state, as far as the start of the next step is extrapolated from it."""

    time: float
    p: Array  # (rows,) in the same rows as the state's own [Pa]


@dataclass(frozen=True, kw_only=True)
class State:
    """An equilibrium: everything the next step needs of the past. Vectors run over all displacements."""

    time: float
    u: Any  # [m]
    u_s: Any  # prescribed part [m]
    load: Any  # [N]
    initial: Array  # (k,) values of the initial strains
    initial_work: Array  # (k,) see `InitialStrains.stress_work` [J]
    residual: Any  # K u - load - that of initial strains + B^T p [N]: what supports and periodic sides carry
    p: Array  # (rows,) [Pa]
    w: Array  # (rows,) relative displacement [m]
    motion: Mapping[str, Array]  # (n, d) of each contact's obstacle; none at the start, even if it jumps at t = 0 [m]
    driven: Array  # (o,) motion of the obstacles that forces drive, by `Obstacles.driven` [m]
    slip: Mapping[str, Array]  # (n, d) total at the slave's nodes of each contact [m]
    forces: Mapping[str, Array]  # (n_all, d) B^T p of each contact, in the rows that the step was solved in [N]
    rows: tuple[ContactRows, ...]  # that p and w are told in
    energy: Energy
    before: Before | None = None  # none: the start, or nothing to be learnt from it
    pace: Pace = Pace()
    law_error: float = 0.0  # added up since t = 0, see `Solution` [J^(1/2)]
    peak: float = 0.0  # largest stored energy since t = 0: what errors are relative to, also where all is let go [J]
