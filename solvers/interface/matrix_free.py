"""The Delassus operator matrix-free: each application of K_B^-1 is an iterative solve over the bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
from mpi4py import MPI

from stickslip.geometry.arrays import EXACT, Array
from stickslip.geometry.protocols import PC, Mat, Sparse, Vec
from stickslip.solvers.interface.flexibility import DelassusOperator, Load, T
from stickslip.solvers.linear.conjugate_gradients import (
    ConjugateGradients,
    ContactErrorCriterion,
    EnergyErrorCriterion,
    ResidualCriterion,
    StoppingCriterion,
)
from stickslip.solvers.linear.multigrid import multigrid
from stickslip.solvers.parallel.replicated import Replicated, on_all_ranks
from stickslip.solvers.parallel.serialise import Own, Plain
from stickslip.solvers.system.floating_modes import FloatingMotions, near_nullspace
from stickslip.solvers.system.system import System


class IterativeVolume:
    """Solves K_B v = f by conjugate gradients with multigrid.

    Forces on a floating body are balanced first, and its rigid modes are removed from the solution: R^T v_c = 0.
    """

    def __init__(self, system: System) -> None:
        """Take K_B over; collective."""
        self.counters = system.counters
        self.K: Mat = system.K_B
        K = self.K
        self.contact = Replicated(K.createVecRight(), system.interface.dofs)
        self.floating = FloatingMotions(system, self.contact, system.interface.rigid_modes)
        diagonal = self.contact.read(K.getDiagonal())
        self.stiffness = float(diagonal.mean()) if len(diagonal) else 1.0
        self.tolerance = system.problem.solver.tolerance
        self._multigrid = _FloatingMultigrid(system, self.contact, self.floating, self.stiffness)
        self._cg = ConjugateGradients(K, self._multigrid, self.counters)

    def widened(self, system: System) -> IterativeVolume:
        """The same bodies with the contact dofs of a system that has more of them; multigrid stays; collective."""
        other = copy(self)
        other.contact = Replicated(self.K.createVecRight(), system.interface.dofs)
        other.floating = FloatingMotions(system, other.contact, system.interface.rigid_modes)
        other._multigrid = copy(self._multigrid)
        other._multigrid._floating = other.floating
        other._cg = ConjugateGradients(self.K, other._multigrid, self.counters)
        return other

    def remember(self, most: int) -> None:
        """Forget the search directions, and store up to `most` of them from now on."""
        self._cg.remember(most)

    @contextmanager
    def loosely(self, tolerance: float) -> Iterator[None]:
        """Another tolerance inside the block; the search directions found there are forgotten after it."""
        usual, self.tolerance = self.tolerance, tolerance
        try:
            with self._cg.apart(12):  # search directions
                yield
        finally:
            self.tolerance = usual

    def release(self) -> None:
        """Free the memory; no solve is possible after that; collective."""
        self._multigrid.release()
        self.remember(1)

    def snapshot(self) -> dict[str, Plain]:
        """The stored search directions; see `restore`."""
        return self._cg.directions.snapshot()

    def restore(self, snapshot: dict[str, Plain]) -> None:
        """Take the search directions of a `snapshot` of the same bodies."""
        self._cg.directions.restore(snapshot)

    def solve_contact(self, f: Vec, v: Vec, error: float, relative: float) -> None:
        """Improve v until the error of its contact dofs is small; collective.

        Args:
            f: forces over the free dofs [N].
            v: displacement [m]: the start, then the solution.
            error, relative: see `ContactErrorCriterion`.
        """
        local, response = self.contact.local, self._cg.directions.response
        self._solve(
            f,
            v,
            ContactErrorCriterion(
                comm=self._cg.comm, local=local, error=error, relative=relative, response=lambda: response(local)
            ),
        )

    def solve_energy(self, f: Vec, v: Vec, relative: float) -> float:
        """Improve v until its error in energy norm is below `relative`; returns the estimated error; collective."""
        criterion = EnergyErrorCriterion(self._cg.comm, f.array, relative)
        self._solve(f, v, criterion)
        return criterion.reached

    def solve_residual(self, f: Vec, v: Vec, allowed: Callable[[float], float]) -> None:
        """Improve v until its residual is small, see `ResidualCriterion`; collective."""
        self._solve(f, v, ResidualCriterion(allowed))

    def _solve(self, f: Vec, v: Vec, criterion: StoppingCriterion) -> None:
        forces = f.array.copy()
        self.floating.balance(forces)
        if self._cg.comm.allreduce(bool(forces.any()), op=MPI.LOR):
            self._cg.solve(forces, v.array, criterion)
            self.floating.pin(v.array)
        else:  # relative to a zero solution, no error is small
            v.array[:] = 0.0
        self.counters.volume_solves += 1


class _FloatingMultigrid:
    """Multigrid between `balance` and `pin`, which are transposes: symmetric."""

    def __init__(self, system: System, contact: Replicated, floating: FloatingMotions, stiffness: float) -> None:
        self._system, self._contact, self._floating, self._stiffness = system, contact, floating, stiffness

    def __call__(self, r: Vec, z: Vec) -> None:
        """Write z = M^-1 r; r changes by rounding only; collective."""
        self._floating.balance(r.array)
        self._multigrid.apply(r, z)
        self._floating.pin(z.array)

    def release(self) -> None:
        """Free the memory; collective."""
        if "_multigrid" in vars(self):
            self._multigrid.destroy()

    @cached_property
    def _multigrid(self) -> PC:
        """Set up at the first solve: a method that needs none does without."""
        K, nodal = self._bedded(self._system.K_B), self._system.mesh.simplicial
        return multigrid(K, nodal, lambda: near_nullspace(self._system), "volume_")

    def _bedded(self, K: Mat) -> Mat:
        """K_B itself; if bodies float, a copy with springs at the contact dofs."""
        if not self._floating.R.shape[1]:
            return K
        springs, bedded = K.createVecRight(), K.copy()
        # of the stiffness of a contact dof: springs under floating bodies, in the multigrid matrix alone
        springs.array[self._contact.local] = 1e-2 * self._stiffness
        bedded.setDiagonal(bedded.getDiagonal() + springs)
        return bedded


SHARE = 0.1  # of the scene's tolerance: relative error of the accepted displacement, in energy norm


class MatrixFreeSurface(DelassusOperator):
    """The Delassus operator with K_B^-1 by conjugate gradients, each started from the last solution.

    The rigid motion of a floating body is known without iteration, b = R^T f / rho; conjugate gradients find the
    deformation.
    """

    def __init__(
        self, volume: IterativeVolume, *, N: Sparse, W: Array, R: Array, normal_rows: int, driven: int = 0
    ) -> None:
        """See `DelassusOperator`."""
        super().__init__(N=N, W=W, R=R, normal_rows=normal_rows, driven=driven, counters=volume.counters)
        self.volume = volume
        self.rho = volume.stiffness
        self._last: Vec = volume.K.createVecRight()  # deformation under the last load and tractions
        self._known: tuple[Array, Vec] | None = None  # tractions, and the displacement that a method has found for them
        # of a method that needs it as a scale only: about the displacement (c,) under forces without contact
        self.guess: Callable[[Vec], Array] | None = None

    def load(self, f_q: Vec, driving: Array, error: float = 0.0) -> Load:
        resultant = np.concatenate([self.volume.floating.resultant(f_q.array_r), driving])
        if self.guess is not None and not error:
            free = np.zeros(self.size)
            free[: self.size - self.driven] = self.guess(f_q)
            # coarse nodes may lie on both sides of a crack: these then move as one, which is no scale
            size = np.abs(free).max(initial=0.0)
            if size == 0 or np.abs(self.N @ free).max(initial=0.0) > EXACT * size:
                rough = Load(f_q=f_q, driving=driving, f_c=self.R @ resultant, resultant=resultant, free=free)
                return replace(rough, rough=True)
        deformation = f_q.duplicate()
        # relative error of the contact dofs when the allowed error is zero: rounding
        # relative error of the displacement without contact, which only sets the scales of a step
        free = self._solved(f_q, deformation, resultant, error, EXACT if error else 1e-4)
        return Load(f_q=f_q, driving=driving, f_c=self.R @ resultant, resultant=resultant, free=free)

    def with_more(self, load: Load, forces: Vec, balanced: bool) -> Load:
        more = super().with_more(load, forces, balanced)
        if balanced:
            return more
        felt = np.concatenate([self.volume.floating.resultant(forces.array_r), np.zeros(self.driven)])
        return replace(more, f_c=load.f_c + self.R @ felt, resultant=load.resultant + felt)

    @contextmanager
    def loosely(self, tolerance: float) -> Iterator[None]:
        last = self._last.copy()
        try:
            with super().loosely(tolerance), self.volume.loosely(tolerance / SHARE):
                yield
        finally:
            self._last.array[:] = last.array_r

    def displacement(self, force: Array, error: float = 0.0) -> Array:
        f = self._last.duplicate()
        self.volume.contact.write(f, force)
        return self._solved(f, f.duplicate(), self.R.T @ force, error, EXACT)

    def under(self, load: Load, p: Array, error: float = 0.0) -> Array:
        force = self.agreed(self.forces(p))
        return self._solved(self._total(load, force), self._last, load.resultant - self.R.T @ force, error, EXACT)

    def nearly(self, load: Load, p: Array, allowed: Callable[[float], float]) -> Array:
        """Displacement (c,) [m] of held bodies to a given residual, started from the last solve; collective.

        Args:
            load: of the step.
            p: tractions (rows,) [Pa].
            allowed: see `ResidualCriterion`.
        """
        assert not self.floating
        if not self.size:
            return np.zeros(0)
        self.volume.solve_residual(self._total(load, self.agreed(self.forces(p))), self._last, allowed)
        return self.volume.contact.read(self._last)

    def found(self, p: Array, q: Vec) -> None:
        """Take over the displacement q [m] of all free dofs that a method has found with tractions p (rows,) [Pa]."""
        self._known, self._last, self.linear_error = (p, q), q.copy(), 0.0

    def recover(self, load: Load, p: Array, u_c: Array) -> Vec:
        if self._known is not None and self._known[0] is p:
            return self._known[1]
        q = self._last.copy()
        self.linear_error = self.volume.solve_energy(
            self._total(load, self.forces(p)), q, SHARE * self.volume.tolerance
        )
        own = self.size - self.driven
        self.volume.floating.pin(q.array, self.volume.floating.R.T @ u_c[:own])
        return q

    def agreed(self, value: T) -> T:
        """The value of rank 0: solves are collective, so if ranks stopped at different iterations they would hang."""
        return on_all_ranks(self.volume.K.comm.tompi4py(), value)

    def snapshot(self) -> dict[str, Plain]:
        return super().snapshot() | {"last": Own(self._last.array_r)}

    def restore(self, snapshot: dict[str, Plain]) -> None:
        super().restore(snapshot)
        self._last.array[:] = snapshot["last"]

    def adopt(self, other: DelassusOperator) -> None:
        assert isinstance(other, MatrixFreeSurface)
        self._last = other._last

    def _total(self, load: Load, force: Array) -> Vec:
        """The load minus forces at the contact dofs (c,) [N], over the free dofs [N]."""
        total = load.f_q.duplicate()
        self.volume.contact.write(total, -force)
        return total + load.f_q

    def _solved(self, f: Vec, deformation: Vec, resultant: Array, error: float, relative: float) -> Array:
        """Displacement (c,) [m]: the deformation, improved in place, plus the rigid motion R R^T f / rho."""
        if not self.size:
            return np.zeros(0)
        self.volume.solve_contact(f, deformation, error, relative)
        found = self.R @ (resultant / self.rho)
        found[: self.size - self.driven] += self.volume.contact.read(deformation)
        return np.asarray(found)
