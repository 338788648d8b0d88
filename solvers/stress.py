"""Stress at the cells' midpoints, all nine components, whatever the model."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry import dolfinx_versions as dx
from solvers.system import System

Array = NDArray[np.float64]


class CellStress:
    """sigma(u) (own cells, 3, 3) [Pa]; the strain is compiled once, u is left in `displacement`."""

    def __init__(self, system: System) -> None:
        self._system = system
        self.displacement = dx.fem.Function(system.space)
        mesh = system.mesh
        self._strain = dx.CellExpression(system.weak.strain(self.displacement), dx.midpoint(mesh.domain), mesh.domain)
        system.counters.forms += 1
        count = mesh.domain.topology.index_map(mesh.dim).size_local
        self._cells = np.arange(count)
        self._lame = np.zeros((count, 2))
        for name, tag in mesh.bodies.items():
            material = system.scene.bodies[name]
            members = mesh.cell_tags.indices[mesh.cell_tags.values == tag]
            self._lame[members[members < count]] = material.lame_lambda, material.lame_mu

    def __call__(self, u: Any) -> Array:
        dx.petsc_vector(self.displacement).array[:] = u.array
        self.displacement.x.scatter_forward()
        strain = np.zeros((len(self._cells), 3, 3))
        found = self._strain(self._cells)
        d = round(found.shape[-1] ** 0.5)
        strain[:, :d, :d] = found.reshape(-1, d, d)
        lame_lambda, lame_mu = self._lame.T
        if self._system.scene.model == "plane stress":
            strain[:, 2, 2] = -lame_lambda / (lame_lambda + 2 * lame_mu) * (strain[:, 0, 0] + strain[:, 1, 1])
        trace = np.trace(strain, axis1=1, axis2=2)
        return np.asarray(2 * lame_mu[:, None, None] * strain + (lame_lambda * trace)[:, None, None] * np.eye(3))
