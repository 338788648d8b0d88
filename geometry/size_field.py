"""Mesh sizes given point by point, as an error estimate wants them: gmsh meshes the exact geometry with them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import EXACT, TINY, Array, Ints
from stickslip.geometry.protocols import Gmsh

USUAL = {2: np.sqrt(3) / 4, 3: 0.2}  # mean volume of gmsh's cells for a size of 1; a regular tetrahedron's is .118
LIST = {3: "ST", 4: "SS"}  # gmsh's names of list data on triangles and tetrahedra, by their corners
SILENCED = ("Mesh.MeshSizeExtendFromBoundary", "Mesh.MeshSizeFromPoints", "Mesh.MeshSizeFromCurvature")
LEAST, MOST = 0.125, 2.0  # factors by which a size may change from one mesh to the next


@dataclass(frozen=True, eq=False)
class SizeField:
    """Edge lengths on the cells of an earlier mesh, linear in each."""

    points: Array  # (n, d) [m]
    cells: Ints  # (c, d+1) triangles or tetrahedra
    sizes: Array  # (n,) [m]

    def in_units_of(self, unit: float) -> SizeField:
        """All lengths divided by `unit` [m]."""
        return replace(self, points=self.points / unit, sizes=self.sizes / unit)

    def impose(self, gmsh: Gmsh) -> None:
        """Make it the only rule for sizes in the current gmsh model, in its unit; grids become free meshes."""
        gmsh.model.mesh.removeConstraints()
        for option in SILENCED:
            gmsh.option.setNumber(option, 0)
        corners = np.zeros((*self.cells.shape, 3))
        corners[:, :, : self.points.shape[1]] = self.points[self.cells]
        data = np.concatenate([corners.transpose(0, 2, 1).reshape(len(corners), -1), self.sizes[self.cells]], axis=1)
        view = gmsh.view.add("sizes")
        gmsh.view.addListData(view, LIST[self.cells.shape[1]], len(data), data.ravel().tolist())
        field = gmsh.model.mesh.field.add("PostView")
        gmsh.model.mesh.field.setNumber(field, "ViewTag", view)
        gmsh.model.mesh.field.setAsBackgroundMesh(field)

    def cell_count(self) -> float:
        """About how many cells the mesh will have."""
        d = self.points.shape[1]
        wanted = self.sizes[self.cells].mean(axis=1)
        return float(np.sum(volumes(self.points, self.cells) / (USUAL[d] * wanted**d)))


def volumes(points: Array, cells: Ints) -> Array:
    """Volumes (c,) [m^d] of triangles or tetrahedra."""
    sides = points[cells[:, 1:]] - points[cells[:, :1]]
    return np.asarray(np.abs(np.linalg.det(sides)) / {2: 2, 3: 6}[points.shape[1]])


def adapted(points: Array, cells: Ints, error: Array, factor: float, order: int = 1) -> SizeField:
    """Sizes with which all cells have the same error, and all of it together is `factor` times what it was.

    A cell's error falls with the power `order` of its size: of all sizes with that sum, these need the fewest cells.

    Args:
        points, cells: triangles or tetrahedra of the present mesh.
        error: (c,) of each cell, in the energy norm; its square adds up.
        factor: of the error of all cells.
        order: of the next mesh.
    """
    d, volume = points.shape[1], volumes(points, cells)
    size = (volume / USUAL[d]) ** (1 / d)
    error = np.maximum(error, EXACT * error.max(initial=TINY))
    power = 1 / (order + d / 2)
    share = 2 * order * power
    level = (factor**2 * np.sum(error**2) / np.sum(error ** (2 - share))) ** (1 / share)
    wanted = size * np.clip((level / error) ** power, LEAST, MOST)
    # a node takes the mean of its cells, in the logarithm
    node = cells.ravel()
    count = np.maximum(np.bincount(node, minlength=len(points)), 1)
    logs = np.bincount(node, np.repeat(np.log(wanted), cells.shape[1]), len(points)) / count
    return SizeField(points, cells, np.exp(logs))
