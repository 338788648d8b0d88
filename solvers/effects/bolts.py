"""Bolts, which are shortened and then clamp: drawn ones, or springs between two sides, as a head's face and a nut's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check
from stickslip.geometry.arrays import EXACT
from stickslip.geometry.errors import SceneError, require, require_components, require_known
from stickslip.geometry.keys import Key, Vector
from stickslip.geometry.obstacles.obstacle import unit
from stickslip.solvers.effects.effect import Effect, Equilibrium
from stickslip.solvers.fem.terms import InitialStrain
from stickslip.solvers.scene.loads import Link
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.record import Number
from stickslip.solvers.scene.scene import EffectTable, Scene
from stickslip.solvers.scene.timeline import Place

SOLID = ("body", "shank")
SPRING = ("head", "nut", "axis", "stiffness")


class BoltState(NamedTuple):
    """A bolt."""

    tension: Annotated[float, Number("N", "positive where it clamps", words="tension")]
    shortening: Annotated[float, Number("m", "of its shank", column=False, error=False)]


@dataclass(frozen=True, kw_only=True)
class Bolt(EffectTable):
    """A body whose shank is shortened between two planes, or a spring between two sides.

    The tension of a spring is stiffness times (their mean distance along the axis + shortening).
    """

    reports = BoltState

    body: Annotated[str | None, Key("-", "that is a bolt; its tension is the mean one of the shank")] = None
    shank: Annotated[
        tuple[Vector, Vector] | None,
        Key("m", "two points on its axis: between the planes across it through them the shank is shortened"),
    ] = None
    head: Annotated[str | None, Key("-", "of a spring: side under the head; the tension is spread evenly over it")] = (
        None
    )
    nut: Annotated[str | None, Key("-", "side under the nut, likewise")] = None
    axis: Annotated[Vector | None, Key("-", "direction from nut to head, of any length")] = None
    stiffness: Annotated[float | None, Key("N/m", "E A / L of the shank; plane: per metre; of the full circle")] = None
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
        wanted, other = (SOLID, SPRING) if self.body is not None else (SPRING, SOLID)
        for key in other:
            of = "a spring" if self.body is not None else "a body"
            require(getattr(self, key) is None, key, getattr(self, key), f"belongs to a bolt that is {of}; remove it")
        for key in wanted:
            require(getattr(self, key) is not None, key, "missing", f"a bolt has {' and '.join(wanted)}")
        if self.shank is not None:
            require(self.shank[0] != self.shank[1], "shank", list(self.shank[0]), "two different points are needed")
            return
        require(any(self.axis or ()), "axis", list(self.axis or ()), "must not be zero")
        require((self.stiffness or 0.0) > 0, "stiffness", self.stiffness, "must be positive, in N/m")
        require(self.head != self.nut, "nut", self.nut, "a bolt has two different ends")

    def amplitudes(self) -> Mapping[tuple[str, str], Amplitude]:
        values = {"shortening": self.shortening, "force": self.force}
        return {(key, ""): value for key, value in values.items() if value is not None}

    def check(self, scene: Scene, key: str) -> None:
        axis = self.axis or ()
        if self.shank is not None:
            require_known(f"{key}.body", str(self.body), scene.bodies)
            for point in self.shank:
                require_components(point, f"{key}.shank", scene.dim)
            axis = tuple(b - a for a, b in zip(*self.shank, strict=True))
        else:
            scene.require_side(str(self.head), f"{key}.head")
            scene.require_side(str(self.nut), f"{key}.nut")
            require_components(axis, f"{key}.axis", scene.dim)
        times = [t for t in scene.requested_times() if self.held_from is None or abs(t - self.held_from) < EXACT * t]
        require(len(times) > 0, f"{key}.held_from", self.held_from, "no step ends there; list that time in force")
        radial = scene.axisymmetric and axis[0] != 0
        where = f"{key}.axis" if self.shank is None else f"{key}.shank"
        require(not radial, where, list(axis), "an axisymmetric model has bolts along its axis y")

    def links(self, key: str) -> tuple[Link, ...]:
        table, _, name = key.partition(".")
        if self.head is None or self.nut is None or self.axis is None or self.stiffness is None:
            return ()
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
        bolts: Mapping[str, Bolt] = scene.sections[self.name]  # type: ignore[assignment]
        springs = sum(bolt.shank is None for bolt in bolts.values())
        drawn = len(bolts) - springs
        found = sum(bolt.force is not None for bolt in bolts.values())
        words = [f"{springs} spring{'s' * (springs > 1)} in the stiffness"] * bool(springs)
        words += [f"{drawn} shank{'s' * (drawn > 1)} shortened: a load"] * bool(drawn)
        words += [f"{found} tightened by force: such a step is solved twice and more often"] * bool(found)
        return "; ".join(words)

    def initial_strains(self, problem: Problem) -> Iterable[InitialStrain]:
        for name, bolt in problem.tables["bolts"].items():
            if bolt.shank is None:
                continue
            if bolt.body in problem.averaged:
                raise SceneError(f"bolts.{name}.body = {bolt.body}: nearly incompressible; a bolt is not")
            start, end = (np.array(point, float) for point in bolt.shank)
            yield InitialStrain(
                drive=Place("bolts", name, "shortening"),
                body=bolt.body,
                strain=np.zeros((3, 3)),
                shrunk=(start, end),
                tension=None if bolt.force is None else Place("bolts", name, "force"),
                held_from=np.inf if bolt.held_from is None else bolt.held_from,
            )

    def read(self, reached: Equilibrium) -> Mapping[str, BoltState]:
        own = ((place, found) for place, found in reached.strains.items() if place.table == self.name)
        return {place.name: BoltState(-work, value) for place, (value, work) in own}


EFFECT = _Bolts()
