"""A block on the ground that friction and weight hold up to a known time: pushed, lifted, tipped, unloaded, shaken.

A rigid block of length L and height H presses on the ground with N and is pushed at mid-height with F: it rests while
F <= mu N and F H / 2 <= N L / 2. An elastic one, small displacements, rests as long: of its shape only L and H enter.
A force that grows by straight lines crosses its limit at one time, and from then on there is no equilibrium.

Source: statics.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

Table = tuple[tuple[float, float], ...]
END = 4.0  # [s]


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Forces on a block by time, and the time at which equilibrium ends."""

    length: float  # [m]
    height: float  # [m]
    mu: float
    press: Table  # N on top, negative: lifting [N]
    push: Table  # F on the left side [N]

    @property
    def time(self) -> float:
        """The first time at which what is left, mu N - |F|, N or (N L - |F| H) / 2, crosses zero [s].

        >>> round(Limit(length=2.0, height=1.0, mu=0.5, press=STEADY, push=((0.0, 0.0), (4.0, 1.0))).time, 12)
        2.0
        """
        times = sorted({t for t, _ in (*self.press, *self.push)} | {END})
        for before, after in pairwise(times):
            crossed = [
                before + (after - before) * a / (a - b)
                for a, b in zip(self._left(before), self._left(after), strict=True)
                if b < 0
            ]
            if crossed:
                return min(crossed)
        raise ValueError("these loads are held to the end")

    def pressed(self, time: float) -> float:
        """N [N]."""
        return _at(self.press, time)

    def pushed(self, time: float) -> float:
        """F [N]."""
        return _at(self.push, time)

    def _left(self, time: float) -> tuple[float, ...]:
        """Linear between the listed times; both senses of the push are told apart."""
        N, F = self.pressed(time), self.pushed(time)
        slide, tip = self.mu * N, N * self.length / self.height
        return slide - F, slide + F, N, tip - F, tip + F


def _at(table: Table, time: float) -> float:
    """Straight between the entries, constant beyond."""
    return float(np.interp(time, [t for t, _ in table], [force for _, force in table]))


STEADY: Table = ((0.0, 1.0),)
NONE: Table = ((0.0, 0.0),)
LIMITS: Mapping[str, Limit] = {
    "pushed": Limit(length=2.0, height=1.0, mu=0.5, press=STEADY, push=((0.0, 0.0), (END, 0.7))),
    "tipped": Limit(length=1.0, height=2.0, mu=2.0, press=STEADY, push=((0.0, 0.0), (END, 0.7))),
    "lifted": Limit(length=2.0, height=1.0, mu=0.5, press=((0.0, 1.0), (END, -0.3)), push=NONE),
    "pushed, then let go": Limit(
        length=2.0, height=1.0, mu=0.5, press=((0.0, 1.0), (1.0, 1.0), (END, 0.1)), push=((0.0, 0.0), (1.0, 0.3))
    ),
    "shaken": Limit(
        length=2.0, height=1.0, mu=0.5, press=STEADY,
        push=((0.0, 0.0), (0.5, 0.25), (1.5, -0.35), (2.5, 0.45), (END, -0.8)),
    ),
}  # fmt: skip
