"""The contact problem of one load step on the surface: tractions and relative displacement in complementarity.

It is all that a method sees of the scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stickslip.geometry.arrays import EPS, Array
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.flexibility import DelassusOperator, Load

ROUNDING = 1e-12  # of the largest motion: smaller motions count as zero
PART = 1e-2  # of the distance from a compliant law that counts as defect
LAST_DIGITS = 16 * EPS  # of motions
SCALED = 1e-9  # relative difference up to which problems are the same in another unit
FAR = 1e10  # times the motions that are given or expected: bodies that move farther have flown away
BALANCED = 1e-9  # of all forces of a load on the contact dofs: a resultant below that is rounding
NOTHING = 1e-9  # of p_ref: the most that rounding may press where nothing pushes the bodies
LEAST = 1e-6  # of p_ref: tractions below that are measured against it, for they are differences of what is far larger


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

    @cached_property
    def u_ref(self) -> float:
        """Scale of relative displacement [m]: that of the load without contact, from where the bodies stand."""
        n, u_c = self.surface.normal_rows, self.load.free
        if self.idle:
            u_c = u_c + self.surface.R @ (self.surface.R.T @ self.u_before)
        # without contact the augmentation holds a floating body, and is stiffer than contact
        w = self.relative_displacement(u_c)
        # a long slide causes no large pressure: tangential motion sets the scale only if no normal motion closes
        motion = float(np.abs(w).max(initial=0.0))
        closing = max(self._closing(w[:n]), self._closing((w - self.gap)[:n]))
        sliding = float(np.abs(w - self.gap)[n:].max(initial=0.0))
        u_ref = next((size for size in (closing, sliding) if size > ROUNDING * motion), motion)
        if self.surface.floating or not u_ref:
            u_ref = max(u_ref, self._mean_pressure / self.stiffness)
        return u_ref

    @cached_property
    def p_ref(self) -> float:
        """Scale of tractions [Pa]: the mean pressure of the applied force, and at least `stiffness` times `u_ref`."""
        return max(self._mean_pressure, self.stiffness * self.u_ref)

    @cached_property
    def _mean_pressure(self) -> float:
        """Applied force by contact area [Pa]."""
        area = sum(float(c.node_weights.sum()) for c in self.cone.contacts)
        return self.force / area if area else 0.0

    @property
    def idle(self) -> bool:
        """Whether bodies float and no load pushes them; strains that balance themselves do not."""
        f = self.load
        return self.surface.floating and bool(np.abs(f.resultant).sum() <= BALANCED * np.abs(f.f_c).sum())

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
        allowed = SCALED * max(self.u_ref, float(np.abs(self.load.free).max(initial=0.0)))
        return all(np.abs(a - scale * b).max(initial=0.0) <= allowed for a, b in pairs)

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
            u_ref = min(u_ref, self.scale(p) / float(self.weight.max()))
        return self.surface.under(self.load, p, residual * u_ref)

    def relative_displacement(self, u_c: Array) -> Array:
        """Relative displacement w = N u_c + offset (rows,) [m] of a displacement u_c (c,) [m]."""
        return np.asarray(self.surface.N @ u_c + self.offset)

    def project(self, p_hat: Array, gamma: Array | float) -> Array:
        """Projection of trial tractions (rows,) [Pa] onto the admissible set; `gamma` [Pa/m] is their step."""
        return self.cone.project(p_hat, np.broadcast_to(gamma, p_hat.shape))

    def defect(self, p: Array, w: Array) -> Array:
        """Complementarity (KKT) defect p - P_C(p + k (w - gap)) (rows,) [Pa]: zero at the solution only.

        It is the traction that each row lacks, as the bodies behind it would answer: k is theirs, E / extent. Where
        bodies are much softer than a compliant law, it is a part of what the pressure differs from that of the law.
        What the last digits of the motions decide is no defect, unless bodies have flown away; of bodies that nothing
        pushes, what a law makes of these digits is none either.

        Args:
            p: tractions (rows,) [Pa].
            w: relative displacement (rows,) [m].
        """
        r = w - self.gap
        found: Array = self.cone.natural_residual(p, r, self.weight)
        moved, *given = (float(np.abs(x).max(initial=0.0)) for x in (w, self.gap, self.offset))
        rounding = LAST_DIGITS * max(min(moved, FAR * max(*given, self.u_ref)), *(given if self.idle else given[:1]))
        doubt = self.weight * rounding
        for place in self.cone.places if self.idle else ():
            of_law = float(place.rows.normal.doubt(r[place.normal], rounding).max(initial=0.0))
            for rows in (place.normal, place.tangential):  # friction bounds follow the pressure
                doubt[rows] = np.maximum(doubt[rows], min(of_law, NOTHING * self.p_ref))
        found = np.sign(found) * np.maximum(np.abs(found) - doubt, 0.0)
        for place in self.cone.places:
            n = place.normal
            off = PART * place.rows.normal.misses(p[n], r[n], rounding)
            found[n] = np.where(off > np.abs(found[n]), off, found[n])
        return found

    def scale(self, p: Array) -> float:
        """Largest traction of p (rows,) [Pa]: what the residual is relative to; at least a small part of `p_ref`."""
        return max(float(np.abs(p).max(initial=0.0)), LEAST * self.p_ref)

    def imbalance(self, p: Array) -> float:
        """Forces R^T (f - B^T p) out of balance on the rigid modes, relative to all forces on them; 0 without modes.

        What the last digits of a common motion decide is in balance.
        """
        surface = self.surface
        if not surface.floating:
            return 0.0
        forces, least = surface.forces(p), np.abs(surface.forces(np.full(len(p), LEAST * self.p_ref)))
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
        return float(self.surface.agreed(np.abs(self.defect(p, w)).max(initial=0.0) / self.scale(p)))
