"""Responses of the contact sides to smooth forces, measured cheaply on a coarse mesh of the same scene.

They are the first secant pairs of `surface-uzawa`: smooth forces reach deepest into the bodies.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from itertools import product

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import StickslipError
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.search import pair
from stickslip.geometry.surfaces.surface import Surface, lumped_mass
from stickslip.solvers.interface.prepare import prepare_surface, prepare_volume
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.system.system import System, assemble, contact_sides

LEAST = 0.5  # largest part of the dofs of the fine mesh at which a coarse mesh still pays
DEGREE = 2  # polynomial degree of the smooth tractions
log = logging.getLogger(__name__)


class CoarseMesh:
    """The same scene on a coarse mesh, condensed onto its contact dofs (Schur complement)."""

    def __init__(self, system: System) -> None:
        self.system, self.counters = system, system.counters
        self.surface = prepare_surface(system, prepare_volume(system, "condensed"))

    @staticmethod
    def beside(fine: System) -> CoarseMesh | None:
        """Mesh, assemble and condense the coarse scene; collective.

        Returns:
            None if the scene cannot be meshed so coarsely, or would have too many dofs.
        """
        # at least twice the edge length, and about 2500 dofs
        factor = max(2.0, (fine.constraints.free_total / 2500) ** (1 / fine.mesh.dim))
        try:
            problem = replace(fine.problem, shape=fine.problem.shape.refined(factor))
            mesh = build_mesh(problem.shape, problem.request, fine.mesh.comm)
            coarse = assemble(problem, mesh, Counters())
            if coarse.constraints.free_total > LEAST * fine.constraints.free_total:
                log.info("no coarse mesh: it would have %d dofs", coarse.constraints.free_total)
                return None
            return CoarseMesh(coarse)
        except StickslipError as error:
            log.info("no coarse mesh: %s", error)
            return None

    def smooth_responses(self, fine: System, R: Array, rho: float) -> tuple[Array, Array]:
        """Forces of smooth tractions on the fine contact dofs, and approximately the displacement that they cause.

        Args:
            fine: the system on the fine mesh.
            R, rho: rigid modes (c, r) and augmentation of the fine bodies, see `DelassusOperator`.

        Returns:
            Forces (c, k) [N] and displacements (c, k) [m].
        """
        coarse, forces = self.surface, _smooth_forces(fine)
        own = coarse.size - coarse.driven
        given = np.zeros((coarse.size, forces.shape[1]))
        given[:own] = _smooth_forces(self.system)
        caused = np.column_stack([given[:, :0], *(coarse.displacement(f) for f in given.T)])
        caused = caused - coarse.R @ (coarse.R.T @ caused)
        found, count = np.zeros_like(forces), np.zeros(len(forces))
        for (_, side, onto), (_, other, from_coarse) in zip(
            contact_sides(fine), contact_sides(self.system), strict=True
        ):
            spread = sparse.kron(_interpolation(side, other), sparse.eye(side.dim))
            found += onto.T @ (spread @ (from_coarse @ caused[:own]))
            count += np.asarray(onto.multiply(onto).sum(axis=0)).ravel()
        found /= count[:, None]
        R = R[: len(found)]
        return forces, found - R @ (R.T @ found) + R @ (R.T @ forces) / rho


def _smooth_forces(system: System) -> Array:
    """Forces (c, k) [N] of tractions that are polynomials on one side and zero on the others, by component."""
    found = [np.zeros((len(system.interface.dofs), 0))]
    for _, side, onto in contact_sides(system):
        low, high = side.points.min(axis=0), side.points.max(axis=0)
        x = (2 * side.points - low - high) / (high - low).max()
        powers = [k for k in product(range(DEGREE + 1), repeat=side.dim) if sum(k) <= DEGREE]
        fields = np.column_stack([np.prod(x ** np.array(k), axis=1) for k in powers]) * lumped_mass(side)[:, None]
        found.append(onto.T @ np.kron(fields, np.eye(side.dim)))
    return np.column_stack(found)


def _interpolation(fine: Surface, coarse: Surface) -> Sparse:
    """Interpolation (n_fine, n_coarse) along the fine normals; from the nearest node where these meet no facet."""
    found = pair(fine.points, -fine.node_normals(), coarse, np.inf)
    missed = np.flatnonzero(found.facet < 0)
    nearest = cKDTree(coarse.points).query(fine.points[missed])[1]
    shape = (len(fine.points), len(coarse.points))
    return found.weights(coarse) + sparse.csr_matrix((np.ones(len(missed)), (missed, nearest)), shape=shape)
