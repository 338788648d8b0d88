"""Column lifted off its base and set down again: an open contact carries no friction and keeps no memory.

A column of constrained modulus M, shear modulus G and height H with periodic lateral faces, its top at (V, -U), its
base at w and at first a gap g above a rigid plane: p = M (U - g)+ / H, tau = G (V - w) / H, |tau| <= mu p, V, w and tau
vectors along the plane. Compression and shear do not interact. While the base hangs free it is below its
top, w = V: that is the clip to a bound of 0. On a foundation that gives way p is that of `column` instead. A step's
answer is the bound at its end, on the trial traction from w at its start; work is that at the end too, so what the base
rubs while p falls to 0 within a step is not seen.

Source: derived here. Only steps in which nothing turns from one state to another and back are exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.workflows.lab.verification.closed_forms.column import driven_by_displacement


@dataclass(frozen=True, kw_only=True)
class LiftedColumn:
    """The column, its gap and its friction."""

    M: float  # [Pa]
    G: float  # [Pa]
    mu: float
    gap: float  # at the start [m]
    height: float = 1.0  # [m]
    foundation: tuple[float, float] | None = None  # c_n [Pa/m^m], m; None: rigid

    def pressed(self, U: float) -> tuple[float, float]:
        """Pressure [Pa], and the gap that is left, negative where the foundation gives way [m]."""
        if self.foundation is None:
            return self.M / self.height * max(U - self.gap, 0.0), max(self.gap - U, 0.0)
        c_n, m = self.foundation
        state = driven_by_displacement(M=self.M, U=U, g=self.gap, c_n=c_n, m=m, height=self.height)
        return state.pressure, self.gap - state.displacement


@dataclass(frozen=True, kw_only=True)
class LiftedHistory:
    """The states after each step."""

    pressure: Array  # (steps,) [Pa]
    gap: Array  # (steps,) [m]
    tau: Array  # (steps, d - 1) in the sense of the slip [Pa]
    slip: Array  # (steps, d - 1) displacement of the base along the plane [m]
    dissipation: Array  # (steps,) so far, per area of the base [J/m²]


def follow(column: LiftedColumn, down: Array, along: Array) -> LiftedHistory:
    """Move the top, from an undeformed start.

    Args:
        down: U at the end of each step (steps,) [m].
        along: V (steps, d - 1) [m].

    >>> column = LiftedColumn(M=1000.0, G=100.0, mu=0.5, gap=0.0)
    >>> history = follow(column, np.array([0.01, 0.01, -0.01]), np.array([[0.0], [0.1], [0.1]]))
    >>> history.pressure, history.tau[:, 0], history.slip[:, 0], history.gap
    (array([10., 10.,  0.]), array([0., 5., 0.]), array([0.  , 0.05, 0.1 ]), array([0.  , 0.  , 0.01]))
    """
    shear = column.G / column.height
    pressure, gap = np.array([column.pressed(float(U)) for U in down]).T
    w, work = np.zeros(along.shape[1]), 0.0
    tau, slip, dissipation = np.zeros_like(along), np.zeros_like(along), np.zeros(len(down))
    for k, V in enumerate(along):
        trial = shear * (V - w)
        size, bound = float(np.linalg.norm(trial)), column.mu * pressure[k]
        tau[k] = trial if size <= bound else trial * (bound / size)
        step = (trial - tau[k]) / shear
        w = w + step
        work += float(tau[k] @ step)
        slip[k], dissipation[k] = w, work
    return LiftedHistory(pressure=pressure, gap=gap, tau=tau, slip=slip, dissipation=dissipation)
