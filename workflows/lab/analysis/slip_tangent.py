"""The tangent K = K_B + Σ K_C^s of the published contact elements on all displacements: in slip it is unsymmetric."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.classical.contact_element import ContactElements, held_from
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.solvers.system.system import System


@dataclass(frozen=True, kw_only=True)
class SlipTangent:
    """The tangent matrix of Newton-Raphson at a solved step; on one rank.

    Source: Pop (1999), (4.4)-(4.5).
    """

    K_B: Sparse  # (n, n) [N/m]
    N: Sparse  # (rows, n), displacement to gaps
    slope: Sparse  # Σ*' (rows, rows) [N/m]
    omega: Array  # (rows,) [N/m], penalties
    status: Ints  # (rows,) OPEN, STICK or SLIP
    force: Array  # (n,) [N], of contact on the bodies

    @staticmethod
    def at(system: System, accepted: Accepted, omega: Array) -> SlipTangent:
        """The tangent at a solved step.

        Args:
            system: the assembled scene.
            accepted: the step, solved by the perturbed Lagrangian with the same `omega`, not augmented.
            omega: penalties (rows,) [Pa/m].
        """
        problem = accepted.problem
        elements = ContactElements.of(problem, omega, held_from(problem, accepted.substep_start.p))
        answer = elements.answer(accepted.state.w - elements.reference)
        indptr, indices, data = system.K_B.getValuesCSR()
        K_B = sparse.csr_matrix((data, indices, indptr), shape=system.K_B.size)
        c = len(system.interface.dofs)
        onto = sparse.csr_matrix((np.ones(c), (np.arange(c), system.interface.dofs)), shape=(c, K_B.shape[0]))
        N = problem.surface.N[:, :c] @ onto
        force = -np.asarray(N.T @ (problem.surface.W * accepted.state.p))
        return SlipTangent(K_B=K_B, N=N, slope=answer.slope, omega=elements.omega, status=answer.status, force=force)

    @property
    def of_displacements(self) -> tuple[Sparse, Array]:
        """K_B + N^T Σ*' N (n, n), with ΔΣ eliminated, and a right-hand side (n,): the forces of contact."""
        return (self.K_B + self.N.T @ self.slope @ self.N).tocsr(), self.force

    @property
    def of_both(self) -> tuple[Sparse, Array]:
        """The same system with the unknowns (ΔU, ΔΣ) (n + rows,), as in (4.5) and (5.3)."""
        flexible = sparse.diags(1 / self.omega)
        whole = sparse.bmat([[self.K_B, self.N.T], [flexible @ self.slope @ self.N, -flexible]], format="csr")
        whole.eliminate_zeros()  # as the sum above does: an incomplete factor depends on the pattern
        return whole, np.concatenate([self.force, np.zeros(len(self.omega))])

    def share(self, *status: int) -> float:
        """Part of the rows whose status is one of those named: OPEN, STICK, SLIP."""
        return float(np.isin(self.status, status).mean())


def unsymmetry(K: Sparse) -> float:
    """||K - K^T|| / ||K|| in the Frobenius norm."""
    return float(sparse.linalg.norm(K - K.T) / sparse.linalg.norm(K))
