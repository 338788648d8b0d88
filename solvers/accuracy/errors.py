"""All errors of the numbers of a run: of each step when it is solved; at the end of the time steps, and of order 2.

`iteration_errors` finds the errors that iterations, and iterative volume solves, leave in each number of a step.
Tractions and relative displacement of the exact solution of the same discrete steps are known, see `Correction`: the
numbers of a contact are compared with those of them. Reactions of supports change by no more than all contact forces
together change. The error of an iterative volume solve is known in the energy norm, relative: numbers are off by that
part of the largest of their kind.

`with_unresolved` asks how finely the two sides of a contact resolve the part that touches, and what errors of its
numbers say at least. Where the part that touches is smaller than one element of a side, finer spaces on these cells,
or on cells cut twice, do not see it either: what they differ by says nothing. So such numbers are stated to be as
uncertain as they are large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from stickslip.geometry.arrays import EPS, Bools
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.accuracy.lower_order import smooth_errors
from stickslip.solvers.accuracy.mesh_error import Values, mesh_errors, stress_errors
from stickslip.solvers.accuracy.model_error import model_errors
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.results.observe import LINEAR, Observer
from stickslip.solvers.results.step_result import (
    OPEN,
    ContactState,
    ErrorParts,
    Errors,
    Quantity,
    StepResult,
    number_of,
    quantities,
)
from stickslip.solvers.scene.record import ContactNumbers, Value, numbers_of
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.solvers.system.system import System

AREAS = tuple(key for key, number in numbers_of(ContactNumbers).items() if number.kind == "area")
LIKE = {"moment": "force", "rotation": "length"}  # kinds that are measured by another


def iteration_errors(observe: Observer, accepted: Accepted, found: Values) -> dict[Quantity, ErrorParts]:
    """Parts `iteration` and `linear_solver` of the errors of the numbers `found`; collective."""
    state, W = accepted.state, accepted.stepper.surface.W
    left = state.correction
    if left is None or np.isnan(left.size):
        return {}
    exact = replace(accepted, state=replace(state, p=state.p + left.p, w=state.w + left.w))
    theirs = quantities(observe.numbers(exact))
    sizes = {
        "force": float(np.abs(W * state.p).sum()),
        "length": float(np.abs(state.w).max(initial=0.0)),
        "energy": 2 * state.peak,
        "pressure": float(np.abs(state.p).max(initial=0.0)),
    }
    pushed = np.abs(W * left.p).sum()
    worked = float(pushed * sizes["length"] + np.abs(W * state.p) @ np.abs(left.w))
    bounds = {
        "force": float(pushed),
        "length": float(np.abs(left.w).max(initial=0.0)),
        "energy": worked + left.size * float(np.sqrt(2 * state.peak)),
        "pressure": float(np.abs(left.p).max(initial=0.0)),
    }
    errors = {}
    for key, value in found.items():
        kind, lever = number_of(key).kind, _lever(accepted.stepper.system, key)
        kind = LIKE.get(kind, kind)
        if not kind:
            continue
        if kind == "area":
            off: Value = np.abs(theirs[key] - value)
            linear = 0.0 * off
        elif key.quantity == "stress":
            off = 0.0 * value + bounds["pressure"]
            linear = 0.0 * value + LINEAR * accepted.linear_error * sizes["pressure"]
        else:
            size = lever * sizes[kind]
            off = 0.0 * np.abs(value) + lever * bounds[kind] + EPS * size  # of the largest number of its kind
            linear = 0.0 * np.abs(value) + LINEAR * accepted.linear_error * size
        errors[key] = ErrorParts(iteration=off, linear_solver=linear)
    return errors


def _lever(system: System, key: Quantity) -> float:
    """By what the error of a force [N] or a displacement [m] gives that of the number: 1 unless something turns.

    Of a moment it is the distance [m] of the farthest corner of the bodies' box from the point that it is about, of a
    rotation 2 / size [1/m] of the side that turns, whose ends may move in opposite directions.
    """
    kind = number_of(key).kind
    if kind not in ("moment", "rotation"):
        return 1.0
    about, problem = np.zeros(system.mesh.dim), system.problem
    of_points = {each.coupling.key: each for each in system.constraints.remote.every}
    if point := of_points.get(f"{key.kind}.{key.name}"):
        if kind == "rotation":
            return 2 / float(np.ptp(point.points, axis=0).max())
        about = np.array(point.coupling.point)
    elif key.kind == "obstacles" and (rotation := problem.obstacles[key.name].rotation):
        about = np.array(rotation.point)
    return float(np.linalg.norm(np.abs(system.box - about).max(axis=0)))


BLIND = 0.99  # elements across; one that a flat contact covers wholly is enough
LOCAL = (*AREAS, "max_pressure", "max_penetration", "max_slip")


def elements_touched(rows: ContactRows, state: ContactState) -> tuple[float, float]:
    """Elements across the part that touches: of the slave, and of the master; inf of a rigid obstacle.

    The part is as wide as its area tells; triangles count as halves of quadrilaterals.
    """
    closed = state.status != OPEN
    own = _across(rows.surface, closed, state.contact_area)
    return own, np.inf if rows.master is None else _across(rows.master, faced(rows, closed), state.contact_area)


def faced(rows: ContactRows, nodes: Bools) -> Bools:
    """Nodes (n_master,) of the master whose facets face these nodes (n,) of the slave."""
    found = np.zeros(rows.relative.shape[1], bool)
    found[rows.relative[np.flatnonzero(nodes)].indices] = True
    return found[len(nodes) :]


def _across(side: Surface, nodes: Bools, area: float) -> float:
    """Elements of which all nodes are among these (n,), or else some, across an area [m^(d-1)]; inf without nodes."""
    sizes, inside = side.quadrature(2 * side.degree)[0].sum(axis=1), nodes[side.facets]
    taken = sizes[inside.all(axis=1)] if inside.all(axis=1).any() else sizes[inside.any(axis=1)]
    alike = 2 if side.shape == "triangle" else 1
    return float(area / (alike * taken.mean())) ** (1 / (side.dim - 1)) if len(taken) else np.inf


def unresolved(rows: ContactRows, state: ContactState) -> bool:
    """Whether the part that touches, which a law bounds, lies within an element of one of the sides."""
    return rows.normal.sides == 1 and min(elements_touched(rows, state)) < BLIND


def with_unresolved(contacts: Sequence[ContactRows], step: StepResult, errors: Errors) -> Errors:
    """Errors of a step's numbers, where they are known; those of unresolved contacts are at least the numbers."""
    found = dict(errors)
    for rows in contacts:
        state = step.contacts[rows.name]
        parts_of = {key: found.get(key, ErrorParts()) for key in (Quantity("contacts", rows.name, x) for x in LOCAL)}
        stated = {key: of for key, of in parts_of.items() if of.mesh is not None or of.converges is False}
        if stated and unresolved(rows, state):
            for key, parts in stated.items():
                size = abs(float(getattr(state, key.quantity)))
                off = size if parts.mesh is None else max(float(parts.mesh), size)
                found[key] = replace(parts, mesh=off, geometry=parts.geometry or 0.0, converges=True)
    for name, x in product(step.sums, LOCAL):
        each = [found.get(Quantity("contacts", pair, x), ErrorParts()) for pair in step.parts(name)]
        found[Quantity("contacts", name, x)] = ErrorParts.added(each)
    return with_means(step, found)


def with_means(step: StepResult, errors: Errors) -> Errors:
    """Errors of a step's numbers; that of the mesh of a mean pressure follows from those of force and area."""
    found = dict(errors)
    for name, of in {**step.contacts, **step.sums}.items():
        force, area, mean = (
            found.get(Quantity("contacts", name, key), ErrorParts())
            for key in ("normal_force", "contact_area", "mean_pressure")
        )
        parts = list[Value | None]()
        for part in ("mesh", "geometry"):
            N, A = getattr(force, part), getattr(area, part)
            known = N is not None and A is not None and (of.contact_area or not A)
            parts.append((N + of.mean_pressure * A) / (of.contact_area or 1.0) if known else None)
        both = replace(mean, mesh=parts[0], geometry=parts[1], converges=area.converges)
        found[Quantity("contacts", name, "mean_pressure")] = both
    return found


def with_errors(observe: Observer, accepted: Accepted, result: StepResult) -> StepResult:
    """The result of a step with the errors of its numbers, but for those that are found at the end; collective."""
    found = quantities(result)
    of_order_1 = accepted.stepper.system.mesh.degree == 1
    corrected, of_mesh = (mesh_errors if of_order_1 else smooth_errors)(observe, accepted, result)
    of_mesh = {**of_mesh, **stress_errors(observe, accepted, result)}
    of_iteration = iteration_errors(observe, accepted, found)
    exact_laws = accepted.stepper.chain.exact_laws
    of_model = model_errors(observe, accepted, result)
    errors = dict[Quantity, ErrorParts]()
    for key, value in found.items():
        laws = ErrorParts(law=np.abs(0.0 * value) if exact_laws else None, model=of_model.get(key))
        parts = [part for part in (of_mesh.get(key), of_iteration.get(key)) if part is not None]
        for part in parts:
            laws = laws.joined(part)
        errors[key] = laws
    known = with_unresolved(accepted.stepper.system.contacts, result, errors)
    return replace(
        result,
        corrected={str(key): value for key, value in corrected.items()},
        errors={str(key): parts for key, parts in known.items()},
    )


def joined(
    contacts: Sequence[ContactRows],
    steps: Sequence[StepResult],
    *found_later: Sequence[Errors],
    of_pairs: Sequence[Values | None] = (),
) -> tuple[Errors, ...]:
    """All errors of the numbers of each step.

    Args:
        contacts: of the run's mesh.
        found_later: those that are found at the end of a run, each for as many steps as they are known for.
        of_pairs: see `KeptPairs`; they are added to those of the geometry.
    """
    found = []
    for k, step in enumerate(steps):
        later = [errors[k] for errors in found_later if k < len(errors)]
        own = {key: step.errors.get(str(key), ErrorParts()) for key in quantities(step)}
        for errors in later:
            own = {key: parts.joined(errors.get(key, ErrorParts())) for key, parts in own.items()}
        if of_pairs:
            off = of_pairs[k]
            own = {key: _with_pairs(parts, None if off is None else off[key]) for key, parts in own.items()}
        found.append(with_unresolved(contacts, step, own))
    return tuple(found)


def _with_pairs(parts: ErrorParts, off: Value | None) -> ErrorParts:
    """The errors of a number with that of the pairs, None: it is not known."""
    known = None if off is None or parts.geometry is None else parts.geometry + off
    return replace(parts, geometry=known)
