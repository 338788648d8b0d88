"""Forces per volume of bodies: gravity, forces given as such, and the centrifugal load of bodies that spin."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check
from stickslip.geometry.errors import SceneError, require, require_components
from stickslip.geometry.expression import Varying, check_varying
from stickslip.geometry.keys import LIST, Key, Vector
from stickslip.geometry.obstacles.obstacle import unit
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
        require_components(found, where, scene.dim)
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


@dataclass(frozen=True, kw_only=True)
class BodyForce(EffectTable):
    """Force per volume on one body, [body_force.BODY]."""

    force: Annotated[tuple[Varying, ...], Key("N/m³", "force per volume, by component")]

    def __post_init__(self) -> None:
        for value in self.force:
            check_varying(value, "force")

    def amplitudes(self) -> Mapping[tuple[str, str], Varying]:
        return {("force", axis): value for axis, value in zip("xyz", self.force, strict=False)}

    def check(self, scene: Scene, key: str) -> None:
        scene.require_body(key)
        require_components(self.force, f"{key}.force", scene.dim)


class _BodyForce(Effect):
    name = "body_force"
    table = Mapping[str, BodyForce]

    def loads(self, problem: Problem, weak: WeakForms) -> Iterable[LoadTerm]:
        for body, table in problem.tables["body_force"].items():
            for axis, value in enumerate(table.force):
                if value != 0:
                    place = Place("body_force", body, "force", "xyz"[axis])
                    yield weak.load(place, weak.along(axis), partial(weak.volume, body))


@dataclass(frozen=True, kw_only=True)
class Centrifugal(EffectTable):
    """Speed of rotation of all bodies with a density; the load is that of the undeformed bodies."""

    speed: Annotated[Amplitude, Key("rad/s", "angular velocity, in time; its square loads the bodies")]
    point: Annotated[Vector | None, Key("m", "a point of the axis; absent: the origin")] = None
    axis: Annotated[
        Vector | None, Key("-", "direction of the axis, given in 3D alone, and there always; else z, if axisymmetric y")
    ] = None

    def __post_init__(self) -> None:
        check(self.speed, "speed")
        require(self.axis is None or any(self.axis), "axis", self.axis, "must not be zero")

    def amplitudes(self) -> Mapping[tuple[str, str], Amplitude]:
        return {("speed", ""): self.speed}

    def check(self, scene: Scene, key: str) -> None:
        if (self.axis is None) == (scene.dim == 3):
            require(self.axis is None, f"{key}.axis", self.axis, "only a 3D model chooses its axis; remove the key")
            raise SceneError(f"{key}.axis: missing, a 3D model needs it")
        if scene.axisymmetric:
            require(self.point is None, f"{key}.point", self.point, "an axisymmetric body spins about its axis")
        for name, vector in (("point", self.point), ("axis", self.axis)):
            require_components(vector, f"{key}.{name}", scene.dim)
        if not any(material.density for material in scene.bodies.values()):
            raise SceneError(f"{key}: no body has a density; set bodies.NAME.density, in kg/m³")


class _Centrifugal(Effect):
    name = "centrifugal"
    table = Centrifugal

    def loads(self, problem: Problem, weak: WeakForms) -> Iterable[LoadTerm]:
        table, drive = problem.tables["centrifugal"], Place("centrifugal", "", "speed")
        across = np.eye(problem.dim)  # the part of a vector that is perpendicular to the axis
        if problem.model == "axisymmetric":
            across[1, 1] = 0.0
        if table.axis is not None:
            across -= np.outer(unit(table.axis), unit(table.axis))
        origin = np.zeros(problem.dim) if table.point is None else np.array(table.point)
        for body, material in problem.bodies.items():
            if material.density:
                pull = weak.linear(material.density * across, -material.density * across @ origin)
                yield LoadTerm(drive=drive, power=2, form=pull * weak.volume(body))


EFFECTS = (_Gravity(), _BodyForce(), _Centrifugal())
