"""Half a ball that stands on its pole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.builders import sides
from stickslip.geometry.builders.dome import Dome
from stickslip.geometry.errors import SceneError
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Model, Request

PLANES = {"x_plane": 0, "y_plane": 1}  # sides of a quarter -> axis of the normal
SYMMETRY = "quarter: x, y >= 0 only, with sides x_plane and y_plane"


@dataclass(frozen=True, kw_only=True)
class HalfBall(Dome):
    """Half a ball with its pole at the origin and its flat side on top, at z = radius; 3D only."""

    symmetry: Annotated[Literal["none", "quarter"], Key("-", SYMMETRY)] = "none"
    builder: Annotated[Literal["half_ball"], Key("-", "the shape's name")] = "half_ball"

    @property
    def quarter(self) -> bool:
        return self.symmetry == "quarter"

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        return {"ball": ("cap", "top", *(PLANES if self.quarter else ()))}

    def check_model(self, model: Model) -> None:
        if model != "3d":
            raise SceneError('builder = "half_ball": there is one in 3D only; use "half_disc"')
        super().check_model(model)

    def box(self, dim: int) -> Array:
        low = 0.0 if self.quarter else -1.0
        return self.radius * np.array([[low, low, 0.0], [1.0, 1.0, 1.0]])

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        name = side.split(".")[1]
        turns = np.radians(np.arange(0, 91 if self.quarter else 360, 45))
        round_z = np.stack([np.cos(turns), np.sin(turns), np.zeros(len(turns))], axis=1)
        up = np.array([0.0, 0.0, 1.0])
        if name == "cap":
            normals = np.concatenate([-up[None], round_z, (round_z - up) / np.sqrt(2)])
            return self.radius * (normals + up), normals
        if name == "top":
            points = self.radius * np.concatenate([up[None], round_z + up])
            return points, np.tile(up, (len(points), 1))
        along = np.eye(3)[1 - PLANES[name]]
        points = self.radius * np.array([0 * up, up, along + up, (along - up) / np.sqrt(2) + up])
        return points, sides.constant_normals(PLANES[name], 0, points.shape)

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        """Drawn in quarters: the pole is then a vertex, and no surface has a seam or a singular point there."""
        occ, r = gmsh.model.occ, self.radius
        quarters = []
        for turn in range(1 if self.quarter else 4):
            quarters.append((3, occ.addSphere(0, 0, 0, r, angle1=0, angle2=np.pi / 2, angle3=np.pi / 2)))
            occ.rotate(quarters[-1:], 0, 0, 0, 1, 0, 0, -np.pi / 2)  # the octant x, y >= 0, z <= 0
            occ.rotate(quarters[-1:], 0, 0, 0, 0, 0, 1, turn * np.pi / 2)
        occ.translate(quarters, 0, 0, r)
        if not self.quarter:
            occ.fragment(quarters[:1], quarters[1:])
        occ.synchronize()
        flat = {"top": (2, r)} | ({name: (axis, 0.0) for name, axis in PLANES.items()} if self.quarter else {})
        sides.name_groups(gmsh, 3, "ball", sides.outer(gmsh, 3, flat, rest="cap"))
        self.size_cells(gmsh)
