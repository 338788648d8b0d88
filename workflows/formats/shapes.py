"""How dolfinx, VTK and XDMF name a cell and number its nodes.

dolfinx counts the corners of quadrilaterals and hexahedra like a tensor product, VTK and XDMF go round. Nodes of
edges and faces (order 2) follow dolfinx's numbering of edges and faces: e.g. edge 0 of a triangle lies opposite to
corner 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import AnyArray, Ints

CORNERS = {"interval": 2, "triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}
DIMENSIONS = {"interval": 1, "triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}


@dataclass(frozen=True)
class Shape:
    """A cell of VTK: node i of VTK is node `order[i]` of dolfinx."""

    xdmf: str  # TopologyType
    vtk: int  # VTK's cell type
    order: tuple[int, ...]


# fmt: off
SHAPES = {
    ("interval", 2): Shape("Polyline", 3, (0, 1)),
    ("interval", 3): Shape("Edge_3", 21, (0, 1, 2)),
    ("triangle", 3): Shape("Triangle", 5, (0, 1, 2)),
    ("triangle", 6): Shape("Triangle_6", 22, (0, 1, 2, 5, 3, 4)),
    ("quadrilateral", 4): Shape("Quadrilateral", 9, (0, 1, 3, 2)),
    ("quadrilateral", 9): Shape("Quadrilateral_9", 28, (0, 1, 3, 2, 4, 6, 7, 5, 8)),
    ("tetrahedron", 4): Shape("Tetrahedron", 10, (0, 1, 2, 3)),
    ("tetrahedron", 10): Shape("Tetrahedron_10", 24, (0, 1, 2, 3, 9, 6, 8, 7, 5, 4)),
    ("hexahedron", 8): Shape("Hexahedron", 12, (0, 1, 3, 2, 4, 5, 7, 6)),
    ("hexahedron", 27): Shape("Hexahedron_27", 29, (
        0, 1, 3, 2, 4, 5, 7, 6, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 15, 14, 22, 23, 21, 24, 20, 25, 26)),
}
# fmt: on


def shape_of(name: str, cells: AnyArray) -> Shape:
    """Shape of cells (c, k) by its dolfinx name."""
    return SHAPES[name, cells.shape[1]]


def shape_with(dim: int, width: int) -> str:
    """dolfinx's name of the cells of a dimension that have so many nodes.

    >>> shape_with(2, 4), shape_with(3, 4)
    ('quadrilateral', 'tetrahedron')
    """
    return next(name for name, count in SHAPES if DIMENSIONS[name] == dim and count == width)


def corner_cells(name: str, cells: AnyArray) -> tuple[Ints, int]:
    """Straight cells on the corners alone, in VTK's order, and VTK's type: enough for a picture.

    >>> corner_cells("quadrilateral", np.array([[0, 1, 2, 3]]))
    (array([[0, 1, 3, 2]]), 9)
    """
    shape = SHAPES[name, CORNERS[name]]
    return np.asarray(cells[:, shape.order], np.int64), shape.vtk
