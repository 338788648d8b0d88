"""Two half discs that face each other with their poles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from stickslip.geometry.builders import sides
from stickslip.geometry.builders.assembly import Part
from stickslip.geometry.builders.half_disc import HalfDisc
from stickslip.geometry.builders.pair import Domes
from stickslip.geometry.keys import Key
from stickslip.geometry.shape import Model

UPSIDE_DOWN = ((1.0, 0.0), (0.0, -1.0))


@dataclass(frozen=True, kw_only=True)
class Cylinders(Domes):
    """Two cylinders cut by a plane; in axisymmetric models two balls."""

    models: ClassVar[tuple[Model, ...]] = ("plane strain", "plane stress", "axisymmetric")

    symmetric: Annotated[bool, Key("-", sides.SYMMETRIC)] = False
    builder: Annotated[Literal["cylinders"], Key("-", "the shape's name")] = "cylinders"

    def parts(self) -> Mapping[str, Part]:
        lower = HalfDisc(symmetric=self.symmetric, **self.lower_keys())
        upper = HalfDisc(symmetric=self.symmetric, **self.upper_keys())
        return {
            "lower": Part(shape=lower, renamed={"top": "base"}, turn=UPSIDE_DOWN),
            "upper": Part(shape=upper, shift=(0.0, self.gap)),
        }
