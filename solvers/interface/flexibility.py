"""The bodies as the contact surface feels them: displacement of the contact dofs caused by loads and tractions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from petsc4py import PETSc

from geometry.arrays import Array
from solvers.parallel.counters import Counters


@dataclass(frozen=True)
class Load:
    """What pulls at the bodies in one step besides contact; made by `DelassusOperator.load`."""

    f_q: Any  # PETSc vector over the free numbers [N]
    driving: Array  # (o,) forces on driven obstacles [N]
    f_c: Array  # (c,) its effect on the contact dofs [N]; not condensed: only its resultant counts
    resultant: Array  # (r,) R^T f
    free: Array  # (c,) displacement of the contact dofs under it, without contact [m]

    @property
    def magnitude(self) -> float:
        """Sum of the magnitudes of all forces [N]; collective."""
        return float(self.f_q.norm(PETSc.NormType.NORM_1) + np.abs(self.driving).sum())


class DelassusOperator(ABC):
    """K_B^-1, seen on the c contact dofs; `rows` contact rows measure relative displacement there.

    A body that is held by contact alone makes K_B singular. With R an orthonormal basis of its rigid motions on the
    contact dofs, K_B + rho R R^T is positive definite, and (K_B + rho R R^T) u = f + rho R b with b = R^T u is the same
    equation: an augmentation that changes no answer, for any rho > 0. Driven obstacles are dofs of no stiffness, the
    last ones, and among these rigid motions.

    A volume solve is one application of K_B^-1. Those of a direct solver are exact; an iterative one stops when it
    believes the displacement of the contact dofs to be right within `error` [m].
    """

    rho: float
    exact: bool = False  # displacement is right to rounding, whatever error is allowed
    linear_error: float = 0.0  # of the displacement last recovered, relative, energy norm: none but rounding

    def __init__(self, N: Any, W: Array, R: Array, normal_rows: int, driven: int, counters: Counters) -> None:
        """
        Args:
            N: (rows, c) sparse, contact dofs to relative displacement.
            W: (rows,) point weights [m^(d-1)].
            R: (c, r) rigid motions on the contact dofs, orthonormal; r = 0 if the bodies are held.
            normal_rows: how many of the rows are normal.
            driven: how many dofs, the last ones, are motions of obstacles: they have no stiffness.
        """
        self.N, self.W, self.R = N, W, R
        self.normal_rows, self.driven, self.counters = normal_rows, driven, counters

    @property
    def size(self) -> int:
        """c, the driven dofs included."""
        return len(self.R)

    @property
    def floating(self) -> bool:
        return self.R.shape[1] > 0

    def forces(self, p: Array) -> Array:
        """B^T p on the contact dofs (c,) [N]."""
        return np.asarray(self.N.T @ (self.W * p))

    @abstractmethod
    def load(self, f_q: Any, driving: Array, error: float = 0.0) -> Load:
        """What forces over the free numbers and on driven obstacles do; collective."""

    @abstractmethod
    def displacement(self, force: Array, error: float = 0.0) -> Array:
        """Displacement (c,) [m] that forces on the contact dofs (c,) [N] cause; one volume solve; collective."""

    @abstractmethod
    def under(self, load: Load, p: Array, error: float = 0.0) -> Array:
        """Displacement (c,) [m] under a load and tractions (rows,); one volume solve; collective."""

    @abstractmethod
    def recover(self, load: Load, p: Array, u_c: Array) -> Any:
        """Displacement q of all free numbers under a load and tractions, the contact dofs at u_c; collective."""

    def agreed(self, value: Any) -> Any:
        """What all ranks go by: `value`, or that of the first rank where others may find it different by rounding."""
        return value

    @abstractmethod
    def adopt(self, other: DelassusOperator) -> None:
        """Take over what another one, of the same bodies and contact dofs with other pairs, has learnt of them."""

    def snapshot(self) -> dict[str, Any]:
        """What later answers depend on beside the bodies, to the last bit; see `restore`."""
        return {"lambda_max": self.__dict__.get("lambda_max")}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on as the one that `snapshot` was taken of."""
        if snapshot["lambda_max"] is not None:
            self.__dict__["lambda_max"] = snapshot["lambda_max"]

    @cached_property
    def lambda_max(self) -> float:
        """Largest eigenvalue of W^-1 B K_B^-1 B^T [m/Pa] by Lanczos (SLEPc), with its error bound added."""
        from slepc4py import SLEPc

        root = np.sqrt(self.W)
        rows = len(self.W)
        surface = self

        class Operator:
            def mult(self, matrix: Any, x: Any, y: Any) -> None:
                counters = surface.counters
                counters.lanczos_applications += 1
                before = counters.volume_solves, counters.linear_iterations
                y.array = root * (surface.N @ surface.displacement(surface.N.T @ (root * x.array_r)))
                counters.volume_solves, counters.linear_iterations = before

        shell = PETSc.Mat().createPython(((rows, rows), (rows, rows)), Operator(), comm=PETSc.COMM_SELF)
        shell.setUp()
        solver = SLEPc.EPS().create(PETSc.COMM_SELF)
        solver.setOptionsPrefix("lambda_max_")
        solver.setOperators(shell)
        solver.setProblemType(SLEPc.EPS.ProblemType.HEP)
        solver.setType(SLEPc.EPS.Type.LANCZOS)
        solver.setLanczosReorthogType(SLEPc.EPS.LanczosReorthogType.FULL)
        solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
        solver.setDimensions(1)
        solver.setTolerances(tol=1e-4)
        start = shell.createVecRight()
        start.array = root * (1 + np.sin(np.arange(rows)))  # the same on every rank, no symmetry
        solver.setInitialSpace(start)
        solver.solve()
        assert solver.getConverged() > 0
        return float(solver.getEigenvalue(0).real + solver.computeError(0, SLEPc.EPS.ErrorType.ABSOLUTE))
