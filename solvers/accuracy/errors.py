"""All errors of the numbers of a run: of each step when it is solved; at the end of the time steps, and of order 2.

`iteration_errors` finds the errors that iterations, and iterative volume solves, leave in each number of a step.
Tractions and relative displacement of the exact solution of the same discrete steps are known, see `Correction`: the
numbers of a contact are compared with those of them. Reactions of supports change by no more than all contact forces
together change. The error of an iterative volume solve is known in the energy norm, relative: numbers are off by that
part of the largest of their kind.

`with_unresolved` asks how finely the two sides of a contact resolve the part that touches. Where it is smaller than one
element of a side, better cells do not see it either: such numbers are stated to be as uncertain as they are large.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from stickslip.geometry.arrays import EPS, EXACT, Array, Bools
from stickslip.geometry.errors import StickslipError
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.accuracy.histories import FINER, OtherHistory, cells_along, largest_stresses
from stickslip.solvers.accuracy.mesh_error import AT_NODES, Better, Values, corrected, errors_of_step, with_ends
from stickslip.solvers.accuracy.model_error import model_errors
from stickslip.solvers.accuracy.nested_run import Corners, cut_cells
from stickslip.solvers.accuracy.two_level import MeshCorrection
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.laws.wear import WORN
from stickslip.solvers.results.observe import LINEAR, Observer
from stickslip.solvers.results.recovered_stress import RecoveredStress
from stickslip.solvers.results.step_result import (
    OPEN,
    ContactState,
    ErrorParts,
    Errors,
    Numbers,
    Quantity,
    StepResult,
    number_of,
    quantities,
)
from stickslip.solvers.scene.record import STRESSES, Value
from stickslip.solvers.stepping.choice import Size
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import Accepted, Stepper
from stickslip.solvers.system.system import System

log = logging.getLogger(__name__)
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
    worn = [float(np.abs(ahead).max(initial=0.0)) for key, ahead in left.memory.items() if key.endswith(WORN)]
    bounds["length"] += max(worn, default=0.0)
    area = float(W[: accepted.stepper.surface.normal_rows].sum())
    for known in (sizes, bounds):
        known["volume"] = area * known["length"]
    errors = dict[Quantity, ErrorParts]()
    for key, value in found.items():
        kind, lever = number_of(key).kind, _lever(accepted.stepper.system, key)
        kind = LIKE.get(kind, kind)
        if not kind and key.quantity not in ("slip_rate", "state"):
            continue
        if not kind:
            off: Value = _ahead(accepted, key, value)
            linear: Value = LINEAR * accepted.linear_error * np.abs(value)
        elif kind == "area":
            off = np.abs(theirs[key] - value)
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


def _ahead(accepted: Accepted, key: Quantity, value: Value) -> Value:
    """Error of a slip rate, or of a state, by how far what friction remembers is from that of the exact solution."""
    left, contacts = accepted.state.correction, accepted.stepper.system.contacts
    known = left.memory if left is not None else {}
    ahead = [np.atleast_2d(known[c.name].T) for c in contacts if c.name in known]
    column, size = (-1, 1.0) if key.quantity == "slip_rate" else (0, np.abs(value))
    return size * max((float(np.abs(each[column]).max(initial=0.0)) for each in ahead), default=0.0)


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
    """Errors of a step's numbers; those of what nodes of unresolved contacts decide are at least the numbers.

    Where friction acts and no other mesh tells of an edge between stick and slip, it may lie beside any node.
    """
    found = dict(errors)
    for rows in contacts:
        state = step.contacts[rows.name]
        rubs = not rows.normal.ties and np.abs(state.traction).max(initial=0.0) > EXACT * state.max_pressure
        for name in ("stick_area", "slip_area") if rubs else ():
            key = Quantity("contacts", rows.name, name)
            parts = found[key]
            if parts.mesh is not None and parts.mesh <= EXACT * state.contact_area:
                found[key] = replace(parts, mesh=float(rows.node_weights.max()))
        for name in AT_NODES if unresolved(rows, state) else ():
            key = Quantity("contacts", rows.name, name)
            parts, size = found[key], abs(float(getattr(state, name)))
            off = size if parts.mesh is None else max(float(parts.mesh), size)
            found[key] = replace(parts, mesh=off, geometry=0.0, converges=True)
    return found


class MeshErrors:
    """Estimates the error of the mesh of a run that is solved, from its history on other meshes; collective."""

    def __init__(
        self,
        stepper: Stepper,
        fits: Callable[[Size], bool] = lambda size: True,
        on_iteration: Callable[[HistoryRow], None] = lambda row: None,
    ) -> None:
        """
        Args:
            stepper: of the run.
            fits: whether better cells of a history of a size are not too dear.
            on_iteration: called after each iteration, on every rank.
        """
        self._stepper, self._fits, self._on_iteration = stepper, fits, on_iteration

    def __call__(
        self, steps: Sequence[StepResult], coarser: Sequence[StepResult] = (), factor: float = 2.0, solves: bool = True
    ) -> tuple[Errors, ...]:
        """Errors of each step of a run from rest, in `mesh` and `geometry`; collective.

        Args:
            steps: results at the requested times, without a gap.
            coarser: the first of them on longer cells; none: there are no such cells.
            factor: how many times as long.
            solves: whether the history on better cells is solved.
        """
        system = self._stepper.system
        by = "bubbles" if isinstance(self._stepper.companion, MeshCorrection) else "order 2"
        better: Sequence[Better] = self._better(steps) if solves and by != "bubbles" else ()
        better = [Better((corrected(step),)) for step in steps] if by == "bubbles" else better
        found = []
        for k, step in enumerate(steps):
            near, far = better[k] if k < len(better) else Better(()), coarser[k] if k < len(coarser) else None
            errors = errors_of_step(system.problem, system.mesh.degree, step, near, far, by, factor)
            found.append(with_unresolved(system.contacts, step, with_ends(system.contacts, step, errors)))
        return tuple(found)

    def _better(self, steps: Sequence[StepResult]) -> Sequence[Better]:
        """Better numbers of the first steps, as many as are found; collective."""
        system, found = self._stepper.system, list[Better]()
        finer: float | None = None
        history: OtherHistory | None = None
        try:
            if system.mesh.degree == 1:
                log.info("the same history with order 2, for the error of the mesh")
                history = OtherHistory.of_order(system, 2, self._on_iteration)
            if system.mesh.dim == 2:
                order_2 = system if history is None else history.stepper.system
                mesh = cut_cells(system, order_2, steps, self._fits)
                if mesh is not None:
                    log.info("on a mesh of %d nodes, for the error of the mesh", len(mesh.points))
                    history = OtherHistory.on(system, mesh, self._on_iteration)
            elif history is None:
                log.info("the same history on a finer mesh, for the error of the mesh")
                history = OtherHistory.coarser(system, 1 / FINER, self._on_iteration)
                finer = cells_along(history.stepper.system.mesh) / cells_along(system.mesh)
                history = history if finer > 1 else None  # so few cells that they are the same
            if history is not None:
                read = partial(better_numbers, history.observe, Corners.of(history.stepper.system), finer)
                found.extend(history.read([step.time for step in steps], read))
        except StickslipError as error:
            log.info("no better cells for the error of the mesh from there on: %s", error)
        return found


def better_numbers(observe: Observer, corners: Corners | None, finer: float | None, accepted: Accepted) -> Better:
    """Numbers of a step with order 2, see `OtherHistory`."""
    step, system = observe(accepted), accepted.stepper.system
    probes = {name: np.array(probe.point) for name, probe in system.problem.probes.items()}
    smooth = system.mesh.comm.bcast(corners.smooth(step, probes) if corners else frozenset())
    return Better((quantities(step), corrected(step)), smooth, finer)


def with_errors(observe: Observer, accepted: Accepted, result: StepResult) -> StepResult:
    """The result of a step with the errors of its numbers, but for those that are found at the end; collective."""
    found, system = quantities(result), accepted.stepper.system
    better = numbers_with_bubbles(observe, accepted, result)
    near = Better((better,) if better else ())
    of_mesh = errors_of_step(system.problem, system.mesh.degree, result, near, None, "bubbles")
    of_iteration = iteration_errors(observe, accepted, found)
    exact_laws = accepted.stepper.chain.exact_laws
    of_model = model_errors(observe, accepted, result)
    errors = dict[Quantity, ErrorParts]()
    for key, value in found.items():
        parts = ErrorParts(law=np.abs(0.0 * value) if exact_laws else None, model=of_model.get(key))
        for part in (of_mesh[key], of_iteration.get(key)):
            parts = parts if part is None else parts.joined(part)
        errors[key] = parts
    at_corners = {}
    if observe.recovered is not None and not better:
        at_corners = largest_stresses(observe, observe.recovered, accepted, result)
    return replace(
        result,
        corrected=at_corners | {str(key): value for key, value in better.items()},
        errors={str(key): parts for key, parts in with_ends(system.contacts, result, errors).items()},
    )


def numbers_with_bubbles(observe: Observer, accepted: Accepted, result: StepResult) -> Values:
    """Numbers of a step with bubbles, but for those that contact nodes decide; nothing if it was not followed."""
    refined, companion = accepted.state.refined, observe.stepper.companion
    if refined is None or not isinstance(companion, MeshCorrection):
        return {}
    values = quantities(observed(observe, accepted, refined)) | companion.displacement_at(refined, observe.probes)
    if observe.recovered is not None:
        stress = observe.stress(accepted.state.u, accepted.state.initial)
        largest = observe.recovered.largest(*companion.whole(refined), stress)
        values |= {Quantity("bodies", name, "max_von_mises"): x for name, x in zip(result.bodies, largest, strict=True)}
        values |= _stress_at_probes(observe, observe.recovered, accepted.state, refined, stress)
    return {key: value for key, value in values.items() if key.kind != "contacts" or key.quantity not in AT_NODES}


def _stress_at_probes(
    observe: Observer, recovered: RecoveredStress, state: State, refined: State, stress: Array
) -> Values:
    """Stress (6,) [Pa] with bubbles at the probes, on every rank, from that at midpoints (cells, 3, 3); collective."""
    companion, found = observe.stepper.companion, dict[str, Array]()
    assert isinstance(companion, MeshCorrection)
    points = companion.in_cells(refined, observe.probes)
    for name, change in recovered.from_midpoints(state.u, state.initial, points).items():
        found[name] = change + np.array([stress[points[name].cell][ij] for ij in STRESSES.values()])
    offers = observe.stepper.system.mesh.comm.allgather(found)
    return {Quantity("probes", name, "stress"): stress for own in offers for name, stress in own.items()}


def observed(observe: Observer, accepted: Accepted, state: State) -> Numbers:
    """Numbers of another state at the end of the same step; collective."""
    start, before = accepted.start, accepted.substep_start
    same = replace(accepted, state=state, start=start.refined or start, substep_start=before.refined or before)
    return observe.numbers(same)


def joined(
    steps: Sequence[StepResult], *found_later: Sequence[Errors], of_pairs: Sequence[Values | None] = ()
) -> tuple[Errors, ...]:
    """All errors of the numbers of each step.

    Args:
        found_later: those that are found at the end of a run, each for as many steps as they are known for.
        of_pairs: see `KeptPairs`; they are added to those of the geometry.
    """
    found = []
    for k, step in enumerate(steps):
        own = {key: step.errors.get(str(key), ErrorParts()) for key in quantities(step)}
        for errors in (errors[k] for errors in found_later if k < len(errors)):
            own = {key: _with(parts, errors.get(key, ErrorParts())) for key, parts in own.items()}
        if of_pairs:
            off = of_pairs[k]
            own = {key: _with_pairs(parts, None if off is None else off[key]) for key, parts in own.items()}
        found.append(own)
    return tuple(found)


def _with(parts: ErrorParts, later: ErrorParts) -> ErrorParts:
    """The parts of both; of a number without limit the mesh's is none."""
    return (replace(parts, mesh=None, geometry=None) if later.converges is False else parts).joined(later)


def _with_pairs(parts: ErrorParts, off: Value | None) -> ErrorParts:
    """The errors of a number with that of the pairs, None: it is not known."""
    known = None if off is None or parts.geometry is None else parts.geometry + off
    return replace(parts, geometry=known)
