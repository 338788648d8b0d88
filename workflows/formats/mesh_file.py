"""fields.h5 holds the mesh of the bodies and of the contact surfaces, as VTK numbers the nodes of each cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import AnyArray, Array, Ints
from stickslip.solvers.results.step_result import MeshData, SurfaceMesh
from stickslip.workflows.formats.hdf5 import checksum
from stickslip.workflows.formats.steps import three

CORNERS = {"interval": 2, "triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}
DIMENSIONS = {"interval": 1, "triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}
MESH_FILE = "fields.h5"


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


def mesh_arrays(mesh: MeshData) -> dict[str, AnyArray]:
    """All that fields.h5 holds, by place: points (n, 3) [m] and cells (c, k) of mesh/ and contacts/NAME/, and more."""
    found: dict[str, AnyArray] = {
        "mesh/body": np.asarray(mesh.body, np.int64),
        "mesh/bodies": np.array([name.encode() for name in mesh.bodies]),
    }
    places = {"mesh": (mesh.points, mesh.cells, mesh.shape)}
    places |= {f"contacts/{name}": surface for name, surface in mesh.surfaces.items()}
    for place, (points, cells, shape) in places.items():
        found[f"{place}/points"] = three(points)
        found[f"{place}/cells"] = np.asarray(cells[:, shape_of(shape, cells).order], np.int64)
    return found | {f"contacts/{name}/nodes": np.asarray(nodes, np.int64) for name, nodes in mesh.slaves.items()}


def mesh_from(arrays: Mapping[str, AnyArray], dim: int) -> MeshData:
    """The mesh that `mesh_arrays` has turned into arrays, in `dim` dimensions; gaps are not kept.

    Raises:
        KeyError: an array is missing, as in files of earlier versions.
    """

    def grid(place: str, of: int) -> tuple[Array, Ints, str]:
        cells = arrays[f"{place}/cells"]
        name = shape_with(of, cells.shape[1])
        return arrays[f"{place}/points"][:, :dim], cells[:, np.argsort(shape_of(name, cells).order)], name

    points, cells, shape = grid("mesh", dim)
    surfaces = [key.split("/")[1] for key in arrays if key.startswith("contacts/") and key.endswith("/cells")]
    return MeshData(
        points=points,
        cells=cells,
        shape=shape,
        body=arrays["mesh/body"],
        bodies=tuple(name.decode() for name in arrays["mesh/bodies"]),
        surfaces={name: SurfaceMesh(*grid(f"contacts/{name}", dim - 1)) for name in surfaces},
        slaves={name: arrays[f"contacts/{name}/nodes"] for name in surfaces},
    )


def mesh_checksum(mesh: MeshData) -> str:
    """Return a checksum that is the same for the same mesh."""
    return checksum(mesh_arrays(mesh), {})
