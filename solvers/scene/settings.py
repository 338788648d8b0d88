"""When to solve, how exactly, what to write, where to probe, and what is known of the answer beforehand."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

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


@dataclass(frozen=True, kw_only=True)
class Steps(Noun):
    """Equal steps; these and every time listed in a table are hit."""

    end: Annotated[float, Key("s", "last time")] = 1.0
    count: Annotated[int, Key("-", "number of equal steps")] = 1

    def __post_init__(self) -> None:
        require(self.end > 0, "end", self.end, "must be positive")
        require(1 <= self.count <= 1_000_000, "count", self.count, "must be a whole number from 1 to 1000000")


@dataclass(frozen=True, kw_only=True)
class Solver(Noun):
    """The method, and the residual at which a step counts as solved."""

    method: Annotated[str, Key("-", "solution method")] = "auto"
    surface: Annotated[
        Literal["auto", "condensed", "matrix-free"],
        Key("-", "how contact feels the bodies: an exact dense stiffness of its dofs, or iterative solves"),
    ] = "auto"
    tolerance: Annotated[float, Key("-", "on the natural residual, relative to p_ref")] = 1e-8
    max_iterations: Annotated[int, Key("-", "per step")] = 10000

    def __post_init__(self) -> None:
        require(0 < self.tolerance < 1, "tolerance", self.tolerance, "must lie between 0 and 1, for example 1e-8")
        require(self.max_iterations >= 1, "max_iterations", self.max_iterations, "must be at least 1")

    @classmethod
    def default(cls) -> Solver:
        """All defaults, with the keys of every method where `solvers.methods` has declared them."""
        return (cls.__subclasses__() or [cls])[-1]()


@dataclass(frozen=True, kw_only=True)
class Output(Noun):
    """What is written."""

    every: Annotated[int, Key("-", "keep the fields of every n-th reported step, and of the last")] = 1
    pictures: Annotated[bool, Key("-", "draw PNG pictures of the last step")] = True
    animation: Annotated[
        Literal["none", "gif"], Key("-", "gif: draw animation.gif, the bodies and contacts from step to step")
    ] = "none"
    linear_reference: Annotated[bool, Key("-", "after the run, time one linear solve of the same mesh")] = False

    def __post_init__(self) -> None:
        require(self.every >= 1, "every", self.every, "must be at least 1")


@dataclass(frozen=True, kw_only=True)
class Probe(Noun):
    """Displacement and stress at a point, each step."""

    point: Annotated[tuple[float, ...], Key("m", "inside a body or on its boundary")]
