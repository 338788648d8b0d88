"""A history that a script decides step by step: each step names the values that change."""

from __future__ import annotations

import logging
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields, replace
from numbers import Real
from reprlib import repr as shortly
from typing import Any, TypeGuard

import numpy as np

from stickslip.geometry.amplitude import Amplitude, value_at
from stickslip.geometry.arrays import EXACT
from stickslip.geometry.errors import SceneError, nearest, prefixed, require
from stickslip.geometry.field import Field, HeightMap
from stickslip.solvers.accuracy.budget import budget_of
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.method_registry import method_of
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.scene.scene import Scene, over, with_values
from stickslip.solvers.scene.settings import LARGEST
from stickslip.solvers.scene.timeline import Place
from stickslip.solvers.simulation.sensitivity import Slopes, timelines
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import Accepted, NoEquilibriumError, Stepper

log = logging.getLogger(__name__)
Parts = Mapping[str, float | Mapping[str, float]]  # by component, or by key and component
Values = Mapping[str, Parts]  # by name
Table = Values | Parts  # one that has no names, as gravity
UNCHANGED: Values = {}
CHANGEABLE = {
    "supports": "displacement",
    "loads": "traction, force or pressure, other than a bare 0,",
    "obstacles": "displacement, force or rotation",
}  # of other tables: a value in time
NOT_ASSEMBLED = {"loads", "body_force"}  # where a constant 0 leaves nothing to change
NOT_LAWS = {"law", "k_T"}  # keys of friction laws that stay: the kind, and how far a traction has bent the surface


@dataclass(frozen=True)
class Limit:
    """Limit of a load that contact and friction bear; inf: they bear any."""

    value: float  # the largest that was found to be borne, in the unit of the load
    beyond: float  # the smallest that was found not to be
    multiple: float  # `value` in units of the scene's largest value of this load [-]


class Script:
    """A history that is decided step by step; `Simulation.script` makes one.

    A step may change all that a scene gives in time: supports, loads, obstacles, gap offsets, and tables of effects, as
    gravity, thermal, bolts, springs, plungers, remote_points.

    It starts at rest at t = 0. Slip, energy and all else that depends on the path continue from step to step; the
    bodies are prepared only once.

    A value that no step has named follows the scene. A value that a step has named keeps what it was given until a
    later step names it again. An example::

        script = stickslip.prepare(scene).script()
        step = script.step(to=1.0, supports={"top": {"y": -0.1}})
        while step.contacts["base"].stick_area > 0:  # draw it aside until all of it slips
            step = script.step(to=script.time + 0.1, supports={"top": {"x": 0.05 * script.time}})
    """

    def __init__(self, scene: Scene, stepper: Stepper, observer: Observer, slopes: Slopes | None = None) -> None:
        """Start at rest; collective.

        Args:
            scene: which values there are, and what they are until a step names them.
            stepper: solves the steps.
            observer: makes their results.
            slopes: reads derivatives of their numbers; None: the scene asks for none.
        """
        self._stepper, self._observer, self._slopes = stepper, observer, slopes
        self._scene, self._named = scene, frozenset[Place]()
        self._state, self._altered = stepper.start(), False
        self._times: tuple[float, ...] = ()

    @property
    def time(self) -> float:
        """Time at the end of the last step [s]; 0 before the first."""
        return self._state.time

    def step(
        self,
        *,
        to: float,
        supports: Values = UNCHANGED,
        loads: Values = UNCHANGED,
        obstacles: Values = UNCHANGED,
        contacts: Values = UNCHANGED,
        on_iteration: Callable[[HistoryRow], None] = lambda row: None,
        **effects: Table,
    ) -> StepResult:
        """Solve one step, up to a time, in which the named values change linearly to those given; collective.

        Times in between that the scene's tables list are hit exactly. The result covers the whole step.

        Args:
            to: time at the end [s], after the last one; the first step may be at 0, where values jump.
            supports: {name: {component: displacement [m]}}; components x, y, z, normal.
            loads: {name: {component: value}}; x, y, z: traction [Pa] or force [N], whichever the scene has;
                pressure [Pa], positive when pressing.
            obstacles: {name: {component: value}}; x, y, z: displacement [m] or force [N], whichever the scene has;
                angle [rad].
            contacts: {name: {component: value}}; `gap_offset` [m], of a map of heights its `plus`, and `bound` [Pa];
                other numbers of the friction law, such as `mu`, hold from the start of this step on, if the scene does
                not give them in time; so does `gap_offset` with a method that takes one number for a side.
            on_iteration: called with a `HistoryRow` after each iteration of each attempt, on every rank.
            effects: tables of effects by their names in the scene, in its units: {name: {component or key: value}}, as
                bolts={"m8": {"force": 9e3}}, gravity={"y": -9.81}; {name: {key: {component: value}}} where a component
                belongs to several keys, as remote_points={"hub": {"moment": {"z": 5.0}}}.

        Returns:
            The result at the time `to`; counts, history and dissipation are of the whole step.

        Raises:
            SceneError: a value is not a number, or the scene does not prescribe that component: a displacement that
                was free when the bodies were prepared stays free.
            StepError: the step could not be solved. The script is as it was before: you may try another step.
            NoEquilibriumError: so, and it is shown that contact and friction cannot balance the loads.
        """
        require(_is_number(to), "to", _in_words(to), "expected a number")
        require(to <= LARGEST, "to", to, f"expected at most {LARGEST:g}")
        require(callable(on_iteration), "on_iteration", _in_words(on_iteration), "expected a function")
        begins = not self._times and to == 0
        require(to > self.time or begins, "to", to, f"expected a time after {self.time:g}")
        laws, of_contacts, altered = self._of_contacts(contacts)
        tables = {"supports": supports, "loads": loads, "obstacles": obstacles, "contacts": of_contacts, **effects}
        wanted = self._places(laws, tables)
        self._keep_to_budget()
        with self._stepper.system.counters.clock.phase("iterate"):
            scene, times, stepper, accepted = self._reached(to, wanted, laws, on_iteration)
        with _following(scene, stepper):
            result = self._observer(accepted)
            if self._slopes:
                result = self._slopes(result, accepted, scene.parameters())
        self._stepper, self._altered = stepper, self._altered or altered
        self._scene, self._named = scene, self._named | wanted.keys()
        self._state, self._times = accepted.state, (*self._times, *times)
        return result

    def _keep_to_budget(self) -> None:
        """Follow no further step with errors where `output.error_budget` is used up; collective."""
        system, output = self._stepper.system, self._scene.output
        clock = system.counters.clock
        budget = budget_of(output, sum(map(clock.worked, ("mesh", "assemble", "prepare", "iterate"))))
        if self._stepper.companion is None or budget is None:
            return
        if system.mesh.comm.bcast(clock.worked("error") >= budget):
            log.warning("t = %g: no errors of the mesh from here on: output.error_budget is used up", self.time)
            self._stepper.companion = None

    def limit(self, load: str) -> Limit:
        """Find the largest value of a load that has an equilibrium, from the present state on; collective.

        All other values stay as they are now, and so does the script. The load grows from what it is to the largest
        value that the scene has for it, to twice that, and so on. An example: `script.limit("loads.pull.x").multiple`.

        Args:
            load: place of the value: loads.NAME.COMPONENT, or that of an obstacle's force.

        Raises:
            SceneError: the scene prescribes no such value, or it is zero at all times.
            StepError: a step could not be solved, and it is not shown that there is no equilibrium.
        """
        words = load.split(".") if isinstance(load, str) else []
        known = len(words) == 3 and words[0] in ("loads", "obstacles")
        require(known, "limit", _in_words(load), "expected loads.NAME.COMPONENT, or of an obstacle's force")
        table, name, part = words
        (place,) = self._places(self._scene, {table: {name: {part: 0.0}}})
        require(place.quantity not in ("displacement", "rotation"), load, place.quantity, "expected a force")
        end, drives = self._scene.steps.end, self._scene.drives()
        held = {key: value_at(a, self.time, end) for key, a in drives.items() if not isinstance(a, str)}
        amplitude = drives[place]
        require(place in held, load, amplitude, "expected a number or a table")
        listed = [amplitude] if isinstance(amplitude, float | int) else [value for _, value in amplitude]
        largest, now = max(listed, key=abs), held[place]
        require(largest != 0, load, largest, "a load of zero has no multiples")
        for value in (largest * 2.0**doubled for doubled in range(20)):
            if value / largest <= now / largest:  # it bears more already
                continue
            try:
                self._reached(self.time + 1, held | {place: value}, self._scene, lambda row: None)
            except NoEquilibriumError as found:
                good = found.last_good.state.time if found.last_good else self.time
                borne, beyond = (now + (value - now) * (time - self.time) for time in (good, found.time))
                return Limit(borne, beyond, borne / largest)
        return Limit(np.inf, np.inf, np.inf)

    def _reached(
        self, to: float, wanted: Mapping[Place, float], laws: Scene, on_iteration: Callable[[HistoryRow], None]
    ) -> tuple[Scene, tuple[float, ...], Stepper, Accepted]:
        """The scene with these values at the time `to` [s], times up to it, and the step there; collective."""
        scene = over(
            laws, lambda place, now: self._continued(place, now, to, wanted[place]) if place in wanted else now
        )
        times = self._times_to_hit(scene, float(to))
        stepper, state = self._stepper, self._state
        if scene.contacts != self._scene.contacts:
            stepper, state = _with_laws(stepper, scene.pairs, state)
        system = stepper.system
        with _following(scene, stepper):
            for time in times:
                system.constraints.prescribed(time)  # raises here if supports contradict each other, before any solve
            return scene, times, stepper, _reach(stepper, state, times, on_iteration)

    @property
    def scene(self) -> Scene:
        """The history so far as a scene, for `run` or `steps` to repeat.

        Every value in time is a table with a row for each time that was solved; expressions stay.

        Raises:
            SceneError: no step has been solved yet; or a law's parameter has changed: in a scene it does not.
        """
        require(not self._altered, "script", "other laws", "parameters of contacts have changed; a scene's do not")
        require(len(self._times) > 0, "script", "no step yet", "there is nothing to repeat")
        scene, end = over(self._scene, self._so_far), self._scene.steps.end
        ramps = {place: found.text for place, found in scene.expressions().items() if not found.in_time}
        ramped = {place: f"({text})*min(t/{end!r}, 1)" for place, text in ramps.items()}
        return replace(with_values(scene, ramped), steps=replace(scene.steps, end=self.time, count=1))

    def _times_to_hit(self, scene: Scene, to: float) -> tuple[float, ...]:
        """Times [s] of the scene's tables after the last step, then `to`; where the ramp of a number ends is one."""
        if to == 0:
            return (to,)
        end = scene.steps.end
        tables = over(scene, lambda _, now: ((end, now),) if isinstance(now, float | int) and now else now)
        *listed, last = replace(tables.timeline(), end=to, count=1).times
        if to > end and any(not found.in_time for found in scene.expressions().values()):
            listed = sorted({*listed, end})
        return (*(t for t in listed if t - self.time > EXACT * to or not self._times), last)

    def _of_contacts(self, given: Values) -> tuple[Scene, Values, bool]:
        """The scene with other numbers of friction laws, the values in time that are left, and whether a law changes.

        Raises:
            SceneError: there is no such contact or number, or it refuses the value.
        """
        contacts, left = dict(self._scene.contacts), dict[str, dict[str, float]]()
        changes = method_of(self._scene.solver).WORKS_WITH.fields
        altered = False
        for name, parts in _items("contacts", given, "{ name: { component: number } }"):
            if name not in contacts:
                raise SceneError(f"contacts.{name}: nothing there to change; {nearest(str(name), contacts)}")
            for part, value in _items(f"contacts.{name}", parts, "{ component: number }"):
                key, friction, gap = f"contacts.{name}.{part}", contacts[name].friction, contacts[name].gap_offset
                if changes and part in ("gap_offset", "plus"):
                    contacts[name] = replace(contacts[name], gap_offset=_from_rest(gap))
                varying = contacts[name].amplitudes().items()
                in_time = {path[-1] for path, value in varying if not isinstance(value, str)} - {"slide_speed"}
                fixed = friction is None or friction.orthotropic  # its coefficients are in the rows
                own = set() if friction is None or fixed else {f.name for f in fields(friction)} - NOT_LAWS
                numbers = {part for part in own if _is_number(getattr(friction, part))} | in_time
                numbers |= {"gap_offset"} if _is_number(gap) or isinstance(gap, str) else set()
                if part not in numbers:
                    raise SceneError(f"{key}: nothing there to change; {nearest(str(part), numbers)}")
                require(_is_number(value), key, _in_words(value), "expected a number")
                if part in in_time:
                    left.setdefault(name, {})[part] = value
                    continue
                altered = True
                with prefixed(f"contacts.{name}"):
                    if part == "gap_offset":
                        contacts[name] = replace(contacts[name], gap_offset=float(value))
                    elif friction is not None:
                        contacts[name] = replace(contacts[name], friction=replace(friction, **{part: float(value)}))
        changed = contacts != dict(self._scene.contacts)
        return replace(self._scene, contacts=contacts) if changed else self._scene, left, altered and changed

    def _so_far(self, place: Place, amplitude: Amplitude) -> tuple[tuple[float, float], ...]:
        """Time [s] and value at each time that was solved, and of contacts at rest, where they may be other than 0."""
        rest = () if place.table != "contacts" or 0.0 in self._times else (0.0,)
        return tuple((time, value_at(amplitude, time, self._scene.steps.end)) for time in (*rest, *self._times))

    def _continued(self, place: Place, amplitude: Amplitude, to: float, value: float) -> Amplitude:
        """A value in time as it was so far, then linear to `value` at the time `to` [s]."""
        if place in self._named and not isinstance(amplitude, float | int):
            held = amplitude[-1][1]
            so_far = amplitude if amplitude[-1][0] == self.time else (*amplitude, (self.time, held))
        else:
            so_far = self._so_far(place, amplitude)
        return (*(row for row in so_far if row[0] < to), (to, float(value)))

    def _places(self, scene: Scene, given: Mapping[str, Table]) -> dict[Place, float]:
        """The values given by table, by their place in the scene.

        Raises:
            SceneError: the scene does not prescribe it, or it is not a finite number.
        """
        nouns = {table: getattr(scene, table) for table in ("supports", "loads", "obstacles", "contacts")}
        nouns |= {table: of if isinstance(of, Mapping) else {"": of} for table, of in scene.sections.items()}
        found, drives = dict[Place, float](), scene.drives()
        for table, values in given.items():
            if table not in nouns:
                raise SceneError(f"{table}: nothing there to change; {nearest(table, nouns)}")
            there = nouns[table]
            named = {"": values} if "" in there else values
            for name, parts in _items(table, named, "{ name: { component: number } }"):
                owner = f"{table}.{name}" if name != "" else table
                if name not in there:
                    raise SceneError(f"{owner}: nothing there to change; {nearest(str(name), there)}")
                own = [p for p, now in drives.items() if p[:2] == (table, name)]
                own = [p for p in own if table not in NOT_ASSEMBLED or drives[p] != 0]
                if not own:
                    has = CHANGEABLE.get(table, "value in time")
                    raise SceneError(f"{owner}: has no {has} that a script can change; the scene must name one")
                words = Counter(_shortest(place) for place in own)
                known: dict[tuple[str, ...], Place] = {(place.quantity, place.component): place for place in own}
                known |= {(_shortest(place),): place for place in own if words[_shortest(place)] == 1}
                said = [_shortest(p) if words[_shortest(p)] == 1 else f"{p.quantity}.{p.component}" for p in own]
                only = f"the scene prescribes only {', '.join(said)}, nothing else can be changed"
                for path, value in _paths(owner, parts):
                    key = ".".join(map(str, (owner, *path)))
                    require(path in known, key, _in_words(value), only)
                    require(_is_number(value), key, _in_words(value), "expected a number")
                    found[known[path]] = float(value)
        return found


@contextmanager
def _following(scene: Scene, stepper: Stepper) -> Iterator[None]:
    """Context that uses the values in time of a scene, and for its neighbours theirs."""
    with ExitStack() as held:
        for course, timeline in timelines(scene, stepper):
            held.enter_context(course.following(timeline))
        yield


def _with_laws(stepper: Stepper, contacts: Mapping[str, Contact], state: State) -> tuple[Stepper, State]:
    """A stepper of the same bodies with other parameters of contact laws and other gap offsets, and a state for it.

    Args:
        contacts: by name, those that change; the kinds of their laws stay.
        state: to go on from. Its rows stay those of its own pairs: sliding contacts were searched since.
    """
    system, problem = stepper.system, stepper.system.problem

    def changed(rows: tuple[ContactRows, ...]) -> tuple[ContactRows, ...]:
        found = []
        for c in rows:
            contact = contacts.get(c.name, problem.pairs[c.name].contact)
            assert c.fields is not None
            law, slide = contact.law(c.surface.axisymmetric)
            fields = replace(c.fields, gap_offset=contact.gap_offset, law=law, slide=slide)
            found.append(c.with_fields(fields, c.time))
        return tuple(found)

    pairs = {name: replace(pair, contact=contacts.get(name, pair.contact)) for name, pair in problem.pairs.items()}
    own = changed(system.contacts)
    other = Stepper(replace(system, problem=replace(problem, pairs=pairs), contacts=own), stepper.chain)
    if other.volume is stepper.volume:
        other.surface.adopt(stepper.surface)
    other.companion = stepper.companion
    if state.neighbours:
        log.warning("t = %g: derivatives are not known from here on: laws are changed", state.time)
    rows = own if state.rows is system.contacts else changed(state.rows)
    return other, replace(state, neighbours=(), rows=rows, refined=state.refined and replace(state.refined, rows=rows))


def _reach(
    stepper: Stepper, start: State, times: tuple[float, ...], on_iteration: Callable[[HistoryRow], None]
) -> Accepted:
    """Solve up to each of the times [s]; all together count as one step."""
    state, parts = start, list[Accepted]()
    for time in times:
        parts.append(stepper.reach(state, time, on_iteration))
        state = parts[-1].state
    return replace(
        parts[-1],
        start=start,
        substeps=sum(part.substeps for part in parts),
        iterations=sum(part.iterations for part in parts),
        volume_solves=sum(part.volume_solves for part in parts),
        history=tuple(row for part in parts for row in part.history),
    )


def _from_rest(gap: Field) -> Field:
    """A gap offset as a value in time, where it is a number at all times; an expression stays."""
    if isinstance(gap, HeightMap):
        return replace(gap, plus=((0.0, gap.plus),)) if isinstance(gap.plus, float | int) else gap
    return ((0.0, gap),) if isinstance(gap, float | int) else gap


def _shortest(place: Place) -> str:
    """The word by which a step names a place, if it is the only one."""
    return place.component or place.quantity


def _paths(key: str, parts: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Values by component, or by key and component."""
    for part, value in _items(key, parts, "{ component: number }"):
        deeper = value.items() if isinstance(value, Mapping) else ()
        yield from (((part, axis), number) for axis, number in deeper) if deeper else [((part,), value)]


def _is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a finite number; True and False are none."""
    real = isinstance(value, Real) and not isinstance(value, bool)
    return real and bool(abs(value) <= sys.float_info.max)  # type: ignore[arg-type]


def _items(key: str, values: Any, expected: str) -> Any:
    """Items of a mapping; anything else is refused."""
    require(isinstance(values, Mapping), key, _in_words(values), f"expected {expected}")
    return values.items()


def _in_words(value: object) -> str:
    """Any value as one short line."""
    return " ".join(shortly(value).split())
