"""Gravity: body force density times acceleration, ramped like every other load."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from geometry.amplitude import Amplitude, check
from geometry.errors import SceneError, require
from geometry.keys import Key, Noun
from solvers.effects.effect import Effect

if TYPE_CHECKING:
    from solvers.fem.forms import LoadForm, WeakForms
    from solvers.scene.course import Drive
    from solvers.scene.scene import Scene


@dataclass(frozen=True, kw_only=True)
class Gravity(Noun):
    """Acceleration of the whole scene."""

    acceleration: Annotated[tuple[Amplitude, ...], Key("m/s²", "by component, in time")]

    def __post_init__(self) -> None:
        for amplitude in self.acceleration:
            check(amplitude, "acceleration")


def because(scene: Scene) -> str | None:
    return "gravity" if "gravity" in scene.sections else None


def check_section(scene: Scene) -> None:
    found = list(scene.sections["gravity"].acceleration)
    require(len(found) == scene.dim, "gravity.acceleration", found, f"expected {scene.dim} components in this model")
    radial = scene.axisymmetric and found[0] != 0
    require(not radial, "gravity.acceleration", found, "an axisymmetric body has gravity along the axis y alone")
    if not any(material.density for material in scene.bodies.values()):
        raise SceneError("gravity: no body has a density; set bodies.NAME.density, in kg/m³")


def _drive(axis: int) -> Drive:
    return lambda scene: scene.sections["gravity"].acceleration[axis]


def loads(scene: Scene, weak: WeakForms) -> Iterable[LoadForm]:
    for body, material in scene.bodies.items():
        for axis in range(scene.dim):
            if material.density:
                yield _drive(axis), weak.constant(material.density) * weak.v[axis] * weak.volume(body)


EFFECT = Effect(name="gravity", because=because, section=Gravity, check=check_section, loads=loads)
