"""The bodies as the contact surface feels them: a small dense stiffness, exact, kept over all load steps."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.linalg import block_diag, cho_factor, cho_solve

from solvers.volume import Volume

Array = NDArray[np.float64]


class CondensedSurface:
    """S u_c = f_c - N^T W p on the contact dofs, S the Schur complement of K_B.

    A body that is held by contact alone makes S singular. With R an orthonormal basis of its rigid motions on the
    contact dofs, S + rho R R^T is positive definite, and (S + rho R R^T) u = f + rho R b with b = R^T u is the same
    equation: an augmentation that changes no answer, for any rho > 0.
    """

    def __init__(self, volume: Volume, N: Any, W: Array, R: Array, normal_rows: int, driven: int = 0) -> None:
        """
        Args:
            N: (rows, c) sparse, contact dofs to relative displacement.
            W: (rows,) point weights [m^(d-1)].
            R: (c, r) rigid motions on the contact dofs, orthonormal; r = 0 if the bodies are held.
            driven: how many dofs, the last ones, are motions of obstacles: they have no stiffness.
            normal_rows: how many of the rows are normal.
        """
        self.S = block_diag(volume.S, np.zeros((driven, driven))) if driven else volume.S
        self.N, self.W, self.R = N, W, R
        self.driven = driven
        self.normal_rows = normal_rows
        self.counters = volume.counters
        self.rho = float(np.trace(self.S) / max(len(self.S), 1))

    @property
    def floating(self) -> bool:
        return self.R.shape[1] > 0

    @cached_property
    def flexibility(self) -> Array:
        """(S + rho R R^T)^-1 (c, c) [m/N]."""
        if not len(self.S):  # no contact in the scene
            return self.S
        inverse = cho_solve(self.factor(np.zeros_like(self.S)), np.eye(len(self.S)))
        return np.asarray((inverse + inverse.T) / 2)

    def factor(self, tangent: Array) -> Any:
        """Cholesky factor of S + tangent + rho R R^T."""
        return cho_factor(self.S + tangent + self.rho * self.R @ self.R.T)

    def forces(self, p: Array) -> Array:
        """B^T p on the contact dofs (c,) [N]."""
        return np.asarray(self.N.T @ (self.W * p))

    def displacement(self, force: Array) -> Array:
        """K_B^-1 applied to forces on the contact dofs, seen there (c,) [m]; one volume solve."""
        self.counters.volume_solves += len(force) > 0
        return np.asarray(self.flexibility @ force)

    @cached_property
    def lambda_max(self) -> float:
        """Largest eigenvalue of W^-1 B K_B^-1 B^T [m/Pa] by Lanczos (SLEPc), with its error bound added."""
        from slepc4py import SLEPc

        root = np.sqrt(self.W)
        rows = len(self.W)
        surface = self

        class Operator:
            def mult(self, matrix: Any, x: Any, y: Any) -> None:
                surface.counters.lanczos_applications += 1
                y.array = root * (surface.N @ (surface.flexibility @ (surface.N.T @ (root * x.array_r))))

        shell = PETSc.Mat().createPython(((rows, rows), (rows, rows)), Operator(), comm=PETSc.COMM_SELF)
        shell.setUp()
        solver = SLEPc.EPS().create(PETSc.COMM_SELF)
        solver.setOptionsPrefix("lambda_max_")
        solver.setOperators(shell)
        solver.setProblemType(SLEPc.EPS.ProblemType.HEP)
        solver.setType(SLEPc.EPS.Type.LANCZOS)
        solver.setLanczosReorthogType(SLEPc.EPS.LanczosReorthogType.FULL)
        solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
        solver.setDimensions(1)
        solver.setTolerances(tol=1e-4)
        start = shell.createVecRight()
        start.array = root * (1 + np.sin(np.arange(rows)))  # the same on every rank, no symmetry
        solver.setInitialSpace(start)
        solver.solve()
        assert solver.getConverged() > 0
        return float(solver.getEigenvalue(0).real + solver.computeError(0, SLEPc.EPS.ErrorType.ABSOLUTE))
