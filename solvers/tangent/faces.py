"""Compliant faces: pressure at quadrature points as a function of displacement, as forces on the coordinates.

Every rank has all of these points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.parallel.replicated import Replicated
from stickslip.solvers.tangent.coordinates import ContactCoordinates
from stickslip.solvers.tangent.operator import TangentOperator


@dataclass(frozen=True)
class Pressed:
    """The faces at a displacement; arrays (rows,) are zero at rows that are not compliant."""

    p: Array  # (rows,) [Pa]
    penetration: Array  # (rows,) [m]
    stiffness: Array  # (rows,) W dp/d(penetration) [N/m]
    force: Array  # (owned,) on the coordinates [N]
    diagonal: Array  # (owned,) sums of the rows of their stiffness [N/m]


class CompliantFaces:
    """Motion of the faces by the coordinates, N T, and the forces of their pressures."""

    def __init__(self, operator: TangentOperator, coordinates: ContactCoordinates, problem: SurfaceProblem) -> None:
        """Take the faces of a step; collective."""
        self.problem, self.operator = problem, operator
        self.places = [block for block in problem.cone.places if block.rows.normal.at_quadrature]
        self._vector = operator.K_B.createVecRight()
        none, size = np.zeros(len(problem.gap)), self._vector.getLocalSize()
        self._nothing = Pressed(none, none, none, *np.zeros((2, size)))
        if self.places:
            compliant = np.zeros(len(problem.gap))
            for block in self.places:
                compliant[block.normal] = 1.0
            self.N: Sparse = (sparse.diags(compliant) @ coordinates.rows).tocsr()
            self._size = abs(self.N)
            self._sums = self._size @ np.ones(self.N.shape[1])
            self.scatter = Replicated(self._vector, coordinates.numbers)

    def motion(self, v: Array) -> Array:
        """Closing motion N v (rows,) [m] of coordinates v (owned,); collective."""
        if not self.places:
            return np.zeros(len(self.problem.gap))
        self._vector.array[:] = v
        return np.asarray(self.N @ self.scatter.read(self._vector))

    def pressed(self, v: Array) -> Pressed:
        """The faces at coordinates v (owned,) [m]; collective."""
        if not self.places:
            return self._nothing
        p, x = self._pressures(v)
        stiffness = np.zeros(len(p))
        for block in self.places:
            n = block.normal
            stiffness[n] = self.problem.surface.W[n] * block.rows.normal.stiffness(p[n], x[n])
        diagonal = self._written(self._size.T @ (stiffness * self._sums))
        return Pressed(p, x, stiffness, self.forces(self.problem.surface.W * p), diagonal)

    def _pressures(self, v: Array) -> tuple[Array, Array]:
        """Pressures (rows,) [Pa] and penetrations (rows,) [m] at coordinates v (owned,) [m]; collective."""
        p, x = np.zeros(len(self.problem.gap)), self.motion(v) + self.problem.offset - self.problem.gap
        for block in self.places:
            p[block.normal] = block.rows.normal.pressure(x[block.normal])
        return p, x

    def forces(self, weighted: Array) -> Array:
        """Forces N^T f (owned,) [N] of forces f (rows,) [N] of the points, if faces are compliant; collective."""
        return self._written(self.N.T @ weighted)

    def _written(self, values: Array) -> Array:
        """Values (owned,) of those of all coordinates of contact nodes (n d,); collective."""
        self._vector.array[:] = 0.0
        self.scatter.write(self._vector, values)
        return self._vector.array_r.copy()

    def growth(self, was: Pressed, v: Array, moved: Array) -> float:
        """Growth of the energy stored in the faces [J] by a motion from v; collective."""
        if not self.places:
            return 0.0
        energy, W = self.problem.cone.energy, self.problem.surface.W
        return float(W @ (energy(self._pressures(v + moved)[0]) - energy(was.p)))
