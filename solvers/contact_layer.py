"""The layer of cells next to the contact sides, cut off and held below: what bodies give at the scale of the mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy import sparse

from solvers.sparse_cholesky import SparseCholesky
from solvers.system import System

Array = NDArray[np.float64]
BED = 1e-2  # of the stiffness of a contact dof: springs in case that the layer is the whole of a body that floats


class ContactLayer:
    """Displacement of the contact dofs that forces there cause in the layer alone, a lower bound of the bodies' own.

    Corners and edges of the sides, graded cells, the normal displacement of tangential forces: all that happens within
    a few cells is in it. Every rank has the whole layer.
    """

    def __init__(self, system: System, cells: int) -> None:
        """Cut it out and factorise it; collective.

        Args:
            cells: how many of them one below the other.
        """
        contact = np.asarray(system.contact_dofs, PETSc.IntType)
        layer = PETSc.IS().createGeneral(contact, comm=PETSc.COMM_SELF)
        system.K_B.increaseOverlap(layer, cells)
        layer.sort()
        (cut,) = system.K_B.createSubMatrices([layer], [layer])
        indptr, indices, data = cut.getValuesCSR()
        self._at = np.searchsorted(layer.getIndices(), contact)
        K = sparse.csr_matrix((data, indices, indptr), shape=cut.getSize())
        springs = np.zeros(K.shape[0])
        if len(springs) and system.rigid_modes().shape[1]:
            springs[self._at] = BED * K.diagonal()[self._at]
        self._factor = SparseCholesky(K + sparse.diags(springs))
        self._size = K.shape[0]

    def __call__(self, force: Array) -> Array:
        """Displacement [m] under forces (c,) or (c, k) [N]."""
        whole = np.zeros((self._size, *force.shape[1:]))
        whole[self._at] = force
        return self._factor.solve(whole)[self._at]
