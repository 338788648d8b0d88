"""Periodic sides: the displacement of one side is that of the other; its dofs are eliminated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from geometry.errors import require
from geometry.keys import Key, Noun
from solvers.effects.effect import Effect

if TYPE_CHECKING:
    from solvers.scene.scene import Scene


@dataclass(frozen=True, kw_only=True)
class Periodic(Noun):
    """Matching meshes."""

    boundary: Annotated[str, Key("-", "side whose dofs are eliminated")]
    with_: Annotated[str, Key("-", "opposite side; the key is `with`")]

    __pydantic_config__: ClassVar[dict[str, Any]] = {
        "extra": "forbid",
        "alias_generator": lambda name: name.rstrip("_"),
    }

    def __post_init__(self) -> None:
        require(self.boundary != self.with_, "with", self.with_, "a side cannot be periodic with itself")


def because(scene: Scene) -> str | None:
    return ", ".join(f"periodic.{name}" for name in scene.sections.get("periodic", {})) or None


def check_section(scene: Scene) -> None:
    for name, pair in scene.sections["periodic"].items():
        scene.require_side(pair.boundary, f"periodic.{name}.boundary")
        scene.require_side(pair.with_, f"periodic.{name}.with")


def pairs(scene: Scene) -> Iterable[tuple[str, str]]:
    return [(pair.boundary, pair.with_) for pair in scene.sections["periodic"].values()]


EFFECT = Effect(name="periodic", because=because, section=Mapping[str, Periodic], check=check_section, periodic=pairs)
