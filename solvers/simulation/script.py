"""A history that is made up on the way: each step is told where supports, loads and obstacles go."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from numbers import Real
from reprlib import repr as shortly
from typing import Any, TypeGuard

from geometry.amplitude import Amplitude, value_at
from geometry.errors import SceneError, nearest, require
from solvers.results.observe import Observer
from solvers.results.step_result import StepResult
from solvers.scene.scene import Scene, over
from solvers.scene.settings import Steps
from solvers.scene.timeline import Place
from solvers.stepping.history import HistoryRow
from solvers.stepping.stepper import ROUNDING, Accepted, Stepper

Values = Mapping[str, Mapping[str, float]]  # by name and component
NOTHING: Values = {}
CHANGEABLE = {
    "supports": "displacement",
    "loads": "traction, force or pressure, other than a bare 0,",
    "obstacles": "displacement, force or rotation",
}


class Script:
    """Begins at rest at t = 0. The bodies stay prepared; memory and energy go on from step to step.

    What no step has named goes as the scene says; what one has named stays there until it is named again.
    """

    def __init__(self, scene: Scene, stepper: Stepper, observer: Observer) -> None:
        self._stepper, self._observer = stepper, observer
        self._scene, self._named = scene, frozenset[Place]()
        self._state = stepper.start()
        self._times: tuple[float, ...] = ()

    @property
    def time(self) -> float:
        """Of the last step [s]."""
        return self._state.time

    def step(
        self,
        *,
        to: float,
        supports: Values = NOTHING,
        loads: Values = NOTHING,
        obstacles: Values = NOTHING,
        on_iteration: Callable[[HistoryRow], None] = lambda row: None,
    ) -> StepResult:
        """Go on to a time [s], while the values named go to those given, linearly; collective.

        Times on the way that the scene lists for what is not named are hit; the result is of all the way to `to`.

        Args:
            supports: x, y, z or normal of supports by name: displacement [m].
            loads: x, y, z of loads by name: traction [Pa] or force [N], as the scene has it; or pressure [Pa].
            obstacles: x, y, z of obstacles by name: displacement [m] or force [N], as the scene has it; or angle [rad].

        Raises:
            SceneError: the scene prescribes no such component; what was free when the bodies were prepared stays free.
            StepError: the step could not be solved. All is as it was before: a script may try another one.
        """
        require(_is_number(to), "to", _in_words(to), "expected a number")
        begins = not self._times and to == 0
        require(to > self.time or begins, "to", to, f"expected a time after {self.time:g}")
        wanted = self._places(supports=supports, loads=loads, obstacles=obstacles)
        scene = over(
            self._scene, lambda place, now: self._on(place, now, to, wanted[place]) if place in wanted else now
        )
        times = self._on_the_way(scene, float(to))
        system = self._stepper.system
        with system.course.following(scene.timeline()):
            for time in times:
                system.constraints.prescribed(time)  # supports that contradict each other show before any solve
            accepted = self._reach(times, on_iteration)
            result = self._observer(accepted)
        self._scene, self._named = scene, self._named | wanted.keys()
        self._state, self._times = accepted.state, (*self._times, *times)
        return result

    @property
    def scene(self) -> Scene:
        """What has happened so far, for `run` or `steps` to repeat."""
        require(len(self._times) > 0, "script", "no step yet", "there is nothing to repeat")
        return replace(over(self._scene, lambda place, now: self._so_far(now)), steps=Steps(end=self.time))

    def _on_the_way(self, scene: Scene, to: float) -> tuple[float, ...]:
        """Times to hit up to `to`; where the ramp of a bare number ends counts as listed."""
        if to == 0:
            return (to,)
        end = scene.steps.end
        tables = over(scene, lambda _, now: ((end, now),) if isinstance(now, float | int) and now else now)
        *listed, last = replace(tables, steps=Steps(end=to)).requested_times()
        return (*(t for t in listed if t - self.time > ROUNDING * to or not self._times), last)

    def _reach(self, times: tuple[float, ...], on_iteration: Callable[[HistoryRow], None]) -> Accepted:
        """One time after the other, as one step."""
        state, parts = self._state, list[Accepted]()
        for time in times:
            parts.append(self._stepper.reach(state, time, on_iteration))
            state = parts[-1].state
        return replace(
            parts[-1],
            before=self._state,
            substeps=sum(part.substeps for part in parts),
            iterations=sum(part.iterations for part in parts),
            volume_solves=sum(part.volume_solves for part in parts),
            history=tuple(row for part in parts for row in part.history),
        )

    def _so_far(self, amplitude: Amplitude) -> tuple[tuple[float, float], ...]:
        return tuple((time, value_at(amplitude, time, self._scene.steps.end)) for time in self._times)

    def _on(self, place: Place, amplitude: Amplitude, to: float, value: float) -> Amplitude:
        """What it was so far, and from now on to the value."""
        if place in self._named and not isinstance(amplitude, float | int):
            held = amplitude[-1][1]
            so_far = amplitude if amplitude[-1][0] == self.time else (*amplitude, (self.time, held))
        else:
            so_far = self._so_far(amplitude)
        return (*so_far, (to, float(value)))

    def _places(self, **given: Values) -> dict[Place, float]:
        """Values by their place in the scene; refuses what the scene does not prescribe, and what is no number."""
        known: dict[tuple[str, str], dict[str, Place]] = {}
        for place, amplitude in self._scene.drives().items():
            if place.table != "loads" or amplitude != 0:  # a load that is plainly 0 was not prepared
                of_name = known.setdefault((place.table, place.name), {})
                of_name[place.component or place.quantity] = place
        found: dict[Place, float] = {}
        for table, values in given.items():
            for name, parts in _items(table, values, "{ name: { component: number } }"):
                there = getattr(self._scene, table)
                if name not in there:
                    raise SceneError(f"{table}.{name}: nothing there to change; {nearest(str(name), there)}")
                if (table, name) not in known:
                    raise SceneError(
                        f"{table}.{name}: has no {CHANGEABLE[table]} that a script can change; the scene must name one"
                    )
                for part, value in _items(f"{table}.{name}", parts, "{ component: number }"):
                    key = f"{table}.{name}.{part}"
                    only = f"the scene prescribes only {', '.join(known[table, name])}, nothing else can be changed"
                    require(part in known[table, name], key, _in_words(value), only)
                    require(_is_number(value), key, _in_words(value), "expected a number")
                    found[known[table, name][part]] = float(value)
        return found


def _is_number(value: Any) -> TypeGuard[float]:
    """A finite one; Python counts True as 1."""
    real = isinstance(value, Real) and not isinstance(value, bool)
    return real and bool(abs(value) <= sys.float_info.max)


def _items(key: str, values: Any, expected: str) -> Any:
    require(isinstance(values, Mapping), key, _in_words(values), f"expected {expected}")
    return values.items()


def _in_words(value: Any) -> str:
    """Whatever it is, in one short line."""
    return " ".join(shortly(value).split())
