"""Quality of the cells of a mesh by the Jacobian of their map: the mean ratio, and whether a cell is inverted.

Curving the sides of a mesh may turn thin cells inside out: such a mesh is refused.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.protocols import DolfinxMesh

AT_A_TIME = 20_000  # cells
IDEAL = {  # edges of the ideal cell from its first corner, as columns
    "triangle": [[1.0, 0.5], [0.0, np.sqrt(3) / 2]],
    "tetrahedron": [[1.0, 0.5, 0.5], [0.0, np.sqrt(3) / 2, np.sqrt(3) / 6], [0.0, 0.0, np.sqrt(2 / 3)]],
}


def worst_jacobian_ratio(domain: DolfinxMesh, degree: int) -> tuple[float, Array]:
    """Smallest over largest Jacobian determinant at the nodes of the worst owned cell, and its midpoint (d,) [m].

    The ratio is 1 if all cells are straight simplices, and 0 or less if a cell is inverted.
    """
    points = dx.reference_nodes(domain.topology.cell_type.name, degree)
    worst, place = np.inf, np.zeros(domain.geometry.dim)
    for x, jacobian in _jacobians(domain, degree, points):
        determinant = np.linalg.det(jacobian)
        determinant *= np.sign(determinant.mean(axis=1, keepdims=True))  # cells may be mirror images
        found = determinant.min(axis=1) / np.abs(determinant).max(axis=1)
        if len(found) and found.min() < worst:
            worst, place = float(found.min()), x[found.argmin()].mean(axis=0)
    return worst, place


def refuse_inverted_cells(domain: DolfinxMesh, degree: int) -> None:
    """Raise GeometryError on every rank if a cell of any rank is inverted; collective."""
    worst, place = min(domain.comm.allgather(worst_jacobian_ratio(domain, degree)), key=lambda found: found[0])
    if worst <= 0:
        where = ", ".join(f"{value:.3g}" for value in place)
        raise GeometryError(f"geometry: a curved cell at ({where}) is turned inside out; make the cells there smaller")


def worst_quality(domain: DolfinxMesh, degree: int) -> float:
    """Smallest mean ratio d |J|^(2/d) / ||J||^2 over the nodes of all cells: 1 if ideal, 0 if flat; collective.

    J is the Jacobian of the map from the ideal cell (equilateral, or square) to the cell.

    Source: Knupp, SIAM J. Sci. Comput. 23 (2001).
    """
    shape, d = domain.topology.cell_type.name, domain.geometry.dim
    points = dx.reference_nodes(shape, degree)
    if degree == 1 and shape in IDEAL:
        points = points[:1]  # J is constant in a straight simplex
    ideal, worst = np.linalg.inv(IDEAL.get(shape, np.eye(d))), 1.0
    for _, jacobian in _jacobians(domain, degree, points):
        J = jacobian @ ideal
        volume = np.linalg.det(J)
        volume *= np.sign(volume.sum(axis=1, keepdims=True))  # the nodes of a cell may be numbered clockwise
        ratio = d * np.abs(volume) ** (2 / d) * np.sign(volume) / np.einsum("cqij,cqij->cq", J, J)
        worst = min(worst, float(ratio.min(initial=1.0)))
    return float(min(domain.comm.allgather(worst)))


def _jacobians(domain: DolfinxMesh, degree: int, points: Array) -> Iterator[tuple[Array, Array]]:
    """Nodes (c, k, d) [m] of owned cells, and their Jacobians (c, q, d, d) at reference points (q, d), by blocks."""
    gradient = dx.reference_basis(domain.topology.cell_type.name, degree, points)[1]
    owned = domain.topology.index_map(domain.topology.dim).size_local
    for cells in np.split(dx.cell_nodes(domain)[:owned], range(AT_A_TIME, owned, AT_A_TIME)):
        x = domain.geometry.x[cells][:, :, : domain.geometry.dim]
        yield x, np.einsum("jqk,ckd->cqdj", gradient, x, optimize=True)
