"""The bodies without a matrix on the surface: each displacement of the contact dofs is an iterative solve."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.bodies import Bodies, Load
from solvers.iterative_volume import IterativeVolume
from solvers.plain import Own

Array = NDArray[np.float64]
EXACT = 1e-12  # relative error of the contact dofs where 0 is asked for: rounding
SCALE = 1e-4  # of the displacement without contact, which only sets the scales of a step
SHARE = 0.1  # of the scene's tolerance: error of the accepted displacement in energy norm


class MatrixFreeSurface(Bodies):
    """K_B^-1 by conjugate gradients, begun where the last solve ended; see `Bodies`.

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
            allowed: see `ResidualNorm`.
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

    def kept(self) -> dict[str, Any]:
        return super().kept() | {"last": Own(self._last.array_r)}

    def restore(self, kept: dict[str, Any]) -> None:
        super().restore(kept)
        self._last.array[:] = kept["last"]

    def adopt(self, other: Bodies) -> None:
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
