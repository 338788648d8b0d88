"""A history that is made up on the way: each step is told where supports, loads and obstacles go."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from numbers import Real

from geometry.amplitude import Amplitude, value_at
from geometry.errors import SceneError, nearest, require
from solvers.drives import over
from solvers.history import HistoryRow
from solvers.nouns.place import Place
from solvers.nouns.scene import Scene
from solvers.nouns.stepping import Steps
from solvers.observe import Observer
from solvers.step_result import StepResult
from solvers.stepping import Stepper

Values = Mapping[str, Mapping[str, float]]  # by name and component
NOTHING: Values = {}


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

        Args:
            supports: x, y, z or normal of supports by name: displacement [m].
            loads: x, y, z of loads by name: traction [Pa] or force [N], as the scene has it; or pressure [Pa].
            obstacles: x, y, z of obstacles by name: displacement [m] or force [N], as the scene has it; or angle [rad].

        Raises:
            SceneError: the scene prescribes no such component; what was free when the bodies were prepared stays free.
            StepError: the step could not be solved. All is as it was before: a script may try another one.
        """
        begins = not self._times and to == 0
        require(math.isfinite(to) and (to > self.time or begins), "to", to, f"expected a time after {self.time:g}")
        wanted = self._places(supports=supports, loads=loads, obstacles=obstacles)
        scene = over(
            self._scene, lambda place, now: self._on(place, now, to, wanted[place]) if place in wanted else now
        )
        system = self._stepper.system
        with system.course.following(scene):
            system.constraints.prescribed(to)  # supports that contradict each other show before any solve
            accepted = self._stepper.reach(self._state, to, on_iteration)
            result = self._observer(accepted)
        self._scene, self._named = scene, self._named | wanted.keys()
        self._state, self._times = accepted.state, (*self._times, to)
        return result

    @property
    def scene(self) -> Scene:
        """What has happened so far, for `run` or `steps` to repeat."""
        require(len(self._times) > 0, "script", "no step yet", "there is nothing to repeat")
        return replace(over(self._scene, lambda place, now: self._so_far(now)), steps=Steps(end=self.time))

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
            for name, parts in values.items():
                there = [n for t, n in known if t == table]
                if name not in there:
                    raise SceneError(f"{table}.{name}: nothing there that a script can change; {nearest(name, there)}")
                for part, value in parts.items():
                    if part not in known[table, name]:
                        free = f"the scene prescribes only {', '.join(known[table, name])}, the rest is free"
                        raise SceneError(f"{table}.{name}.{part} = {value}: {free}")
                    number = isinstance(value, Real) and math.isfinite(value)
                    require(number, f"{table}.{name}.{part}", value, "expected a number")
                    found[known[table, name][part]] = value
        return found
