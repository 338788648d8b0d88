"""Stated errors beside true ones: which count, which share is of the right size, and which pressures have no limit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.workflows.lab.verification.accuracy.answer import Answer

COUNTS = 1e-3  # of the scale of its kind; a smaller true error does not count
LOW, HIGH = 0.7, 3.0  # stated / true within: of the right size
TOO_SMALL, TOO_LARGE = 0.5, 10.0
INSIDE, BELOW = 0.9, 0.02  # share that is asked for within the band, and that may be too small; none may be too large
SILENT = 0.1  # share of large enough true errors of which nothing need be stated
SAME = 1e-9  # of the scale: a number under several names is one
GROWTH, STEADY = 0.05, 0.8  # of a pressure without limit: see `endless`


@dataclass(frozen=True, kw_only=True)
class Case:
    """One number of one step of one run, and one part of its error."""

    problem: str
    order: int
    mesh: float  # factor on the mesh sizes
    time: float  # [s]
    name: str
    part: str
    stated: float | None  # None: nothing is stated
    true: float
    scale: float
    known: bool = True  # whether the truth is near enough to judge it

    @property
    def size(self) -> float:
        """True error over the scale of its kind [-]."""
        return self.true / self.scale

    @property
    def effectivity(self) -> float:
        """Stated over true."""
        return np.nan if self.stated is None else self.stated / self.true


@dataclass(frozen=True, kw_only=True)
class Endless:
    """The largest pressure of one contact of order 1 in one step, said to have no limit, or without one."""

    problem: str
    mesh: float
    time: float  # [s]
    name: str
    said: bool
    true: bool


@dataclass(frozen=True)
class Share:
    """How many of the counted cases are of the right size."""

    counted: int
    inside: float
    below: float
    above: int
    median: float
    silent: int = 0  # with a true error that is large enough, and none stated

    @classmethod
    def of(cls, cases: Iterable[Case]) -> Share:
        """Of the cases that count."""
        cases = list(cases)
        found = np.array([case.effectivity for case in counted(cases)])
        n = max(len(found), 1)
        return cls(
            counted=len(found),
            inside=float(((found >= LOW) & (found <= HIGH)).sum() / n),
            below=float((found < TOO_SMALL).sum() / n),
            above=int((found > TOO_LARGE).sum()),
            median=float(np.median(found)) if len(found) else np.nan,
            silent=sum(case.stated is None and case.size > COUNTS for case in cases),
        )

    @property
    def said(self) -> bool:
        """Whether some errors are stated, where some are large enough."""
        return bool(self.counted or not self.silent)

    @property
    def enough(self) -> bool:
        """Whether it is what is asked for."""
        if self.silent > SILENT * (self.counted + self.silent):
            return False
        return not self.counted or (self.inside >= INSIDE and self.below <= BELOW and not self.above)


def counted(cases: Iterable[Case]) -> list[Case]:
    """Those with a stated error, and a true one that is large enough, and known."""
    return [case for case in cases if case.stated is not None and case.size > COUNTS and case.known]


def compare(
    problem: str,
    order: int,
    mesh: float,
    part: str,
    run: Answer,
    truth: Answer,
    doubt: Mapping[str, Array] | None = None,
) -> Iterator[Case]:
    """One case for each number of each step of a run; numbers that are the same under several names once.

    Args:
        truth: at the times of the run.
        doubt: how far the truth itself may be off, by number at these times; errors below it are not known.
    """
    for k, time in enumerate(run.times):
        seen = set[tuple[int, int, float]]()
        for name, values in run.values.items():
            scale, stated = float(truth.scales[name][k]), float(run.stated[part][name][k])
            if not scale or run.endless[name][k]:
                continue
            true = abs(float(values[k] - truth.values[name][k]))
            alike = (round(true / scale / SAME), -1 if np.isnan(stated) else round(stated / scale / SAME), scale)
            if alike not in seen:
                seen.add(alike)
                yield Case(
                    problem=problem, order=order, mesh=mesh, time=float(time), name=name, part=part,
                    stated=None if np.isnan(stated) else stated, true=true, scale=scale,
                    known=doubt is None or true >= float(doubt[name][k]),
                )  # fmt: skip


def endless(pressures: Sequence[Array], sizes: Sequence[float]) -> Array:
    """Whether largest pressures (n,) grow without end: on the last mesh as fast as before, by logarithms of sizes.

    Args:
        pressures: (n,) on three or more meshes, each finer than the one before.
        sizes: of their cells, up to a factor.

    >>> h = np.array([4.0, 2.0, 1.0, 0.25])
    >>> endless([np.array([h**-0.3, 1 - 0.1 * h]) for h in h], h)
    array([ True, False])
    """
    before, last = (
        (pressures[k] - pressures[k - 1]) / np.log(sizes[k - 1] / sizes[k]) for k in (len(sizes) - 2, len(sizes) - 1)
    )
    return np.asarray((pressures[-1] > (1 + GROWTH) * pressures[-2]) & (last > STEADY * before))
