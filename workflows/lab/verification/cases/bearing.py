"""A ball on the groove of a bearing's inner ring, or on a flat, from a STEP file: a quarter of both against Hertz.

Hertz contact of two elastic bodies whose gap is A x² + B y²: an elliptical area.

Source: Johnson, Contact Mechanics (1985), section 4.2, with (4.25), (4.26).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipk, elliprd

from stickslip import Contact, Material, Scene, Support
from stickslip.geometry.arrays import Array, Bools
from stickslip.workflows.lab.verification.cases.hertz import plane_strain
from stickslip.workflows.lab.verification.check import ONE, Check, problem
from stickslip.workflows.lab.verification.prepared import solved, solver
from stickslip.workflows.lab.verification.step_file import MM, NEAR, on_plane, read_step, step_file

SLIMMEST = 1e-6  # b / a that is looked for


@dataclass(frozen=True, kw_only=True)
class Ellipse:
    """A contact with p = p0 sqrt(1 - (x / a)² - (y / b)²)."""

    a: float  # larger half axis, along x [m]
    b: float  # [m]
    p0: float  # [Pa]
    approach: float  # of distant points [m]

    def pressure(self, x: Array, y: Array) -> Array:
        """Pressure (n,) [Pa] at places (n,) [m]."""
        return np.asarray(self.p0 * np.sqrt(np.maximum(1 - (x / self.a) ** 2 - (y / self.b) ** 2, 0.0)))


def ellipse(F: float, A: float, B: float, E_star: float) -> Ellipse:
    """Pressed with F [N]; A <= B [1/m].

    With k = b / a, and K, E the complete elliptic integrals of 1 - k², Johnson has A by (K - E) / (1 - k²) and B by
    (E / k² - K) / (1 - k²): these are Carlson's R_D(0, k², 1) / 3 and R_D(0, 1, k²) / 3, which do not cancel.

    >>> found = ellipse(60 * np.pi, 1 / 16, 1 / 16, 1000 / 0.91)  # the sphere of `hertz`
    >>> [round(value, 4) for value in (found.a, found.b, found.p0, found.approach)]
    [1.0096, 1.0096, 88.2904, 0.1274]
    """

    def ratio(k: float) -> float:
        return float(elliprd(0.0, 1.0, k**2) / elliprd(0.0, k**2, 1.0)) - B / A

    k = brentq(ratio, SLIMMEST, 1.0, xtol=1e-15, rtol=1e-14)
    a = float((F * elliprd(0.0, k**2, 1.0) / (2 * np.pi * E_star * A)) ** (1 / 3))
    b = k * a
    approach = 3 * F * float(ellipk(1 - k**2)) / (2 * np.pi * a * E_star)
    return Ellipse(a=a, b=b, p0=3 * F / (2 * np.pi * a * b), approach=approach)


BALL, RACE = 5e-3, 20e-3  # radii of the ball, and of the race at the bottom of its groove [m]
SECTION = 6e-3  # radius of the groove's section [m]
BLOCK = 10e-3  # edges of the segment of the ring that is drawn [m]
RIM = 0.5e-3  # by which it is higher than the bottom of the groove [m]
E, NU = 210e9, 0.3
E_STAR = plane_strain(E, NU) / 2
LOAD = 50.0  # [N], on the whole ball
CAP = 1.3  # radius of the part of the ball that has fine cells, over the larger half axis


@dataclass(frozen=True, kw_only=True)
class Rest:
    """A mesh of the ball and of what it rests on."""

    on: Literal["groove", "flat"] = "groove"
    cells: float = 4.0  # in the smaller half axis
    load: float = LOAD  # [N]
    order: Literal[1, 2] = 2
    method: str = "condensed-newton"

    def __str__(self) -> str:
        return f"ball on a {self.on}, order {self.order}, {self.cells:g} cells in b"

    def exact(self, load: float) -> Ellipse:
        """Hertz' answer; the groove's section follows the ball along x, and the race falls away along y."""
        along, across = (1 / SECTION, -1 / RACE) if self.on == "groove" else (0.0, 0.0)
        return ellipse(load, (1 / BALL - along) / 2, (1 / BALL - across) / 2, E_STAR)

    @cached_property
    def cap(self) -> float:
        """Radius of the fine part of the ball [m]."""
        return CAP * self.exact(self.load).a

    @property
    def height(self) -> float:
        """Of the edge of that part [m]."""
        return BALL - float(np.sqrt(BALL**2 - self.cap**2))

    def draw(self, occ: Any) -> None:
        """A quarter of the lower half of the ball, and what lies under it, in mm."""
        R, cap, height = (length / MM for length in (BALL, self.cap, self.height))
        centre, *points = (occ.addPoint(x, 0, z) for x, z in ((0.0, R), (0.0, 0.0), (cap, height), (R, R)))
        arcs = [occ.addCircleArc(one, centre, other) for one, other in pairwise(points)]
        lines = [occ.addLine(centre, points[0]), *arcs, occ.addLine(points[-1], centre)]
        section = occ.addPlaneSurface([occ.addCurveLoop(lines)])
        occ.revolve([(2, section)], 0, 0, 0, 0, 0, 1, np.pi / 2)
        occ.remove([(2, section)], recursive=True)
        block = BLOCK / MM
        if self.on == "flat":
            occ.addBox(0, 0, -block, block, block, block)
            return
        ring = occ.addBox(0, 0, -block, block, block, block + RIM / MM)
        groove = occ.addTorus(0, 0, 0, (RACE + SECTION) / MM, SECTION / MM)
        occ.rotate([(3, groove)], 0, 0, 0, 0, 1, 0, np.pi / 2)
        occ.translate([(3, groove)], 0, 0, -RACE / MM)
        occ.cut([(3, ring)], [(3, groove)])

    def on_cap(self, x: Array) -> Bools:
        """Whether points (n, 3) [m] lie on the fine part of the ball."""
        on_ball = np.abs(np.linalg.norm(x - [0.0, 0.0, BALL], axis=1) - BALL) < NEAR
        return np.asarray(on_ball & (x[:, 2] < self.height + NEAR))

    def on_race(self, x: Array) -> Bools:
        """Whether they lie on the groove or flat."""
        if self.on == "flat":
            return np.asarray(np.abs(x[:, 2]) < NEAR)
        around = np.hypot(x[:, 1], x[:, 2] + RACE) - RACE - SECTION
        return np.asarray(np.abs(np.hypot(x[:, 0], around) - SECTION) < NEAR)


def scene(rest: Rest, path: Path) -> Scene:
    """The ball's equator goes down by Hertz' approach; the block stands."""
    exact = rest.exact(rest.load)
    planes = {f"{body}.{name}": on_plane(axis) for body in ("ball", "ring") for axis, name in enumerate("xy")}
    geometry = read_step(
        path,
        bodies={"ball": "part", "ring": "part_2"},
        sides={
            "ball.cap": rest.on_cap,
            "ring.race": rest.on_race,
            "ball.equator": on_plane(2, BALL),
            "ring.foot": on_plane(2, -BLOCK),
            **planes,
        },
        mesh_size=BALL / 3,
        contact_mesh_size=exact.b / rest.cells,
        order=rest.order,
    )
    held = {side: {side[-1]: 0.0} for side in planes}
    held |= {"ball.equator": {"z": -exact.approach}, "ring.foot": {"z": 0.0}}
    return Scene(
        model="3d",
        geometry=geometry,
        bodies={"ball": Material(E=E, nu=NU), "ring": Material(E=E, nu=NU)},
        contacts={"race": Contact(surface="ball.cap", against="ring.race", slave="surface")},
        supports={
            side.replace(".", "_"): Support(boundary=side, displacement=motion)  # type: ignore[arg-type]
            for side, motion in held.items()
        },
        solver=solver(rest.method, 1e-9),
    )


@dataclass(frozen=True, kw_only=True)
class Found:
    """The computed numbers, of the whole ball."""

    load: float  # [N]
    fitted: Ellipse  # through the nodal pressures
    scatter: float  # of these about Hertz' own, over its p0, root mean square
    radius: float  # of a circle as large as what touches [m]
    highest: float  # pressure at a node [Pa]


def solve(rest: Rest) -> Found:
    """Its only step."""
    with step_file(rest.draw) as path:
        _, (step,) = solved(scene(rest, path))
    race = step.contacts["race"]
    load = 4 * float(-step.supports["ball_equator"].force[2])
    exact = rest.exact(load)
    x, y, _ = race.points.T
    reach = np.hypot(x / exact.a, y / exact.b)
    off = ((race.pressure - exact.pressure(x, y)) / exact.p0)[reach < 0.9]
    near = reach < 0.7
    return Found(
        load=load,
        fitted=fitted(x[near], y[near], race.pressure[near], race.weight[near], exact.approach),
        scatter=float(np.sqrt(np.average(off**2, weights=race.weight[reach < 0.9]))),
        radius=float(np.sqrt(4 * race.contact_area / np.pi)),
        highest=race.max_pressure,
    )


def fitted(x: Array, y: Array, p: Array, weight: Array, approach: float = 0.0) -> Ellipse:
    """Least squares in p² = p0² (1 - x² / a² - y² / b²) over nodes within the ellipse.

    >>> x, y = (c.ravel() for c in np.meshgrid(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 0.5, 5)))
    >>> found = fitted(x, y, Ellipse(a=3.0, b=1.0, p0=2.0, approach=0.0).pressure(x, y), np.ones(25))
    >>> round(found.a, 12), round(found.b, 12), round(found.p0, 12)
    (3.0, 1.0, 2.0)
    """
    each = np.sqrt(weight)
    rows = each[:, None] * np.stack([np.ones_like(x), -(x**2), -(y**2)], axis=1)
    sizes = np.abs(rows).max(axis=0)
    level, along, across = np.linalg.lstsq(rows / sizes, each * p**2, rcond=None)[0] / sizes
    a, b = (float(np.sqrt(level / slope)) for slope in (along, across))
    return Ellipse(a=a, b=b, p0=float(np.sqrt(level)), approach=approach)


# With 2, 3, 4, 6 cells in b at 50 N on the groove: p0 -1, -1.2, -.8, -.1 %, a .8, 1.5, 1, -.4 %, b -1, 1.6, 3.4, .4 %,
# pressures 5, 3, 3, 1.1 %; on the flat with 3 and 6: p0 -.6, -.4 %, a and b 4 and .4 %, pressures 6, 1.4 %. Linear
# cells, 4 in b: p0 2.6 %, a 4 %, b 60 %. The equator of the ball is R away, the foot 2 R, and normals lean by a / R:
# the approach at a given load is .5, 1, 2 % too small at 5, 50, 500 N, where sqrt(a b) / R = .013, .03, .06.
HEAVY, LIGHT = 500.0, 5.0  # [N]


def figures(rest: Rest, fine: bool = True) -> list[Check]:
    """Half axes, pressures and approach, beside Hertz' at the computed load.

    Args:
        fine: whether the cells are small enough for half axes and pressures.
    """
    found = solve(rest)
    exact, given = rest.exact(found.load), rest.exact(rest.load)
    lean = float(np.sqrt(given.a * given.b)) / BALL
    name, tolerance = f"{rest}, {rest.load:g} N", 0.4 * lean + 0.01 / rest.cells
    checks = [Check(f"{name}: approach [m]", given.approach, exact.approach, tolerance, relative=True)]
    if fine:
        size = float(np.sqrt(exact.a * exact.b))
        checks += [
            Check(f"{name}: a [m]", found.fitted.a, exact.a, 0.12 / rest.cells, relative=True),
            Check(f"{name}: b [m]", found.fitted.b, exact.b, 0.12 / rest.cells, relative=True),
            Check(f"{name}: p0 [Pa]", found.fitted.p0, exact.p0, 0.06 / rest.cells, relative=True),
            Check(f"{name}: largest pressure [Pa]", found.highest, exact.p0, 0.06 / rest.cells, relative=True),
            Check(
                f"{name}: pressures over p0, root mean square", found.scatter, 0.0, 0.15 / rest.cells, relative=False
            ),
            # a sum over nodes: exact to half a cell
            Check(f"{name}: radius by the area that touches [m]", found.radius, size, 0.5 / rest.cells, relative=True),
        ]
    return checks


@problem("a ball on a groove, from a STEP file: Hertz' ellipse", methods=ONE, slow=ONE)
def checks(method: str) -> list[Check]:
    """A loaded ball of a bearing, one on a flat, and the approach under a light load."""
    found = figures(Rest(load=HEAVY, method=method)) + figures(Rest(on="flat", cells=6.0, method=method))
    return found + figures(Rest(load=LIGHT, cells=2.0, method=method), fine=False)
