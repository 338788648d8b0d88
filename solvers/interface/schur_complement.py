"""The bodies condensed onto the contact dofs: a small dense stiffness, exact, kept over all load steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.linalg.lapack import dpotri
from scipy.sparse.linalg import splu

from geometry.arrays import Array, Bools, Ints
from solvers.interface.factorised import FactorisedVolume
from solvers.interface.flexibility import DelassusOperator, Load
from solvers.linear.memoised_map import MemoisedMap

SINGULAR = 1e-8  # smallest pivot of N beside its largest at which rows do not measure every dof


@dataclass(frozen=True)
class RowStiffness:
    """W p = N^-T f_c - H (w - offset) on the rows that may carry tractions, m = c of them.

    The same equation as S u_c = f_c - N^T W p, multiplied by N^-T: exact, whether the bodies are held or not.
    """

    index: Ints  # (m,) numbers of these rows among all
    H: Array  # (m, m) N^-T S N^-1 [N/m], symmetric
    _N: Any  # LU factor of these rows of N

    @classmethod
    def of(cls, N: Any, S: Array, carrying: Bools) -> RowStiffness | None:
        """
        Args:
            N: (rows, c) sparse.
            S: (c, c) stiffness of the contact dofs [N/m].
            carrying: (rows,) rows that may carry tractions.

        Returns:
            None where these rows do not measure each dof once.
        """
        index = np.flatnonzero(carrying)
        if not len(index) or len(index) != len(S):
            return None
        try:
            factor = splu(N[index].tocsc())
        except RuntimeError:  # SuperLU: exactly singular
            return None
        pivots = np.abs(factor.U.diagonal())
        if pivots.min() < SINGULAR * pivots.max():
            return None
        half = factor.solve(np.asfortranarray(S), "T")
        return cls(index, np.asarray(factor.solve(np.asfortranarray(half.T), "T")), factor)

    def forces(self, f_c: Array) -> Array:
        """N^-T f_c (m,) [N]: what forces on the contact dofs do to the rows."""
        return np.asarray(self._N.solve(f_c, "T"))

    def displacement(self, relative: Array) -> Array:
        """u_c (c,) [m] at which the rows measure this (m,)."""
        return np.asarray(self._N.solve(relative))


PAYS = 16  # an inverse is cheaper than two triangular solves for each of c / PAYS forces


class CondensedSurface(DelassusOperator):
    """S u_c = f_c - N^T W p on the contact dofs, S the Schur complement of K_B; see `DelassusOperator`."""

    exact = True

    def __init__(self, volume: FactorisedVolume, N: Any, W: Array, R: Array, normal_rows: int, driven: int = 0) -> None:
        super().__init__(N, W, R, normal_rows, driven, volume.counters)
        self.volume = volume
        self.S = block_diag(volume.S, np.zeros((driven, driven))) if driven else volume.S
        self.rho = float(np.trace(self.S) / max(len(self.S), 1))
        self._condensed = MemoisedMap(volume.condense, len(volume.S))
        self._forces = 0  # that were asked about
        self._dense: dict[str, Any] = {}  # factor and inverse, shared with those of other pairs
        self._row_stiffness: dict[bytes, RowStiffness | None] = {}

    @property
    def held(self) -> Any:
        """Cholesky factor of S + rho R R^T."""
        if "held" not in self._dense:
            self._dense["held"] = self.factor(None)
        return self._dense["held"]

    @cached_property
    def total(self) -> float:
        """Sum of all magnitudes in S [N/m]: force beside which less is rounding, once the bodies move by 1 m."""
        return float(np.abs(self.S).sum())

    @property
    def flexibility(self) -> Array:
        """(S + rho R R^T)^-1 (c, c) [m/N]."""
        if not len(self.S):  # no contact in the scene
            return self.S
        if "flexibility" not in self._dense:
            inverse, _ = dpotri(self.held[0], lower=True)
            self._dense["flexibility"] = np.tril(inverse) + np.tril(inverse, -1).T
        return np.asarray(self._dense["flexibility"])

    def factor(self, tangent: Array | None) -> Any:
        """Cholesky factor of S + tangent + rho R R^T."""
        total = self.S + self.rho * self.R @ self.R.T if self.floating else self.S
        return cho_factor(total if tangent is None else total + tangent, lower=True, check_finite=False)

    def row_stiffness(self, carrying: Bools) -> RowStiffness | None:
        """The bodies in terms of these rows (rows,), if they measure every contact dof once; see `RowStiffness`."""
        key = carrying.tobytes()
        if key not in self._row_stiffness:
            self._row_stiffness[key] = RowStiffness.of(self.N, self.S, carrying)
        return self._row_stiffness[key]

    def load(self, f_q: Any, driving: Array, error: float = 0.0) -> Load:
        f_c = np.concatenate([self._condensed(f_q), driving])
        return Load(f_q, driving, f_c, self.R.T @ f_c, self.displacement(f_c))

    def displacement(self, force: Array, error: float = 0.0) -> Array:
        if not len(force):
            return force
        self.counters.volume_solves += 1
        self._forces += 1
        if "flexibility" in self._dense or PAYS * self._forces > len(force):
            return np.asarray(self.flexibility @ force)
        return np.asarray(cho_solve(self.held, force))

    def under(self, load: Load, p: Array, error: float = 0.0) -> Array:
        return self.displacement(load.f_c - self.forces(p))

    def recover(self, load: Load, p: Array, u_c: Array) -> Any:
        total, own = load.f_q.duplicate(), len(u_c) - self.driven
        self.volume.contact.write(total, self.forces(p)[:own])
        return self.volume.expand(load.f_q - total, u_c[:own])

    def snapshot(self) -> dict[str, Any]:
        inverted = "flexibility" in self._dense
        counted = 0 if inverted else self._forces  # it matters only until then
        return super().snapshot() | {"condensed": self._condensed.snapshot(), "forces": counted, "inverted": inverted}

    def restore(self, snapshot: dict[str, Any]) -> None:
        super().restore(snapshot)
        self._condensed.restore(snapshot["condensed"], self.volume.K.createVecRight())
        self._forces = snapshot["forces"]
        if snapshot["inverted"]:  # from then on displacements came from the inverse, with its rounding
            _ = self.flexibility

    def adopt(self, other: DelassusOperator) -> None:
        assert isinstance(other, CondensedSurface)
        self._condensed, self._dense = other._condensed, other._dense
