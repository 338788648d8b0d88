"""Error of the mesh of each number of a step, from the same step with bubbles, see `two_level`.

Stated is FACTOR times the difference. Part of it is that of the geometry: the share of what curved sides add by their
bulges, beside what the finite element space adds; where these have opposite signs, OPPOSED of their sum is the least
that is stated. Areas of touching, sticking and slipping nodes are multiples of a node's area: theirs is BETWEEN times
the difference to areas whose edges lie between nodes, and EDGE times the facets that these cross, see `areas`. The
largest slip of the nodes that touch is compared with that up to the same edge. Of a contact's sums and largest values
no less is stated than `by_chance` says of the differences at its nodes, which may cancel; unless they do to FIXED
of that, as equilibrium makes a force that loads prescribe. A largest pressure that grows
without end as the mesh is refined has no error, see `grows`, nor have the penetration that it causes and the slip
beside it.

The stress at a probe, which is the recovered one there, is compared with the mean of the stress with bubbles at the
point and of the recovered stress there of their nodes; stated is STRESS times the difference. Each alone is
worse somewhere: bubbles on regular triangles, recovery in hexahedra. Where the stress grows without end it has no
error; along an edge in 3D that is not seen.

The first four factors are fitted to problems of `stickslip verify accuracy`, on three meshes each.

`by_chance` says how far sums and largest values of a contact may be off although they agree with those of a better
solution. Differences at nodes cancel in a sum by chance. As if they were independent, that of the sum is at least a
part of the root of the sum of their squares; of the dissipation since t = 0 that of the last step counts alone. A
largest value is off by as much as the values around it. The parts are fitted to the problems of `stickslip verify
accuracy`: they hardly raise what is stated, but where it would be .05 to .5 of the error.

`grows` says whether a largest pressure, or a stress in a cell, has a limit, or grows without end as the mesh is
refined: at a corner, at the end of a punch. Such a pressure falls off like a negative power of the distance: by much
to the nearest nodes, by far less to those behind, or it waves there. Where it is smooth, or falls to zero at the edge
of contact, the fall grows with the distance or stays. At the end of a side a smaller fall is enough. The largest
pressure may be a smooth one yet: others that are nearly as high are looked at, too.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CLOSE, LAST_DIGITS, ROUNDING, TINY, Array, Bools, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.accuracy.areas import areas_between_nodes, crossings, scatter
from stickslip.solvers.accuracy.two_level import MeshCorrection
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import (
    OPEN,
    STICK,
    ContactState,
    ErrorParts,
    Errors,
    Numbers,
    Quantity,
    StepResult,
    quantities,
)
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.record import STRESSES, Value
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import Accepted

FORCE, DISSIPATION, PRESSURE, SLIP = 0.3, 0.5, 0.5, 1.0


def least_errors(contacts: Iterable[ContactRows], own: Numbers, better: Numbers) -> Values:
    """`by_chance` of each contact, and of what all together dissipate."""
    least: Values = {}
    for c in contacts:
        local = by_chance(c, own.contacts[c.name], better.contacts[c.name])
        least |= {Quantity("contacts", c.name, name): chance for name, chance in local.items()}
        least[DISSIPATED] = np.hypot(least.get(DISSIPATED, 0.0), local["dissipation"])
    return least


def by_chance(c: ContactRows, own: ContactState, better: ContactState) -> dict[str, Value]:
    """The least error of numbers of a contact, by quantity, >= 0.

    Args:
        own: whose errors are asked for.
        better: a solution with less of the same error, at the same nodes.
    """
    weight, pressure = own.weight[:, None], np.abs(better.pressure - own.pressure)
    n = c.sense * c.frames[:, 0]
    force = weight * (better.traction - own.traction + (own.pressure - better.pressure)[:, None] * n)
    work = (weight * (better.traction * better.slip_increment - own.traction * own.slip_increment)).sum(axis=1)
    slip = np.linalg.norm(better.slip - own.slip, axis=1)
    slipped = np.where(own.status == OPEN, 0.0, np.linalg.norm(own.slip, axis=1))
    dissipation = DISSIPATION * float(np.linalg.norm(work))
    return {
        "force": FORCE * np.linalg.norm(force, axis=0),
        "normal_force": FORCE * float(np.linalg.norm(own.weight * pressure)),
        "max_pressure": PRESSURE * float(pressure[_around(c, own.pressure)].max(initial=0.0)),
        "max_slip": SLIP * float(slip[_around(c, slipped)].max(initial=0.0)),
        "dissipation": dissipation,
        "dissipation_total": dissipation,
    }


def with_ends(contacts: Iterable[ContactRows], step: StepResult, errors: Errors) -> dict[Quantity, ErrorParts]:
    """Errors of a step's numbers, those of forces with what the ends of two sides of one body leave.

    Neighbours carry the part of an end: by as much as pressures and tractions differ within three facets of it, its own
    may be another.
    """
    found = dict(errors)
    for c in contacts:
        state, near = step.contacts[c.name], c.surface.neighbours()[c.ends]
        for _ in range(2):
            near = near + near @ c.surface.neighbours()
        rings = [row.indices for row in near]
        weights, left = state.weight[c.ends], dict[str, Value]()
        for name, field in {
            "force": state.traction - c.sense * state.pressure[:, None] * c.frames[:, 0],
            "normal_force": state.pressure[:, None],
            "tangential_force": state.traction,
        }.items():
            off = weights @ np.array([np.ptp(field[ring], axis=0) for ring in rings]) if rings else 0.0
            left[name] = off if name == "force" else float(np.linalg.norm(off))
        for key, parts in errors.items():
            if rings and key.kind == "contacts" and key.name == c.name and key.quantity in left:
                found[key] = replace(parts, mesh=parts.mesh if parts.mesh is None else parts.mesh + left[key.quantity])
    return found


def _around(c: ContactRows, values: Array) -> Bools:
    """The nodes with the largest of some values (n,) above zero, and their neighbours."""
    peaks = (values > 0) & (values == values.max(initial=0.0))
    return np.asarray(peaks | (c.surface.neighbours() @ peaks.astype(float) > 0))


STEEP = 0.15  # part by which the nearest nodes have less; smooth pressures: .10 at most on the meshes that were tried
END = 0.05  # the same at the end of a side
CONVEX = 1.5  # times the next fall; r^(-1/2) has 2.3, r^(-1/10) 1.8


def grows(side: Surface, pressure: Array) -> bool:
    """Whether the largest pressure (n,) [Pa] of a side of n nodes, or another one nearly as high, grows without end."""
    if not len(pressure):
        return False
    near, rim = side.neighbours().tocsr(), _rim(side)
    # where one as high as that grows, it is the largest on a finer mesh
    high = np.flatnonzero(pressure >= 0.8 * pressure.max(initial=0.0))
    around = [pressure[near.indices[near.indptr[k] : near.indptr[k + 1]]] for k in high]
    highest = pressure[high] >= [others.max(initial=0.0) for others in around]
    falls = [others.min(initial=np.inf) for others in around] < (1 - END) * pressure[high]
    return any(_grows_at(peak, side, pressure, near, rim) for peak in high[highest & falls])


def _grows_at(peak: int, side: Surface, pressure: Array, near: Sparse, rim: Bools) -> bool:
    """Whether the pressure at a node falls off to all sides like one that grows without end."""
    first = np.arange(len(pressure)) == peak
    # relative: neighbours that share a multiplier, as where two contacts meet
    front = first | ((near @ first.astype(float) > 0) & (pressure >= (1 - ROUNDING) * pressure[peak]))
    ends = bool(rim[front].any())
    behind = [rim] if ends and side.dim == 3 else []  # along an edge it may be as high: so those behind it, too
    return any(_falls(pressure, near, front, layer, END if ends else STEEP) for layer in (front, *behind))


def _falls(pressure: Array, near: Sparse, front: Bools, layer: Bools, steep: float) -> bool:
    """Whether a largest pressure (n,) falls off like a power of the distance from nodes `front`, and from `layer`."""
    rings, seen = [float(pressure[front].max())], front
    for _ in range(2):
        seen = seen | layer
        front = (near @ front.astype(float) > 0) & ~seen
        if not front.any():
            return False
        rings.append(float(pressure[front].max()))
        layer = front | (near @ layer.astype(float) > 0)
    first, second = -np.diff(rings)
    # times the next rise, if that is steep: pressures that alternate from node to node have 1
    more = 1.2 if second < -STEEP * rings[0] else CONVEX
    return bool(rings[-1] > 0 and first > steep * rings[0] and first > more * abs(second))


def grows_in(cells: Ints, stress: Array, cell: int) -> bool:
    """Whether the stress in a cell, or close by, grows without end.

    Args:
        cells: (n, k) nodes of the cells.
        stress: (n, 3, 3) [Pa].
        cell: number of the cell.
    """
    size, nodes, seen = np.linalg.norm(stress, axis=(1, 2)), cells[cell], np.zeros(len(cells), bool)
    rings = list[float]()
    for _ in range(3):
        ring = np.isin(cells, nodes).any(axis=1) & ~seen
        if not ring.any():
            return False
        rings.append(float(size[ring].max()))
        nodes, seen = cells[ring].ravel(), seen | ring
    first, second = -np.diff(rings)
    return bool(first > STEEP * rings[0] and first > CONVEX * abs(second))


def _rim(side: Surface) -> Bools:
    """Nodes (n,) at which a side ends: on a line between two corners, in 2D at a corner, of one facet alone."""
    corners = dx.borders(side.shape)
    ends = side.facets[:, corners]
    rows = np.sort(ends, axis=2).reshape(-1, corners.shape[1])
    _, line, count = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    alone = (count[line.ravel()] == 1).reshape(ends.shape[:2])
    found = np.zeros(len(side.points), bool)
    found[ends[alone]] = True
    if side.degree == 2 and side.dim == 3:
        middles = len(dx.reference_nodes(side.shape, 1)) + np.arange(len(corners))
        found[side.facets[:, middles][alone]] = True
    return found


FACTOR, OPPOSED = 1.6, 0.5
BETWEEN, EDGE = 0.75, 0.2
FIXED = 0.02  # of what the differences at nodes may sum up to: they cancel so well by equilibrium alone
STRESS = 1.25
DISSIPATED = Quantity("energy", "", "dissipated")  # by all contacts
Values = dict[Quantity, Value]


def mesh_errors(observe: Observer, accepted: Accepted, result: StepResult) -> tuple[Values, dict[Quantity, ErrorParts]]:
    """Numbers of a step with bubbles, and the errors of its result's; nothing if it was not followed; collective."""
    refined, found = accepted.state.refined, quantities(result)
    if refined is None:
        return {}, {}
    with_bubbles = observed(observe, accepted, refined)
    corrected = _values(observe, accepted, refined, with_bubbles, result)
    straight = corrected
    if refined.unbent is not None:
        flat_sides = observed(observe, accepted, refined.unbent)
        straight = _values(observe, accepted, refined.unbent, flat_sides, result)
    rims = _rims(observe, accepted, with_bubbles)
    corrected = corrected | {key: corrected[key] + rim for key, rim in rims.items()}
    errors, chances = dict[Quantity, ErrorParts](), dict[Quantity, float]()
    least = least_errors(accepted.stepper.system.contacts, result, with_bubbles)
    for c in accepted.stepper.system.contacts:
        edges = scatter(c.surface, result.contacts[c.name], c.node_weights)
        chances |= {Quantity("contacts", c.name, name): chance for name, chance in edges.items()}
    for key, value in corrected.items():
        bent, flat = np.abs(value - straight[key]), np.abs(straight[key] - found[key])
        off = np.maximum(np.abs(value - found[key]), OPPOSED * (bent + flat))
        if key in chances:
            rim = rims.get(key, 0.0)
            whole = BETWEEN * np.abs(value - rim - found[key]) + EDGE * chances[key] + FACTOR * abs(rim)
        else:
            whole = STRESS * _of_stress(np.asarray(off)) if key.quantity == "stress" else FACTOR * off
        chance = np.asarray(least.get(key, 0.0))
        whole = np.maximum(whole, np.where(flat <= FIXED * chance, 0.0, chance))
        parts = np.maximum(bent + flat, CLOSE * whole)  # where less is left than rounding, all is the mesh's
        share = bent / np.maximum(parts, TINY)
        errors[key] = ErrorParts(mesh=whole * (1 - share), geometry=whole * share, converges=True)
    for c in accepted.stepper.system.contacts:
        # of the bodies' size: shorter slips are none
        errors |= without_limit(c, result.contacts[c.name], LAST_DIGITS * accepted.stepper.system.extent)
    errors |= {Quantity("probes", name, "stress"): ErrorParts(converges=False) for name in _at_corners(observe, result)}
    errors = with_ends(accepted.stepper.system.contacts, result, errors)
    return corrected, errors | at_points(accepted.stepper.system.problem, found)


def _rims(observe: Observer, accepted: Accepted, numbers: Numbers) -> dict[Quantity, float]:
    """Areas of the rims of contact sides in a state with bubbles [m²]."""
    companion, found = observe.stepper.companion, dict[Quantity, float]()
    if not isinstance(companion, MeshCorrection):
        return found
    for name, rim in companion.rims(accepted.stepper.system).items():
        status = numbers.contacts[name].status
        touching, sticking = float(rim[status != OPEN].sum()), float(rim[status == STICK].sum())
        areas = {"contact_area": touching, "stick_area": sticking, "slip_area": touching - sticking}
        found |= {Quantity("contacts", name, key): area for key, area in areas.items() if rim.any()}
    return found


def at_points(problem: Problem, found: Iterable[Quantity]) -> dict[Quantity, ErrorParts]:
    """No error of springs that pull at a point: it gives way the more, the finer the mesh is, which no mesh ends."""
    alone = {link.key for link in problem.links if any(not isinstance(end, str) for end, _ in link.ends.values())}
    return {key: ErrorParts() for key in found if f"{key.kind}.{key.name}" in alone}


def without_limit(c: ContactRows, contact: ContactState, rounding: float) -> dict[Quantity, ErrorParts]:
    """Explain why no error is stated: the largest pressure of a contact grows without end.

    With compliance it has a limit, which no mesh of that size comes near. The slip close by converges slowly as well,
    if there is one above `rounding` [m]. Where nothing touches, pressures are rounding, and none grows.
    """
    if (contact.status == OPEN).all() or not grows(c.surface, contact.pressure):
        return {}
    soft, peaks, slip = c.normal.at_quadrature, _largest(contact.pressure), np.linalg.norm(contact.slip, axis=1)
    said = {"max_pressure": ErrorParts(converges=None if soft else False)}
    if soft:
        said["max_penetration"] = ErrorParts()
    if slip.max() > rounding and (_largest(slip) & (peaks | (c.surface.neighbours() @ peaks.astype(float) > 0))).any():
        said["max_slip"] = ErrorParts()
    return {Quantity("contacts", c.name, name): parts for name, parts in said.items()}


def _largest(values: Array) -> Bools:
    """Nodes (n,) with the largest value, and those that rounding alone makes smaller."""
    return np.asarray(values >= (1 - CLOSE) * values.max())


def _of_stress(error: Array) -> Array:
    """Components of a difference of stresses that happen to be small have a part of its size; zeros stay."""
    return np.where(error == 0, 0.0, np.maximum(error, 0.15 * float(np.linalg.norm(error))))


def observed(observe: Observer, accepted: Accepted, state: State) -> Numbers:
    """Numbers of another state at the end of the same step; collective."""
    start, before = accepted.start, accepted.substep_start
    same = replace(accepted, state=state, start=start.refined or start, substep_start=before.refined or before)
    return observe.numbers(same)


def _values(observe: Observer, accepted: Accepted, state: State, numbers: Numbers, result: StepResult) -> Values:
    """Numbers of another state, and of what it exerts, at the end of the step with a known result; collective."""
    values = quantities(numbers)
    companion = observe.stepper.companion
    if observe.probes and isinstance(companion, MeshCorrection):
        values |= companion.displacement_at(state, observe.probes)
        better = _stress(observe, companion, accepted, state, result)
        values |= {Quantity("probes", name, "stress"): value for name, value in better.items()}
    for c in accepted.stepper.system.contacts:
        contact = numbers.contacts[c.name]
        areas = areas_between_nodes(c.surface, contact, c.node_weights)
        values |= {Quantity("contacts", c.name, key): area for key, area in areas.items()}
        values[Quantity("contacts", c.name, "max_slip")] = _largest_slip(c, contact)
        if not c.normal.at_quadrature:  # only compliance penetrates, else that is what an iteration left
            values[Quantity("contacts", c.name, "max_penetration")] = 0.0
    return values


def _stress(
    observe: Observer, companion: MeshCorrection, accepted: Accepted, state: State, result: StepResult
) -> dict[str, Array]:
    """Stress (6,) [Pa] at the probes of a state with bubbles, on every rank; collective.

    The mean of that of the displacement of order 2 and of the recovered one of the nodes alone: where the one is off,
    at the ends of cells or at the surface, the other one is not. Reported is the recovered one of order 1.
    """
    if observe.recovered is None:
        return {}
    system, recovered = observe.stepper.system, observe.recovered
    points = companion.in_cells(state, observe.probes)
    smooth = recovered.smooth_at(state.u, state.initial, points)
    order_2, found = recovered.of_order_2(points, state.initial), dict[str, Array]()
    for name, own in recovered.smooth_at(accepted.state.u, accepted.state.initial, points).items():
        reported = np.array([result.probes[name].stress[ij] for ij in STRESSES.values()])
        found[name] = reported + (smooth[name] + order_2[name]) / 2 - own
    return {name: stress for offers in system.mesh.comm.allgather(found) for name, stress in offers.items()}


def _at_corners(observe: Observer, result: StepResult) -> list[str]:
    """Probes where the stress grows without end, on every rank; collective."""
    mesh = observe.stepper.system.mesh
    if observe.data is None or not observe.probes:
        return []
    numbers = mesh.domain.topology.original_cell_index
    own = {name: int(numbers[place[0]]) for name, place in observe.probes.items() if place is not None}
    cells = {name: cell for offers in mesh.comm.allgather(own) for name, cell in offers.items()}
    found = list[str]()
    if mesh.comm.rank == 0:
        found = [name for name, cell in cells.items() if grows_in(observe.data.cells, result.stress, cell)]
    return list(mesh.comm.bcast(found))


def stress_errors(observe: Observer, accepted: Accepted, result: StepResult) -> dict[Quantity, ErrorParts]:
    """Errors of the largest stresses of bodies, which are those of midpoints; collective.

    Stresses are larger at the surface: STRESS times the difference to the largest one at corners of cells is stated, of
    order 1 with bubbles, and no less than that of the recovered stress in the cell. At a corner there is no limit.
    """
    recovered, data, companion = observe.recovered, observe.data, observe.stepper.companion
    if recovered is None or data is None:
        return {}
    system, state, refined = observe.stepper.system, accepted.state, accepted.state.refined
    stress = observe.stress(state.u, state.initial)
    if system.mesh.degree > 1:
        u, cells = observe.stress.displacement.x.array.reshape(-1, system.mesh.dim), dx.cell_dofs(system.space)
    elif refined is not None and isinstance(companion, MeshCorrection):
        u, cells = companion.whole(refined)
    else:
        return {}
    better = recovered.largest(u, cells, stress)
    errors = dict[Quantity, ErrorParts]()
    for index, (name, of) in enumerate(result.bodies.items() if len(data.cells) else ()):
        own = np.flatnonzero(data.body == index)
        cell = int(own[np.argmax(result.von_mises[own])])
        off = STRESS * max(abs(better[index] - of.max_von_mises), float(result.stress_error[cell]))
        grows = grows_in(data.cells, result.stress, cell)
        known = ErrorParts(converges=False) if grows else ErrorParts(mesh=off, geometry=0.0, converges=True)
        errors[Quantity("bodies", name, "max_von_mises")] = known
    return dict(system.mesh.comm.bcast(errors))


def _largest_slip(c: ContactRows, contact: ContactState) -> float:
    """Largest slip up to the edge of contact between nodes [m]."""
    closed = contact.status != OPEN
    found = crossings(c.surface, closed, np.where(c.node_weights > 0, contact.gap, 0.0))
    inner = closed.copy()
    inner[[crossing.inside for crossing in found if crossing.at < 0]] = False
    at_edge = [contact.slip[a] + at * (contact.slip[b] - contact.slip[a]) for a, b, at in found]
    return float(max(np.linalg.norm(slip) for slip in [np.zeros(1), *contact.slip[inner], *at_edge]))
