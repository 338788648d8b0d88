"""Counters of work, incremented where the work is done, and the clock of a run.

One phase of the clock is on at a time, so that the seconds of all phases add up to the whole. A phase that begins
within another one stops that, and gives it back the clock at its end: no second counts twice.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, fields, replace
from typing import Annotated, TypeVar

from stickslip.geometry.keys import Key

PHASES = {  # what a row of the clock may be of, and what that is
    "imports": "loading libraries, and reading the scene",
    "mesh": "gmsh, and distributing the mesh",
    "assemble": "forms, stiffness, loads, contact rows",
    "prepare": "factor or multigrid of the bodies, and what the method prepares",
    "iterate": "all steps, failed ones included",
    "error": "estimates of errors",
    "audit": "reading the steps' files back, and holding them against equilibrium and the contact laws",
    "output": "reading results off the steps, and writing files",
    "linear_reference": "one linear solve of the same mesh, by each solver",
    "other": "what is between these",
}
OTHER = "other"
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Row:
    """Time that a phase, or a part of it, has taken so far."""

    phase: str  # of `PHASES`
    part: Annotated[str, Key("", "empty: what of the phase is in no part that has a name")]
    seconds: float
    calls: Annotated[int, Key("", "how often it began")]
    volume_solves: Annotated[int, Key("", "applications of K_B^-1 meanwhile, those for estimates of errors too")]


def processors() -> float:
    """Seconds that processors have worked for this process, and for those that it has waited for."""
    spent = os.times()
    return time.process_time() + spent.children_user + spent.children_system


class Clock:
    """Wall time and volume solves by phase, of this rank: a collective phase waits for the slowest one.

    Beside them it knows for how long processors have worked, which is no longer where others use the machine, too.

    >>> clock = Clock()
    >>> with clock.phase("iterate"), clock.part("tangent"):
    ...     pass
    >>> [(row.phase, row.part, row.calls) for row in clock.rows()]
    [('iterate', '', 1), ('iterate', 'tangent', 1), ('other', '', 0)]
    """

    def __init__(self, solves: Callable[[], int] = lambda: 0, now: Callable[[], float] = time.perf_counter) -> None:
        """
        Args:
            solves: number of volume solves so far.
            now: the time [s].
        """
        self._solves, self._now = solves, now
        self._spent: dict[tuple[str, str], tuple[float, int, int]] = {}
        self._on = [(OTHER, "")]
        self._since, self._before, self._worked_before = now(), solves(), processors()
        self._worked = dict[tuple[str, str], float]()
        self.expected = 0.0  # s that preparing the bodies and solving all steps will take, once it is known
        self.on_phase: Callable[[Clock, str, str], None] = lambda clock, phase, part: None  # told where one begins
        self._way: tuple[float, int, int] | None = None  # when it began [s], done and all, of what is counted now

    @contextmanager
    def phase(self, phase: str, part: str = "") -> Iterator[None]:
        """Context that counts for a phase, or for a part of it."""
        assert phase in PHASES, phase
        self._stop()
        seconds, calls, solves = self._spent.get((phase, part), (0.0, 0, 0))
        self._spent[phase, part] = seconds, calls + 1, solves
        self._on.append((phase, part))
        self.on_phase(self, phase, part)
        try:
            yield
        finally:
            self._stop()
            self._on.pop()

    def part(self, part: str) -> AbstractContextManager[None]:
        """Context that counts for a part of the phase that is on."""
        return self.phase(self._on[-1][0], part)

    def counted(self, members: Sequence[T], done: int = 0) -> Iterator[T]:
        """Go through what there is to do, each about as long; from it follows how long the rest will take.

        Args:
            members: all, those that are done among them.
            done: how many that are.

        >>> clock = Clock(now=iter([0.0, 0.0, 3.0, 4.0, 4.0]).__next__)
        >>> [clock.left for _ in clock.counted("abc")]
        [None, 6.0, 2.0]
        """
        before, began = self._way, self._now()
        try:
            for k, member in enumerate(members[done:]):
                self._way = began, k, len(members) - done
                yield member
        finally:
            self._way = before

    @property
    def left(self) -> float | None:
        """How long what is counted now will go on [s]; None: nothing is, or none of it is done."""
        if self._way is None or not self._way[1]:
            return None
        began, done, count = self._way
        return (self._now() - began) / done * (count - done)

    def rows(self) -> tuple[Row, ...]:
        """Time spent until now, in the order of `PHASES`; of a phase, what is in no part comes first."""
        self._stop()
        order = list(PHASES)
        return tuple(
            Row(phase=phase, part=part, seconds=seconds, calls=calls, volume_solves=solves)
            for (phase, part), (seconds, calls, solves) in sorted(
                self._spent.items(), key=lambda item: (order.index(item[0][0]), bool(item[0][1]))
            )
        )

    def seconds(self, phase: str) -> float:
        """Of a phase with all its parts [s]."""
        self._stop()
        return sum(seconds for (own, _), (seconds, *_) in self._spent.items() if own == phase)

    def worked(self, phase: str, part: str | None = None) -> float:
        """Seconds of processors of a phase with all its parts, or of one; of an earlier process its wall time."""
        self._stop()
        return sum(s for (own, each), s in self._worked.items() if own == phase and part in (None, each))

    def add(self, earlier: Sequence[Row]) -> None:
        """Add what an earlier process has spent."""
        for row in earlier:
            key = row.phase, row.part
            self._worked[key] = self._worked.get(key, 0.0) + row.seconds
            seconds, calls, solves = self._spent.get((row.phase, row.part), (0.0, 0, 0))
            spent = seconds + row.seconds, calls + row.calls, solves + row.volume_solves
            self._spent[row.phase, row.part] = spent

    def leave_out(self, solves: int) -> None:
        """Volume solves that were just added to the number so far are those of an earlier process."""
        self._before += solves

    def _stop(self) -> None:
        """Give what was spent since the last stop to the phase that is on."""
        now, count, worked, on = self._now(), self._solves(), processors(), self._on[-1]
        seconds, calls, solves = self._spent.get(on, (0.0, 0, 0))
        self._spent[on] = seconds + now - self._since, calls, solves + count - self._before
        self._worked[on] = self._worked.get(on, 0.0) + worked - self._worked_before
        self._since, self._before, self._worked_before = now, count, worked


@dataclass
class Counters:
    """Work done since the start of a run; one instance per run, written to `result.json`.

    Attributes:
        clock: what that took, by phase.
    """

    forms: int = 0  # UFL forms compiled or loaded
    searches: int = 0  # closest-point passes; analytic obstacles need none
    factorisations: int = 0  # of K_B, or of its interior block K_ii
    schur_size: int = 0  # c, order of the Schur complement on the contact dofs
    volume_solves: int = 0  # applications of K_B^-1 (of K_ii^-1 when the contact dofs are condensed)
    added_dofs: int = 0  # contact dofs that bodies which came near added, a volume solve each; nothing is factorised
    linear_iterations: int = 0  # of iterative linear solvers
    error_solves: int = 0  # applications of K_B^-1 for estimates of errors; not in volume_solves
    lanczos_applications: int = 0  # of K_B^-1 for lambda_max (Lanczos); not in volume_solves

    def __post_init__(self) -> None:
        self.clock = Clock(lambda: self.volume_solves + self.error_solves)

    def __reduce__(self) -> tuple[type[Counters], tuple[int, ...]]:
        """Another process has a clock of its own."""
        return Counters, tuple(getattr(self, f.name) for f in fields(self))

    @contextmanager
    def for_error(self) -> Iterator[None]:
        """Count the volume solves of a block as `error_solves`, and nothing else."""
        before = replace(self)
        try:
            yield
        finally:
            solves = self.error_solves + self.volume_solves - before.volume_solves
            for f in fields(self):
                setattr(self, f.name, getattr(before, f.name))
            self.error_solves = solves

    def add(self, earlier: Counters) -> None:
        """Add the work of an earlier process of the same run; `schur_size` is a size and stays."""
        for f in fields(self):
            if f.name != "schur_size":
                setattr(self, f.name, getattr(self, f.name) + getattr(earlier, f.name))
        self.clock.leave_out(earlier.volume_solves + earlier.error_solves)
