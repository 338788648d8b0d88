"""The Delassus operator W = B K_B^-1 B^T: contact displacement caused by contact tractions, and by the loads.

On the contact dofs alone it is the inverse of the Steklov-Poincaré operator, the Schur complement S of K_B.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Sparse, Vec
from stickslip.solvers.linear.conjugate_gradients import extreme_eigenvalue, without_symmetry
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.parallel.replicated import sum_of_sizes
from stickslip.solvers.parallel.serialise import Plain

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Load:
    """All forces on the bodies in one step but those of contact; made by `DelassusOperator.load`."""

    f_q: Vec  # over the free dofs [N]
    driving: Array  # (o,) forces on driven obstacles [N]
    f_c: Array  # (c,) condensed onto the contact dofs [N]; matrix-free: any forces there with the same resultant
    resultant: Array  # (r,) R^T f, the work on each rigid mode
    free: Array  # (c,) displacement of the contact dofs under the load alone, without contact [m]
    rough: bool = False  # whether `free` is a scale only

    @property
    def magnitude(self) -> float:
        """Sum of the magnitudes of all forces [N]; collective."""
        return sum_of_sizes(self.f_q) + float(np.abs(self.driving).sum())


class DelassusOperator(ABC):
    """Delassus operator B K_B^-1 B^T with B = W N, by its factors: K_B^-1 on the c contact dofs, N and W on the rows.

    Floating bodies, held by contact alone, make K_B singular. With R an orthonormal basis of their rigid modes on the
    contact dofs, K_B + rho R R^T is positive definite, and (K_B + rho R R^T) u = f + rho R b with b = R^T u is the same
    equation: an augmentation that does not change the solution, for any rho > 0. Driven obstacles are the last contact
    dofs; they have no stiffness and are among the rigid modes.

    A volume solve is one application of K_B^-1. Those of a direct solver are exact to rounding; an iterative one stops
    when it estimates the error of the contact dofs to be below `error` [m].
    """

    rho: float  # [N/m]
    exact: bool = False  # volume solves are right to rounding, for every `error`
    total: float = 0.0  # [N/m] sum of the magnitudes of the entries of S, if it is formed: scale of rounding of forces
    linear_error: float = 0.0  # of the displacement last recovered: relative, in energy norm; zero: rounding only

    def __init__(self, *, N: Sparse, W: Array, R: Array, normal_rows: int, driven: int, counters: Counters) -> None:
        """
        Args:
            N: (rows, c) displacement of the contact dofs to relative displacement.
            W: (rows,) point weights [m^(d-1)].
            R: (c, r) rigid modes on the contact dofs, orthonormal; r = 0 if supports hold the bodies.
            normal_rows: number of normal rows; they come first.
            driven: number of contact dofs, the last ones, that are motions of driven obstacles.
            counters: counts volume solves.
        """
        self.N, self.W, self.R = N, W, R
        self._spread = N.T  # scipy makes it anew at each access
        self.normal_rows, self.driven, self.counters = normal_rows, driven, counters
        self._lambda_max: float | None = None

    @property
    def size(self) -> int:
        """Number c of contact dofs, those of driven obstacles included."""
        return len(self.R)

    @property
    def floating(self) -> bool:
        """Whether contact alone holds a body or a driven obstacle."""
        return self.R.shape[1] > 0

    @property
    def give(self) -> Array | None:
        """Flexibility of each row (rows,) [m/Pa]: the diagonal of W^-1 B K_B^-1 B^T; None: it is not known."""
        return None

    @cached_property
    def delassus(self) -> Array:
        """W^-1 B K_B^-1 B^T (rows, rows) [m/Pa], a volume solve for each row; collective."""
        return self.agreed(np.column_stack([self.N @ self.displacement(self.forces(p)) for p in np.eye(len(self.W))]))

    def forces(self, p: Array) -> Array:
        """Forces B^T p on the contact dofs (c,) [N] of tractions p (rows,) [Pa]."""
        return np.asarray(self._spread @ (self.W * p))

    @abstractmethod
    def load(self, f_q: Vec, driving: Array, error: float = 0.0) -> Load:
        """Condense the load of a step, and find the displacement without contact; collective.

        Args:
            f_q: forces over the free dofs [N].
            driving: forces on the driven obstacles (o,) [N].
            error: allowed error [m] of the displacement without contact.
        """

    @abstractmethod
    def displacement(self, force: Array, error: float = 0.0) -> Array:
        """Displacement (c,) [m] that forces on the contact dofs (c,) [N] cause; one volume solve; collective."""

    @abstractmethod
    def under(self, load: Load, p: Array, error: float = 0.0) -> Array:
        """Displacement u_c (c,) [m] under a load and tractions p (rows,) [Pa]; one volume solve; collective."""

    def with_more(self, load: Load, forces: Vec, balanced: bool) -> Load:
        """A load with more forces over the free dofs [N]; its `free`, which sets scales, stays; collective.

        Args:
            balanced: whether no rigid mode feels them.
        """
        return replace(load, f_q=load.f_q + forces)

    @abstractmethod
    def recover(self, load: Load, p: Array, u_c: Array) -> Vec:
        """Displacement of all free dofs [m] under a load and tractions p (rows,), given the contact dofs; collective.

        Args:
            load: of the step.
            p: tractions (rows,) [Pa].
            u_c: displacement of the contact dofs (c,) [m].
        """

    def agreed(self, value: T) -> T:
        """The value that all ranks use: that of rank 0 where rounding may make it differ; collective."""
        return value

    @abstractmethod
    def adopt(self, other: DelassusOperator) -> None:
        """Take over what `other` stores about the bodies: it has the same contact dofs, with other contact pairs."""

    @contextmanager
    def loosely(self, tolerance: float) -> Iterator[None]:
        """Solves inside the block count as those of an error; displacements are recovered to a relative `tolerance`.

        Nothing that later steps start from is changed.
        """
        before = self.linear_error
        try:
            with self.counters.for_error():
                yield
        finally:
            self.linear_error = before

    def snapshot(self) -> dict[str, Plain]:
        """State, besides the bodies, on which later results depend to the last bit; see `restore`."""
        return {"lambda_max": self._lambda_max}

    def restore(self, snapshot: dict[str, Plain]) -> None:
        """Continue from the state of a `snapshot`."""
        if snapshot["lambda_max"] is not None:
            self._lambda_max = snapshot["lambda_max"]

    @property
    def lambda_max(self) -> float:
        """Largest eigenvalue of W^-1 B K_B^-1 B^T [m/Pa] by Lanczos' method, and its error more."""
        if self._lambda_max is None:
            start = np.sqrt(self.W) * without_symmetry(len(self.W))
            self._lambda_max = extreme_eigenvalue(self._response, start)
        return self._lambda_max

    def _response(self, x: Array) -> Array:
        """W^1/2 N K_B^-1 N^T W^1/2 x: its eigenvalues are those of W^-1 B K_B^-1 B^T."""
        counters, root = self.counters, np.sqrt(self.W)
        counters.lanczos_applications += 1
        before = counters.volume_solves, counters.linear_iterations
        found = root * (self.N @ self.displacement(self.N.T @ (root * x)))
        counters.volume_solves, counters.linear_iterations = before
        return np.asarray(found)
