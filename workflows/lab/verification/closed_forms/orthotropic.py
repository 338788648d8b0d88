"""Orthotropic bodies: compliance off the axes, a tube that touches a rigid bore, a cylinder on a half-plane.

Sources: Bond, Proc. Phys. Soc. 56 (1943), of the compliance; Lekhnitskii, Theory of Elasticity of an Anisotropic Body
(1981), sections 19 and 35, of plane problems and of tubes; Willis, J. Mech. Phys. Solids 14 (1966), and Ting,
Anisotropic Elasticity (1996), sections 7.3 and 10.5, of half-planes and of indenters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.workflows.lab.verification.closed_forms.hertz import Hertz, cylinder

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # components of stress as a vector of six


@dataclass(frozen=True, kw_only=True)
class Constants:
    """Engineering constants along the axes 1, 2, 3."""

    E: tuple[float, float, float]  # [Pa]
    G: tuple[float, float, float]  # between axes 2 and 3, 1 and 3, 1 and 2 [Pa]
    nu: tuple[float, float, float]  # nu_23, nu_13, nu_12 [-]

    @property
    def compliance(self) -> Array:
        """Strains eps_11, 22, 33, 2 eps_23, 13, 12 by stresses (6, 6) [1/Pa]."""
        E, (nu_23, nu_13, nu_12) = self.E, self.nu
        S = np.diag([*(1 / np.array(E)), *(1 / np.array(self.G))])
        S[0, 1] = S[1, 0] = -nu_12 / E[0]
        S[0, 2] = S[2, 0] = -nu_13 / E[0]
        S[1, 2] = S[2, 1] = -nu_23 / E[1]
        return S


def turned(S: Array, axes: Array) -> Array:
    """Compliance (6, 6) [1/Pa] in the scene's axes: S' = M^T S M, M the stresses along the axes by those of the scene.

    Args:
        S: along the axes (6, 6) [1/Pa].
        axes: their unit vectors as rows (3, 3).

    >>> oak = Constants(E=(4.0, 1.0, 1.0), G=(1.0, 1.0, 0.5), nu=(0.0, 0.0, 0.0)).compliance
    >>> half = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2)]]) / np.sqrt(2)
    >>> float(turned(oak, half)[0, 0].round(12))  # (1 / E_1 + 1 / E_2 + 1 / G_12) / 4
    0.8125
    """
    Q, M = axes, np.empty((6, 6))
    for row, (i, j) in enumerate(PAIRS):
        for column, (a, b) in enumerate(PAIRS):
            M[row, column] = Q[i, a] * Q[j, a] if a == b else Q[i, a] * Q[j, b] + Q[i, b] * Q[j, a]
    return np.asarray(M.T @ S @ M)


def plane(S: Array, plane_stress: bool) -> Array:
    """Strains eps_xx, eps_yy, 2 eps_xy by stresses in the plane (3, 3) [1/Pa]; else eps_zz = 0."""
    kept = np.ix_([0, 1, 5], [0, 1, 5])
    return np.asarray(S[kept] - (0 if plane_stress else np.outer(S[:, 2], S[2])[kept] / S[2, 2]))


def surface_compliance(beta: Array) -> float:
    """Of the surface y = 0 of a half-plane [1/Pa]: a line load P presses it by -P / pi times this times ln|x|.

    It is beta_11 (a d - b c), where a + i b is the sum and c + i d the product of the roots mu_1, mu_2 of positive
    imaginary part of beta_11 mu^4 - 2 beta_16 mu^3 + (2 beta_12 + beta_66) mu^2 - 2 beta_26 mu + beta_22 = 0.
    Isotropic, in plane strain, it is 2 (1 - nu^2) / E, which has a double root.

    Args:
        beta: see `plane`.

    >>> beta = plane(Constants(E=(1.0, 1.0, 1.0), G=(0.5, 0.5, 0.5001), nu=(0.0, 0.0, 0.0)).compliance, True)
    >>> round(surface_compliance(beta), 3)
    2.0
    """
    (b_11, b_12, b_16), (_, b_22, b_26), (_, _, b_66) = beta
    roots = np.roots([b_11, -2 * b_16, 2 * b_12 + b_66, -2 * b_26, b_22])
    one, two = roots[roots.imag > 0]
    total, product = one + two, one * two
    return float(b_11 * (total.real * product.imag - total.imag * product.real))


def roller(beta: Array, load: float, radius: float) -> Hertz:
    """Half width and peak pressure of a rigid roller that presses a half-plane, both without friction.

    The normal displacement of the surface knows no more of the half-plane than `surface_compliance`; so Hertz' ellipse
    holds with E* = 2 / surface_compliance.

    Args:
        beta: see `plane`.
        load: per length [N/m].
        radius: [m].
    """
    return cylinder(load, radius, 2 / surface_compliance(beta))


@dataclass(frozen=True, kw_only=True)
class Tube:
    """A long tube that cannot grow longer, pressed from inside until it touches a rigid bore; axis 1 r, 2 y, 3 hoop.

    u = A r^k + B r^-k with k = sqrt(c_33 / c_11), sigma_r = c_11 u' + c_13 u / r.
    """

    constants: Constants
    inner: float  # radius [m]
    outer: float  # [m]
    pressure: float  # inside [Pa]
    gap: float  # around it [m]

    def touching(self) -> tuple[float, float]:
        """Displacement of the inner surface [m], and pressure on the bore [Pa], where it touches.

        >>> steel = Constants(E=(1.0, 1.0, 1.0), G=(0.5, 0.5, 0.5), nu=(0.0, 0.0, 0.0))
        >>> thin = Tube(constants=steel, inner=1.0, outer=1.001, pressure=0.01, gap=0.0)
        >>> [round(value, 4) + 0.0 for value in thin.touching()]  # pressure goes through it
        [0.0, 0.01]
        """
        c = np.linalg.inv(self.constants.compliance[:3, :3])
        k = np.sqrt(c[2, 2] / c[0, 0])

        def displacement(r: float) -> Array:
            return np.array([r**k, r**-k])

        def radial(r: float) -> Array:
            return np.array([(c[0, 0] * k + c[0, 2]) * r ** (k - 1), (c[0, 2] - c[0, 0] * k) * r ** (-k - 1)])

        rows = np.array([radial(self.inner), displacement(self.outer)])
        found = np.linalg.solve(rows, [-self.pressure, self.gap])
        return float(displacement(self.inner) @ found), -float(radial(self.outer) @ found)
