"""Nodes of the displacement space: their local, global and gmsh numbers, coordinates and connected parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry import dolfinx_versions as dx
from geometry.arrays import Array, Ints
from geometry.mesh.mesh import Mesh
from geometry.protocols import FunctionSpace


@dataclass(frozen=True)
class Nodes:
    """The k local nodes, those that this rank owns first, then ghosts."""

    owned: int  # nodes that this rank owns
    offset: int  # global number of the first owned node
    total: int  # nodes of the whole mesh
    number: Ints  # (k,) global
    input: Ints  # (k,) number in the gmsh model: the same on any number of ranks
    points: Array  # (k, d) [m]
    part: Ints  # (k,) part of the mesh, as in `Mesh.parts`

    @staticmethod
    def of(mesh: Mesh, space: FunctionSpace) -> Nodes:
        """Nodes of a Lagrange space of the mesh's own degree."""
        domain, index_map = space.mesh, space.dofmap.index_map
        count = index_map.size_local + index_map.num_ghosts
        of_geometry = np.empty(count, np.int64)
        of_geometry[dx.cell_dofs(space).ravel()] = dx.cell_nodes(domain).ravel()
        numbers = np.asarray(domain.geometry.input_global_indices, np.int64)[of_geometry]
        return Nodes(
            owned=index_map.size_local,
            offset=index_map.local_range[0],
            total=index_map.size_global,
            number=np.asarray(index_map.local_to_global(np.arange(count, dtype=np.int32)), np.int64),
            input=numbers,
            points=domain.geometry.x[of_geometry][:, : domain.geometry.dim].copy(),
            part=mesh.parts[numbers],
        )
