"""Warnings of an answer, judged after the solve: each says in one sentence what there is reason to doubt."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import LAST_DIGITS, ROUNDING, Array, Bools, Ints, inverse_and_determinant
from stickslip.geometry.obstacles.obstacle import Obstacle
from stickslip.geometry.surfaces.faces import RIDGES
from stickslip.geometry.surfaces.surface import Surface
from stickslip.geometry.user_files.raw_mesh import different
from stickslip.solvers.accuracy.errors import elements_touched, unresolved
from stickslip.solvers.accuracy.kept_pairs import facet_length, moved_on_obstacle
from stickslip.solvers.contact.build import LEANS
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.results.step_result import OPEN, ContactState, Errors, MeshData, Quantity, StepResult, walk
from stickslip.solvers.scene.contact import table_of
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.simulation.simulation import Simulation

LARGE = 0.05  # part of an answer that is doubtful, from which on it is said; of a turn [rad], for it turns no load
GROSS = 0.1  # the same of what changes the answer less, and a peak above the mean around it, as measured on balls
SMALL = 0.01  # part that counts for nothing: of a force at a point beside rounding, of a spread beside a turn
PART = 0.95  # of a body's volume turns by less than what counts: a corner's singularity is no rotation of the body
SOFT = 0.4  # Poisson's ratio up to which no mesh locks
FEWEST = {2: 4, 3: 9}  # closed facets (in 3D of four corners) for a maximum pressure within 10 %, by dimension
ACROSS = {2: 4.0, 3: 3.0}  # elements of the other side across the part that touches, for the same


@dataclass(frozen=True, kw_only=True)
class Seen:
    """The largest values of all steps so far [-]."""

    spread: float = 0.0  # displacements within a body that differ, relative to the body's box
    turn: float = 0.0  # rotation [rad], see `PART`
    jump: float = 0.0  # of the mean stress between cells, relative to the equivalent stress, where nu is above `SOFT`
    lean: tuple[float, str] = (0.0, "")  # see `_lean`, and the contact
    strain: tuple[float, str] = (0.0, "")  # largest principal one, where it is above `GROSS` in less than `SMALL` of a
    # body's volume; and its place
    inverted: str = ""  # the body of which cells are turned inside out, and when
    # of the last step alone: by body the integral of the squared displacement [m^(d + 2)]; and where it is largest
    moved: tuple[float, ...] = ()
    fastest: tuple[str, tuple[float, ...]] = ("", ())


class Fields:
    """Judges displacement and stress step by step: they are not kept."""

    def __init__(
        self, problem: Problem, mesh: MeshData, contacts: Sequence[ContactRows], before: Seen, start: Array | None
    ) -> None:
        """
        Args:
            contacts: with the pairs of the start.
            before: what was seen in steps before those that `see` is given.
            start: displacement (nodes, d) [m] before these steps; None: nothing has moved yet.
        """
        self.seen, self._problem, self._mesh = before, problem, mesh
        self._start = np.zeros_like(mesh.points) if start is None else start
        self._cells = corners(mesh, mesh.cells)
        self._middles, self._volume = middles_and_volumes(mesh, problem.axisymmetric)
        self._rubbing = [
            rows
            for rows in contacts
            if rows.master is not None and rows.friction is not None and not problem.pairs[rows.name].contact.sliding
        ]
        self._bodies = []
        for index, name in enumerate(mesh.bodies):
            cells = mesh.cells[mesh.body == index]
            inside = np.zeros(len(mesh.points), bool)
            inside[cells] = True
            size = float(np.linalg.norm(np.ptp(mesh.points[inside], axis=0)))
            self._bodies.append((name, inside, cells, mesh.body == index, size))

    def see(self, step: StepResult) -> None:
        """A shift of a body as a whole does not count."""
        for name, inside, cells, own, size in self._bodies:
            spread = float(np.linalg.norm(np.ptp(step.displacement[inside], axis=0))) / size
            turn = self._seen_strains(name, cells, step) if spread > SMALL else 0.0
            soft = self._problem.bodies[name].near_incompressible > SOFT and self._problem.model != "plane stress"
            jump = _jump(cells, step.stress[own], step.von_mises[own]) if soft else 0.0
            self.seen = replace(
                self.seen,
                spread=max(self.seen.spread, spread),
                turn=max(self.seen.turn, turn),
                jump=max(self.seen.jump, jump),
            )
        for rows in self._rubbing:
            lean = _lean(rows, step.contacts[rows.name], rows.of_mesh(step.displacement, self._problem.request.turned))
            self.seen = replace(self.seen, lean=max(self.seen.lean, (lean, rows.name)))
        moved, self._start = (step.displacement - self._start)[self._cells].mean(axis=1), step.displacement
        squares, mesh = (moved**2).sum(axis=1), self._mesh
        first, found = int(squares.argmax()), np.bincount(mesh.body, self._volume * squares, len(mesh.bodies))
        place = f"bodies.{mesh.bodies[mesh.body[first]]}", tuple(self._middles[first].tolist())
        self.seen = replace(self.seen, moved=tuple(found.tolist()), fastest=place)

    def _seen_strains(self, name: str, cells: Ints, step: StepResult) -> float:
        """Note large strains and inverted cells of a body (c, k); its rotation [rad], see `PART`."""
        gradient, volume = gradients(self._mesh, cells, step.displacement)
        strain = np.abs(np.linalg.eigvalsh((gradient + np.swapaxes(gradient, 1, 2)) / 2)).max(axis=1)
        worst = int(np.argmax(strain))
        if 0 < volume[strain > GROSS].sum() < SMALL * volume.sum():
            at = ", ".join(f"{x:.3g}" for x in self._mesh.points[cells[worst]].mean(axis=0))
            place = f"bodies.{name} at ({at}) at t = {step.time:g}"
            self.seen = replace(self.seen, strain=max(self.seen.strain, (float(strain[worst]), place)))
        if (np.linalg.det(np.eye(gradient.shape[1]) + gradient) <= 0).any():
            self.seen = replace(self.seen, inverted=self.seen.inverted or f"bodies.{name} at t = {step.time:g}")
        turn = np.linalg.norm(gradient - np.swapaxes(gradient, 1, 2), axis=(1, 2)) / np.sqrt(8)
        order = np.argsort(turn)
        filled = np.cumsum(volume[order])
        return float(turn[order][np.searchsorted(filled, PART * filled[-1])])

    def notes(self) -> Iterator[str]:
        """What is said of an answer that is no reason to doubt it."""
        strain, place = self.seen.strain
        if place:
            yield (
                f"strains reach {strain:.0%} in less than {SMALL:.0%} of a body's volume, at a corner or an edge of "
                f"contact: {place}; they are taken to be small, and stresses there are those of linear elasticity"
            )

    def warnings(self) -> Iterator[str]:
        """One for each value that is too large."""
        if self.seen.spread > GROSS:
            yield (
                f"displacements differ by up to {self.seen.spread:.2g} of a body's size, and are taken to be small: "
                "the answer is that of the linear problem; check the units of E, loads and lengths"
            )
        if self.seen.turn > LARGE:
            yield (
                f"bodies turn by up to {self.seen.turn:.2g} rad, and rotations are taken to be small: forces may be "
                f"wrong by as large a part; apply less load or motion"
            )
        lean, name = self.seen.lean
        if lean > GROSS:
            yield (
                f"contacts.{name}: its sides turn by {lean:.0%} of mu, while pressure and friction keep the directions "
                f"of the start: forces along the side are off by as large a part of the friction; set "
                f"contacts.{table_of(name)}.sliding = true"
            )
        if self.seen.jump > 0.25:  # the maximum pressure is then 15 % off and more, as measured
            yield (
                f"the mean stress jumps between cells by {self.seen.jump:.2g} of the equivalent stress: elements "
                "lock where nu is near 0.5, and pressures are wrong; set geometry.order = 2, or refine the mesh"
            )


def corners(mesh: MeshData, cells: Ints) -> Ints:
    """Corners (c, n) of cells (c, k) of any order."""
    d = mesh.points.shape[1]
    return cells[:, : d + 1 if mesh.shape in ("triangle", "tetrahedron") else 2**d]


def middles_and_volumes(mesh: MeshData, axisymmetric: bool) -> tuple[Array, Array]:
    """Midpoints (c, d) [m] and volumes (c,) of all cells, in 2D by thickness, axisymmetric ones of rings [m³]."""
    middles = mesh.points[corners(mesh, mesh.cells)].mean(axis=1)
    volume = gradients(mesh, mesh.cells, mesh.points)[1] * dx.reference_rule(mesh.shape, 1)[1].sum()
    return middles, np.asarray(volume * (2 * np.pi * middles[:, 0] if axisymmetric else 1.0))


def gradients(mesh: MeshData, cells: Ints, displacement: Array) -> tuple[Array, Array]:
    """Gradient (c, d, d) of the displacement at midpoints of cells (c, k), and their volume (c,) but for a factor."""
    nodes = corners(mesh, cells)
    slope = dx.reference_basis(mesh.shape, 1, dx.reference_nodes(mesh.shape, 1).mean(axis=0, keepdims=True))[1][:, 0]
    jacobian, change = (np.array([slope @ x[nodes.T] for x in values.T]) for values in (mesh.points, displacement))
    inverse, det = inverse_and_determinant(jacobian)
    return np.einsum("ikc,kjc->cij", change, inverse), np.abs(det)


def _lean(rows: ContactRows, state: ContactState, moved: Array) -> float:
    """Resultant of the pressure along the turn of the normals, relative to that of the friction bounds [-].

    The smaller of both sides' turns counts, and none where they oppose each other: contact acts half way between
    normals that become alike, and the points of a shaft that turns in its bore have the normals of those before.
    """
    bound = float(state.weight @ state.bound)
    if not 0 < bound < np.inf:
        return 0.0
    assert rows.master is not None
    n = len(rows.surface.points)
    motions = np.split(moved, [n])
    own, other = (
        replace(side, points=side.points + motion).node_normals() - side.node_normals()
        for side, motion in zip((rows.surface, rows.master), motions, strict=True)
    )
    other = rows.relative[:, n:] @ other  # opposite to the slave's, and so are the coefficients
    smaller = np.where((np.linalg.norm(own, axis=1) < np.linalg.norm(other, axis=1))[:, None], own, other)
    push = state.weight * state.pressure * (np.einsum("nd,nd->n", own, other) > 0)
    return float(np.linalg.norm(push @ smaller)) / bound


def _jump(cells: Ints, stress: Array, von_mises: Array) -> float:
    """Mean stress of cells (c, k) less that of the cells around, root mean square, by that of the equivalent stress."""
    mean, k = np.trace(stress, axis1=1, axis2=2) / 3, cells.shape[1]
    count = np.bincount(cells.ravel())
    around = np.bincount(cells.ravel(), np.repeat(mean, k)) / np.maximum(count, 1)
    size = float(np.linalg.norm(von_mises))
    return float(np.linalg.norm(mean - around[cells].mean(axis=1))) / size if size else 0.0


def reasons_to_doubt(simulation: Simulation, steps: Sequence[StepResult]) -> Iterator[str]:
    """Yield why an answer that is solved may be wrong all the same: each makes it doubtful."""
    if times := simulation.stepper.chain.unsettled:
        yield (
            f"the pairs of a sliding contact change from search to search at t = {times[0]:g}"
            f"{f' and {len(times) - 1} other times' * (len(times) > 1)}: those that change least are kept there; take "
            "more steps, or finer sides"
        )
    if worn := wears_too_fast(simulation, steps):
        yield worn
    for rows in simulation.system.contacts:
        states = [step.contacts[rows.name] for step in steps if rows.name in step.contacts]
        if not states or rows.normal.ties or rows.normal.at_quadrature:  # compliance presses in, on areas of flanks
            continue
        alone, (known, end) = np.any([_alone(rows, state) for state in states], axis=0), _corners(rows)
        leans = np.einsum("nd,nd->n", rows.surface.node_normals(), rows.frames[:, 0]) < LEANS
        counted = _by_area(rows, simulation.problem.timeline.end)
        no_area = (
            f"has no area, by which {counted} counts: that is of the mesh there; round it, or take friction in "
            "proportion to pressure"
        )
        no_flank = (
            "presses half way between the normals of both sides, for no side goes round it; name what lies beyond it "
            "as a part of the side, or the whole skin"
        )
        for places, said in (
            (alone & (known | end) & bool(counted), no_area),
            (alone & ~known & leans & (rows.master is not None), no_flank),
        ):
            for place in rows.surface.points[places][:1]:
                at = ", ".join(f"{x:.4g}" for x in place)
                yield f"contacts.{rows.name}: the corner or edge at ({at}) bears alone and {said}"


def _by_area(rows: ContactRows, end: float) -> str:
    """What of a contact's laws is not in proportion to the pressure, and needs an area; empty: nothing."""
    law = rows.friction
    if rows.wears or law is None:
        return "wear" if rows.wears else ""
    if law.k_T is not None:
        return "friction.k_T"
    return "" if law.remembers or law.homogeneous(rows.normal, rows.time, end) else "friction"


def _alone(rows: ContactRows, state: ContactState) -> Bools:
    """Nodes (n,) that press while no whole facet beside them touches."""
    facets, found = rows.surface.facets, state.pressure > 0
    found[facets[(state.status != OPEN)[facets].all(axis=1)]] = False
    return np.asarray(found)


def _corners(rows: ContactRows) -> tuple[Bools, Bools]:
    """Nodes (n,) of known corners and edges, and at the ends of a side.

    Where supports hold a node along the side, in a plane of symmetry, the side does not end.
    """
    side = rows.surface
    ridges = side.facets[:, [ends[: side.dim - 1] for ends in RIDGES[side.shape]]].reshape(-1, side.dim - 1)
    first, times = different(ridges)
    end = np.isin(np.arange(len(side.nodes)), ridges[first[times == 1]])
    known = side.at_edge + (0.0 if rows.tips is None else rows.tips) > 0
    return known, end & (rows.share_t.T @ rows.free.all(axis=1) > 0)


def wears_too_fast(simulation: Simulation, steps: Sequence[StepResult]) -> str:
    """Why an answer is doubtful where what slip wears off lets it slip on; else empty."""
    wears = any(pair.contact.wear is not None for pair in simulation.problem.pairs.values())
    found = [step for step in steps if wears and step.weakening >= 1]
    if not found:
        return ""
    return (
        f"t = {found[0].time:g}: what slip wears off takes friction away up to "
        f"{max(step.weakening for step in found):.3g} times as fast as the bodies unload, in {len(found)} of "
        f"{len(steps)} steps: such a step has several solutions, and one near to the step before is taken; k times the "
        "pressure is the depth that wears off per length of slip"
    )


def doubts(
    simulation: Simulation, steps: Sequence[StepResult], errors: Sequence[Errors] | None = None
) -> Iterator[str]:
    """Warn of what contacts and energies give reason to doubt.

    Args:
        errors: of the numbers of each step; None: not estimated.
    """
    problem, contacts = simulation.problem, simulation.system.contacts
    if steps and all(step.bodies and not any(b.max_displacement for b in step.bodies.values()) for step in steps):
        yield "nothing loads or moves the bodies: all displacements and forces are zero"
    if simulation.slopes and (lost := [step.time for step in steps if not step.sensitivity]):
        yield f"derivatives are not known from t = {lost[0]:g} on: the laws of a step, linearised, have no one solution"
    yield from _carried_at_points(problem, steps)
    yield from _several_solutions(steps, problem.labels("N/m" if problem.model.startswith("plane") else "N"))
    yield from _jumps(steps, problem.labels("J/m" if problem.model.startswith("plane") else "J"))
    yield from _slip_jumps(simulation, steps)
    yield from large_time_errors(problem, steps, errors or ())
    for rows in contacts:
        states = [step.contacts[rows.name] for step in steps if rows.name in step.contacts]
        if not states or rows.normal.ties:
            continue
        if not problem.pairs[rows.name].contact.sliding:
            yield from _slid_far(rows, problem, states)
        yield from _at_corners(rows, states)
        yield from _worn_far(rows, states[-1], problem.labels.length)
        peak = max(states, key=lambda state: state.max_pressure)
        if (peak.status != OPEN).any() and peak.max_pressure > 0:
            yield from _few_points(rows, problem, peak)
            yield from _cut_corners(rows, problem, peak)


def beyond_linear(steps: Sequence[StepResult]) -> str:
    """Name the resultant that finite strain and rotation, which are left out, change by more than `GROSS` of it.

    Components of resultants, and those that are small beside the largest of their step, are not judged.
    """
    worst = (GROSS, "")
    for step in steps:
        forces = [(key, value) for key, number, value in walk(step) if number.kind == "force"]
        sizes = {key: float(np.linalg.norm(value)) for key, value in forces if key.quantity != "tangential_force"}
        for key, size in sizes.items():
            parts = step.errors.get(str(key))
            if size > GROSS * max(sizes.values()) and parts is not None and parts.model is not None:
                worst = max(worst, (float(np.linalg.norm(parts.model)) / size, f"{key} at t = {step.time:g}"))
    share, name = worst
    return name and f"finite strain and rotation, which are left out, change {name} by about {share:.0%}"


def _carried_at_points(problem: Problem, steps: Sequence[StepResult]) -> Iterator[str]:
    """Supports at a point that carry: a point gives way the more, the finer the mesh is, and all numbers with it."""
    points = [name for name, support in problem.supports.items() if support.boundary is None]
    share = dict.fromkeys(points, 0.0)
    for step in steps if points else ():
        sizes = {name: float(np.linalg.norm(support.force)) for name, support in step.supports.items()}
        largest = max([*sizes.values(), *(float(np.linalg.norm(c.force)) for c in step.contacts.values())])
        for name in points:
            share[name] = max(share[name], sizes.get(name, 0.0) / largest if largest else 0.0)
    name = max(share, key=share.__getitem__, default="")
    if name and share[name] > SMALL:
        yield (
            f"supports.{name}: a point carries {share[name]:.0%} of the largest force, and gives way the more, the "
            "finer the mesh is: numbers that depend on it have no limit, and stated errors are too small; hold a side"
        )


def _several_solutions(steps: Sequence[StepResult], unit: str) -> Iterator[str]:
    """Warn of the first step where friction admits several solutions; what follows depends on the one taken."""
    step = next((step for step in steps if step.other_solutions), None)
    if step is None:
        return
    found = [{name: contact.normal_force for name, contact in step.contacts.items()}, *step.other_solutions]
    apart = {name: max(one[name] for one in found) - min(one[name] for one in found) for name in found[0]}
    name = max(apart, key=apart.__getitem__)
    more = ", ".join(f"{one[name]:.4g}" for one in step.other_solutions)
    yield (
        f"t = {step.time:g}: so much friction admits several solutions, and the model does not say which; taken is the "
        f"one reached from the step before, with a normal force of {found[0][name]:.4g} {unit} "
        f"in contacts.{name}; others that were met have {more} {unit}"
    )


def _jumps(steps: Sequence[StepResult], unit: str) -> Iterator[str]:
    """Warn of steps whose solution does not go on from the step before."""
    found = [(step.time, step.jump) for step in steps if step.jump is not None]
    if found:
        time, freed = max(found, key=lambda each: abs(each[1]))
        yield (
            f"t = {found[0][0]:g}: no equilibrium goes on from the step before as the load grows: bodies jump, in "
            f"{len(found)} of {len(steps)} steps, and inertia, which is left out, may carry them elsewhere; the jump "
            f"at t = {time:g} sets {freed:.3g} {unit} free"
        )


def _slip_jumps(simulation: Simulation, steps: Sequence[StepResult]) -> Iterator[str]:
    """Warn where friction weakens faster than bodies unload: of the first such step."""
    found = [step for step in steps if step.weakening >= 1]
    if found and not wears_too_fast(simulation, steps):
        yield (
            f"t = {found[0].time:g}: friction weakens by slip {max(step.weakening for step in found):.3g} times as "
            f"fast as the bodies unload, so slip jumps, in {len(found)} of {len(steps)} steps: such a step has several "
            "solutions, and the nearest one to the step before is taken; inertia, which is left out, may carry it on"
        )


def large_time_errors(problem: Problem, steps: Sequence[StepResult], errors: Sequence[Errors]) -> Iterator[str]:
    """A warning of the largest error that the time steps leave: in a dissipation at the end, or an area at some step.

    That of an area is relative to the largest area that touches at any step: of a contact that begins at a point, a
    node more or less is a large part.
    """
    found = [(0.0, "")]  # relative error, and where
    touching = {name: max((step.contacts[name].contact_area for step in steps), default=0.0) for name in problem.pairs}
    for step, its in zip(steps, errors, strict=False):
        work = abs(step.energy.external) + step.energy.stored
        for name, contact in step.contacts.items():
            numbers = {f"{area} area": (f"{area}_area", touching[name]) for area in ("contact", "stick", "slip")}
            # of the work and energy; what friction dissipated is less where nothing slips
            if step is steps[-1] and contact.dissipation_total > max(GROSS * step.energy.dissipated, ROUNDING * work):
                numbers["dissipation"] = "dissipation_total", contact.dissipation_total
            for what, (key, scale) in numbers.items():
                off = its[Quantity("contacts", name, key)].time_step
                # a number within its error of zero has no error in per cent
                if off is not None and scale > (float(off) if what == "dissipation" else 0.0):
                    found.append((float(off) / scale, f"the {what} of contacts.{name}"))
    share, where = max(found)
    if share > LARGE:
        longest = max(np.diff([step.time for step in steps], prepend=0.0))
        count = share / LARGE * problem.timeline.end / longest  # the error is of first order
        digits = 10 ** max(int(np.log10(count)) - 1, 0)
        use = f"steps.count = {int(np.ceil(count / digits)) * digits}"
        if (clock := problem.timeline.clock) is not None:
            use = f"steps.clock.error = {clock.error * LARGE / share:.0e}"
        yield f"the time steps leave an error of about {share:.0%} in {where}; use {use}"


def _slid_far(rows: ContactRows, problem: Problem, states: Sequence[ContactState]) -> Iterator[str]:
    """A slip beyond a facet of the master; on an obstacle one that leaves its surface. A plane is alike everywhere."""
    closed, length = [(state, state.status != OPEN) for state in states], problem.labels.length
    if rows.master is not None:
        facet = facet_length(rows)
        slid = max(state.max_slip for state in states)
        if slid > facet:
            yield (
                f"contacts.{rows.name}: slips by up to {slid:.3g} {length}, past facets of {facet:.2g} {length}, while "
                f"each point keeps the facet it began at; set contacts.{table_of(rows.name)}.sliding = true"
            )
        return
    obstacle = problem.obstacles[str(problem.pairs[rows.name].obstacle)]
    if obstacle.rotation is not None:  # of the slip, nothing moves the body along a surface that turns in itself
        return
    missed, worst = 0.0, 0.0
    for state, touching in closed:
        if not touching.any():
            continue
        off = strayed(rows, obstacle, state)
        miss = float(np.abs(off[touching]).max()) / motion(rows, problem, state)
        if miss > missed:
            missed, worst = miss, state.max_slip
    if missed > LARGE:
        yield (
            f"contacts.{rows.name}: slips by up to {worst:.3g} {length} on a curved obstacle, while each point keeps "
            f"the normal it began with; set contacts.{table_of(rows.name)}.sliding = true"
        )


def strayed(rows: ContactRows, obstacle: Obstacle, state: ContactState) -> Array:
    """Gap (n,) [m] to a curved obstacle that slips open, of second order, while normals are those of the start."""
    moved = moved_on_obstacle(rows, state)
    off = obstacle.signed_gap(rows.surface.points + moved) - obstacle.signed_gap(rows.surface.points)
    return np.asarray(off + np.einsum("nd,nd->n", moved, rows.frames[:, 0]))


def _worn_far(rows: ContactRows, state: ContactState, length: str) -> Iterator[str]:
    """A worn depth beside the part that touches: bodies keep their shape, and the stiffness of what has worn off."""
    touching = rows.surface.points[state.status != OPEN]
    extent = float(np.ptp(touching, axis=0).max()) if len(touching) else 0.0
    if state.max_wear is not None and state.max_wear > LARGE * extent > 0:
        yield (
            f"contacts.{rows.name}: wears by {state.max_wear:.3g} {length}, {state.max_wear / extent:.0%} of the part "
            "that touches, while the bodies keep what has worn off: they are stiffer and flatter than they would be"
        )


def _at_corners(rows: ContactRows, states: Sequence[ContactState]) -> Iterator[str]:
    """Corners that press on corners."""
    tips = np.zeros(len(rows.surface.nodes)) if rows.tips is None else rows.tips
    places = (tips > 1) & np.any([state.pressure > 0 for state in states], axis=0)
    for point in rows.surface.points[places][:1]:
        place = ", ".join(f"{x:.4g}" for x in point)
        yield (
            f"contacts.{rows.name}: the corner or edge at ({place}) presses on one along it, half way between faces, "
            "which is a choice"
        )


def _few_points(rows: ContactRows, problem: Problem, state: ContactState) -> Iterator[str]:
    """A closed part with an open edge on a curved gap, with too few elements, or with a peak that its mesh makes."""
    closed, beside, pair = state.status != OPEN, rows.surface.neighbours, problem.pairs[rows.name]
    ring = closed | (beside @ closed > 0)
    gap = rows.node_gap[ring]
    flat = closed.all() or float(np.ptp(gap)) <= ROUNDING * float(np.ptp(rows.surface.points, axis=0).max())
    if flat and not unresolved(rows, state):
        return  # all of the side, or flat on flat
    facets = int(closed[rows.surface.facets].all(axis=1).sum())
    alike = facets / 2 if rows.surface.shape == "triangle" else facets
    top, other = int(np.argmax(state.pressure)), elements_touched(rows, state)[1]
    around = beside[top].indices
    peak = float(state.pressure[top] / state.pressure[around].mean() - 1) if closed[around].all() else 0.0
    advice = _refine(problem, pair.slave) + ("" if rows.surface.degree > 1 else ", or set geometry.order = 2")
    if alike < FEWEST[rows.surface.dim]:
        yield (
            f"contacts.{rows.name}: only {int(closed.sum())} points touch, on {facets} whole facets, too few for the "
            f"maximum pressure; {advice}"
        )
    elif other < ACROSS[rows.surface.dim]:
        yield (
            f"contacts.{rows.name}: the part that touches has only {other:.2g} elements of {pair.master} across, too "
            f"few for the maximum pressure; {_refine(problem, str(pair.master))}"
        )
    elif peak > GROSS:
        yield (
            f"contacts.{rows.name}: the maximum pressure stands {peak:.0%} above that of the points around it, where "
            f"{int(closed.sum())} touch: it is the mesh's; {advice}"
        )


def _refine(problem: Problem, side: str) -> str:
    """Name the key that makes the elements of a side smaller: some builders have a key of their own for a body."""
    key = f"{side.partition('.')[0]}_mesh_size"
    return f"refine geometry.{key}" if getattr(problem.shape, key, None) else "refine contact_mesh_size"


def _cut_corners(rows: ContactRows, problem: Problem, state: ContactState) -> Iterator[str]:
    """Facets of order 1 whose distance from a curved side counts beside the motion that the pressure causes."""
    closed = state.status != OPEN
    if rows.surface.degree > 1 or problem.pairs[rows.name].contact.gap is not None:
        return
    cut = _sagitta(rows.surface, closed)
    if rows.master is not None:
        facing = rows.relative[np.flatnonzero(closed), len(closed) :]
        cut = max(cut, _sagitta(rows.master, np.isin(np.arange(len(rows.master.points)), facing.indices)))
    share = cut / motion(rows, problem, state)
    if share > LARGE:
        yield (
            f"contacts.{rows.name}: flat facets cut up to {cut:.2g} {problem.labels.length} off a curved side, "
            f"{share:.0%} of the motion that the pressure causes; set geometry.order = 2, or refine contact_mesh_size"
        )


def _sagitta(side: Surface, touching: Bools) -> float:
    """Largest height [m] of an arc above the first edge of a facet that touches, by the normals at its ends."""
    edge, normals = side.facets[:, :2], side.node_normals()
    edge = edge[touching[edge].all(axis=1)]
    turn = np.linalg.norm(normals[edge[:, 1]] - normals[edge[:, 0]], axis=1)
    return float((_lengths(side.points, edge) * turn).max(initial=0.0)) / 8


def _lengths(points: Array, facets: Ints) -> Array:
    """Length (f,) [m] of the first edge of each facet."""
    return np.asarray(np.linalg.norm(points[facets[:, 1]] - points[facets[:, 0]], axis=1))


def motion(rows: ContactRows, problem: Problem, state: ContactState) -> float:
    """Motion [m] that the largest pressure or pull causes: times the extent of the closed part, by E of each body.

    Where the contact transmits nothing it is inf: nothing counts beside it.
    """
    powers = rows.surface.dim - 1 + rows.surface.axisymmetric
    give: float = sum(
        1 / problem.bodies[body].modulus_along(rows.frames[:, 0]) for body in problem.pairs[rows.name].bodies
    )
    strain = float(np.abs(state.pressure).max(initial=0.0)) * give
    # strain below which a contact transmits nothing
    return strain * float(state.contact_area ** (1 / powers)) if strain > LAST_DIGITS else np.inf
