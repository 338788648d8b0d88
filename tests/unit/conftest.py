"""Small blocks to try the parts on: a scene in a few words, its system, its steps."""

from typing import Any

import pytest
from mpi4py import MPI

from shared.problems import SceneOf, SimulationOf, SystemOf
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation import simulation
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.system.system import System, assemble
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict


@pytest.fixture(scope="session")
def scene_of() -> SceneOf:
    """A block on the foundation y = 0 (z = 0 in 3D), E = 1 Pa, nu = 0.3; keywords replace or add whole tables.

    `base` is what is said of a contact of its bottom besides the two sides, `top` a displacement of its top.
    """

    def make(dim: int = 2, geometry: Any = None, base: Any = None, top: Any = None, **tables: Any) -> Scene:
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
            "obstacles": {"foundation": {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}},
        }
        return from_dict(data | tables)

    return make


@pytest.fixture(scope="session")
def system_of() -> SystemOf:
    """The scene meshed and assembled; nothing is factorised."""

    def make(scene: Scene) -> System:
        return assemble(resolve(scene), build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF), Counters())

    return make


@pytest.fixture(scope="session")
def simulation_of() -> SimulationOf:
    """The scene ready to be solved, without estimates of errors."""
    return lambda scene: prepare(scene, MPI.COMM_SELF)


@pytest.fixture(scope="session")
def estimating() -> SimulationOf:
    """The scene ready to be solved, with estimates of errors."""
    return lambda scene: simulation.prepare(scene, MPI.COMM_SELF)
