"""Two half balls that face each other with their poles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from stickslip.geometry.builders.assembly import Part
from stickslip.geometry.builders.half_ball import SYMMETRY, HalfBall
from stickslip.geometry.builders.pair import Domes
from stickslip.geometry.keys import Key
from stickslip.geometry.shape import Model

HALF_TURN = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))  # about the line x = y: a quarter stays in x, y >= 0


@dataclass(frozen=True, kw_only=True)
class Spheres(Domes):
    """Two balls cut by a plane, or the quarter of both; 3D only."""

    models: ClassVar[tuple[Model, ...]] = ("3d",)

    symmetry: Annotated[Literal["none", "quarter"], Key("-", SYMMETRY)] = "none"
    builder: Annotated[Literal["spheres"], Key("-", "the shape's name")] = "spheres"

    def parts(self) -> Mapping[str, Part]:
        lower = HalfBall(symmetry=self.symmetry, **self.lower_keys())
        upper = HalfBall(symmetry=self.symmetry, **self.upper_keys())
        swapped = {"top": "base", "x_plane": "y_plane", "y_plane": "x_plane"}
        return {
            "lower": Part(shape=lower, renamed=swapped, turn=HALF_TURN),
            "upper": Part(shape=upper, shift=(0.0, self.gap)),
        }
