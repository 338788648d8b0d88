"""Orthotropic bodies off their axes: uniform stress, heat, a tube that touches a bore, a roller on half-planes.

Orthotropic bodies: compliance off the axes, a tube that touches a rigid bore, a cylinder on a half-plane.

Sources: Bond, Proc. Phys. Soc. 56 (1943), of the compliance; Lekhnitskii, Theory of Elasticity of an Anisotropic Body
(1981), sections 19 and 35, of plane problems and of tubes; Willis, J. Mech. Phys. Solids 14 (1966), and Ting,
Anisotropic Elasticity (1996), sections 7.3 and 10.5, of half-planes and of indenters.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.shape import Model
from stickslip.solvers.method_registry import METHODS
from stickslip.workflows.lab.verification.cases.hertz import Hertz, cylinder, ellipse
from stickslip.workflows.lab.verification.check import TWO, Check, close, farthest, problem
from stickslip.workflows.lab.verification.prepared import prepare, solved
from stickslip.workflows.scene_file.read import from_dict

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # components of stress as a vector of six


@dataclass(frozen=True, kw_only=True)
class Constants:
    """Engineering constants along the axes 1, 2, 3."""

    E: tuple[float, float, float]  # [Pa]
    G: tuple[float, float, float]  # between axes 2 and 3, 1 and 3, 1 and 2 [Pa]
    nu: tuple[float, float, float]  # nu_23, nu_13, nu_12 [-]

    @property
    def compliance(self) -> Array:
        """Strains eps_11, 22, 33, 2 eps_23, 13, 12 by stresses (6, 6) [1/Pa]."""
        E, (nu_23, nu_13, nu_12) = self.E, self.nu
        S = np.diag([*(1 / np.array(E)), *(1 / np.array(self.G))])
        S[0, 1] = S[1, 0] = -nu_12 / E[0]
        S[0, 2] = S[2, 0] = -nu_13 / E[0]
        S[1, 2] = S[2, 1] = -nu_23 / E[1]
        return S


def turned(S: Array, axes: Array) -> Array:
    """Compliance (6, 6) [1/Pa] in the scene's axes: S' = M^T S M, M the stresses along the axes by those of the scene.

    Args:
        S: along the axes (6, 6) [1/Pa].
        axes: their unit vectors as rows (3, 3).

    >>> oak = Constants(E=(4.0, 1.0, 1.0), G=(1.0, 1.0, 0.5), nu=(0.0, 0.0, 0.0)).compliance
    >>> half = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2)]]) / np.sqrt(2)
    >>> float(turned(oak, half)[0, 0].round(12))  # (1 / E_1 + 1 / E_2 + 1 / G_12) / 4
    0.8125
    """
    Q, M = axes, np.empty((6, 6))
    for row, (i, j) in enumerate(PAIRS):
        for column, (a, b) in enumerate(PAIRS):
            M[row, column] = Q[i, a] * Q[j, a] if a == b else Q[i, a] * Q[j, b] + Q[i, b] * Q[j, a]
    return np.asarray(M.T @ S @ M)


def plane(S: Array, plane_stress: bool) -> Array:
    """Strains eps_xx, eps_yy, 2 eps_xy by stresses in the plane (3, 3) [1/Pa]; else eps_zz = 0."""
    kept = np.ix_([0, 1, 5], [0, 1, 5])
    return np.asarray(S[kept] - (0 if plane_stress else np.outer(S[:, 2], S[2])[kept] / S[2, 2]))


def surface_compliance(beta: Array) -> float:
    """Of the surface y = 0 of a half-plane [1/Pa]: a line load P presses it by -P / pi times this times ln|x|.

    It is beta_11 (a d - b c), where a + i b is the sum and c + i d the product of the roots mu_1, mu_2 of positive
    imaginary part of beta_11 mu^4 - 2 beta_16 mu^3 + (2 beta_12 + beta_66) mu^2 - 2 beta_26 mu + beta_22 = 0.
    Isotropic, in plane strain, it is 2 (1 - nu^2) / E, which has a double root.

    Args:
        beta: see `plane`.

    >>> beta = plane(Constants(E=(1.0, 1.0, 1.0), G=(0.5, 0.5, 0.5001), nu=(0.0, 0.0, 0.0)).compliance, True)
    >>> round(surface_compliance(beta), 3)
    2.0
    """
    (b_11, b_12, b_16), (_, b_22, b_26), (_, _, b_66) = beta
    roots = np.roots([b_11, -2 * b_16, 2 * b_12 + b_66, -2 * b_26, b_22])
    one, two = roots[roots.imag > 0]
    total, product = one + two, one * two
    return float(b_11 * (total.real * product.imag - total.imag * product.real))


def roller(beta: Array, load: float, radius: float) -> Hertz:
    """Half width and peak pressure of a rigid roller that presses a half-plane, both without friction.

    The normal displacement of the surface knows no more of the half-plane than `surface_compliance`; so Hertz' ellipse
    holds with E* = 2 / surface_compliance.

    Args:
        beta: see `plane`.
        load: per length [N/m].
        radius: [m].
    """
    return cylinder(load, radius, 2 / surface_compliance(beta))


@dataclass(frozen=True, kw_only=True)
class Tube:
    """A long tube that cannot grow longer, pressed from inside until it touches a rigid bore; axis 1 r, 2 y, 3 hoop.

    u = A r^k + B r^-k with k = sqrt(c_33 / c_11), sigma_r = c_11 u' + c_13 u / r.
    """

    constants: Constants
    inner: float  # radius [m]
    outer: float  # [m]
    pressure: float  # inside [Pa]
    gap: float  # around it [m]

    def touching(self) -> tuple[float, float]:
        """Displacement of the inner surface [m], and pressure on the bore [Pa], where it touches.

        >>> steel = Constants(E=(1.0, 1.0, 1.0), G=(0.5, 0.5, 0.5), nu=(0.0, 0.0, 0.0))
        >>> thin = Tube(constants=steel, inner=1.0, outer=1.001, pressure=0.01, gap=0.0)
        >>> [round(value, 4) + 0.0 for value in thin.touching()]  # pressure goes through it
        [0.0, 0.01]
        """
        c = np.linalg.inv(self.constants.compliance[:3, :3])
        k = np.sqrt(c[2, 2] / c[0, 0])

        def displacement(r: float) -> Array:
            return np.array([r**k, r**-k])

        def radial(r: float) -> Array:
            return np.array([(c[0, 0] * k + c[0, 2]) * r ** (k - 1), (c[0, 2] - c[0, 0] * k) * r ** (-k - 1)])

        rows = np.array([radial(self.inner), displacement(self.outer)])
        found = np.linalg.solve(rows, [-self.pressure, self.gap])
        return float(displacement(self.inner) @ found), -float(radial(self.outer) @ found)


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
    simulation, (step,) = solved(
        from_dict(block(model, order, axes) | {"loads": loads, "supports": held_at_points(dim)})
    )
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
    _, (step,) = solved(from_dict(tables))
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
    simulation, (step,) = solved(from_dict(block(model, 2, axes) | warm | {"supports": held_at_points(dim)}))
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
        simulation, (step,) = solved(from_dict(tables, Path(folder)))
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
    simulation, (step,) = solved(from_dict(tables))
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


@problem("orthotropic: uniform stress off the axes, a tube, a roller on half-planes", methods=TWO)
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
