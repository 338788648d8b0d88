"""The contact laws at trial tractions, linearised: which rows become constraints, which springs, which slip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from geometry.arrays import Array, Bools, Ints
from solvers.contact.admissible_set import AdmissibleSet, Place
from solvers.interface.problem import SurfaceProblem

TIE = 1e-12  # of the bound: nearer to it, rounding alone would decide between stick and slip


@dataclass(frozen=True)
class ActiveSet:
    """One Newton system over all rows: A_p p + A_w w = rhs.

    Held rows (closed, stick): w = gap. Springs (compliance, stick with k_T): p = p_0 + k (w - gap). Slip: p follows the
    pressures of normal rows, in 3D w as well. All others: p = 0. The diagonal of A_p is 1 on rows without A_w.
    """

    problem: SurfaceProblem
    k: Array  # (rows,) spring stiffness [Pa/m], 0 where there is none
    held: Bools  # (rows,)
    slip: Bools  # (rows,)
    A_p: sparse.csr_matrix  # (rows, rows)
    A_w: sparse.csr_matrix  # (rows, rows)
    rhs: Array  # (rows,)

    @property
    def given(self) -> Bools:
        """Rows whose p follows from that of others, or is 0, whatever w is."""
        return np.asarray(np.diff(self.A_w.indptr) == 0)


class _Rows:
    """The system while it is put together: every row open at first."""

    def __init__(self, cone: AdmissibleSet, gap: Array, gamma: Array) -> None:
        self.cone, self.gap, self.gamma, self.rows = cone, gap, gamma, len(gap)
        self.k, self.held, self.slips = np.zeros(self.rows), np.zeros(self.rows, bool), np.zeros(self.rows, bool)
        self.rhs = np.zeros(self.rows)
        self.on_p: list[tuple[Array, Ints, Ints]] = []  # entries besides the diagonals
        self.on_w: list[tuple[Array, Ints, Ints]] = []

    def hold(self, at: Ints) -> None:
        """gamma (w - gap) = 0: rows of one unit, Pa."""
        self.held[at] = True
        self.rhs[at] = self.gamma[at] * self.gap[at]

    def spring(self, at: Ints, k: Array | float, p_0: Array | float) -> None:
        """p = p_0 + k (w - gap)."""
        self.k[at] = k
        self.rhs[at] = p_0 - k * self.gap[at]

    def slip(self, at: Ints, free: Bools, trial: Array, s: Array, slope: Any, p_n: Array, normal: slice) -> None:
        """t = s(p_n) e + J (t + gamma (w - gap) - t_hat), e = t_hat / |t_hat|, J = s/|t_hat| (I - e e^T).

        Args:
            at: their rows (m, c).
            free: (m, c) directions that carry a multiplier.
            trial: t_hat (m, c) [Pa].
            s: bound (m,) [Pa].
            slope: ds/dp_n, sparse (m, m_n), at p_n (m_n,).
            normal: rows of p_n.
        """
        self.slips[at] = free
        c = trial.shape[1]
        length = np.linalg.norm(trial, axis=1)
        e = trial / length[:, None]
        self.rhs[at] = (s - slope @ p_n)[:, None] * e
        point = np.repeat(np.arange(len(at)), np.diff(slope.indptr))
        columns = np.broadcast_to(normal.start + slope.indices[:, None], (len(point), c))
        self.on_p.append(((-e[point] * slope.data[:, None]).ravel(), at[point].ravel(), columns.ravel()))
        if c == 1:
            return
        J = (s / length)[:, None, None] * (np.eye(c) - e[:, :, None] * e[:, None, :])
        J *= free[:, :, None] & free[:, None, :]
        self.rhs[at] -= np.einsum("mab,mb->ma", J, self.gamma[at] * self.gap[at] + trial)
        i, j = (np.broadcast_to(x, J.shape).ravel() for x in (at[:, :, None], at[:, None, :]))
        self.on_p.append((-J.ravel(), i, j))
        self.on_w.append(((-J * self.gamma[at][:, None, :]).ravel(), i, j))

    def matrix(self, diagonal: Array, entries: list[tuple[Array, Ints, Ints]]) -> sparse.csr_matrix:
        own = np.flatnonzero(diagonal)
        data, i, j = (np.concatenate(x) for x in zip((diagonal[own], own, own), *entries, strict=True))
        return sparse.csr_matrix((data, (i, j)), shape=(self.rows, self.rows))

    def laws(self, problem: SurfaceProblem) -> ActiveSet:
        A_p = self.matrix(np.where(self.held, 0.0, 1.0), self.on_p)
        A_w = self.matrix(np.where(self.held, self.gamma, -self.k), self.on_w)
        return ActiveSet(problem, self.k, self.held, self.slips, A_p, A_w, self.rhs)


def linearise(problem: SurfaceProblem, p_hat: Array, gamma: Array) -> ActiveSet:
    """Linearise p = P_C(p + gamma (w - gap)) at the trial tractions p_hat (rows,) [Pa]."""
    cone = problem.cone
    p = cone.project(p_hat, gamma)
    rows = _Rows(cone, problem.gap, gamma)
    for place in cone.places:
        n, law = place.normal, place.rows.normal
        slope = law.stiffness(p[n], p_hat[n])
        closed, index = np.isinf(slope), np.arange(n.start, n.stop)
        rows.hold(index[closed])
        soft = ~closed & (slope > 0)
        rows.spring(index[soft], slope[soft], p[n][soft] - slope[soft] * law.penetration(p[n])[soft])
    for place in cone.with_friction():
        _friction(rows, place, p_hat, p[place.normal], gamma)
    return rows.laws(problem)


def _friction(rows: _Rows, place: Place, p_hat: Array, p_n: Array, gamma: Array) -> None:
    span, free = place.tangential, place.rows.free
    index = np.arange(span.start, span.stop).reshape(free.shape)
    trial = p_hat[span].reshape(free.shape) * free
    length, s = np.linalg.norm(trial, axis=1), rows.cone.bound(place, p_n)
    softness = place.rows.friction.softness  # type: ignore[union-attr]
    # at the bound, as all points that slipped are where their tractions begin a step, a point sticks: it may turn back
    stick = (length <= s * (1 + gamma[index[:, 0]] * softness) * (1 + TIE)) & (s > 0)
    slip = np.flatnonzero(~stick & (s > 0))
    stuck = index[stick[:, None] & free]
    if softness:
        rows.spring(stuck, 1 / softness, 0.0)
    else:
        rows.hold(stuck)
    if len(slip):
        slope = rows.cone.bound_slope(place, p_n)[slip]
        rows.slip(index[slip], free[slip], trial[slip], s[slip], slope, p_n, place.normal)
