"""The bodies, prepared for iterations: multigrid for K_B is set up once, solves remember each other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from solvers.conjugate_gradients import ConjugateGradients
from solvers.multigrid import boomeramg
from solvers.replicated import Replicated
from solvers.stopping import ContactError, EnergyError, Goal, ResidualNorm
from solvers.system import System
from solvers.volume_motions import FloatingMotions

Array = NDArray[np.float64]
SOFT = 1e-2  # of the stiffness of a contact dof: a bed for bodies that float, felt by multigrid alone


class IterativeVolume:
    """K_B v = f by conjugate gradients. A body that floats is balanced first, and pinned: R^T v_c = 0."""

    def __init__(self, system: System) -> None:
        self.counters, self.K = system.counters, system.K_B
        K = self.K
        self.contact = Replicated(K.createVecRight(), system.contact_dofs)
        self.floating = FloatingMotions(system, self.contact, system.rigid_modes())
        diagonal = self.contact.read(K.getDiagonal())
        self.stiffness = float(diagonal.mean()) if len(diagonal) else 1.0
        self.tolerance = system.scene.solver.tolerance
        self._multigrid = boomeramg(self._bedded(K), "volume_")
        self._cg = ConjugateGradients(K, self._precondition, self.counters)

    def remember(self, most: int) -> None:
        """Keep that many search directions, instead of what is known to pay."""
        self._cg.remember(most)

    def release(self) -> None:
        """Give the memory back; nothing can be solved from then on; collective."""
        self._multigrid.destroy()
        self.remember(1)

    def kept(self) -> dict[str, Any]:
        """What solves have learnt; see `restore`."""
        return self._cg.directions.kept()

    def restore(self, kept: dict[str, Any]) -> None:
        """Know what was `kept` by another one of the same bodies."""
        self._cg.directions.restore(kept)

    def solve_contact(self, f: Any, v: Any, error: float, relative: float) -> None:
        """Improve v until its contact dofs are right within `error` [m], or `relative` to the largest; collective."""
        local, response = self.contact.local, self._cg.directions.response
        self._solve(f, v, ContactError(self._cg.comm, local, error, relative, lambda: response(local)))

    def solve_energy(self, f: Any, v: Any, relative: float) -> float:
        """Improve v until its relative error in energy norm is small; that error, estimated; collective."""
        goal = EnergyError(self._cg.comm, f.array, relative)
        self._solve(f, v, goal)
        return goal.reached

    def solve_residual(self, f: Any, v: Any, allowed: Callable[[float], float]) -> None:
        """Improve v until its residual is small; collective."""
        self._solve(f, v, ResidualNorm(allowed))

    def _solve(self, f: Any, v: Any, goal: Goal) -> None:
        forces = f.array.copy()
        self.floating.balance(forces)
        if self._cg.comm.allreduce(bool(forces.any()), op=MPI.LOR):
            self._cg.solve(forces, v.array, goal)
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
