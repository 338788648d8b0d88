"""The contact problem of one load step on the surface: tractions and relative displacement in complementarity.

It is all that a method sees of the scene.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stickslip.geometry.arrays import EXACT, LAST_DIGITS, ROUNDING, Array
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.flexibility import DelassusOperator, Load
from stickslip.solvers.interface.scales import Scales

PART = 1e-2  # of the stiffness of a compliant law, for which bodies that are softer still do not stand in


@dataclass(frozen=True, kw_only=True)
class SurfaceProblem:
    """Find admissible p with w(p) - gap in the normal cone at p, and R^T (f - B^T p) = 0 for the rigid modes R.

    In other words: a quasi-variational inequality with the Delassus operator, w(p) = N K_B^-1 (f - B^T p) + offset.
    Flat arrays (rows,): normal rows of all contacts, then tangential rows in the local frames.
    """

    surface: DelassusOperator
    cone: AdmissibleSet  # admissible tractions
    load: Load
    offset: Array  # (rows,) prescribed part of the relative displacement [m]
    u_before: Array  # (c,) [m] displacement of the contact dofs at the end of the last step, if bodies float
    gap: Array  # (rows,) [m] initial gap; tangential: where slip is counted from, w - t/k_T of the last accepted step
    gamma: Array  # (rows,) E / depth of the body [Pa/m], weighs w - gap beside p in Newton's trial tractions
    weight: Array  # (rows,) E / extent of the bodies [Pa/m], likewise in the residual
    force: float  # applied force, sum of magnitudes [N]
    stiffness: float  # E / L [Pa/m], L the extent of the bodies
    touch: Callable[[Array, Array, Array], Array] | None = None  # the gap by p and w, see `stepping/touch`
    turned: Array | None = None  # tractions (rows,) [Pa] at which a load or motion turns, where the step begins
    guess: Array | None = None  # (c,) [m] with the tractions that it is solved from, of pairs that lay almost there

    @cached_property
    def scales(self) -> Scales:
        """Sizes of motions and tractions: those of the load without contact, from where the bodies stand."""
        n, u_c = self.surface.normal_rows, self.load.free
        if self.idle:
            u_c = u_c + self.surface.R @ (self.surface.R.T @ self.u_before)
        # without contact the augmentation holds a floating body, and is stiffer than contact
        w = self.relative_displacement(u_c)
        r = w - self.gap
        free = float(np.abs(w).max(initial=0.0))
        closing, sliding = max(self._closing(w[:n]), self._closing(r[:n])), float(np.abs(r)[n:].max(initial=0.0))
        # a long slide causes no large pressure: tangential motion sets the scale only if no normal motion closes
        motion = next((size for size in (closing, sliding) if size > EXACT * free), free)
        area = sum(float(c.node_weights.sum()) for c in self.cone.contacts)
        pressure = self.force / area if area else 0.0
        if self.surface.floating or not motion:
            motion = max(motion, pressure / self.stiffness)
        traction = max(pressure, self.stiffness * motion)
        given = np.maximum(np.abs(self.gap), np.abs(self.offset))
        return Scales(motion=motion, traction=traction, given=given, free=free)

    @property
    def u_ref(self) -> float:
        """Scale of relative displacement [m]."""
        return self.scales.motion

    @property
    def p_ref(self) -> float:
        """Scale of tractions [Pa]."""
        return self.scales.traction

    @property
    def idle(self) -> bool:
        """Whether bodies float and no load pushes them; strains that balance themselves do not."""
        f = self.load
        return self.surface.floating and bool(np.abs(f.resultant).sum() <= ROUNDING * np.abs(f.f_c).sum())

    def _closing(self, u_n: Array) -> float:
        """Largest entry of u_n (normal rows,) [m] that contact resists: closing, and opening where it also pulls."""
        pulls = np.concatenate(
            [np.zeros(0, bool), *(np.full(len(c.W_n), c.normal.sides == 2) for c in self.cone.contacts)]
        )
        return float(np.max(np.where(pulls, np.abs(u_n), u_n), initial=0.0))

    def is_scaled(self, other: SurfaceProblem) -> bool:
        """Whether this is another problem of the same bodies in another unit: load, gaps, motions in proportion."""
        N, of_other = self.surface.N, other.surface.N
        if N is not of_other and (N.shape != of_other.shape or abs(N - of_other).sum()):
            return False  # sliding contact has found other pairs
        if self.p_ref == 0 or other.p_ref == 0 or not self.cone.homogeneous:
            return False
        scale = self.p_ref / other.p_ref
        pairs = ((self.gap, other.gap), (self.offset, other.offset), (self.load.free, other.load.free))
        allowed = ROUNDING * max(self.u_ref, float(np.abs(self.load.free).max(initial=0.0)))
        return all(np.abs(a - scale * b).max(initial=0.0) <= allowed for a, b in pairs)

    @cached_property
    def give(self) -> Array | None:
        """Flexibility of each row (rows,) [m/Pa], the same in all tangential directions of a point; None: unknown."""
        give = self.surface.give
        if give is None or not (give > 0).any():
            return None
        found = np.where(give > 0, give, np.median(give[give > 0]))
        for place in self.cone.places:
            t = place.tangential
            found[t] = np.repeat(found[t].reshape(-1, place.components).mean(axis=1), place.components)
        return found

    @property
    def volume_solves(self) -> int:
        """Applications of K_B^-1 in the run so far."""
        return self.surface.counters.volume_solves

    def contact_displacement(self, p: Array, residual: float = 0.0) -> Array:
        """u_c = K_B^-1 (f - B^T p) at the contact dofs (c,) [m]: one volume solve. Not for floating bodies.

        Args:
            p: tractions (rows,) [Pa].
            residual: error that an iterative volume solve may cause in the natural residual.
        """
        u_ref = self.u_ref
        if p.any():
            u_ref = min(u_ref, self.scales.of_tractions(p) / float(self.weight.max()))
        return self.surface.under(self.load, p, residual * u_ref)

    def relative_displacement(self, u_c: Array) -> Array:
        """Relative displacement w = N u_c + offset (rows,) [m] of a displacement u_c (c,) [m]."""
        return np.asarray(self.surface.N @ u_c + self.offset)

    def project(self, p_hat: Array, gamma: Array | float) -> Array:
        """Projection of trial tractions (rows,) [Pa] onto the admissible set; `gamma` [Pa/m] is their step."""
        return self.cone.project(p_hat, np.broadcast_to(gamma, p_hat.shape))

    def defect(self, p: Array, w: Array) -> Array:
        """Complementarity (KKT) defect p - P_C(p + k (w - gap)) (rows,) [Pa]: zero at the solution only.

        It is the traction that each row lacks, as what is behind it would answer: k is the bodies' E / extent, or a
        part of a compliant law's stiffness where bodies are much softer. What a motion misses by rounding is none;
        of bodies that nothing pushes, what a law makes of these digits is none either, up to a small part of `p_ref`.

        Args:
            p: tractions (rows,) [Pa].
            w: relative displacement (rows,) [m].
        """
        k, r, no_motion = self.weight.copy(), w - self.gap, self.scales.no_motion(w)
        of_law = np.zeros_like(p)
        for place in self.cone.places:
            n = place.normal
            slope = place.rows.normal.stiffness(p[n], r[n])
            of_law[n] = np.where(np.isfinite(slope), slope, 0.0)
            k[n] = np.maximum(k[n], PART * of_law[n])
        rounding = k * no_motion
        if self.idle:  # what a law makes of the last digits is all there is
            rounding = np.maximum(rounding, min(float((of_law * no_motion).max(initial=0.0)), ROUNDING * self.p_ref))
        found = self.cone.natural_residual(p, r, k)
        return np.asarray(np.sign(found) * np.maximum(np.abs(found) - rounding, 0.0))

    def imbalance(self, p: Array) -> float:
        """Forces R^T (f - B^T p) out of balance on the rigid modes, relative to all forces on them; 0 without modes.

        What the last digits of a common motion decide is in balance.
        """
        surface = self.surface
        if not surface.floating:
            return 0.0
        forces, least = surface.forces(p), np.abs(surface.forces(np.full(len(p), self.scales.of_tractions(0 * p))))
        work = np.abs(surface.R).T @ np.maximum(np.abs(forces), least)  # larger than that of any p that balances
        scale = max(float(work.sum()), float(np.abs(self.load.resultant).sum()))
        left = float(np.abs(self.load.resultant - surface.R.T @ forces).sum())
        carried_along = float(np.abs(self.offset - self.gap)[p != 0].max(initial=0.0))
        return max(left - LAST_DIGITS * surface.total * carried_along, 0.0) / scale if scale else 0.0

    def natural_residual(self, p: Array, w: Array) -> float:
        """Largest `defect` relative to the largest traction; collective.

        It is the same measure for every method, independent of its step, of motions that contact takes away, and of the
        stiffness of bodies that are not in contact at a row.

        Args:
            p: tractions (rows,) [Pa].
            w: relative displacement (rows,) [m].
        """
        if self.p_ref == 0:
            return 0.0
        return float(self.surface.agreed(np.abs(self.defect(p, w)).max(initial=0.0) / self.scales.of_tractions(p)))
