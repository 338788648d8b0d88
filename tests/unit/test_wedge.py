"""Builder wedge: its mesh is as large, as fine and as straight as asked, and pressed into a notch it obeys statics."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.builders.wedge import Wedge
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
