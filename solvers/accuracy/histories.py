"""Histories of the same scene in other steps, or on another mesh: their plans, their numbers, and how two differ."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geometry.arrays import Array, Ints
from solvers.results.error_parts import Quantity, Value
from solvers.scene.timeline import CLOSE, Timeline

Stretches = tuple[tuple[float, ...], ...]  # the times of a history [s]; each stretch ends where some value turns


def stretches(times: Sequence[float], timeline: Timeline) -> Stretches:
    """Times of a history [s] from one turn of a value to the next; no time that ends a stretch is ever left out.

    >>> from solvers.scene.timeline import Place
    >>> line = Timeline({Place("supports", "top", "displacement", "x"): ((1.0, 0.0), (2.0, 1.0))}, end=2.0, count=4)
    >>> stretches(line.times, line)
    ((0.5, 1.0), (1.5, 2.0))
    """
    turns, found, open_stretch = np.array([*timeline.turns, 0.0]), list[tuple[float, ...]](), list[float]()
    for time in times:
        open_stretch.append(time)
        if np.abs(turns - time).min() <= CLOSE * timeline.end or time == times[-1]:
            found.append(tuple(open_stretch))
            open_stretch = []
    return tuple(found)


def halved(stretch: tuple[float, ...]) -> tuple[float, ...]:
    """Every second time of a stretch, the last one among them; of an odd number the first three steps become one.

    >>> halved((1.0, 2.0, 3.0, 4.0)), halved((1.0, 2.0, 3.0, 4.0, 5.0)), halved((1.0,))
    ((2.0, 4.0), (3.0, 5.0), (1.0,))
    """
    kept = stretch[::-1][::2][::-1]
    return kept[1:] if len(stretch) % 2 and len(stretch) > 1 else kept


def doubled(history: Stretches, single: Sequence[bool]) -> Stretches:
    """The history with its steps halved in stretches that are `single`; a step at t = 0 stays one.

    >>> doubled(((1.0,), (1.5, 2.0)), [True, False])
    ((0.5, 1.0), (1.5, 2.0))
    """
    starts = [0.0, *(stretch[-1] for stretch in history)]
    return tuple(
        (*((start + stretch[0]) / 2 for _ in range(alone and stretch[0] > start)), *stretch)
        for start, stretch, alone in zip(starts, history, single, strict=False)
    )


def count(plan: Stretches) -> int:
    """Number of steps."""
    return sum(map(len, plan))


class Solved(NamedTuple):
    """A history as far as it was solved in whole steps."""

    plan: Stretches
    times: Array  # (n,) those that are also times of the run [s]
    rows: Array  # (n, k) all numbers at these times, flat, see `Columns`


class Difference(NamedTuple):
    """Of two histories, at the c times that both were solved at."""

    times: Array  # (c,) [s]
    rows: Array  # (c, k) the finer one minus the coarser one
    factor: (
        Array  # (c,) error of the run over that, by the sums of h² up to there; 0 before the first step that differs
    )


@dataclass(frozen=True)
class Columns:
    """All numbers of a step as one row (k,)."""

    keys: tuple[Quantity, ...]
    sizes: tuple[int, ...]  # of each; 0: a number, not a vector

    @classmethod
    def of(cls, values: Mapping[Quantity, Value]) -> Columns:
        """Those of a step's numbers, see `quantities`."""
        return cls(tuple(values), tuple(np.size(value) * (np.ndim(value) > 0) for value in values.values()))

    @staticmethod
    def row(values: Mapping[Quantity, Value]) -> Array:
        """A step's numbers (k,)."""
        return np.concatenate([np.atleast_1d(value) for value in values.values()])

    def which(self, test: Callable[[Quantity], bool]) -> Ints:
        """Columns of the quantities that pass a test."""
        each = [key for key, size in zip(self.keys, self.sizes, strict=True) for _ in range(max(size, 1))]
        return np.flatnonzero([test(key) for key in each])

    def energy(self, name: str) -> int:
        """The column of an energy."""
        return int(self.which(lambda key: key == Quantity("energy", "", name))[0])

    def values(self, row: Array) -> dict[Quantity, Value | None]:
        """A row by quantity; None where there is a NaN."""
        found, at = dict[Quantity, Value | None](), 0
        for key, size in zip(self.keys, self.sizes, strict=True):
            part = row[at : at + max(size, 1)]
            at += len(part)
            found[key] = None if np.isnan(part).any() else part if size else float(part[0])
        return found


def factor_at(one: Difference, times: Array) -> Array:
    """Factor of a difference (n,) at times of the run; NaN behind its last time."""
    return np.asarray(np.append(one.factor, np.nan)[np.searchsorted(one.times, times)])


def signed(one: Difference, times: Array, columns: Columns) -> Array:
    """Error of the run (n, k) at its times by one comparison, positive where a number is too large; NaN behind it."""
    after = np.searchsorted(one.times, times)
    rows = np.vstack([np.zeros((1, one.rows.shape[1])), one.rows, np.full((1, one.rows.shape[1]), np.nan)])
    ends = np.concatenate([[0.0], one.times, [np.inf]])
    found, adding = rows[after + 1], columns.which(adds_up)
    length = ends[after + 1] - ends[after]
    share = np.divide(times - ends[after], length, out=np.ones_like(times), where=length > 0)[:, None]
    found[:, adding] = rows[after][:, adding] * (1 - share) + found[:, adding] * share
    in_step = columns.which(lambda key: key.quantity == "dissipation")
    since_rest = columns.which(lambda key: key.quantity == "dissipation_total")
    found[:, in_step] = np.diff(found[:, since_rest], axis=0, prepend=0.0)
    return np.asarray(-found * factor_at(one, times)[:, None])


def adds_up(key: Quantity) -> bool:
    """Whether a number is a sum over all steps."""
    return key.kind == "energy" or key.quantity == "dissipation_total"
