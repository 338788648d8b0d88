"""Active sets of semismooth Newton: the contact laws linearised at trial tractions, row by row.

Rows are open, closed or stick (constraints), springs (compliance), or slip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import HALF_DIGITS, Array, Bools, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.admissible_set import AdmissibleSet, ContactBlock
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.laws.law import Dragged, Trial


@dataclass(frozen=True, kw_only=True)
class ActiveSet:
    """The active set and its generalised derivative, one Newton system over all rows: A_p p + A_w w = rhs.

    Held rows (closed, stick): w = gap. Springs (compliance, stick with k_T): p = p_0 + k (w - gap). Slip: p depends on
    the pressures of normal rows, in 3D on w as well. Open rows: p = 0. The diagonal of A_p is 1 on rows without A_w.
    """

    problem: SurfaceProblem
    k: Array  # (rows,) spring stiffness [Pa/m], 0 where there is no spring
    held: Bools  # (rows,) closed or stick without springs
    slip: Bools  # (rows,) and closed rows that give
    A_p: Sparse  # (rows, rows) [-]
    A_w: Sparse  # (rows, rows) [Pa/m]
    rhs: Array  # (rows,) [Pa]
    weight: float = 0.0  # of the proximal term [-]
    hold: float = 0.0  # springs that hold rigid motions where they are, relative to the stiffness of the bodies [-]

    @property
    def sets(self) -> Array:
        """Rows (3, rows) that are held, on springs, and slip."""
        return np.array([self.held, self.k > 0, self.slip])

    @property
    def given(self) -> Bools:
        """Rows (rows,) whose p is 0 or depends on p of other rows only, not on w."""
        return np.asarray(np.diff(self.A_w.indptr) == 0)

    @property
    def fixed(self) -> Bools:
        """Rows (rows,) with w = gap."""
        return np.zeros_like(self.held) if self.weight else self.held

    def proximal(self, p: Array, weight: float, gamma: Array, hold: float) -> ActiveSet:
        """The system with w - weight (p_new - p) / gamma in place of w in the rows whose law involves w.

        It is solvable where rows depend on each other. If p_new = p, its answer is that of the system itself.

        Args:
            p: tractions (rows,) [Pa] that the next ones should be near to.
            weight: of the distance from them [-].
            gamma: (rows,) [Pa/m].
            hold: see the class.
        """
        term = self.A_w @ sparse.diags(weight / gamma)
        scale = 1 / (1 + self.k * weight / gamma)  # springs in series are a spring
        A_p, A_w = (self.A_p - term).tocsr(), self.A_w
        k, rhs = scale * self.k, self.rhs - term @ p
        if self.k.any():
            A_p, A_w, rhs = sparse.diags(scale) @ A_p, sparse.diags(scale) @ A_w, scale * rhs
        return replace(self, k=k, A_p=A_p, A_w=A_w, rhs=rhs, weight=weight, hold=hold)

    def without(self, rows: Bools) -> ActiveSet:
        """The system in which the rows (rows,) carry nothing."""
        rest, A_p, A_w = sparse.diags((~rows).astype(float)), self.A_p, self.A_w
        A_p, A_w = (rest @ A_p + sparse.diags(rows.astype(float))).tocsr(), (rest @ A_w).tocsr()
        A_p.eliminate_zeros()
        A_w.eliminate_zeros()
        k, rhs = (np.where(rows, 0.0, x) for x in (self.k, self.rhs))
        return replace(self, k=k, A_p=A_p, A_w=A_w, rhs=rhs, held=self.held & ~rows, slip=self.slip & ~rows)

    def without_springs(self) -> ActiveSet:
        """The same system with springs as rows like any other, of one size however stiff they are."""
        scale = 1 / (1 + self.k / self.problem.gamma)
        A_p, A_w = ((sparse.diags(scale) @ A).tocsr() for A in (self.A_p, self.A_w))
        return replace(self, k=np.zeros_like(self.k), A_p=A_p, A_w=A_w, rhs=scale * self.rhs)

    def refuse_unbalanced(self, p: Array, rounding: float = 0.0) -> None:
        """Check that tractions p (rows,) [Pa] balance the load of floating bodies; rounding: of these forces [N].

        Raises:
            LinAlgError: they do not, because the active set leaves a rigid mode free.
        """
        surface, load = self.problem.surface, self.problem.load
        contact = surface.forces(p)
        # relative force out of balance above which the linear system counts as singular
        allowed = HALF_DIGITS * (max(np.abs(load.f_c).sum(), np.abs(load.resultant).sum()) + np.abs(contact).sum())
        if np.abs(load.resultant - surface.R.T @ contact).sum() > allowed + rounding:
            raise np.linalg.LinAlgError("the system is singular: some rigid motion is not held")


class _Rows:
    """The active set under construction: every row is open at first."""

    def __init__(self, cone: AdmissibleSet, p: Array, gap: Array, gamma: Array) -> None:
        self.cone, self.p, self.gap, self.gamma, self.rows = cone, p, gap, gamma, len(gap)
        self.k, self.held, self.slips = np.zeros(self.rows), np.zeros(self.rows, bool), np.zeros(self.rows, bool)
        self.rhs = np.zeros(self.rows)
        self.on_p: list[tuple[Array, Ints, Ints]] = []  # entries besides the diagonals
        self.on_w: list[tuple[Array, Ints, Ints]] = []

    def hold(self, at: Ints) -> None:
        """Hold the rows `at`: gamma (w - gap) = 0, so that all rows have the unit Pa."""
        self.held[at] = True
        self.rhs[at] = self.gamma[at] * self.gap[at]

    def give(self, at: Ints, softness: Array) -> None:
        """Let closed rows give by p softness (m,) [m/Pa]: p = J (p + gamma (w - gap)), J = 1 / (1 + gamma softness).

        However little they give, the numbers of a row have one size: a spring that is so stiff would drown in rounding.
        """
        J = 1 / (1 + self.gamma[at] * softness)
        self.slips[at] = True
        self.on_p.append((-J, at, at))
        self.on_w.append((-J * self.gamma[at], at, at))
        self.rhs[at] = -J * self.gamma[at] * self.gap[at]

    def spring(self, at: Ints, k: Array | float, p_0: Array | float) -> None:
        """Make springs of the rows `at`: p = p_0 + k (w - gap)."""
        self.k[at] = k
        self.rhs[at] = p_0 - k * self.gap[at]

    def slip(self, at: Ints, free: Bools, trial: Array, s: Dragged, p_n: Array, normal: slice) -> None:
        """Let points slip, t = s(p_n) e + J (t + gamma (w - gap) - t_hat).

        Here e = t_hat / |t_hat| and J = s/|t_hat| (I - e e^T) + ds/d|t_hat| e e^T, the derivative of the projection
        onto the disc; the last term is that of laws by slip rate.

        Args:
            at: rows of the points (m, c).
            free: (m, c) directions that carry a multiplier.
            trial: t_hat (m, c) [Pa].
            s: bound of the points, and its derivatives.
            p_n: pressures (m_n,) [Pa] at which it is taken.
            normal: rows of p_n.
        """
        self.slips[at] = free
        c, slope = trial.shape[1], s.by_pressure
        length = np.linalg.norm(trial, axis=1)
        e = trial / length[:, None]
        self.rhs[at] = (s.bound - slope @ p_n)[:, None] * e
        point = np.repeat(np.arange(len(at)), np.diff(slope.indptr))
        columns = np.broadcast_to(normal.start + slope.indices[:, None], (len(point), c))
        self.on_p.append(((-e[point] * slope.data[:, None]).ravel(), at[point].ravel(), columns.ravel()))
        drags = s.by_trial.any()
        if c == 1 and not drags:
            return
        along = e[:, :, None] * e[:, None, :]
        J = (s.bound / length)[:, None, None] * (np.eye(c) - along)
        if drags:
            J += s.by_trial[:, None, None] * along
            self.rhs[at] -= (s.by_trial * length)[:, None] * e
        J *= free[:, :, None] & free[:, None, :]
        self.rhs[at] -= np.einsum("mab,mb->ma", J, self.gamma[at] * self.gap[at])  # J t_hat = ds/d|t_hat| t_hat
        i, j = (np.broadcast_to(x, J.shape).ravel() for x in (at[:, :, None], at[:, None, :]))
        self.on_p.append((-J.ravel(), i, j))
        self.on_w.append(((-J * self.gamma[at][:, None, :]).ravel(), i, j))

    def matrix(self, diagonal: Array, entries: list[tuple[Array, Ints, Ints]]) -> Sparse:
        """(rows, rows) with that diagonal and further entries (values, rows, columns)."""
        own = np.flatnonzero(diagonal)
        data, i, j = (np.concatenate(x) for x in zip((diagonal[own], own, own), *entries, strict=True))
        order = np.argsort(i, kind="stable")
        first = np.concatenate([[0], np.cumsum(np.bincount(i, minlength=self.rows))])
        matrix = sparse.csr_matrix((data[order], j[order], first), shape=(self.rows, self.rows))
        matrix.sum_duplicates()  # of the diagonal and J
        return matrix

    def active_set(self, problem: SurfaceProblem) -> ActiveSet:
        A_p = self.matrix(np.where(self.held, 0.0, 1.0), self.on_p)
        A_w = self.matrix(np.where(self.held, self.gamma, -self.k), self.on_w)
        return ActiveSet(problem=problem, k=self.k, held=self.held, slip=self.slips, A_p=A_p, A_w=A_w, rhs=self.rhs)


def linearise(problem: SurfaceProblem, p_hat: Array, gamma: Array) -> ActiveSet:
    """Linearise the complementarity condition p = P_C(p + gamma (w - gap)) at trial tractions.

    Args:
        problem: the contact problem of the step.
        p_hat: trial tractions p + gamma (w - gap) (rows,) [Pa].
        gamma: (rows,) [Pa/m].

    Source: Alart & Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991), of the projection and its derivative.
    """
    return _rows(problem, p_hat, gamma).active_set(problem)


def sets(problem: SurfaceProblem, p_hat: Array, gamma: Array) -> tuple[Array, Array]:
    """Rows (3, rows) that are held, on springs, and slip at trial tractions, see `linearise`; their projection [Pa]."""
    rows = _rows(problem, p_hat, gamma)
    return np.array([rows.held, rows.k > 0, rows.slips]), rows.p


def _rows(problem: SurfaceProblem, p_hat: Array, gamma: Array) -> _Rows:
    cone = problem.cone
    p = cone.project(p_hat, gamma)
    rows = _Rows(cone, p, problem.gap, gamma)
    for place in cone.places:
        n, law = place.normal, place.rows.normal
        slope = law.stiffness(p[n], p_hat[n])
        closed, index = np.isinf(slope), np.arange(n.start, n.stop)
        softness = np.broadcast_to(law.give, closed.shape)
        gives = closed & (softness > 0)
        rows.hold(index[closed & ~gives])
        if gives.any():
            rows.give(index[gives], softness[gives])
        soft = ~closed  # what is open is a spring of no stiffness
        rows.spring(index[soft], slope[soft], p[n][soft] - slope[soft] * law.penetration(p[n])[soft])
    for place in cone.with_friction():
        _friction(rows, place, p_hat, p[place.normal], gamma)
    return rows


def _friction(rows: _Rows, place: ContactBlock, p_hat: Array, p_n: Array, gamma: Array) -> None:
    """Let the points of a contact stick, slip, or carry no friction (s = 0), by their trial tractions."""
    span, free = place.tangential, place.rows.free
    index = np.arange(span.start, span.stop).reshape(free.shape)
    trial = p_hat[span].reshape(free.shape) * free
    length = np.linalg.norm(trial, axis=1)
    tried = Trial(length, gamma[index[:, 0]])
    s = rows.cone.bound(place, p_n, tried)
    softness = place.rows.friction.softness  # type: ignore[union-attr]
    stick = (length <= s * (1 + gamma[index[:, 0]] * softness)) & (s > 0)
    slip = np.flatnonzero(~stick & (s > 0))
    stuck = index[stick[:, None] & free]
    if softness:
        rows.spring(stuck, 1 / softness, 0.0)
    else:
        rows.hold(stuck)
    if len(slip):
        dragged = rows.cone.dragged(place, p_n, tried)
        own = Dragged(dragged.bound[slip], dragged.by_trial[slip], dragged.by_pressure[slip])
        rows.slip(index[slip], free[slip], trial[slip], own, p_n, place.normal)
