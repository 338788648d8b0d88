"""Body force: a force per volume of a body, in time or as an expression of place and time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated

from stickslip.geometry.errors import require
from stickslip.geometry.expression import Varying, check_varying
from stickslip.geometry.keys import Key
from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.fem.terms import LoadTerm
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.scene import EffectTable, Scene
from stickslip.solvers.scene.timeline import Place


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
        found, expected = list(self.force), f"expected {scene.dim} components in this model"
        require(len(found) == scene.dim, f"{key}.force", found, expected)


class _BodyForce(Effect):
    name = "body_force"
    table = Mapping[str, BodyForce]

    def loads(self, problem: Problem, weak: WeakForms) -> Iterable[LoadTerm]:
        for body, table in problem.tables["body_force"].items():
            for axis, value in enumerate(table.force):
                if value != 0:
                    place = Place("body_force", body, "force", "xyz"[axis])
                    yield weak.load(place, weak.along(axis), partial(weak.volume, body))


EFFECT = _BodyForce()
