"""Thermal expansion: an initial strain that is proportional to the temperature above the stress-free one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check
from stickslip.geometry.keys import Key
from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.fem.terms import InitialStrain
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.scene import EffectTable, Scene
from stickslip.solvers.scene.timeline import Place


@dataclass(frozen=True, kw_only=True)
class Thermal(EffectTable):
    """Thermal expansion of one body, [thermal.BODY]; its temperature is uniform."""

    expansion: Annotated[float, Key("1/K", "coefficient of linear thermal expansion of the body")]
    temperature: Annotated[Amplitude, Key("K", "above the temperature at which the body is free of stress, in time")]

    def __post_init__(self) -> None:
        check(self.temperature, "temperature")

    def amplitudes(self) -> Mapping[tuple[str, str], Amplitude]:
        return {("temperature", ""): self.temperature}

    def check(self, scene: Scene, key: str) -> None:
        scene.require_body(key)


class _Thermal(Effect):
    """sigma = C (eps(u) - expansion temperature I); in every model all three directions expand."""

    name = "thermal"
    table = Mapping[str, Thermal]

    def initial_strains(self, problem: Problem) -> Iterable[InitialStrain]:
        for body, table in problem.tables["thermal"].items():
            drive = Place("thermal", body, "temperature")
            yield InitialStrain(drive=drive, body=body, strain=table.expansion * np.eye(3))


EFFECT = _Thermal()
