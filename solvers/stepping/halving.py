"""A step that fails is cut into substeps, each from the last good state; if the smallest fails, a line says why.

The line names the largest contact residual, how the iteration ended, and what to try. Where it is shown that nothing
balances the loads, the limit load is bracketed to `SLIGHT` of it, and the line names the motion that nothing resists.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import ROUNDING, SLIGHT, Array, Ints
from stickslip.solvers.contact.admissible_set import ContactBlock
from stickslip.solvers.fem.constraints import AXES
from stickslip.solvers.interface.limit_analysis import decide, spent
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Solution, Status
from stickslip.solvers.scene.settings import Solver
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.state import HALVINGS, State, StepControl
from stickslip.solvers.stepping.substep import Attempt, Substep
from stickslip.solvers.system.system import System

Observe = Callable[[Attempt], Attempt]  # what is known of an accepted substep is added to it; collective
log = logging.getLogger(__name__)


class Halving:
    """Solves a step in one substep if that succeeds, otherwise in several; each that is accepted is observed.

    A substep of 1/2^HALVINGS of the step is the smallest; where the chain only repeats none is cut or observed.
    """

    def __init__(self, system: System, chain: MethodChain, observers: Sequence[Observe]) -> None:
        self.system, self.chain, self.observers = system, chain, observers

    def active(self) -> bool:
        """Always."""
        return True

    def around(self, inner: Substep) -> Substep:
        return lambda start, target: _March(self, inner, start, target)()


class _March:
    """The substeps of one step."""

    def __init__(self, halving: Halving, inner: Substep, start: State, target: float) -> None:
        self._system, self._chain, self._observers = halving.system, halving.chain, halving.observers
        self._inner, self._state, self._target, self._control = inner, start, target, start.control
        self._step = target - start.time
        self._shortest = self._smallest = self._step if self._chain.repeats else self._step / 2**HALVINGS
        self._whole: StepControl | None = None  # before the step was cut for a jump that lies ahead
        self._good: Attempt | None = None  # up to the present state
        self._unbalanced: Attempt | None = None  # at the earliest time at which bodies move on without end
        self._proved: Attempt | None = None  # at the earliest one that is shown to have no equilibrium
        self._limit: _Limit | None = None  # between the present state and that time
        self._failed: SurfaceProblem | None = None  # from the present state
        self._beyond: float | None = None  # the earliest time [s] to which a jump led
        self._stuck = False  # whether a shorter step would be the same problem again

    def __call__(self) -> Attempt:
        while self._good is None or self._state.time < self._target:
            remaining = self._target - self._state.time
            size = self._control.next_size(remaining, self._smallest)
            end = self._target if size == remaining else self._state.time + size
            if self._limit is not None:
                if self._unbalanced is not None and self._limit.found(self._state.time):
                    if self._by_jump():
                        continue
                    return self._no_equilibrium(self._unbalanced)
                end = self._limit.next_time(self._state.time)
                size = end - self._state.time
            self._chain.begin(cut_first=not self._stuck and not self._least(size))
            attempt = self._inner(self._state, end)
            if attempt.solution.jumps and self._limit is None and not (self._least(size) or self._chain.repeats):
                self._whole = self._whole or self._control
                self._control = self._control.after_failure(size, self._smallest)  # it may lead on in between
                self._beyond = end if attempt.state is not None else self._beyond
            elif attempt.state is not None:
                self._good = self._accepted(attempt, attempt.state, size)
            elif (given_up := self._cut(attempt, size, end)) is not None:
                return given_up
        return self._good

    def _least(self, size: float) -> bool:
        """Whether a size [s] is the smallest one."""
        return size <= self._smallest * (1 + ROUNDING)

    def _accepted(self, attempt: Attempt, new: State, size: float) -> Attempt:
        """Go on from the end of a substep; collective."""
        for observe in self._observers if not self._chain.repeats else ():
            attempt = observe(attempt)
        before, solution = self._good, attempt.solution
        if before is not None:
            known = before.solution
            solution = replace(
                solution,
                others=solution.others or known.others,
                weakening=max(known.weakening, solution.weakening),
                proved=known.proved and solution.proved,
                jumps=known.jumps or solution.jumps,
                jump=known.jump + solution.jump,
            )
        # of the iterations allowed; a substep that takes more is not easy
        easy = solution.iterations <= 0.5 * self._system.problem.solver.max_iterations
        self._control = self._control.after_success(size, self._step, easy)
        settled = new.time not in self._chain.unsettled[-1:]
        if attempt.solution.jumps and settled and self._whole:  # what was cut for that alone lies behind
            self._control, self._whole = self._whole, None
        # where pairs do not settle shorter substeps do not either
        self._smallest = self._shortest if settled else 2 * size
        begin, self._state = self._state, replace(attempt.state or new, control=self._control)
        self._failed, self._stuck = None, False
        self._beyond = self._beyond if self._beyond is not None and self._beyond > new.time else None
        if self._state.searched:
            self._unbalanced = self._proved = None  # for other pairs
            if self._limit is not None and self._limit.found(self._state.time):
                self._limit = None
        return replace(
            attempt,
            begin=begin,
            state=self._state,
            solution=solution,
            substeps=1 + (before.substeps if before else 0),
            rows=len(self._chain.history.rows),
            volume_solves=self._system.counters.volume_solves,
        )

    def _cut(self, attempt: Attempt, size: float, end: float) -> Attempt | None:
        """Go on with shorter substeps after one that failed; the attempt at the step if none is left; collective."""
        solution, problem, state = attempt.solution, attempt.problem, self._state
        system, chain = attempt.solver.system, self._chain
        if attempt.collapses:
            self._unbalanced = replace(attempt, when=end)
            self._proved = self._unbalanced if attempt.impossible else self._proved
        # from rest, under loads in proportion to time, a shorter step is the same problem again
        at_rest = not (state.p.any() or state.w.any() or state.memory)  # slip that changes the law is not scaled
        scaled = at_rest and self._failed is not None and problem is not None and problem.is_scaled(self._failed)
        known = self._stuck or chain.exhausted or attempt.collapses
        self._failed = problem
        if scaled and not known:
            self._stuck = True  # once more, now by all methods
            return None
        if not scaled and problem is not None and (attempt.collapses or self._limit) and not self._chain.repeats:
            self._limit = _Limit.of(attempt, problem, state, end, self._limit, self._smallest)
            if not self._limit.found(state.time):
                log.warning("t = %g: %s; the step is cut", end, solution.status.value)
                return None
        elif not scaled and not self._least(size) and not _creeps(solution, system.problem.solver):
            self._control, self._whole = self._control.after_failure(size, self._smallest), None
            log.warning("t = %g: %s; the step is cut to %.3g s", end, solution.status.value, self._control.size)
            return None
        if self._by_jump():
            return None
        if self._unbalanced is not None:
            return self._no_equilibrium(self._unbalanced)
        why = explain(problem, solution, system.problem.solver, size)
        why += f"; {self._last}" if attempt.solver.surface.floating else ""
        return replace(attempt, good=self._good, when=end, why=why)

    def _by_jump(self) -> bool:
        """Go on by a jump to where one led, unless it is shown that the load has a limit before; collective.

        In between is nothing that could be solved: where mu is large, an edge that opens neither sticks nor slips then.
        """
        if (end := self._beyond) is None or self._proved is not None:
            return False
        self._beyond = None
        self._chain.begin(cut_first=False)
        attempt = self._inner(self._state, end)
        if attempt.state is None:
            return False
        self._limit = self._unbalanced = None
        self._good = self._accepted(attempt, attempt.state, end - self._state.time)
        return True

    @property
    def _last(self) -> str:
        return f"the last equilibrium that was found is at t = {self._state.time:g}"

    def _no_equilibrium(self, attempt: Attempt) -> Attempt:
        """Give the step up at an attempt in which bodies move on without end, next to the present state."""
        solution, problem, state = attempt.solution, attempt.problem, self._state
        assert problem is not None
        p = state.ahead(problem.cone.time, self._system.course.timeline.turns)
        if state.p.any() and spent(problem, p, solution.u_c):
            solution = replace(solution, status=Status.NO_EQUILIBRIUM)
        elif self._proved is not None:
            attempt, solution = self._proved, self._proved.solution
        moves = describe_motion(self._system, solution.u_c, self._chain.volume.contact.rows)
        why = f"{solution.status.value}: {moves}; {self._last}"
        return replace(attempt, solution=solution, good=self._good, why=why)


@dataclass(frozen=True)
class _Limit:
    """The search for a limit load: it lies between the present state and a time that has no equilibrium."""

    beyond: float  # that time, or one that could not be solved [s]
    near: float  # where the load is expected to be as large as its limit [s]
    width: float  # of the time in which the load changes by `SLIGHT` of it [s]
    halve: bool  # whether the expectation has not been good

    @classmethod
    def of(
        cls,
        attempt: Attempt,
        problem: SurfaceProblem,
        state: State,
        end: float,
        before: _Limit | None,
        smallest: float,
    ) -> _Limit:
        """After an attempt from a state to an end [s] that failed; collective.

        The work of the load along the motion of collapse, less what contact and friction take up, is taken as linear in
        time.
        """
        solution, surface = attempt.solution, problem.surface
        load, first = problem.load.resultant, surface.R.T @ surface.forces(state.p)
        final, change, near = float(np.linalg.norm(load)), float(np.linalg.norm(load - first)), state.time
        if attempt.collapses:
            along = surface.R.T @ solution.u_c
            final, begun = float(along @ load), float(along @ first)
            change = abs(final - begun)
            room = final * (1 - solution.lacking) - begun
            near += room / (final - begun) * (end - state.time) if final > begun else 0.0
        width = SLIGHT * max(abs(final) / change * (end - state.time), smallest) if change else smallest
        slow = before is not None and 2 * (end - state.time) > (before.beyond - state.time) * (1 + ROUNDING)
        return cls(end, near, width, slow or near - state.time < width)

    def found(self, time: float) -> bool:
        """Whether a time of equilibrium [s] is near enough."""
        return self.beyond - time <= self.width * (1 + ROUNDING)

    def next_time(self, time: float) -> float:
        """The time [s] to try after one of equilibrium: just before the expected limit, then just after it."""
        for sign in (-1, 1):
            tried = self.near + sign * self.width / 3
            if not self.halve and time + self.width / 9 < tried < self.beyond:
                return tried
        return (time + self.beyond) / 2


def describe_motion(system: System, motion: Array, dofs: Ints) -> str:
    """A rigid motion in words, by the body or driven obstacle that moves farthest: "bodies.block moves along x".

    Args:
        system: whose bodies and obstacles move.
        motion: displacement (c,) [m] of the contact dofs that the surface problem has, then of the driven obstacles.
        dofs: numbers of these contact dofs: without friction those of normal motions alone.
    """
    return max(_motions(system, motion, dofs), key=lambda found: found[0])[1]


def _motions(system: System, motion: Array, dofs: Ints) -> Iterator[tuple[float, str]]:
    """Distance [m] that each body and driven obstacle moves, and the sentence about it."""
    own, driven = np.split(motion, [len(dofs)])
    known = np.isin(system.interface.dofs, dofs)
    for (name, axis), size in zip(system.obstacles.driven, driven, strict=True):
        yield abs(float(size)), f"obstacles.{name} moves along {_sign(size)}{'xyz'[axis]}"
    for c in system.contacts:
        moved = (system.interface.trace(c)[:, known] @ own).reshape(c.points.shape)
        sides = np.split(moved, [len(c.surface.points)])
        for body, u in zip(system.problem.pairs[c.name].bodies, sides, strict=False):
            yield float(np.linalg.norm(u, axis=1).max()), f"bodies.{body} {_verb(u)}"


def _verb(u: Array) -> str:
    """Name a rigid motion: "turns", or "moves along -x"; u: displacement (m, d) of one of its sides [m]."""
    mean = u.mean(axis=0)
    if np.linalg.norm(u - mean, axis=1).max() > np.linalg.norm(mean):
        return "turns"
    axis = max(AXES, key=lambda name: abs(mean[AXES[name]]) if AXES[name] < len(mean) else -1.0)
    return f"moves along {_sign(mean[AXES[axis]])}{axis}"


def _sign(size: float) -> str:
    return "-" if size < 0 else ""


def explain(problem: SurfaceProblem | None, solution: Solution, solver: Solver, size: float) -> str:
    """Explain in one line why the smallest substep failed.

    Args:
        problem: what was to be solved; None: it could not be set up.
        solution: how the iteration ended.
        solver: settings; where `auto` has tried all methods no other one is advised.
        size: size of the substep [s].
    """
    rigid_bodies = ""
    if problem is not None and problem.surface.floating:
        rigid_bodies = f" ({decide(problem).value})"
    residual = "no residual"
    if np.isfinite(solution.residual):
        broken = solution.status is Status.BROKEN  # its tractions are those of the substep before
        where = "" if broken or problem is None else largest_residual(problem, solution)
        residual = f"{where}residual {solution.residual:.1e}, not {solver.tolerance:g},"
    other = solver.method != "auto" and solution.status in (Status.STALLED, Status.BROKEN)
    advice = solution.status.value.replace("try ", f"try {'another solver.method, or ' * other}")
    if np.isfinite(more := solution.needs(solution.residual, solver.tolerance)):
        advice += f" by about {more:.1e}, for each leaves {solution.contraction:.5g} of the residual"
        advice += ', or set solver.method = "auto"' if solver.method != "auto" else ""
    ending = f"after {solution.iterations} iterations; {advice}{rigid_bodies}"
    return f"{residual} in a step of {size:.3g} s {ending}{_jumps(problem)}"


def _jumps(problem: SurfaceProblem | None) -> str:
    """Tell of friction bounds that jump where the surfaces part."""
    for place in problem.cone.with_friction() if problem is not None else ():
        friction = place.rows.friction
        if place.rows.normal.sides == 1 and friction is not None and friction.continuous:
            return (
                f"; the friction bound of contacts.{place.rows.name} jumps where the surfaces part: there may be no "
                f"solution; {friction.continuous} has one"
            )
    return ""


def _creeps(solution: Solution, solver: Solver) -> bool:
    """Whether iterations contract so little that they would not do even from the start that a short step has."""
    return solution.needs(SLIGHT, solver.tolerance) > solver.max_iterations


def largest_residual(problem: SurfaceProblem, solution: Solution) -> str:
    """Name the place of the largest residual: "contacts.base at (1, 0): normal "; empty without tractions."""
    if not len(solution.p) or problem.p_ref == 0:
        return ""
    row = int(np.argmax(np.abs(problem.defect(solution.p, solution.w))))
    for place in problem.cone.places:
        for part, span in (("normal", place.normal), ("tangential", place.tangential)):
            if span.start <= row < span.stop:
                point = ", ".join(f"{x:.4g}" for x in _point(place, part, row - span.start))
                return f"contacts.{place.rows.name} at ({point}): {part} "
    raise AssertionError("a row of no contact")


def _point(place: ContactBlock, part: str, row: int) -> Array:
    """The slave node (d,) [m] that has the largest weight in a row of the block."""
    rows = place.rows
    share = rows.psi[:, row] if part == "normal" else rows.share_t[row // place.components].T
    return np.asarray(rows.surface.points[int(np.argmax(np.abs(share.toarray().ravel())))])
