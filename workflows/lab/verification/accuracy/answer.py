"""All numbers of a solved history with their stated errors, component by component, and the scales that judge them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.accuracy.areas import areas_of_order_2
from stickslip.solvers.results.step_result import ErrorParts, Errors, Quantity, StepResult, number_of, quantities
from stickslip.solvers.scene.record import STRESSES, Value
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation, prepare

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
    unknowns: int

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
            scales={**some(self.scales), **{name: _worth(values, stored) for name, values in sums.items()}},
        )


def solve(scene: Scene, errors: bool = True, sharp: bool = False) -> Answer:
    """Solve all steps.

    Args:
        errors: whether they are estimated.
        sharp: whether edges of areas lie between nodes; of order 2 in 2D.
    """
    simulation = prepare(replace(scene, output=replace(scene.output, error=errors)))
    steps = tuple(simulation.steps())
    found = simulation.errors(steps) if errors else tuple({key: ErrorParts() for key in quantities(s)} for s in steps)
    areas = [_sharp_areas(simulation, step) if sharp and scene.dim == 2 else {} for step in steps]
    values = _columns([dict(_numbers(quantities(s))) | found for s, found in zip(steps, areas, strict=True)])
    return Answer(
        times=np.array([step.time for step in steps]),
        values=values,
        stated={part: _columns([dict(_part(s, e, part)) for s, e in zip(steps, found, strict=True)]) for part in PARTS},
        endless=_columns([dict(_endless(s, e)) for s, e in zip(steps, found, strict=True)]),
        scales=_scales(simulation, steps, values),
        unknowns=simulation.system.T.size[0],
    )


def quantity(name: str) -> Quantity:
    """
    >>> quantity("contacts.base.force.x")[:2], str(quantity("energy.stored"))
    (('contacts', 'base'), 'energy.stored')
    """
    table, *words = name.split(".")
    return Quantity(table, "", words[0]) if table == "energy" else Quantity(table, *words[:2])


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


def _sharp_areas(simulation: Simulation, step: StepResult) -> dict[str, float]:
    """Areas of all contacts whose edges lie between nodes [m], in 2D; nodes of order 2 as those of half as long facets.

    By nodes alone, an area on the fine mesh would be known to no better than a fraction of its error on the others.
    """
    found = dict[str, float]()
    for c in simulation.system.contacts:
        contact = step.contacts[c.name]
        areas = areas_of_order_2(c.surface, contact, contact.weight)
        found |= {f"contacts.{c.name}.{key}": area for key, area in areas.items()}
    return found


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
    """What errors of numbers are measured by: the largest of their kind in all steps; a dissipation by itself."""
    contacts = simulation.system.contacts
    states = [contact for step in steps for contact in step.contacts.values()]
    force = max(contact.normal_force for contact in states)
    moved = {
        c.name: max(_longest(step.displacement[side.input]) for step in steps for side in (c.surface, c.master) if side)
        for c in contacts
    }
    pressure = max(contact.max_pressure for contact in states)
    areas = {name: float(contact.weight.sum()) for name, contact in steps[0].contacts.items()}
    stored = float(values["energy.stored"].max())
    everywhere = max(_longest(step.displacement) for step in steps)
    found = {}
    for name, column in values.items():
        owner = name.split(".")[1]
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
