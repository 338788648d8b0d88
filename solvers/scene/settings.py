"""Settings of a scene: steps, solver, output, probes, and exact values to compare with."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator

from stickslip.geometry.errors import require, require_components
from stickslip.geometry.keys import Key, Keys, Noun, Vector
from stickslip.geometry.shape import Model, dimensions

SMALLEST, LARGEST = 1e-100, 1e100  # of numbers other than 0; powers of those far beyond are 0 or infinite


@dataclass(frozen=True, kw_only=True)
class Exact(Noun):
    """Known values of the last step from a closed form or a reference; they do not change the solution."""

    values: Annotated[
        Mapping[str, float],
        Key("-", 'by quantity, e.g. "base.normal_force" = 2e6, "probe.corner.displacement.x", "energy.stored"'),
    ] = field(default_factory=dict)
    source: Annotated[str, Key("-", "where the values are published")] = ""
    accuracy: Annotated[float, Key("-", "relative accuracy of the values; smaller errors cannot be judged")] = 0.0

    def __post_init__(self) -> None:
        require(0 <= self.accuracy < 1, "accuracy", self.accuracy, "must lie between 0 and 1")


@dataclass(frozen=True, kw_only=True)
class Accuracy(Noun):
    """Accuracy asked of numbers of the last step: mesh, time steps and tolerance are refined until it is reached."""

    goals: Annotated[
        Mapping[str, float],
        Key("-", 'largest relative error by quantity, e.g. "base.normal_force" = 0.01; see `stickslip run --accuracy`'),
    ] = field(default_factory=dict)
    budget: Annotated[float, Key("s", "of all rounds together; no round is begun that would exceed it")] = 600.0

    def __post_init__(self) -> None:
        require(self.budget > 0, "budget", self.budget, "must be positive")
        for name, share in self.goals.items():
            require(0 < share < 1, f"goals.{name}", share, "must lie between 0 and 1, for example 0.01")


@dataclass(frozen=True, kw_only=True)
class Clock(Noun):
    """Steps that follow slip rates, by their own error; times are seconds."""

    error: Annotated[float, Key("-", "largest error that a step adds: of slip by Dc, and of ln(theta)")]
    smallest: Annotated[float, Key("s", "shortest step: one that has to be shorter is given up; also the first one")]
    largest: Annotated[float, Key("s", "longest step")]
    event: Annotated[
        float, Key("m/s", "slip rate from which an event lasts, until all points are slower than a tenth of it")
    ] = 1e-3
    every: Annotated[int | None, Key("-", "report each n-th step of the clock; absent: tables' times and events")] = (
        None
    )

    def __post_init__(self) -> None:
        require(self.every is None or self.every >= 1, "every", self.every, "must be at least 1")
        require(0 < self.error < 1, "error", self.error, "must lie between 0 and 1, for example 1e-4")
        require(self.smallest > 0, "smallest", self.smallest, "must be positive, in seconds")
        require(self.largest >= self.smallest, "largest", self.largest, "must not be less than `smallest`")
        require(self.event > 0, "event", self.event, "must be positive, in m/s")


@dataclass(frozen=True, kw_only=True)
class Cycle(Noun):
    """One load cycle that stands for many: worn depth goes on in batches of cycles, and the last one is told."""

    from_: Annotated[float, Key("s", "its beginning; the key is `from`")]
    to: Annotated[float, Key("s", "its end, with the loads and motions of its beginning")]
    repeat: Annotated[float, Key("-", "number of cycles that it stands for")]
    error: Annotated[float, Key("-", "of worn depth, relative to the largest: one batch against two halves")] = 0.01

    def __post_init__(self) -> None:
        require(self.from_ >= 0, "from", self.from_, "must not be negative, in seconds")
        require(self.to > self.from_, "to", self.to, "must be later than `from`")
        require(self.repeat >= 1 and self.repeat % 1 == 0, "repeat", self.repeat, "must be a whole number from 1 on")
        require(0 < self.error < 1, "error", self.error, "must lie between 0 and 1, for example 0.01")


@dataclass(frozen=True, kw_only=True)
class Steps(Noun):
    """Equal steps in time; steps end exactly at these times, and at every time listed in a table."""

    end: Annotated[float, Key("s", "last time")] = 1.0
    count: Annotated[int, Key("-", "number of equal steps")] = 1
    seconds: Annotated[bool, Key("-", "times are seconds, as laws by slip rate need; false: they only order")] = False
    clock: Annotated[
        Clock | None, Key("-", "steps by their error, of friction by rate and state; absent: `count` equal ones")
    ] = None
    cycle: Annotated[Cycle | None, Key("-", "a part that stands for many load cycles, of wear; absent: none")] = None

    def __post_init__(self) -> None:
        require(self.end > 0, "end", self.end, "must be positive")
        require(SMALLEST <= self.end <= LARGEST, "end", self.end, f"must be from {SMALLEST:g} to {LARGEST:g} s")
        require(1 <= self.count <= 1_000_000, "count", self.count, "must be a whole number from 1 to 1000000")
        require(self.clock is None or self.count == 1, "count", self.count, "leave it out: the clock finds the steps")
        if self.cycle is not None:
            require(self.clock is None, "cycle", "given", "leave it out: a clock follows each cycle by itself")
            require(
                self.cycle.to <= self.end, "cycle.to", self.cycle.to, f"must not be later than the end, {self.end:g}"
            )


@dataclass(frozen=True, kw_only=True)
class Solver(Noun):
    """The method, and the residual at which a step counts as solved."""

    method: Annotated[str, Key("-", "solution method")] = "auto"
    surface: Annotated[
        Literal["auto", "condensed", "matrix-free"],
        Key("-", "form of the bodies: an exact dense stiffness of the contact dofs, or iterative solves"),
    ] = "auto"
    tolerance: Annotated[float, Key("-", "on the natural residual, relative to the largest traction")] = 1e-8
    max_iterations: Annotated[int, Key("-", "per step")] = 10000

    def __post_init__(self) -> None:
        require(0 < self.tolerance < 1, "tolerance", self.tolerance, "must lie between 0 and 1, for example 1e-8")
        require(self.max_iterations >= 1, "max_iterations", self.max_iterations, "must be at least 1")

    @classmethod
    def default(cls) -> Solver:
        """All defaults; with the keys of every method, if `stickslip.solvers.method_registry` is imported."""
        return (cls.__subclasses__() or [cls])[-1]()


def _infinite(value: Any) -> Any:
    return "inf" if value == math.inf else value


@dataclass(frozen=True, kw_only=True)
class Output(Noun):
    """Which results are written.

    Writers may add their own keys to this table, which are given and replaced like all others (`Output(vtu=True)`);
    those that differ from their default are kept in `writers`.
    """

    of_writers: ClassVar[Callable[[], Mapping[str, tuple[Any, Any]]]] = dict  # type and default of each added key

    every: Annotated[int, Key("-", "keep the fields of every n-th reported step, and of the last")] = 1
    step_files: Annotated[
        Literal["all", "every"],
        Key("-", "every: fields and checkpoint of `every`-th steps alone are stored, and --resume goes on from these"),
    ] = "all"
    pictures: Annotated[bool, Key("-", "draw PNG pictures of the last step")] = True
    animation: Annotated[
        Literal["none", "gif"], Key("-", "gif: draw animation.gif, the bodies and contacts from step to step")
    ] = "none"
    audit: Annotated[
        bool, Key("-", "after the run, check every step's file against equilibrium and the contact laws")
    ] = True
    error: Annotated[
        bool | Literal["full", "rough"],
        Key("-", "estimate the errors of mesh and time steps; full: whatever it costs; rough: by a coarser mesh alone"),
    ] = True
    error_budget: Annotated[
        float | Literal["inf"] | None,
        BeforeValidator(_infinite),
        Key("s", "of the estimates, where `error` is true; absent: the larger of the run's own seconds and 10"),
    ] = None
    linear_reference: Annotated[bool, Key("-", "after the run, time one linear solve of the same mesh")] = False
    writers: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def added(cls) -> Keys:
        return {key: kind for key, (kind, _) in cls.of_writers().items()}

    @classmethod
    def gathered(cls, values: Keys) -> Keys:
        known = cls.of_writers()
        given = {key: value for key, value in values.items() if key in known}
        kept = {key: value for key, value in values.get("writers", {}).items() if key not in given}
        kept |= {key: value for key, value in given.items() if value not in (None, known[key][1])}
        return {key: value for key, value in values.items() if key not in given} | {"writers": kept}

    def stores(self, index: int) -> bool:
        """Whether the fields of step `index` (from 1 on) are stored, were it not the last one."""
        return self.step_files == "all" or index % self.every == 0

    def __post_init__(self) -> None:
        require(self.every >= 1, "every", self.every, "must be at least 1")
        if isinstance(self.error_budget, float):
            require(self.error_budget >= 0, "error_budget", self.error_budget, "must not be negative")


@dataclass(frozen=True, kw_only=True)
class Probe(Noun):
    """Displacement and stress at a point, each step."""

    point: Annotated[Vector, Key("m", "inside a body or on its boundary")]

    def check_model(self, model: Model) -> None:
        """Refuse components that the model does not have, or lacks."""
        require_components(self.point, "point", dimensions(model))
