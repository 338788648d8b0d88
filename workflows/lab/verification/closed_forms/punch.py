"""Rigid flat punch on an elastic half-plane: frictionless, bonded, and with Coulomb friction.

The punch |x| <= a presses with P per metre of thickness on y <= 0 in plane strain, without rotation. A half-plane's
surface moves, downwards (w) and along x, by

    w'(x)   = -k / pi PV∫ p(s) / (x - s) ds + beta k q(x)
    u_x'(x) = -k / pi PV∫ q(s) / (x - s) ds - beta k p(x),    k = 2 (1 - nu²) / E, beta = (1 - 2 nu) / (2 (1 - nu)),

with p the pressure and q the shear traction on the half-plane, along x. Without friction q = 0 and w' = 0: p is
P / (pi sqrt(a² - x²)). Bonded, u_x' = 0 too. With x = a tanh(t), p = C cosh(t) cos(2 eps t), q = C cosh(t) sin(2 eps t)
solve both: PV∫ cos(o s) / sinh(t - s) ds = pi tanh(pi o / 2) sin(o t), and the same with sin and -cos, so that
tanh(pi eps) = beta, or eps = ln(3 - 4 nu) / (2 pi). Tractions change sign infinitely often at the edge, from about
1e-7 a on.

With friction the stick width does not depend on the load, because the contact width is fixed.

Source: Muskhelishvili (1953), derived here as above. For friction: Spence, Proc. Camb. Phil. Soc. 73 (1973); STICK was
computed for this project by an independent half-plane program, and is data.
"""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import Array

NU = 0.3
X = np.array([0.0, 0.5, 0.9])  # samples, over a
STICK = {0.1: 0.038, 0.2: 0.362, 0.3: 0.690, 0.5: 0.941}  # half-width of the sticking part over a, by mu; nu = 0.3
STICK_DIGITS = 0.004  # accuracy of STICK


def frictionless(x: Array, a: float = 1.0, P: float = 1.0) -> Array:
    """Pressure [Pa] at x [m], |x| < a.

    >>> frictionless(X).round(5)
    array([0.31831, 0.36755, 0.73025])
    """
    return np.asarray(P / (np.pi * np.sqrt(a**2 - x**2)))


def oscillation(nu: float) -> float:
    """eps, the exponent's imaginary part [-]: 0 for an incompressible half-plane, which moves as if frictionless."""
    return float(np.log(3 - 4 * nu) / (2 * np.pi))


def bonded(x: Array, nu: float, a: float = 1.0, P: float = 1.0) -> tuple[Array, Array]:
    """Pressure and shear traction on the half-plane [Pa], outward where x > 0.

    >>> p, q = bonded(X, NU)
    >>> p.round(5), q.round(5)
    (array([0.33216, 0.38152, 0.73329]), array([0.     , 0.03935, 0.20725]))
    """
    eps = oscillation(nu)
    size = np.cosh(np.pi * eps) * frictionless(x, a, P)
    angle = eps * np.log((a + x) / (a - x))
    return np.asarray(size * np.cos(angle)), np.asarray(size * np.sin(angle))
