"""Error of the mesh of every number, from its history on better cells and on coarser ones.

Of a run of order 1 the better ones are its own cells with order 2, in the plane cut where the error comes from, see
`nested_run`: beside singular ends, and where less than a facet touches or slips, order 2 alone leaves most of the
error. Stated is BETTER times the difference, no less than a third of that to cells twice as long, as the difference to
order 2 may vanish by chance: it is the error if that falls with their area. Where most numbers of the step are off by
less of that, no chance makes them so, and that part of it is the least: long cells that lock err more. A mesh that is
a file's has no such cells.
Curved sides are curved with order 2: the part of the geometry is in that of the mesh. One rule holds for every kind of
number. Areas, which are multiples of a node's area, are compared with that whose edges lie between nodes, see `areas`,
and with the sum over nodes, of which half of the difference counts, as of all that is rounded; the larger is stated.

Where order 2 is too dear, the better numbers are those with bubbles, see `two_level`, which have no contact nodes of
their own: what these decide, `AT_NODES`, is stated to be off by all of the difference to cells twice as long.

With order 2 the better cells in the plane are cut likewise. In 3D they are those of a fresh mesh with smaller cells,
and errors are taken to fall with their area. Where that is too dear, bubbles of order 3 tell of what contact nodes do
not decide. No less is stated than what is left of the difference to cells twice as long if the error falls with the
third power of their length, of stresses and of what contact nodes decide with the second: the largest value of a
plateau lies anywhere. Where nothing else tells, half of the difference: it is the error if that falls with the power
1.6, and no order is between the smooth and the singular ones.

A pressure or a stress grows without end where it does so by no less from order 1 to order 2 as it did when cells were
halved: as a power of the cells' length does. Where it has a limit, it grows less and less. A notch that is round has
one, though cells that are larger than it do not show it: in the plane growth counts near corners alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from stickslip.geometry.arrays import EXACT, Array
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.results.step_result import ErrorParts, Errors, Quantity, StepResult, number_of, quantities
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.record import ContactNumbers, Value, numbers_of

BETTER = 1.4  # 1 falls below the error where order 2 errs to the same side
GROWS = 0.05  # of a number: what grows by less has a limit
AREAS = tuple(key for key, number in numbers_of(ContactNumbers).items() if number.kind == "area")
AT_NODES = (*AREAS, "max_pressure", "max_penetration", "max_slip", "mean_pressure")  # that contact nodes decide
Values = dict[Quantity, Value]


class Better(NamedTuple):
    """Numbers that are nearer to the exact ones, the nearest last."""

    values: tuple[Values, ...]
    smooth: frozenset[Quantity] = frozenset()  # that have a limit by their place
    finer: float | None = None  # times as many cells along a line, if that is all that makes them better


def errors_of_step(
    problem: Problem,
    order: int,
    step: StepResult,
    better: Better,
    coarser: StepResult | None,
    by: str,
    factor: float = 2.0,
) -> dict[Quantity, ErrorParts]:
    """Errors of the numbers of a step, of which `better` or `coarser` tells.

    Args:
        order: of the run's displacements.
        coarser: the step on longer cells; None: there is none.
        by: what `better` are from.
        factor: how many times as long.
    """
    found, alone = dict[Quantity, ErrorParts](), _at_points(problem)
    others = {} if coarser is None else quantities(coarser)
    meshes = [] if coarser is None or not better.values else [at_ends(coarser), at_ends(step), _merged(better.values)]
    numbers = {key: (value, [v[key] for v in better.values if key in v]) for key, value in quantities(step).items()}
    third = _left_over(numbers, others, factor)
    for key, (value, near) in numbers.items():
        far = others.get(key)
        if f"{key.kind}.{key.name}" in alone or (not near and far is None):
            found[key] = ErrorParts()
        elif near and meshes and key not in better.smooth and _grows(problem, key, meshes, (factor, better.finer)):
            found[key] = ErrorParts(converges=False)
        else:
            found[key] = _stated(key, order, value, near, far, by, factor, better.finer, third)
    return found


def _left_over(numbers: Mapping[Quantity, tuple[Value, Sequence[Value]]], others: Values, factor: float) -> float:
    """Part of the difference to longer cells that an error of order 1 is: a third, less if most numbers show less."""
    parts = [1 / 3]
    for key, (value, near) in numbers.items():
        whole = 0.0 if key not in others else float(np.linalg.norm(value - others[key])) / (factor - 1)
        if near and whole > EXACT * np.linalg.norm(value):
            parts.append(BETTER * float(np.linalg.norm(difference(value, near))) / whole)
    return min(parts[0], float(np.median(parts)))


def _stated(
    key: Quantity,
    order: int,
    value: Value,
    near: Sequence[Value],
    far: Value | None,
    by: str,
    factor: float,
    finer: float | None,
    third: float,
) -> ErrorParts:
    """Error of a number by the difference to better ones, and to that of longer cells: the part that twice have."""
    times = BETTER if finer is None else finer**2 / (finer**2 - 1)
    off = times * difference(value, near)
    whole = np.zeros(np.shape(value)) if far is None else np.abs(value - far) / (factor - 1)
    if order == 1:
        least = whole * (third if near else 1)
    else:
        second = key.quantity in AT_NODES or number_of(key).kind == "pressure"
        least = whole / ((3 if second else 7) if near else 2)
    both, mesh = len(near) > 0 and far is not None, np.maximum(off, least)
    apart = (least > 2 * off) | ((off > 2 * whole) & (order == 1))
    unsure = both and bool(np.any(apart & (mesh > EXACT * np.linalg.norm(value))))  # else it is rounding
    return ErrorParts(
        mesh=_like(value, mesh),
        geometry=_like(value, 0.0 * mesh),
        converges=True if both or number_of(key).kind != "pressure" else None,
        corrected=near[-1] if near else value,
        by=by if near else "rough",
        unsure=unsure or None,
    )


def difference(value: Value, near: Sequence[Value]) -> Array:
    """Return that to the last of better numbers, no less than half of that to others, which are rounded to nodes."""
    off = [np.abs(each - value) for each in near]
    return np.asarray(np.max([np.zeros(np.shape(value)), *(each / 2 for each in off[:-1]), *off[-1:]], axis=0))


def _like(value: Value, found: Array) -> Value:
    return found if np.ndim(value) else float(found)


def corrected(step: StepResult) -> Values:
    """Better numbers that a step itself has."""
    return {key: step.corrected[str(key)] for key in quantities(step) if str(key) in step.corrected}


def at_ends(step: StepResult) -> Values:
    """Its numbers, those of bodies at corners of cells, where stresses are largest."""
    return quantities(step) | {key: value for key, value in corrected(step).items() if key.kind == "bodies"}


def _merged(better: Sequence[Values]) -> Values:
    return {key: value for values in better for key, value in values.items()}


def _grows(
    problem: Problem, key: Quantity, meshes: Sequence[Values], finer: tuple[float, float | None] = (2.0, None)
) -> bool:
    """Whether a number grows without end on ever better meshes; compliance gives pressures a limit.

    Growth counts by the logarithm of how many times `finer` the second mesh and the third are; None: as the second.
    A largest pressure is measured by the mean one: both grow where the part that touches is smaller than a facet.
    """
    pair = problem.pairs.get(key.name) if key.kind == "contacts" else None
    if number_of(key).kind != "pressure" or (pair is not None and pair.contact.normal.at_quadrature):
        return False
    mean, sizes = key._replace(quantity="mean_pressure"), list[float]()
    for values in meshes:
        whole = float(values.get(mean, 1.0))
        sizes.append(float(np.linalg.norm(values[key])) / whole if whole else 0.0)
    first, second = np.diff(sizes)
    alike = np.log(finer[0]) / np.log(finer[1] or finer[0])
    return bool(alike * second >= first > GROWS * sizes[1])


def _at_points(problem: Problem) -> set[str]:
    """Springs that pull at a point: it gives way the more, the finer the mesh is, which no mesh ends."""
    return {link.key for link in problem.links if any(not isinstance(end, str) for end, _ in link.ends.values())}


def with_ends(contacts: Iterable[ContactRows], step: StepResult, errors: Errors) -> dict[Quantity, ErrorParts]:
    """Errors of a step's numbers, those of forces with what the ends of two sides of one body leave.

    Neighbours carry the part of an end: by as much as pressures and tractions differ within three facets of it, its own
    may be another.
    """
    found = dict(errors)
    for c in (c for c in contacts if len(c.ends)):
        state, near = step.contacts[c.name], c.surface.neighbours[c.ends]
        for _ in range(2):
            near = near + near @ c.surface.neighbours
        rings = [row.indices for row in near]
        weights, left = state.weight[c.ends], dict[str, Value]()
        for name, field in {
            "force": state.traction - c.sense * state.pressure[:, None] * c.frames[:, 0],
            "normal_force": state.pressure[:, None],
            "tangential_force": state.traction,
        }.items():
            off = weights @ np.array([np.ptp(field[ring], axis=0) for ring in rings])
            left[name] = off if name == "force" else float(np.linalg.norm(off))
        for key, parts in errors.items():
            if key.kind == "contacts" and key.name == c.name and key.quantity in left:
                found[key] = replace(parts, mesh=parts.mesh if parts.mesh is None else parts.mesh + left[key.quantity])
    return found
