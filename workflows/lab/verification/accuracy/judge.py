"""Stated errors beside true ones: which count, which share is of the right size, and which pressures have no limit.

All numbers of a solved history with their stated errors, component by component, and the scales that judge them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import NamedTuple

import numpy as np

from stickslip import ErrorParts, Quantity, Scene, Simulation, StepResult, prepare
from stickslip.geometry.arrays import EXACT, Array
from stickslip.geometry.surfaces.surface import SECTOR
from stickslip.solvers.accuracy.areas import areas_inside_facets
from stickslip.solvers.accuracy.histories import largest_stresses
from stickslip.solvers.accuracy.mesh_error import at_ends, corrected
from stickslip.solvers.results.recovered_stress import RecoveredStress
from stickslip.solvers.results.step_result import Errors, number_of, quantities
from stickslip.solvers.scene.record import STRESSES, Value

MESH, TIME, ITERATION, TOTAL = "mesh", "time_step", "iteration", "total"
PARTS = {  # as they are judged, of the parts of `ErrorParts`: what no truth can tell apart is one
    MESH: ("mesh", "geometry"),
    TIME: ("time_step",),
    ITERATION: ("iteration", "linear_solver"),
    TOTAL: ("total",),
}
WORTH = 1e-3  # of the stored energy; the error of a smaller dissipation is not judged
Column = Mapping[str, Array]  # (n,) for each of n steps, by the name of a number


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The numbers of all n steps of a history, in SI units; vectors by component: contacts.base.force.x."""

    times: Array  # (n,) [s]
    values: Column
    stated: Mapping[str, Column]  # errors by part; nan: none is stated
    endless: Column  # 1 where it is said that the number has no limit on ever finer meshes
    scales: Column  # what an error is measured by; 0: it is not judged
    ends: Column = field(default_factory=dict)  # the numbers, but stresses of bodies at corners of cells
    unknowns: int
    price: float = np.nan  # seconds of the errors over those of all else

    def at(self, times: Array) -> Answer:
        """The same at some of its times alone; what a step dissipates is that of all steps since the time before."""
        k = np.array([np.abs(self.times - time).argmin() for time in times])

        def some(columns: Column) -> Column:
            return {name: column[k] for name, column in columns.items()}

        own = {name: values for name, values in self.values.items() if quantity(name).quantity == "dissipation"}
        sums = {name: np.diff(np.cumsum(values)[k], prepend=0.0) for name, values in own.items()}
        stored = self.scales["energy.stored"][k]
        return replace(
            self,
            times=self.times[k],
            values={**some(self.values), **sums},
            stated={part: some(columns) for part, columns in self.stated.items()},
            endless=some(self.endless),
            ends=some(self.ends),
            scales={**some(self.scales), **{name: _worth(values, stored) for name, values in sums.items()}},
        )


def solve(
    scene: Scene, errors: bool = True, sharp: Sequence[float] | Array = (), budget: float | None = None
) -> Answer:
    """Solve all steps.

    Args:
        errors: whether they are estimated.
        sharp: times [s] at which edges of areas lie between nodes, and stresses of bodies are those at corners of
            cells: by nodes and midpoints alone a number on a fine mesh would be known to no better than a fraction of
            its error on others.
        budget: seconds that errors may take, in those of all else, which the run is solved for once more; None: as the
            scene has it.
    """
    output = replace(scene.output, error=errors)
    if budget is not None:
        alone = prepare(replace(scene, output=replace(output, error=False)))
        tuple(alone.steps())
        output = replace(output, error_budget=budget * sum(asdict(alone.seconds).values()))
    simulation = prepare(replace(scene, output=output))
    steps = tuple(_sharper(simulation, step, sharp) for step in simulation.steps())
    found = simulation.errors(steps) if errors else tuple({key: ErrorParts() for key in quantities(s)} for s in steps)
    seconds = asdict(simulation.seconds)
    better = [corrected(step) if len(sharp) else {} for step in steps]
    values = _columns([dict(_numbers(quantities(s) | found)) for s, found in zip(steps, better, strict=True)])
    return Answer(
        times=np.array([step.time for step in steps]),
        values=values,
        stated={part: _columns([dict(_part(s, e, part)) for s, e in zip(steps, found, strict=True)]) for part in PARTS},
        endless=_columns([dict(_endless(s, e)) for s, e in zip(steps, found, strict=True)]),
        scales=_scales(simulation, steps, values),
        ends=_columns([dict(_numbers(at_ends(step))) for step in steps]),
        unknowns=simulation.system.T.size[0],
        price=seconds["error"] / (sum(seconds.values()) - seconds["error"]),
    )


def _sharper(simulation: Simulation, step: StepResult, sharp: Sequence[float] | Array) -> StepResult:
    """A step that was just solved, with better numbers at some times, see `solve`."""
    if not len(sharp) or np.abs(np.array(sharp) - step.time).min() > EXACT * simulation.scene.steps.end:
        return step
    assert simulation.reported is not None
    areas = areas_inside_facets(simulation.system.contacts, step)
    recovered = RecoveredStress(simulation.system)
    stresses = largest_stresses(simulation.observer, recovered, simulation.reported, step)
    return replace(step, corrected=stresses | {str(key): value for key, value in areas.items()})


def quantity(name: str) -> Quantity:
    """
    >>> quantity("contacts.base.force.x")[:2], str(quantity("energy.stored"))
    (('contacts', 'base'), 'energy.stored')
    """
    table, *words = name.split(".")
    if words[-1] in (*"xyz", *STRESSES):  # a component
        words.pop()
    return Quantity(table, ".".join(words[:-1]), words[-1])


def kind(name: str) -> str:
    """Kind of a number; dissipation is one of its own."""
    key = quantity(name)
    return "dissipation" if key.quantity.startswith("dissipat") else number_of(key).kind


def _numbers(values: Mapping[Quantity, Value]) -> Iterator[tuple[str, float]]:
    """Numbers by name, vectors by component."""
    for key, value in values.items():
        if np.ndim(value) == 0:
            yield str(key), float(value)
        else:
            words = tuple(STRESSES) if key.quantity == "stress" else "xyz"
            yield from ((f"{key}.{word}", float(each)) for word, each in zip(words, np.asarray(value), strict=False))


def _part(step: StepResult, errors: Errors, part: str) -> Iterator[tuple[str, float]]:
    """A part of the stated errors by name; nan where one of what it sums up is not stated."""
    return _numbers({key: _sum_of(errors[key], part, value) for key, value in quantities(step).items()})


def _sum_of(error: ErrorParts, part: str, like: Value) -> Array:
    terms: list[Value | None] = [getattr(error, word) for word in PARTS[part]]
    all_terms = [np.broadcast_to(np.nan if term is None else term, np.shape(like)) for term in terms]
    return np.asarray(np.sum(all_terms, axis=0))


def _endless(step: StepResult, errors: Errors) -> Iterator[tuple[str, float]]:
    return _numbers({k: 0.0 * value + (errors[k].converges is False) for k, value in quantities(step).items()})


def _columns(rows: Sequence[Mapping[str, float]]) -> Column:
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _scales(simulation: Simulation, steps: Sequence[StepResult], values: Column) -> Column:
    """Scales of errors of numbers: the largest of their kind in all steps; a dissipation by itself."""
    contacts = simulation.system.contacts
    states = [contact for step in steps for contact in step.contacts.values()]
    force = max(contact.normal_force for contact in states)
    moved = {
        c.name: max(
            _longest(step.displacement[side.input % SECTOR]) for step in steps for side in (c.surface, c.master) if side
        )
        for c in contacts
    }
    pressure = max(contact.max_pressure for contact in states)
    areas = {name: float(contact.weight.sum()) for name, contact in steps[0].contacts.items()}
    areas |= {name: max(areas[part] for part in steps[0].parts(name)) for name in steps[0].sums}
    stored = float(values["energy.stored"].max())
    everywhere = max(_longest(step.displacement) for step in steps)
    found = {}
    for name, column in values.items():
        owner = quantity(name).name
        size: dict[str, float | Array] = {
            "force": force,
            "moment": force * simulation.system.extent,
            "area": areas.get(owner, 0.0),
            "pressure": pressure,
            "length": moved.get(owner, everywhere),
            "dissipation": _worth(column, stored),
            "energy": stored,
        }
        found[name] = size[kind(name)] + np.zeros(len(steps))
    return found


def _worth(dissipation: Array, stored: Array | float) -> Array:
    """Scale of a dissipation (n,) [J]: itself; 0 where it is little beside the stored energy."""
    return np.where(dissipation > WORTH * stored, dissipation, 0.0)


def _longest(displacement: Array) -> float:
    return float(np.linalg.norm(displacement, axis=1).max(initial=0.0))


COUNTS = 1e-3  # of the scale of its kind; a smaller true error does not count
SURE = 5.0  # times the doubt of its truth: a smaller true error is not known
LOW, HIGH = 0.7, 3.0  # stated / true within: of the right size
TOO_SMALL, TOO_LARGE = 0.5, 10.0


class Asked(NamedTuple):
    """Share that is asked for within the band; and of what may be too small, too large, or not stated."""

    inside: float
    below: float
    above: float
    silent: float


OF_PROBLEMS = Asked(0.9, 0.02, 0.0, 0.1)
OF_DRAWN = {1: Asked(0.9, 0.04, 0.01, 0.03), 2: Asked(0.85, 0.05, 0.01, 0.03)}  # by order
WORST, MANY = 0.65, 20  # share within the band of each drawn scene of so many numbers
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
    """Share of the counted cases that are of the right size."""

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
            silent=sum(case.stated is None and case.size > COUNTS and case.known for case in cases),
        )

    @property
    def said(self) -> bool:
        """Whether some errors are stated, where some are large enough."""
        return bool(self.counted or not self.silent)

    def meets(self, asked: Asked) -> bool:
        """Whether it is what is asked for."""
        if self.silent > asked.silent * (self.counted + self.silent):
            return False
        right = self.inside >= asked.inside and self.below <= asked.below
        return not self.counted or (right and self.above <= asked.above * self.counted)


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
        doubt: how far the truth itself may be off, by number at these times; errors below `SURE` times it are not
            known. Of the others none is stated where a number is said to have no limit.
    """
    for k, time in enumerate(run.times):
        seen = set[tuple[int, int, float]]()
        for name, values in run.values.items():
            scale, limitless = float(truth.scales[name][k]), bool(run.endless[name][k])
            if not scale or (limitless and doubt is None):
                continue
            stated = np.nan if limitless else float(run.stated[part][name][k])
            true = abs(float(values[k] - truth.values[name][k]))
            alike = (round(true / scale / SAME), -1 if np.isnan(stated) else round(stated / scale / SAME), scale)
            if alike in seen:
                continue
            seen.add(alike)
            known = doubt is None or true >= SURE * float(doubt[name][k])
            if known or not limitless:
                yield Case(
                    problem=problem, order=order, mesh=mesh, time=float(time), name=name, part=part,
                    stated=None if np.isnan(stated) else stated, true=true, scale=scale, known=known,
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
