"""A shaft pressed or shrunk into a hub, both with free ends, from a STEP file: a quarter of both, or their section.

A shaft pressed into a hub, both with free ends: Lamé's solution in plane stress, cold and warm.

Source: Timoshenko & Goodier, Theory of Elasticity, § 28.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from stickslip import Contact, Material, Scene, Simulation, StepResult, Steps, Support
from stickslip.geometry.arrays import Array
from stickslip.solvers.effects.thermal import Thermal
from stickslip.workflows.lab.verification.check import METHODS, TWO, Check, close, problem
from stickslip.workflows.lab.verification.prepared import prepare, solver
from stickslip.workflows.lab.verification.step_file import MM, on_cylinder, on_plane, read_step, step_file


@dataclass(frozen=True, kw_only=True)
class Cylinder:
    """A full or hollow cylinder with free ends: radial and hoop stress are A - B / r² and A + B / r²."""

    outer: float  # radius [m]
    bore: float = 0.0  # radius [m]
    E: float  # [Pa]
    nu: float  # [-]

    def constants(self, inside: float, around: float) -> tuple[float, float]:
        """A [Pa] and B [N] under the pressures inside and around it [Pa]."""
        a, b = self.bore**2, self.outer**2
        return (inside * a - around * b) / (b - a), (inside - around) * a * b / (b - a)

    def displacement(self, r: Array, inside: float = 0.0, around: float = 0.0) -> Array:
        """Radial displacement (n,) [m] at radii r (n,) [m].

        >>> Cylinder(outer=1.0, E=2.0, nu=0.5).displacement(np.array([0.0, 1.0]), around=1.0)
        array([ 0.  , -0.25])
        >>> Cylinder(bore=1.0, outer=2.0, E=1.0, nu=0.0).displacement(np.array([1.0, 2.0]), 3.0).tolist()
        [5.0, 4.0]
        """
        A, B = self.constants(inside, around)
        turned = np.divide(B, r, out=np.zeros_like(r), where=r > 0)
        return np.asarray(((1 - self.nu) * A * r + (1 + self.nu) * turned) / self.E)

    def stresses(self, r: Array, inside: float = 0.0, around: float = 0.0) -> tuple[Array, Array]:
        """Radial and hoop stress (n,) [Pa].

        >>> Cylinder(bore=1.0, outer=2.0, E=1.0, nu=0.3).stresses(np.array([1.0, 2.0]), 3.0)
        (array([-3.,  0.]), array([5., 2.]))
        """
        A, B = self.constants(inside, around)
        return A - B / r**2, A + B / r**2


def pressure(shaft: Cylinder, hub: Cylinder, interference: float, expanded: float = 0.0) -> float:
    """Pressure [Pa] where they meet.

    Args:
        interference: [m].
        expanded: free strain of the hub, which takes its part of the interference, or all of it.

    >>> shaft, hub = Cylinder(outer=1.0, E=1.0, nu=0.0), Cylinder(bore=1.0, outer=3.0, E=1.0, nu=0.0)
    >>> round(pressure(shaft, hub, 9.0), 12), round(pressure(shaft, hub, 9.0, 5.0), 12), pressure(shaft, hub, 9.0, 10.0)
    (4.0, 1.777777777778, 0.0)
    """
    at = np.array([hub.bore])
    gives = hub.displacement(at, inside=1.0) - shaft.displacement(at, around=1.0)
    return max(interference - expanded * hub.bore, 0.0) / float(gives[0])


SHAFT = Cylinder(outer=0.02, E=210e9, nu=0.3)
HUB = Cylinder(bore=0.02, outer=0.04, E=70e9, nu=0.33)
THICK = 0.005  # [m]
INTERFERENCE = 10e-6  # [m]
EXPANDS = 23e-6  # the hub [1/K]
COOLING = ((0.0, 60.0), (1.0, 60.0), (2.0, 10.0), (3.0, 0.0))  # [s, K]; above 21.7 K the hub is loose
SIZES = {"3d": 2.5e-3, "axisymmetric": 1.25e-3}  # cells [m]


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A mesh of both, and where the interference comes from."""

    model: Literal["3d", "axisymmetric"] = "3d"
    finer: float = 1.0  # than `SIZES`
    order: Literal[1, 2] = 2
    gap: Literal["given", "of the meshes"] = "given"  # to which gap_offset is added
    drawn: bool = False  # the shaft is drawn too large, and the exact gap given, instead of a gap_offset
    heated: bool = False  # the hub, by `COOLING`
    method: str = "condensed-newton"

    def __str__(self) -> str:
        words = [self.model, f"order {self.order}", f"gap {self.gap}"] + ["shaft drawn too large"] * self.drawn
        return ", ".join(words + [f"cells / {self.finer:g}"] * (self.finer != 1))

    @property
    def radius(self) -> float:
        """Of the shaft as it is drawn [m]."""
        return SHAFT.outer + INTERFERENCE * self.drawn

    @property
    def share(self) -> float:
        """Of the full circle."""
        return 0.25 if self.model == "3d" else 1.0

    def draw(self, occ: Any) -> None:
        """Shaft and hub, in mm."""
        thick, shaft, bore, outer = (length / MM for length in (THICK, self.radius, HUB.bore, HUB.outer))
        if self.model == "axisymmetric":
            occ.addRectangle(0, 0, 0, shaft, thick)
            occ.addRectangle(bore, 0, 0, outer - bore, thick)
            return
        solids = [occ.addCylinder(0, 0, 0, 0, 0, thick, r, angle=np.pi / 2) for r in (shaft, outer, bore)]
        occ.cut([(3, solids[1])], [(3, solids[2])])


def scene(fit: Fit, path: Path) -> Scene:
    """Each body is held in its planes of symmetry and on one end."""
    solid = fit.model == "3d"
    planes = {"x_plane": (0, "x"), "y_plane": (1, "y"), "end": (2, "z")} if solid else {"end": (1, "y")}
    held = {f"{body}.{name}": where for body in ("shaft", "hub") for name, where in planes.items()}
    around = on_cylinder if solid else lambda radius: on_plane(0, radius)
    geometry = read_step(
        path,
        bodies={"shaft": "part", "hub": "part_2"},
        sides={"shaft.fit": around(fit.radius), "hub.bore": around(HUB.bore)}
        | {side: on_plane(axis) for side, (axis, _) in held.items()},
        mesh_size=SIZES[fit.model] / fit.finer,
        order=fit.order,
        dim=3 if solid else 2,
    )
    exact = -INTERFERENCE if fit.drawn else 0.0
    joint = Contact(
        surface="hub.bore",
        against="shaft.fit",
        gap=exact if fit.gap == "given" else None,
        gap_offset=0.0 if fit.drawn else -INTERFERENCE,
    )
    heat = {"thermal": {"hub": Thermal(expansion=EXPANDS, temperature=COOLING)}}
    return Scene(
        title="Press fit from a STEP file",
        model=fit.model,
        geometry=geometry,
        bodies={"shaft": Material(E=SHAFT.E, nu=SHAFT.nu), "hub": Material(E=HUB.E, nu=HUB.nu)},
        contacts={"joint": joint},
        supports={
            side.replace(".", "_"): Support(boundary=side, displacement={axis: 0.0})  # type: ignore[dict-item]
            for side, (_, axis) in held.items()
        },
        steps=Steps(end=3.0, count=3) if fit.heated else Steps(),
        solver=solver(fit.method, 1e-10),
        sections=heat if fit.heated else {},
    )


@dataclass(frozen=True, kw_only=True)
class Found:
    """A step beside Lamé's solution; deviations are over the pressure of the cold fit, or over the interference."""

    time: float  # [s]
    p: float  # mean [Pa]
    exact: float  # [Pa]
    scatter: float  # of the pressures at nodes, root mean square
    u: float  # of the radial displacement of both bodies, greatest
    stress: float  # radial and hoop in both, root mean square over the cells' midpoints
    work: float  # of contact, from the start [J]; nothing else works on a fit that is cold


def solve(fit: Fit) -> list[Found]:
    """All steps."""
    with step_file(fit.draw) as path:
        simulation = prepare(scene(fit, path))
        return [_found(fit, simulation, step) for step in simulation.steps()]


def _found(fit: Fit, simulation: Simulation, step: StepResult) -> Found:
    data, joint = simulation.data, step.contacts["joint"]
    expanded = EXPANDS * float(np.interp(step.time, *np.transpose(COOLING))) if fit.heated else 0.0
    p, cold = pressure(SHAFT, HUB, INTERFERENCE, expanded), pressure(SHAFT, HUB, INTERFERENCE)
    corners = data.cells[:, : data.points.shape[1] + 1]
    in_hub = data.body == data.bodies.index("hub")
    off, worst = [], 0.0
    for own, solid, loads, free in ((in_hub, HUB, {"inside": p}, expanded), (~in_hub, SHAFT, {"around": p}, 0.0)):
        nodes = np.unique(data.cells[own])
        r, out = _radial(data.points[nodes])
        moved = np.einsum("nd,nd->n", step.displacement[nodes], out[:, : data.points.shape[1]])
        exact = solid.displacement(r, **loads) + free * r
        worst = max(worst, float(np.abs(moved - exact).max()))
        r, out = _radial(data.points[corners[own]].mean(axis=1))
        stress = step.stress[own]
        radial, trace = np.einsum("ci,cij,cj->c", out, stress, out), np.trace(stress, axis1=1, axis2=2)
        axis = 2 if fit.model == "3d" else 1
        hoop = trace - radial - stress[:, axis, axis]
        parts = solid.stresses(r, **loads)
        off += [radial - parts[0], hoop - parts[1]]
    area = 2 * np.pi * fit.share * HUB.bore * THICK
    scatter = np.sqrt(np.average((joint.pressure - p) ** 2, weights=joint.weight))
    return Found(
        time=step.time,
        p=joint.normal_force / area,
        exact=p,
        scatter=float(scatter) / cold,
        u=worst / INTERFERENCE,
        stress=float(np.sqrt(np.mean(np.concatenate(off) ** 2))) / cold,
        work=step.energy.contact / fit.share,
    )


def _radial(points: Array) -> tuple[Array, Array]:
    """Radius (n,) of points (n, d), and radial unit vectors (n, 3); in an axisymmetric model they are those of x."""
    across = points[:, :2] if points.shape[1] == 3 else points[:, :1]
    r = np.linalg.norm(across, axis=1)
    out = np.zeros((len(points), 3))
    out[:, : across.shape[1]] = np.divide(across, r[:, None], out=np.zeros_like(across), where=r[:, None] > 0)
    return r, out


@dataclass(frozen=True, kw_only=True)
class Reach:
    """Deviations that are allowed, as in `Found`."""

    p: float
    u: float
    scatter: float
    stress: float


# Quadratic cells of 5, 2.5, 1.25 mm in 3D: p is off by 2.3e-3, 6.8e-4, 1.8e-4, u by 2.2e-3, 6.8e-4, 2.3e-4, pressures
# by 2e-2, 1e-2, 5e-3, stresses by 5e-3, 1.7e-3, 6e-4. A quarter of that in the axisymmetric section: p by 1.3e-7.
# Linear ones of 2.5 mm: p by 6.5e-3, pressures by 6 %, stresses by 7 %. A shaft of 20.01 mm is another one by 5e-4.
SOLID = Reach(p=1e-3, u=1e-3, scatter=0.015, stress=2.5e-3)
SECTION = Reach(p=5e-7, u=1e-5, scatter=5e-4, stress=5e-4)
SECTION_DRAWN = Reach(p=5e-7, u=1e-4, scatter=5e-4, stress=1e-3)
LINEAR = Reach(p=0.01, u=0.01, scatter=0.1, stress=0.1)


def figures(fit: Fit, reach: Reach) -> list[Check]:
    """All steps."""
    checks = list[Check]()
    cold = pressure(SHAFT, HUB, INTERFERENCE)
    for found in solve(fit):
        name = f"{fit}, t = {found.time:g}" if fit.heated else str(fit)
        checks += [
            close(f"{name}: mean p [Pa]", found.p, found.exact, reach.p * cold / (found.exact or cold), cold),
            Check(f"{name}: pressures at nodes, over p", found.scatter, 0.0, reach.scatter, relative=False),
            Check(f"{name}: radial displacement, over the interference", found.u, 0.0, reach.u, relative=False),
            Check(f"{name}: radial and hoop stress, over p", found.stress, 0.0, reach.stress, relative=False),
        ]
        if not fit.heated:
            work = -cold * INTERFERENCE / 2 * 2 * np.pi * HUB.bore * THICK
            checks.append(close(f"{name}: work of contact [J]", found.work, work, reach.p, 1.0))
    return checks


@problem("a shaft pressed into a hub, from a STEP file, Lamé's closed form", slow=METHODS)
def checks(method: str) -> list[Check]:
    """Pressed in cold: a quarter of both and their section, by gap_offset and drawn too large."""
    found = figures(Fit(method=method), SOLID)
    found += figures(Fit(model="axisymmetric", method=method), SECTION)
    if method == "condensed-newton":
        found += (
            figures(Fit(drawn=True), SOLID) + figures(Fit(gap="of the meshes"), SOLID) + figures(Fit(order=1), LINEAR)
        )
        found += figures(Fit(model="axisymmetric", drawn=True), SECTION_DRAWN)
    return found


@problem("a hub from a STEP file shrinks onto its shaft, Lamé", methods=TWO, slow=TWO)
def heated_hub(method: str) -> list[Check]:
    """The hub is put on hot, without touching, and cools: first it grips, then it presses as if pressed on cold."""
    found = figures(Fit(heated=True, method=method), SOLID)
    return found + figures(Fit(model="axisymmetric", heated=True, method=method), SECTION)
