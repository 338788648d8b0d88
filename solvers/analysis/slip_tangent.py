"""K = K_B + Σ K_C^s of the published contact elements on all displacements: in slip it is unsymmetric."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from geometry.arrays import Array, Ints
from solvers.methods.contact_element import ContactElements
from solvers.stepping.stepper import Accepted
from solvers.system.system import System


@dataclass(frozen=True)
class SlipTangent:
    """The matrix that Newton-Raphson meets at a solved step; on one rank.

    Source: Pop (1999), (4.4)-(4.5).
    """

    K_B: Any  # (n, n) sparse [N/m]
    N: Any  # (rows, n) displacement to gaps, sparse
    slope: Any  # Σ*' (rows, rows), sparse [N/m]
    omega: Array  # (rows,) [N/m]
    status: Ints  # (rows,)
    force: Array  # (n,) [N] with which contact acts

    @staticmethod
    def at(system: System, accepted: Accepted, omega: Array) -> SlipTangent:
        """
        Args:
            accepted: the step, solved by the perturbed Lagrangian with the same `omega` (rows,) [Pa/m].
        """
        problem = accepted.problem
        elements = ContactElements.of(problem, omega, accepted.substep_start.p)
        answer = elements.answer(accepted.state.w - elements.reference)
        indptr, indices, data = system.K_B.getValuesCSR()
        K_B = sparse.csr_matrix((data, indices, indptr), shape=system.K_B.size)
        c = len(system.interface.dofs)
        onto = sparse.csr_matrix((np.ones(c), (np.arange(c), system.interface.dofs)), shape=(c, K_B.shape[0]))
        N = problem.surface.N[:, :c] @ onto
        force = -np.asarray(N.T @ (problem.surface.W * accepted.state.p))
        return SlipTangent(K_B, N, answer.slope, elements.omega, answer.status, force)

    @property
    def of_displacements(self) -> tuple[Any, Array]:
        """K_B + N^T Σ*' N (n, n) with ΔΣ eliminated, and a right-hand side (n,): the forces of contact."""
        return (self.K_B + self.N.T @ self.slope @ self.N).tocsr(), self.force

    @property
    def of_both(self) -> tuple[Any, Array]:
        """The same before: unknowns (ΔU, ΔΣ), as (4.5) and (5.3) have them."""
        flexible = sparse.diags(1 / self.omega)
        whole = sparse.bmat([[self.K_B, self.N.T], [flexible @ self.slope @ self.N, -flexible]], format="csr")
        whole.eliminate_zeros()  # as a sum does above: an incomplete factor lives by the pattern
        return whole, np.concatenate([self.force, np.zeros(len(self.omega))])

    def share(self, *status: int) -> float:
        """Of the rows, how many have one of these: OPEN, STICK, SLIP."""
        return float(np.isin(self.status, status).mean())


def unsymmetry(K: Any) -> float:
    """|K - K^T| / |K|, by Frobenius."""
    return float(sparse.linalg.norm(K - K.T) / sparse.linalg.norm(K))
