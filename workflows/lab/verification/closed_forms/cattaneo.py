"""Two like cylinders pressed together, then sheared: partial slip from the edges inwards.

Both half-planes are of one material, so that pressure and shear do not interact; the contact is small against
the radii.

Source: Johnson, Contact Mechanics (1985), section 7.2; Cattaneo (1938), Mindlin (1949).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.workflows.lab.verification.closed_forms import hertz
from stickslip.workflows.lab.verification.closed_forms.hertz import Hertz


@dataclass(frozen=True, kw_only=True)
class Cattaneo:
    """Hertz' contact under a shear force Q < mu P per length; the middle, |x| < c, sticks."""

    pressed: Hertz
    mu: float
    c: float  # [m]

    def shear(self, x: Array) -> Array:
        """Tangential traction [Pa] at a distance x [m] from the middle: that of slip, less an ellipse where it sticks.

        >>> middle = cattaneo(1.0, 0.15, 1.0, 1.0, mu=0.2)
        >>> round(float(middle.shear(np.zeros(1))[0] / (middle.mu * middle.pressed.p0)), 12)
        0.5
        """
        inner = Hertz(a=self.c, p0=self.pressed.p0 * self.c / self.pressed.a)
        return self.mu * (self.pressed.pressure(x) - inner.pressure(x))


def cattaneo(P: float, Q: float, R: float, E_star: float, mu: float) -> Cattaneo:
    """Pressed with P and then sheared with Q per length [N/m]; 1 / R and 1 / E* are sums over both cylinders.

    >>> one = hertz.plane_strain(200.0, 0.3)
    >>> found = cattaneo(10.0, 0.93622, 4.0, one / 2, mu=0.2)
    >>> round(found.pressed.a, 6), round(found.pressed.p0, 5), round(found.c, 6)
    (0.680778, 9.35135, 0.496497)
    """
    pressed = hertz.cylinder(P, R, E_star)
    return Cattaneo(pressed=pressed, mu=mu, c=float(pressed.a * np.sqrt(1 - Q / (mu * P))))
