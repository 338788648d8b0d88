"""Bolts: a spring between two sides, such as a head's face and a nut's, that is shortened and then clamps them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import Key
from stickslip.geometry.obstacles.rotation import unit
from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.scene.loads import Link
from stickslip.solvers.scene.scene import EffectTable, Scene
from stickslip.solvers.scene.timeline import CLOSE, Place


@dataclass(frozen=True, kw_only=True)
class Bolt(EffectTable):
    """Clamps two sides: its tension is stiffness times (their mean distance along the axis + shortening)."""

    head: Annotated[str, Key("-", "side under the head, as body.side; the tension is spread evenly over it")]
    nut: Annotated[str, Key("-", "side under the nut, likewise")]
    axis: Annotated[tuple[float, ...], Key("-", "direction from nut to head, of any length")]
    stiffness: Annotated[float, Key("N/m", "E A / L of the shank; plane: per metre; of the full circle")]
    shortening: Annotated[Amplitude | None, Key("m", "in time: [[1.0, 1e-5]] tightens until 1 s, then holds")] = None
    force: Annotated[Amplitude | None, Key("N", "tension, in time, instead of shortening, which is then found")] = None
    held_from: Annotated[
        float | None, Key("s", "end of the tightening by force: from there on the shortening is kept")
    ] = None

    def __post_init__(self) -> None:
        given = [key for key in ("shortening", "force") if getattr(self, key) is not None]
        if len(given) != 1:
            raise SceneError(f"{' / '.join(given) or 'shortening / force'}: exactly one of the two is needed")
        check(getattr(self, given[0]), given[0])
        require(self.held_from is None or self.force is not None, "held_from", self.held_from, "belongs to force")
        require(any(self.axis), "axis", list(self.axis), "must not be zero")
        require(self.stiffness > 0, "stiffness", self.stiffness, "must be positive, in N/m")
        require(self.head != self.nut, "nut", self.nut, "a bolt has two different ends")

    def amplitudes(self) -> Mapping[tuple[str, str], Amplitude]:
        values = {"shortening": self.shortening, "force": self.force}
        return {(key, ""): value for key, value in values.items() if value is not None}

    def check(self, scene: Scene, key: str) -> None:
        for name in ("head", "nut"):
            scene.require_side(getattr(self, name), f"{key}.{name}")
        expected = f"expected {scene.dim} components in this model"
        require(len(self.axis) == scene.dim, f"{key}.axis", list(self.axis), expected)
        times = [t for t in scene.requested_times() if self.held_from is None or abs(t - self.held_from) < CLOSE * t]
        require(len(times) > 0, f"{key}.held_from", self.held_from, "no step ends there; list that time in force")
        radial = scene.axisymmetric and self.axis[0] != 0
        require(not radial, f"{key}.axis", list(self.axis), "an axisymmetric model has bolts along its axis y")

    def links(self, key: str) -> tuple[Link, ...]:
        table, _, name = key.partition(".")
        return (
            Link(
                ends={f"{key}.head": (self.head, 1.0), f"{key}.nut": (self.nut, -1.0)},
                directions=unit(self.axis)[None],
                stiffness=np.array([self.stiffness]),
                rests={Place(table, name, "shortening"): np.array([-1.0])},
                tension=None if self.force is None else Place(table, name, "force"),
                held_from=np.inf if self.held_from is None else self.held_from,
                table=table,
                name=name,
            ),
        )


class _Bolts(Effect):
    name = "bolts"
    table = Mapping[str, Bolt]

    def adds(self, scene: Scene) -> str:
        bolts = [link for link in scene.links() if link.table == self.name]
        found = sum(link.tension is not None for link in bolts)
        more = f"; {found} tightened by force: such a step is solved twice and more often" if found else ""
        return f"{len(bolts)} spring{'s' * (len(bolts) > 1)} in the stiffness{more}"


EFFECT = _Bolts()
