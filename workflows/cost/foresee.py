"""The price of accuracy is foretold before anything is solved but coarse versions: `stickslip plan SCENE --cost`.

The scene is solved on meshes that are coarser than its own, of order 1, with the errors of its numbers, until a few
seconds are used. Errors of the mesh and seconds follow powers of the cells' size through the finest of them, errors of
the time steps fall with their number: the cheapest mesh and steps that are expected to be accurate enough are looked
for. An error of a mesh is at least that of all finer ones: where it changes its sign it is small by luck.

Seconds are those of the processor, so that others who work on the machine do not count; the estimates of errors have no
more of them than `output.error_budget` pays for. How far a version was off what the coarser ones foretold is kept from
scene to scene: it tells how sure a price is.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stickslip.geometry.arrays import SLIGHT
from stickslip.geometry.dolfinx_versions import CACHE
from stickslip.geometry.errors import GeometryError, MachineError, SceneError, SolverError, prefixed
from stickslip.solvers.accuracy.budget import budget_of
from stickslip.solvers.parallel.counters import processors
from stickslip.solvers.results.step_result import Errors, Quantity, StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.simulation.simulation import prepare
from stickslip.workflows.accuracy.level import SOLVING
from stickslip.workflows.cost.ladder import COARSEST, FINEST, power_law
from stickslip.workflows.cost.measure import forms
from stickslip.workflows.cost.run_record import RATIO
from stickslip.workflows.formats.files import read_json, write_json
from stickslip.workflows.run.ranks import refuse_mpirun

log = logging.getLogger(__name__)
ASKED = (0.1, 0.01, 0.001)
NUMBERS = (
    "normal_force", "tangential_force", "max_pressure", "contact_area", "stick_area", "slip_area", "dissipation_total",
)  # fmt: skip
LEARNT, KEPT = "prices.json", 50  # what versions were off, in the cache; the last ones
UNKNOWN = 0.2  # off, where nothing is learnt
SPLITS = [2**doublings for doublings in range(13)]  # steps for each of the scene that are looked at


@dataclass(frozen=True)
class Known:
    """A number of the last step of a coarse version, errors relative to it."""

    value: float
    mesh: float = 0.0  # geometry included
    time_step: float = 0.0
    why_not: str = ""  # why its error is not known

    @property
    def error(self) -> float:
        return self.mesh + self.time_step


@dataclass(frozen=True)
class Coarse:
    """A coarse version that was solved."""

    level: int
    unknowns: int
    steps: int
    setup: float  # [s] mesh, assembly, preparation
    step: float  # [s] of each step, with its results
    numbers: Mapping[str, Known]
    error: float = 0.0  # [s] of the estimates of errors

    @property
    def run(self) -> float:
        """Seconds of the whole version without its errors [s]."""
        return self.setup + self.steps * self.step

    @property
    def seconds(self) -> float:
        """Seconds of the whole version [s]."""
        return self.run + self.error


@dataclass(frozen=True)
class Price:
    """Mesh, steps and seconds that an accuracy is expected to take."""

    asked: float
    seconds: float  # [s] of the processor
    factor: float  # of the scene's mesh sizes
    splits: int  # steps for each of the scene
    between: tuple[float, float]  # [s] what it is likely to take, by the scatter of both trends


@dataclass(frozen=True)
class Row:
    """A number, as the finest coarse version has it, and its prices."""

    name: str
    value: float
    error: float  # relative
    prices: tuple[Price | None, ...]  # by ASKED; None: beyond all that is looked at
    why_not: str = ""


def foresee(scene: Scene, seconds: float = 10.0, on_coarse: Callable[[Coarse], None] = lambda one: None) -> list[Row]:
    """Solve coarse versions within some seconds, and tell the prices of the numbers of the contacts.

    Args:
        on_coarse: called with each that is solved.

    Raises:
        SceneError: under mpirun; there is no mesh size to change, no contact, or no coarse version can be solved.
    """
    refuse_mpirun("--cost: measures coarse versions on one core")
    if not scene.contacts:
        raise SceneError("contacts: there is none, and of its numbers the prices are told")
    found = list[Coarse]()
    for one in coarse_versions(scene, seconds):
        found.append(one)
        on_coarse(one)
    if not found:
        raise SceneError("--cost: no coarse version of this scene can be solved in a few seconds; use stickslip cost")
    return rows(found, scene.dim, learnt(found, scene.dim))


def learnt(found: Sequence[Coarse], dim: int, file: Path = CACHE / LEARNT) -> float:
    """By how much prices are off for each level that they go beyond what was solved, as a logarithm.

    What this machine has shown of it before is in a file, to which these versions add; without one they speak alone.
    A file is put in place whole, so that of two processes at once the later one counts.

    Args:
        found: coarse versions, from coarse to fine.
    """
    kept = read_json(file)
    before = kept.get(f"{dim}d")
    off = [one for one in before if isinstance(one, float) and np.isfinite(one)] if isinstance(before, list) else []
    if len(found) > 2:
        *coarser, last = found
        law = _law(coarser, lambda one: one.run, last.level, dim)
        off = [*off, float(np.log(last.run / law)) / (last.level - coarser[-1].level)][-KEPT:]
        aside = file.with_name(f".{file.name}.{os.getpid()}")
        with suppress(OSError, MachineError):  # there may be no room
            write_json(aside, {**kept, f"{dim}d": off})
            aside.replace(file)
    return float(np.sqrt(np.mean(np.square([UNKNOWN, *off]))))


def coarse_versions(scene: Scene, seconds: float) -> Iterator[Coarse]:
    """Versions from coarse to fine, as long as the next one is expected to be solved in time."""
    found, began = list[Coarse](), processors()
    for level in range(COARSEST, FINEST + 1):
        left = seconds - (processors() - began)
        if left <= 0 or (found and _law(found, lambda one: one.seconds, level, scene.dim) > left):
            return
        with prefixed("geometry"):
            shape = replace(scene.geometry.refined(RATIO**-level), order=1)
        mine = replace(scene, geometry=shape, output=Output(pictures=False))
        try:
            before = forms()
            one = _solved(mine, level)
            if not found or forms() != before:  # its seconds were those of libraries or of a compiler
                one = _solved(mine, level)
        except (GeometryError, SceneError, SolverError) as error:
            log.info("level %d: %s", level, error)  # too coarse
            continue
        found.append(one)
        yield one


def _solved(scene: Scene, level: int) -> Coarse:
    simulation = prepare(scene)
    steps = list(simulation.steps())
    errors = simulation.errors(steps)[-1]
    worked = simulation.clock.worked
    setup, each = sum(map(worked, ("mesh", "assemble", "prepare"))), (worked("iterate") + worked("output")) / len(steps)
    unknowns = simulation.system.constraints.free_total
    return Coarse(level, unknowns, len(steps), setup, each, dict(_numbers(steps[-1], errors)), worked("error"))


def _numbers(step: StepResult, errors: Errors) -> Iterator[tuple[str, Known]]:
    """The numbers of all contacts that are not zero."""
    force = max(contact.normal_force for contact in step.contacts.values())
    kinds = {"tangential_force": force, "normal_force": force, "dissipation_total": step.energy.stored}
    for name, contact in step.contacts.items():
        areas = dict.fromkeys(("contact_area", "stick_area", "slip_area"), contact.contact_area)
        for key in NUMBERS:
            value = abs(float(getattr(contact, key)))
            # of the largest of its kind: a smaller number is as good as zero
            if value > SLIGHT * ({**kinds, **areas}.get(key) or 0.0):
                parts = errors[Quantity("contacts", name, key)]
                if parts.converges is False:
                    yield f"{name}.{key}", Known(value, why_not="grows without end as the mesh is refined")
                elif parts.mesh is None or parts.time_step is None:
                    by = "the mesh" if parts.mesh is None else "the time steps"
                    yield f"{name}.{key}", Known(value, why_not=f"its error by {by} is not known")
                else:
                    mesh = float(np.sum([parts.mesh, parts.geometry or 0.0])) / value
                    yield f"{name}.{key}", Known(value, mesh, float(np.sum(parts.time_step)) / value)


def rows(found: Sequence[Coarse], dim: int, off: float = UNKNOWN) -> list[Row]:
    """The prices of all numbers that the finest of the coarse versions has; `off` as of `price`."""
    last = found[-1]
    return [
        Row(name, known.value, known.error, (None,) * len(ASKED), known.why_not)
        if known.why_not
        else Row(name, known.value, known.error, tuple(price(found, name, asked, dim, off) for asked in ASKED))
        for name, known in last.numbers.items()
    ]


def price(found: Sequence[Coarse], name: str, asked: float, dim: int, off: float = UNKNOWN) -> Price | None:
    """The cheapest mesh and steps with which a number is expected to have an error.

    Args:
        found: coarse versions, from coarse to fine.
        off: see `learnt`.
    """
    last = found[-1]
    known, fall = last.numbers[name], trend(found, name)
    best: tuple[float, float, int] | None = None
    for up in np.arange(0, 60, 0.5):
        level = found[0].level + float(up)
        error = fall(level)
        splits = next((n for n in SPLITS if error + known.time_step / n <= asked), None)
        if splits is None:
            continue
        seconds = seconds_of(found, level, splits, dim)
        if best is None or seconds < best[0]:
            best = seconds, level, splits
    if best is None:
        return None
    seconds, level, splits = best
    times, levels = float(np.exp(off * (1 + max(level - last.level, 0.0)))), fall.levels(level)
    low, high = (seconds_of(found, level + sign * levels, splits, dim) for sign in (-1, 1))
    return Price(asked, seconds, RATIO**-level, splits, (low / times, high * times))


def seconds_of(found: Sequence[Coarse], level: float, splits: int, dim: int) -> float:
    """Seconds that a run takes at a level in so many times the steps, with the errors that its budget pays for."""
    setup, each = (_law(found, number, level, dim) for number in (lambda one: one.setup, lambda one: one.step))
    error = _law(found, lambda one: one.error, level, dim)
    whole = setup + found[-1].steps * splits * each
    budget = budget_of(Output(), whole)
    assert budget is not None
    return float(whole + min(splits * error, budget))


@dataclass(frozen=True)
class Trend:
    """The error of a number by the mesh, a power of the cells' size."""

    size: float  # logarithms, as all below: of the cells that are known best, over those of the scene
    error: float  # there
    power: float
    scatter: float  # of `error`
    scatter_of_power: float

    def __call__(self, level: float) -> float:
        """The error at a level."""
        return float(np.exp(self.error - self.power * (self.size + level * np.log(RATIO))))

    def levels(self, level: float) -> float:
        """By how many levels the mesh may differ that has the error of one at a level."""
        away = self.size + level * np.log(RATIO)
        off = np.hypot(self.scatter, self.scatter_of_power * away)
        return float(off / (self.power * np.log(RATIO))) if self.power > 0 else 0.0


def trend(found: Sequence[Coarse], name: str) -> Trend:
    """The error of a number by the mesh, by the finest versions.

    At order 1 errors fall with the power 1.3 of the cells' size, between corners and smooth solutions; beside what is
    observed that counts by (scatter of log errors over that of powers)².
    """
    errors = {one.level: one.numbers[name].mesh for one in found if name in one.numbers}
    envelope = {at: max(error for other, error in errors.items() if other >= at) for at in errors}
    if not all(envelope.values()):
        return Trend(0.0, -np.inf, 1.3, 0.0, 0.0)
    x, y = np.array(list(envelope)) * np.log(RATIO), np.log(list(envelope.values()))
    off, scatter = x - x.mean(), 0.4
    sure = (scatter / 0.5) ** 2
    power = (sure * 1.3 - off @ y) / (off @ off + sure)
    return Trend(-x.mean(), y.mean(), power, scatter / np.sqrt(len(x)), scatter / np.sqrt(off @ off + sure))


def _law(found: Sequence[Coarse], number: Callable[[Coarse], float], level: float, dim: int) -> float:
    """Seconds at a level: what every version takes, and what grows with the cells, at most as solving does.

    Of the seconds of the fastest version 90 % are those of a mesh without cells.
    """
    all_take = 0.9 * min(number(one) for one in found)
    if not all_take:
        return 0.0
    return all_take + power_law({one.level: number(one) - all_take for one in found}, level, dim, SOLVING * dim)
