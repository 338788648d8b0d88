"""Builder wedge: its mesh is as large, as fine and as straight as asked, and pressed into a notch it obeys statics."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.builders.wedge import Wedge
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.cell_quality import worst_jacobian_ratio
from stickslip.geometry.mesh.mesh import Mesh, build_mesh
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.shape import Model, Request
from stickslip.geometry.surfaces.surface import Surface, gather_surface
from stickslip.solvers.results.step_result import SLIP, StepResult
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

WEDGE = Wedge(half_angle=30.0, bottom_width=0.4, height=1.0, mesh_size=0.2)
TAN, COS, SIN = np.tan(np.pi / 6), np.cos(np.pi / 6), np.sin(np.pi / 6)
TOP = 0.4 + 2 * TAN
LENGTHS = {"bottom": 0.4, "top": TOP, "left": 1 / COS, "right": 1 / COS}
NORMALS = {"bottom": [0, -1], "top": [0, 1], "left": [-COS, -SIN], "right": [COS, -SIN]}
WALLS = ("wedge.left", "wedge.right")
EVERY = [replace(WEDGE, cells=cells, order=order) for cells in ("simplex", "tensor") for order in (1, 2)]
PRESSED = 0.01  # [Pa] on the top, E = 1 Pa
MADE = pytest.mark.parametrize("shape", EVERY, ids=[f"{shape.cells}-{shape.order}" for shape in EVERY])


@cache
def meshed(shape: Wedge, contacts: tuple[str, ...] = ()) -> Mesh:
    shape.check_model("plane strain")
    return build_mesh(shape, Request(model="plane strain", contact_sides=contacts), MPI.COMM_SELF)


def side_of(shape: Wedge, side: str, contacts: tuple[str, ...] = ()) -> Surface:
    mesh = meshed(shape, contacts)
    space = dx.vector_space(mesh.domain, mesh.degree)
    return gather_surface(mesh, space, Nodes.of(mesh, space), f"wedge.{side}")


def steps_along(surface: Surface) -> Any:
    """Lengths of the cells along a side, from its lower or left end (f,) [m]."""
    ends = surface.points[surface.facets[:, :2]]
    order = np.argsort(ends.mean(axis=1) @ [1e-3, 1.0] if np.ptp(ends[:, :, 1]) > 1e-9 else ends.mean(axis=1)[:, 0])
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[order]


@MADE
def test_sides_are_where_they_belong_and_the_box_is_filled(shape: Wedge) -> None:
    mesh = meshed(shape)
    assert (set(mesh.bodies), set(mesh.sides)) == ({"wedge"}, {f"wedge.{side}" for side in LENGTHS})
    assert_allclose(mesh.box(), shape.box(2), atol=1e-12)
    assert_allclose(shape.box(2), [[-TOP / 2, 0], [TOP / 2, 1]])
    x = mesh.domain.geometry.x[dx.cell_nodes(mesh.domain)][:, :, :2]
    points, weights = dx.reference_rule(mesh.domain.topology.cell_type.name, 2)
    gradient = dx.reference_basis(mesh.domain.topology.cell_type.name, mesh.degree, points)[1]
    area = np.abs(np.linalg.det(np.einsum("iqn,cnj->cqij", gradient, x))) @ weights
    assert_allclose(area.sum(), (0.4 + TOP) / 2, rtol=1e-12)
    assert worst_jacobian_ratio(mesh.domain, mesh.degree)[0] > 0.3
    for side, length in LENGTHS.items():
        surface = side_of(shape, side)
        assert_allclose(surface.quadrature(2)[0].sum(), length, rtol=1e-12)
        ends, normals = shape.sample(f"wedge.{side}", 2)
        assert_allclose(normals, [NORMALS[side]] * 2, atol=1e-15)
        assert_allclose(surface.node_normals(), [NORMALS[side]] * len(surface.points), atol=1e-12)
        assert_allclose((surface.points - ends[0]) @ normals[0], 0.0, atol=1e-12)  # midnodes of order 2 included
        for end in ends:  # both ends are corners of the mesh
            assert np.linalg.norm(surface.points - end, axis=1).min() < 1e-12


def test_cells_are_as_fine_as_asked_where_it_touches() -> None:
    coarse = {side: steps_along(side_of(WEDGE, side)) for side in LENGTHS}
    assert max(steps.max() for steps in coarse.values()) <= 0.2 * (1 + 1e-9)
    fine = replace(WEDGE, contact_mesh_size=0.05)
    assert_allclose(steps_along(side_of(fine, "left")), steps_along(side_of(WEDGE, "left")))  # nothing touches
    walls = {side: steps_along(side_of(fine, side, WALLS)) for side in LENGTHS}
    for side in ("left", "right"):
        assert_allclose(walls[side], 1 / COS / 24, rtol=1e-9)  # 1.155 m in cells of 0.05 m at most
    assert_allclose(walls["top"][[0, -1]], 0.05, rtol=0.3)  # small at either wall, growing to the middle
    assert walls["top"].max() > 1.5 * walls["top"].min()
    assert walls["top"].max() <= 0.2 * 1.3
    level = {side: steps_along(side_of(fine, side, ("wedge.top",))) for side in LENGTHS}
    assert level["top"].max() <= 0.05 * (1 + 1e-9)
    assert_allclose(level["left"][-1], 0.05, rtol=0.3)
    assert np.all(np.diff(level["left"]) < 0)  # they grow downwards, away from the top
    left = steps_along(side_of(fine, "top", ("wedge.left",)))
    assert np.all(np.diff(left) > 0)
    every = steps_along(side_of(fine, "top", ("wedge.left", "wedge.top")))
    assert_allclose(every, every[0], rtol=1e-9)


def test_refined_cells_and_another_unit_of_length_make_the_same_shape() -> None:
    half = WEDGE.refined(0.5)
    assert (half.mesh_size, half.height, half.half_angle) == (0.1, 1.0, 30.0)
    metres = meshed(replace(WEDGE, contact_mesh_size=0.05), WALLS)
    millimetres = meshed(replace(WEDGE, contact_mesh_size=0.05).in_units_of(1e3), WALLS)
    assert_allclose(millimetres.domain.geometry.x, 1e-3 * metres.domain.geometry.x, rtol=1e-9, atol=1e-12)


REFUSED: dict[str, tuple[Callable[[], Wedge], Model, str]] = {
    "closed": (lambda: replace(WEDGE, half_angle=0.0), "plane strain", "half_angle = 0.0: must lie between 0 and 90"),
    "flat": (lambda: replace(WEDGE, half_angle=90.0), "plane strain", "half_angle = 90.0: must lie between 0 and 90"),
    "sharp": (lambda: replace(WEDGE, bottom_width=0.0), "plane strain", "bottom_width = 0.0: must be positive"),
    "low": (lambda: replace(WEDGE, height=-1.0), "plane stress", "height = -1.0: must be positive"),
    "in 3D": (lambda: WEDGE, "3d", 'builder = "wedge": there is one in plane models only'),
    "round": (lambda: WEDGE, "axisymmetric", 'builder = "wedge": there is one in plane models only'),
    "fine": (lambda: replace(WEDGE, contact_mesh_size=1e-6), "plane strain", "contact_mesh_size = 1e-06: makes"),
    "coarse": (lambda: replace(WEDGE, contact_mesh_size=0.5), "plane strain", "must not exceed mesh_size"),
}


def check(make: Callable[[], Wedge], model: Model) -> None:
    shape = make()
    shape.check_model(model)
    shape.refuse_too_large(Request(model=model, contact_sides=("wedge.left", "wedge.right")))


@pytest.mark.parametrize("name", REFUSED)
def test_nonsense_is_refused_by_key(name: str) -> None:
    make, model, message = REFUSED[name]
    with pytest.raises(SceneError, match=message):
        check(make, model)


def in_its_notch(half_angle: float, mu: float, **geometry: Any) -> StepResult:
    """Pressed evenly on its top into a rigid notch of its own shape, by walls alone."""
    angle = np.radians(half_angle)
    up, out = np.sin(angle), np.cos(angle)
    model = geometry.pop("model", "plane strain")
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
    return step


def pushes(half_angle: float, mu: float, **geometry: Any) -> None:
    """N = P / (2 (sin alpha + mu cos alpha)), T = mu N up along each wall: statics of a wedge that slides down."""
    angle = np.radians(half_angle)
    step, up, out = in_its_notch(half_angle, mu, **geometry), np.sin(angle), np.cos(angle)
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


@pytest.mark.parametrize(
    ("half_angle", "mu"),
    [
        (20.0, 0.0),
        (45.0, 0.0),
        (60.0, 0.0),
        (20.0, 0.2),
        (35.0, 0.2),
        (45.0, 0.2),
    ],  # flatter, parts of a rough one stick
)
def test_walls_carry_what_statics_says(half_angle: float, mu: float) -> None:
    pushes(half_angle, mu)


@MADE
@pytest.mark.parametrize("model", ["plane strain", "plane stress"])
def test_so_they_do_on_every_mesh(shape: Wedge, model: Model) -> None:
    pushes(35.0, 0.25, model=model, cells=shape.cells, order=shape.order, contact_mesh_size=0.1)


def test_without_friction_the_statics_of_friction_fail() -> None:
    step = in_its_notch(30.0, 0.0)
    P = PRESSED * TOP
    assert_allclose(step.contacts["left"].normal_force, P, rtol=1e-8)  # sin alpha = 1/2
    assert abs(step.contacts["left"].normal_force - P / (2 * (SIN + 0.2 * COS))) > 0.1 * P
