"""Path following: the last resort for piecewise-linear contact problems in the plane.

The tractions p and rigid motions b solve F(p, b) = 0, with the natural map p - P_C(p + gamma (w - gap)) in the rows of
contact and the balance R^T (f - B^T p) in the others. In the plane, with unilateral or bilateral contact and Coulomb
friction, F is linear on each of finitely many pieces. A homotopy H(p, b, s) = 0 with a known solution at s = 1 and
F = 0 at s = 0 is then a polygon: it is followed from kink to kink, where one row changes its state (open, closed,
stick, slip either way). The inverse of the Jacobian changes by rank one there; where its determinant changes its sign,
s turns back. No volume solve is needed.

Three homotopies. H = F - s F(z_0) starts at any iterate z_0; nothing is proved of it. H = F with gaps wider by s D
starts with all rows open, as Lemke's method does with the covering vector D. For bodies that supports hold, with
independent rows, it arrives for every coefficient of friction: work on the tractions of a solution, p^T W G p <= p_n^T
W (w_n - gap - s D) + s_t^T W |w_t - gap_t| with the bounds s_t <= mu p_n, shows that solutions are bounded, and that p
= 0 is the only one for s >= 1, if D is large enough; the path that starts there cannot end but at s = 0. It has
finitely many kinks if no two come at once (start and D are perturbed for that), perhaps very many.
A third one is H = F - s F(z_0) with gaps wider by s D such that at s = 1 the problem is that of the state before: the
load grows from that of the state, and a path on which it never falls leads to the solution that goes on from it.

Past s = 0 the second path goes on, and may come back: each time it crosses s = 0 it is at a solution. Their number is
odd. Solutions on closed paths of their own are not found. Below some coefficient of friction the solution of the
discrete problem is unique; above it there may be an odd number of them, or a continuum, and all of them are right.
Nothing in the quasi-static model says which one a body takes.

Source: Katzenelson, Bell Syst. Tech. J. 44 (1965); Lemke, Management Sci. 11 (1965); Eaves, Math. Program. Study 7
(1978), of paths of piecewise-linear maps. Several solutions: Klarbring, Ing.-Arch. 60 (1990), of one node; Hild, Q. J.
Mech. Appl. Math. 57 (2004), of discrete problems.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import CLOSE, EXACT, SLIGHT, Array, Bools, Ints
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.iteration import Solution
from stickslip.solvers.laws.friction import Stick
from stickslip.solvers.newton.attempts import Start, closed
from stickslip.solvers.newton.uniqueness import MOST, critical, proved

OPEN, CLOSED = 0, 1  # states of normal rows
DEAD, STICK, FORWARD, BACKWARD = 2, 3, 4, 5  # states of tangential rows; dead: the friction bound is zero or less
SOFT = (1e-6, 1e-9, 1e-12)  # springs that hold floating bodies, relative to the bodies' own stiffness
KINKS = (150, 600, 3000)  # budgets of paths from iterates, one after the other
MOST_KINKS = 20000  # of the path from all open
REFRESH = 40  # kinks after which the inverse is computed anew


def applies(problem: SurfaceProblem) -> bool:
    """Whether the problem is piecewise linear: in the plane, pressures and bounds proportional to what causes them."""
    if not isinstance(problem.surface, CondensedSurface) or not problem.cone.homogeneous:
        return False
    return all(place.components == 1 and not isinstance(place.rows.friction, Stick) for place in problem.cone.places)


def ends(problem: SurfaceProblem, p: Array, best: Solution) -> Iterator[Start]:
    """Ends of paths from the best iterate, the tractions p (rows,) [Pa] of the last step, all closed, and all open."""
    if not applies(problem):
        return
    nowhere = np.zeros_like(best.u_c)
    for attempt, kinks in enumerate(KINKS):
        for at, u_c in ((best.p, best.u_c), (p, best.u_c), (closed(problem), nowhere)):
            yield from path_from(problem, at, u_c, kinks, seed=attempt)
    if not problem.surface.floating:
        yield from path_from_open(problem, MOST_KINKS)
        return
    for soft in SOFT:
        yield from islice(path_from_open(problem, KINKS[-1], soft), 1)


def path_from(problem: SurfaceProblem, p: Array, u_c: Array, kinks: int, seed: int = 0) -> Iterator[Start]:
    """The end of the path H = F - s F(z_0), if it arrives.

    Args:
        problem: the contact problem of the step.
        p: tractions (rows,) [Pa] of z_0.
        u_c: displacement (c,) [m] of z_0; of it only the rigid motions matter.
        kinks: their largest number.
        seed: of the perturbation of z_0.
    """
    maps = _Map.of(problem)
    # of tractions and gaps at the start, against kinks that come at once
    away = CLOSE * problem.p_ref * np.random.default_rng(seed).standard_normal(len(p))
    p = np.where(problem.cone.carrying, p + away, 0.0)
    yield from _follow(maps, p, problem.surface.R.T @ u_c, np.zeros_like(p), kinks)


def path_from_open(problem: SurfaceProblem, kinks: int, soft: float = 0.0) -> Iterator[Start]:
    """The end of the path H = F with gaps wider by s D, from all rows open.

    For bodies that supports hold it arrives, but perhaps after more `kinks` than are allowed. Floating bodies are held
    by soft springs: if they rest, then the end is near to their solution.

    Args:
        problem: the contact problem of the step.
        kinks: their largest number.
        soft: stiffness of springs on the rigid motions, relative to that of the bodies; 0: none.
    """
    maps, zero, n = _Map.of(problem, soft), np.zeros(len(problem.gap)), problem.surface.normal_rows
    if np.any(maps.two_sided):
        return
    b = problem.load.resultant / maps.spring if maps.spring else np.zeros(0)
    W, free = problem.surface.W, maps.w_0 + maps.C @ b - problem.gap
    rubbed = (np.maximum(maps.bound, 0.0).T @ (W * np.abs(free)) / W)[:n]
    room = float(np.maximum(free[:n] + rubbed, 0.0).max(initial=0.0)) + problem.p_ref / float(problem.gamma.max())
    wider = zero.copy()
    wider[:n] = room * (1 + 0.1 * np.random.default_rng(0).random(n))
    yield from _follow(maps, zero, b, wider, kinks)


def continued(problem: SurfaceProblem, p: Array, w: Array, found: Solution) -> tuple[Start | None, bool]:
    """Whether a solution is the one that the state before leads to while the load grows from that of the state.

    Args:
        problem: the contact problem of the step.
        p: tractions (rows,) [Pa] of the state before.
        w: its relative displacement (rows,) [m].
        found: a solution.

    Returns:
        Another solution that it leads to, or None; and whether it jumps: no solution goes on from the state without a
        fall of the load.
    """
    rubs = any(True for _ in problem.cone.with_friction())
    if not rubs or len(p) > MOST or problem.p_ref == 0 or not applies(problem) or _falls(problem, p) or proved(problem):
        return None, False
    r = standing(problem, p, w)
    size = max(problem.scales.of_tractions(p), problem.scales.of_tractions(found.p))
    if _in_one_piece(problem, (p, r), (found.p, found.w - problem.gap), CLOSE * size):
        return None, False
    maps = _Map.of(problem)
    away = CLOSE * size * np.random.default_rng(0).standard_normal(len(p))
    at = np.where(problem.cone.carrying, p + away, 0.0)
    try:
        path = _Path(maps, at, np.zeros(len(maps.H)), maps.w_0 - maps.G @ at - problem.gap - r)
        end = next(path.solutions(FOLLOWED), None)
    except np.linalg.LinAlgError:  # a row is at a kink, or nothing holds a body there
        return None, False
    if end is None or np.abs(end.p - found.p).max(initial=0.0) <= SLIGHT * size:
        return None, path.turned
    return end, path.turned


def _falls(problem: SurfaceProblem, p: Array) -> bool:
    """Whether rows with tractions p (rows,) [Pa] cannot hold a body: it goes all the way under the least load."""
    surface, force = problem.surface, problem.load.resultant
    held = np.asarray(surface.N @ surface.R)[p != 0].T
    left = force - held @ np.linalg.lstsq(held, force, rcond=None)[0]
    return bool(np.abs(left).max(initial=0.0) > CLOSE * np.abs(force).max(initial=0.0))


def standing(problem: SurfaceProblem, p: Array, w: Array) -> Array:
    """Return w - gap (rows,) [m] of the state before, with tractions p (rows,) [Pa].

    Slip counts from where the state is, of points without friction from where the problem counts it: they may close.
    """
    n, r, away = problem.surface.normal_rows, problem.cone.give(p), w - problem.gap
    r[:n] += np.where(p[:n] == 0, np.minimum(away[:n], 0.0), 0.0)
    for place in problem.cone.with_friction():
        t, none = place.tangential, problem.cone.bound(place, p[place.normal]) == 0
        r[t] = np.where(np.repeat(none, place.components), away[t], r[t])
    return r


def _in_one_piece(
    problem: SurfaceProblem, before: tuple[Array, Array], after: tuple[Array, Array], slight: float
) -> bool:
    """Whether F is linear between two pairs of tractions and w - gap (rows,): then the path is straight.

    Args:
        slight: traction [Pa] that is none.
    """
    trials = [p + problem.gamma * r for p, r in (before, after)]
    for place in problem.cone.places:
        (start, end), law = (trial[place.normal] for trial in trials), place.rows.normal
        if law.sides == 1 and np.any(np.where(end > 0, start < -slight, start > slight)):
            return False
        if place.rows.friction is None:
            continue
        s, s_end = (problem.cone.bound(place, np.maximum(p[place.normal], 0.0)) for p, _ in (before, after))
        start, end = (trial[place.tangential] for trial in trials)
        slips = np.abs(end) > s_end
        if np.any(np.where(slips, np.sign(end) * start < s - slight, np.abs(start) > s + slight)):
            return False
    return True


def _follow(maps: _Map, p: Array, b: Array, wider: Array, kinks: int) -> Iterator[Start]:
    try:
        yield from _Path(maps, p, b, wider).solutions(kinks)
    except np.linalg.LinAlgError:  # it starts where a row is at a kink, or where nothing holds a body
        return


@dataclass(frozen=True, kw_only=True)
class _Map:
    """The natural map F of a piecewise-linear problem. Unknowns: tractions on the `carrying` rows, rigid motions b."""

    problem: SurfaceProblem
    w_0: Array  # (rows,) w at p = 0, b = 0 [m]
    G: Array  # (rows, rows) w = w_0 - G p + C b [m/Pa]
    C: Array  # (rows, r)
    H: Array  # (r, rows) R^T B^T: balance is R^T f - H p = 0
    bound: Array  # (rows, rows) friction bounds s = bound @ p [-]
    share: Array  # (rows,) of the trial traction that a closed or sticking row takes: 1 without compliance
    normal: Bools  # (rows,)
    two_sided: Bools  # (rows,) normal rows that are always closed
    rows: Ints  # (m,) that may carry a traction
    spring: float  # on the rigid motions [N/m]

    @staticmethod
    def of(problem: SurfaceProblem, soft: float = 0.0) -> _Map:
        surface, cone = condensed(problem.surface), problem.cone
        count = len(problem.gap)
        force = sparse.csr_matrix(surface.N.T @ sparse.diags(surface.W))  # of unit tractions
        bound, share = np.zeros((count, count)), 1 / (1 + problem.gamma * cone.softness)
        normal, two_sided, rubs = (np.zeros(count, bool) for _ in range(3))
        for place in cone.places:
            n, t = place.normal, place.tangential
            one = np.ones(n.stop - n.start)
            normal[n], two_sided[n] = True, place.rows.normal.sides == 2
            share[n] = place.rows.normal.resolvent(one, problem.gamma[n])
            if place.rows.friction is not None:
                bound[t, n], rubs[t] = cone.bound_slope(place, one).toarray(), True
        return _Map(
            problem=problem,
            w_0=problem.relative_displacement(surface.flexibility @ problem.load.f_c),
            G=surface.flexibility.between(surface.N, force),
            C=np.asarray(surface.N @ surface.R),
            H=surface.R.T @ (surface.N.T.toarray() * surface.W),
            bound=bound,
            share=share,
            normal=normal,
            two_sided=two_sided,
            rows=np.flatnonzero(cone.carrying & (normal | rubs)),
            spring=soft * surface.rho,
        )

    def trial(self, p: Array, b: Array, wider: Array) -> Array:
        """Trial tractions (rows,) [Pa], gaps wider by `wider` (rows,) [m]."""
        r = self.w_0 - self.G @ p + self.C @ b - self.problem.gap - wider
        return np.asarray(self.share * (p + self.problem.gamma * r))

    def states(self, trial: Array, s: Array) -> Ints:
        """State of each row (rows,) at trial tractions and bounds s (rows,) [Pa]."""
        rubbing = np.select([s <= 0, np.abs(trial) <= s, trial > 0], [DEAD, STICK, FORWARD], BACKWARD)
        return np.where(self.normal, np.where(self.two_sided | (trial > 0), CLOSED, OPEN), rubbing)

    def value(self, p: Array, b: Array, trial: Array, state: Ints) -> Array:
        """F (m + r,) at an iterate whose rows are in the given states."""
        s = self.bound @ p
        follows = (state == CLOSED) | (state == STICK)
        P = np.select([follows, state == FORWARD, state == BACKWARD], [trial, s, -s], 0.0)
        return np.concatenate([(p - P)[self.rows], self.problem.load.resultant - self.H @ p - self.spring * b])

    def gradient(self, row: int, state: int) -> Array:
        """Gradient (m + r,) of F in one row of that state."""
        by_p, by_b = np.zeros(len(self.share)), np.zeros(self.C.shape[1])
        by_p[row] = 1.0
        if state in (CLOSED, STICK):
            weight = self.share[row] * self.problem.gamma[row]
            by_p[row] -= self.share[row]
            by_p += weight * self.G[row]
            by_b -= weight * self.C[row]
        elif state in (FORWARD, BACKWARD):
            by_p += self.bound[row] * (-1.0 if state == FORWARD else 1.0)
        return np.concatenate([by_p[self.rows], by_b])

    def jacobian(self, state: Ints) -> Array:
        """(m + r, m + r)."""
        balance = np.hstack([-self.H[:, self.rows], -self.spring * np.eye(len(self.H))])
        return np.vstack([*(self.gradient(i, state[i]) for i in self.rows), balance])


class _Path:
    """The polygon H(z, s) = 0 from s = 1 to s = 0, and where on it we are."""

    def __init__(self, maps: _Map, p: Array, b: Array, wider: Array) -> None:
        """
        Args:
            maps: F.
            p: tractions (rows,) [Pa] at s = 1.
            b: rigid motions (r,) [m] at s = 1.
            wider: D (rows,) [m], by which gaps are wider at s = 1.
        """
        self.map, self.p, self.b, self.wider = maps, p.copy(), b.copy(), wider
        self.s, self.direction = 1.0, -1.0
        self.trial = maps.trial(p, b, wider)
        self.bounds = maps.bound @ p
        self.state = maps.states(self.trial, self.bounds)
        self.turned = False  # whether s has grown on the way
        self.at_start = maps.value(p, b, self.trial, self.state)  # F(z_0)
        self.inverse = np.linalg.inv(maps.jacobian(self.state))
        self.crossed: tuple[int, int] | None = None  # row that changed its state last, and its state before

    def solutions(self, kinks: int) -> Iterator[Start]:
        """Follow the path and yield where it crosses s = 0, until it leads away, or has had that many kinks."""
        for kink in range(1, kinks + 1):
            z = -self.direction * (self.inverse @ self._by_s())  # dz along the path, for |ds| = 1
            dp = np.zeros_like(self.p)
            m = len(self.map.rows)
            dp[self.map.rows], db = z[:m], z[m:]
            step, row, to = self._next_kink(dp, db)
            if 0 < -self.s * self.direction <= step:
                yield self._at(*self._exact())
            if not np.isfinite(step):
                return
            self._move(step, dp, db)
            if self.s > 2.0 or not self._change(row, to):  # it leads away
                return
            if kink % REFRESH == 0:
                self._correct()

    def _by_s(self) -> Array:
        """dH/ds (m + r,)."""
        maps = self.map
        follows = ((self.state == CLOSED) | (self.state == STICK))[maps.rows]
        push = (maps.share * maps.problem.gamma * self.wider)[maps.rows]
        return np.asarray(np.append(np.where(follows, push, 0.0), np.zeros(len(maps.H))) - self.at_start)

    def _next_kink(self, dp: Array, db: Array) -> tuple[float, int, int]:
        """Distance to the next kink, the row that changes there, and its next state."""
        maps, state, trial, s = self.map, self.state, self.trial, self.bounds
        dr = -maps.G @ dp + maps.C @ db - self.direction * self.wider
        dt, ds = maps.share * (dp + maps.problem.gamma * dr), maps.bound @ dp
        carrying = np.zeros(len(dp), bool)
        carrying[maps.rows] = True
        sign = np.where(trial > 0, FORWARD, BACKWARD)
        kinds = (  # rows in a state, what stays positive in it, its change, the state after
            (carrying & (state == OPEN), -trial, -dt, CLOSED),
            (carrying & (state == CLOSED) & ~maps.two_sided, trial, dt, OPEN),
            (carrying & (state == DEAD), -s, -ds, sign),
            (carrying & (state == STICK), s - trial, ds - dt, FORWARD),
            (carrying & (state == STICK), s + trial, ds + dt, BACKWARD),
            (carrying & (state == FORWARD), trial - s, dt - ds, STICK),
            (carrying & (state == BACKWARD), -trial - s, -dt - ds, STICK),
            (carrying & ((state == FORWARD) | (state == BACKWARD)), s, ds, DEAD),
        )
        best: tuple[float, int, int] = np.inf, -1, -1
        for rows, value, change, after in kinds:
            index = np.flatnonzero(rows & (change < 0))
            after = np.broadcast_to(after, len(dp))
            if self.crossed is not None and len(index):  # it does not go straight back
                row, before = self.crossed
                index = index[~((index == row) & (after[index] == before))]
            if len(index):
                distance = np.maximum(value[index], 0.0) / -change[index]
                k = int(np.argmin(distance))
                best = min(best, (float(distance[k]), int(index[k]), int(after[index[k]])))
        return best

    def _move(self, step: float, dp: Array, db: Array) -> None:
        self.p += step * dp
        self.b += step * db
        self.s += self.direction * step
        self._evaluate()

    def _evaluate(self) -> None:
        self.trial = self.map.trial(self.p, self.b, self.s * self.wider)
        self.bounds = self.map.bound @ self.p

    def _change(self, row: int, to: int) -> bool:
        """Let a row change its state: update the inverse, and turn s where the determinant changes its sign."""
        a = int(np.searchsorted(self.map.rows, row))
        by_row = (self.map.gradient(row, to) - self.map.gradient(row, int(self.state[row]))) @ self.inverse
        ratio = 1 + by_row[a]  # of the determinants
        if abs(ratio) < EXACT:  # relative change of the determinant that counts as zero
            return False
        self.crossed = row, int(self.state[row])
        self.state[row] = to
        self.inverse -= np.outer(self.inverse[:, a], by_row / ratio)
        if ratio < 0:
            self.direction = -self.direction
            self.turned = True
        return True

    def _exact(self) -> tuple[Array, Array]:
        """Tractions (rows,) [Pa] and rigid motions (r,) [m] at s = 0 on this piece, without the rounding of the way."""
        maps, state, p = self.map, self.state, self.p.copy()
        off = maps.value(p, self.b, maps.trial(p, self.b, np.zeros_like(p)), state)
        z, m = np.linalg.solve(maps.jacobian(state), off), len(maps.rows)
        p[maps.rows] -= z[:m]
        return p, self.b - z[m:]

    def _correct(self) -> None:
        """Compute the inverse anew, and return to the path, which rounding has left a little."""
        maps = self.map
        self.inverse = np.linalg.inv(maps.jacobian(self.state))
        z = self.inverse @ (self.s * self.at_start - maps.value(self.p, self.b, self.trial, self.state))
        self.p[maps.rows] += z[: len(maps.rows)]
        self.b += z[len(maps.rows) :]
        self._evaluate()

    def _at(self, p: Array, b: Array) -> Start:
        problem, surface = self.map.problem, condensed(self.map.problem.surface)
        u_c = surface.flexibility @ (problem.load.f_c - surface.forces(p)) + surface.R @ b
        return Start.at(problem, p, u_c)


FOLLOWED = 2000  # kinks of a path that is followed for other solutions


def others(
    problem: SurfaceProblem, p: Array, keeps: Callable[[Array, Array], bool] = lambda p, w: True
) -> Iterator[Array]:
    """Tractions (rows,) [Pa] of solutions that differ from p, on the path from all open; none where it does not apply.

    It finds no others of floating bodies, of curved laws, in 3D, off this path, or where there are many rows.

    Args:
        problem: the contact problem of the step.
        p: tractions (rows,) [Pa] that solve it.
        keeps: whether tractions (rows,) [Pa] and relative displacement (rows,) [m] have the laws of the problem.
    """
    if not applies(problem) or critical(problem) > 1:
        return
    known = [p]
    for found in path_from_open(problem, FOLLOWED):
        w = problem.relative_displacement(found.u_c)
        # natural residual of another solution: it is the end of a path, not iterated
        if problem.natural_residual(found.p, w) > CLOSE or not keeps(found.p, w):
            continue
        size = max(problem.scales.of_tractions(found.p), problem.scales.of_tractions(p))
        # of the largest traction: solutions that differ by less are one
        if all(np.abs(found.p - one).max(initial=0.0) > SLIGHT * size for one in known):
            known.append(found.p)
            yield found.p
