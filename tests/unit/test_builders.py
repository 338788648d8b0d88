"""Builders mesh their shapes with named sides and cells as fine as asked for."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose

from shared.cases import every_nth
from shared.measures import facets_miss, measures
from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.builders import Builder
from stickslip.geometry.builders.assembly import Assembly
from stickslip.geometry.builders.cuboid import Block, Cuboid, Strip
from stickslip.geometry.builders.domes import Dome, HalfBall, HalfDisc
from stickslip.geometry.builders.half_space import HalfSpace
from stickslip.geometry.builders.ring import Ring, Sector
from stickslip.geometry.builders.wedge import Wedge
from stickslip.geometry.errors import GeometryError, SceneError
from stickslip.geometry.mesh.cell_quality import worst_jacobian_ratio
from stickslip.geometry.mesh.mesh import Mesh, build_mesh
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.shape import Model, Request
from stickslip.geometry.surfaces.surface import Surface, gather_surface
from stickslip.solvers.results.step_result import SLIP
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

Case = tuple[Builder, Model]
PLANE: Model = "plane strain"
DISC = HalfDisc(radius=2.0, mesh_size=0.4, contact_mesh_size=0.05)
BALL = HalfBall(radius=2.0, mesh_size=0.8, contact_mesh_size=0.2)
SPACE = HalfSpace(size=20.0, contact_half_width=1.0, mesh_size=5.0, contact_mesh_size=0.25, edge_mesh_size=0.125)
RING = Ring(inner_radius=1.0, outer_radius=1.5, mesh_size=0.2)
STRIP = Strip(length=2.0, height=0.2, mesh_size=0.1, layers=3)
BLOCK = Block(length=2.0, height=1.0, mesh_size=0.25)
WEDGE = Wedge(half_angle=30.0, bottom_width=0.4, height=1.0, mesh_size=0.2)
SHAPES: list[Case] = [
    (DISC, PLANE),
    (replace(DISC, symmetric=True), PLANE),
    (replace(DISC, symmetric=True), "axisymmetric"),
    (BALL, "3d"),
    (replace(BALL, symmetry="quarter"), "3d"),
    (SPACE, "plane stress"),
    (replace(SPACE, symmetric=True), "axisymmetric"),
    (replace(SPACE, contact_mesh_size=0.5, edge_mesh_size=0.25), "3d"),
    (RING, PLANE),
    (replace(RING, angle=90), "plane stress"),
    (replace(STRIP, width=0.5), "3d"),
    (STRIP, "axisymmetric"),
    (replace(BLOCK, contact_mesh_size=0.05), PLANE),
    (replace(BLOCK, width=0.5), "3d"),
    (WEDGE, PLANE),
]


def variations() -> Iterator[Case]:
    """Each shape by all kinds of cells that it has, and by both orders."""
    for (shape, model), cells, order in product(SHAPES, ("simplex", "tensor"), (1, 2)):
        varied = replace(shape, cells=cells, order=order)
        with suppress(SceneError):  # not every shape has a grid
            varied.check_model(model)
            yield varied, model


ROUND = {"disc.arc": np.array([0.0, 2.0]), "ball.cap": np.array([0.0, 0.0, 2.0]), "ring.inner": np.zeros(2)}
ROUND |= {"ring.outer": np.zeros(2)}  # side -> its centre
EVERY = pytest.mark.parametrize(
    ("shape", "model"),
    [
        pytest.param(
            *(shape, model),
            id=f"{type(shape).__name__}-{shape.cells}-{shape.order}-{model}",
            marks=[pytest.mark.slow] * (shape.order == 2 and isinstance(shape, Cuboid)),  # their sides stay straight
        )
        for shape, model in variations()
    ],
)
HALF = pytest.mark.parametrize("case", every_nth(2, SHAPES))  # each builder is always there


def dim_of(model: Model) -> int:
    return 3 if model == "3d" else 2


@cache
def meshed(shape: Builder, model: Model, *contacts: str) -> Mesh:
    shape.check_model(model)
    return build_mesh(shape, Request(model=model, contact_sides=contacts), MPI.COMM_SELF)


@cache
def side_of(shape: Builder, model: Model, side: str, *contacts: str) -> Surface:
    """The side as a plane mesh: its areas are those of the meridian."""
    mesh = meshed(shape, model, *contacts)
    space = dx.vector_space(mesh.domain, mesh.degree)
    return replace(gather_surface(mesh, space, Nodes.of(mesh, space), side), axisymmetric=False)


def volume(mesh: Mesh) -> float:
    """By a rule that is exact for the Jacobian of curved cells."""
    kind = mesh.domain.topology.cell_type.name
    points, weights = dx.reference_rule(kind, 2 * mesh.dim)
    gradient = dx.reference_basis(kind, mesh.degree, points)[1]
    x = mesh.domain.geometry.x[dx.cell_nodes(mesh.domain)][:, :, : mesh.dim]
    return float((np.abs(np.linalg.det(np.einsum("iqn,cnj->cqij", gradient, x))) @ weights).sum())


def edges(surface: Surface) -> tuple[Array, Array]:
    """Midpoints (e, d) and lengths (e,) of the facets' edges."""
    corners = surface.points[surface.facets[:, : 2 if surface.dim == 2 else 3]]
    pairs = [(i, j) for i in range(corners.shape[1]) for j in range(i)]
    ends = np.concatenate([corners[:, pair] for pair in pairs])
    return ends.mean(axis=1), np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


@EVERY
def test_named_parts_are_meshed_and_as_large_as_they_are(shape: Builder, model: Model) -> None:
    mesh, dim = meshed(shape, model), dim_of(model)
    expected, bodies = measures(shape, dim), shape.bodies(dim)
    assert set(mesh.bodies) == set(bodies)
    assert set(mesh.sides) == {f"{body}.{side}" for body, sides in bodies.items() for side in sides}
    assert set(expected) == set(mesh.bodies) | set(mesh.sides)
    (body,) = bodies
    assert_allclose(volume(mesh), expected[body], rtol=facets_miss(shape))
    for side in mesh.sides:
        found = side_of(shape, model, side).quadrature(4)[0].sum()
        assert_allclose(found, expected[side], rtol=facets_miss(shape), err_msg=side)


@EVERY
def test_round_sides_are_round_and_the_box_is_filled(shape: Builder, model: Model) -> None:
    mesh = meshed(shape, model)
    assert_allclose(mesh.box(), shape.box(dim_of(model)), atol=1e-12)
    for side in ROUND.keys() & mesh.sides.keys():
        distance = np.linalg.norm(side_of(shape, model, side).points - ROUND[side], axis=1)
        assert_allclose(distance, distance[0], rtol=1e-10)  # mid-nodes of order 2 included
    assert worst_jacobian_ratio(mesh.domain, mesh.degree)[0] > 0.3  # no cell near to being inverted


@EVERY
def test_samples_lie_on_their_side_with_outward_normals(shape: Builder, model: Model) -> None:
    mesh = meshed(shape, model)
    slack = 1e-9 * np.ptp(mesh.box(), axis=0).max()
    for side in mesh.sides:
        surface = side_of(shape, model, side)
        points, normals = shape.sample(side, dim_of(model))
        assert points.shape == normals.shape
        assert len(points) <= 20
        distance = np.linalg.norm(points[:, None] - surface.points, axis=2)
        h = edges(surface)[1].max()
        assert distance.min(axis=1).max() <= h
        low, high = surface.points.min(axis=0), surface.points.max(axis=0)
        chord = h**2 / 8 if side == "half_space.contact" and surface.dim == 3 else 0.0  # a polygon in place of a disc
        assert_allclose([points.min(axis=0), points.max(axis=0)], [low, high], atol=slack + chord)  # the extremes
        assert_allclose(np.linalg.norm(normals, axis=1), 1)
        nearest = surface.node_normals()[distance.argmin(axis=1)]
        assert np.einsum("kd,kd->k", normals, nearest).min() > 0.8  # outward, and the mesh's up to the cell's bend
        if side in ROUND:
            arm = points - ROUND[side]
            assert_allclose(np.abs(np.einsum("kd,kd->k", normals, arm)), np.linalg.norm(arm, axis=1))


@pytest.mark.parametrize(
    ("shape", "model"), [(STRIP, PLANE), (replace(STRIP, width=0.5), "3d"), (SPACE, PLANE), (SPACE, "3d")]
)
def test_opposite_sides_are_sampled_in_the_same_order_and_match(shape: Builder, model: Model) -> None:
    dim = dim_of(model)
    (body,) = shape.bodies(dim)
    pair = (f"{body}.left", f"{body}.right")
    (left, _), (right, _) = (shape.sample(side, dim) for side in pair)
    shift = np.eye(dim)[0] * np.ptp(shape.box(dim)[:, 0])
    assert_allclose(left + shift, right)
    mesh = build_mesh(shape, Request(model=model, periodic=(pair,)), MPI.COMM_SELF)
    space = dx.vector_space(mesh.domain, 1)
    here, there = (gather_surface(mesh, space, Nodes.of(mesh, space), side).points for side in pair)
    distance = np.linalg.norm((here + shift)[:, None] - there, axis=2)
    assert len(here) == len(there)
    assert distance.min(axis=1).max() < 1e-9 * shift[0]


@pytest.mark.parametrize("width", [1e-2, 1e-5])
def test_the_contact_of_a_half_space_is_found_however_narrow_it_is(width: float) -> None:
    narrow = HalfSpace(size=1.0, contact_half_width=width, mesh_size=0.5, contact_mesh_size=width / 2)
    side = side_of(narrow, PLANE, "half_space.contact")
    assert_allclose([side.points[:, 0].min(), side.points[:, 0].max()], [-width, width], rtol=1e-9)


@pytest.mark.parametrize(
    ("shape", "model", "side", "centre", "near", "size"),
    [
        (DISC, PLANE, "disc.arc", [0.0, 0.0], 0.25, 0.05),  # radius / 8
        (replace(DISC, contact_radius=1.0), PLANE, "disc.arc", [0.0, 0.0], 1.0, 0.05),
        (replace(BALL, contact_radius=0.8), "3d", "ball.cap", [0.0, 0.0, 0.0], 0.8, 0.2),
        (replace(SPACE, edge_mesh_size=None), PLANE, "half_space.contact", [0.0, 0.0], 1.0, 0.25),
        (SPACE, PLANE, "half_space.contact", [1.0, 0.0], 0.2, 0.15),  # 0.125 at the edge, and growing
        (SPACE, "3d", "half_space.contact", [0.0, 0.0, 0.0], 0.5, 0.25),
    ],
)
def test_cells_are_as_fine_as_asked_near_the_contact(
    shape: Builder, model: Model, side: str, centre: list[float], near: float, size: float
) -> None:
    """gmsh keeps sizes up to a factor: 1.5 here, of the mean of the edges."""
    middles, lengths = edges(side_of(shape, model, side))
    distance = np.linalg.norm(middles - centre, axis=1)
    assert size / 1.5 < lengths[distance < near].mean() < 1.3 * size
    if shape is DISC:  # away from the pole cells grow, up to mesh_size
        assert lengths[distance > 2.0].mean() > 4 * size
        assert lengths.max() < 1.5 * shape.mesh_size


@pytest.mark.parametrize("cells", ["simplex", "tensor"])
def test_ring_is_fine_along_the_circle_that_touches(cells: Any) -> None:
    shape = replace(RING, contact_mesh_size=0.05, cells=cells)
    for side, count in (("inner", 2 * np.pi / 0.05), ("outer", 2 * np.pi * 1.5 / 0.05)):
        facets = side_of(shape, PLANE, f"ring.{side}", f"ring.{side}").facets
        assert count <= len(facets) <= count + 4  # four quarters, each rounded up
    assert len(side_of(shape, PLANE, "ring.inner").facets) == 4 * np.ceil(np.pi / 2 * 1.5 / 0.2)  # no contact
    quarter = replace(shape, angle=90)
    spoke = np.sort(side_of(quarter, PLANE, "ring.x_axis", "ring.inner").points[:, 0])
    assert_allclose(spoke[1] - spoke[0], 0.05, rtol=0.2)  # small at the contact, growing away from it
    assert np.all(np.diff(spoke, 2) > 0)


def test_strip_has_its_layers() -> None:
    mesh = meshed(replace(STRIP, cells="tensor"), PLANE)
    assert mesh.domain.topology.index_map(2).size_local == 20 * 3
    assert len(side_of(STRIP, PLANE, "strip.left").facets) == 3


@HALF
def test_another_unit_of_length_makes_the_same_mesh(case: Case) -> None:
    shape, model = case
    metres, millimetres = meshed(shape, model), meshed(shape.in_units_of(1e3), model)
    assert_allclose(millimetres.domain.geometry.x, 1e-3 * metres.domain.geometry.x, rtol=1e-9, atol=1e-12)


def test_cells_turned_inside_out_are_refused() -> None:
    """The inner circle of a thin ring of few cells bulges through their diagonals, which are straight."""
    thin = Ring(inner_radius=0.9, outer_radius=1.0, mesh_size=1.0)
    assert worst_jacobian_ratio(meshed(thin, PLANE).domain, 1)[0] > 0.9
    with pytest.raises(
        GeometryError, match=r"a curved cell at \(.*\) is turned inside out; make the cells there small"
    ):
        meshed(replace(thin, order=2), PLANE)


def all_touch(shape: Builder, model: Model) -> Request:
    """A request in which every side is a contact side."""
    bodies = shape.bodies(3 if model == "3d" else 2)
    return Request(model=model, contact_sides=tuple(f"{b}.{side}" for b, sides in bodies.items() for side in sides))


@HALF
def test_the_number_of_cells_is_known_before_gmsh_starts(case: Case) -> None:
    shape, model = case
    for fine in (shape, shape.refined(0.5)):
        request = Request(model=model, contact_sides=all_touch(shape, model).contact_sides[:1])
        mesh = build_mesh(fine, request, MPI.COMM_SELF)
        count = mesh.domain.topology.index_map(mesh.dim).size_local
        assert count / 3 < fine.cell_count(request) < 3 * count  # coarse meshes of a few cells are the worst


REFUSED: dict[str, tuple[Callable[[], Builder], Model, str]] = {
    "radius": (lambda: replace(DISC, radius=-1.0), PLANE, "radius = -1.0: must be positive"),
    "contact radius": (lambda: replace(BALL, contact_radius=3.0), "3d", "contact_radius = 3.0: must not exceed radius"),
    "disc in 3D": (lambda: DISC, "3d", 'builder = "half_disc": there is none in 3D; use "half_ball"'),
    "whole disc": (lambda: DISC, "axisymmetric", "symmetric = false: expected true in an axisymmetric model"),
    "quads in a disc": (lambda: replace(DISC, cells="tensor"), PLANE, "cells = tensor: this shape has no grid"),
    "ball in a plane": (lambda: BALL, PLANE, 'builder = "half_ball": there is one in 3D only; use "half_disc"'),
    "hexahedra in a ball": (lambda: replace(BALL, cells="tensor"), "3d", "cells = tensor: this shape has no grid"),
    "many in a ball": (
        lambda: replace(BALL, contact_mesh_size=1e-4),
        "3d",
        "^contact_mesh_size = 0.0001: makes more than",
    ),
    "many in a disc": (lambda: replace(DISC, mesh_size=1e-4, contact_mesh_size=None), PLANE, "makes more than"),
    "wide contact": (lambda: replace(SPACE, contact_half_width=20.0), PLANE, "must be smaller than size"),
    "coarse edge": (lambda: replace(SPACE, edge_mesh_size=1.0), PLANE, "must not exceed contact_mesh_size"),
    "half in 3D": (lambda: replace(SPACE, symmetric=True), "3d", "symmetric = true: there is the whole shape only in"),
    "whole half-space": (lambda: SPACE, "axisymmetric", "symmetric = false: expected true in an axisymmetric"),
    "quads below": (lambda: replace(SPACE, cells="tensor"), PLANE, "cells = tensor: this shape has no grid"),
    "many at edges": (lambda: replace(SPACE, edge_mesh_size=1e-7), "3d", "^edge_mesh_size = 1e-07: makes more than"),
    "hole": (lambda: replace(RING, inner_radius=1.5), PLANE, "inner_radius = 1.5: must be smaller than outer_radius"),
    "thin ring": (lambda: replace(RING, inner_radius=1.5 - 1e-7), PLANE, "must be a millionth of it thick"),
    "torus": (lambda: RING, "axisymmetric", 'builder = "ring": there is one in plane models only'),
    "tube": (lambda: RING, "3d", 'builder = "ring": there is one in plane models only'),
    "many in a ring": (lambda: replace(RING, contact_mesh_size=1e-5), PLANE, "^contact_mesh_size = 1e-05: makes"),
    "closed": (lambda: replace(WEDGE, half_angle=0.0), PLANE, "half_angle = 0.0: must lie between 0 and 90"),
    "flat": (lambda: replace(WEDGE, half_angle=90.0), PLANE, "half_angle = 90.0: must lie between 0 and 90"),
    "sharp": (lambda: replace(WEDGE, bottom_width=0.0), PLANE, "bottom_width = 0.0: must be positive"),
    "wedge in 3D": (lambda: WEDGE, "3d", 'builder = "wedge": there is one in plane models only'),
    "round wedge": (lambda: WEDGE, "axisymmetric", 'builder = "wedge": there is one in plane models only'),
    "many in a wedge": (lambda: replace(WEDGE, contact_mesh_size=1e-6), PLANE, "contact_mesh_size = 1e-06: makes"),
    "coarse contact": (lambda: replace(WEDGE, contact_mesh_size=0.5), PLANE, "must not exceed mesh_size"),
    "layers": (lambda: replace(STRIP, layers=0), PLANE, "layers = 0: a strip needs one layer"),
    "tall": (lambda: replace(STRIP, height=3.0), PLANE, "height = 3.0: must not exceed length"),
    "fine strip": (lambda: replace(STRIP, contact_mesh_size=0.01), PLANE, "contact_mesh_size = 0.01: a strip's cells"),
    "no width": (lambda: STRIP, "3d", 'width: missing, a strip needs it in model = "3d"'),
    "width": (lambda: replace(STRIP, width=1.0), PLANE, "width = 1.0: a plane model has no width"),
    "many in a strip": (lambda: replace(STRIP, mesh_size=1e-8), PLANE, "^mesh_size = 1e-08: makes more than"),
}


def check(make: Callable[[], Builder], model: Model) -> None:
    shape = make()
    shape.check_model(model)
    shape.refuse_too_large(all_touch(shape, model))


@pytest.mark.parametrize("name", REFUSED)
def test_nonsense_is_refused_with_one_line(name: str) -> None:
    make, model, message = REFUSED[name]
    with pytest.raises(SceneError, match=message) as caught:
        check(make, model)
    assert "\n" not in str(caught.value)


def test_every_shape_is_found_by_its_name_and_what_shapes_share_is_none_itself() -> None:
    names = {get_args(get_type_hints(kind)["builder"])[0]: kind for kind in Builder.kinds}
    assert len(Builder.kinds) == len(names)
    assert {"block", "half_disc", "arch", "two_blocks"} <= set(names)
    assert not {Assembly, Cuboid, Dome, Sector} & set(Builder.kinds)


TAN, COS, SIN = np.tan(np.pi / 6), np.cos(np.pi / 6), np.sin(np.pi / 6)
TOP = 0.4 + 2 * TAN
LENGTHS = {"bottom": 0.4, "top": TOP, "left": 1 / COS, "right": 1 / COS}
WALLS = ("wedge.left", "wedge.right")
PRESSED = 0.01  # [Pa] on the top, E = 1 Pa


def steps_along(shape: Wedge, side: str, *contacts: str) -> Any:
    """Lengths of the cells along a side of a wedge, from its lower or left end (f,) [m]."""
    surface = side_of(shape, PLANE, f"wedge.{side}", *contacts)
    ends = surface.points[surface.facets[:, :2]]
    order = np.argsort(ends.mean(axis=1) @ [1e-3, 1.0] if np.ptp(ends[:, :, 1]) > 1e-9 else ends.mean(axis=1)[:, 0])
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[order]


def test_cells_are_as_fine_as_asked_where_it_touches() -> None:
    coarse = {side: steps_along(WEDGE, side) for side in LENGTHS}
    assert max(steps.max() for steps in coarse.values()) <= 0.2 * (1 + 1e-9)
    fine = replace(WEDGE, contact_mesh_size=0.05)
    assert_allclose(steps_along(fine, "left"), steps_along(WEDGE, "left"))  # nothing touches
    walls = {side: steps_along(fine, side, *WALLS) for side in LENGTHS}
    for side in ("left", "right"):
        assert_allclose(walls[side], 1 / COS / 24, rtol=1e-9)  # 1.155 m in cells of 0.05 m at most
    assert_allclose(walls["top"][[0, -1]], 0.05, rtol=0.3)  # small at either wall, growing to the middle
    assert walls["top"].max() > 1.5 * walls["top"].min()
    assert walls["top"].max() <= 0.2 * 1.3
    level = {side: steps_along(fine, side, "wedge.top") for side in LENGTHS}
    assert level["top"].max() <= 0.05 * (1 + 1e-9)
    assert_allclose(level["left"][-1], 0.05, rtol=0.3)
    assert np.all(np.diff(level["left"]) < 0)  # they grow downwards, away from the top
    left = steps_along(fine, "top", "wedge.left")
    assert np.all(np.diff(left) > 0)
    every = steps_along(fine, "top", *WALLS[:1], "wedge.top")
    assert_allclose(every, every[0], rtol=1e-9)


MESHES: list[tuple[float, float, str, dict[str, Any]]] = [
    *((half_angle, 0.0, PLANE, {}) for half_angle in (20.0, 45.0, 60.0)),
    *((half_angle, 0.2, PLANE, {}) for half_angle in (20.0, 35.0, 45.0)),  # flatter, parts of a rough one stick
    *(
        (35.0, 0.25, model, {"cells": cells, "order": order, "contact_mesh_size": 0.1})
        for model, cells, order in product(("plane strain", "plane stress"), ("simplex", "tensor"), (1, 2))
    ),
]


@pytest.mark.parametrize(("half_angle", "mu", "model", "geometry"), MESHES)
def test_walls_carry_what_statics_says(half_angle: float, mu: float, model: str, geometry: dict[str, Any]) -> None:
    """Pressed evenly on its top into a rigid notch of its own shape, by walls alone.

    N = P / (2 (sin alpha + mu cos alpha)), T = mu N up along each wall: statics of a wedge that slides down.
    """
    angle = np.radians(half_angle)
    up, out = np.sin(angle), np.cos(angle)
    shape = {"builder": "wedge", "half_angle": half_angle, "bottom_width": 0.4, "height": 1.0, "mesh_size": 0.2}
    data = {
        "model": model,
        "geometry": shape | geometry,
        "bodies": {"wedge": {"E": 1.0, "nu": 0.3}},
        "obstacles": {
            "left": {"shape": "plane", "point": [-0.2, 0.0], "normal": [out, up]},
            "right": {"shape": "plane", "point": [0.2, 0.0], "normal": [-out, up]},
        },
        "contacts": {
            side: {"surface": f"wedge.{side}", "against": side, "friction": {"law": "coulomb", "mu": mu}}
            for side in ("left", "right")
        },
        "loads": {"press": {"boundary": "wedge.top", "pressure": PRESSED}},
        "solver": {"tolerance": 1e-11},
    }
    (step,) = prepare(from_dict(data)).steps()
    P = PRESSED * (0.4 + 2 * np.tan(angle))
    N = P / (2 * (up + mu * out))
    forces = {side: contact.force for side, contact in step.contacts.items()}
    # exact on any mesh: the balance of the whole; 1e-8 is the solver's 1e-11 and three digits to spare
    assert_allclose(sum(forces.values()), [0.0, P], atol=1e-8 * P)
    for side, inwards in (("left", 1.0), ("right", -1.0)):
        contact = step.contacts[side]
        assert_allclose(contact.normal_force, N, rtol=1e-8)
        assert_allclose(forces[side] @ [-inwards * up, out], mu * N, atol=1e-8 * N)  # up the wall, against the slip
        assert_allclose(contact.tangential_force, mu * N, atol=1e-8 * N)
        assert np.all(contact.status[contact.pressure > 0] == SLIP)
        assert contact.pressure.max() > 0
