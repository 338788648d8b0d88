"""Thermal expansion: an initial strain that is proportional to the temperature above the stress-free one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require, shortened
from stickslip.geometry.expression import Expression, Varying, check_varying
from stickslip.geometry.keys import Key, Vector
from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.fem.terms import InitialStrain
from stickslip.solvers.scene.material import Elastic, Orthotropic
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.scene import EffectTable, Scene
from stickslip.solvers.scene.timeline import Place


@dataclass(frozen=True, kw_only=True)
class Thermal(EffectTable):
    """Thermal expansion of one body, [thermal.BODY]."""

    expansion: Annotated[
        float | Vector,
        Key("1/K", "coefficient of linear thermal expansion of the body; of an orthotropic one also a list by axis"),
    ]
    temperature: Annotated[
        Varying, Key("K", "above that at which the body is free of stress, in time or as an expression of x, y, z")
    ]
    history: Annotated[
        Amplitude | None, Key("-", "factor of an expression, in time; absent: it is reached at steps.end")
    ] = None

    def __post_init__(self) -> None:
        check_varying(self.temperature, "temperature")
        if self.history is not None:
            check(self.history, "history")
            wrong = "only of an expression; write the temperature itself in time"
            require(isinstance(self.temperature, str), "history", "given", wrong)

    def amplitudes(self) -> Mapping[tuple[str, str], Varying]:
        found: dict[tuple[str, str], Varying] = {("temperature", ""): self.temperature}
        return found if self.history is None else found | {("history", ""): self.history}

    def check(self, scene: Scene, key: str) -> None:
        scene.require_body(key)
        if isinstance(self.expansion, tuple):
            found, body = list(self.expansion), scene.bodies[key.split(".")[-1]]
            require(isinstance(body, Orthotropic), f"{key}.expansion", found, "expected a number; the body has no axes")
            require(len(found) == 3, f"{key}.expansion", found, "expected three, along the axes 1, 2, 3 of the body")
        if isinstance(self.temperature, str):
            text, why = f'"{shortened(self.temperature)}"', "t: has no place here; give its factor in time as history"
            require(not Expression(self.temperature, {}).in_time, f"{key}.temperature", text, why)


class _Thermal(Effect):
    """sigma = C (eps(u) - expansion temperature I); in every model all three directions expand.

    With an expansion by axis the tensor that has it along the axes of the body takes the place of expansion I.
    """

    name = "thermal"
    table = Mapping[str, Thermal]

    def initial_strains(self, problem: Problem) -> Iterable[InitialStrain]:
        for body, table in problem.tables["thermal"].items():
            temperature = Place("thermal", body, "temperature")
            drive = temperature if table.history is None else Place("thermal", body, "history")
            field = temperature if isinstance(table.temperature, str) else None
            yield InitialStrain(drive=drive, body=body, field=field, strain=_by_kelvin(problem.bodies[body], table))


def _by_kelvin(body: Elastic, table: Thermal) -> Array:
    """Strain (3, 3) [1/K] without stress."""
    if isinstance(table.expansion, tuple):
        assert isinstance(body, Orthotropic)
        return np.asarray(body.axes.T @ np.diag(table.expansion) @ body.axes)
    return np.asarray(table.expansion * np.eye(3))


EFFECT = _Thermal()
