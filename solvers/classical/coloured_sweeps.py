"""Gauss-Seidel by colours: contacts that do not move each other directly are answered together.

W of a discrete problem is sparse: two contacts are coupled if they act on the same body. Contacts of one colour are not
coupled, so that one array operation answers all of them, to the numbers that one after the other would give.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import EXACT, Array, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.classical.sweeps import sweep_until_solved
from stickslip.solvers.contact.admissible_set import project_disc
from stickslip.solvers.interface.discrete import DiscreteProblem
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.newton.solution import OnStep, Solution, ignore

STALL_WINDOW = 20000  # sweeps in which the smallest residual must halve; plateaus of 2000 were seen
CLOSE, FEW = 10, 5  # the residual is measured after each of the first CLOSE sweeps, then after every FEW


@dataclass(frozen=True)
class Colour:
    """Contacts of one colour."""

    rows: Ints  # (k, d) of W
    W: Sparse  # (k d, rows) those rows of W
    q: Array  # (k, d)
    mu: Array  # (k,)
    push: Array  # (k, d-1) change of u_T with r_n
    rho_n: Array  # (k,) inverse of the flexibility along the normal
    rho_T: Array  # (k, 1) inverse of the largest flexibility across

    def answer(self, r: Array) -> None:
        """Give the contacts, in r (rows,), normal reactions that their u_n asks for, then friction within mu r_n."""
        old = r[self.rows]
        u = (self.W @ r).reshape(old.shape) + self.q
        new = np.empty_like(old)
        new[:, 0] = np.maximum(old[:, 0] - self.rho_n * u[:, 0], 0.0)
        u_T = u[:, 1:] + self.push * (new[:, 0] - old[:, 0])[:, None]
        new[:, 1:] = project_disc(old[:, 1:] - self.rho_T * u_T, self.mu * new[:, 0])
        r[self.rows] = new


@dataclass(frozen=True, kw_only=True)
class ColouredSweeps:
    """Non-smooth Gauss-Seidel on a discrete problem; `Sweeps` of `nsgs` is the same on a dense operator.

    A contact's normal reaction is exact for its present u_T; its friction is one projected step of size
    1 / lambda_max of its own tangential block, which is exact in 2D.
    """

    rtol: float
    max_it: int

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        assert isinstance(problem, DiscreteProblem)
        N, colours = problem.surface.N, coloured(problem)
        r = np.asarray(N.T @ p)

        def sweep() -> None:
            for colour in colours:
                colour.answer(r)

        return sweep_until_solved(
            problem,
            lambda: np.asarray(N @ r),
            sweep,
            rtol=self.rtol,
            max_it=self.max_it,
            window=STALL_WINDOW,
            on_step=on_step,
            looks=lambda k: k <= CLOSE or k % FEW == 0,
        )


def coloured(problem: DiscreteProblem) -> list[Colour]:
    """The contacts by colour."""
    surface, d = problem.surface, problem.dim
    own = _own_blocks(surface.matrix, d)
    give_n, give_T = own[:, 0, 0], np.linalg.eigvalsh(own[:, 1:, 1:])[:, -1]
    # smallest flexibility of a contact, relative to the largest: for contacts that move nothing
    least = EXACT * max(give_n.max(), give_T.max()) or 1.0
    rho_n, rho_T = 1 / np.maximum(give_n, least), 1 / np.maximum(give_T, least)[:, None]
    found, q = [], problem.q.reshape(-1, d)
    for members in colours(surface.matrix, d):
        rows = members[:, None] * d + np.arange(d)
        push, W = own[members, 1:, 0], surface.matrix[rows.ravel()]
        found.append(Colour(rows, W, q[members], problem.mu[members], push, rho_n[members], rho_T[members]))
    return found


def colours(W: Sparse, d: int) -> list[Ints]:
    """Sets of contacts, none coupled by W (rows, rows) to another of its set: greedy, most coupled first.

    >>> [set.tolist() for set in colours(sparse.csr_matrix(np.eye(4) + np.eye(4, k=2) + np.eye(4, k=-2)), 2)]
    [[0], [1]]
    """
    entries = W.tocoo()
    m = W.shape[0] // d
    coupled = sparse.csr_matrix((np.ones(entries.nnz), (entries.row // d, entries.col // d)), shape=(m, m))
    coupled.sum_duplicates()
    colour = np.full(m, -1)
    for contact in np.argsort(-np.diff(coupled.indptr), kind="stable"):
        taken = set(colour[coupled.indices[coupled.indptr[contact] : coupled.indptr[contact + 1]]])
        colour[contact] = next(k for k in range(m) if k not in taken)
    return [np.flatnonzero(colour == k) for k in range(colour.max(initial=-1) + 1)]


def _own_blocks(W: Sparse, d: int) -> Array:
    """Diagonal blocks (contacts, d, d) of W."""
    entries = W.tocoo()
    own = entries.row // d == entries.col // d
    row, column = entries.row[own], entries.col[own]
    blocks = np.zeros((W.shape[0] // d, d, d))
    blocks[row // d, row % d, column % d] = entries.data[own]
    return blocks
