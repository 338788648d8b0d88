"""Rings that spin: a free one in plane stress or strain, and a shrink fit that its speed loosens."""

from __future__ import annotations

from stickslip.workflows.lab.verification.closed_forms.shrink_fit import (
    HUB,
    INNER,
    JOINT,
    OUTER,
    SHAFT,
    Fit,
    RingMaterial,
    give,
)

DENSITIES = (2.0, 1.0)  # of the inner and the outer ring [kg/m³]


def growth(material: RingMaterial, pull: float, inner: float, outer: float, r: float, plane_strain: bool) -> float:
    """Radial displacement [m] at r of a free ring under centrifugal forces.

    Source: Timoshenko & Goodier, Theory of Elasticity, § 32, with E / (1 - nu^2) and nu / (1 - nu) for plane strain.

    Args:
        pull: density times speed squared [N/m^4].

    >>> growth(RingMaterial(E=1.0, nu=0.3), 1.0, 1.0 - 1e-9, 1.0, 1.0, plane_strain=False)  # a hoop: pull r^3 / E
    0.999999998...
    """
    E, nu = material.E, material.nu
    if plane_strain:
        E, nu = E / (1 - nu**2), nu / (1 - nu)
    both = (inner * outer / r) ** 2
    radial = (3 + nu) / 8 * pull * (inner**2 + outer**2 - both - r**2)
    hoop = (3 + nu) / 8 * pull * (inner**2 + outer**2 + both - (1 + 3 * nu) / (3 + nu) * r**2)
    return r / E * (hoop - nu * radial)


def fit(interference: float, speed: float) -> Fit:
    """State of the joint of the shrink fit's rings in plane strain, at a speed [rad/s] at which they still touch."""
    inner, outer = (rho * speed**2 for rho in DENSITIES)
    u_in, u_out = growth(SHAFT, inner, INNER, JOINT, JOINT, True), growth(HUB, outer, JOINT, OUTER, JOINT, True)
    give_in, give_out = give(SHAFT, JOINT, INNER), give(HUB, JOINT, OUTER)
    p = (interference - (u_out - u_in)) / (give_in + give_out)
    return Fit(p=p, u_in=u_in - p * give_in, u_out=u_out + p * give_out)
