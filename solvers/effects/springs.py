"""Springs between two places, or a place and the ground, and springs per area: they hold bodies as supports do.

One that acts in one way is a linear spring, and has a slack that each step finds, see `Tightening`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError, require, require_components
from stickslip.geometry.keys import LIST, Key, Vector
from stickslip.geometry.obstacles.obstacle import unit
from stickslip.geometry.protocols import UflExpr, UflForm
from stickslip.solvers.effects.effect import Effect, Equilibrium, named
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.scene.loads import End, Link, Springs
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.record import Number, Reaction
from stickslip.solvers.scene.scene import EffectTable, Scene
from stickslip.solvers.scene.timeline import Place


class SpringForce(NamedTuple):
    """Force of a spring between places on the body at its end `at`."""

    force: Annotated[Array, Number("N", "by component", "vector", "force")]


@dataclass(frozen=True, kw_only=True)
class Spring(EffectTable):
    """Pulls with stiffness times elongation: at a point, or on the mean displacement of a side."""

    reports = SpringForce

    at: Annotated[End, Key("m", "side, as body.side, or a point, at which a mesh vertex lies")]
    to: Annotated[End | None, Key("m", "the other end, likewise; absent: the ground")] = None
    stiffness: Annotated[
        float | Vector, Key("N/m", "along direction, or by component; plane: per metre; of the full circle")
    ]
    direction: Annotated[Vector | None, Key("-", "of a single stiffness, of any length")] = None
    displacement: Annotated[
        tuple[Amplitude, ...] | None, Key("m", "motion of the ground, by component, in time"), LIST
    ] = None
    gap: Annotated[float, Key("m", "of a spring that acts in one way: way of `at` until it acts")] = 0.0
    acts: Annotated[
        Literal["both", "tension", "compression"],
        Key("-", "in one way only: tension once `at` has moved along direction, away from the other end"),
    ] = "both"

    def __post_init__(self) -> None:
        if self.acts != "both" and self.direction is None:
            raise SceneError(
                "direction: missing, a spring that acts in one way needs it, from its other end towards `at`"
            )
        require(self.gap >= 0, "gap", self.gap, "must not be negative, in metres")
        require(self.gap == 0 or self.acts != "both", "gap", self.gap, 'belongs to acts = "tension" or "compression"')
        single = isinstance(self.stiffness, float | int)
        if single != (self.direction is not None):
            raise SceneError(
                "direction: missing, a single stiffness needs it"
                if single
                else f"direction = {list(self.direction or ())}: a stiffness by component has none; remove the key"
            )
        require(self.direction is None or any(self.direction), "direction", self.direction, "must not be zero")
        values = np.atleast_1d(self.stiffness)
        wrong = "must not be negative, and one be positive, in N/m"
        require(bool(np.all(values >= 0) and values.any()), "stiffness", self.stiffness, wrong)
        require(self.at != self.to, "to", self.to, "a spring has two different ends")
        for amplitude in self.displacement or ():
            check(amplitude, "displacement")
        require(self.displacement is None or self.to is None, "displacement", "given", "moves the ground; remove `to`")

    def amplitudes(self) -> Mapping[tuple[str, str], Amplitude]:
        return {("displacement", axis): a for axis, a in zip("xyz", self.displacement or (), strict=False)}

    def check(self, scene: Scene, key: str) -> None:
        vectors = {"direction": self.direction, "displacement": self.displacement}
        vectors |= {"stiffness": None if isinstance(self.stiffness, float | int) else self.stiffness}
        for name, end in (("at", self.at), ("to", self.to)):
            if isinstance(end, str):
                scene.require_side(end, f"{key}.{name}")
            elif end is not None:
                vectors[name] = end
                require(
                    not scene.axisymmetric, f"{key}.{name}", list(end), "an axisymmetric model has rings; use a side"
                )
        for name, vector in vectors.items():
            require_components(vector, f"{key}.{name}", scene.dim)
        if scene.axisymmetric:
            along = self.direction or self.stiffness
            radial = not isinstance(along, float | int) and along[0] != 0
            require(not radial, key, "radial", "springs of an axisymmetric model act along the axis y")

    def links(self, key: str) -> tuple[Link, ...]:
        k = np.atleast_1d(np.array(self.stiffness, float))
        along = np.eye(len(k)) if self.direction is None else unit(self.direction)[None]
        table, _, name = key.partition(".")
        moved = {Place(table, name, *part): along[k > 0, i] for i, part in enumerate(self.amplitudes())}
        ends: dict[str, tuple[End, float]] = {f"{key}.at": (self.at, 1.0)}
        if self.to is not None:
            ends[f"{key}.to"] = self.to, -1.0
        slack = Place(table, name, "slack") if self.acts != "both" else None
        if slack is not None:  # a positive one keeps the spring from acting
            moved[slack] = np.array([-1.0 if self.acts == "tension" else 1.0])
        return (
            Link(
                ends=ends,
                directions=along[k > 0],
                stiffness=k[k > 0],
                rests=moved,
                slack=slack,
                gap=self.gap,
                table=table,
                name=name,
            ),
        )


class _Springs(Effect):
    name = "springs"
    table = Mapping[str, Spring]

    def adds(self, scene: Scene) -> str:
        links = [link for link in scene.links() if link.table == self.name]
        rows, found = sum(len(link.stiffness) for link in links), sum(link.slack is not None for link in links)
        said = f"{rows} spring{'s' * (rows > 1)} in the stiffness, which couple all nodes of a side with each other"
        return said + f"; {found} of one way: a step in which slack changes is solved again" * bool(found)

    def read(self, reached: Equilibrium) -> Mapping[str, SpringForce]:
        return {name: SpringForce(force) for name, force in named(self.name, reached.links).items()}


@dataclass(frozen=True, kw_only=True)
class ElasticSupport(EffectTable):
    """Springs per area under a side, along its normal and across; their stress is stiffness times displacement."""

    reports = Reaction

    boundary: Annotated[str, Key("-", "side, as body.side")]
    normal: Annotated[float, Key("Pa/m", "stiffness along the side's normal, in both directions")] = 0.0
    tangential: Annotated[float, Key("Pa/m", "stiffness along the side")] = 0.0

    def __post_init__(self) -> None:
        for key in ("normal", "tangential"):
            require(getattr(self, key) >= 0, key, getattr(self, key), "must not be negative, in Pa/m")
        require(
            self.normal + self.tangential > 0, "normal", self.normal, "springs need a stiffness; tangential is 0 too"
        )

    def check(self, scene: Scene, key: str) -> None:
        scene.require_side(self.boundary, f"{key}.boundary")

    def springs(self, key: str) -> tuple[Springs, ...]:
        return (Springs(boundary=self.boundary, normal=self.normal, tangential=self.tangential, key=key),)


class _ElasticSupport(Effect):
    name = "elastic_support"
    table = Mapping[str, ElasticSupport]

    def stiffness(self, problem: Problem, weak: WeakForms, u: UflExpr) -> Iterable[UflForm]:
        return [weak.springs(springs, u) for springs in problem.springs if springs.key.split(".")[0] == self.name]

    def read(self, reached: Equilibrium) -> Mapping[str, Reaction]:
        return {name: Reaction(*pair) for name, pair in named(self.name, reached.reactions).items()}


EFFECTS = (_Springs(), _ElasticSupport())
