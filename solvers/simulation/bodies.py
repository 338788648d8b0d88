"""Bodies that another simulation has meshed and factorised, for scenes that differ in contact, loads or history."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.prepare import Volume
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.system.system import System


@dataclass(frozen=True)
class Bodies:
    """A mesh and, if it was factorised, its stiffness."""

    problem: Problem  # that they were prepared for
    mesh: Mesh
    volume: Volume
    content: str  # hash of the geometry's file, if there is one

    @classmethod
    def of(cls, problem: Problem, mesh: Mesh, volume: Volume) -> Bodies:
        """Those of a simulation."""
        return cls(problem, mesh, volume, _content(problem))

    def mesh_for(self, problem: Problem) -> Mesh | None:
        """The mesh, if that of another problem is the same."""
        same = problem.shape == self.problem.shape and replace(problem.request, sizes=None) == self.problem.request
        return self.mesh if same and _content(problem) == self.content else None

    def factor_for(self, system: System) -> FactorisedVolume | None:
        """The factor, if a system on this mesh has the same stiffness and contact dofs, to the last bit; collective."""
        factor = self.volume
        if system.mesh is not self.mesh or not isinstance(factor, FactorisedVolume):
            return None
        if not np.array_equal(factor.contact.rows, system.interface.dofs) or not factor.K.equal(system.K_B):
            return None
        return factor.counting(system.counters)


def _content(problem: Problem) -> str:
    return problem.shape.digest() if isinstance(problem.shape, UserFile) else ""
