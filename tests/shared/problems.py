"""Small scenes: what makes them, their surface problems at t = 1, their loads multiplied, their matrices."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from stickslip import Scene, Simulation, prepare
from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Mat
from stickslip.solvers.accuracy.two_level import MeshCorrection
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.flexibility import Load
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.solvers.system.system import System, whole_stiffness
from stickslip.workflows.scene_file.read import from_dict

Tables = dict[str, Any]
SceneOf = Callable[..., Scene]  # what the fixtures of tests/unit give
SimulationOf = Callable[[Scene], Simulation]
SystemOf = Callable[[Scene], System]


NORMAL: dict[str, dict[str, Any]] = {
    "unilateral": {"law": "unilateral"},
    "bilateral": {"law": "bilateral"},
    "linear": {"law": "compliance", "c_n": 20.0},
    "power": {"law": "compliance", "c_n": 20.0, "m_n": 2.0},
}
FRICTION: dict[str, dict[str, Any]] = {
    "coulomb": {"law": "coulomb", "mu": 0.4},
    "tresca": {"law": "tresca", "bound": 0.02},
    "stick": {"law": "stick"},
    "penetration": {"law": "compliance", "c_T": 1.6},
    "penetration squared": {"law": "compliance", "c_T": 8.0, "m_T": 2.0},
    "soft coulomb": {"law": "coulomb", "mu": 0.1, "k_T": 5.0},
    "soft tresca": {"law": "tresca", "bound": 0.02, "k_T": 5.0},
    "soft stick": {"law": "stick", "k_T": 5.0},
}


def plane(dim: int = 2) -> dict[str, Any]:
    """The obstacle y = 0, z = 0 in 3D."""
    return {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}


def scene_of(dim: int = 2, geometry: Any = None, base: Any = None, top: Any = None, **tables: Any) -> Scene:
    """A block on the foundation y = 0 (z = 0 in 3D), E = 1 Pa, nu = 0.3; keywords replace or add whole tables.

    `base` is what is said of a contact of its bottom besides the two sides, `top` a displacement of its top.
    """
    if base is not None:
        tables["contacts"] = {"base": {"surface": "block.bottom", "against": "foundation"} | base}
    if top is not None:
        tables["supports"] = {"top": {"boundary": "block.top", "displacement": top}}
    width = {"width": 1.0} if dim == 3 else {}
    shape = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.25 if dim == 2 else 0.5} | width
    data = {
        "model": "plane strain" if dim == 2 else "3d",
        "geometry": shape | (geometry or {}),
        "bodies": {"block": {"E": 1.0, "nu": 0.3}},
        "obstacles": {"foundation": plane(dim)},
    }
    return from_dict(data | tables)


def pressed(dim: int = 2, normal: str = "unilateral", friction: Any = "coulomb", **tables: Any) -> Scene:
    """The block pressed and dragged in one step, by the top and by the foundation; in 3D along both axes.

    Args:
        normal: a name in `NORMAL`, or of a law without parameters.
        friction: a name in `FRICTION`, or a table, or None.
    """
    drag = {"x": 0.06, "y": -0.1} if dim == 2 else {"x": 0.06, "y": 0.03, "z": -0.1}
    laws = {"normal": NORMAL.get(normal, {"law": normal})}
    laws |= {"friction": FRICTION[friction] if isinstance(friction, str) else friction} if friction else {}
    made: dict[str, Any] = {
        "obstacles": {"foundation": plane(dim) | {"displacement": {"x": -0.01, "y": 0.02}}},
        "contacts": {"base": {"surface": "block.bottom", "against": "foundation"} | laws},
        "supports": {"top": {"boundary": "block.top", "displacement": drag}},
    }
    return scene_of(dim, **(made | tables))


def two_blocks(dim: int, top: dict[str, Any], joint: dict[str, Any] | None = None, **tables: Any) -> Scene:
    """A block on another one whose mesh does not match; the upper one's top is moved, the lower one is held.

    Args:
        top: displacement of the upper block's top.
        joint: keys of the contact between them.
        tables: replace or add whole tables, but keys of the geometry.
    """
    width = {"width": 0.5} if dim == 3 else {}
    shape = {"builder": "two_blocks", "length": 2.0, "height": 0.5, "mesh_size": 0.25, "lower_mesh_size": 0.3} | width
    made: dict[str, Any] = {
        "model": "plane strain" if dim == 2 else "3d",
        "geometry": shape | tables.pop("geometry", {}),
        "bodies": {"upper": {"E": 1.0, "nu": 0.3}, "lower": {"E": 1.0, "nu": 0.3}},
        "contacts": {"joint": {"surface": "upper.bottom", "against": "lower.top"} | (joint or {})},
        "supports": {
            "bed": {"boundary": "lower.bottom", "displacement": dict.fromkeys("xyz"[:dim], 0.0)},
            "top": {"boundary": "upper.top", "displacement": top},
        },
    }
    return from_dict(made | tables)


def on_floor(dim: int, geometry: Tables, body: Tables, base: Tables, **more: Any) -> Tables:
    """Tables of a scene: a block, 2 m by 1 m (by 1 m) if its geometry has no other, and the plane under it."""
    sizes = {"builder": "block", "length": 2.0, "height": 1.0} | ({"width": 1.0} if dim == 3 else {})
    return {
        "model": "plane strain" if dim == 2 else "3d",
        "geometry": sizes | geometry,
        "bodies": {"block": {"E": 1.0, "nu": 0.3} | body},
        "obstacles": {"floor": plane(dim)},
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


def followed(scene: Scene) -> Simulation:
    """The scene ready to be solved, its steps followed with bubbles, as where order 2 is too dear."""
    simulation = prepare(scene)
    if MeshCorrection.works_for(simulation.stepper):
        simulation.stepper.companion = MeshCorrection(simulation.stepper)
    return simulation
