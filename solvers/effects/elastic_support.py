"""Elastic support: linear springs per area between a side and the ground; they hold bodies as supports do."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated

from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import UflExpr, UflForm
from stickslip.solvers.effects.effect import Effect, Equilibrium, named
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.scene.loads import Springs
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.record import Reaction
from stickslip.solvers.scene.scene import EffectTable, Scene


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


EFFECT = _ElasticSupport()
