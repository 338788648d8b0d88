"""Periodic sides: two sides have the same displacement; the dofs of one of them are eliminated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.scene.scene import EffectTable, Scene


@dataclass(frozen=True, kw_only=True)
class Periodic(EffectTable):
    """Two sides with the same displacement; their meshes match."""

    boundary: Annotated[str, Key("-", "side whose dofs are eliminated")]
    with_: Annotated[str, Key("-", "opposite side; the key is `with`")]

    __pydantic_config__: ClassVar[dict[str, Any]] = {
        **EffectTable.__pydantic_config__,
        "alias_generator": lambda name: name.rstrip("_"),
    }

    def __post_init__(self) -> None:
        require(self.boundary != self.with_, "with", self.with_, "a side cannot be periodic with itself")

    def check(self, scene: Scene, key: str) -> None:
        scene.require_side(self.boundary, f"{key}.boundary")
        scene.require_side(self.with_, f"{key}.with")

    def periodic_pairs(self) -> tuple[tuple[str, str], ...]:
        return ((self.boundary, self.with_),)


class _Periodic(Effect):
    name = "periodic"
    table = Mapping[str, Periodic]

    def adds(self, scene: Scene) -> str:
        return "no unknowns on the one side, which follows the other"


EFFECT = _Periodic()
