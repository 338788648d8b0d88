"""What holds bodies: supports, hinges, contact and friction; and what nothing pushes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import pairwise, product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose, assert_array_equal

from shared.audited import record_of, stored_by
from shared.cases import often
from shared.drawn import scene_data
from shared.problems import dense, plane, scene_of, surface_problem, times, whole
from stickslip import Block
from stickslip.geometry.arrays import CLOSE, ROUNDING, Array, Ints, cross
from stickslip.geometry.errors import SceneError
from stickslip.geometry.keys import Key
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.mesh.joints import Joints, find_parts
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.shape import Request
from stickslip.geometry.surfaces.surface import Surface, gather_surface
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.fem.constraints import Components, Constraints
from stickslip.solvers.fem.rigid_fields import rigid_fields
from stickslip.solvers.interface.limit_analysis import (
    Balance,
    Mechanism,
    balancing_tractions,
    closes,
    decide,
    spent,
    unbalanced_motion,
)
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.newton import condensed_system
from stickslip.solvers.newton.active_set import linearise
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.resolve import resolve, unresisted
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.simulation.simulation import prepare as estimating
from stickslip.solvers.stepping.choice import choose
from stickslip.solvers.stepping.stepper import NoEquilibriumError
from stickslip.solvers.system.stiffness import Stiffness
from stickslip.solvers.system.system import System, assemble
from stickslip.workflows.lab.verification.prepared import prepare, system_of
from stickslip.workflows.scene_file.read import from_dict, read

AXES = {"x": 0, "y": 1, "z": 2}
SIDES = {"periodic": {"sides": {"boundary": "block.right", "with": "block.left"}}}


def support(side: str, **displacement: Any) -> dict[str, Any]:
    return {"boundary": f"block.{side}", "displacement": displacement}


def surface(system: System, side: str) -> Surface:
    return gather_surface(system.mesh, system.space, system.nodes, side)


def free_columns(T: Any) -> Array:
    """T without the zero columns of eliminated numbers."""
    found = dense(T)
    return found[:, found.any(axis=0)]


def any_displacement(system: System, time: float) -> Array:
    """T q + u_s for random q, by node (n, d)."""
    T = dense(system.T)
    q = np.random.default_rng(3).normal(size=T.shape[1])
    u = T @ q + system.prescribed(time).array
    return np.asarray(u.reshape(-1, system.mesh.dim))


def holding(of: Constraints, held: Mapping[int, str], rows: Mapping[str, tuple[Any, float]]) -> Constraints:
    """The same mesh with other supports, each one letter with a direction and a value, at some nodes."""
    at = [(node, name) for node, names in held.items() for name in names]
    nodes, index = np.array([node for node, _ in at]), np.array([[*rows].index(name) for _, name in at])
    components = Components(
        node=nodes,
        directions=np.array([rows[name][0] for _, name in at]),
        drive=index,
        support=index,
        points=of.nodes.points[nodes],
    )
    drives = tuple(value for _, value in rows.values())
    return replace(of, drives=drives, supports=tuple(rows), components=components)


CASES: dict[str, tuple[int, dict[str, Any]]] = {
    "free": (2, {}),
    "one side": (2, {"supports": {"top": support("top", x=0.3, y=-0.1)}}),
    "corner from two sides": (2, {"supports": {"top": support("top", y=-0.1), "left": support("left", x=0.2)}}),
    "normal on two sides": (2, {"supports": {"a": support("left", normal=0.1), "b": support("bottom", normal=-0.2)}}),
    "one corner twice": (2, {"supports": {"top": support("top", x=0.1), "left": support("left", normal=-0.1)}}),
    "periodic": (2, SIDES),
    "periodic, held": (2, SIDES | {"supports": {"top": support("top", x=0.1, y=0.2), "base": support("bottom", y=0)}}),
    "3d edge": (3, {"supports": {"left": support("left", normal=0.1), "front": support("front", y=0.3)}}),
    "3d corner": (
        3, {"supports": {"a": support("left", x=0.1), "b": support("front", normal=0.3), "c": support("bottom", z=1)}},
    ),
    "3d periodic both ways": (
        3,
        {
            "periodic": SIDES["periodic"] | {"depth": {"boundary": "block.back", "with": "block.front"}},
            "supports": {"top": support("top", x=0.1, z=-0.2)},
        },
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_every_free_displacement_fulfils_what_is_prescribed(case: str) -> None:
    dim, tables = CASES[case]
    scene = scene_of(dim, **tables)
    system = system_of(scene)
    T = free_columns(system.T)
    assert T.shape[1] == system.constraints.free_total
    assert_allclose(T.T @ T, np.eye(T.shape[1]) * (T * T).sum(axis=0), atol=1e-14)  # no two free numbers mix
    if "periodic" not in tables:
        assert_allclose(T.T @ T, np.eye(T.shape[1]), atol=1e-14)
    for time in (0.5, 1.0):
        u = any_displacement(system, time)
        for held in scene.supports.values():
            side = surface(system, str(held.boundary))
            for axis, value in held.displacement.items():
                direction = side.node_normals()[0] if axis == "normal" else np.eye(dim)[AXES[axis]]
                assert_allclose(u[side.nodes] @ direction, float(value) * time, atol=1e-14)
        for slave_side, master_side in scene.request().periodic:
            slave, master = surface(system, slave_side), surface(system, master_side)
            shift = master.points.mean(axis=0) - slave.points.mean(axis=0)
            distance = np.linalg.norm(slave.points[:, None] + shift - master.points, axis=2)
            assert distance.min(axis=1).max() < 1e-12
            assert_array_equal(u[slave.nodes], u[master.nodes[distance.argmin(axis=1)]])


def test_stiffness_of_free_displacements_is_selected_or_transformed() -> None:
    selecting = {case: system_of(scene_of(dim, **tables)) for case, (dim, tables) in CASES.items()}
    free = selecting["free"]
    inclined = holding(free.constraints, {4: "a", 9: "a"}, {"a": ([0.6, 0.8], 0.3)})
    T = inclined.transformation()
    both = Stiffness.of(whole(free), T, inclined)
    selecting["inclined"] = replace(free, constraints=inclined, T=T, assembled=lambda: both)
    for case, system in selecting.items():
        assert system.constraints.selects == ("periodic" not in case and case != "inclined"), case
        T, gone = dense(system.T), system.constraints.eliminated()
        expected = T.T @ dense(whole(system)) @ T
        assert not expected[gone].any()
        assert not expected[:, gone].any()
        expected[gone, gone] = expected.trace() / system.constraints.free_total
        assert_allclose(dense(system.K_B), expected, atol=1e-14 * np.abs(expected).max(), err_msg=case)
        assert system.K_B.getBlockSize() == system.mesh.dim


def test_nothing_more_than_what_is_prescribed_is_held() -> None:
    # 9 x 5 nodes, 9 of them on top: x and y there, and the periodic image of the lower four on the right
    everywhere = 2 * 9 * 5
    free = {case: system_of(scene_of(2, **CASES[case][1])).constraints.free_total for case in list(CASES)[:6]}
    assert free["free"] == everywhere
    assert free["one side"] == everywhere - 2 * 9
    assert free["corner from two sides"] == free["normal on two sides"] == everywhere - 9 - 5
    assert free["one corner twice"] == everywhere - 9 - 5 + 1  # both hold x in the corner
    assert free["periodic"] == everywhere - 2 * 5


def test_an_inclined_direction_is_held_and_the_other_is_free() -> None:
    system = system_of(scene_of(3))
    directions = np.array([[1.0, 2.0, 2.0], [0.0, 3.0, 4.0]]) / np.array([[3.0], [5.0]])
    rows = {"a": (directions[0], 0.3), "b": (directions[1], -0.1)}
    inclined = holding(system.constraints, {4: "a", 9: "ab"}, rows)
    T = free_columns(inclined.transformation())
    assert inclined.free_total == 3 * system.nodes.total - 3 == T.shape[1]
    assert_allclose(T.T @ T, np.eye(T.shape[1]), atol=1e-14)
    u = (T @ np.random.default_rng(5).normal(size=T.shape[1])).reshape(-1, 3)
    u[inclined.prescribed_nodes] += inclined.prescribed(1.0)
    assert_allclose([u[4] @ directions[0], u[9] @ directions[0], u[9] @ directions[1]], [0.3, 0.3, -0.1], atol=1e-14)
    # a force along what holds is shared among those that hold, with nothing left over
    force = np.zeros((system.nodes.owned, 3))
    force[[4, 9]] = 0.7 * directions[0], -0.2 * directions[0] + 1.1 * directions[1]
    shares = inclined.reactions(force)
    assert_allclose(shares["a"][0], 0.5 * directions[0], atol=1e-14)
    assert_allclose(shares["b"][0], 1.1 * directions[1], atol=1e-14)


def test_supports_that_contradict_are_refused_by_name() -> None:
    at_corner = {"lid": support("top", y=-0.1), "wall": support("left", y=0.0)}
    with pytest.raises(
        SceneError, match=r"supports\.lid and supports\.wall: contradict each other at the point \(0, 1\)"
    ):
        system_of(scene_of(supports=at_corner))
    later = {"lid": support("top", y=[[0, 0], [1, 0], [2, -0.1]]), "wall": support("left", y=0.0)}
    steps = {"end": 2.0, "count": 4}
    with pytest.raises(SceneError, match=r"supports\.lid and supports\.wall: .* at t = 1\.5"):
        system_of(scene_of(supports=later, steps=steps))
    images = SIDES | {"supports": {"one": support("left", x=0.1), "other": support("right", x=0.2)}}
    with pytest.raises(SceneError, match=r"supports\.one and supports\.other: contradict"):
        system_of(scene_of(**images))


def test_a_point_support_away_from_every_vertex_is_refused() -> None:
    pin = {"pin": {"point": [0.01, 0.0], "displacement": {"x": 0.0}}}
    with pytest.raises(SceneError, match=r"supports\.pin\.point = \[0\.01, 0\.0\]: .* the nearest is \(0, 0\)"):
        system_of(scene_of(supports=pin))


MOTIONS: list[tuple[int, dict[str, Any], int, str]] = [
    (2, {}, 3, "free"),
    (3, {}, 6, "free"),
    (2, {"a": support("left", x=0.0, y=0.0)}, 0, "one side held"),
    (3, {"a": support("left", x=0.0, y=0.0, z=0.0)}, 0, "one side held"),
    (2, {"a": support("left", x=0.0)}, 1, "slides along y"),
    (2, {"a": support("left", y=0.0)}, 2, "slides along x, and turns about the side: its points then move along x"),
    (2, {"a": {"point": [0.0, 0.0], "displacement": {"x": 0.0, "y": 0.0}}}, 1, "turns about the pin"),
    (3, {"a": support("bottom", z=0.0)}, 3, "slides in the plane and turns about z"),
    (3, {"a": support("bottom", z=0.0), "b": support("left", x=0.0)}, 1, "slides along y"),
    (3, {"a": {"point": [0.0, 0.0, 0.0], "displacement": {"x": 0.0, "y": 0.0, "z": 0.0}}}, 3, "turns about the pin"),
]


@pytest.mark.parametrize(("dim", "supports", "count", "why"), MOTIONS)
def test_rigid_motions_left_free_are_counted(dim: int, supports: Mapping[str, Any], count: int, why: str) -> None:
    system = system_of(scene_of(dim, supports=supports))
    low, high = system.mesh.box()
    motions = system.lifting.unresisted
    assert motions.shape[1] == count, why
    # each is a displacement without strain that the supports allow
    points = system.nodes.points[np.argsort(system.nodes.number)]
    fields = rigid_fields(points, (low + high) / 2, float(np.max(high - low)), axisymmetric=False) @ motions
    T = dense(system.T)
    for field in np.moveaxis(fields, 2, 0):
        assert_allclose(T @ (T.T @ field.ravel()), field.ravel(), atol=1e-12)
        K_u = dense(whole(system)) @ field.ravel()
        assert np.abs(K_u).max() < 1e-12 * np.abs(dense(whole(system))).max()


def test_a_prescribed_rigid_motion_follows_the_time_and_its_values() -> None:
    system = system_of(scene_of(supports={"top": support("top", x=0.3, y=-0.1)}))
    other = scene_of(supports={"top": support("top", x=0.6, y=-0.1)}).timeline()
    (place,) = (place for place, value in other.amplitudes.items() if value == 0.6)

    def along_x(time: float) -> float:
        motion = system.rigid_motion(time)
        return float(motion[0, 0])

    assert [along_x(1.0), along_x(0.5), along_x(1.0)] == pytest.approx([0.3, 0.15, 0.3])
    with system.course.following(other):
        assert along_x(1.0) == pytest.approx(0.6)
    assert along_x(1.0) == pytest.approx(0.3)
    system.course.found = {place: 0.9}
    assert along_x(1.0) == pytest.approx(0.9)


def test_a_periodic_block_moves_but_does_not_turn() -> None:
    system = system_of(scene_of(**SIDES))
    motions = system.lifting.unresisted
    assert motions.shape[1] == 2
    assert_allclose(motions[2], 0.0, atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_reactions_contact_and_loads_balance(dim: int) -> None:
    """Moments of what acts where points are now are in balance to the square of the motion, which is small."""
    pull = {"x": 2e-9, "y": -5e-9} if dim == 2 else {"x": 2e-9, "y": 1e-9, "z": -5e-9}
    wall = {} if dim == 2 else {"wall": support("left", normal=-2e-9)}  # shares an edge with the top
    scene = scene_of(
        dim,
        contacts={"base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "stick"}}},
        supports={"top": support("top", **pull)} | wall,
        loads={"push": {"boundary": "block.right", "traction": [1e-9, -2e-9] + [5e-10] * (dim - 2)}},
    )
    simulation = prepare(scene)
    (step,) = simulation.steps()
    load = simulation.system.load(1.0).array.reshape(-1, dim)
    contact = step.contacts["base"]
    force = load.sum(axis=0) + contact.force + sum(f for f, _ in step.supports.values())
    moment = np.atleast_1d(cross(simulation.system.nodes.points, load).sum(axis=0)) + contact.moment
    moment = moment + sum(m for _, m in step.supports.values())
    largest = max(float(np.linalg.norm(f)) for f, _ in step.supports.values())
    assert min(contact.normal_force, largest) > 1e-9
    assert_allclose(force, 0.0, atol=1e-12 * largest)  # a direct solve
    assert_allclose(moment, 0.0, atol=3e-8 * largest)


TWO_BLOCKS = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 0.5};
Rectangle(2) = {2, 0, 0, 1, 0.5};
Physical Surface("a") = {1}; Physical Curve("a.bottom") = {1}; Physical Curve("a.top") = {3};
Physical Surface("b") = {2}; Physical Curve("b.bottom") = {5}; Physical Curve("b.top") = {7};
"""


def two_blocks(folder: Path, *held: str) -> Scene:
    """Two blocks side by side on one foundation; those that are held are pressed down by 0.01 m."""
    (folder / "two.geo").write_text(TWO_BLOCKS)
    contact = {"against": "foundation", "friction": {"law": "stick"}}
    data = scene_data("two.geo", mesh_size=0.2) | {
        "bodies": {"a": {"E": 1.0, "nu": 0.3}, "b": {"E": 2.0, "nu": 0.3}},
        "contacts": {name: {"surface": f"{name}.bottom"} | contact for name in "ab"},
        "supports": {name: {"boundary": f"{name}.top", "displacement": {"x": 0.0, "y": -0.01}} for name in held},
    }
    return from_dict(data, folder)


def test_each_part_of_a_mesh_that_falls_apart_is_held_by_its_own(tmp_path: Path) -> None:
    (step,) = prepare(two_blocks(tmp_path, "a", "b")).steps()
    a, b = (step.contacts[name].normal_force for name in "ab")
    assert_allclose(b, 2 * a, rtol=0.02)  # the same block of a material twice as stiff; their meshes differ
    # contact alone holds the other one, and nothing loads it
    (step,) = prepare(two_blocks(tmp_path, "a")).steps()
    assert_allclose(step.contacts["a"].normal_force, a, rtol=1e-7)
    assert abs(step.contacts["b"].normal_force) < 1e-9 * a
    # without contact it is loose
    loose = two_blocks(tmp_path, "a")
    with pytest.raises(SceneError, match=r"nothing resists the .* of bodies\.b"):
        make_plan(replace(loose, contacts={"a": loose.contacts["a"]}))


Places = tuple[tuple[int, ...], ...]
CORNERS = {2: [(0, 0), (1, 0), (1, 1), (0, 1)], 3: []}
CORNERS[3] = [(*corner, z) for z in (0, 1) for corner in CORNERS[2]]
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


@pytest.mark.parametrize(
    ("places", "parts", "points"),
    [
        (((0, 0), (1, 1)), [0, 0, 0, 0, 1, 1, 1], [[2.0, 2.0]]),  # squares that share a corner; in metres
        (((2, 2), (2, 1), (0, 0)), [0] * 4 + [1] * 6, []),  # by their nodes
        (((0, 0, 0), (1, 1, 0)), [0] * 8 + [1] * 6, [[2.0, 2.0, 0.0], [2.0, 2.0, 2.0]]),  # cubes that share an edge
    ],
)
def test_cells_that_share_facets_are_one_part_and_others_hinge_where_they_meet(
    places: Places, parts: list[int], points: list[list[float]]
) -> None:
    found, joints = found_in(places)
    assert_array_equal(found, parts)
    assert_array_equal(joints.points, np.reshape(points, (-1, len(places[0]))))
    assert np.all(joints.parts == [0, 1])


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


def voxel_system(scene: Scene, places: Places, degree: int = 1) -> System:
    problem = resolve(scene)
    return assemble(problem, build_mesh(voxels(places, degree), scene.request(), MPI.COMM_SELF), Counters())


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("model", "degree"), [("plane strain", 1), ("plane strain", 2), ("axisymmetric", 1), ("3d", 1)]
)
def test_modes_are_those_of_the_stiffness(model: str, degree: int, seed: int) -> None:
    """Motions without strain are the null space of K, found from its eigenvalues."""
    dim = 3 if model == "3d" else 2
    scene = scene_of(dim, model=model, contacts={})
    system = voxel_system(scene, drawn(dim, seed), degree)
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


def voxel_simulation(scene: Scene, places: Places) -> Simulation:
    return estimating(replace(scene, geometry=voxels(places), output=Output(error=False)))


MANY = tuple((i, j) for i in range(80) for j in range(80) if (i + j) % 2 == 0 and (i, j) != (0, 2))
AT_ITS_EDGE = {f"at_{k}": {"point": [0.0, *x], "displacement": dict.fromkeys("xyz", 0.0)}
               for k, x in enumerate(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))}  # fmt: skip
END = {"end": {"point": [4.0, 4.0], "displacement": {"x": 0.0, "y": 0.0}}}


@pytest.mark.parametrize(
    ("places", "supports", "where"),
    [
        (HINGED, NEAR, r"\(1, 1\), where it hangs on the rest by"),
        # a chain: each of its parts is held at one end or hangs in two hinges; together they move
        (((0, 0), (1, 1), (2, 2), (3, 3)), NEAR | END, r"\([123], [123]\)"),
        (MANY, NEAR, r"\(\d+, \d+\)"),  # thousands of parts at once: their rigid motions would fill the memory
        (((0, 0, 0), (1, 1, 0)), AT_ITS_EDGE, r"\(1, 1, [01]\)"),
    ],
    ids=["corner", "chain", "thousands", "edge"],
)
def test_part_that_turns_is_refused_and_the_place_named(places: Places, supports: Any, where: str) -> None:
    said = rf"supports: a part of the mesh that (no contact touches|contact does not resist) can turn about {where}"
    with pytest.raises(SceneError, match=said):
        voxel_simulation(scene_of(len(places[0]), contacts={"base": BASE}, supports=supports), places)


def test_squares_that_facets_join_are_no_mechanism() -> None:
    voxel_simulation(scene_of(contacts={"base": BASE}, supports=NEAR), (*HINGED, (0, 1)))


def test_part_that_turns_is_no_mechanism_where_a_support_holds_it() -> None:
    held = NEAR | {"end": {"point": [2.0, 1.0], "displacement": {"y": 0.0}}}
    simulation = voxel_simulation(scene_of(contacts={"base": BASE}, supports=held), HINGED)
    assert simulation.system.interface.rigid_modes.shape[1] == 0


def test_part_that_hangs_in_a_hinge_rests_on_contact() -> None:
    """Moments about the hinge: the pressure under the square balances its weight."""
    stiff = {"bodies": {"block": {"E": 1e10, "nu": 0.3, "density": 3.0}}}  # it does not turn, nor the pressure's arm
    scene = scene_of(contacts={"base": BASE}, supports=FAR, **(GRAVITY | stiff))
    simulation = voxel_simulation(scene, HINGED)
    assert all(METHODS[stage.method].WORKS_WITH.floating for stage in choose(simulation.system).stages)
    (step,) = simulation.steps()
    base = step.contacts["base"]
    assert base.normal_force > 0
    hinge = 1.0  # x
    assert base.normal_force * hinge - base.moment[0] == pytest.approx(0.5 * 6.0, rel=1e-7)
    (joined,) = voxel_simulation(scene, (*HINGED, (1, 0))).steps()  # by facets to a square under the hinge
    base = joined.contacts["base"]
    assert base.normal_force * 1.0 - base.moment[0] != pytest.approx(0.5 * 6.0, rel=0.1)


def test_what_contact_alone_holds_is_refused_to_methods_that_cannot() -> None:
    scene = scene_of(contacts={"base": BASE}, supports=FAR, solver={"method": "uzawa"}, **GRAVITY)
    with pytest.raises(SceneError, match=r"solver\.method = uzawa: needs bodies that their supports hold in all parts"):
        voxel_simulation(scene, HINGED)


def test_part_that_slides_without_friction_is_refused() -> None:
    apart = ((0, 0), (2, 2))
    held = {"top": {"point": [3.0, 3.0], "displacement": {"x": 0.0, "y": 0.0}},
            "too": {"point": [3.0, 2.0], "displacement": {"x": 0.0}}}  # fmt: skip
    scene = scene_of(contacts={"base": BASE}, supports=held, **GRAVITY)
    with pytest.raises(SceneError, match="that contact does not resist can move as a whole; hold it"):
        voxel_simulation(scene, apart)
    rough = BASE | {"friction": {"law": "coulomb", "mu": 0.3}}
    (step,) = voxel_simulation(scene_of(contacts={"base": rough}, supports=held, **GRAVITY), apart).steps()
    assert step.contacts["base"].normal_force == pytest.approx(6.0, rel=1e-9)  # its weight


LINEAR = {"law": "compliance", "c_n": 1e9, "m_n": 1.0}
COULOMB = {"law": "coulomb", "mu": 0.3}
UP_DOWN = [[0.0, 0.0], [1.0, 0.01], [2.0, -0.01]]
CLEAN = 1e-8


def block_on(floor: dict[str, Any], dim: int, contact: dict[str, Any], **more: Any) -> Scene:
    """A block without support or load on a floor."""
    tables: dict[str, Any] = {
        "bodies": {"block": {"E": 1e7, "nu": 0.3}},
        "obstacles": {"floor": plane(dim) | floor},
        "contacts": {"base": {"surface": "block.bottom", "against": "floor", "friction": COULOMB} | contact},
        "steps": {"end": 2.0, "count": 2},
    }
    return scene_of(dim, {"mesh_size": 0.5, "cells": "tensor"}, **tables | more)


def solved_cleanly(scene: Scene) -> list[StepResult]:
    """Its steps, which the audit finds clean with their fields."""
    simulation = prepare(scene)
    audit, steps = Auditor(simulation.problem, simulation.mesh), [*simulation.steps()]
    for before, step in pairwise([None, *steps]):
        assert step is not None
        assert max(asdict(audit(replace(record_of(step), stored=stored_by(step, before)))).values()) < CLEAN
    return steps


@pytest.mark.parametrize("contact", [{}, {"normal": LINEAR}, {"normal": LINEAR | {"m_n": 2.0}}, {"sliding": True}])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_floor_that_rises_lifts_a_body_and_leaves_it_there(dim: int, contact: dict[str, Any]) -> None:
    """Its other motions are nobody's: they are those of the step before, not what rounding makes of them."""
    axis = "xyz"[dim - 1]
    for step in prepare(block_on({"displacement": {axis: UP_DOWN}}, dim, contact)).steps():
        moved = step.displacement.reshape(-1, dim)
        assert_allclose(moved[:, :-1], 0.0, atol=1e-10)
        assert_allclose(moved[:, -1], 0.01, atol=1e-6)


def test_two_bodies_pressed_by_nothing_are_solved_to_rounding() -> None:
    """Tractions are what a stiff law makes of the last digits of motions; pairs are searched while steps are cut."""
    scene = scene_of(
        model="3d",
        geometry={"builder": "two_blocks", "length": 2.0, "height": 0.5, "width": 0.5, "mesh_size": 0.5,
                  "lower_mesh_size": 0.4, "cells": "tensor"},
        bodies={"upper": {"E": 1e7, "nu": 0.3}, "lower": {"E": 5e6, "nu": 0.2}},
        obstacles={},
        contacts={"base": {"surface": "upper.bottom", "against": "lower.top", "normal": LINEAR, "friction": COULOMB,
                           "sliding": True}},
        supports={"bed": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0, "z": UP_DOWN}}},
        steps={"end": 2.0, "count": 2},
    )  # fmt: skip
    for step in solved_cleanly(scene):
        assert step.substeps == 1
        assert step.iterations < 20
        assert np.abs(step.displacement).max() < 0.0101


@pytest.mark.parametrize("power", [1.0, 1.5, 3.0])
def test_a_released_body_rises_until_it_touches(power: float) -> None:
    """By Newton's method alone the penetration of a power law would shrink by a factor, step for step."""
    law = LINEAR | {"c_n": 1e7 * 1e-3 ** (1 - power), "m_n": power}
    weight = {"boundary": "block.top", "pressure": [[0.0, 0.0], [1.0, 1e4], [2.0, 0.0]]}
    pressed, released = solved_cleanly(block_on({}, 2, {"normal": law}, loads={"weight": weight}))
    assert_allclose(pressed.p[:4], 1e4, rtol=0.2)
    assert released.iterations <= 2
    assert np.abs(released.displacement).max() < 1e-9


def test_a_stiff_law_excuses_nothing_where_it_does_not_press() -> None:
    floor = {"displacement": {"y": UP_DOWN}}
    problem = surface_problem(prepare(block_on(floor, 2, {"normal": LINEAR})))
    (rows,) = problem.cone.contacts
    stiff = replace(rows, normal=Compliance(c_n=1e25))
    problem = replace(problem, cone=AdmissibleSet((stiff,), problem.cone.time, problem.cone.end))
    n, p = problem.surface.normal_rows, np.zeros(len(problem.gap))
    for pull in (0.5 * ROUNDING, 10 * ROUNDING):
        p[:n] = -pull * problem.p_ref
        assert problem.natural_residual(p, problem.gap) == pytest.approx(pull / CLOSE, rel=1e-4)


@pytest.fixture
def lifted() -> SurfaceProblem:
    """The second step, in which the floor leaves the block."""
    return surface_problem(prepare(block_on({"displacement": {"y": UP_DOWN}}, 2, {})))


def test_motions_that_nothing_resists_stay_if_nothing_pushes_along_them(lifted: SurfaceProblem) -> None:
    away, stood = np.full(len(lifted.gap), -1.0), np.random.default_rng(0).normal(size=lifted.surface.size)
    open_everywhere = linearise(lifted, away, lifted.gamma)
    p, u_c = condensed_system.solve(open_everywhere, stood)
    R = lifted.surface.R
    assert_array_equal(p, 0.0)
    assert_allclose(u_c, R @ (R.T @ stood), atol=1e-12)
    for mode in range(R.shape[1]):
        push = R[:, mode]
        load = replace(lifted.load, f_c=push, resultant=R.T @ push)
        with pytest.raises(np.linalg.LinAlgError):
            condensed_system.solve(replace(open_everywhere, problem=replace(lifted, load=load)), stood)


ProblemOf = Callable[..., SurfaceProblem]
PRESS = 0.2  # N on a block of 2 m (and 1 m wide in 3D)


@pytest.fixture
def problem_of(monkeypatch: pytest.MonkeyPatch) -> ProblemOf:
    """A block pressed onto the foundation and pulled along it, held by the contact alone; nothing is solved."""

    def make(
        dim: int, pull: list[float], friction: dict[str, Any], normal: str = "unilateral", **others: Any
    ) -> SurfaceProblem:
        area = 2.0
        normals = {"unilateral": {"law": "unilateral"}, "bilateral": {"law": "bilateral"},
                   "compliance": {"law": "compliance", "c_n": 20.0, "m_n": 2.0}}  # fmt: skip
        low = {"surface": "block.bottom", "against": "foundation", "friction": friction, "normal": normals[normal]}
        walls = {"wall": plane(dim) | {"normal": [1.0] + [0.0] * (dim - 1)}}
        scene = scene_of(
            dim,
            geometry={"cells": "tensor"},
            obstacles={"foundation": plane(dim)} | (walls if others else {}),
            contacts=others | {"base": low},
            loads={"lid": {"boundary": "block.bottom", "traction": [*(f / area for f in pull), -PRESS / area]}},
        )
        seen: list[SurfaceProblem] = []
        monkeypatch.setattr(
            "stickslip.solvers.stepping.substep.unbalanced_motion",
            lambda problem: seen.append(problem) or Mechanism(problem.surface.R[:, 0], 1.0),
        )
        monkeypatch.setattr("stickslip.solvers.stepping.halving.describe_motion", lambda system, motion, dofs: "")
        stepper = prepare(scene).stepper
        with pytest.raises(NoEquilibriumError, match="cannot balance"):
            stepper.reach(stepper.start(), 1.0, lambda row: None)
        return seen[0]

    return make


LAWS: list[tuple[dict[str, Any], float]] = [  # with the pull that they can just hold [N]
    ({"law": "coulomb", "mu": 0.3}, 0.3 * PRESS),
    ({"law": "coulomb", "mu": 0.3, "k_T": 7.0}, 0.3 * PRESS),
    ({"law": "tresca", "bound": 0.02}, 0.02 * 2.0),
    ({"law": "capped_coulomb", "mu": 0.3, "s_max": 0.01}, 0.01 * 2.0),
    ({"law": "cohesion", "a": 0.02, "mu": 0.3}, 0.3 * PRESS + 0.02 * 2.0),
]


@pytest.mark.parametrize(("friction", "limit"), LAWS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_pull_up_to_the_limit_is_possible_and_beyond_it_impossible(
    sign: float, friction: dict[str, Any], limit: float, problem_of: ProblemOf
) -> None:
    assert decide(problem_of(2, [sign * 0.9999 * limit], friction)) is Balance.POSSIBLE
    beyond = problem_of(2, [sign * 1.0001 * limit], friction)
    assert decide(beyond) is Balance.IMPOSSIBLE
    motion, lacking = unbalanced_motion(beyond)
    assert_allclose(np.abs(motion).max(), 1.0)
    assert sign * motion[::2].mean() > 0.9  # it slides with the pull
    borne = 0.0 if {"bound", "s_max"} & set(friction) else 0.3 * PRESS  # by a cone, which dissipates nothing
    assert_allclose(lacking, (1.0001 * limit - limit) / (1.0001 * limit - borne), rtol=1e-3)


@pytest.mark.parametrize("turn", often(range(0, 91, 15), (0, 15, 60)))
def test_polygons_enclose_the_disc_of_friction(turn: int, problem_of: ProblemOf) -> None:
    """In whatever direction: wrong answers never, undecided within the half per cent between the polygons."""
    way = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
    friction, limit = {"law": "coulomb", "mu": 0.3}, 0.3 * PRESS
    found = {
        share: decide(problem_of(3, (share * limit * way).tolist(), friction))
        for share in (0.994, 0.9999, 1.0001, 1.006)
    }
    assert (found[0.994], found[1.006]) == (Balance.POSSIBLE, Balance.IMPOSSIBLE)
    assert found[0.9999] is not Balance.IMPOSSIBLE
    assert found[1.0001] is not Balance.POSSIBLE


@pytest.mark.parametrize("dim", [2, 3])
def test_balancing_tractions_balance_and_lie_in_the_cone(dim: int, problem_of: ProblemOf) -> None:
    problem = problem_of(dim, [0.05, 0.01][: dim - 1], {"law": "coulomb", "mu": 0.3})
    p, surface = balancing_tractions(problem), problem.surface
    left = surface.R.T @ (problem.load.f_c - surface.forces(p))
    assert_allclose(left, 0.0, atol=1e-7 * np.abs(problem.load.f_c).sum())  # the programme's own tolerance
    assert_allclose(problem.project(p, problem.gamma), p, atol=1e-7 * np.abs(p).max())


def test_stick_holds_any_pull_but_no_lift(problem_of: ProblemOf) -> None:
    assert decide(problem_of(2, [50 * PRESS], {"law": "stick"})) is Balance.POSSIBLE
    pressed = problem_of(2, [0.0], {"law": "stick"})
    lifted = replace(pressed, load=times(pressed.load, -1.0))
    assert decide(lifted) is Balance.IMPOSSIBLE
    assert balancing_tractions(lifted) is None


@pytest.mark.parametrize(("m_T", "expected"), [(2.0, Balance.IMPOSSIBLE), (1.0, Balance.UNDECIDED)])
def test_bounds_that_are_no_lines_are_not_guessed(m_T: float, expected: Balance, problem_of: ProblemOf) -> None:
    """s = c_T delta^m_T at p = 20 delta²: m_T = 2 is Coulomb's law with mu = c_T / 20."""
    friction = {"law": "compliance", "c_T": 2.0, "m_T": m_T}
    assert decide(problem_of(2, [0.5 * PRESS], friction, "compliance")) is expected


def test_no_load_is_balanced_by_nothing(problem_of: ProblemOf) -> None:
    problem = problem_of(2, [0.01], {"law": "coulomb", "mu": 0.3})
    problem = replace(problem, load=times(problem.load, 0.0))
    assert decide(problem) is Balance.POSSIBLE
    assert not balancing_tractions(problem).any()


def test_the_answer_is_the_same_in_every_unit_and_rounding_of_forces_that_cancel_is_no_load(
    problem_of: ProblemOf,
) -> None:
    for share, expected in ((0.9999, Balance.POSSIBLE), (1.0001, Balance.IMPOSSIBLE)):
        problem = problem_of(2, [share * 0.3 * PRESS], {"law": "coulomb", "mu": 0.3})
        for unit in (1e-9, 1e9):
            assert decide(replace(problem, load=times(problem.load, unit))) is expected
    for left, expected in ((1e-12, Balance.POSSIBLE), (1e-6, Balance.IMPOSSIBLE)):
        load = replace(problem.load, resultant=left * problem_of(2, [2 * PRESS], COULOMB).load.resultant)
        assert decide(replace(problem, load=load)) is expected


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_bilateral_contact_pulls(sign: float, problem_of: ProblemOf) -> None:
    problem = problem_of(2, [0.9 * 0.04], {"law": "tresca", "bound": 0.02}, "bilateral")
    assert decide(replace(problem, load=times(problem.load, sign))) is Balance.POSSIBLE
    p = balancing_tractions(replace(problem, load=times(problem.load, sign)))
    assert sign * problem.surface.W[: problem.surface.normal_rows] @ p[: problem.surface.normal_rows] > 0.9 * PRESS


def test_more_is_held_than_is_proved_and_nothing_forbids_it(problem_of: ProblemOf) -> None:
    """A surface that pulls presses elsewhere as hard as need be: rigid bodies may be pressed and pulled."""
    assert decide(problem_of(2, [3 * PRESS], COULOMB, "bilateral")) is not Balance.IMPOSSIBLE
    for law in ({"law": "stick"}, {"law": "cohesion", "a": 1e4, "mu": 0.3}):
        assert decide(problem_of(2, [1005 * PRESS], law)) is Balance.UNDECIDED  # STEEP is 1000
        assert decide(problem_of(2, [1005 * PRESS], law, "bilateral")) is Balance.POSSIBLE


def test_a_wall_holds_what_is_pushed_against_it(problem_of: ProblemOf) -> None:
    """Two contacts: each has the rows and the friction of its own."""
    wall = {"surface": "block.left", "against": "wall", "friction": {"law": "coulomb", "mu": 0.8}}
    for pull, expected in ((-3.0, Balance.POSSIBLE), (0.29, Balance.POSSIBLE), (0.31, Balance.IMPOSSIBLE)):
        assert decide(problem_of(2, [pull * PRESS], {"law": "coulomb", "mu": 0.3}, wall=wall)) is expected
    problem = problem_of(2, [-3.0 * PRESS], {"law": "coulomb", "mu": 0.3}, wall=wall)
    p, (first, second) = balancing_tractions(problem), problem.cone.places
    for place, at_least in ((first, 2.6), (second, 0.0)):
        assert problem.surface.W[place.normal] @ p[place.normal] > at_least * PRESS
    assert_allclose(problem.project(p, problem.gamma), p, atol=1e-6 * np.abs(p).max())


def test_friction_takes_up_the_work_of_a_pull_at_given_pressures(problem_of: ProblemOf) -> None:
    for dim, share in product((2, 3), (0.29, 0.31)):
        problem = problem_of(dim, [share * PRESS, 0.0][: dim - 1], {"law": "coulomb", "mu": 0.3})
        surface, n = problem.surface, problem.surface.normal_rows
        p = np.where(np.arange(len(problem.gap)) < n, PRESS / surface.W[:n].sum(), 7.0)
        along = np.tile(np.eye(dim)[0], surface.size // dim)
        assert spent(problem, p, along) == (share > 0.3)
        assert not spent(problem, 1.01 * p, -np.tile(np.eye(dim)[-1], surface.size // dim))  # what presses is borne
        (rows,) = problem.cone.contacts
        less = replace(rows, free=rows.free & (np.arange(len(rows.free)) > 0)[:, None])
        other = replace(problem, cone=replace(problem.cone, contacts=(less,)))
        assert spent(other, p, along) or share < 0.3  # a direction without multiplier takes up nothing
    problem = problem_of(2, [0.0], {"law": "stick"}, "bilateral")
    lifted, up = replace(problem, load=times(problem.load, -1.0)), np.tile([0.0, 1.0], problem.surface.size // 2)
    area = problem.surface.W[: problem.surface.normal_rows].sum()
    for part in (0.9, 1.1):  # what does not slide is no work, however large its bound
        assert spent(lifted, np.full(len(problem.gap), -part * PRESS / area), up) == (part < 1)


def test_a_motion_closes_the_gaps_that_it_goes_towards(problem_of: ProblemOf) -> None:
    problem = problem_of(2, [0.0], COULOMB)
    n, down = problem.surface.normal_rows, -np.tile([0.0, 1.0], problem.surface.size // 2)
    gap = np.where(np.arange(len(problem.gap)) < n, 0.5, 9.0)
    for (w, widest), size in product(((0.0, 0.5), (0.25, 0.5), (-0.25, 0.75)), (1.0, 1e-9)):
        assert closes(replace(problem, gap=gap), np.full(len(gap), w), size * down) == widest
        assert closes(replace(problem, gap=gap), np.full(len(gap), w), -size * down) == 0.0


def test_a_body_that_nothing_touches_is_held_by_nothing_that_no_gap_closes(problem_of: ProblemOf) -> None:
    """Tresca's bound would bear a pull along the floor, if something touched."""
    pulled, pressed = (problem_of(2, [pull], {"law": "tresca", "bound": 0.02}) for pull in (0.03, 0.0))
    a, b = pulled.load, pressed.load
    along = replace(a, f_c=a.f_c - b.f_c, resultant=a.resultant - b.resultant, free=a.free - b.free)
    rests, n = replace(pulled, load=along), pulled.surface.normal_rows
    assert unbalanced_motion(rests) is None
    up, drift = np.tile([0.0, 1.0], rests.surface.size // 2), rests.surface.R @ along.resultant
    far = np.where(np.arange(len(rests.gap)) < n, 1e3, 0.0)
    elsewhere = replace(along, free=along.free - 1e3 * up)  # the augmentation tells nothing of where bodies are
    for away in (replace(rests, gap=rests.gap + far), replace(rests, u_before=1e3 * up, load=elsewhere)):
        motion, lacking = unbalanced_motion(away)
        assert lacking == 1.0
        assert_allclose(motion, drift / np.abs(drift).max())


def test_rigid_bodies_rest_where_gaps_are_small_and_evenly(problem_of: ProblemOf) -> None:
    """A gap that the motion of the foundation has closed is none."""
    problem = problem_of(2, [0.0], {"law": "coulomb", "mu": 0.3})
    n = problem.surface.normal_rows
    rows, W = np.arange(len(problem.gap)), problem.surface.W[: problem.surface.normal_rows]
    even = balancing_tractions(problem)
    assert_allclose(even[:n], PRESS / W.sum(), rtol=1e-6)
    (corners,) = np.nonzero(W / W.max() < 0.6)
    touching = np.isin(rows, corners)
    assert touching.sum() == 2
    for opening in (1e-3, 1.0, 1e3):  # small or large beside the motion without contact
        away = np.where((rows < n) & ~touching, opening * problem.u_ref, 0.0)
        rests = replace(problem, gap=problem.gap + away)
        moved = replace(rests, gap=rests.gap + 50 * problem.u_ref, offset=rests.offset + 50 * problem.u_ref)
        raised = replace(problem, offset=problem.offset - away)
        for case in (rests, moved, raised):
            p = balancing_tractions(case)
            assert_allclose(p[:n][touching[:n]], PRESS / W[touching[:n]].sum(), rtol=1e-5)
            assert_allclose(np.delete(p[:n], corners), 0.0, atol=1e-6 * PRESS)
    # in another unit of loads and lengths
    small = replace(
        rests,
        load=times(rests.load, 1e-9), gap=1e-9 * rests.gap, offset=1e-9 * rests.offset, force=1e-9 * rests.force,
    )  # fmt: skip
    p = balancing_tractions(small)
    assert_allclose(p[:n][touching[:n]], 1e-9 * PRESS / W[touching[:n]].sum(), rtol=1e-5)


def test_a_body_without_friction_says_where_nothing_holds_it() -> None:
    """Its surface problem has the normal motions of contact alone."""
    away = ["obstacles.plane.force.y=[[0, 0], [1, 2e-4], [2, -2e-4]]", "steps={ end = 2.0, count = 2 }"]
    simulation = prepare(read("sphere", ["geometry.mesh_size=1.4", "geometry.contact_mesh_size=0.01", *away]))
    with pytest.raises(NoEquilibriumError, match="plane moves along"):
        list(simulation.steps())


def test_plates_that_carry_a_block_far_and_close_a_little_press_it() -> None:
    """Pressures are far below what the common motion would cause, and yet they are the answer."""
    E, nu, far, near = 2e11, 0.3, 0.05, 1e-9
    below = plane() | {"displacement": {"y": far}}
    above = {"shape": "plane", "point": [0.0, 2.0], "normal": [0.0, -1.0], "displacement": {"y": far - near}}
    scene = scene_of(
        geometry={"length": 4.0, "height": 2.0, "mesh_size": 0.5, "contact_mesh_size": 0.5},
        bodies={"block": {"E": E, "nu": nu}},
        obstacles={"below": below, "above": above},
        contacts={
            "base": {"surface": "block.bottom", "against": "below"},
            "top": {"surface": "block.top", "against": "above"},
        },
        supports={"side": support("left", x=0.0)},
    )
    (step,) = prepare(scene).steps()
    for contact in step.contacts.values():
        assert contact.normal_force == pytest.approx(E / (1 - nu**2) * near / 2.0 * 4.0, rel=1e-5)


def test_motions_that_many_points_leave_free_are_found_in_little_memory() -> None:
    """A wall of two hundred blocks has 100 000 rows; a square array of that many is 80 GB."""
    rows = np.zeros((100_000, 3))
    rows[:, 1] = np.linspace(1.0, 2.0, len(rows))
    assert_allclose(np.abs(unresisted(rows)).sum(axis=1), [1.0, 0.0, 1.0], atol=1e-12)
