"""The bodies as the sparse matrix K_B, uncondensed: what the block system [[F', B^T], [B, -C]] is assembled from.

Nothing is factorised before the first solve, so that a method can first say how its inner solves are done.
"""

from __future__ import annotations

from functools import cached_property, partial

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Mat, Sparse, Vec
from stickslip.solvers.interface.flexibility import DelassusOperator, Load, T
from stickslip.solvers.linear.multigrid import multigrid
from stickslip.solvers.linear.petsc_solver import InnerSolver, PetscOptions
from stickslip.solvers.parallel.replicated import Replicated, on_all_ranks
from stickslip.solvers.parallel.serialise import Plain
from stickslip.solvers.system.floating_modes import FloatingMotions, near_nullspace
from stickslip.solvers.system.system import System

PREFIX = "block_fieldsplit_u_"  # of PETSc's options: that of the split u of the block system


class SparseVolume:
    """K_B and its inner solver. A floating body lies on springs at its contact dofs, for the scales of a step only."""

    def __init__(self, system: System) -> None:
        """Take K_B over; collective."""
        self.counters, self.K = system.counters, system.K_B
        self.contact = Replicated(self.K.createVecRight(), system.interface.dofs)
        self.floating = FloatingMotions(system, self.contact, system.interface.rigid_modes)
        self.iterative = False  # inner solves by conjugate gradients with multigrid; set before the first solve
        self.options: PetscOptions | None = None  # of the user; likewise
        self._multigrid = partial(
            multigrid, nodal=system.mesh.simplicial, motions=partial(near_nullspace, system), prefix=PREFIX
        )

    @cached_property
    def solver(self) -> InnerSolver:
        """Of K_B, or of floating bodies on springs; set up at the first access."""
        return self.inner_solver(self._held)

    def inner_solver(self, V: Mat) -> InnerSolver:
        """Of K_B, or of a matrix of its kind; collective."""
        cycles = self._multigrid if self.iterative else None
        return InnerSolver(V, PREFIX, self.counters, multigrid=cycles, options=self.options)

    @cached_property
    def _held(self) -> Mat:
        if not self.floating.R.shape[1]:
            return self.K
        springs, held = self.K.createVecRight(), self.K.copy()
        springs.array[self.contact.local] = self.K.getDiagonal().array[self.contact.local]
        held.setDiagonal(held.getDiagonal() + springs)
        return held

    def release(self) -> None:
        """Nothing to free before the end: PETSc's objects go with this one."""

    def snapshot(self) -> None:
        """Nothing is learnt from solve to solve; see `restore`."""

    def restore(self, snapshot: None) -> None:
        """Nothing to take up."""


class SparseSurface(DelassusOperator):
    """The Delassus operator by solves with K_B; `q` is the displacement that the last solve left."""

    def __init__(self, volume: SparseVolume, *, N: Sparse, W: Array, R: Array, normal_rows: int, driven: int = 0):
        """See `DelassusOperator`."""
        super().__init__(N=N, W=W, R=R, normal_rows=normal_rows, driven=driven, counters=volume.counters)
        self.volume = volume
        self.rho = 1.0
        self.q: Vec = volume.K.createVecRight()

    @property
    def exact(self) -> bool:  # type: ignore[override]
        return not self.volume.iterative

    def load(self, f_q: Vec, driving: Array, error: float = 0.0) -> Load:
        resultant = np.concatenate([self.volume.floating.resultant(f_q.array_r), driving])
        free = f_q.duplicate()
        self.volume.solver.solve(f_q, free)
        return Load(
            f_q=f_q, driving=driving, f_c=self.R @ resultant, resultant=resultant, free=self.volume.contact.read(free)
        )

    def displacement(self, force: Array, error: float = 0.0) -> Array:
        f = self.q.duplicate()
        self.volume.contact.write(f, force)
        found = f.duplicate()
        self.volume.solver.solve(f, found)
        return self.volume.contact.read(found)

    def under(self, load: Load, p: Array, error: float = 0.0) -> Array:
        f = load.f_q.duplicate()
        self.volume.contact.write(f, -self.forces(p))
        self.volume.solver.solve(f + load.f_q, self.q)
        return self.volume.contact.read(self.q)

    def recover(self, load: Load, p: Array, u_c: Array) -> Vec:
        """The displacement of the last solve: the method has made it as exact as its inner solver can, and says so."""
        return self.q.copy()

    def agreed(self, value: T) -> T:
        """The value of rank 0: solves are collective, so if ranks stopped at different iterations they would hang."""
        return on_all_ranks(self.volume.K.comm.tompi4py(), value)

    def adopt(self, other: DelassusOperator) -> None:
        assert isinstance(other, SparseSurface)
        self.q = other.q

    def snapshot(self) -> dict[str, Plain]:
        return {}

    def restore(self, snapshot: dict[str, Plain]) -> None:
        """Nothing to take up: each step starts from the state alone."""
