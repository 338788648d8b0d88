"""Small scenes: what makes them, their surface problems at t = 1, their loads multiplied, their matrices."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Mat
from stickslip.solvers.interface.flexibility import Load
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.system.system import System, whole_stiffness
from stickslip.workflows.scene_file.read import from_dict

SceneOf = Callable[..., Scene]  # what the fixtures of tests/unit give
SimulationOf = Callable[[Scene], Simulation]
SystemOf = Callable[[Scene], System]


def plane(dim: int = 2) -> dict[str, Any]:
    """The obstacle y = 0, z = 0 in 3D."""
    return {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}


def scene_of(dim: int = 2, geometry: dict[str, Any] | None = None, **tables: Any) -> Scene:
    """A block on the foundation y = 0 (z = 0 in 3D), E = 1 Pa, nu = 0.3; keywords replace or add whole tables."""
    width = {"width": 1.0} if dim == 3 else {}
    shape = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.25 if dim == 2 else 0.5} | width
    data = {
        "model": "plane strain" if dim == 2 else "3d",
        "geometry": shape | (geometry or {}),
        "bodies": {"block": {"E": 1.0, "nu": 0.3}},
        "obstacles": {"foundation": plane(dim)},
    }
    return from_dict(data | tables)


def surface_problem(simulation: Simulation) -> SurfaceProblem:
    """As it is solved at t = 1."""
    stepper = simulation.stepper
    return stepper.reach(stepper.start(), 1.0, lambda row: None).problem


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
