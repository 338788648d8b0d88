"""The bodies of a run on another mesh, for a comparison of the same history."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from stickslip.geometry.arrays import Ints
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.shape import Shape
from stickslip.geometry.surfaces.surface import gather_surface
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.parallel.gather import nodes_of
from stickslip.solvers.results.step_result import Errors, MeshData, StepResult
from stickslip.solvers.scene.settings import Solver
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.stepper import Stepper
from stickslip.solvers.system.system import System, assemble


class OtherMeshRun(ABC):
    """Estimates the error of the mesh of a solved run of order 2, from its history on another mesh; collective."""

    DIM: ClassVar[int]  # of the models that it is for

    @classmethod
    def works_for(cls, stepper: Stepper) -> bool:
        """Whether it can: order 2 in its dimension, with contact, by a method with the exact contact laws."""
        mesh, contacts = stepper.system.mesh, stepper.system.contacts
        return mesh.degree == 2 and mesh.dim == cls.DIM and len(contacts) > 0 and stepper.chain.exact_laws

    def __init__(
        self, stepper: Stepper, data: MeshData, on_iteration: Callable[[HistoryRow], None] = lambda row: None
    ) -> None:
        """
        Args:
            stepper: of the run.
            data: its mesh.
            on_iteration: called after each iteration, on every rank.
        """
        self._stepper, self._data, self._on_iteration = stepper, data, on_iteration

    @abstractmethod
    def __call__(self, steps: Sequence[StepResult]) -> tuple[Errors, ...]:
        """Mesh and geometry of the errors of the first steps, up to one that fails or that the run has cut; collective.

        Args:
            steps: results at the requested times of a run from rest, without a gap.
        """


def on_other_mesh(own: System, mesh: Shape, counters: Counters) -> Stepper:
    """The bodies of a system on another mesh, by the default method at the same tolerance; collective.

    Args:
        mesh: on every rank.

    Raises:
        StickslipError: they cannot be prepared.
    """
    problem = replace(own.problem, solver=replace(Solver.default(), tolerance=own.problem.solver.tolerance))
    system = assemble(problem, build_mesh(mesh, problem.request, own.mesh.comm), counters)
    return Stepper(system, MethodChain(system))


def sides_of(system: System) -> Mapping[str, Ints]:
    """Facets (f, k) of all sides of a system's mesh by the numbers of all its nodes, on rank 0; collective."""
    mesh, nodes = system.mesh, system.nodes
    known = nodes_of(mesh, nodes)(nodes.input[: nodes.owned])
    sides = {name: gather_surface(mesh, system.space, nodes, name) for name in mesh.sides}
    if mesh.comm.rank:
        return {}
    return {name: np.searchsorted(known, side.input)[side.facets] for name, side in sides.items()}
