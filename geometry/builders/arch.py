"""An arch of stones, each a ring sector meshed alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.builders.assembly import BodyRow, Part
from stickslip.geometry.builders.block import Block
from stickslip.geometry.builders.sector import Sector, directions
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.shape import Model


@dataclass(frozen=True, kw_only=True)
class Arch(BodyRow):
    """Ring sectors stone_1 (leftmost), stone_2, ... about the origin, symmetric about the y axis.

    The sides `left` and `right` of a stone, as seen from the origin, are its joints; `top` is that of a springer.
    """

    models: ClassVar[tuple[Model, ...]] = ("plane strain", "plane stress")
    lengths: ClassVar[tuple[str, ...]] = ("inner_radius", "thickness", "springer_height")

    inner_radius: Annotated[float, Key("m", "of the inside")]
    thickness: Annotated[float, Key("m", "from the inside to the outside")]
    angle: Annotated[float, Key("-", "of the whole arch, in degrees")] = 180.0
    springer_height: Annotated[
        float | None, Key("m", "of the blocks left_springer and right_springer under the arch's ends; absent: no such")
    ] = None
    builder: Annotated[Literal["arch"], Key("-", "the shape's name")] = "arch"

    @property
    def outer_radius(self) -> float:
        """Radius of the outside of the arch [m]."""
        return self.inner_radius + self.thickness

    def check_keys(self) -> None:
        super().check_keys()
        require(0 < self.angle <= 180, "angle", self.angle, "must be above 0 and not above 180 degrees")
        require(self.angle / self.count <= 90, "count", self.count, "makes stones of more than 90 degrees")
        fine = self.contact_mesh_size
        require(fine is None, "contact_mesh_size", fine, "an arch's cells are alike; use mesh_size")

    def parts(self) -> Mapping[str, Part]:
        stones = {f"stone_{k}": self._stone(k) for k in range(1, self.count + 1)}
        if self.springer_height is None:
            return stones
        left = self._springer(0, 90 + self.angle / 2 - 180, self.outer_radius, self.springer_height)
        right = self._springer(self.count + 1, 90 - self.angle / 2, self.inner_radius, self.springer_height)
        return {"left_springer": left, **stones, "right_springer": right}

    def _stone(self, number: int) -> Part:
        right, left = (90 + self.angle * (0.5 - k / self.count) for k in (number, number - 1))
        sector = Sector(
            inner_radius=self.inner_radius,
            outer_radius=self.outer_radius,
            start=right,
            end=left,
            **self.cell_keys_of(number),
        )
        return Part(shape=sector)

    def _springer(self, number: int, turn: float, first: float, height: float) -> Part:
        """The block under one end of the arch.

        Args:
            number: place in the row, 0 for the left springer.
            turn: angle by which the block is turned, in degrees.
            first: radius of its upper left corner [m].
            height: [m].
        """
        ((c, s),) = directions(np.array([turn]))
        block = Block(length=self.thickness, height=height, **self.cell_keys_of(number))
        outward = -1 if number == 0 else 1
        corner = first * outward * np.array([c, s]) - height * np.array([-s, c])
        return Part(shape=block, turn=((c, -s), (s, c)), shift=(float(corner[0]), float(corner[1])))
