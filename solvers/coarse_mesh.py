"""The same scene on a coarse mesh beside the fine one: tractions to begin with, and what smooth forces do."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from geometry.errors import StickslipError
from geometry.mesh import build_mesh
from geometry.search import pair
from geometry.surface import Surface
from geometry.surface_forms import surface_mass
from solvers.bodies import Bodies
from solvers.contact_sides import contact_sides
from solvers.counters import Counters
from solvers.state import State
from solvers.system import System, assemble

Array = NDArray[np.float64]
DOFS = 2500  # about, of the coarse mesh: its steps cost next to nothing
COARSER = 2.0  # in edge length, at least
TOLERANCE = 1e-3  # of its steps: less than what the meshes differ by
DEGREE = 2  # of the smooth tractions
log = logging.getLogger(__name__)


class March(Protocol):
    """What is needed of a stepper."""

    system: System
    surface: Bodies

    def start(self) -> State: ...
    def reach(self, start: State, target: float, on_iteration: Callable[[Any], None]) -> Any: ...
    def split(self, p: Array) -> tuple[list[Array], list[Array]]: ...


class CoarseMesh:
    """Marches beside the fine run; where it cannot go, the fine run starts as if it were not there."""

    def __init__(self, fine: System, coarse: March) -> None:
        self.fine, self.stepper = fine, coarse
        self.counters = coarse.system.counters
        self.spread = {
            c.name: _interpolation(c.surface, other.surface)
            for c, other in zip(fine.contacts, coarse.system.contacts, strict=True)
        }
        self.states = {0.0: self.stepper.start()}

    @staticmethod
    def beside(system: System, stepper_of: Callable[[System], March]) -> CoarseMesh | None:
        """Mesh, assemble and prepare the coarse scene, if there is one; collective."""
        scene = system.scene
        if any(contact.sliding for contact in scene.contacts.values()):
            return None
        factor = max(COARSER, (system.constraints.free_total / DOFS) ** (1 / system.mesh.dim))
        solver = replace(scene.solver, method="auto", surface="auto", tolerance=max(TOLERANCE, scene.solver.tolerance))
        try:
            coarse = replace(scene, geometry=scene.geometry.refined(factor), solver=solver)
            mesh = build_mesh(coarse.geometry, coarse.request(), system.mesh.comm)
            return CoarseMesh(system, stepper_of(assemble(coarse, mesh, Counters())))
        except StickslipError as error:
            log.info("no coarse mesh: %s", error)
            return None

    def smooth_responses(self, R: Array, rho: float) -> tuple[Array, Array]:
        """Forces (c, k) [N] of smooth tractions on the fine contact dofs, and about the displacement [m] they cause.

        Args:
            R, rho: rigid motions (c, r) and augmentation of the fine bodies, see `Bodies`.
        """
        coarse = self.stepper.surface
        forces, fine_sides = _smooth_forces(self.fine), list(contact_sides(self.fine))
        own = coarse.size - coarse.driven
        given = np.zeros((coarse.size, forces.shape[1]))
        given[:own] = _smooth_forces(self.stepper.system)
        caused = np.column_stack([coarse.displacement(f) for f in given.T])
        caused = caused - coarse.R @ (coarse.R.T @ caused)
        found, count = np.zeros_like(forces), np.zeros(len(forces))
        for (_, side, onto), (_, other, onto_coarse) in zip(
            fine_sides, contact_sides(self.stepper.system), strict=True
        ):
            spread = sparse.kron(_interpolation(side, other), sparse.eye(side.dim))
            found += onto.T @ (spread @ (onto_coarse @ caused[:own]))
            count += np.asarray(onto.multiply(onto).sum(axis=0)).ravel()
        found /= count[:, None]
        R = R[: len(found)]
        return forces, found - R @ (R.T @ found) + R @ (R.T @ forces) / rho

    def change(self, before: float, time: float) -> Array | None:
        """What the coarse tractions change by from one time to another, in the fine rows (rows,) [Pa]; collective.

        None where the coarse march cannot tell.
        """
        old = self.states.get(before)
        if old is None:
            return None
        try:
            new: State = self.stepper.reach(old, time, lambda row: None).state
        except StickslipError as error:
            log.info("t = %g: no start from the coarser mesh: %s", time, error)
            return None
        self.states = {before: old, time: new}
        return self._told(new) - self._told(old)

    def _told(self, state: State) -> Array:
        normal, tangential = [], []
        pressures, tractions = self.stepper.split(state.p)
        for fine, coarse, p_n, t in zip(
            self.fine.contacts, self.stepper.system.contacts, pressures, tractions, strict=True
        ):
            spread = self.spread[fine.name]
            normal.append(fine.normal_of_nodes(spread @ coarse.node_pressure(p_n)))
            tangential.append(fine.tangential_of_nodes(spread @ coarse.node_traction(t)).ravel())
        return np.concatenate([np.zeros(0), *normal, *tangential])


def _smooth_forces(system: System) -> Array:
    """Forces (c, k) [N] of tractions that are polynomials on one side and none on the others, by component."""
    found = [np.zeros((len(system.contact_dofs), 0))]
    for _, side, onto in contact_sides(system):
        low, high = side.points.min(axis=0), side.points.max(axis=0)
        x = (2 * side.points - low - high) / (high - low).max()
        powers = [k for k in product(range(DEGREE + 1), repeat=side.dim) if sum(k) <= DEGREE]
        fields = np.column_stack([np.prod(x ** np.array(k), axis=1) for k in powers]) * surface_mass(side)[:, None]
        found.append(onto.T @ np.kron(fields, np.eye(side.dim)))
    return np.column_stack(found)


def _interpolation(fine: Surface, coarse: Surface) -> sparse.csr_matrix:
    """(n_fine, n_coarse): along the fine normals; from the nearest node where these meet nothing."""
    found = pair(fine.points, -fine.node_normals(), coarse, np.inf)
    missed = np.flatnonzero(found.facet < 0)
    nearest = cKDTree(coarse.points).query(fine.points[missed])[1]
    shape = (len(fine.points), len(coarse.points))
    return found.weights(coarse) + sparse.csr_matrix((np.ones(len(missed)), (missed, nearest)), shape=shape)
