"""Where contact tractions may lie: the laws of all contacts, applied point by point.

p is flat: normal pressures of all contacts, then their tangential multipliers; r likewise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from geometry.arrays import Array, Bools
from solvers.contact.rows import ContactRows


@dataclass(frozen=True)
class ContactBlock:
    """Where one contact's entries stand in p."""

    rows: ContactRows
    normal: slice
    tangential: slice
    average: Any  # (m_t, m_n) sparse

    @property
    def components(self) -> int:
        return self.rows.surface.dim - 1


@dataclass(frozen=True)
class AdmissibleSet:
    """The admissible tractions of all contacts at one time."""

    contacts: tuple[ContactRows, ...]
    time: float
    end: float

    @cached_property
    def places(self) -> tuple[ContactBlock, ...]:
        found, n = [], 0
        normals = []
        for c in self.contacts:
            normals.append(slice(n, n + len(c.W_n)))
            n += len(c.W_n)
        for c, normal in zip(self.contacts, normals, strict=True):
            size = c.free.size
            found.append(ContactBlock(c, normal, slice(n, n + size), c.average))
            n += size
        return tuple(found)

    @cached_property
    def softness(self) -> Array:
        """1 / k_T of each tangential row [m/Pa]: the give before slip, 0 where there is none and in normal rows."""
        found = np.zeros(self.size)
        for place in self.with_friction():
            found[place.tangential] = place.rows.friction.softness  # type: ignore[union-attr]
        return found

    @cached_property
    def carrying(self) -> Bools:
        """Which rows may carry a traction: supports make some directions of friction redundant."""
        found = np.ones(self.size, bool)
        for place in self.places:
            found[place.tangential] = place.rows.free.ravel()
        return found

    @property
    def size(self) -> int:
        return sum(len(c.W_n) + c.free.size for c in self.contacts)

    def at(self, time: float) -> AdmissibleSet:
        """The same laws at another time."""
        other = AdmissibleSet(self.contacts, time, self.end)
        other.__dict__.update(places=self.places, softness=self.softness, carrying=self.carrying)
        return other

    def bound(self, place: ContactBlock, p_n: Array) -> Array:
        """Friction bound s (m_t,) [Pa] of one contact."""
        law = place.rows.friction
        assert law is not None
        return law.limit(p_n, place.average, place.rows.normal, self.time, self.end)

    def bound_slope(self, place: ContactBlock, p_n: Array) -> Any:
        """ds/dp_n, sparse (m_t, m_n)."""
        law = place.rows.friction
        assert law is not None
        return law.limit_slope(p_n, place.average, place.rows.normal)

    def with_friction(self) -> Iterator[ContactBlock]:
        return (place for place in self.places if place.rows.friction is not None)

    def give(self, p: Array) -> Array:
        """Relative displacement (rows,) [m] that is elastic at tractions p: the penetration, and t / k_T."""
        found = self.softness * p
        for place in self.places:
            found[place.normal] = place.rows.normal.penetration(p[place.normal])
        return found

    def energy(self, p: Array) -> Array:
        """What that stores, per area (rows,) [J/m²]."""
        found = self.softness * p**2 / 2
        for place in self.places:
            found[place.normal] = place.rows.normal.energy(p[place.normal])
        return found

    def project(self, p_hat: Array, gamma: Array) -> Array:
        """argmin over the cone of ||q - p_hat|| in a metric that is diagonal by point.

        Normal laws by their resolvent, with step gamma; then tangential tractions, their elastic give taken off in
        the same way, into the disc of radius s.

        Args:
            p_hat: trial tractions [Pa].
            gamma: step of the trial, by row [Pa/m].
        """
        p = p_hat / (1 + gamma * self.softness)
        for place in self.places:
            p[place.normal] = place.rows.normal.resolvent(p_hat[place.normal], gamma[place.normal])
        for place in self.with_friction():
            t = np.where(place.rows.free, p[place.tangential].reshape(-1, place.components), 0.0)
            p[place.tangential] = project_disc(t, self.bound(place, p[place.normal])).ravel()
        return p

    def natural_residual(self, p: Array, r: Array, gamma: float) -> Array:
        """p - P_C(p + gamma (r - give(p))), by row [Pa]: zero at the solution only."""
        residual, trial = np.empty_like(p), p + gamma * (r - self.give(p))
        for place in self.places:
            n = place.normal
            residual[n] = p[n] - (trial[n] if place.rows.normal.sides == 2 else np.maximum(trial[n], 0.0))
        for place in self.with_friction():
            hat = np.where(place.rows.free, trial[place.tangential].reshape(-1, place.components), 0.0)
            disc = project_disc(hat, self.bound(place, p[place.normal]))
            residual[place.tangential] = p[place.tangential] - disc.ravel()
        return residual


def project_disc(t: Array, s: Array) -> Array:
    """Push tangential tractions t (m, c) [Pa] into the disc of radius s (m,) [Pa].

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
