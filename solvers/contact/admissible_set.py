"""The admissible set of contact tractions, its projection, and the complementarity (KKT) residual, point by point.

Vectors over rows are flat: normal pressures p_n of all contacts, then their tangential multipliers t. With unilateral
contact and Coulomb friction the tractions of a point are admissible if p_n >= 0 and |t| <= s, the bound s = mu p_n.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stickslip.geometry.arrays import Array, Bools
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.laws.law import Dragged, Trial


@dataclass(frozen=True, kw_only=True)
class ContactBlock:
    """Position of one contact's entries in a flat vector over all rows."""

    rows: ContactRows
    normal: slice  # its m_n entries
    tangential: slice  # its m_t (d-1) entries

    @property
    def average(self) -> Sparse:
        """See `ContactRows.average`."""
        return self.rows.average

    @property
    def components(self) -> int:
        """d - 1, tangential components a point."""
        return self.rows.surface.dim - 1


@dataclass(frozen=True)
class AdmissibleSet:
    """The admissible tractions of all contacts at one time; amplitudes of friction bounds depend on it."""

    contacts: tuple[ContactRows, ...]
    time: float  # of the load step
    end: float  # last time of the scene

    @cached_property
    def places(self) -> tuple[ContactBlock, ...]:
        """The block of each contact."""
        found, n = [], 0
        normals = []
        for c in self.contacts:
            normals.append(slice(n, n + len(c.W_n)))
            n += len(c.W_n)
        for c, normal in zip(self.contacts, normals, strict=True):
            size = c.free.size
            found.append(ContactBlock(rows=c, normal=normal, tangential=slice(n, n + size)))
            n += size
        return tuple(found)

    @cached_property
    def softness(self) -> Array:
        """Tangential compliance 1 / k_T of each row (rows,) [m/Pa]; 0 where there is none, and in normal rows."""
        found = np.zeros(self.size)
        for place in self.with_friction():
            found[place.tangential] = place.rows.friction.softness  # type: ignore[union-attr]
        return found

    @cached_property
    def carrying(self) -> Bools:
        """Rows (rows,) that may carry a traction: supports make some directions of friction redundant."""
        found = np.ones(self.size, bool)
        for place in self.places:
            found[place.tangential] = place.rows.free.ravel()
        return found

    @property
    def size(self) -> int:
        """Number of rows."""
        return sum(len(c.W_n) + c.free.size for c in self.contacts)

    @property
    def homogeneous(self) -> bool:
        """Whether the laws are positively homogeneous: twice the motion belongs to twice the tractions."""
        return all(
            c.normal.power == 1 and (c.friction is None or c.friction.homogeneous(c.normal, self.time, self.end))
            for c in self.contacts
        )

    def at(self, time: float) -> AdmissibleSet:
        """The admissible set of the same laws at another time."""
        return AdmissibleSet(tuple(c.at(time) for c in self.contacts), time, self.end)

    def bound(self, place: ContactBlock, p_n: Array, trial: Trial | None = None) -> Array:
        """Friction bound s (m_t,) [Pa] of one contact at its pressures p_n (m_n,) [Pa].

        Args:
            trial: tractions whose slip raises the bound of a law that `drags`; None: at rest.
        """
        law = place.rows.friction
        assert law is not None
        if trial is not None and law.drags:
            return self.dragged(place, p_n, trial).bound
        return law.limit(p_n, place.average, place.rows.normal, self.time, self.end)

    def dragged(self, place: ContactBlock, p_n: Array, trial: Trial) -> Dragged:
        """That bound with its derivatives, of any law."""
        law = place.rows.friction
        assert law is not None
        if law.drags:
            return law.dragged(p_n, place.average, trial)
        return Dragged(self.bound(place, p_n), np.zeros_like(trial.size), self.bound_slope(place, p_n))

    def _in_disc(self, place: ContactBlock, t: Array, p_n: Array, gamma: Array | float) -> Array:
        """Tangential tractions (m_t c,) of trial ones t (m_t, c) [Pa], which are divided by 1 + gamma / k_T."""
        law, trial = place.rows.friction, None
        if law is not None and law.drags:
            step = np.broadcast_to(gamma, self.size)[place.tangential][:: place.components]
            trial = Trial(np.linalg.norm(t, axis=1) * (1 + step * law.softness), step)
        return project_disc(t, self.bound(place, p_n, trial)).ravel()

    def bound_at_nodes(self, place: ContactBlock, p: Array) -> Array:
        """Friction bound (n,) [Pa] at the slave's nodes of one contact, at tractions p (rows,) [Pa]."""
        c, t = place.rows, p[place.tangential].reshape(-1, place.components)
        return np.asarray(c.share_t.T @ c.along_traction(self.bound(place, p[place.normal]), t))

    def bound_slope(self, place: ContactBlock, p_n: Array) -> Sparse:
        """Slope ds/dp_n (m_t, m_n) of that bound."""
        law = place.rows.friction
        assert law is not None
        slope: Sparse = law.limit_slope(p_n, place.average, place.rows.normal)
        return slope

    def with_friction(self) -> Iterator[ContactBlock]:
        """The blocks of the contacts with friction."""
        return (place for place in self.places if place.rows.friction is not None)

    def give(self, p: Array) -> Array:
        """Elastic part of the relative displacement (rows,) [m] at tractions p: the penetration, and t / k_T."""
        found = self.softness * p
        for place in self.places:
            found[place.normal] = place.rows.normal.penetration(p[place.normal])
        return found

    def energy(self, p: Array) -> Array:
        """Energy per area (rows,) [J/m²] that it stores."""
        found = self.softness * p**2 / 2
        for place in self.places:
            found[place.normal] = place.rows.normal.energy(p[place.normal])
        return found

    def project(self, p_hat: Array, gamma: Array) -> Array:
        """Projection P_C of trial tractions onto the admissible set, point by point; compliance is taken implicitly.

        First pressures by the resolvent of their law with step gamma; then tangential multipliers, divided by
        1 + gamma / k_T, into the disc of radius s(p_n).

        Args:
            p_hat: trial tractions (rows,) [Pa].
            gamma: step of the trial, by row (rows,) [Pa/m].

        Returns:
            Admissible tractions (rows,) [Pa].
        """
        p = p_hat / (1 + gamma * self.softness)
        for place in self.places:
            p[place.normal] = place.rows.normal.resolvent(p_hat[place.normal], gamma[place.normal])
        for place in self.with_friction():
            t = np.where(place.rows.free, p[place.tangential].reshape(-1, place.components), 0.0)
            p[place.tangential] = self._in_disc(place, t, p[place.normal], gamma)
        return p

    def natural_residual(self, p: Array, r: Array, gamma: Array | float) -> Array:
        """Complementarity (KKT) residual p - P_C(p + gamma (r - give(p))) (rows,) [Pa]: zero at the solution only.

        Tangential springs are taken implicitly, t - P_C((t + gamma r) / (1 + gamma / k_T)): however soft they are, what
        rounding leaves of t is no slip.

        Args:
            p: tractions (rows,) [Pa].
            r: w - gap (rows,) [m], closing normal motion less the gap, and slip.
            gamma: weight of r beside p [Pa/m], by row or one for all.
        """
        residual, trial = np.empty_like(p), p + gamma * (r - self.give(p))
        elastic: Array = (p + gamma * r) / (1 + gamma * self.softness)
        for place in self.places:
            n = place.normal
            residual[n] = p[n] - (trial[n] if place.rows.normal.sides == 2 else np.maximum(trial[n], 0.0))
        for place in self.with_friction():
            hat = np.where(place.rows.free, elastic[place.tangential].reshape(-1, place.components), 0.0)
            residual[place.tangential] = p[place.tangential] - self._in_disc(place, hat, p[place.normal], gamma)
        return residual


def project_disc(t: Array, s: Array) -> Array:
    """Project tangential tractions onto the disc of radius s, the friction bound.

    Args:
        t: tractions (m, c) [Pa].
        s: friction bounds (m,) [Pa], >= 0.

    >>> project_disc(np.array([[3.0, 4.0], [0.3, 0.4]]), np.array([1.0, 1.0]))
    array([[0.6, 0.8],
           [0.3, 0.4]])
    >>> project_disc(np.array([[5.0]]), np.array([0.0]))
    array([[0.]])
    """
    length = np.linalg.norm(t, axis=1)
    outside = length > s
    scale = np.ones_like(length)
    scale[outside] = s[outside] / length[outside]
    return np.asarray(t * scale[:, None])
