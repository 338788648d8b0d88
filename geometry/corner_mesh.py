"""A mesh of order 2 in 3D without the nodes between corners: the same cells, of order 1 and with straight edges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Request, Shape
from stickslip.geometry.user_files.raw_mesh import RawMesh

GMSH = {  # gmsh's type, and its order of the corners of cells and of facets
    "tetrahedron": (4, (0, 1, 2, 3), (0, 1, 2)),
    "hexahedron": (5, (0, 1, 3, 2, 4, 5, 7, 6), (0, 1, 3, 2)),
}


@dataclass(frozen=True, kw_only=True)
class CornerMesh(Shape):
    """As a shape it is put into gmsh as it is."""

    kind: str  # tetrahedron or hexahedron
    points: Array  # (n, 3) [m], of order 2
    cells: Ints  # (c, k) nodes, the corners first, in dolfinx's order
    body: Ints  # (c,) index in `names`
    names: tuple[str, ...]  # of the bodies
    sides: Mapping[str, Ints]  # body.side -> nodes of its facets (f, k), the corners first

    @property
    def degree(self) -> int:
        return 1

    def refuse_too_large(self, request: Request, free: float = np.inf) -> None:
        """It is smaller than the mesh that is there."""

    def put(self, gmsh: Gmsh, request: Request) -> float:
        kind, order, around = GMSH[self.kind]
        corners = self.cells[:, order]
        used = np.unique(corners)
        bodies = {name: np.searchsorted(used, corners[self.body == k]) for k, name in enumerate(self.names)}
        sides = {name: np.searchsorted(used, facets[:, around]) for name, facets in self.sides.items()}
        RawMesh(3, kind, self.points[used], bodies, sides).put(gmsh)
        return 1.0
