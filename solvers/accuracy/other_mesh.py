"""The bodies of a run on another mesh, for a comparison of the same history."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import Ints
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.shape import Shape
from stickslip.geometry.surfaces.surface import gather_surface
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.parallel.gather import nodes_of
from stickslip.solvers.scene.settings import Solver
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.stepper import Stepper
from stickslip.solvers.system.system import System, assemble


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
