"""Spring plungers: spring-loaded stops that push a side with a preload plus stiffness times travel, and never pull.

A plunger is a linear spring that is shortened by preload / stiffness, and acts in one way, see `BoltsAndSprings`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check
from stickslip.geometry.errors import require, require_components
from stickslip.geometry.keys import Key, Vector
from stickslip.geometry.obstacles.obstacle import unit
from stickslip.solvers.effects.effect import Effect, Equilibrium, named
from stickslip.solvers.scene.loads import Link
from stickslip.solvers.scene.record import Number, Seen
from stickslip.solvers.scene.scene import EffectTable, Scene
from stickslip.solvers.scene.timeline import Place


def _push(seen: Seen) -> float:
    return float(np.linalg.norm(seen.forces.sum(axis=0)))


class PlungerState(NamedTuple):
    """A spring plunger."""

    force: Annotated[
        float, Number("N", "push on its side along the direction, never negative", words="push", again=_push)
    ]


@dataclass(frozen=True, kw_only=True)
class Plunger(EffectTable):
    """A spring-loaded stop: it pushes the mean displacement of a side away from the ground, and lets go of it.

    Its force is preload - stiffness times displacement along the direction, zero where that is negative.
    """

    reports = PlungerState

    boundary: Annotated[str, Key("-", "side, as body.side; the push is spread evenly over it")]
    direction: Annotated[Vector, Key("-", "in which it pushes the body, of any length")]
    stiffness: Annotated[float, Key("N/m", "plane: per metre; of the full circle")]
    preload: Annotated[
        Amplitude, Key("N", "push where the side lies undeformed, in time; negative: a gap of -preload / stiffness")
    ]

    def __post_init__(self) -> None:
        check(self.preload, "preload")
        require(self.stiffness > 0, "stiffness", self.stiffness, "must be positive, in N/m")
        require(any(self.direction), "direction", list(self.direction), "must not be zero")

    def amplitudes(self) -> Mapping[tuple[str, str], Amplitude]:
        return {("preload", ""): self.preload}

    def check(self, scene: Scene, key: str) -> None:
        found = list(self.direction)
        scene.require_side(self.boundary, f"{key}.boundary")
        require_components(found, f"{key}.direction", scene.dim)
        radial = scene.axisymmetric and found[0] != 0
        require(not radial, f"{key}.direction", found, "an axisymmetric model has plungers along its axis y")

    def links(self, key: str) -> tuple[Link, ...]:
        table, _, name = key.partition(".")
        slack = Place(table, name, "slack")
        return (
            Link(
                ends={f"{key}.boundary": (self.boundary, 1.0)},
                directions=unit(self.direction)[None],
                stiffness=np.array([self.stiffness]),
                rests={Place(table, name, "preload"): np.array([1 / self.stiffness]), slack: np.array([1.0])},
                slack=slack,
                table=table,
                name=name,
            ),
        )


class _Plungers(Effect):
    name = "plungers"
    table = Mapping[str, Plunger]
    example: ClassVar[Mapping[str, Any]] = {
        "plungers": {"stop": {"boundary": "block.left", "direction": [1.0, 0.0], "stiffness": 100.0, "preload": 0.5}}
    }

    def adds(self, scene: Scene) -> str:
        count = len(scene.sections[self.name])  # type: ignore[arg-type]
        return f"{count} spring{'s' * (count > 1)} of one way: a step in which slack changes is solved again"

    def read(self, reached: Equilibrium) -> Mapping[str, PlungerState]:
        tables = reached.problem.tables[self.name]
        return {
            name: PlungerState(float(force @ unit(tables[name].direction)))
            for name, force in named(self.name, reached.links).items()
        }


EFFECT = _Plungers()
