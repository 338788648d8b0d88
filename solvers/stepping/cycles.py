"""One load cycle stands for many: they go by in batches, each a cycle in which steps wear for several.

In a batch of n cycles the depth that a step wears off is k n Δs p, with the pressure at its end: a compliance of the
point still, so that no batch is too large to be stable. One batch of 2 n and two of n differ in worn depth, of which
that of the two lacks about as much. n is so large that this is at most `error` of the largest depth that cycles have
worn off, times the share that these have in them; both batches are kept. What rubs in a batch rubs n times, too.

Source: McColl, Ding & Leen, Wear 256 (2004), of cycles that wear for many; Johansson, Comput. Struct. 52 (1994), of
implicit steps.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise

import numpy as np

from stickslip.geometry.arrays import EXACT, TINY
from stickslip.solvers.laws.wear import WORN
from stickslip.solvers.scene.record import Batch
from stickslip.solvers.stepping.law_memory import worn_depth
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.substep import Attempt, Substep, SubstepSolver


class CycleLoop:
    """Solves the batches before the last cycle, in the step that begins it."""

    def __init__(self, solver: SubstepSolver) -> None:
        self._solver, self._course = solver, solver.system.course
        self._cycle, self._end = solver.system.problem.timeline.cycle, solver.system.problem.timeline.end

    def active(self) -> bool:
        """Whether a cycle of the scene stands for several."""
        return self._cycle is not None and self._cycle.repeat > 1

    def around(self, inner: Substep) -> Substep:
        assert self._cycle is not None
        begin, near = self._cycle.from_, EXACT * self._end

        def followed(start: State, target: float) -> Attempt:
            if target <= begin + near or start.time > begin + near:
                return inner(start, target)
            if start.time < begin - near:
                reached = inner(start, begin)
                if reached.state is None:
                    return reached
                start = reached.state
            return self._batches(inner, start, target)

        return followed

    def _batches(self, inner: Substep, start: State, target: float) -> Attempt:
        """The last cycle up to a time [s], after all others; collective."""
        state, batches, substeps, done = start, list[Batch](), 0, 0.0
        for attempt, n in self._replayed(inner, start) if self._course.batches else self._found(inner, start):
            if attempt.state is None:
                return attempt
            state, substeps, done = attempt.state, substeps + attempt.substeps, done + n
            batches += self._worn(state, done)
        last = inner(state.again(start.time, 1), target)
        told = last.state and replace(last.state, batches=tuple(batches))
        return replace(last, state=told, substeps=substeps + last.substeps)

    def _replayed(self, inner: Substep, start: State) -> Iterator[tuple[Attempt, float]]:
        """Yield the batches that a run has found, each with its number of cycles; a cycle alone is not halved."""
        halves = self._course.halved
        return self._each(
            inner, start, [n for b in self._course.batches for n in ([b / 2] * 2 if halves and b > 1 else [b])]
        )

    def _found(self, inner: Substep, start: State) -> Iterator[tuple[Attempt, float]]:
        """Yield batches as large as `error` allows, each with its number of cycles; the last may have failed."""
        assert self._cycle is not None
        chain, system, n, done, most = self._solver.chain, self._solver.system, 1.0, 0.0, self._cycle.repeat - 1
        begun = start
        while done < most:
            n, pair, whole = max(min(n, (most - done) // 2), 1.0), 1 + (most - done > 1), None
            if pair == 2:
                with nullcontext() if chain.repeats else chain.repeating(system):
                    whole = self._batch(inner, start, 2 * n).state
            found = list(self._each(inner, start, [n] * pair)) if whole or n == 1 else []
            last, room = found[-1][0].state if found else None, 0.0  # what is allowed over what one batch is off
            if whole and last:
                depth, other, first = (worn_depth(self._solver.cone, each.memory) for each in (last, whole, begun))
                off = max(float(np.abs(other - depth).max()), TINY)
                allowed = self._cycle.error * float((depth - first).max()) * 2 * n / (done + 2 * n)
                room = system.mesh.comm.bcast(allowed / off if allowed > 0 else np.inf)
            after = max(n * float(np.clip(0.8 * room, 0.25, 4.0)) // 1, 1.0)
            if n > 1 and room < 1:
                n = after
                continue
            yield from found
            if last is None:
                return
            start, done, n = last, done + pair * n, after

    def _each(self, inner: Substep, state: State, sizes: Sequence[float]) -> Iterator[tuple[Attempt, float]]:
        """Yield batches of these numbers of cycles, one after the other, up to one that fails."""
        for n in sizes:
            attempt = self._batch(inner, state, n)
            yield attempt, n
            if attempt.state is None:
                return
            state = attempt.state

    def _batch(self, inner: Substep, state: State, n: float) -> Attempt:
        """One cycle that stands for n, from a state at the end of another one or at the first one's beginning."""
        cycle, near, attempt = self._cycle, EXACT * self._end, None
        assert cycle is not None
        times = [t for t in self._course.timeline.times if cycle.from_ + near < t <= cycle.to + near]
        if self._course.halved:
            times = [t for a, b in pairwise([cycle.from_, *times]) for t in ((a + b) / 2, b)]
        state, substeps = state.again(cycle.from_, n), 0
        for time in times:
            attempt = inner(state, time)
            substeps += attempt.substeps
            if attempt.state is None:
                why = f"in a load cycle that stands for {n:g}, {attempt.why}"
                return replace(attempt, good=None, why=why, when=attempt.when)
            state = attempt.state
        assert attempt is not None
        return replace(attempt, substeps=substeps)

    def _worn(self, state: State, done: float) -> Iterator[Batch]:
        for c in (c for c in self._solver.cone.contacts if c.wears):
            depth = state.memory[f"{c.name}{WORN}"]
            yield Batch(c.name, done, float(depth.max(initial=0.0)), float(c.W_n @ depth))
