"""Half a disc that stands on its pole."""

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


@dataclass(frozen=True, kw_only=True)
class HalfDisc(Dome):
    """Half a disc with its pole at the origin and its flat side at y = radius; if axisymmetric, half a ball."""

    symmetric: Annotated[bool, Key("-", sides.SYMMETRIC)] = False
    builder: Annotated[Literal["half_disc"], Key("-", "the shape's name")] = "half_disc"

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        return {"disc": ("arc", "top", *(("axis",) if self.symmetric else ()))}

    def check_model(self, model: Model) -> None:
        if model == "3d":
            raise SceneError('builder = "half_disc": there is none in 3D; use "half_ball"')
        sides.check_symmetric(self.symmetric, model)
        super().check_model(model)

    def box(self, dim: int) -> Array:
        return self.radius * np.array([[0.0 if self.symmetric else -1.0, 0.0], [1.0, 1.0]])

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        name = side.split(".")[1]
        if name == "arc":
            angle = np.radians(np.arange(0 if self.symmetric else -90, 91, 22.5))
            normals = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
            return self.radius * (normals + np.array([0.0, 1.0])), normals
        return sides.box_corners(self.box(dim), *((0, 0) if name == "axis" else (1, 1)))

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        """The pole and the centre are vertices of the mesh."""
        occ, r = gmsh.model.occ, self.radius
        pole, centre, right = (occ.addPoint(*point, 0) for point in ((0, 0), (0, r), (r, r)))
        arcs, tops, axis = [occ.addCircleArc(pole, centre, right)], [occ.addLine(right, centre)], []
        if self.symmetric:
            axis = [occ.addLine(centre, pole)]
        else:
            left = occ.addPoint(-r, r, 0)
            tops.append(occ.addLine(centre, left))
            arcs.append(occ.addCircleArc(left, centre, pole))
        occ.addPlaneSurface([occ.addCurveLoop([arcs[0], *tops, *axis, *arcs[1:]])])
        occ.synchronize()
        sides.name_groups(gmsh, 2, "disc", {"arc": arcs, "top": tops} | ({"axis": axis} if axis else {}))
        self.size_cells(gmsh)
