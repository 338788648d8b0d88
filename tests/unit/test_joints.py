"""Parts of a mesh that hang together at points or along edges: a mechanism is found, and only a mechanism."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated, Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_array_equal

from shared.matrices import whole
from shared.problems import SceneOf
from stickslip import Block
from stickslip.geometry.arrays import Ints
from stickslip.geometry.errors import SceneError
from stickslip.geometry.keys import Key
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.mesh.joints import Joints, find_parts
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.shape import Request
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.solvers.stepping.choice import choose
from stickslip.solvers.system.system import System, assemble

Places = tuple[tuple[int, ...], ...]
CORNERS = {2: [(0, 0), (1, 0), (1, 1), (0, 1)], 3: []}
CORNERS[3] = [(*corner, z) for z in (0, 1) for corner in CORNERS[2]]  # type: ignore[misc]
KINDS = {2: (3, 1, 4), 3: (5, 3, 8)}  # gmsh's types of cells and facets; corners of a cell
SIZE = 4  # voxels along each axis


@dataclass(frozen=True, kw_only=True)
class Voxels(Block):
    """Squares or cubes of 1 m at places of a grid, as images give them; sides bottom and top, where there are any."""

    places: Annotated[Places, Key("m", "lower corners")]

    def cell_count(self, request: Request) -> float:
        return float(len(self.places))

    def put(self, gmsh: Any, request: Request) -> float:
        dim = request.dim
        corners = np.array(self.places)[:, None] + np.array(CORNERS[dim])
        points, rows = np.unique(corners.reshape(-1, dim), axis=0, return_inverse=True)
        cells = rows.reshape(len(corners), -1)
        kind, facet, _ = KINDS[dim]
        gmsh.model.addDiscreteEntity(dim, 1)
        tags = np.arange(1, len(points) + 1)
        gmsh.model.mesh.addNodes(dim, 1, tags, np.pad(points, ((0, 0), (0, 3 - dim))).ravel().astype(float))
        gmsh.model.mesh.addElementsByType(1, kind, [], (cells + 1).ravel())
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [1]), "block")
        for number, (name, row, level) in enumerate((("bottom", 0, 0), ("top", 1, SIZE)), start=1):
            local = [(0, 1), (3, 2)][row] if dim == 2 else [(0, 1, 2, 3), (4, 5, 6, 7)][row]
            there = cells[:, local][corners[:, local[0], dim - 1] == level]
            if len(there):
                gmsh.model.addDiscreteEntity(dim - 1, number)
                gmsh.model.mesh.addElementsByType(number, facet, [], (there + 1).ravel())
                tag = gmsh.model.addPhysicalGroup(dim - 1, [number])
                gmsh.model.setPhysicalName(dim - 1, tag, f"block.{name}")
        return 1.0


def voxels(places: Places, degree: Any = 1) -> Voxels:
    width = float(SIZE) if len(places[0]) == 3 else None
    return Voxels(length=float(SIZE), height=float(SIZE), width=width, mesh_size=1.0, order=degree, places=places)


def found_in(places: Places) -> tuple[Ints, Joints]:
    with gmsh_session() as gmsh:
        voxels(places).put(gmsh, Request(model="plane strain" if len(places[0]) == 2 else "3d"))
        return find_parts(gmsh, len(places[0]), 2.0)


def test_squares_that_share_a_corner_are_hinged_there() -> None:
    parts, joints = found_in(((0, 0), (1, 1)))
    assert_array_equal(parts, [0, 0, 0, 0, 1, 1, 1])
    assert_array_equal(joints.points, [[2.0, 2.0]])  # in metres
    assert_array_equal(joints.parts, [[0, 1]])


def test_cells_that_share_facets_are_one_part_and_others_are_numbered_by_their_nodes() -> None:
    parts, joints = found_in(((2, 2), (2, 1), (0, 0)))
    assert_array_equal(parts, [0] * 4 + [1] * 6)
    assert len(joints.points) == 0


def test_cubes_that_share_an_edge_are_hinged_along_it() -> None:
    parts, joints = found_in(((0, 0, 0), (1, 1, 0)))
    assert parts.max() == 1
    assert_array_equal(joints.points, [[2.0, 2.0, 0.0], [2.0, 2.0, 2.0]])


def test_corners_that_hold_each_other_make_one_part() -> None:
    """A bow of squares closed by a square at two corners; cubes around a corner, each pair with an edge."""
    ring: Places = ((0, 1), (0, 0), (1, 0), (2, 0), (2, 1), (1, 2))
    for places in (ring, ((0, 0, 0), (1, 1, 0), (1, 0, 1), (0, 1, 1), (2, 1, 0), (2, 0, 0), (1, 0, 0))):
        parts, joints = found_in(places)
        assert parts.max() == 0
        assert len(joints.points) == 0


def drawn(dim: int, seed: int) -> Places:
    """Some places of the grid."""
    grid = np.array(list(product(range(SIZE), repeat=dim)))
    random = np.random.default_rng(seed)
    return tuple(map(tuple, grid[random.random(len(grid)) < random.uniform(0.3, 0.55)].tolist()))


def system_of(scene: Scene, places: Places, degree: int = 1) -> System:
    problem = resolve(scene)
    return assemble(problem, build_mesh(voxels(places, degree), scene.request(), MPI.COMM_SELF), Counters())


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("model", "degree"), [("plane strain", 1), ("plane strain", 2), ("axisymmetric", 1), ("3d", 1)]
)
def test_modes_are_those_of_the_stiffness(model: str, degree: int, seed: int, scene_of: SceneOf) -> None:
    """Motions without strain are the null space of K, found from its eigenvalues."""
    dim = 3 if model == "3d" else 2
    scene = scene_of(dim, model=model, contacts={})
    system = system_of(scene, drawn(dim, seed), degree)
    K = whole(system).convert("dense").getDenseArray()
    if model == "axisymmetric":
        (free,) = np.nonzero(system.T.getDiagonal().array)
        K = K[np.ix_(free, free)]
    sizes = np.linalg.eigvalsh((K + K.T) / 2)
    assert system.lifting.unresisted.shape[1] == np.sum(sizes < 1e-9 * sizes[-1])


GRAVITY = {"gravity": {"acceleration": [0.0, -2.0]}, "bodies": {"block": {"E": 1e4, "nu": 0.3, "density": 3.0}}}
HINGED = ((0, 0), (1, 1))
NEAR = {"near": {"point": [0.0, 0.0], "displacement": {"x": 0.0, "y": 0.0}},
        "too": {"point": [0.0, 1.0], "displacement": {"x": 0.0}}}  # fmt: skip
FAR = {"far": {"point": [2.0, 2.0], "displacement": {"x": 0.0, "y": 0.0}},
       "too": {"point": [2.0, 1.0], "displacement": {"x": 0.0}}}  # fmt: skip
BASE = {"surface": "block.bottom", "against": "foundation"}


def simulation_of(scene: Scene, places: Places) -> Simulation:
    return prepare(replace(scene, geometry=voxels(places), output=Output(error=False)), MPI.COMM_SELF)


def test_part_that_turns_is_refused_and_the_place_named(scene_of: SceneOf) -> None:
    scene = scene_of(contacts={"base": BASE}, supports=NEAR)
    said = (
        r"supports: a part of the mesh that no contact touches can turn about \(1, 1\), where it hangs on the rest by"
    )
    with pytest.raises(SceneError, match=said):
        simulation_of(scene, HINGED)
    simulation_of(scene, (*HINGED, (0, 1)))  # joined by facets


def test_chain_that_is_held_at_its_ends_gives_way_between(scene_of: SceneOf) -> None:
    """Each of its parts is held at one end or hangs in two hinges; together they move."""
    ends = NEAR | {"end": {"point": [4.0, 4.0], "displacement": {"x": 0.0, "y": 0.0}}}
    with pytest.raises(SceneError, match=r"that no contact touches can turn about \([123], [123]\)"):
        simulation_of(scene_of(contacts={"base": BASE}, supports=ends), ((0, 0), (1, 1), (2, 2), (3, 3)))


def test_thousands_of_parts_are_refused_at_once(scene_of: SceneOf) -> None:
    """Their rigid motions would fill the memory."""
    places = tuple((i, j) for i in range(80) for j in range(80) if (i + j) % 2 == 0 and (i, j) != (0, 2))
    with pytest.raises(SceneError, match=r"can turn about \(\d+, \d+\)"):
        simulation_of(scene_of(contacts={"base": BASE}, supports=NEAR), places)


def test_part_that_turns_is_no_mechanism_where_a_support_holds_it(scene_of: SceneOf) -> None:
    held = NEAR | {"end": {"point": [2.0, 1.0], "displacement": {"y": 0.0}}}
    simulation = simulation_of(scene_of(contacts={"base": BASE}, supports=held), HINGED)
    assert simulation.system.interface.rigid_modes.shape[1] == 0


def test_part_that_hangs_in_a_hinge_rests_on_contact(scene_of: SceneOf) -> None:
    """Moments about the hinge: the pressure under the square balances its weight."""
    scene = scene_of(contacts={"base": BASE}, supports=FAR, **GRAVITY)
    simulation = simulation_of(scene, HINGED)
    assert all(METHODS[stage.method].WORKS_WITH.floating for stage in choose(simulation.system).stages)
    (step,) = simulation.steps()
    base = step.contacts["base"]
    assert base.normal_force > 0
    assert base.normal_force * 1.0 - base.moment[0] == pytest.approx(0.5 * 6.0, rel=1e-9)
    (joined,) = simulation_of(scene, (*HINGED, (1, 0))).steps()  # by facets to a square under the hinge
    base = joined.contacts["base"]
    assert base.normal_force * 1.0 - base.moment[0] != pytest.approx(0.5 * 6.0, rel=0.1)


def test_what_contact_alone_holds_is_refused_to_methods_that_cannot(scene_of: SceneOf) -> None:
    scene = scene_of(contacts={"base": BASE}, supports=FAR, solver={"method": "uzawa"}, **GRAVITY)
    with pytest.raises(SceneError, match=r"solver\.method = uzawa: needs bodies that their supports hold in all parts"):
        simulation_of(scene, HINGED)


def test_part_that_slides_without_friction_is_refused(scene_of: SceneOf) -> None:
    apart = ((0, 0), (2, 2))
    held = {"top": {"point": [3.0, 3.0], "displacement": {"x": 0.0, "y": 0.0}},
            "too": {"point": [3.0, 2.0], "displacement": {"x": 0.0}}}  # fmt: skip
    scene = scene_of(contacts={"base": BASE}, supports=held, **GRAVITY)
    with pytest.raises(SceneError, match="that contact does not resist can move as a whole; hold it"):
        simulation_of(scene, apart)
    rough = BASE | {"friction": {"law": "coulomb", "mu": 0.3}}
    (step,) = simulation_of(scene_of(contacts={"base": rough}, supports=held, **GRAVITY), apart).steps()
    assert step.contacts["base"].normal_force == pytest.approx(6.0, rel=1e-9)  # its weight


def test_cubes_turn_about_an_edge(scene_of: SceneOf) -> None:
    held = {f"at_{k}": {"point": [0.0, *x], "displacement": dict.fromkeys("xyz", 0.0)}
            for k, x in enumerate(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))}  # fmt: skip
    scene = scene_of(3, contacts={"base": BASE}, supports=held)
    with pytest.raises(SceneError, match=r"can turn about \(1, 1, [01]\)"):
        simulation_of(scene, ((0, 0, 0), (1, 1, 0)))
