"""Cholesky factor of a sparse positive definite matrix on one rank, for many solves.

CHOLMOD is three times as fast as SuperLU here. Where PETSc comes without it, MUMPS factorises.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import MachineError
from stickslip.geometry.protocols import PC, Sparse

CHOLMOD = any(PETSc.Sys.hasExternalPackage(name) for name in ("cholmod", "suitesparse"))  # its name differs by version
SOLVER = "cholmod" if CHOLMOD else "mumps"  # PyPI's wheels of dolfinx come without


class SparseCholesky:
    """The map x -> A^-1 x."""

    def __init__(self, A: Sparse) -> None:
        """
        Args:
            A: (n, n) symmetric, positive definite; n = 0 where nothing touches, which CHOLMOD refuses.

        Raises:
            MachineError: A cannot be factorised.
        """
        A = sparse.csr_matrix(A)
        A.sum_duplicates()
        rows = (A.indptr.astype(PETSc.IntType), A.indices.astype(PETSc.IntType), A.data)
        matrix = PETSc.Mat().createAIJ(A.shape, csr=rows, comm=PETSc.COMM_SELF)
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._pc: PC = PETSc.PC().create(PETSc.COMM_SELF)
        self._pc.setOptionsPrefix("surface_")
        self._pc.setOperators(matrix)
        self._pc.setType("cholesky")
        self._pc.setFactorSolverType(SOLVER)
        try:
            if A.shape[0]:
                self._pc.setUp()
        except PETSc.Error as error:
            raise MachineError(f"a factorisation on the surface failed: PETSc error {error.ierr}") from None
        self._in, self._out = matrix.createVecRight(), matrix.createVecLeft()

    def solve(self, x: Array) -> Array:
        """A^-1 x for x (n,) or (n, k)."""
        found = np.empty_like(x)
        if not len(x):
            return found
        for column, into in zip(x.reshape(len(x), -1).T, found.reshape(len(x), -1).T, strict=True):
            self._in.array[:] = column
            self._pc.apply(self._in, self._out)
            into[:] = self._out.array_r
        return found
