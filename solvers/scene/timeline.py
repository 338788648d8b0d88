"""Where in a scene a value in time stands."""

from __future__ import annotations

from typing import NamedTuple


class Place(NamedTuple):
    """supports.top.displacement.x, loads.side.pressure, obstacles.roller.rotation.angle, gravity.acceleration.y."""

    table: str
    name: str
    quantity: str
    component: str = ""

    def __str__(self) -> str:
        return ".".join(word for word in self if word)
