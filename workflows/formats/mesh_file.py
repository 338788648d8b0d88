"""fields.h5: the mesh of the bodies and of the contact surfaces, as VTK numbers its nodes; and what tells two apart."""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import AnyArray
from stickslip.solvers.results.step_result import MeshData
from stickslip.workflows.formats.hdf5 import checksum
from stickslip.workflows.formats.shapes import shape_of
from stickslip.workflows.formats.steps import three

MESH_FILE = "fields.h5"


def mesh_arrays(mesh: MeshData) -> dict[str, AnyArray]:
    """All that fields.h5 holds, by place: points (n, 3) [m] and cells (c, k) of mesh/ and contacts/NAME/, mesh/body."""
    found: dict[str, AnyArray] = {"mesh/body": np.asarray(mesh.body, np.int64)}
    places = {"mesh": (mesh.points, mesh.cells, mesh.shape)}
    places |= {f"contacts/{name}": surface for name, surface in mesh.surfaces.items()}
    for place, (points, cells, shape) in places.items():
        found[f"{place}/points"] = three(points)
        found[f"{place}/cells"] = np.asarray(cells[:, shape_of(shape, cells).order], np.int64)
    return found


def mesh_checksum(mesh: MeshData) -> str:
    """The same for the same mesh."""
    return checksum(mesh_arrays(mesh), {})
