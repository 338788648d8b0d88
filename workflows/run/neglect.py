"""The neglect report: what each effect that is off would have changed in the main numbers of the last step.

Nothing is solved. By Betti's theorem the solution u itself is the adjoint of the forces that hold it: a load f that is
left out does the work A = f . u, and changes forces of bodies that are held, relative to their own, by A over the work
2 (elastic energy + that of compliant laws); an initial strain does A = ∫ sigma : strain, and a change of gaps
A = ∫ p change. Where equilibrium alone gives a contact's force, as where a load presses on a body that nothing else
holds, a strain changes none, and a load all that its resultant asks for. Largest pressures change by what a change of
the gap, uniform parts left out, is of the motion that the pressure causes. To first order all of that is exact for a
column; elsewhere it is an estimate, within a factor of 3 in what `stickslip verify neglect` turns on.

Where the scene lacks a property, no value is guessed: stated is the one at which a main number changes by `REACHED`.

Source: Betti, Nuovo Cimento 7 (1872); of the heated column see `_friction_heat`, of wear `Wear`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np
from scipy.optimize import brentq

from stickslip.geometry.arrays import TINY, Array, Bools
from stickslip.geometry.errors import SceneError
from stickslip.geometry.keys import Key
from stickslip.geometry.surfaces.faces import RIDGES
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.accuracy.model_error import left_out
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.results.step_result import (
    OPEN,
    SLIP,
    ContactState,
    Errors,
    Quantity,
    StepResult,
    quantities,
    values,
    von_mises,
)
from stickslip.solvers.simulation.resolve import RigidMotions
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.state import State
from stickslip.workflows.run.ranks import from_rank_0
from stickslip.workflows.run.warnings import GROSS, Seen, corners, middles_and_volumes, motion, strayed

REACHED = 0.01  # of a number: the change at which a property that the scene lacks is stated
GRAVITY = 9.80665  # of the Earth [m/s²]
UNTIMED = "times are not seconds (steps.seconds): this is as if they were"


@dataclass(frozen=True)
class Where:
    """Place at which an effect is largest."""

    part: str  # bodies.NAME or contacts.NAME
    point: list[float]  # [m]


@dataclass(frozen=True, kw_only=True)
class Neglected:
    """An effect that is off."""

    effect: str
    number: Annotated[float | None, Key("-", "largest relative change of a main number; null: a property lacks")]
    where: Where | None
    changes: Annotated[Mapping[str, float], Key("", "of main numbers of the last step, in their units")]
    seconds: Annotated[float, Key("s", "that a run with it takes longer, about, from the run's own")]
    reaches: Annotated[
        Mapping[str, float], Key("", "by property that the scene lacks: value at which a main number changes by 1 %")
    ]
    says: str  # what else there is to say


class Found(NamedTuple):
    """Relative changes of main numbers by name; if a property `lacks`, of its value 1, and with that power of it."""

    changes: Mapping[str, float]
    where: Where | None = None
    lacks: str = ""
    power: float = 1.0
    says: str = ""


@dataclass(frozen=True, kw_only=True)
class Side:
    """A contact of the last step; arrays run over its n slave nodes."""

    rows: ContactRows
    state: ContactState
    motions: Array  # (n, d, k) relative to the other side in the rigid motions that no support resists
    extent: float  # motion that its largest pressure causes [m]; inf: it presses nowhere
    given: float = 0.0  # part of the normal force that equilibrium alone gives [-]
    asks: Array = field(default_factory=lambda: np.zeros(0))  # (k,) rigid motion that moves all of it by 1
    driven: float = 0.0  # part of the tangential force that equilibrium alone gives [-]

    @property
    def push(self) -> Array:
        """Normal forces (n,) [N]."""
        return np.asarray(self.state.weight * np.maximum(self.state.pressure, 0.0))

    @property
    def along(self) -> Array:
        """Mean normal (d,) of what presses, shorter where normals differ."""
        return np.asarray(self.push @ self.rows.frames[:, 0] / max(self.push.sum(), TINY))

    @property
    def across(self) -> Array:
        """Direction (d,) of the friction's resultant."""
        found = self.state.weight @ self.state.traction
        return np.asarray(found / max(float(np.linalg.norm(found)), TINY))

    @cached_property
    def rubbing(self) -> float:
        """Part of the friction that slips, and follows the pressure [-]."""
        size = self.state.weight * np.linalg.norm(self.state.traction, axis=1)
        return float(size[self.state.status == SLIP].sum() / max(size.sum(), TINY))

    def at(self, size: Array) -> Where:
        """The node where something (n,) is largest."""
        return Where(f"contacts.{self.rows.name}", self.state.points[int(np.argmax(size))].tolist())


class Answer:
    """The last step of a run as the effects read it, on rank 0."""

    def __init__(self, simulation: Simulation, steps: Sequence[StepResult], seen: Seen, errors: Errors) -> None:
        """
        Args:
            seen: of the fields until then.
            errors: of its numbers; empty: not estimated.
        """
        self.problem, self.mesh, self.steps, self.last = simulation.problem, simulation.data, steps, steps[-1]
        self.seen, self.errors, self.timed = seen, errors, simulation.scene.steps.seconds
        self.nodes = corners(self.mesh, self.mesh.cells)
        self.middles, self.volume = middles_and_volumes(self.mesh, self.problem.axisymmetric)
        self.work = 2 * (self.last.energy.stored + self.last.energy.compliance)
        forces = [(c.tangential_force, c.normal_force) for c in self.last.contacts.values()]
        across, normal = np.sum([(0.0, 0.0), *forces], axis=0)
        soft = next(iter(self.problem.bodies.values()))
        sheared = soft.modulus / soft.shear_modulus * float(across / max(normal, TINY)) ** 2  # energy by the pressure's
        self.pressing, self.shearing = self.work / (1 + sheared), self.work * sheared / (1 + sheared)
        self.span = self.last.time - (steps[-2].time if len(steps) > 1 else 0.0)  # [s]
        self.motions = RigidMotions(self.problem)
        own, count = self.problem.rigid_modes, len(self.motions.driven)
        self.free = np.zeros((len(own) + count, own.shape[1] + count))
        self.free[: len(own), : own.shape[1]], self.free[len(own) :, own.shape[1] :] = own, np.eye(count)
        self.sides = self._with_given(
            [self._side(rows) for rows in simulation.system.contacts if rows.name in self.last.contacts]
        )

    def _side(self, rows: ContactRows) -> Side:
        pair, state = self.problem.pairs[rows.name], self.last.contacts[rows.name]
        one, x = self.motions.fields(pair.slave.split(".")[0], rows.surface.points), rows.surface.points
        other = self.motions.of_obstacle(pair.obstacle, x) if pair.obstacle else None
        other = self.motions.fields(str(pair.master).split(".")[0], x) if other is None else other
        return Side(rows=rows, state=state, motions=(one - other) @ self.free, extent=motion(rows, self.problem, state))

    def _with_given(self, sides: Sequence[Side]) -> list[Side]:
        """Find rigid motions that move one contact along its pressures, or its friction, and nothing else.

        They are least squares fits over all nodes, weighted by the forces there: what is missed by a tenth and more,
        as where other contacts carry too, is not given by equilibrium alone.
        """
        if not sides or not self.free.shape[1]:
            return [*sides]
        pulls = list[tuple[Array, Array]]()  # each (n d, k), and what of it is wanted
        for side in sides:
            normal, traction = side.rows.frames[:, 0], side.state.traction
            size = np.linalg.norm(traction, axis=1)
            along = np.einsum("nd,ndk->nk", normal, side.motions)
            across = side.motions - normal[:, :, None] * along[:, None]
            rubs = np.sqrt(side.state.weight * size)
            pulls.append((np.sqrt(side.push)[:, None] * along, np.sqrt(side.push)))
            wanted = rubs[:, None] * traction / np.maximum(size, TINY)[:, None]
            pulls.append(((rubs[:, None, None] * across).reshape(-1, self.free.shape[1]), wanted.ravel()))
        resists, ends = np.concatenate([pull for pull, _ in pulls]), np.cumsum([0, *(len(w) for _, w in pulls)])
        found = list[tuple[float, Array]]()
        for (_, wanted), first in zip(pulls, ends, strict=False):
            whole = np.zeros(len(resists))
            whole[first : first + len(wanted)] = wanted
            asks = np.linalg.lstsq(resists, whole, rcond=REACHED)[0]
            missed = float(np.sum((resists @ asks - whole) ** 2) / max(float(whole @ whole), TINY))
            found.append((max(1 - missed / GROSS, 0.0) if whole.any() else 0.0, asks))
        return [
            replace(side, given=given, asks=asks, driven=driven)
            for side, (given, asks), (driven, _) in zip(sides, found[::2], found[1::2], strict=True)
        ]

    def members(self, body: str) -> Bools:
        """Cells (c,) of a body."""
        return np.asarray(self.mesh.body == self.mesh.bodies.index(body))

    def at(self, size: Array) -> Where:
        """The cell where something (c,) is largest."""
        cell = int(np.argmax(size))
        return Where(f"bodies.{self.mesh.bodies[self.mesh.body[cell]]}", self.middles[cell].tolist())

    def numbers(self, of: Callable[[Side], tuple[float, float]], energy: float) -> dict[str, float]:
        """Relative changes by name, from those of each contact's normal force and largest pressure.

        Of what slips friction follows the pressure. What grows without end on finer meshes has no change.
        """
        found = {"energy.stored": energy}
        for side in self.sides:
            force, peak = of(side)
            name, parts = side.rows.name, {"normal_force": force, "max_pressure": peak}
            parts["tangential_force"] = side.rubbing * force
            for key, size in parts.items():
                error = self.errors.get(Quantity("contacts", name, key))
                if getattr(side.state, key) and not (error and error.converges is False):
                    found[f"{name}.{key}"] = size
        return found

    def strained(self, work: float, peak: float = 0.0) -> dict[str, float]:
        """Changes by an initial strain that the stress does this work on [J]; of pressures at least a part of it.

        Held bodies change their forces by A over twice the energy, and their energy by twice as large a part; bodies
        that loads alone press give way, and keep their stress.

        Args:
            work: A [J], of either sign.
            peak: part of the change of bodies that are held, by which largest pressures change where loads press: a
                strain that is largest below the contact spreads it.
        """
        share = abs(work) / max(self.work, TINY)
        held = max((1 - side.given for side in self.sides), default=1.0)
        return self.numbers(
            lambda side: ((1 - side.given) * share, max(1 - side.given, peak) * share), 2 * held * share
        )

    def loaded(self, force: Array) -> dict[str, float]:
        """Changes by a force per volume (c,) [N/m³] along the normal of each contact.

        Held bodies divide it: the driven side gives up A over its motion, and what it carries itself presses on. A
        column that is held at both ends has half of its weight on its base. Where equilibrium alone gives the force,
        the work of the load in the rigid motion that moves the contact by 1 is the change.

        The stored energy of bodies that are driven by motions alone does not change to first order: the work of their
        stress on a displacement that vanishes where they are held is none. By loads it changes by their work.
        """
        nodes, lever = self.last.displacement[self.nodes].mean(axis=1), self.volume * force

        def asked(side: Side) -> float:
            """The resultant that equilibrium asks of the contact."""
            fields = np.concatenate([self.motions.fields(b, self.middles[self.members(b)]) for b in self.mesh.bodies])
            order = np.concatenate([np.flatnonzero(self.members(body)) for body in self.mesh.bodies])
            return abs(float(lever[order] @ np.einsum("cdk,d->ck", fields @ self.free, side.along) @ side.asks))

        def held(side: Side) -> float:
            """The load on the side that is driven, beyond what its drive gives up."""
            pair, moved = self.problem.pairs[side.rows.name], nodes @ side.along
            own = [self.members(body) for body in pair.bodies]
            ways = [float(self.volume[cells] @ moved[cells] / self.volume[cells].sum()) for cells in own]
            if pair.obstacle:
                ways.append(float(self.last.obstacles[pair.obstacle].displacement @ side.along))
            forth, back = ways[0], -ways[1]
            more = lever[own[0]].sum() if forth > max(back, 0.0) else -lever[own[-1]].sum() if back > 0 else 0.0
            more = 0.0 if back > max(forth, 0.0) and pair.obstacle else more
            return abs(float(more - lever @ moved * side.push.sum() / max(self.pressing, TINY)))

        def of(side: Side) -> tuple[float, float]:
            force = (side.given and side.given * asked(side)) + (1 - side.given) * held(side)
            return force / max(side.push.sum(), TINY), force / max(side.push.sum(), TINY)

        own = [2 * side.given * of(side)[0] for side in self.sides]  # of bodies that are held it does not change
        return self.numbers(of, max(own, default=2 * np.abs(lever @ nodes).max() / max(self.work, TINY)))

    def opened(self, gaps: Mapping[str, Array]) -> dict[str, float]:
        """Changes by gaps that are wider by (n,) [m], by contact.

        Held bodies change their forces by the work of the pressures on it over twice the energy. The largest pressure
        changes by what is left of the gap without its mean, beside the motion that this pressure causes.
        """
        known = {side.rows.name: (side, gaps[side.rows.name]) for side in self.sides if side.rows.name in gaps}
        share = abs(sum(float(side.push @ gap) for side, gap in known.values())) / max(self.work, TINY)

        def of(side: Side) -> tuple[float, float]:
            name, touching = side.rows.name, side.state.status != OPEN
            force = (1 - side.given) * share
            if name not in known or not touching.any():
                return force, force
            uneven = known[name][1] - float(side.push @ known[name][1]) / max(side.push.sum(), TINY)
            return force, force + float(np.abs(uneven[touching]).max()) / side.extent

        return self.numbers(of, 2 * share * max((1 - side.given for side, _ in known.values()), default=0.0))


def _strain_and_rotation(answer: Answer) -> Iterator[Found]:
    """The estimate of `error.NUMBER.model`."""
    main, found = answer.strained(0.0), dict[str, float]()
    for key, value in quantities(answer.last).items():
        name, error = str(key).removeprefix("contacts."), answer.errors.get(key)
        if name in main and value and error and error.model is not None:
            found[name] = float(np.abs(error.model) / np.abs(value))
    yield Found(found)


def _yielding(answer: Answer) -> Iterator[Found]:
    """Plastic strain of the stress above the yield stress Y, (sigma - Y) / (3 G), perfectly plastic: Y by body.

    The work of the stress on it falls with Y, which is searched for that of `REACHED`.
    """
    stress, most = von_mises(answer.last.stress), max(answer.strained(answer.work, 1.0).values())
    for body in answer.mesh.bodies:
        own, soft = answer.members(body), 3 * answer.problem.bodies[body].shear_modulus

        def excess(Y: float, own: Bools = own, soft: float = soft) -> float:
            lost = answer.volume[own] @ (stress[own] * np.maximum(stress[own] - Y, 0.0)) / soft
            return float(most * lost / max(answer.work, TINY)) - REACHED

        if excess(0.0) > 0:
            Y = brentq(excess, 0.0, float(stress[own].max()))
            yield Found(
                {"": REACHED / Y}, answer.at(np.where(own, stress, 0.0)), f"yield stress of bodies.{body} [Pa], below"
            )


def _inertia(answer: Answer) -> Iterator[Found]:
    """Oscillations with the kinetic energy of the step, beside the elastic one.

    Of a column whose end is driven from rest at a steady speed that is 1 / sqrt(3) of the largest deviation.
    """
    density = np.array([answer.problem.bodies[body].density for body in answer.mesh.bodies])
    density = density if density.any() else np.ones(len(density))
    kinetic = float(density @ np.array(answer.seen.moved)) / answer.span**2
    share = float(np.sqrt(kinetic / max(answer.work, TINY)))
    lacks = "" if any(m.density for m in answer.problem.bodies.values()) else "density of all bodies [kg/m³]"
    power = 0.5
    if not answer.timed and not lacks:
        lacks, power = "seconds per unit of time, below", -1.0
    yield Found(
        dict.fromkeys(answer.numbers(lambda side: (share, share), share), share),
        Where(answer.seen.fastest[0], [*answer.seen.fastest[1]]),
        lacks,
        power,
        "" if answer.timed or power < 0 else UNTIMED,
    )


def _friction_heat(answer: Answer) -> Iterator[Found]:
    """A heated body that expands: steady, all heat through a body whose far side keeps its temperature.

    A flux q through a depth H makes it warmer by q H / (2 k) in the mean, so that the confined column of unit
    conductivity that rubs at V has p (1 + E expansion mu V H / (2 (1 - 2 nu))), to first order as it is.
    """
    for side in answer.sides:
        power, area = side.state.dissipation / answer.span, float(side.state.weight.sum())
        for body in answer.problem.pairs[side.rows.name].bodies if power > 0 else ():
            own, trace = answer.members(body), answer.volume * np.trace(answer.last.stress, axis1=1, axis2=2)
            warm = power / area * float(answer.volume[own].sum()) / area / 2
            yield Found(
                answer.strained(float(trace[own].sum()) * warm),
                side.at(side.state.pressure * np.linalg.norm(side.state.slip_increment, axis=1)),
                f"expansion / conductivity of bodies.{body} [m/W]",
                says="" if answer.timed else UNTIMED,
            )


def _thermal_expansion(answer: Answer) -> Iterator[Found]:
    """A body that is warmer as a whole.

    Strains that differ between two bodies which friction holds together are not seen.
    """
    trace = answer.volume * np.trace(answer.last.stress, axis1=1, axis2=2)
    for body in (body for body in answer.mesh.bodies if body not in answer.problem.tables.get("thermal", ())):
        own = answer.members(body)
        where = answer.at(np.where(own, np.abs(trace / answer.volume), 0.0))
        yield Found(answer.strained(float(trace[own].sum())), where, f"expansion × temperature of bodies.{body} [-]")


def _wear(answer: Answer) -> Iterator[Found]:
    """Archard's depth by the pressures and slips of all steps."""
    gaps = dict[str, Array]()
    for side in (side for side in answer.sides if not side.rows.wears and side.rows.normal.sides == 1):
        name, times = side.rows.name, [0.0, *(step.time for step in answer.steps)]
        states = [step.contacts.get(name, side.state) for step in answer.steps]
        before = np.zeros_like(side.state.slip)
        depth = np.zeros(len(before))
        for state, one, two in zip(states, times, times[1:], strict=False):
            aside = np.zeros(len(before))
            if side.rows.fields is not None and side.rows.fields.slide is not None:
                aside = side.rows.fields.slide.within(state.points, two, two - one, side.rows.fields.end)
            length = np.hypot(np.linalg.norm(state.slip - before, axis=1), aside)
            depth, before = depth + np.maximum(state.pressure, 0.0) * length, state.slip
        gaps[name] = depth
    if gaps:
        name = max(gaps, key=lambda each: float(gaps[each].max(initial=0.0)))
        side = next(side for side in answer.sides if side.rows.name == name)
        yield Found(answer.opened(gaps), side.at(gaps[name]), "wear.k of all contacts [1/Pa]")


def _creep(answer: Answer) -> Iterator[Found]:
    """Strain at a rate in proportion to the stress, over all steps; stresses grow as the root of the energy."""
    times = np.array([0.0, *(step.time for step in answer.steps)])
    sizes = np.sqrt([0.0, *(max(step.energy.stored, 0.0) for step in answer.steps)])
    lasts = float(np.diff(times) @ (sizes[1:] + sizes[:-1]) / 2) / max(float(sizes[-1]), TINY)
    stress = von_mises(answer.last.stress)
    yield Found(
        answer.strained(lasts * float(answer.volume @ stress**2), 1.0),
        answer.at(stress),
        "creep rate by von Mises stress [1/(Pa s)]",
        says="" if answer.timed else UNTIMED,
    )


def _rate_dependence(answer: Answer) -> Iterator[Found]:
    """Another mu at the slip rates of the step, where points slip.

    If all do, friction follows it; by Betti's theorem it changes less where what sticks, or the drive, holds the rest.
    """
    for side in answer.sides:
        if side.rows.friction is None or side.rows.friction.timed or not side.rubbing:
            continue
        name, slipping = side.rows.name, side.state.status == SLIP
        rate = np.linalg.norm(side.state.slip_increment, axis=1) / answer.span * slipping
        path = np.abs(side.state.slip @ side.across) * slipping
        pulls = side.state.weight * np.linalg.norm(side.state.traction, axis=1)
        least = float(side.push @ path) / max(float(pulls @ path) + answer.shearing, TINY)
        most = float(side.push[slipping].sum()) / max(float(pulls.sum()), TINY)
        more = (1 - side.driven) * most**side.rubbing * least ** (1 - side.rubbing)
        says = f"points slip at up to {rate.max():.2g} per s" if answer.timed else UNTIMED
        lacks = f"change of mu of contacts.{name} by the rate [-]"
        yield Found({f"{name}.tangential_force": more}, side.at(rate), lacks, says=says)


def _gravity(answer: Answer) -> Iterator[Found]:
    """The weight, along the normal of each contact.

    An acceleration across it is not judged: of what slips, it changes no friction.
    """
    density = np.array([answer.problem.bodies[body].density for body in answer.mesh.bodies])
    lacks = "" if density.any() else "density of all bodies [kg/m³]"
    try:
        g, says = answer.problem.labels.amount(GRAVITY, "m/s²", ""), ""
    except SceneError:
        g, says = 1.0, "under an acceleration of 1"
    weight = g * (density if density.any() else np.ones(len(density)))[answer.mesh.body]
    yield Found(answer.loaded(weight), answer.at(weight), lacks, says=says)


def _sliding(answer: Answer) -> Iterator[Found]:
    """Gaps that slips along curved sides open, while points keep the pairs and normals of the start.

    To second order: what the other side's normal turns by on the way counts by half.
    """
    gaps = dict[str, Array]()
    for side in answer.sides:
        pair, rows, state = answer.problem.pairs[side.rows.name], side.rows, side.state
        if pair.contact.sliding or rows.normal.ties or pair.contact.gap is not None:
            continue
        if rows.master is not None:
            onto, d = -rows.relative[:, len(state.points) :], state.slip.shape[1]
            turning = (onto @ _turning(rows.master).reshape(-1, d * d)).reshape(-1, d, d)
            facing = onto @ rows.master.node_normals() + np.einsum("nd,nde->ne", state.slip, turning) / 2
            gaps[rows.name] = np.einsum("nd,nd->n", state.slip, facing)
        elif (obstacle := answer.problem.obstacles[str(pair.obstacle)]).rotation is None:
            gaps[rows.name] = strayed(rows, obstacle, state)
    yield from _by_gaps(answer, gaps)


def _facets(answer: Answer) -> Iterator[Found]:
    """Gaps that straight facets open between curved sides, by the mean height of arcs; obstacles see nodes.

    Uneven gaps store energy of their own, so that of the energy nothing is said.
    """
    gaps = dict[str, Array]()
    for rows in (side.rows for side in answer.sides):
        if rows.master is not None and rows.surface.degree == 1 and answer.problem.pairs[rows.name].contact.gap is None:
            n = len(rows.surface.points)
            both = rows.relative[:, :n] @ _bulge(rows.surface) - rows.relative[:, n:] @ _bulge(rows.master)
            gaps[rows.name] = np.asarray(both)
    for found in _by_gaps(answer, gaps):
        yield found._replace(changes={name: size for name, size in found.changes.items() if name != "energy.stored"})


def _by_gaps(answer: Answer, gaps: Mapping[str, Array]) -> Iterator[Found]:
    pressed = {
        side.rows.name: (side, np.abs(gaps[side.rows.name]) * (side.state.status != OPEN))
        for side in answer.sides
        if side.rows.name in gaps
    }
    if pressed:
        side, size = max(pressed.values(), key=lambda each: float(each[1].max(initial=0.0)) / each[0].extent)
        yield Found(answer.opened(gaps), side.at(size))


def _along_edges(side: Surface) -> tuple[Array, Array]:
    """Edges (e, f, d) of the facets of a side [m], and what its outward normals turn by along them (e, f, d).

    Of a side in 2D the only edge of a facet is the facet. Sides of order 2 are taken by their corners.
    """
    edges = np.array([ends[:2] for ends in RIDGES[side.shape]] if side.dim == 3 else [(0, 1)])
    (a, b), normals = side.facets[:, edges].T, side.node_normals()
    return side.points[b] - side.points[a], normals[b] - normals[a]


def _bulge(side: Surface) -> Array:
    """Mean height (n,) [m] of a curved side above the facets around each node, positive outward."""
    heights = np.einsum("efd,efd->f", *_along_edges(side)) / 8
    return _around(side, heights * (2 if side.dim == 2 else 1) / 3)


def _turning(side: Surface) -> Array:
    """What the outward normal turns by a way (n, d, d) [1/m], its own component last.

    It is linear on a facet, by least squares where that has more edges than dimensions: of a sphere the identity on
    the facet over the radius.
    """
    ways, turns = (np.moveaxis(each, 0, 1) for each in _along_edges(side))
    return _around(side, np.linalg.pinv(ways) @ turns)


def _around(side: Surface, values: Array) -> Array:
    """Means at nodes (n, ...) of values of the facets (f, ...) around them."""
    found, count = np.zeros((len(side.points), *values.shape[1:])), np.zeros(len(side.points))
    for nodes in side.facets.T:
        np.add.at(found, nodes, values)
        np.add.at(count, nodes, 1.0)
    return np.asarray((found.T / np.maximum(count, 1.0)).T)


class Spent(NamedTuple):
    """Seconds of a run that prices are made of."""

    assemble: float
    prepare: float
    iterate: float
    form: float  # of a form that is assembled
    solve: float  # of a volume solve
    steps: int
    dim: int


@dataclass(frozen=True, kw_only=True)
class Effect:
    """What is off; `on` is the effect of the plan that switches it on."""

    name: str
    of: Callable[[Answer], Iterator[Found]]
    price: Callable[[Spent], float]
    on: str = ""


EFFECTS = (
    # about four iterations a step, each with another stiffness
    Effect(name="strain and rotation", of=_strain_and_rotation, price=lambda s: 4 * s.steps * (s.assemble + s.prepare)),
    # four iterations a step with the elastic stiffness, by Anderson's acceleration
    Effect(name="yielding", of=_yielding, price=lambda s: 3 * s.iterate + 4 * s.steps * s.form),
    Effect(name="inertia", of=_inertia, price=lambda s: s.prepare + s.form),
    # one temperature a node, and each step once more
    Effect(name="friction heat", of=_friction_heat, price=lambda s: (s.assemble + s.prepare) / s.dim + s.iterate),
    Effect(name="thermal expansion", of=_thermal_expansion, price=lambda s: 3 * s.form + s.solve, on="thermal"),
    Effect(name="wear", of=_wear, price=lambda s: s.iterate, on="wear"),
    Effect(name="creep", of=_creep, price=lambda s: 3 * s.iterate + 4 * s.steps * s.form),
    Effect(name="friction by rate", of=_rate_dependence, price=lambda s: s.iterate),
    Effect(name="gravity", of=_gravity, price=lambda s: s.dim * s.form + s.solve, on="gravity"),
    Effect(name="sliding search", of=_sliding, price=lambda s: s.steps * s.assemble / 2, on="sliding"),
    # order 2: 2^d times the unknowns, with as many times the entries a row
    Effect(name="facets", of=_facets, price=lambda s: 4**s.dim / 2 * (s.assemble + s.prepare + s.iterate)),
)


def neglected(
    simulation: Simulation, steps: Sequence[StepResult], state: State, seen: Seen, errors: Sequence[Errors] | None
) -> list[Neglected]:
    """The report on the last step of a run, the same on every rank; collective.

    Args:
        steps: of the run, the last one with its fields on rank 0.
        state: at the end of it.
        seen: of the fields until then, on rank 0.
        errors: of the numbers of each step; None: not estimated.
    """
    share, sizes = 0.0, np.zeros(0)
    if not simulation.problem.averaged:
        share, _, own = left_out(simulation.observer, simulation.system, state)
        sizes = simulation.observer.by_cell(own)

    def report() -> list[Neglected]:
        answer, counters = Answer(simulation, steps, seen, errors[-1] if errors else {}), simulation.counters
        assemble, prepare, iterate = (simulation.clock.seconds(of) for of in ("assemble", "prepare", "iterate"))
        spent = Spent(
            assemble=assemble,
            prepare=prepare,
            iterate=iterate,
            form=assemble / max(counters.forms, 1),
            solve=iterate / max(counters.volume_solves, 1),
            steps=len(steps),
            dim=answer.problem.dim,
        )
        first, *others = filter(None, (_row(effect, answer, spent) for effect in EFFECTS))
        return [replace(first, number=share, where=answer.at(sizes)) if len(sizes) else first, *others]

    return from_rank_0(simulation.mesh.comm, report)


def _row(effect: Effect, answer: Answer, spent: Spent) -> Neglected | None:
    """The row of an effect; None: it is on wherever it could be."""
    with np.errstate(all="ignore"):
        every = [*effect.of(answer)]
    if not every and any(row.on and row.effect == effect.on for row in answer.problem.plan):
        return None
    known, reaches = values(answer.last), dict[str, float]()
    changes = dict[str, float]()
    for found in every:
        most = max(found.changes.values(), default=0.0)
        if found.lacks and most > 0:
            reaches[answer.problem.labels.label(found.lacks)] = (REACHED / most) ** (1 / found.power)
        elif not found.lacks:
            changes |= {name: share * abs(known[name]) for name, share in found.changes.items()}
    most = max((share for found in every if not found.lacks for share in found.changes.values()), default=0.0)
    return Neglected(
        effect=effect.name,
        number=None if reaches else most,
        where=next((found.where for found in every), None),
        changes=changes,
        seconds=effect.price(spent),
        reaches=reaches,
        says="; ".join(dict.fromkeys(found.says for found in every if found.says)),
    )
