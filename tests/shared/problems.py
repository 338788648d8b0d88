"""Small scenes: what makes them, their surface problems at t = 1, their loads multiplied, their matrices."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from stickslip import Scene, Simulation
from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Mat
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.flexibility import Load
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.solvers.system.system import System, whole_stiffness

Tables = dict[str, Any]
SceneOf = Callable[..., Scene]  # what the fixtures of tests/unit give
SimulationOf = Callable[[Scene], Simulation]
SystemOf = Callable[[Scene], System]


def on_floor(dim: int, geometry: Tables, body: Tables, base: Tables, **more: Any) -> Tables:
    """Tables of a scene: a block, 2 m by 1 m (by 1 m) if its geometry has no other, and the plane under it."""
    sizes = {"builder": "block", "length": 2.0, "height": 1.0} | ({"width": 1.0} if dim == 3 else {})
    return {
        "model": "plane strain" if dim == 2 else "3d",
        "geometry": sizes | geometry,
        "bodies": {"block": {"E": 1.0, "nu": 0.3} | body},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}},
        "contacts": {"base": {"surface": "block.bottom", "against": "floor"} | base},
    } | more


def surface_problem(simulation: Simulation) -> SurfaceProblem:
    """As it is solved at t = 1."""
    return march(simulation, 1.0)[0].problem


def march(simulation: Simulation, *times: float) -> list[Accepted]:
    """Steps to these times, or to all that the scene requests, with all that the stepper knows of them."""
    reached: list[Accepted] = []
    for time in times or simulation.scene.requested_times():
        before = reached[-1].state if reached else simulation.stepper.start()
        reached.append(simulation.stepper.reach(before, time, lambda row: None))
    return reached


def condensed_surface(system: System) -> CondensedSurface:
    """The bodies condensed onto their contact dofs, with counters of their own."""
    surface = prepare_surface(system, FactorisedVolume(system.K_B, system.interface.dofs, Counters()))
    assert isinstance(surface, CondensedSurface)
    return surface


def times(load: Load, factor: float) -> Load:
    """The same load, so many times as large."""
    f_q = load.f_q.copy()
    f_q.scale(factor)
    return replace(load, f_q=f_q, f_c=factor * load.f_c, resultant=factor * load.resultant, free=factor * load.free)


def dense(matrix: Any) -> Array:
    """A PETSc matrix of one rank, as an array."""
    indptr, indices, data = matrix.getValuesCSR()
    found = np.zeros(matrix.size)
    for row, (i, j) in enumerate(pairwise(indptr)):
        found[row, indices[i:j]] = data[i:j]
    return found


def whole(system: System) -> Mat:
    """K of all displacements, assembled for itself."""
    return whole_stiffness(system.problem, system.weak, system.constraints.links, system.dilatation)
