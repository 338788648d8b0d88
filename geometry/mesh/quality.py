"""Quality of the cells of a mesh: the mean ratio, which compares each cell with the ideal one."""

from __future__ import annotations

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.mesh.mesh import Mesh

CHUNK = 20_000  # cells at a time
IDEAL = {  # edges of the ideal cell from its first corner, as columns
    "triangle": [[1.0, 0.5], [0.0, np.sqrt(3) / 2]],
    "tetrahedron": [[1.0, 0.5, 0.5], [0.0, np.sqrt(3) / 2, np.sqrt(3) / 6], [0.0, 0.0, np.sqrt(2 / 3)]],
}


def worst_quality(mesh: Mesh) -> float:
    """Smallest mean ratio d |J|^(2/d) / ||J||^2 over the nodes of all cells: 1 if ideal, 0 if flat; collective.

    J is the Jacobian of the map from the ideal cell (equilateral, or square) to the cell.

    Source: Knupp, SIAM J. Sci. Comput. 23 (2001).
    """
    shape, d = mesh.domain.topology.cell_type.name, mesh.dim
    own = mesh.domain.topology.index_map(d).size_local
    points = dx.reference_nodes(shape, mesh.degree)
    if mesh.degree == 1 and shape in IDEAL:
        points = points[:1]  # J is constant in a straight simplex
    gradient = dx.reference_basis(shape, mesh.degree, points)[1]
    ideal, worst = np.linalg.inv(IDEAL.get(shape, np.eye(d))), 1.0
    for cells in np.split(dx.cell_nodes(mesh.domain)[:own], range(CHUNK, own, CHUNK)):
        x = mesh.domain.geometry.x[cells][:, :, :d]
        J = np.einsum("jqk,ckd->cqdj", gradient, x, optimize=True) @ ideal
        volume = np.linalg.det(J)
        volume *= np.sign(volume.sum(axis=1, keepdims=True))  # the nodes of a cell may be numbered clockwise
        ratio = d * np.abs(volume) ** (2 / d) * np.sign(volume) / np.einsum("cqij,cqij->cq", J, J)
        worst = min(worst, float(ratio.min(initial=1.0)))
    return float(min(mesh.comm.allgather(worst)))
