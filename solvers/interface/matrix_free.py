"""The bodies without a matrix on the surface: each displacement of the contact dofs is an iterative solve."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI

from geometry.arrays import Array
from solvers.interface.flexibility import DelassusOperator, Load
from solvers.linear.conjugate_gradients import (
    ConjugateGradients,
    ContactErrorCriterion,
    EnergyErrorCriterion,
    ResidualCriterion,
    StoppingCriterion,
)
from solvers.linear.multigrid import boomeramg
from solvers.parallel.replicated import Replicated
from solvers.parallel.serialise import Own
from solvers.system.floating_modes import FloatingMotions
from solvers.system.system import System

SOFT = 1e-2  # of the stiffness of a contact dof: a bed for bodies that float, felt by multigrid alone


class IterativeVolume:
    """K_B v = f by conjugate gradients. A body that floats is balanced first, and pinned: R^T v_c = 0."""

    def __init__(self, system: System) -> None:
        self.counters, self.K = system.counters, system.K_B
        K = self.K
        self.contact = Replicated(K.createVecRight(), system.interface.dofs)
        self.floating = FloatingMotions(system, self.contact, system.interface.rigid_modes)
        diagonal = self.contact.read(K.getDiagonal())
        self.stiffness = float(diagonal.mean()) if len(diagonal) else 1.0
        self.tolerance = system.problem.solver.tolerance
        self._multigrid = boomeramg(self._bedded(K), "volume_")
        self._cg = ConjugateGradients(K, self._precondition, self.counters)

    def remember(self, most: int) -> None:
        """Keep that many search directions, instead of what is known to pay."""
        self._cg.remember(most)

    def release(self) -> None:
        """Give the memory back; nothing can be solved from then on; collective."""
        self._multigrid.destroy()
        self.remember(1)

    def snapshot(self) -> dict[str, Any]:
        """What solves have learnt; see `restore`."""
        return self._cg.directions.snapshot()

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Know what a `snapshot` holds by another one of the same bodies."""
        self._cg.directions.restore(snapshot)

    def solve_contact(self, f: Any, v: Any, error: float, relative: float) -> None:
        """Improve v until its contact dofs are right within `error` [m], or `relative` to the largest; collective."""
        local, response = self.contact.local, self._cg.directions.response
        self._solve(
            f,
            v,
            ContactErrorCriterion(
                comm=self._cg.comm, local=local, error=error, relative=relative, response=lambda: response(local)
            ),
        )

    def solve_energy(self, f: Any, v: Any, relative: float) -> float:
        """Improve v until its relative error in energy norm is small; that error, estimated; collective."""
        criterion = EnergyErrorCriterion(self._cg.comm, f.array, relative)
        self._solve(f, v, criterion)
        return criterion.reached

    def solve_residual(self, f: Any, v: Any, allowed: Callable[[float], float]) -> None:
        """Improve v until its residual is small; collective."""
        self._solve(f, v, ResidualCriterion(allowed))

    def _solve(self, f: Any, v: Any, criterion: StoppingCriterion) -> None:
        forces = f.array.copy()
        self.floating.balance(forces)
        if self._cg.comm.allreduce(bool(forces.any()), op=MPI.LOR):
            self._cg.solve(forces, v.array, criterion)
            self.floating.pin(v.array)
        else:  # beside a solution that is none, no error is small
            v.array[:] = 0.0
        self.counters.volume_solves += 1

    def _precondition(self, r: Any, z: Any) -> None:
        """Symmetric: `balance` is the transpose of `pin`. What r loses there is rounding."""
        self.floating.balance(r.array)
        self._multigrid.apply(r, z)
        self.floating.pin(z.array)

    def _bedded(self, K: Any) -> Any:
        """K_B; if bodies float, a copy with springs at the contact dofs."""
        if not self.floating.R.shape[1]:
            return K
        springs, bedded = K.createVecRight(), K.copy()
        springs.array[self.contact.local] = SOFT * self.stiffness
        bedded.setDiagonal(bedded.getDiagonal() + springs)
        return bedded


EXACT = 1e-12  # relative error of the contact dofs where 0 is asked for: rounding
SCALE = 1e-4  # of the displacement without contact, which only sets the scales of a step
SHARE = 0.1  # of the scene's tolerance: error of the accepted displacement in energy norm


class MatrixFreeSurface(DelassusOperator):
    """K_B^-1 by conjugate gradients, begun where the last solve ended; see `DelassusOperator`.

    A floating body's motion is known at once, b = R^T f / rho; what is iterated on is its deformation.
    """

    def __init__(self, volume: IterativeVolume, N: Any, W: Array, R: Array, normal_rows: int, driven: int = 0) -> None:
        super().__init__(N, W, R, normal_rows, driven, volume.counters)
        self.volume = volume
        self.rho = volume.stiffness
        self._last = volume.K.createVecRight()  # deformation under the last load and tractions

    def load(self, f_q: Any, driving: Array, error: float = 0.0) -> Load:
        resultant = np.concatenate([self.volume.floating.resultant(f_q.array_r), driving])
        deformation = f_q.duplicate()
        free = self._solved(f_q, deformation, resultant, error, EXACT if error else SCALE)
        return Load(f_q, driving, self.R @ resultant, resultant, free)

    def displacement(self, force: Array, error: float = 0.0) -> Array:
        f = self._last.duplicate()
        self.volume.contact.write(f, force)
        return self._solved(f, f.duplicate(), self.R.T @ force, error, EXACT)

    def under(self, load: Load, p: Array, error: float = 0.0) -> Array:
        force = self.agreed(self.forces(p))
        return self._solved(self._total(load, force), self._last, load.resultant - self.R.T @ force, error, EXACT)

    def nearly(self, load: Load, p: Array, allowed: Callable[[float], float]) -> Array:
        """Displacement (c,) [m] of held bodies, from that of the solve before; one volume solve; collective.

        Args:
            allowed: see `ResidualCriterion`.
        """
        assert not self.floating
        if not self.size:
            return np.zeros(0)
        self.volume.solve_residual(self._total(load, self.agreed(self.forces(p))), self._last, allowed)
        return self.volume.contact.read(self._last)

    def recover(self, load: Load, p: Array, u_c: Array) -> Any:
        q = self._last.copy()
        self.linear_error = self.volume.solve_energy(
            self._total(load, self.forces(p)), q, SHARE * self.volume.tolerance
        )
        own = self.size - self.driven
        self.volume.floating.pin(q.array, self.volume.floating.R.T @ u_c[:own])
        return q

    def agreed(self, value: Any) -> Any:
        """Each solve is collective: were ranks to differ in when to stop, they would wait for each other for ever."""
        return self.volume.K.comm.tompi4py().bcast(value)

    def snapshot(self) -> dict[str, Any]:
        return super().snapshot() | {"last": Own(self._last.array_r)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        super().restore(snapshot)
        self._last.array[:] = snapshot["last"]

    def adopt(self, other: DelassusOperator) -> None:
        assert isinstance(other, MatrixFreeSurface)
        self._last = other._last

    def _total(self, load: Load, force: Array) -> Any:
        """The load less forces at the contact dofs, over the free numbers."""
        total = load.f_q.duplicate()
        self.volume.contact.write(total, -force)
        return total + load.f_q

    def _solved(self, f: Any, deformation: Any, resultant: Array, error: float, relative: float) -> Array:
        """Displacement (c,) [m]: the deformation, improved in place, and the motion of the augmentation."""
        if not self.size:
            return np.zeros(0)
        self.volume.solve_contact(f, deformation, error, relative)
        found = self.R @ (resultant / self.rho)
        found[: self.size - self.driven] += self.volume.contact.read(deformation)
        return np.asarray(found)
