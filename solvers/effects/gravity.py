"""Gravity: the body force density times acceleration, ramped like every other load."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated

from stickslip.geometry.amplitude import Amplitude, check
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import LIST, Key
from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.fem.terms import LoadTerm
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.scene import EffectTable, Scene
from stickslip.solvers.scene.timeline import Place


@dataclass(frozen=True, kw_only=True)
class Gravity(EffectTable):
    """Acceleration of gravity, the same in all bodies."""

    acceleration: Annotated[tuple[Amplitude, ...], Key("m/s²", "by component, in time"), LIST]

    def __post_init__(self) -> None:
        for amplitude in self.acceleration:
            check(amplitude, "acceleration")

    def amplitudes(self) -> Mapping[tuple[str, str], Amplitude]:
        return {("acceleration", axis): a for axis, a in zip("xyz", self.acceleration, strict=False)}

    def check(self, scene: Scene, key: str) -> None:
        found, where = list(self.acceleration), f"{key}.acceleration"
        require(len(found) == scene.dim, where, found, f"expected {scene.dim} components in this model")
        radial = scene.axisymmetric and found[0] != 0
        require(not radial, where, found, "an axisymmetric body has gravity along the axis y alone")
        if not any(material.density for material in scene.bodies.values()):
            raise SceneError("gravity: no body has a density; set bodies.NAME.density, in kg/m³")


class _Gravity(Effect):
    name = "gravity"
    table = Gravity

    def loads(self, problem: Problem, weak: WeakForms) -> Iterable[LoadTerm]:
        for body, material in problem.bodies.items():
            for axis in range(problem.dim):
                if material.density:
                    form = weak.along(axis, material.density) * weak.volume(body)
                    yield LoadTerm(drive=Place("gravity", "", "acceleration", "xyz"[axis]), form=form)


EFFECT = _Gravity()
