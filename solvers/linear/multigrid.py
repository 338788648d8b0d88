"""Algebraic multigrid for elasticity: a preconditioner for a stiffness matrix, set up once.

On 108 k unknowns (hexahedra, one core) BoomerAMG is set up in 0.35 s and needs 19 iterations of 0.057 s for 8 digits;
GAMG 2.2 s and 19 of 0.055 s: it pays only after four such solves, and for order 2 never.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import PC, Mat

HYPRE: bool = PETSc.Sys.hasExternalPackage("hypre")  # PyPI's wheels of dolfinx come without
BOOMERAMG: dict[str, str | float] = {
    "type": "boomeramg",
    "boomeramg_coarsen_type": "HMIS",
    "boomeramg_interp_type": "ext+i",
    "boomeramg_agg_nl": 1,
    # weights below this share of their row's largest are left out, or coarse levels become dense: with 1e6 unknowns of
    # hexahedra set-up takes half the time and a cycle four fifths; iterations stay as many
    "boomeramg_truncfactor": 0.3,
    # Gauss-Seidel forward on the way down, backward on the way up: symmetric, at half the cost of both each way. What
    # other ranks have is as in Jacobi's iteration, and diverges without l1 where cuts between ranks are rugged.
    "boomeramg_relax_type_down": "l1-Gauss-Seidel",
    "boomeramg_relax_type_up": "backward-l1-Gauss-Seidel",
    "boomeramg_no_CF": 1,  # all nodes in one sweep: as many iterations as coarse nodes first, of 4/5 the time
}
STRONG = {2: 0.25, 3: 0.7}  # threshold of strong couplings, by dimension
# Of tetrahedra coarse levels keep whole nodes, or they become dense: a cycle takes half the time, set-up a third to a
# half, and iterations are as many or a fifth more. Hexahedra would take up to four times as many.
NODAL: dict[str, str | float] = {"boomeramg_nodal_coarsen": 4, "boomeramg_strong_threshold": 0.5}  # by row sums
GAMG: Mapping[str, str | int] = {"ksp_max_it": 1}  # of the smoother: more, but cheaper, iterations


def multigrid(K: Mat, nodal: bool, motions: Callable[[], Array], prefix: str, changing: bool = False) -> PC:
    """BoomerAMG where PETSc has hypre, else GAMG; collective.

    Args:
        K, nodal, prefix: see `boomeramg`.
        motions: makes those of `gamg` where they are needed.
        changing: whether K changes later: multigrid then keeps a matrix of its own.
    """
    if not HYPRE:
        return gamg(K.copy() if changing else K, motions(), prefix)
    if changing:  # in hypre's own storage, of which multigrid takes no copy
        size, K = K.block_size, K.convert(PETSc.Mat.Type.HYPRE, PETSc.Mat())
        K.setBlockSize(size)
    return boomeramg(K, nodal, prefix)


def boomeramg(K: Mat, nodal: bool, prefix: str) -> PC:
    """Classical multigrid (hypre) as a PETSc preconditioner, set up; collective.

    Args:
        K: stiffness matrix; its block size is the dimension.
        nodal: in 3D, whether coarse levels keep whole nodes, as is best for tetrahedra.
        prefix: of the PETSc options of this preconditioner, ends with an underscore.
    """
    options = BOOMERAMG | {"boomeramg_strong_threshold": STRONG[K.block_size]}
    options |= NODAL if nodal and K.block_size == 3 else {}
    return _set_up(K, "hypre", prefix, {f"pc_hypre_{key}": value for key, value in options.items()})


def gamg(K: Mat, motions: Array, prefix: str) -> PC:
    """Smoothed aggregation (PETSc) whose coarse spaces contain the rigid modes, set up; collective.

    Args:
        K: stiffness matrix.
        motions: this rank's part (owned, k) of the rigid modes, linearly independent.
        prefix: of the PETSc options of this preconditioner, ends with an underscore.
    """
    factor = np.linalg.cholesky(K.comm.tompi4py().allreduce(motions.T @ motions))
    vectors = []
    for column in np.linalg.solve(factor, motions.T):  # orthonormal
        vectors.append(K.createVecRight())
        vectors[-1].array[:] = column
    K.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=K.comm))
    return _set_up(K, "gamg", prefix, {f"mg_levels_{key}": value for key, value in GAMG.items()})


def _set_up(K: Mat, kind: str, prefix: str, options: Mapping[str, str | int | float]) -> PC:
    known = PETSc.Options()
    ours = {f"{prefix}{key}": value for key, value in options.items() if not known.hasName(f"{prefix}{key}")}
    for name, value in ours.items():  # what a user has set stays
        known[name] = value
    pc = PETSc.PC().create(K.comm)
    pc.setOptionsPrefix(prefix)
    pc.setType(kind)
    pc.setOperators(K)
    try:
        pc.setFromOptions()
        pc.setUp()
    finally:
        for name in ours:
            del known[name]
    pc.setReusePreconditioner(True)  # also where another multigrid changes K in place, and restores it
    return pc
