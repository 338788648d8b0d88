"""Jacobian determinants of curved cells: a mesh with an inverted one is refused.

Curving the sides of a mesh may turn thin cells inside out.
"""

from __future__ import annotations

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.protocols import DolfinxMesh

CHUNK = 20_000  # cells at a time


def worst_jacobian_ratio(domain: DolfinxMesh, degree: int) -> tuple[float, Array]:
    """Smallest over largest Jacobian determinant at the nodes of the worst owned cell, and its midpoint (d,) [m].

    The ratio is 1 if all cells are straight simplices, and 0 or less if a cell is inverted.
    """
    shape, dim = domain.topology.cell_type.name, domain.geometry.dim
    gradient = dx.reference_basis(shape, degree, dx.reference_nodes(shape, degree))[1]
    owned = domain.topology.index_map(domain.topology.dim).size_local
    worst, place = np.inf, np.zeros(dim)
    for cells in np.split(dx.cell_nodes(domain)[:owned], range(CHUNK, owned, CHUNK)):
        x = domain.geometry.x[cells][:, :, :dim]
        determinant = np.linalg.det(np.einsum("iqn,cnj->cqij", gradient, x))
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
