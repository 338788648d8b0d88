"""Two sides of one body: cracks, whose ends both sides have, and slots."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit, solved
from stickslip.geometry.arrays import Array
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict, read

ROCK = {"E": 25e9, "nu": 0.25}
PRESSED, SHEARED = 10e6, 8e6  # [Pa]

SLOT = """
Point(1) = {0, 0, 0, 2}; Point(2) = {40, 0, 0, 2}; Point(3) = {40, 20, 0, 2}; Point(4) = {0, 20, 0, 2};
Point(5) = {0, 10.005, 0, 1}; Point(6) = {30, 10.005, 0, 1}; Point(7) = {30, 9.995, 0, 1}; Point(8) = {0, 9.995, 0, 1};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5};
Line(5) = {5, 6}; Line(6) = {6, 7}; Line(7) = {7, 8}; Line(8) = {8, 1};
Curve Loop(1) = {1:8}; Plane Surface(1) = {1}; Physical Surface("c") = {1}; Physical Curve("c.bottom") = {1};
Physical Curve("c.top") = {3}; Physical Curve("c.upper") = {5}; Physical Curve("c.lower") = {7};
"""  # 40 mm x 20 mm, with a slot of 30 mm from the left that is 0.01 mm high


def squares(a: Array, b: Array) -> Array:
    """Corners of squares between two lines of nodes."""
    return np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=-1)


def cracked(folder: Path, dim: int, n: int = 8) -> Path:
    """A block [-2, 2]² of squares, in 3D of two layers of cubes, with a crack on y = 0 from x = -1 to 1."""
    x, z = np.linspace(-2, 2, n + 1), np.linspace(0, 8 / n, 3)[: 2 * dim - 3]
    points = np.stack(np.meshgrid(x, x, z, indexing="ij")).transpose(3, 2, 1, 0).reshape(-1, 3)
    number = np.arange(len(points)).reshape(len(z), n + 1, n + 1)
    twice = np.flatnonzero((points[:, 1] == 0) & (np.abs(points[:, 0]) < 1))
    above = np.arange(len(points))
    above[twice] = len(points) + np.arange(len(twice))
    layers = [np.concatenate([squares(*(k if j < n // 2 else above[k])[j : j + 2]) for j in range(n)]) for k in number]

    def side(lines: Array) -> Array:
        flat = np.stack([lines[0][:-1], lines[0][1:]], axis=-1)
        return np.concatenate([squares(*pair) for pair in pairwise(lines)]) if dim == 3 else flat

    crack = number[:, n // 2, n // 4 : 3 * n // 4 + 1]
    sides = {"below": side(crack), "above": side(above[crack]), "bottom": side(number[:, 0])}
    sides |= {"top": side(number[:, -1]), "left": side(number[:, :, 0]), "right": side(number[:, :, -1])}
    cells = np.concatenate([np.concatenate(pair, axis=1) for pair in pairwise(layers)]) if dim == 3 else layers[0]
    if dim == 3:
        sides |= {"front": layers[0], "back": layers[-1]}
    groups = {"block": (dim, {2: 3, 3: 5}[dim], cells)}
    groups |= {f"block.{name}": (dim - 1, {2: 1, 3: 3}[dim], facets) for name, facets in sides.items()}
    with gmsh_session() as gmsh:
        for name, (k, kind, corners) in groups.items():
            entity = gmsh.model.addDiscreteEntity(k)
            if k == dim:
                points = np.concatenate([points, points[twice]])
                gmsh.model.mesh.addNodes(k, entity, 1 + np.arange(len(points)), points.ravel())
            gmsh.model.mesh.addElementsByType(entity, kind, [], 1 + corners.ravel())
            gmsh.model.setPhysicalName(k, gmsh.model.addPhysicalGroup(k, [entity]), name)
        gmsh.write(str(folder / f"block{dim}.msh"))
    return folder / f"block{dim}.msh"


def block(path: Path, dim: int, shear: float = 0.0, **tables: Any) -> dict[str, Any]:
    still = [0.0] * (dim - 2)
    data: dict[str, Any] = {
        "model": "3d" if dim == 3 else "plane strain",
        "geometry": {"file": str(path)},
        "bodies": {"block": ROCK},
        "contacts": {
            "crack": {
                "surface": "block.below", "against": "block.above", "friction": {"law": "coulomb", "mu": 0.3},
            },
        },
        "loads": {
            "top": {"boundary": "block.top", "traction": [shear, -PRESSED, *still]},
            "bottom": {"boundary": "block.bottom", "traction": [-shear, 0.0, *still]},
            "right": {"boundary": "block.right", "traction": [0.0, shear, *still]},
            "left": {"boundary": "block.left", "traction": [0.0, -shear, *still]},
        },
        "supports": {"bottom": {"boundary": "block.bottom", "displacement": {"y": 0.0}},
                     "corner": {"point": [-2.0, -2.0, *still], "displacement": {"x": 0.0}}},
    }  # fmt: skip
    if dim == 3:
        flat = {name: {"boundary": f"block.{name}", "displacement": {"z": 0.0}} for name in ("front", "back")}
        data["supports"] |= flat
    return data | tables


def last(data: dict[str, Any]) -> tuple[Any, StepResult]:
    simulation, steps = solved(from_dict(data))
    return simulation, steps[-1]


@pytest.mark.parametrize("method", ["condensed-newton", "tangent-cg", "surface-uzawa", "perturbed-lagrangian"])
def test_a_closed_crack_passes_a_uniform_pressure_on(method: str, tmp_path: Path) -> None:
    data = block(cracked(tmp_path, 2), 2, solver={"method": method, "tolerance": 1e-11})
    simulation, step = last(data)
    crack = step.contacts["crack"]
    assert_allclose(crack.pressure[crack.weight > 0], PRESSED, rtol=1e-8)
    assert_allclose(crack.contact_area, 2.0)
    assert simulation.system.contacts[0].ends.sum() == 2
    assert len(simulation.system.contacts[0].W_n) == len(crack.pressure) - 2


def test_a_crack_through_a_slice_in_3d_is_that_in_plane_strain(tmp_path: Path) -> None:
    found = []
    for dim, method in ((2, "condensed-newton"), (3, "condensed-newton"), (3, "tangent-cg")):
        data = block(cracked(tmp_path, dim), dim, SHEARED, solver={"method": method, "tolerance": 1e-10})
        simulation, step = last(data)
        crack = step.contacts["crack"]
        assert max(value for name, value in audit(simulation, step).items() if name != "fields") < 1e-7
        assert crack.slip_area > 1.4
        found.append([crack.normal_force, crack.tangential_force, 1e9 * crack.max_slip])
    assert_allclose(found[1:], [found[0]] * 2, rtol=1e-6)


@pytest.mark.parametrize(("order", "fine"), [(1, 0.2), (1, 0.1), (2, 0.2)])
def test_what_the_ends_of_a_crack_leave_is_stated(order: int, fine: float, tmp_path: Path) -> None:
    scene = read("crack", [f"geometry.order={order}", f"geometry.fine={fine}", "geometry.coarse=4.0"])
    crack = run(scene, tmp_path / "out")[1]["steps"][-1]["contacts"]["crack"]
    for name, exact in (("normal_force", 23395556.0), ("tangential_force", 13507430.0), ("max_slip", 3.8078e-3)):
        assert abs(crack[name] - exact) < 1.1 * crack["error"][name]["total"]
    assert crack["error"]["normal_force"]["total"] < 0.05 * crack["normal_force"]


@pytest.mark.parametrize("law", [{"law": "unilateral"}, {"law": "compliance", "c_n": 1e9, "m_n": 1.5}])
def test_a_slot_closes_from_its_open_end(law: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "slot.geo").write_text(SLOT)
    data = {
        "model": "plane strain", "units": "mm-N-MPa", "geometry": {"file": str(tmp_path / "slot.geo")},
        "bodies": {"c": {"E": 200_000.0, "nu": 0.3}},
        "contacts": {"slot": {"surface": "c.upper", "against": "c.lower", "normal": law,
                              "friction": {"law": "coulomb", "mu": 0.2}}},
        "supports": {"bottom": {"boundary": "c.bottom", "displacement": [0.0, 0.0]}},
        "loads": {"top": {"boundary": "c.top", "traction": [0.0, -100.0]}},
    }  # fmt: skip
    simulation, step = last(data)
    slot = step.contacts["slot"]
    assert 2500 < slot.normal_force < 2600
    assert slot.pressure.max() < 125
    assert slot.pressure[np.argmin(simulation.system.contacts[0].surface.points[:, 0])] > 50
    assert not simulation.system.contacts[0].ends.any()
    assert max(value for name, value in audit(simulation, step).items() if name != "fields") < 1e-7
