"""A clock: slip and state of rate-and-state friction flow in steps by their error, by an embedded Runge-Kutta pair.

Bodies answer slip at once: w = w_free(t) - D W p with the Delassus matrix D, so that tractions of closed points follow
from their slip by one dense product. These give rates, f(V, theta) p_n + eta V = |t|, and rates the slip and state:

    dw_T/dt = V t / |t|,    d ln(theta)/dt = 1 / theta - V / Dc, or the slip law.

A point that opens, or closes, ends a stretch; then tractions are those of other points. Before anything presses a step
is solved like any other. Dissipation is integrated too, and what drives the bodies has brought it and what they store.

Where more steps than there are unknowns are as long as stability allows, the system is stiff, and an implicit pair goes
on up to the next event: bodies that are much stiffer than friction slide as they are driven, in steps of any size.

Source: Dormand & Prince, J. Comput. Appl. Math. 6 (1980), of the pair, by `scipy.integrate.RK45`; Hairer & Wanner,
Solving Ordinary Differential Equations II, Springer (1996), of stiffness and of the implicit pair, by
`scipy.integrate.Radau`; Lapusta et al., J. Geophys. Res. 105 (2000), of steps that follow the slip; Erickson et al.,
Seismol. Res. Lett. 91 (2020), of problems.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
from scipy.linalg import inv
from scipy.optimize import brentq

from stickslip.geometry.arrays import EPS, EXACT, HALF_DIGITS, ROUNDING, TINY, Array, Bools
from stickslip.geometry.errors import SolverError
from stickslip.solvers.contact.admissible_set import ContactBlock
from stickslip.solvers.iteration import Correction, Solution, Status
from stickslip.solvers.laws.rate_and_state import RateAndStateByPoint
from stickslip.solvers.scene.record import Energy, Event
from stickslip.solvers.scene.settings import Clock
from stickslip.solvers.stepping.law_memory import with_memory
from stickslip.solvers.stepping.state import State, StepControl
from stickslip.solvers.stepping.substep import Attempt, Substep, SubstepSolver, unsolved

SETTLING = 50  # changes of the points that touch at one time, at the most
STABLE = 2.9  # times the largest decay: a step of the pair that stability holds back keeps within this and 3.7
ROUGHEST = 100 * EPS  # relative error that the pair takes as the least, of slips that are long beside Dc


class ClockLoop:
    """Follows a step by the clock in place of substeps that are solved.

    One that pauses ends the step early, where an event begins or ends, or after `every` steps.
    """

    def __init__(self, solver: SubstepSolver, clock: Clock | None, pauses: bool) -> None:
        """
        Args:
            solver: of the bodies; its pairs do not change.
            clock: of the scene; None: it has none.
            pauses: whether a step may end early.
        """
        self._solver, self._clock, self._pauses = solver, clock, pauses

    def active(self) -> bool:
        """Whether the scene has a clock."""
        return self._clock is not None

    def around(self, inner: Substep) -> Substep:
        def followed(start: State, target: float) -> Attempt:
            if not start.p.any() or target <= start.time:
                return inner(start, target)
            assert self._clock is not None
            try:
                return _March(self._solver, self._clock, start, target, self._pauses)()
            except (SolverError, np.linalg.LinAlgError) as error:
                return _given_up(self._solver, start, start.time, str(error))

        return followed


@dataclass(frozen=True)
class _Flow:
    """A contact whose slip and state flow, and its entries in what is integrated."""

    place: ContactBlock
    law: RateAndStateByPoint
    slip: slice  # its w_T (m_t c,)
    aged: slice  # its ln(V0 theta / Dc) (m_t,)
    index: int  # of the contact

    def speeds(self, rates: Array) -> Array:
        """Slip rates (m_t,) [m/s] among those of all that is integrated."""
        return np.asarray(np.linalg.norm(rates[self.slip].reshape(-1, self.place.components), axis=1))

    def moves(self, at: Array) -> tuple[Array, Array]:
        """Slip rates and d ln(theta) / dt of each point (m_t, c + 1), and its work by area [W/m²].

        Args:
            at: ln(V0 theta / Dc), tractions along the contact [Pa], and pressure [Pa] (m_t, c + 2).
        """
        aged, t, pressure = at[:, 0], at[:, 1:-1], np.maximum(at[:, -1], 0.0)
        size = np.linalg.norm(t, axis=1)
        V = self.law.rate(aged, size, pressure)
        slips = (V / np.maximum(size, TINY))[:, None] * t
        return np.column_stack([slips, self.law.evolves(aged, V)]), size * V

    def at(self, p: Array, aged: Array) -> Array:
        """What `moves` is a function of, at tractions p (rows,) [Pa] and states (m_t,)."""
        t = p[self.place.tangential].reshape(-1, self.place.components)
        return np.column_stack([aged, t, self.place.average @ p[self.place.normal]])

    def fastest(self, rates: Array) -> float:
        """The largest of them, at least the smallest number."""
        return max(float(self.speeds(rates).max(initial=0.0)), TINY)


@cache
def _pairs() -> tuple[Any, Any]:
    """The embedded pair, whose error is the largest of all entries, not their mean; and the implicit one."""
    from scipy.integrate import RK45, Radau  # late: they load much else

    class Pair(RK45):  # type: ignore[misc]  # scipy has no types
        def _estimate_error_norm(self, K: Array, h: float, scale: Array) -> float:
            return float(np.abs(self._estimate_error(K, h) / scale).max())

        def asked_by_stability(self) -> float:
            """Steps that stability asks for in the last one, by its last two stages, which lie at one time; at most 2.

            Where it holds steps back they grow and fall about its limit: it asks for three in four of them or more.
            """
            apart = self.y - self.y_old - self.step_size * (self.K[:5].T @ self.A[5])
            turns = self.step_size * (self.K[6] - self.K[5])
            size, limit = (float(np.linalg.norm(x / self.atol)) for x in (turns, STABLE * apart))
            return min(size / max(limit, TINY), 2.0)

    return Pair, Radau


class _March:
    """One step of a clock: from a state to a time."""

    def __init__(self, solver: SubstepSolver, clock: Clock, start: State, target: float, pauses: bool) -> None:
        """See how loads and motions change up to the end; collective.

        Args:
            start: state that the step starts from.
            target: time at its end [s].
            pauses: whether it may end before.
        """
        self._solver, self._clock, self._start, self._target = solver, clock, start, target
        self._most = np.inf if not pauses else clock.every or np.inf
        self._pauses, self._events, self._running = pauses, list[Event](), dict(start.running)
        self._posed = solver.posed(start, target)
        problem, self._flows, at = self._posed[0], list[_Flow](), 0
        self._n = solver.surface.normal_rows
        for index, (place, c) in enumerate(zip(problem.cone.places, solver.cone.contacts, strict=True)):
            if isinstance(law := c.friction, RateAndStateByPoint):
                ends = np.cumsum([at, c.free.size, len(c.W_t)]).tolist()
                self._flows.append(_Flow(place, law, slice(*ends[:2]), slice(*ends[1:]), index))
                at = ends[-1]
        self._works = at
        self._free, self._D = self._motion(), solver.surface.delassus
        bilateral = [np.full(len(c.W_n), c.normal.sides == 2) for c in problem.cone.contacts]
        self._held: Bools = np.concatenate(bilateral)
        self._closed, self._p, self._acts = self._held, start.p, None

    def _motion(self) -> Callable[[float], tuple[Array, Array]]:
        """w without contact, and gaps (rows,) [m] by time: a line between both ends, where it is one; collective."""
        begin, end = self._start.time, self._target

        def exactly(time: float) -> Array:
            problem = self._solver.posed(self._start, time)[0]
            u_c = problem.contact_displacement(np.zeros_like(problem.gap))  # of the load, `free` is the scale alone
            return np.array([problem.relative_displacement(u_c), problem.gap])

        first, middle, last = (exactly(t) for t in (begin, (begin + end) / 2, end))
        slope = (last - first) / (end - begin)
        if np.abs(first + last - 2 * middle).max() > ROUNDING * np.abs([first, last]).max():
            return lambda time: tuple(exactly(time))
        return lambda time: tuple(first + (time - begin) * slope)

    def __call__(self) -> Attempt:
        """Integrate from stretch to stretch, each with the same points closed; collective."""
        start, clock, steps = self._start, self._clock, 0
        size = clock.smallest if np.isinf(start.control.size) else start.control.size
        y = np.zeros(self._works + len(self._solver.cone.contacts))
        allowed = np.full(len(y), np.inf)
        for flow in self._flows:
            y[flow.slip] = start.w[flow.place.tangential]
            y[flow.aged] = start.memory[flow.place.rows.name][:, 0]
            allowed[flow.slip] = clock.error * np.repeat(flow.law.Dc, flow.place.components)
            allowed[flow.aged] = clock.error
        held_back = start.control.easy  # steps that stability asked for, less half of those that were made
        time, last, closed = start.time, 0.0, (start.p[: self._n] > 0) | self._held
        while time < self._target:
            if not self._settles(time, y, closed):
                return _given_up(self._solver, self._start, time, "points open and close without end")
            pair = self._pair(self._stiff(held_back), time, y, allowed, size)
            while time < self._target and (self._shut(time) == self._closed).all():
                tried = pair.h_abs
                with np.errstate(all="ignore"):  # of what is tried and not taken
                    pair.step()
                if pair.status == "failed" or (pair.h_abs < clock.smallest and pair.status == "running"):
                    return _given_up(
                        self._solver,
                        self._start,
                        pair.t,
                        f"its error asks for steps below smallest = {clock.smallest:g} s",
                    )
                last, time, y, steps = pair.step_size, pair.t, pair.y, steps + 1
                self._solver.chain.history.tick(time, steps, self._solver.system.counters.volume_solves)
                size = max(pair.h_abs, tried) if pair.status == "finished" else pair.h_abs
                changes = [self._notice(flow, pair) for flow in self._flows]
                implicit = self._stiff(held_back)
                if any(changes):
                    held_back = 0.0
                elif not implicit:
                    held_back = max(held_back + pair.asked_by_stability() - 0.5, 0.0)
                if self._stiff(held_back) != implicit and time < self._target:
                    pair = self._pair(not implicit, time, y, allowed, size)
                if (self._pauses and any(changes)) or steps >= self._most:
                    return self._ended(time, y, last, max(steps, 2), StepControl(size, held_back))
            closed = self._shut(time)
        return self._ended(time, y, last, max(steps, 2), StepControl(size, held_back))

    def _stiff(self, held_back: float) -> bool:
        """Whether an implicit pair is cheaper: so many steps cost as much as several of its matrices."""
        return self._works < held_back

    def _pair(self, stiff: bool, time: float, y: Array, allowed: Array, size: float) -> Any:
        """What integrates from a time on.

        Args:
            stiff: whether by an implicit pair, which no stability holds back, at the price of a dense matrix.
            time: where it begins [s].
            y: what it begins with, see `_rates`.
            allowed: errors of its entries in a step.
            size: of the first step [s].
        """
        make = partial(_pairs()[stiff], self._rates, time, y, self._target, self._clock.largest, ROUGHEST,
                       first_step=min(size, self._target - time))  # fmt: skip
        if not stiff:
            return make(allowed)
        allowed = allowed.copy()
        for flow in self._flows:  # little slip of stiff bodies changes the rate as much as an error of the state does
            place, c = flow.place, flow.place.components
            turns = np.repeat(flow.law.a * (place.average @ self._p[place.normal]), c)  # [Pa] of e times the rate
            slips = np.where(turns > 0, turns * np.diagonal(self._D)[place.tangential], np.inf)
            allowed[flow.slip] = np.minimum(allowed[flow.slip], self._clock.error * slips)
        allowed = allowed / np.sqrt(len(y))  # its error is a mean
        return make(allowed, jac=self._slopes)

    def _notice(self, flow: _Flow, pair: Any) -> bool:
        """Note whether an event of a contact begins or ends in the last step.

        The moment is the root of ln(V / threshold) in the pair's own interpolation of order 4.
        """
        name, threshold = flow.place.rows.name, self._clock.event
        began, fast = self._running.get(name), flow.fastest(pair.f)
        least = threshold if began is None else threshold / 10
        if began is not None:
            began = self._running[name] = {**began, "rate": np.maximum(began["rate"], fast)}
        if (fast >= least) == (began is not None):
            return False
        inside, kept = pair.dense_output(), self._p

        def above(time: float) -> float:
            return float(np.log(flow.fastest(self._rates(time, inside(time))) / least))

        turns = above(pair.t_old) * above(pair.t) < 0
        time = brentq(above, pair.t_old, pair.t, xtol=EXACT * pair.t) if turns else pair.t_old
        y = inside(time)
        at = np.array(flow.speeds(self._rates(time, y)).argmax())
        now = {"start": np.array(time), "slip": y[flow.slip], "p": self._p, "rate": np.array(fast), "at": at}
        self._p = kept
        if began is None:
            self._running[name] = now
            return True
        self._events.append(self._event(flow, self._running.pop(name), now))
        return True

    def _event(self, flow: _Flow, began: Mapping[str, Array], now: Mapping[str, Array]) -> Event:
        """An event that is over.

        Args:
            began, now: when it began and when it ended, with slip [m] and tractions (rows,) [Pa] there.
        """
        rows, place, n = flow.place.rows, flow.place, flow.place.components
        slip = np.linalg.norm((now["slip"] - began["slip"]).reshape(-1, n), axis=1)
        before, after = (np.linalg.norm(p[place.tangential].reshape(-1, n), axis=1) for p in (began["p"], now["p"]))
        area, problem = float(rows.W_t @ slip), self._solver.system.problem
        assert rows.fields is not None
        at = (rows.fields.to_tangential @ rows.fields.points)[int(began["at"])]
        return Event(
            contact=rows.name,
            start=float(began["start"]),
            end=float(now["start"]),
            moment=problem.bodies[problem.pairs[rows.name].bodies[0]].shear_modulus * area,
            drop=float(rows.W_t @ (slip * (before - after))) / area,
            slip=float(slip.max()),
            rate=float(began["rate"]),
            place=tuple(at.tolist()),
        )

    def _settles(self, time: float, y: Array, closed: Bools) -> bool:
        """Whether the points that touch are found, from `closed`; those that come to touch stand where they are."""
        for _ in range(SETTLING):
            acts = np.concatenate([closed, np.zeros(len(self._D) - self._n, bool)])
            for place in self._posed[0].cone.with_friction():
                near = place.average @ closed[place.normal] > 0
                acts[place.tangential] = (near[:, None] & place.rows.free).ravel()
            if self._acts is not None:
                w = self._free(time)[0] - self._D @ self._p
                for flow in self._flows:
                    new = (acts & ~self._acts)[flow.place.tangential]
                    y[flow.slip][new] = w[flow.place.tangential][new]
            self._closed, self._acts, self._stiffness = closed, acts, inv(self._D[np.ix_(acts, acts)])
            self._rates(time, y)
            closed = self._shut(time)
            if (closed == self._closed).all():
                return True
        return False

    def _shut(self, time: float) -> Bools:
        """Normal points (m_n,) that press or overlap at a time, by the tractions found last."""
        found = self._held | (self._closed & (self._p[: self._n] > 0))
        if not self._closed.all():
            free, gap = self._free(time)
            found |= ~self._closed & ((free - self._D @ self._p > gap)[: self._n])
        return np.asarray(found)

    def _rates(self, time: float, y: Array) -> Array:
        """dy/dt; the tractions (rows,) [Pa] are kept.

        Args:
            time: [s].
            y: w_T [m] and ln(V0 theta / Dc) of the contacts, one after the other; then their dissipation [J].
        """
        (free, w), found = self._free(time), np.zeros_like(y)
        w = np.concatenate([w[: self._n], self._start.w[self._n :]])
        for flow in self._flows:
            w[flow.place.tangential] = y[flow.slip]
        self._p = np.zeros(len(w))
        self._p[self._acts] = self._stiffness @ (free - w)[self._acts]
        for flow in self._flows:
            moves, work = flow.moves(flow.at(self._p, y[flow.aged]))
            found[flow.slip], found[flow.aged] = moves[:, :-1].ravel(), moves[:, -1]
            found[self._works + flow.index] = flow.place.rows.W_t @ work
        return found

    def _slopes(self, time: float, y: Array) -> Array:
        """d(dy/dt)/dy: differences of what each point does, times the bodies' stiffness; the tractions stay.

        What is dissipated follows from all else.
        """
        kept, _, acts = self._p, self._rates(time, y), np.asarray(self._acts)
        p, self._p = self._p, kept
        J, by_y = np.zeros((len(y), len(y))), np.zeros((len(p), len(y)))  # by_y: dp/dy
        for flow in self._flows:
            by_y[flow.place.tangential, flow.slip] = np.eye(flow.slip.stop - flow.slip.start)
        by_y[acts] = -self._stiffness @ by_y[acts]
        by_y[~acts] = 0.0
        for flow in self._flows:
            place, points, at = flow.place, len(flow.law.a), flow.at(p, y[flow.aged])
            aged = np.zeros((points, len(y)))
            aged[:, flow.aged] = np.eye(points)
            t = by_y[place.tangential].reshape(points, -1, len(y)).swapaxes(0, 1)
            turns = np.where(at[:, -1] > 0, flow.law.a * at[:, -1], 1.0)  # [Pa]
            for k, inner in enumerate([aged, *t, place.average @ by_y[place.normal]]):
                change = np.zeros_like(at)
                change[:, k] = HALF_DIGITS * (turns if k else 1.0)
                slope = (flow.moves(at + change)[0] - flow.moves(at)[0]) / change[:, k, None]
                J[flow.slip] += (slope[:, :-1, None] * inner[:, None]).reshape(-1, len(y))
                J[flow.aged] += slope[:, -1:] * inner
        return J

    def _ended(self, time: float, y: Array, last: float, steps: int, control: StepControl) -> Attempt:
        """The state at the end of the step; collective.

        Args:
            last: length of the last step of the clock [s]: its slip is that of the step in which points slip.
        """
        start = self._start
        problem, u_s, load = self._posed if time == self._target else self._solver.posed(start, time)
        rates, memory, gap = self._rates(time, y), dict(start.memory), problem.gap.copy()
        for flow in self._flows:
            memory[flow.place.rows.name] = np.column_stack([y[flow.aged], flow.speeds(rates)])
            gap[flow.place.tangential] = y[flow.slip] - last * rates[flow.slip]
        cone = with_memory(self._solver.cone.at(time), memory)
        problem, u_c = replace(problem, cone=cone, gap=gap), problem.contact_displacement(self._p)
        w = problem.relative_displacement(u_c)
        solution = Solution(p=self._p, w=w, u_c=u_c, status=Status.CONVERGED,
                            residual=problem.natural_residual(self._p, w), history=())  # fmt: skip
        tried = Attempt(solver=self._solver, begin=start, solution=solution, problem=problem, substeps=steps,
                        volume_solves=self._solver.system.counters.volume_solves)  # fmt: skip
        tried = self._solver.ended(tried, start, u_s, load, memory)
        if tried.state is None:
            return tried
        none = Correction.none(len(gap))  # nothing is iterated
        before, stored, lost = start.energy, tried.state.energy.stored, y[self._works :]
        energy = Energy(
            external=before.external + stored - before.stored + float(lost.sum()),
            stored=stored,
            contact=before.contact + float(lost.sum()),
            compliance=before.compliance,
            dissipation=before.dissipation + lost,
        )
        new = replace(tried.state, energy=energy, control=control, correction=none)
        return replace(tried, state=replace(new, events=tuple(self._events), running=self._running))


def _given_up(solver: SubstepSolver, start: State, time: float, why: str) -> Attempt:
    """An attempt without a state; steps up to there are not kept."""
    tried = Attempt(solver=solver, begin=start, solution=unsolved(start, solver.surface.size, Status.BROKEN, []))
    return replace(tried, why=f"the clock stops: {why}", when=time)
