"""Values in time: their places in a scene, the requested times, and each value at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from stickslip.geometry.amplitude import Amplitude, listed_times, turns, value_at
from stickslip.geometry.arrays import EXACT, Array
from stickslip.geometry.errors import SceneError
from stickslip.geometry.expression import Expression
from stickslip.solvers.scene.settings import Clock, Cycle


class Place(NamedTuple):
    """Place of a value in time in a scene, for example

    supports.top.displacement.x, loads.side.pressure, obstacles.roller.rotation.angle, gravity.acceleration.y.
    """

    table: str
    name: str
    quantity: str
    component: str = ""

    def __str__(self) -> str:
        return ".".join(word for word in self if word)


Drive = Place | float  # a value in time: by its place, or a number that is ramped from 0 to the end


@dataclass(frozen=True)
class Timeline:
    """Every value in time of a scene, and its requested times.

    A friction bound that is not zero at t = 0 does not request t = 0; other values do.
    """

    amplitudes: Mapping[Place, Amplitude]
    end: float  # [s]
    count: int  # equal steps up to the end
    expressions: Mapping[Place, Expression] = field(default_factory=dict)
    jumps: bool = False  # whether an expression is not zero at t = 0
    clock: Clock | None = None  # that finds the steps between requested times
    cycle: Cycle | None = None  # a part that stands for many

    @cached_property
    def times(self) -> tuple[float, ...]:
        """Requested times [s], increasing: equal steps, every time that a table lists up to the end, ends of a cycle.

        t = 0 is requested only if a load or a motion is not zero there.
        """
        found = {self.end * (k + 1) / self.count for k in range(self.count)}
        found |= {t for a in self.amplitudes.values() for t in listed_times(a) if 0 < t <= self.end}
        found |= {self.cycle.from_, self.cycle.to} - {0.0} if self.cycle else set()
        moving = [a for place, a in self.amplitudes.items() if place.table != "contacts"]
        if self.jumps or any(0.0 in listed_times(a) and value_at(a, 0.0, self.end) != 0 for a in moving):
            found.add(0.0)
        ordered = sorted(found)
        later = [*ordered[1:], np.inf]
        # relative to the end: requested times that differ by less count as one
        return tuple(t for t, after in zip(ordered, later, strict=True) if after - t > EXACT * self.end)

    @cached_property
    def turns(self) -> frozenset[float]:
        """Times [s] at which the rate of a value changes; those of expressions with t are not known."""
        ramps = [1.0 for expression in self.expressions.values() if not expression.in_time]
        return frozenset(t for a in [*self.amplitudes.values(), *ramps] for t in turns(a, self.end))

    def value(self, drive: Drive, time: float) -> float:
        """Value of a drive at `time` [s], in the unit of its key; of an expression the factor of its formula."""
        if isinstance(drive, Place) and drive in self.expressions:
            return self.expressions[drive].ramp(time, self.end)
        amplitude = self.amplitudes[drive] if isinstance(drive, Place) else drive
        return value_at(amplitude, time, self.end)

    def values(self, place: Place, points: Array, time: float) -> Array:
        """Values (m,) of the expression at a place, at points (m, d) [m] and a time [s].

        Raises:
            SceneError: it has no finite value at a point.
        """
        found = self.expressions[place](points, time, self.end)
        wrong = ~np.isfinite(found)
        if wrong.any():
            at = ", ".join(f"{x:.6g}" for x in points[np.argmax(wrong)])
            raise SceneError(f"{place}: the expression has no finite value at the point ({at}) at t = {time:g}")
        return found


class Course:
    """The timeline in use: the only part of a system that can change, for a script that decides from step to step."""

    def __init__(self, timeline: Timeline) -> None:
        self.timeline = timeline
        self.found: Mapping[Place, Amplitude] = {}  # values that a step finds, over its own time
        self.batches: Sequence[float] = ()  # load cycles of each batch, as a run has found them; empty: to be found
        self.halved = False  # whether batches, and steps of their cycles, are half as long

    def value(self, drive: Drive, time: float) -> float:
        """Value of a drive at `time` [s], in the unit of its key."""
        if drive in self.found:
            return value_at(self.found[drive], time, self.timeline.end)  # type: ignore[index]
        return self.timeline.value(drive, time)

    def at(self, time: float) -> tuple[float, Timeline, Mapping[Place, Amplitude]]:
        """Data that the values at a time [s] follow from, to be compared with those of another time."""
        return time, self.timeline, self.found

    @contextmanager
    def following(self, timeline: Timeline) -> Iterator[None]:
        """Context that uses another timeline, which has the same places."""
        before, self.timeline = self.timeline, timeline
        try:
            yield
        finally:
            self.timeline = before

    @contextmanager
    def in_halves(self) -> Iterator[None]:
        """Context in which batches of load cycles, and steps of their cycles, are half as long."""
        self.halved = True
        try:
            yield
        finally:
            self.halved = False
