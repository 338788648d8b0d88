"""Block of Raous, Chabrand and Lebon: separation, slip and stick at mu = 1 on one face.

[0, 0.04]² m in plane strain: y = 0 on a rigid plane, u_x = 0 on x = 0.04, u_y = 0 at the corner (0.04, 0); a pressure
down on top and a larger one in +x on x = 0, growing in proportion. Forces and works are per metre of thickness.

Source: U_X_PUBLISHED is Raous, Chabrand & Lebon (1988), J. Méc. Théor. Appl. 7, "Numerical methods for frictional
contact problems and applications". All else was computed for this project by independent programs, and is data;
only the balance F_N = pressure times side and the dependence of the dissipation on n are exact.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

SIDE = 0.04  # [m]
E = 1.3e11  # [Pa]
NU = 0.2
MU = 1.0
TOP_PRESSURE = 5e7  # downward [Pa]
SIDE_PRESSURE = 15e7  # in +x [Pa]

X = np.array([0.0, 1.25e-3, 5e-3, 7.5e-3, 11.25e-3])  # samples on y = 0 [m]
U_X_PUBLISHED = np.array([2.86e-5, 2.72e-5, 2.28e-5, 1.98e-5, 1.50e-5])  # [m]
U_X_CONVERGED = np.array([2.860e-5, 2.723e-5, 2.287e-5, 1.981e-5, 1.541e-5])  # [m]
U_X_P1_32 = np.array([2.853e-5, 2.715e-5, 2.281e-5, 1.977e-5, 1.539e-5])  # linear triangles, 32 x 32 x 2 [m]

OPEN_UNTIL = 3.4e-3  # [m]
SLIP_UNTIL = 29.8e-3  # [m]
F_N = 2.000e6  # contact and corner support together, upward [N/m]
F_T = 1.4054e6  # friction, against +x [N/m]
CORNER_SHARE_P1_32 = 0.025  # of F_N, carried by the corner support on the 32 x 32 mesh
DISSIPATION_LIMIT = 4.401  # of infinitely many steps [J/m]


@dataclass(frozen=True, kw_only=True)
class ComplianceShift:
    """Relative change of u_x at x = 0 with c_n = k_T = k E / SIDE, against the limit on the same mesh."""

    k: float
    shift: float
    tolerance: float  # quadrature and stick rule: 15 % of the shift; beyond k = 1000 only |shift| < 0.1 %


COMPLIANCE_SHIFTS = (
    ComplianceShift(k=10, shift=-0.042, tolerance=0.15 * 0.042),
    ComplianceShift(k=100, shift=-0.0046, tolerance=0.15 * 0.0046),
    ComplianceShift(k=1000, shift=-0.0004, tolerance=0.15 * 0.0004),
    ComplianceShift(k=1e4, shift=-0.0001, tolerance=0.0009),
)


def dissipation(n: int) -> float:
    """Frictional work of an implicit proportional ramp in n equal steps [J/m].

    At load k / n the tractions are k / n and the slip of the step is 1 / n of the final ones, so the works of the steps
    are as k / n^2, and their sum as (n + 1) / (2 n): one step makes twice the limit. The displacements do not depend
    on n.

    >>> dissipation(1)
    8.802
    """
    if n < 1:
        raise ValueError(f"n = {n}: a ramp has at least one step")
    return DISSIPATION_LIMIT * (n + 1) / n


def state(x: float) -> Literal["open", "slip", "stick"]:
    """State (open, slip, stick) of the contact face at abscissa x [m]; the two limits are given to 0.1 mm.

    >>> state(0.0), state(0.01), state(0.035)
    ('open', 'slip', 'stick')
    """
    if not 0 <= x <= SIDE:
        raise ValueError(f"x = {x} m: the block reaches from 0 to {SIDE} m")
    if x < OPEN_UNTIL:
        return "open"
    return "slip" if x < SLIP_UNTIL else "stick"
