"""Blocks on top of each other, each meshed alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from stickslip.geometry.builders.assembly import BodyRow, Part
from stickslip.geometry.builders.block import Block
from stickslip.geometry.keys import Key


@dataclass(frozen=True, kw_only=True)
class Stack(BodyRow):
    """Blocks [0, length]; block_1 stands on 0 of the last axis, block_2 on it, and so on upwards."""

    lengths: ClassVar[tuple[str, ...]] = ("length", "height", "width")

    length: Annotated[float, Key("m", "size of each block along x")]
    height: Annotated[float, Key("m", "size of each block along the last axis")]
    width: Annotated[float | None, Key("m", "size along y, 3D only")] = None
    builder: Annotated[Literal["stack"], Key("-", "the shape's name")] = "stack"

    def parts(self) -> Mapping[str, Part]:
        return {f"block_{k}": self._block(k) for k in range(1, self.count + 1)}

    def _block(self, number: int) -> Part:
        block = Block(length=self.length, height=self.height, width=self.width, **self.cell_keys_of(number))
        return Part(shape=block, shift=(0.0, (number - 1) * self.height))
