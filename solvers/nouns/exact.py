"""What is known about the answer beforehand, for `stickslip cost` to measure errors by."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated

from geometry.errors import nearest, require
from geometry.keys import Key, Noun


@dataclass(frozen=True, kw_only=True)
class Exact(Noun):
    """Numbers of the last step that a closed form or a reference gives; they change no answer."""

    values: Annotated[
        Mapping[str, float],
        Key("-", 'by quantity, e.g. "base.normal_force" = 2e6, "probe.corner.displacement.x", "energy.stored"'),
    ] = field(default_factory=dict)
    source: Annotated[str, Key("-", "where they stand")] = ""
    accuracy: Annotated[float, Key("-", "how exact they are, relative: smaller errors mean nothing")] = 0.0

    def __post_init__(self) -> None:
        require(0 <= self.accuracy < 1, "accuracy", self.accuracy, "must lie between 0 and 1")

    def check(self, known: Iterable[str]) -> None:
        """Refuse quantities that the scene does not have."""
        names = tuple(known)
        for name, value in self.values.items():
            require(name in names, "exact.values", name, f"no such quantity; {nearest(name, names)}")
            require(math.isfinite(value), f"exact.values.{name}", value, "must be a finite number")
