"""Orthotropic bodies off their axes: uniform stress, heat, a tube that touches a bore, a roller on half-planes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.shape import Model
from stickslip.solvers.method_registry import METHODS
from stickslip.workflows.lab.verification.cases.hertz import ellipse
from stickslip.workflows.lab.verification.check import Check, close, farthest
from stickslip.workflows.lab.verification.closed_forms.orthotropic import Constants, Tube, plane, roller, turned
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

SPRUCE = Constants(E=(10.0, 0.8, 0.45), G=(0.04, 0.6, 0.65), nu=(0.45, 0.43, 0.37))  # L, R, T [GPa]
ROUND = Constants(E=(0.8, 10.0, 0.8), G=(0.65, 0.3, 0.65), nu=(0.375, 0.4, 0.03))  # the same in all radial directions
STRESS = np.array([3e-3, -5e-3, 2e-3, 1.5e-3, -1e-3, 2.5e-3])  # xx, yy, zz, yz, xz, xy
SIDES = {0: ("left", "right"), 1: ("front", "back"), 2: ("bottom", "top")}  # by the axis of the normal, in 3D
PRESSED = 1e-3  # by how much the top of a block is lowered [m]
TUBE = Tube(constants=SPRUCE, inner=1.0, outer=2.0, pressure=0.02, gap=5e-3)
TUBE_FILE = """SetFactory("OpenCASCADE");
Rectangle(1) = {1, 0, 0, 1, 0.25};
Transfinite Curve{1, 3} = 17; Transfinite Curve{2, 4} = 5;
Transfinite Surface{1};
Physical Surface("tube") = {1};
Physical Curve("tube.bottom") = {1}; Physical Curve("tube.outside") = {2};
Physical Curve("tube.top") = {3}; Physical Curve("tube.inside") = {4};
"""
RADIUS, SLIM = 8.0, 0.005  # of the roller [m]; a / R of its contact: .02 leaves .4 %, .00125 and 24 cells .03 %
CELLS, TOLERANCE = 12.0, 3e-3  # in a; p0 is off by .06 %, a by .08 %, pressures by .18 % at most
WARMTH = (4e-3, 3e-2, -1e-2)  # strains without stress along the axes


def rotation(dim: int, degrees: float = 30.0) -> Array:
    """Axes as rows (3, 3): turned about z, in 3D then about y and x too."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    Q = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return Q @ Q[np.ix_([1, 2, 0], [1, 2, 0])] @ Q[np.ix_([2, 0, 1], [2, 0, 1])] if dim == 3 else Q


def table(constants: Constants, axes: Array, dim: int) -> dict[str, Any]:
    """[bodies.NAME] of a scene; axis_2 is neither of length one nor across axis_1, as a user may write it."""
    names = ("23", "13", "12")
    found: dict[str, Any] = {f"E_{i + 1}": value for i, value in enumerate(constants.E)}
    found |= {f"nu_{ij}": value for ij, value in zip(names, constants.nu, strict=True)}
    found |= {f"G_{ij}": G for ij, G in zip(names, constants.G, strict=True) if dim == 3 or ij == "12"}
    leaning = 3 * axes[1] + 0.5 * axes[0]
    return found | {"axis_1": axes[0, :dim].tolist(), "axis_2": leaning[:dim].tolist()}


def block(model: Model, order: int, axes: Array, constants: Constants = SPRUCE) -> dict[str, Any]:
    """A block of 2 m by 1 m, in 3D 1 m wide, of tetrahedra or triangles."""
    width = {"width": 1.0} if model == "3d" else {}
    shape = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5, "order": order}
    bodies = {"block": table(constants, axes, 3 if model == "3d" else 2)}
    return {"model": model, "geometry": shape | width, "bodies": bodies}


def held_at_points(dim: int) -> dict[str, Any]:
    """Supports at points that hold rigid motions alone: the gradient of the displacement is triangular."""
    held: dict[str, dict[str, Any]] = {
        "origin": {"point": [0.0] * dim, "displacement": dict.fromkeys("xyz"[:dim], 0.0)},
        "end": {"point": [2.0, *[0.0] * (dim - 1)], "displacement": dict.fromkeys("yz"[: dim - 1], 0.0)},
    }
    return held | ({"across": {"point": [0.0, 1.0, 0.0], "displacement": {"z": 0.0}}} if dim == 3 else {})


def pulled(model: Model, order: int) -> list[Check]:
    """All of its sides carry the tractions of a uniform stress: a linear displacement."""
    dim = 3 if model == "3d" else 2
    axes = rotation(dim)
    S = turned(SPRUCE.compliance, axes)
    if dim == 3:
        xx, yy, zz, yz, xz, xy = STRESS
        sigma = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        exx, eyy, ezz, gyz, gxz, gxy = S @ STRESS
        A = np.array([[exx, gxy, gxz], [0.0, eyy, gyz], [0.0, 0.0, ezz]])
    else:
        xx, yy, xy = STRESS[[0, 1, 5]]
        sigma = np.array([[xx, xy], [xy, yy]])
        exx, eyy, gxy = plane(S, model == "plane stress") @ STRESS[[0, 1, 5]]
        A = np.array([[exx, gxy], [0.0, eyy]])
    sides = SIDES if dim == 3 else {0: SIDES[0], 1: SIDES[2]}
    loads = {
        side: {"boundary": f"block.{side}", "traction": (sign * sigma[axis]).tolist()}
        for axis, pair in sides.items()
        for side, sign in zip(pair, (-1, 1), strict=True)
    }
    simulation = prepare(from_dict(block(model, order, axes) | {"loads": loads, "supports": held_at_points(dim)}))
    (step,) = simulation.steps()
    exact = simulation.data.points[:, :dim] @ A.T
    off = float(np.abs(step.displacement[:, :dim] - exact).max())
    stress = float(np.abs(step.stress[:, :dim, :dim] - sigma).max())
    energy = np.sum(sigma * A)  # half of it, in 2 m³
    name = f"pulled, {model}, order {order}"
    return [
        close(f"{name}: displacement off [m]", off, 0.0, 1e-9, float(np.abs(exact).max())),
        close(f"{name}: stress off [Pa]", stress, 0.0, 1e-9, float(np.abs(sigma).max())),
        close(f"{name}: stored energy [J]", step.energy.stored, energy, 1e-9, energy),
    ]


def pressed(model: Model, order: int, method: str) -> list[Check]:
    """Its top is lowered on a floor without friction: a uniform pressure, and sides that lean."""
    dim = 3 if model == "3d" else 2
    up, around = "xyz"[dim - 1], model == "axisymmetric"
    axes = np.eye(3) if around else rotation(dim)
    S = turned(ROUND.compliance, axes) if around else turned(SPRUCE.compliance, axes)
    gives = plane(S, model == "plane stress")[1, 1] if dim == 2 and not around else S[dim - 1, dim - 1]
    tables = block(model, order, axes, ROUND if around else SPRUCE)
    held: dict[str, dict[str, Any]] = {"top": {"boundary": "block.top", "displacement": {up: -PRESSED}}}
    if not around:
        held["origin"] = {"point": [0.0] * dim, "displacement": dict.fromkeys("xy"[: dim - 1], 0.0)}
    if dim == 3:
        held["end"] = {"point": [2.0, 0.0, 0.0], "displacement": {"y": 0.0}}
    tables |= {
        "supports": held,
        "obstacles": {"floor": {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}},
        "contacts": {"base": {"surface": "block.bottom", "against": "floor"}},
        "solver": {"method": method, "tolerance": 1e-11},
    }
    (step,) = prepare(from_dict(tables)).steps()
    p = PRESSED / gives
    stress = step.stress[:, dim - 1, dim - 1]
    name = f"pressed, {model}, order {order}"
    found = [
        close(f"{name}: pressure [Pa]", farthest(step.contacts["base"].pressure, p), p, 1e-8, p),
        close(f"{name}: stress [Pa]", farthest(stress, -p), -p, 1e-8, p),
    ]
    if dim == 2 and not around:
        leans = plane(S, model == "plane stress")[2, 1] * -p
        points = prepare(from_dict(tables)).data.points
        corner = np.linalg.norm(points[:, :2] - [0.0, 1.0], axis=1).argmin()
        found.append(close(f"{name}: lean [m]", step.displacement[corner, 0], leans, 1e-8, abs(leans)))
    return found


def heated(model: Model) -> list[Check]:
    """Held nowhere it has no stress in the plane, although it expands by axis and so shears."""
    dim = 3 if model == "3d" else 2
    axes = rotation(dim)
    free = axes.T @ np.diag(WARMTH) @ axes
    A = np.triu(2 * free[:dim, :dim], 1) + np.diag(free.diagonal()[:dim])
    if model == "plane strain":
        S = turned(SPRUCE.compliance, axes)
        A -= np.array([[S[0, 2], S[5, 2]], [0.0, S[1, 2]]]) / S[2, 2] * free[2, 2]
    warm = {"thermal": {"block": {"expansion": [strain / 10 for strain in WARMTH], "temperature": 10.0}}}
    simulation = prepare(from_dict(block(model, 2, axes) | warm | {"supports": held_at_points(dim)}))
    (step,) = simulation.steps()
    exact = simulation.data.points[:, :dim] @ A.T
    off = float(np.abs(step.displacement[:, :dim] - exact).max())
    stress, scale = float(np.abs(step.stress[:, :dim, :dim]).max()), SPRUCE.E[0] * WARMTH[0]
    return [
        close(f"heated, {model}: displacement off [m]", off, 0.0, 1e-9, float(np.abs(exact).max())),
        close(f"heated, {model}: stress [Pa]", stress, 0.0, 1e-9, scale),
    ]


def tube(method: str) -> list[Check]:
    """Triangles of order 2, 16 across the wall."""
    exact_u, exact_p = TUBE.touching()
    sides = {side: {"boundary": f"tube.{side}", "displacement": {"y": 0.0}} for side in ("bottom", "top")}
    with TemporaryDirectory() as folder:
        (Path(folder) / "tube.geo").write_text(TUBE_FILE, encoding="utf-8")
        tables = {
            "model": "axisymmetric",
            "geometry": {"file": "tube.geo", "order": 2},
            "bodies": {"tube": table(SPRUCE, np.eye(3), 2)},
            "supports": sides,
            "loads": {"inside": {"boundary": "tube.inside", "pressure": TUBE.pressure}},
            "obstacles": {"bore": {"shape": "plane", "point": [TUBE.outer + TUBE.gap, 0.0], "normal": [-1.0, 0.0]}},
            "contacts": {"wall": {"surface": "tube.outside", "against": "bore"}},
            "solver": {"method": method, "tolerance": 1e-11},
        }
        simulation = prepare(from_dict(tables, Path(folder)))
        (step,) = simulation.steps()
    inside = np.abs(simulation.data.points[:, 0] - TUBE.inner) < 1e-9
    u, p = step.displacement[inside, 0], step.contacts["wall"].pressure
    return [
        close("tube: displacement inside [m]", farthest(u, exact_u), exact_u, 1e-4, exact_u),
        close("tube: pressure on the bore [Pa]", farthest(p, exact_p), exact_p, 1e-3, exact_p),
    ]


@dataclass(frozen=True)
class Rolled:
    """A half-plane of spruce under a roller, its fibres at an angle to the surface."""

    degrees: float
    model: Model = "plane strain"

    @property
    def beta(self) -> Array:
        """Compliance in the plane."""
        return plane(turned(SPRUCE.compliance, rotation(2, self.degrees)), self.model == "plane stress")


def on_a_half_plane(case: Rolled, method: str) -> Iterator[Check]:
    """A half-ellipse through the nodal pressures, at the computed load."""
    unit = roller(case.beta, 1.0, RADIUS)
    load = (SLIM * RADIUS / unit.a) ** 2
    exact = roller(case.beta, load, RADIUS)
    size = 4000 * exact.a
    tables = {
        "model": case.model,
        "geometry": {
            "builder": "half_space",
            "size": size,
            "contact_half_width": 1.3 * exact.a,
            "mesh_size": size / 4,
            "contact_mesh_size": exact.a / CELLS,
            "order": 2,
        },
        "bodies": {"half_space": table(SPRUCE, rotation(2, case.degrees), 2)},
        "obstacles": {"roller": {"shape": "cylinder", "point": [0.0, RADIUS], "radius": RADIUS, "force": {"y": -load}}},
        "contacts": {"face": {"surface": "half_space.contact", "against": "roller"}},
        "supports": {"bottom": {"boundary": "half_space.bottom", "displacement": {"x": 0.0, "y": 0.0}}},
        "solver": {"method": method, "tolerance": 1e-10},
    }
    simulation = prepare(from_dict(tables))
    (step,) = simulation.steps()
    face, points = step.contacts["face"], simulation.data.surfaces["face"].points
    at = points[:, 0] - np.average(points[:, 0], weights=face.pressure * face.weight)
    fitted = ellipse(np.abs(at), face.pressure, face.weight, 0.7 * exact.a)
    inside = np.abs(at) < 0.9 * exact.a
    off = (face.pressure - exact.pressure(at))[inside] / exact.p0
    name = f"roller, {case.model}, fibres at {case.degrees:g} degrees"
    yield Check(f"{name}: load [N/m]", abs(float(step.obstacles["roller"].force[1])), load, 1e-8, relative=True)
    yield Check(f"{name}: p0 [Pa]", fitted.p0, exact.p0, TOLERANCE, relative=True)
    yield Check(f"{name}: a [m]", fitted.a, exact.a, TOLERANCE, relative=True)
    yield Check(f"{name}: pressures over p0, root mean square", float(np.sqrt(np.mean(off**2))), 0.0, TOLERANCE, False)


def checks(method: str) -> list[Check]:
    """All of them; an obstacle driven by a force needs a method for floating bodies."""
    models: tuple[Model, ...] = ("plane strain", "plane stress", "axisymmetric", "3d")
    found = [check for model in models if model != "axisymmetric" for order in (1, 2) for check in pulled(model, order)]
    found += [check for model in models for order in (1, 2) for check in pressed(model, order, method)]
    found += [check for model in models if model != "axisymmetric" for check in heated(model)]
    found += tube(method)
    if METHODS[method].WORKS_WITH.floating:
        cases = (Rolled(0.0), Rolled(90.0), Rolled(30.0), Rolled(30.0, "plane stress"))
        found += [check for case in cases for check in on_a_half_plane(case, method)]
    return found
