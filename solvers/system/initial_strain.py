"""Initial strains of bodies and elongations of springs in the assembled system: their loads, and their energy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Vec
from stickslip.solvers.fem.links import Rest
from stickslip.solvers.fem.terms import InitialStrain
from stickslip.solvers.scene.timeline import Course, Timeline


@dataclass(frozen=True, kw_only=True)
class InitialStrains:
    """The k initial strains of a problem, those of bodies first; each is proportional to a value in time a (k,)."""

    strains: tuple[InitialStrain, ...]
    rests: tuple[Rest, ...]
    forces: tuple[Vec, ...]  # ∫ C strain : eps(v) dx at value 1, PETSc over all displacements [N]
    coupling: Array  # (k, k) ∫ strain_i : C strain_j dx at value 1 [J]

    def at(self, strain: InitialStrain, points: Array, timeline: Timeline) -> Array:
        """A strain (m, 3, 3) [-] at value 1, at points (m, d) [m].

        Raises:
            SceneError: its expression has no finite value at a point.
        """
        size = np.ones(len(points))
        if strain.field is not None:
            size = timeline.values(strain.field, points, timeline.end)
        return np.asarray(size[:, None, None] * strain.strain)

    def values(self, course: Course, time: float) -> Array:
        """a (k,) at a time [s]."""
        drives = [strain.drive for strain in self.strains] + [rest.drive for rest in self.rests]
        return np.array([course.value(drive, time) for drive in drives], float)

    def added(self, load: Vec, values: Array) -> Vec:
        """Load plus the forces of the initial strains, over all displacements [N]; `load` itself if there are none."""
        if not self.forces:
            return load
        total = load.copy()
        for value, force in zip(values, self.forces, strict=True):
            total.axpy(value, force)
        return total

    def stress_work(self, values: Array, u: Vec) -> Array:
        """∫ sigma : strain dx (k,) [J] of the stress at displacement u and values a."""
        return np.asarray([force.dot(u) for force in self.forces] - self.coupling @ values)

    def stored(self, values: Array, work: Array) -> float:
        """Energy [J] to add to u . K u / 2, so that the sum is that of the elastic strain eps(u) - initial strain.

        Args:
            work: see `stress_work`.
        """
        return float(-values @ (work + self.coupling @ values / 2))

    @staticmethod
    def external(before: Array, after: Array, work_before: Array, work_after: Array) -> float:
        """Work [J] that the change of the values does on the stressed bodies, exact for linear elasticity."""
        return float(-(after - before) @ (work_before + work_after) / 2)
