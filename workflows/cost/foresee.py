"""The price of accuracy is foretold before anything is solved but coarse versions: `stickslip plan SCENE --cost`.

The scene is solved on meshes that are coarser than its own, of order 1, with the errors of its numbers, until a few
seconds are used. Errors of the mesh and seconds follow powers of the cells' size through the finest of them, errors of
the time steps fall with their number: the cheapest mesh and steps that are expected to be accurate enough are looked
for. An error of a mesh is at least that of all finer ones: where it changes its sign it is small by luck.
"""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import SLIGHT
from stickslip.geometry.errors import GeometryError, SceneError, SolverError, prefixed
from stickslip.solvers.results.step_result import Errors, Quantity, StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.simulation.simulation import prepare
from stickslip.workflows.accuracy.level import SOLVING
from stickslip.workflows.cost.ladder import COARSEST, FINEST, power_law
from stickslip.workflows.cost.measure import forms
from stickslip.workflows.cost.run_record import RATIO
from stickslip.workflows.run.ranks import refuse_mpirun

log = logging.getLogger(__name__)
ASKED = (0.1, 0.01, 0.001)
NUMBERS = (
    "normal_force", "tangential_force", "max_pressure", "contact_area", "stick_area", "slip_area", "dissipation_total",
)  # fmt: skip
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
    step: float  # [s] of each step, with its errors and results
    numbers: Mapping[str, Known]

    @property
    def seconds(self) -> float:
        """Seconds of the whole version [s]."""
        return self.setup + self.steps * self.step


@dataclass(frozen=True)
class Price:
    """Mesh, steps and seconds that an accuracy is expected to take."""

    asked: float
    seconds: float  # [s]
    factor: float  # of the scene's mesh sizes
    splits: int  # steps for each of the scene
    far: bool  # more than two decades beyond what was solved, in the error or the seconds


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
    return rows(found, scene.dim)


def coarse_versions(scene: Scene, seconds: float) -> Iterator[Coarse]:
    """Versions from coarse to fine, as long as the next one is expected to be solved in time."""
    found, began = list[Coarse](), clock.perf_counter()
    for level in range(COARSEST, FINEST + 1):
        left = seconds - (clock.perf_counter() - began)
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
    told = simulation.seconds
    setup = told.mesh + told.assemble + told.prepare
    each = (told.iterate + told.error + told.output) / len(steps)
    unknowns = simulation.system.constraints.free_total
    return Coarse(level, unknowns, len(steps), setup, each, dict(_numbers(steps[-1], errors)))


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


def rows(found: Sequence[Coarse], dim: int) -> list[Row]:
    """The prices of all numbers that the finest of the coarse versions has."""
    last = found[-1]
    return [
        Row(name, known.value, known.error, (None,) * len(ASKED), known.why_not)
        if known.why_not
        else Row(name, known.value, known.error, tuple(price(found, name, asked, dim) for asked in ASKED))
        for name, known in last.numbers.items()
    ]


def price(found: Sequence[Coarse], name: str, asked: float, dim: int) -> Price | None:
    """The cheapest mesh and steps with which a number is expected to have an error.

    Args:
        found: coarse versions, from coarse to fine.
    """
    last = found[-1]
    known = last.numbers[name]
    best: tuple[float, float, int] | None = None
    for up in np.arange(0, 60, 0.5):
        level = found[0].level + float(up)
        error = mesh_error(found, name, level)
        splits = next((n for n in SPLITS if error + known.time_step / n <= asked), None)
        if splits is None:
            continue
        setup = _law(found, lambda one: one.setup, level, dim)
        each = _law(found, lambda one: one.step, level, dim)
        seconds = setup + last.steps * splits * each
        if best is None or seconds < best[0]:
            best = seconds, level, splits
    if best is None:
        return None
    far = best[0] > 100 * last.seconds or known.error > 100 * asked
    return Price(asked, best[0], RATIO ** -best[1], best[2], far)


def mesh_error(found: Sequence[Coarse], name: str, level: float) -> float:
    """The error of a number by the mesh at a level, by the trend of the finest versions.

    At order 1 errors fall with the power 1.3 of the cells' size, between corners and smooth solutions; beside what is
    observed that counts by (scatter of log errors .4 over that of powers .5)².
    """
    errors = {one.level: one.numbers[name].mesh for one in found if name in one.numbers}
    envelope = {at: max(error for other, error in errors.items() if other >= at) for at in errors}
    if not all(envelope.values()):
        return 0.0
    x, y = np.array(list(envelope)) * np.log(RATIO), np.log(list(envelope.values()))
    off = x - x.mean()
    sure = 0.64
    power = (off @ y - sure * 1.3) / (off @ off + sure)
    return float(np.exp(y.mean() + power * (level * np.log(RATIO) - x.mean())))


def _law(found: Sequence[Coarse], number: Callable[[Coarse], float], level: float, dim: int) -> float:
    """Seconds at a level: what every version takes, and what grows with the cells, at most as solving does.

    Of the seconds of the fastest version 90 % are those of a mesh without cells.
    """
    all_take = 0.9 * min(number(one) for one in found)
    return all_take + power_law({one.level: number(one) - all_take for one in found}, level, dim, SOLVING * dim)
