"""A sparse matrix that every rank has whole, as a distributed PETSc matrix; no communication."""

from __future__ import annotations

from petsc4py import PETSc

from stickslip.geometry.protocols import Mat, Sparse, Vec


def distributed(whole: Sparse, rows: Vec, columns: Vec) -> Mat:
    """The PETSc matrix; each rank keeps its own rows.

    Args:
        whole: (m, n).
        rows: a vector with the layout of the rows.
        columns: a vector with the layout of the columns.
    """
    low, high = rows.getOwnershipRange()
    own = whole.tocsr()[low:high]
    sizes = (rows.getLocalSize(), rows.getSize()), (columns.getLocalSize(), columns.getSize())
    csr = own.indptr, own.indices.astype(PETSc.IntType), own.data
    matrix: Mat = PETSc.Mat().createAIJ(sizes, csr=csr, comm=columns.comm)
    matrix.assemble()
    return matrix
