"""Cholesky factors of sparse positive definite matrices on one rank, and inverse square roots by a few of them.

CHOLMOD is three times as fast as SuperLU here. Where PETSc comes without it, MUMPS factorises.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy import sparse
from scipy.special import ellipj, ellipkm1

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


def poles(low: float, high: float, count: int) -> tuple[Array, Array]:
    """Poles of the rational approximation x^(-1/2) = sum_j v_j / (x + t_j²) on [low, high].

    The relative error falls like exp(-2 pi² count / (log(high / low) + 3)).

    Args:
        low, high: ends of the interval, 0 < low < high.
        count: number of poles.

    Returns:
        The weights v and the shifts t², (count,) each, all positive.

    Source: Hale, Higham & Trefethen, SIAM J. Numer. Anal. 46 (2008), method 3.
    """
    ratio = low / high
    period = ellipkm1(ratio)  # K(1 - ratio), exact for small ratios
    at = (np.arange(count) + 0.5) * period / count
    sn, cn, dn, _ = ellipj(at, 1 - ratio)
    return 2 * period * np.sqrt(low) / (np.pi * count) * dn / cn**2, low * (sn / cn) ** 2


class InverseRoot:
    """The map x -> A^(-1/2) x, symmetric and positive definite; one sparse factorisation for each shift."""

    def __init__(self, A: Sparse, low: float, count: int = 3) -> None:
        """
        Args:
            A: (n, n) symmetric, positive definite.
            low: lower bound of the eigenvalues of A, > 0.
            count: number of shifts.
        """
        high = float(abs(A).sum(axis=1).max()) if A.shape[0] else low
        self.weights, self.shifts = poles(low, max(high, 2 * low), count)
        identity = sparse.eye(A.shape[0], format="csr")
        self._factors = [SparseCholesky(A + shift * identity) for shift in self.shifts]

    def __call__(self, x: Array) -> Array:
        """A^(-1/2) x for x (n,) or (n, k)."""
        total = np.zeros_like(x)
        for weight, factor in zip(self.weights, self._factors, strict=True):
            total += weight * factor.solve(x)
        return total
