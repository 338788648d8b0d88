"""Layer on an incline: a slab of height H under its own weight, infinite along a slope of tan(alpha).

Nothing varies along the slope, so that sigma_nn and sigma_tn balance the weight above each height y:
sigma_nn = -rho g cos(alpha) (H - y), sigma_tn = rho g sin(alpha) (H - y). The base rests, so that at the top
u_n = -rho g cos(alpha) H^2 / (2 M), u_t = rho g sin(alpha) H^2 / (2 G). It rests if tan(alpha) <= mu, and only then.

Source: equilibrium, derived here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.workflows.lab.verification.closed_forms.column import constrained_modulus


@dataclass(frozen=True, kw_only=True)
class Layer:
    """The slab and its slope."""

    E: float  # [Pa]
    nu: float
    weight: float  # rho g [N/m³]
    slope: float  # tan(alpha)
    height: float = 1.0  # [m]

    @property
    def along(self) -> float:
        """rho g sin(alpha) [N/m³]."""
        return float(self.weight * self.slope / np.hypot(1.0, self.slope))

    @property
    def across(self) -> float:
        """rho g cos(alpha) [N/m³]."""
        return float(self.weight / np.hypot(1.0, self.slope))

    @property
    def pressure(self) -> float:
        """p on the base [Pa]."""
        return self.across * self.height

    @property
    def shear(self) -> float:
        """tau on the base [Pa]."""
        return self.along * self.height

    @property
    def top(self) -> tuple[float, float]:
        """u_t down the slope, u_n out of it [m]."""
        G, half = self.E / (2 * (1 + self.nu)), self.height**2 / 2
        return self.along * half / G, -self.across * half / constrained_modulus(self.E, self.nu)


LAYER = Layer(E=10.0, nu=0.2, weight=2.0, slope=0.3)
PRESSURE, SHEAR, TOP = 1.9156526, 0.5746958, (6.8963e-2, -8.6204e-2)  # of LAYER, tabulated
HOLDS, SLIDES = 0.3003, 0.2997  # friction coefficients on either side of its slope
