"""A nested start: the same scene on a mesh twice as coarse, whose tractions the fine iteration begins with."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from geometry.errors import StickslipError
from geometry.mesh import build_mesh
from geometry.search import pair
from geometry.surface import Surface
from solvers.counters import Counters
from solvers.state import State
from solvers.system import System, assemble

Array = NDArray[np.float64]
COARSER = 2.0  # in edge length
TOLERANCE = 1e-3  # of its steps: less than what the meshes differ by
log = logging.getLogger(__name__)


class March(Protocol):
    """What is needed of a stepper."""

    system: System
    nested: NestedStart | None

    def start(self) -> State: ...
    def reach(self, start: State, target: float, on_iteration: Callable[[Any], None]) -> Any: ...
    def split(self, p: Array) -> tuple[list[Array], list[Array]]: ...


class NestedStart:
    """Marches beside the fine run; where it cannot go, the fine run starts as if it were not there."""

    def __init__(self, fine: System, coarse: March) -> None:
        self.fine, self.stepper = fine, coarse
        self.spread = {
            c.name: _interpolation(c.surface, other.surface)
            for c, other in zip(fine.contacts, coarse.system.contacts, strict=True)
        }
        self.states = {0.0: self.stepper.start()}

    @staticmethod
    def beside(system: System, stepper_of: Callable[[System], March]) -> NestedStart | None:
        """Mesh, assemble and prepare the coarse scene, if there is one; collective."""
        scene, geometry = system.scene, system.scene.geometry
        sizes = {key: getattr(geometry, key, None) for key in ("mesh_size", "contact_mesh_size")}
        if sizes["mesh_size"] is None or any(contact.sliding for contact in scene.contacts.values()):
            return None
        coarser = replace(geometry, **{key: COARSER * size for key, size in sizes.items() if size is not None})
        solver = replace(scene.solver, method="auto", surface="auto", tolerance=max(TOLERANCE, scene.solver.tolerance))
        coarse = replace(scene, geometry=coarser, solver=solver)
        try:
            mesh = build_mesh(coarser, coarse.request(), system.mesh.comm)
            return NestedStart(system, stepper_of(assemble(coarse, mesh, Counters())))
        except StickslipError as error:
            log.info("no start from a coarser mesh: %s", error)
            return None

    @property
    def counters(self) -> list[Counters]:
        """Of this mesh, and of those that it starts from in turn."""
        deeper = self.stepper.nested.counters if self.stepper.nested else []
        return [self.stepper.system.counters, *deeper]

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


def _interpolation(fine: Surface, coarse: Surface) -> sparse.csr_matrix:
    """(n_fine, n_coarse): along the fine normals; from the nearest node where these meet nothing."""
    found = pair(fine.points, -fine.node_normals(), coarse, np.inf)
    missed = np.flatnonzero(found.facet < 0)
    nearest = cKDTree(coarse.points).query(fine.points[missed])[1]
    shape = (len(fine.points), len(coarse.points))
    return found.weights(coarse) + sparse.csr_matrix((np.ones(len(missed)), (missed, nearest)), shape=shape)
