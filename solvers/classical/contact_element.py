"""Contact elements: a slave node and the master facet or obstacle opposite to it; open, sticking or sliding.

For stick, Pop (4.3), this functional is stationary in u and Σ = (Σ_n, Σ_t, Σ_τ):

    L_d = ½ b(u, u) - L(u) + Σ^T G - Σ_n^T Σ_n / 2ω_n - Σ_t^T Σ_t / 2ω_t - Σ_τ^T Σ_τ / 2ω_τ

so one element adds, (4.5), with its gap G = N^s u - g^s,

    R_C^s = ( N^sT Σ        )      K_C^s = ( 0               N^sT )
            ( (Σ* - Σ) / ω  )              ( Σ*' N^s / ω    -1/ω  )

where Σ* = ω G and Σ*' = ω: (5.3) with B = N, K_C = -1/ω. For slide the source gives only |Σ_tan| = μ |Σ_n|: here Σ* is
the radial return of ω G to the circle of radius μ ω_n G_n, and Σ*' its derivative, unsymmetric because the radius
depends on G_n. An open element has Σ* = 0. Gaps are positive when closed, forces are positive when they press.

Difference from the source: the springs keep the tangential forces of the last step, G_T = u_T - u_T,old +
Σ_T,old / ω_t. If the springs started relaxed, a sticking node would creep by Σ_T / ω_t in every step.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.admissible_set import ContactBlock
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.scene.material import Elastic
from stickslip.solvers.system.system import System

OPEN, STICK, SLIP = range(3)


def press(G_n: Array, omega_n: Array, sides: int) -> tuple[Array, Array]:
    """Normal forces Σ_n* (m,) [N] of m elements, and their derivatives (m,) [N/m] by the gap.

    Args:
        G_n: normal gaps (m,) [m], positive when closed.
        omega_n: penalties (m,) [N/m].
        sides: 1: elements only press; 2: they also pull, and are always closed.

    >>> press(np.array([0.5, -0.5]), np.array([4.0, 4.0]), sides=1)
    (array([2., 0.]), array([4., 0.]))
    """
    closed = (G_n > 0) | (sides == 2)
    return np.where(closed, omega_n * G_n, 0.0), np.where(closed, omega_n, 0.0)


def rub(G_T: Array, omega_T: Array, bound: Array) -> tuple[Array, Array, Array, Ints]:
    """Tangential forces of m elements by radial return, and their derivatives.

    Args:
        G_T: tangential gaps (m, c) [m], c = 1 or 2.
        omega_T: penalties (m,) [N/m].
        bound: μ Σ_n* (m,) [N].

    Returns:
        Σ_T* (m, c) [N], its derivative by G_T (m, c, c) [N/m], its derivative by the bound (m, c) [-], and the status
        (m,): OPEN, STICK or SLIP.
    """
    trial = omega_T[:, None] * G_T
    length = np.linalg.norm(trial, axis=1)
    status = np.where(bound <= 0, OPEN, np.where(length <= bound, STICK, SLIP))
    e = np.divide(trial, length[:, None], out=np.zeros_like(trial), where=length[:, None] > 0)
    shrunk = np.divide(bound, length, out=np.ones_like(length), where=status == SLIP)
    shrunk[status == OPEN] = 0.0
    along = e * (status == SLIP)[:, None]
    across = np.eye(G_T.shape[1]) - along[:, :, None] * along[:, None, :]
    return shrunk[:, None] * trial, (omega_T * shrunk)[:, None, None] * across, along, status


@dataclass(frozen=True)
class Answer:
    """Forces that the elements exert at gaps G, and their derivatives."""

    Sigma: Array  # Σ* (rows,) [N]
    slope: sparse.csr_matrix  # Σ*' = dΣ*/dG (rows, rows) [N/m]
    status: Ints  # (rows,) OPEN, STICK or SLIP; a closed normal row sticks


@dataclass(frozen=True)
class ContactElements:
    """All elements together: arrays (rows,) hold normal rows first, then tangential ones; a slave node has d rows."""

    problem: SurfaceProblem
    omega: Array  # penalties ω_n, ω_t, ω_τ (rows,) [N/m]
    reference: Array  # (rows,) [m], the relative displacement at which G = 0

    @staticmethod
    def of(problem: SurfaceProblem, omega: Array, held: Array) -> ContactElements:
        """Elements of a step.

        Args:
            omega: penalties per area (rows,) [Pa/m].
            held: tractions (rows,) [Pa] that the springs start from, see `held_from`.
        """
        soft = 1 / omega + problem.cone.softness  # k_T is a second spring, in series
        return ContactElements(problem, problem.surface.W / soft, problem.gap - held / omega)

    def gaps(self, u_c: Array) -> Array:
        """G (rows,) [m], positive when closed."""
        return np.asarray(self.problem.relative_displacement(u_c) - self.reference)

    def residual(self, Sigma: Array, answer: Answer) -> tuple[Array, Array]:
        """R_C: its part at the contact dofs (c,) [N], and that of the equations of the forces Σ (rows,) [m]."""
        return np.asarray(self.problem.surface.N.T @ Sigma), (answer.Sigma - Sigma) / self.omega

    def tangent(self, answer: Answer) -> tuple[Sparse, Sparse, Sparse]:
        """The non-zero blocks of K_C, sparse: N^T (c, rows), Σ*' N / ω (rows, c), -1/ω (rows, rows)."""
        N, flexible = self.problem.surface.N, sparse.diags(1 / self.omega)
        return N.T, flexible @ answer.slope @ N, -flexible

    def answer(self, G: Array) -> Answer:
        """Σ*, its derivative and the status at gaps G (rows,) [m]."""
        Sigma, normal, status = np.zeros_like(G), np.zeros_like(G), np.full(len(G), OPEN)
        entries: list[tuple[Array, Ints, Ints]] = []
        for place in self.problem.cone.places:
            n = place.normal
            Sigma[n], normal[n] = press(G[n], self.omega[n], place.rows.normal.sides)
            status[n] = np.where(normal[n] > 0, STICK, OPEN)
        for place in self.problem.cone.with_friction():
            entries += self._rub(place, G, Sigma, normal[place.normal], status)
        own = np.flatnonzero(normal)
        data, i, j = (np.concatenate(x) for x in zip((normal[own], own, own), *entries, strict=True))
        return Answer(Sigma, sparse.csr_matrix((data, (i, j)), shape=(len(G), len(G))), status)

    def _rub(
        self, place: ContactBlock, G: Array, Sigma: Array, normal: Array, status: Ints
    ) -> Iterator[tuple[Array, Ints, Ints]]:
        """Fill in Σ_T* and the status of one contact; yield value, row and column of its entries of Σ*'."""
        n, T, free = place.normal, place.tangential, place.rows.free
        W, index = self.problem.surface.W, np.arange(T.start, T.stop).reshape(free.shape)
        p_n, W_T = Sigma[n] / W[n], W[index[:, 0]]
        bound = W_T * self.problem.cone.bound(place, p_n)
        found, by_gap, by_bound, how = rub(G[T].reshape(free.shape) * free, self.omega[index[:, 0]], bound)
        Sigma[T], status[T] = found.ravel(), np.repeat(how, free.shape[1])
        i, j = (np.broadcast_to(x, by_gap.shape).ravel() for x in (index[:, :, None], index[:, None, :]))
        yield (by_gap * (free[:, :, None] & free[:, None, :])).ravel(), i, j
        slope = self.problem.cone.bound_slope(place, p_n)
        by_G_n = (sparse.diags(W_T) @ slope @ sparse.diags(normal / W[n])).tocoo()  # of the bound (m_t, m_n)
        unsymmetric = by_bound[by_G_n.row] * by_G_n.data[:, None]
        yield unsymmetric.ravel(), index[by_G_n.row].ravel(), np.repeat(n.start + by_G_n.col, free.shape[1])


def held_from(problem: SurfaceProblem, p_old: Array) -> Array:
    """Tractions (rows,) [Pa] that the springs keep from the last step, p_old; zero in normal rows, p_n is a total."""
    found = p_old.copy()
    found[: problem.surface.normal_rows] = 0.0
    return found


def penalties(system: System, omega_factor: float) -> Array:
    """ω_n, then ω_t = ω_τ, per area (rows,) [Pa/m]: omega_factor times E / h and G / h of the contact facets.

    The springs are omega_factor times as stiff as the layer of elements behind the surface; h is the size of the
    facets around each node. The compliances of two bodies add up (springs in series).
    """
    found = [np.zeros(0)]
    for shear in (False, True):
        for c in system.contacts:
            give = _give(system, c, c.N_t if shear else c.N_n, shear)
            found.append(omega_factor / give)
    return np.concatenate(found)


def _give(system: System, c: ContactRows, N: Any, shear: bool) -> Array:
    """h / E, or h / G for `shear`, (rows,) [m/Pa]: for each side averaged with the row's weights, then added up."""
    N, dim = N.tocsr(), c.surface.dim
    parts = sparse.csr_matrix((np.abs(N.data), N.indices // dim, N.indptr), shape=(N.shape[0], N.shape[1] // dim))
    total, start = np.zeros(N.shape[0]), 0
    for surface, body in _sides(system, c):
        size = _sizes(surface)
        weight = parts[:, start : (start := start + len(size))]
        sums = np.asarray(weight.sum(axis=1)).ravel()
        own = np.divide(weight @ size, sums, out=np.full(len(sums), size.mean()), where=sums > 0)
        total += own / (body.shear_modulus if shear else body.modulus_along(c.frames[:, 0]))
    return total


def _sides(system: System, c: ContactRows) -> list[tuple[Surface, Elastic]]:
    """Surface and material of the slave, and of the master if it is a body."""
    surfaces = [c.surface] + ([c.master] if c.master else [])
    bodies = system.problem.pairs[c.name].bodies
    return [(surface, system.problem.bodies[body]) for surface, body in zip(surfaces, bodies, strict=True)]


def _sizes(surface: Surface) -> Array:
    """h (n,) [m]: length of the first edge of a facet, averaged over the facets around each node."""
    ends = surface.points[surface.facets[:, :2]]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    facets = surface.facets.ravel()
    around = np.repeat(length, surface.facets.shape[1])
    return np.bincount(facets, around, len(surface.points)) / np.bincount(facets, minlength=len(surface.points))
