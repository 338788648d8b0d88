"""Blocks on top of each other, each meshed alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from stickslip.geometry.builders.assembly import BodyRow, Pair, Part
from stickslip.geometry.builders.cuboid import Block
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


@dataclass(frozen=True, kw_only=True)
class TwoBlocks(Pair):
    """The upper block is [offset, offset + length]; the lower one is centred under it at offset = 0."""

    lengths: ClassVar[tuple[str, ...]] = (
        *Pair.lengths, "length", "height", "width", "lower_length", "lower_height",
    )  # fmt: skip
    distances: ClassVar[tuple[str, ...]] = (*Pair.distances, "offset")

    length: Annotated[float, Key("m", "size of the upper block along x")]
    height: Annotated[float, Key("m", "size of the upper block along the last axis")]
    width: Annotated[float | None, Key("m", "size of both along y, 3D only")] = None
    lower_length: Annotated[float | None, Key("m", "size of the lower block along x; absent: length")] = None
    lower_height: Annotated[float | None, Key("m", "size of the lower block along the last axis; absent: height")] = (
        None
    )
    offset: Annotated[float, Key("m", "the upper block's way along x from above the lower one's middle")] = 0.0
    builder: Annotated[Literal["two_blocks"], Key("-", "the shape's name")] = "two_blocks"

    def parts(self) -> Mapping[str, Part]:
        length = self.length if self.lower_length is None else self.lower_length
        height = self.height if self.lower_height is None else self.lower_height
        lower = Block(length=length, height=height, width=self.width, **self.lower_cell_keys())
        upper = Block(length=self.length, height=self.height, width=self.width, **self.cell_keys())
        return {
            "lower": Part(shape=lower, shift=((self.length - length) / 2, -height)),
            "upper": Part(shape=upper, shift=(self.offset, self.gap)),
        }
