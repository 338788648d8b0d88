"""Initial strains in the assembled system: what they load the bodies with, and the energy that they store."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.arrays import Array
from geometry.protocols import Vec
from solvers.fem.terms import InitialStrain
from solvers.scene.timeline import Course


@dataclass(frozen=True, kw_only=True)
class InitialStrains:
    """All of a problem, k of them; each is uniform over its body and proportional to a value in time a (k,)."""

    strains: tuple[InitialStrain, ...]
    forces: tuple[Vec, ...]  # ∫ C strain : eps(v) dx at value 1, PETSc over all displacements [N]
    coupling: Array  # (k, k) ∫ strain_i : C strain_j dx at value 1 [J]

    def values(self, course: Course, time: float) -> Array:
        """a (k,) at a time [s]."""
        return np.array([course.value(strain.drive, time) for strain in self.strains], float)

    def added(self, load: Vec, values: Array) -> Vec:
        """Nodal forces over all displacements [N] with those of the initial strains; the same object without any."""
        if not self.strains:
            return load
        total = load.copy()
        for value, force in zip(values, self.forces, strict=True):
            total.axpy(value, force)
        return total

    def stress_work(self, values: Array, u: Vec) -> Array:
        """∫ sigma : strain dx (k,) [J] of the stress at displacement u and values a."""
        return np.asarray([force.dot(u) for force in self.forces] - self.coupling @ values)

    def stored(self, values: Array, work: Array) -> float:
        """What is added to u . K u / 2 to make it the energy of the strain beyond the initial one [J].

        Args:
            work: see `stress_work`.
        """
        return float(-values @ (work + self.coupling @ values / 2))

    @staticmethod
    def external(before: Array, after: Array, work_before: Array, work_after: Array) -> float:
        """Work [J] that the change of the values does on the stressed bodies, exact for linear elasticity."""
        return float(-(after - before) @ (work_before + work_after) / 2)
