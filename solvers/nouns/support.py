"""Prescribed displacement of a side or of one point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from geometry.amplitude import Amplitude, check
from geometry.errors import SceneError, require
from geometry.keys import Key, Noun

Direction = Literal["x", "y", "z", "normal"]


@dataclass(frozen=True, kw_only=True)
class Support(Noun):
    """Components that are not named stay free."""

    displacement: Annotated[Mapping[Direction, Amplitude], Key("m", "by component x, y, z or normal (outward)")]
    boundary: Annotated[str | None, Key("-", "side, as body.side")] = None
    point: Annotated[tuple[float, ...] | None, Key("m", "a mesh vertex lies here; instead of boundary")] = None

    def __post_init__(self) -> None:
        if (self.boundary is None) == (self.point is None):
            raise SceneError("boundary / point: a support needs exactly one of the two")
        require(len(self.displacement) > 0, "displacement", "{}", "name at least one of x, y, z, normal")
        for axis, amplitude in self.displacement.items():
            check(amplitude, f"displacement.{axis}")
        if self.point is not None:
            require(
                "normal" not in self.displacement, "displacement.normal", "given", "a point has no normal; use x, y, z"
            )
