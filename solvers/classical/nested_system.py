"""One semismooth Newton system as the nested block system [[F', B^T], [B, -C]] of its active set, solved by a KSP.

Rows of open points and of slip are in place of those of B and -C; all others are those of the source, (5.3).
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from stickslip.geometry.arrays import HALF_DIGITS, Array, Ints
from stickslip.geometry.errors import SolverError
from stickslip.geometry.protocols import Mat, Sparse, Vec
from stickslip.solvers.classical.block_system import BlockSystem
from stickslip.solvers.classical.nest import backward_error, nested, solve
from stickslip.solvers.linear.inner_solver import direct, failure
from stickslip.solvers.linear.petsc_options import PetscOptions
from stickslip.solvers.newton.active_set import ActiveSet


class NestedSystem:
    """Solves the linearised laws together with the bodies on the free displacements; `q` is the last answer."""

    def __init__(self, blocks: BlockSystem, q: Vec, options: PetscOptions, rtol: float) -> None:
        """
        Args:
            blocks: begun for the step.
            q: free displacements [m], in place.
            options: of PETSc, by the user.
            rtol: tolerance of the step.
        """
        self.blocks, self.q, self.options = blocks, q, options
        # backward error, and relative force out of balance, above which the linear system counts as singular
        self.enough = min(HALF_DIGITS, rtol)
        self.u_c: Array | None = None  # of the last answer, the same object as it returned
        self.direct = True  # whether all solves were by a factor

    def __call__(self, laws: ActiveSet, u_c: Array) -> tuple[Array, Array]:
        """Tractions (rows,) [Pa] and displacement of the contact dofs (c,) [m]; collective. It does not use `u_c`.

        Raises:
            LinAlgError: the active set leaves a rigid mode free.
            SolverError: the KSP did not converge.
        """
        blocks, problem, surface = self.blocks, laws.problem, laws.problem.surface
        multipliers = blocks.multipliers
        m = multipliers.rows
        on = np.zeros(len(surface.W), bool)
        on[m] = True
        faces = np.flatnonzero(~on)  # compliant rows: p = rhs + k w
        A_p, k = laws.A_p[m], laws.k
        through = A_p[:, faces] @ sparse.diags(k[faces])
        A_w = laws.A_w[m] + _in_columns(through, faces, len(surface.W))
        right = laws.rhs[m] - A_p[:, faces] @ laws.rhs[faces] - A_w @ problem.offset
        soft = k[m] > 0
        # rows of B where points are closed, and of -C where they are open or stick elastically: symmetric but for slip
        scale = surface.W[m] * np.where(soft, -1 / np.where(soft, k[m], 1.0), 1 / problem.gamma[m])
        scale *= np.where(~soft & laws.given[m], -1.0, 1.0)
        V = blocks.inner.with_springs(np.where(on, 0.0, k))
        L = blocks.on_free(sparse.diags(scale) @ A_w @ surface.N)
        M = multipliers.matrix(sparse.diags(scale) @ A_p[:, m], multipliers.like)
        nest = nested(V, blocks.B_T, L, M)
        resting = np.where(on, 0.0, laws.rhs + k * problem.offset)  # p of compliant faces at u = 0
        f, g = problem.load.f_q - blocks.inner.on_contact(surface.forces(resting)), multipliers.like.duplicate()
        multipliers.at.write(g, scale * right)
        x, y = self.q, multipliers.like.duplicate()
        self._solve(nest, (f, g), (x, y))
        self.u_c = u_c = blocks.inner.contact.read(x)
        p = np.where(on, 0.0, laws.rhs + k * problem.relative_displacement(u_c))
        p[m] = multipliers.at.read(y)
        given = laws.given & on
        p[given] = 0.0  # exact zeros: the diagonal of A_p is 1 there
        p[given] = (laws.rhs - laws.A_p @ p)[given]
        self._check_balance(laws, p)
        return p, u_c

    def _solve(self, nest: Mat, right: tuple[Vec, Vec], found: tuple[Vec, Vec]) -> None:
        counters = self.blocks.surface.counters
        try:
            ksp = solve(nest, right, found, self.options)
        except PETSc.Error as error:
            raise SolverError(f"the KSP of the block system cannot be set up: PETSc error {error.ierr}") from None
        counters.factorisations += 1
        counters.volume_solves += 1
        if backward_error(nest, right, found) <= self.enough:
            self.direct = self.direct and direct(ksp)
            counters.linear_iterations += 0 if direct(ksp) else ksp.getIterationNumber()
        elif direct(ksp):
            raise np.linalg.LinAlgError("the block system is singular: some rigid motion is not held")
        else:
            raise SolverError(f"the block system is not solved to {self.enough:g}: {failure(ksp)}; try -ksp_rtol")

    def _check_balance(self, laws: ActiveSet, p: Array) -> None:
        """Raise if the tractions p (rows,) [Pa] do not balance the load of a floating body."""
        surface, load = laws.problem.surface, laws.problem.load.resultant
        held = surface.R.T @ surface.forces(p)
        if np.abs(load - held).sum() > HALF_DIGITS * (np.abs(load).sum() + np.abs(surface.forces(p)).sum()):
            raise np.linalg.LinAlgError("the system is singular: some rigid motion is not held")


def _in_columns(block: Sparse, columns: Ints, count: int) -> Sparse:
    """The matrix (m, count) with the columns of `block` at the given places, zero elsewhere."""
    entries = block.tocoo()
    shape = block.shape[0], count
    found: Sparse = sparse.csr_matrix((entries.data, (entries.row, columns[entries.col])), shape=shape)
    return found
