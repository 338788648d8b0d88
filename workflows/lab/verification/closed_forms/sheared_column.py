"""Sheared column on a frictional base: stick, slip, reversal, dissipation.

A column of shear modulus G and height H with periodic lateral faces is in uniform shear: tau = G (V - w) / H, V the
displacement of its top and w that of its base [m]. The base carries |tau| <= s, and slips along tau where
|tau| = s. So the exact answer to a step of V is to clip the trial traction, and w follows from the shear.
A base of tangential stiffness k_T moves by tau / k_T before it slips: a spring in series, w = slip + tau / k_T.

Signs: tau [Pa] is t of the friction law, t dv = s |dv|: it has the sign of the slip v it makes.

Source: derived here. In one dimension the return map is exact along any monotone step, so a step may be of any size.
"""

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array


@dataclass(frozen=True, kw_only=True)
class ShearedColumn:
    """A column of shear modulus G and height H on a base of friction bound s (mu p, or Tresca's)."""

    G: float  # [Pa]
    bound: float  # s [Pa]
    height: float = 1.0  # [m]
    k_T: float = np.inf  # stiffness of the base before slip [Pa/m]

    @property
    def stiffness(self) -> float:
        """tau over V while the base sticks [Pa/m].

        >>> ShearedColumn(G=1000.0, bound=3.0, k_T=1000.0).stiffness
        500.0
        """
        return self.G / (self.height + self.G / self.k_T)


@dataclass(frozen=True, kw_only=True)
class ShearHistory:
    """The states after each step, (steps,) each."""

    tau: Array  # tangential traction on the base [Pa]
    slip: Array  # displacement of the base, elastic part included [m]
    dissipation: Array  # cumulative, per area of the base [J/m²]


def drive(column: ShearedColumn, top: Array) -> ShearHistory:
    """Drive the top through a sequence of displacements, from an undeformed start.

    Args:
        column: what is sheared.
        top: V at the end of each step (steps,) [m]; V is monotone between them.

    >>> history = drive(ShearedColumn(G=1000.0, bound=3.0), np.array([0.001, 0.01]))
    >>> history.tau
    array([1., 3.])
    """
    tau, slip, dissipation = np.zeros((3, len(top)))
    v = work = 0.0
    for k, V in enumerate(top):
        trial = column.stiffness * (V - v)
        tau[k] = np.clip(trial, -column.bound, column.bound)
        dv = (trial - tau[k]) / column.stiffness  # exactly 0 where it sticks
        v += dv
        work += tau[k] * dv
        slip[k], dissipation[k] = v + tau[k] / column.k_T, work
    return ShearHistory(tau=tau, slip=slip, dissipation=dissipation)


COLUMN = ShearedColumn(G=1000.0, bound=3.0)  # p = 10 Pa, mu = 0.3
TOP = np.array([0.001, 0.01, 0.005, -0.01, 0.01])  # [m]: stick, slip, unloading, slip back, slip again
TABLE = ShearHistory(
    tau=np.array([1.0, 3.0, -2.0, -3.0, 3.0]),
    slip=np.array([0.0, 0.007, 0.007, -0.007, 0.007]),
    dissipation=np.array([0.0, 0.021, 0.021, 0.063, 0.105]),
)
