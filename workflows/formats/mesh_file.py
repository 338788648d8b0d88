"""fields.h5: the mesh of the bodies and of the contact surfaces, as VTK numbers its nodes; and what tells two apart."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stickslip.geometry.arrays import AnyArray, Array, Ints
from stickslip.solvers.results.step_result import MeshData, SurfaceMesh
from stickslip.workflows.formats.hdf5 import checksum
from stickslip.workflows.formats.shapes import shape_of, shape_with
from stickslip.workflows.formats.steps import three

MESH_FILE = "fields.h5"


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
    """The same for the same mesh."""
    return checksum(mesh_arrays(mesh), {})
