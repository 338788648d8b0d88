"""A ring inside a ring, with interference (a press fit) or with a gap."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from stickslip.geometry.builders.assembly import Assembly, CellKeys, Part
from stickslip.geometry.builders.ring import ANGLE, Ring
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.shape import Model


@dataclass(frozen=True, kw_only=True)
class Rings(Assembly):
    """Two rings about the origin, or a quarter of both; the inner one is larger than the hole by the interference."""

    models: ClassVar[tuple[Model, ...]] = ("plane strain", "plane stress")
    lengths: ClassVar[tuple[str, ...]] = ("inner_radius", "radius", "outer_radius", "inner_mesh_size")
    distances: ClassVar[tuple[str, ...]] = ("interference",)

    inner_radius: Annotated[float, Key("m", "of the hole in the inner ring")]
    radius: Annotated[float, Key("m", "of the hole in the outer ring")]
    outer_radius: Annotated[float, Key("m", "of the outer ring")]
    interference: Annotated[
        float, Key("m", "the inner ring's radius beyond that of the outer ring's hole: their overlap; negative: a gap")
    ] = 0.0
    inner_mesh_size: Annotated[
        float | None,
        Key(
            "m",
            "mesh_size of the inner ring, contact_mesh_size in the same ratio; "
            "absent: where the rings touch, both have as many cells",
        ),
    ] = None
    angle: Annotated[Literal[360, 90], Key("-", ANGLE)] = 360
    builder: Annotated[Literal["rings"], Key("-", "the shape's name")] = "rings"

    @property
    def fitted_radius(self) -> float:
        """Outer radius of the inner ring [m]."""
        return self.radius + self.interference

    def check_keys(self) -> None:
        require(self.inner_radius < self.radius, "inner_radius", self.inner_radius, "must be smaller than radius")
        require(self.radius < self.outer_radius, "radius", self.radius, "must be smaller than outer_radius")
        fits = self.inner_radius < self.fitted_radius < self.outer_radius
        require(fits, "interference", self.interference, "moves the inner ring's outside beyond one of the other radii")

    def parts(self) -> Mapping[str, Part]:
        inner = self._ring(self.inner_radius, self.fitted_radius, self._inner_cell_keys())
        return {"inner": inner, "outer": self._ring(self.radius, self.outer_radius, self.cell_keys())}

    def _ring(self, inner: float, outer: float, cell_keys: CellKeys) -> Part:
        ring = Ring(inner_radius=inner, outer_radius=outer, angle=self.angle, **cell_keys)
        return Part(shape=ring, renamed={"inner": "inside", "outer": "outside"})

    def _inner_cell_keys(self) -> CellKeys:
        """Mesh keys of the inner ring; by default it has as many cells around as the outer ring where the two touch.

        A ring has equally many cells on both of its circles, as the larger or the finer of them needs.
        """
        if self.inner_mesh_size is not None:
            return self.cell_keys(self.inner_mesh_size)
        keys = self.cell_keys(self.mesh_size * self.fitted_radius / self.outer_radius)
        if self.contact_mesh_size is not None:
            along = self.contact_mesh_size * self.fitted_radius / self.radius
            keys["contact_mesh_size"] = min(keys["mesh_size"], along)
        return keys
