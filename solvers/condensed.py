"""The bodies condensed onto the contact dofs: a small dense stiffness, exact, kept over all load steps."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, cho_solve

from solvers.bodies import Bodies, Load
from solvers.volume import Volume

Array = NDArray[np.float64]


class CondensedSurface(Bodies):
    """S u_c = f_c - N^T W p on the contact dofs, S the Schur complement of K_B; see `Bodies`."""

    def __init__(self, volume: Volume, N: Any, W: Array, R: Array, normal_rows: int, driven: int = 0) -> None:
        super().__init__(N, W, R, normal_rows, driven, volume.counters)
        self.volume = volume
        self.S = block_diag(volume.S, np.zeros((driven, driven))) if driven else volume.S
        self.rho = float(np.trace(self.S) / max(len(self.S), 1))

    @cached_property
    def flexibility(self) -> Array:
        """(S + rho R R^T)^-1 (c, c) [m/N]."""
        if not len(self.S):  # no contact in the scene
            return self.S
        inverse = cho_solve(self.factor(np.zeros_like(self.S)), np.eye(len(self.S)))
        return np.asarray((inverse + inverse.T) / 2)

    def factor(self, tangent: Array) -> Any:
        """Cholesky factor of S + tangent + rho R R^T."""
        return cho_factor(self.S + tangent + self.rho * self.R @ self.R.T)

    def load(self, f_q: Any, driving: Array, error: float = 0.0) -> Load:
        f_c = np.concatenate([self.volume.condense(f_q), driving])
        return Load(f_q, driving, f_c, self.R.T @ f_c, self.displacement(f_c))

    def displacement(self, force: Array, error: float = 0.0) -> Array:
        self.counters.volume_solves += len(force) > 0
        return np.asarray(self.flexibility @ force)

    def under(self, load: Load, p: Array, error: float = 0.0) -> Array:
        return self.displacement(load.f_c - self.forces(p))

    def recover(self, load: Load, p: Array, u_c: Array) -> Any:
        total, own = load.f_q.duplicate(), len(u_c) - self.driven
        self.volume.contact.write(total, self.forces(p)[:own])
        return self.volume.expand(load.f_q - total, u_c[:own])

    def adopt(self, other: Bodies) -> None:
        assert isinstance(other, CondensedSurface)
        self.__dict__["flexibility"] = other.flexibility
