"""The surface problem of one load step: relative displacement caused by tractions. All that a method sees."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from geometry.arrays import Array
from solvers.contact.admissible_set import AdmissibleSet
from solvers.interface.flexibility import DelassusOperator, Load

ROUNDING = 1e-12  # normal motion that is none, beside the largest one


@dataclass(frozen=True, kw_only=True)
class SurfaceProblem:
    """Find p in the cone with w(p) - gap in its normal cone, and R^T (f - B^T p) = 0 for the rigid modes R.

    Flat arrays (rows,): normal rows of all contacts, then tangential rows in the local frames.
    """

    surface: DelassusOperator
    cone: AdmissibleSet
    load: Load
    offset: Array  # (rows,) prescribed part of the relative displacement [m]
    gap: Array  # (rows,) [m] initial gap; tangential: where slip is counted from, w - t/k_T of the last accepted step
    gamma: Array  # (rows,) E / depth of the body [Pa/m], the scale of Newton's trial tractions
    force: float  # applied force, sum of magnitudes [N]
    stiffness: float  # E / L [Pa/m], L the extent of the bodies
    u_ref: float = field(init=False)  # [m]
    p_ref: float = field(init=False)  # [Pa]

    def __post_init__(self) -> None:
        n = self.surface.normal_rows
        area = sum(float(c.node_weights.sum()) for c in self.cone.contacts)
        pressure = self.force / area if area else 0.0
        # without contact; a floating body is then held by the augmentation, which is stiffer than contact
        w = self.relative_displacement(self.load.free)
        # a long slide is no reason for a large pressure: tangential motion counts only where nothing is closed
        closing, motion = max(self._closing(w[:n]), self._closing((w - self.gap)[:n])), np.abs(w).max(initial=0.0)
        if closing <= ROUNDING * motion:
            closing = 0.0
        u_ref = closing or float(np.abs(w - self.gap)[n:].max(initial=0.0)) or float(motion)
        if self.surface.floating or not u_ref:
            u_ref = max(u_ref, pressure / self.stiffness)
        object.__setattr__(self, "u_ref", u_ref)
        object.__setattr__(self, "p_ref", max(pressure, self.stiffness * u_ref))

    def _closing(self, u_n: Array) -> float:
        """Largest normal motion (normal rows,) that contact resists [m]: in both directions where it also pulls."""
        pulls = np.concatenate(
            [np.zeros(0, bool), *(np.full(len(c.W_n), c.normal.sides == 2) for c in self.cone.contacts)]
        )
        return float(np.max(np.where(pulls, np.abs(u_n), u_n), initial=0.0))

    @property
    def volume_solves(self) -> int:
        return self.surface.counters.volume_solves

    def contact_displacement(self, p: Array, residual: float = 0.0) -> Array:
        """u_c = K_B^-1 (f - B^T p) at the contact dofs (c,) [m]: one volume solve. Not for floating bodies.

        Args:
            residual: how far an iterative volume solve may put the natural residual off.
        """
        return self.surface.under(self.load, p, residual * self.u_ref)

    def relative_displacement(self, u_c: Array) -> Array:
        """w = N u_c + offset (rows,) [m]."""
        return np.asarray(self.surface.N @ u_c + self.offset)

    def project(self, p_hat: Array, gamma: Any) -> Array:
        """Trial tractions pushed back into the cone; `gamma` is the step that made them [Pa/m]."""
        return self.cone.project(p_hat, np.broadcast_to(gamma, p_hat.shape))

    def natural_residual(self, p: Array, w: Array) -> float:
        """max |p - P_C(p + (p_ref/u_ref) r)| / p_ref: one yardstick for every method, free of its step; collective."""
        if self.p_ref == 0:
            return 0.0
        residual = self.cone.natural_residual(p, w - self.gap, self.p_ref / self.u_ref)
        return float(self.surface.agreed(np.abs(residual).max(initial=0.0) / self.p_ref))
