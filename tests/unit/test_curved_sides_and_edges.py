"""Errors of curved sides, of edges of contact, between nodes, and by chance."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import csr_matrix
from scipy.spatial import Delaunay

from shared.cases import every_nth
from shared.drawn import scene_data
from shared.problems import plane, scene_of
from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.accuracy.areas import beyond_nodes
from stickslip.solvers.accuracy.bubble_rows import BetweenNodes
from stickslip.solvers.accuracy.facet_volume_correction import LeftOut, bulges
from stickslip.solvers.accuracy.two_level import MeshCorrection
from stickslip.solvers.results.step_result import SLIP, ContactState, Quantity, StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import READY, from_dict, read


def side(points: Array, facets: Ints, shape: str = "interval", degree: int = 1, axisymmetric: bool = False) -> Surface:
    numbers = np.arange(len(points))
    return Surface(shape, degree, numbers, numbers, points, facets, np.ones(len(facets)), axisymmetric)


def line(x: Array, axisymmetric: bool = False) -> Surface:
    """Nodes at x on a straight line."""
    k = np.arange(len(x) - 1)
    return side(np.stack([x, 0 * x], axis=1), np.stack([k, k + 1], axis=1), axisymmetric=axisymmetric)


def with_middles(straight: Surface) -> Surface:
    """The same facets at order 2, in 2D."""
    middles = straight.points[straight.facets].mean(axis=1)
    facets = np.column_stack([straight.facets, len(straight.points) + np.arange(len(middles))])
    return side(np.concatenate([straight.points, middles]), facets, degree=2)


def arc(angles: Array) -> Surface:
    """Nodes on a circle of radius 2 m; the facets run clockwise, so that their outward normals point outward."""
    points = 2 * np.stack([np.cos(-angles), np.sin(-angles)], axis=1)
    k = np.arange(len(angles) - 1)
    return side(points, np.stack([k + 1, k], axis=1))


@pytest.mark.parametrize("angles", [np.linspace(0, 1, 9), np.linspace(0, 1, 9) ** 1.3])
def test_arcs_bulge_up_to_their_circle(angles: Array) -> None:
    straight = arc(angles)
    middles = with_middles(straight)
    moved = middles.points + bulges(straight, middles)
    off = np.abs(np.linalg.norm(moved, axis=1) - 2.0)
    flat = np.abs(np.linalg.norm(middles.points, axis=1) - 2.0)
    assert off[len(angles) :].max() < 0.02 * flat.max()
    assert_allclose(moved[: len(angles)], straight.points, rtol=0, atol=0)


def test_kinks_and_creases_do_not_bulge() -> None:
    x = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.2], [4.0, 0.4], [4.0, 1.4], [4.0, 2.4]])
    k = np.arange(6)
    straight = side(x, np.stack([k, k + 1], axis=1))
    assert not bulges(straight, with_middles(straight)).any()


def sphere(points: Array) -> Array:
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def test_a_sphere_bulges_in_3d() -> None:
    plane = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.4, 0.4, 9)), axis=-1).reshape(-1, 2)
    facets = Delaunay(plane + 1e-3 * np.sin(7 * plane[:, ::-1])).simplices
    corners = sphere(np.column_stack([plane, np.ones(len(plane))]))
    arms = corners[facets[:, 1:]] - corners[facets[:, :1]]
    out = np.sign(np.einsum("fd,fd->f", np.cross(arms[:, 0], arms[:, 1]), corners[facets].mean(axis=1)))
    straight = replace(side(corners, facets.astype(np.int64), "triangle"), outward=out)
    ends = [(1, 2), (0, 2), (0, 1)]
    pairs = np.sort(np.concatenate([facets[:, pair] for pair in ends]), axis=1)
    edges, number = np.unique(pairs, axis=0, return_inverse=True)
    middle = corners[edges].mean(axis=1)
    quadratic = np.column_stack([facets, 81 + number.reshape(3, -1).T])
    middles = side(np.concatenate([corners, middle]), quadratic.astype(np.int64), "triangle", degree=2)
    middles = replace(middles, outward=out)
    moved = middles.points + bulges(straight, middles)
    inside = np.abs(plane[edges]).max(axis=(1, 2)) < 0.35  # nodes at the rim know one side of their surroundings
    off = np.abs(np.linalg.norm(moved[81:], axis=1) - 1)[inside]
    assert off.mean() < 0.25 * np.abs(np.linalg.norm(middle, axis=1) - 1)[inside].mean()


@pytest.mark.parametrize("axisymmetric", [False, True])
def test_the_edge_of_contact_lies_where_the_gap_to_the_power_two_thirds_is_zero(axisymmetric: bool) -> None:
    x = np.linspace(0, 1, 11)
    straight = line(x, axisymmetric)
    for edge in (0.31, 0.37, 0.399):
        inside = x < edge
        found = straight.node_weights()[inside].sum() + beyond_nodes(straight, inside, np.maximum(x - edge, 0) ** 1.5)
        true = np.pi * edge**2 if axisymmetric else edge
        assert found == pytest.approx(true, rel=1e-2 if axisymmetric else 1e-12)


def test_edges_of_a_disc_are_found_between_its_nodes() -> None:
    points = np.random.default_rng(0).random((800, 2)) * 2 - 1
    disc = side(np.column_stack([points, np.zeros(800)]), Delaunay(points).simplices.astype(np.int64), "triangle")
    radius = np.linalg.norm(points, axis=1)
    off = []
    for edge in (0.5, 0.6, 0.7):
        inside = radius < edge
        nodes = disc.node_weights()[inside].sum()
        found = nodes + beyond_nodes(disc, inside, np.maximum(radius - edge, 0) ** 1.5)
        off.append([abs(nodes - np.pi * edge**2), abs(found - np.pi * edge**2)])
    by_nodes, between = np.mean(off, axis=0)
    assert between < 0.5 * by_nodes


def test_facets_with_other_nodes_can_be_left_out() -> None:
    x = np.linspace(0, 1, 11)
    outside = np.maximum(x - 0.37, 0) ** 1.5
    assert beyond_nodes(line(x), x < 0.37, outside, among=x < 0.35) == 0
    assert beyond_nodes(line(x), x < 0.37, outside, among=x < 2) == pytest.approx(0.02)


R, H, HOLE = 1.0, 0.5, 0.4
Draw = Callable[[Any], None]
DOWN = 3.0


def disc(occ: Any) -> None:
    occ.addCylinder(0, 0, 0, 0, 0, H, R)


def holed(occ: Any) -> None:
    """A block with a hole through it from the top to the bottom."""
    box, hole = occ.addBox(-1, -1, 0, 2, 2, H), occ.addCylinder(0, 0, 0, 0, 0, H, HOLE)
    occ.cut([(3, box)], [(3, hole)])


def plate(occ: Any) -> None:
    """A plane body with a round hole."""
    occ.cut([(2, occ.addRectangle(-1, 0, 0, 2, 2))], [(2, occ.addDisk(0, 1, 0, HOLE, HOLE))])


def dome(occ: Any) -> None:
    """A quarter of a disc, whose revolution is half a ball on its flat side."""
    occ.intersect([(2, occ.addRectangle(0, 0, 0, R, R))], [(2, occ.addDisk(0, 0, 0, R, R))])


SHAPES: dict[str, tuple[Draw, str, float, float, float]] = {  # model; volume; area of the base, of the top
    "disc": (disc, "3d", np.pi * R**2 * H, np.pi * R**2, np.pi * R**2),
    "holed": (holed, "3d", (4 - np.pi * HOLE**2) * H, 4 - np.pi * HOLE**2, 4 - np.pi * HOLE**2),
    "plate": (plate, "plane strain", 4 - np.pi * HOLE**2, 2.0, 2.0),
    "dome": (dome, "axisymmetric", 2 / 3 * np.pi * R**3, np.pi * R**2, 0.0),
}


def scene(shape: str, tmp_path: Path, **tables: Any) -> Scene:
    """A body under its weight on a frictionless floor, held against moving sideways only."""
    draw, model, *_ = SHAPES[shape]
    dim = 3 if model == "3d" else 2
    with gmsh_session() as gmsh:
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "b.brep"))
    low, high = [-2.0, -1e-3, -1.0], [2.0, 1e-3, 1.0]
    if dim == 3:
        low, high = [-2.0, -2.0, -1e-3], [2.0, 2.0, 1e-3]
    top = [*low[: dim - 1], (H if dim == 3 else 2.0) - 1e-3, *low[dim:]], [*high[: dim - 1], 2.1, *high[dim:]]
    names = {"part.base": {"box": [*low, *high]}} | (
        {"part.top": {"box": [*top[0], *top[1]]}} if shape != "dome" else {}
    )
    size = 0.3 if shape == "holed" else 0.4
    data = scene_data(tmp_path / "b.brep", dim, "part", mesh_size=size, names=names)
    data["contacts"]["base"] = {"surface": "part.base", "against": "foundation"}
    data |= {"model": model, "supports": {}, "bodies": {"part": {"E": 1e4, "nu": 0.3, "density": 1.0}}}
    data["gravity"] = {"acceleration": [0.0] * (dim - 1) + [-DOWN]}
    if model != "axisymmetric":
        data["contacts"]["base"]["friction"] = {"law": "coulomb", "mu": 0.3}
    return from_dict(data | tables)


def base_of(found: Scene, folder: Path) -> dict[str, Any]:
    """The contact after the last step, as result.json has it."""
    return dict(run(found, folder)[1]["steps"][-1]["contacts"]["base"])


@pytest.mark.parametrize("shape", every_nth(2, SHAPES))
def test_weight_and_area_are_off_by_what_is_stated(shape: str, tmp_path: Path) -> None:
    _, model, volume, area, _ = SHAPES[shape]
    base = base_of(scene(shape, tmp_path), tmp_path / "out")
    for name, exact in (("normal_force", DOWN * volume), ("contact_area", area)):
        off, error = abs(base[name] - exact), base["error"][name]
        if model != "3d" and name == "contact_area":
            assert off < 1e-9  # its ends are nodes
            continue
        assert off > 0.002 * exact
        assert 1.3 * off < error["total"] < 2 * off
        assert error["by"] == "order 2"
        assert abs(error["corrected"] - exact) < 0.1 * off


@pytest.mark.parametrize(("shape", "load"), every_nth(2, ["disc", "holed"], ["pressure", "traction", "force"]))
def test_pressure_acts_on_the_rim_too_and_a_force_is_what_it_is(shape: str, load: str, tmp_path: Path) -> None:
    top = SHAPES[shape][4]
    value = {"pressure": 7.0}.get(load, {"z": -7.0})
    still = {"gravity": {"acceleration": [0.0, 0.0, 0.0]}}
    base = base_of(
        scene(shape, tmp_path, loads={"lid": {"boundary": "part.top", load: value}}, **still), tmp_path / "out"
    )
    error = base["error"]["normal_force"]
    if load == "force":
        assert_allclose([base["normal_force"], error["corrected"]], 7.0, rtol=1e-6)
        assert error["total"] < 1e-6
    else:
        off = abs(base["normal_force"] - 7.0 * top)
        assert off > 0.01 * 7.0
        assert abs(error["corrected"] - 7.0 * top) < 0.1 * off


def test_a_body_without_curved_sides_pays_nothing() -> None:
    simulated = prepare(read("block", ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=0.5"]))
    assert not simulated.mesh.bulging
    assert MeshCorrection(simulated.stepper)._left_out is None


def test_stiffness_and_weight_grow_by_what_is_left_out(tmp_path: Path) -> None:
    system = prepare(scene("disc", tmp_path)).system
    left_out, whole = LeftOut(system), system.load(1.0)
    weight, more = (float(f.array[2::3].sum()) for f in (whole, left_out.load(1.0)))
    exact = -DOWN * SHAPES["disc"][2]
    assert abs(weight + more - exact) < 0.05 * abs(weight - exact)
    stretched = system.vector()
    stretched.array[2::3] = system.nodes.points[: system.nodes.owned, 2]  # eps_zz = 1
    energy, added = stretched.dot(system.K * stretched), stretched.dot(left_out.inner(stretched, np.zeros(0)))
    assert_allclose(added / energy, more / weight, rtol=1e-9)


def test_drawn_bolts_have_the_section_of_their_mesh(tmp_path: Path) -> None:
    bolt = {"body": "part", "shank": [[0.0, 0.0, 0.1], [0.0, 0.0, 0.4]], "force": 1.0}
    system = prepare(scene("disc", tmp_path, bolts={"stud": bolt})).system
    stretched = system.vector()
    stretched.array[2::3] = system.nodes.points[: system.nodes.owned, 2]
    assert LeftOut(system).inner(stretched, np.ones(1)).norm() == 0


MU, SIDE, FORCE = 0.3, 0.1, 5000.0
MOMENT = MU * FORCE * SIDE * (np.sqrt(2) + np.log(1 + np.sqrt(2))) / 6  # of even pressure on a square
TURN = [[1, 0], [2, 0.02]]
EVEN = [[1, -1e-5]]
BLOCK = {"builder": "block", "length": SIDE, "width": SIDE, "height": 0.02, "mesh_size": 0.02, "cells": "tensor"}
TABLE = plane(3)
TURNED = TABLE | {"rotation": {"angle": TURN, "point": [SIDE / 2, SIDE / 2, 0.0], "axis": [0, 0, 1]}}


def turning(friction: Any = None, geometry: Any = BLOCK, **tables: Any) -> Simulation:
    """A block, pressed on a table that turns then; its steps are followed with bubbles."""
    base = {"surface": "block.bottom", "against": "table", "friction": friction or {"law": "coulomb", "mu": MU}}
    made: dict[str, Any] = {
        "bodies": {"block": {"E": 1e9, "nu": 0.0}},
        "obstacles": {"table": TURNED},
        "contacts": {"base": base},
        "supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0, "z": EVEN}}},
        "steps": {"end": 2.0, "count": 2},
    }
    simulation = prepare(scene_of(3, geometry, **made | tables))
    simulation.stepper.companion = MeshCorrection(simulation.stepper)  # as where order 2 is too dear
    return simulation


ALONG, ACROSS = 0.3, 0.1
ELLIPSE = {"law": "orthotropic_coulomb", "mu_1": ALONG, "mu_2": ACROSS, "axis": [1, 0, 0]}


def moment_of_ellipse() -> float:
    """Its power over the turning: the mean of the friction along each point's way, times its distance."""
    nodes, weights = np.polynomial.legendre.leggauss(200)
    x, y = np.meshgrid(nodes * SIDE / 2, nodes * SIDE / 2)
    return FORCE * float(weights @ np.hypot(ALONG * y, ACROSS * x) @ weights) / 4


@pytest.mark.parametrize("form", ["condensed", "matrix-free"])
@pytest.mark.parametrize(("friction", "true"), [(None, MOMENT), (ELLIPSE, moment_of_ellipse())])
def test_the_moment_of_a_turning_table_has_the_error_that_is_stated(
    friction: dict[str, Any] | None, true: float, form: str
) -> None:
    *_, last = turning(friction, solver={"surface": form}).steps()
    moment, support = (Quantity(*of, "moment") for of in (("obstacles", "table"), ("supports", "top")))
    found, corrected, stated = (
        last.obstacles["table"].moment[2],
        last.corrected[str(moment)],
        last.errors[str(moment)].mesh,
    )
    assert isinstance(corrected, np.ndarray)
    assert isinstance(stated, np.ndarray)
    assert abs(corrected[2] - true) < 0.05 * abs(found - true) + 4e-4 * true  # the pressure is not quite even
    assert 0.9 < stated[2] / abs(found - true) < 3
    assert_allclose(last.errors[str(support)].mesh, stated, rtol=1e-3, atol=1e-3 * stated[2])


def test_the_dissipation_has_it_too() -> None:
    *_, last = turning().steps()
    number = str(Quantity("contacts", "base", "dissipation_total"))
    stated, corrected, work = last.errors[number].mesh, last.corrected[number], MOMENT * TURN[-1][1]
    true = last.contacts["base"].dissipation_total - work
    assert abs(corrected - work) < 0.4 * true  # the block gives way a little
    assert 0.9 < stated / true < 3


def test_nothing_is_added_where_all_slip_has_one_direction() -> None:
    moved = TABLE | {"displacement": {"x": [[1, 0], [2, 0.01]]}}
    simulation = turning(obstacles={"table": moved})
    *_, last = simulation.steps()
    c = last.contacts["base"]
    (rows,) = simulation.system.contacts
    assert rows.quadrature is not None
    between = BetweenNodes.of(rows, rows.quadrature(5))
    assert c.slip_area > 0
    assert between.added(c.status == SLIP, c.bound, c.slip_increment) is None
    middle = [SIDE / 2, SIDE / 2, 0.0]
    wheel = np.cross([0.0, 0.0, 1.0], c.points - middle)
    sizes = np.linalg.norm(wheel, axis=1, keepdims=True)
    added = between.added(c.bound > 0, c.bound, wheel)
    moment = np.cross(c.points - middle, added[0])[:, 2].sum()
    assert -1 < moment / (c.weight * c.bound * sizes[:, 0]).sum() < 0  # slip between nodes is shorter than theirs
    assert added[1] < 0


def test_both_sides_feel_it_in_balance() -> None:
    """A block on a block, whose top turns."""
    shape = {"builder": "two_blocks", "length": 1.0, "width": 1.0, "height": 0.4, "lower_height": 0.3}
    simulation = turning(
        geometry=shape | {"mesh_size": 0.25, "lower_mesh_size": 0.3},
        bodies={name: {"E": 1e9, "nu": 0.0} for name in ("upper", "lower")},
        obstacles={},
        contacts={
            "base": {"surface": "upper.bottom", "against": "lower.top", "friction": {"law": "coulomb", "mu": MU}}
        },
        supports={"floor": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0, "z": 0.0}}},
        remote_points={
            "top": {
                "boundary": "upper.top",
                "point": [0.5, 0.5, 0.4],
                "coupling": "rigid",
                "displacement": {"x": 0.0, "y": 0.0, "z": [[1, -1e-9]]},
                "rotation": {"x": 0.0, "y": 0.0, "z": [[1, 0], [2, 1e-8]]},
            }
        },
    )
    *_, last = simulation.steps()
    assert last.contacts["base"].slip_area > 0
    names = ("contacts", "base"), ("supports", "floor"), ("remote_points", "top")
    contact, floor, top = (last.corrected[str(Quantity(*name, "moment"))][2] for name in names)
    moment = last.contacts["base"].moment[2]
    assert abs(contact - moment) > 1e-3 * abs(moment)
    assert_allclose(contact, floor, rtol=1e-7)  # the top turns by 1e-8
    assert_allclose(top, -floor, rtol=0.01)


def test_nothing_pushes_an_obstacle_that_a_force_drives() -> None:
    """A table that a force presses against the block may turn it; one that a force pulls along keeps its balance."""
    (rows,) = turning().system.contacts
    assert rows.quadrature is not None
    pulled, pressed = (BetweenNodes.of(rows, rows.quadrature(5), axes) for axes in ([0], [2]))
    away = rows.surface.points - [0.3 * SIDE, 0.4 * SIDE, 0.0]
    wheel = np.cross([0.0, 0.0, 1.0], away)
    bound = np.ones(len(wheel))
    assert pulled.added(bound > 0, bound, wheel) is None
    assert pressed.added(bound > 0, bound, wheel) is not None


def test_slip_of_rounding_has_no_direction() -> None:
    """All sticks on a side that bends: one node's weight is negative, and along the other's side nothing moves."""
    between = BetweenNodes(
        relative=csr_matrix(np.eye(2)),
        measures=np.array([np.diag([1.0, 0.0]), np.diag([0.0, 1.0])]),
        phi=csr_matrix([[1.1], [-0.1]]),
        weights=np.ones(1),
        driven=(),
    )
    assert between.added(np.zeros(2, bool), np.ones(2), np.array([[0.0, 0.0], [0.0, 1e-18]])) is None


@pytest.mark.parametrize(
    ("name", "order", "size", "unit"),
    [("rotor", 2, 0.05, 2.1e12), ("shaft", 2, 0.1, 1.0), ("shaft", 1, 0.1, 1.0), ("spheres", 1, 0.5, 10.0)],
)
def test_the_stiffer_curved_sides_are_the_more_they_press_as_rigid_ones(
    name: str, order: int, size: float, unit: float
) -> None:
    """Slip along a side whose facets are polynomials opens some points and closes others by 1e-11 of a length."""

    def last(c_n: float | None) -> tuple[StepResult, ContactState]:
        data = tomllib.loads((READY / f"{name}.toml").read_text())
        data["geometry"] |= {"order": order, "mesh_size": size}
        if name == "spheres":  # meshes that do not match, closed in part
            data["geometry"] |= {"lower_mesh_size": 0.6, "contact_mesh_size": 0.08}
            data["steps"]["count"] = 2
        ((key, contact),) = data["contacts"].items()
        if name != "rotor":  # which keeps its cohesion, whose bound falls wherever a point opens
            contact["friction"] = {"law": "coulomb", "mu": 0.12}
        if c_n is not None:
            contact["normal"] = {"law": "compliance", "c_n": c_n}
        *_, step = prepare(from_dict(data)).steps()
        return step, step.contacts[key]

    (_, rigid), (soft, some), (stiff, most) = last(None), last(1e4 * unit), last(1e6 * unit)
    assert stiff.iterations <= soft.iterations + 1  # 13 to 160 before
    assert_allclose(most.pressure, some.pressure, rtol=3e-3, atol=3e-3 * rigid.max_pressure)
    force = 1e-3 if order == 2 else 0.02  # the mesh: of order 1 gaps of nodes are not the means of those of facets
    assert_allclose([some.normal_force, most.normal_force], rigid.normal_force, rtol=force)
    assert_allclose(most.max_pressure, rigid.max_pressure, rtol=0.015)
    assert most.pressure.min() >= 0
