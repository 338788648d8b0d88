"""Rings that spin, a quarter of each: a free ring in plane stress and strain, a cylinder, and a shrink fit.

Rings that spin: a free one in plane stress or strain, and a shrink fit that its speed loosens.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from stickslip import Block, Material, Ring, Scene, Simulation, Steps, Support
from stickslip.geometry.shape import Model
from stickslip.solvers.effects.body_forces import Centrifugal
from stickslip.workflows.lab.verification.cases import shrink_fit as still
from stickslip.workflows.lab.verification.cases.shrink_fit import (
    HUB,
    INNER,
    INTERFERENCE,
    JOINT,
    OUTER,
    SHAFT,
    Fit,
    RingMaterial,
    give,
)
from stickslip.workflows.lab.verification.check import TWO, Check, close, farthest, problem
from stickslip.workflows.lab.verification.prepared import prepare, solved, solver

DENSITIES = (2.0, 1.0)  # of the inner and the outer ring [kg/m³]


def growth(material: RingMaterial, pull: float, inner: float, outer: float, r: float, plane_strain: bool) -> float:
    """Radial displacement [m] at r of a free ring under centrifugal forces.

    Source: Timoshenko & Goodier, Theory of Elasticity, § 32, with E / (1 - nu^2) and nu / (1 - nu) for plane strain.

    Args:
        pull: density times speed squared [N/m^4].

    >>> growth(RingMaterial(E=1.0, nu=0.3), 1.0, 1.0 - 1e-9, 1.0, 1.0, plane_strain=False)  # a hoop: pull r^3 / E
    0.999999998...
    """
    E, nu = material.E, material.nu
    if plane_strain:
        E, nu = E / (1 - nu**2), nu / (1 - nu)
    both = (inner * outer / r) ** 2
    radial = (3 + nu) / 8 * pull * (inner**2 + outer**2 - both - r**2)
    hoop = (3 + nu) / 8 * pull * (inner**2 + outer**2 + both - (1 + 3 * nu) / (3 + nu) * r**2)
    return r / E * (hoop - nu * radial)


def fit(interference: float, speed: float) -> Fit:
    """State of the joint of the shrink fit's rings in plane strain, at a speed [rad/s] at which they still touch."""
    inner, outer = (rho * speed**2 for rho in DENSITIES)
    u_in, u_out = growth(SHAFT, inner, INNER, JOINT, JOINT, True), growth(HUB, outer, JOINT, OUTER, JOINT, True)
    give_in, give_out = give(SHAFT, JOINT, INNER), give(HUB, JOINT, OUTER)
    p = (interference - (u_out - u_in)) / (give_in + give_out)
    return Fit(p=p, u_in=u_in - p * give_in, u_out=u_out + p * give_out)


SPEED = 3.0  # [rad/s] of the ring and the cylinder
LOOSENING = 2.5  # [rad/s] of the fit, at which a fifth of the pressure is left
TOLERANCE = 2e-5  # order 2 on cells of 1/8 m: displacements are off by 4e-6, pressures of the loosened fit by 1e-5


def ring(model: Model) -> Scene:
    """From INNER to JOINT, or for the axisymmetric model a cylinder of radius INNER between lubricated walls."""
    axisymmetric = model == "axisymmetric"
    geometry = Block(length=INNER, height=0.25, mesh_size=0.125, cells="tensor", order=2)
    quarter = Ring(inner_radius=INNER, outer_radius=JOINT, angle=90, mesh_size=0.125, cells="tensor", order=2)
    body, sides = ("block", ("bottom", "top")) if axisymmetric else ("ring", ("x_axis", "y_axis"))
    return Scene(
        model=model,
        geometry=geometry if axisymmetric else quarter,
        bodies={body: Material(E=HUB.E, nu=HUB.nu, density=DENSITIES[0])},
        supports={side: Support(boundary=f"{body}.{side}", displacement={"normal": 0.0}) for side in sides},
        sections={"centrifugal": Centrifugal(speed=SPEED)},
    )


def radial(simulation: Simulation, displacement: Any, r: float) -> Any:
    """Radial displacement (k,) [m] of the nodes at a radius."""
    points, dim = simulation.data.points[:, : simulation.scene.dim], simulation.scene.dim
    if simulation.scene.axisymmetric:
        return displacement[np.abs(points[:, 0] - r) < 1e-9, 0]
    at = np.abs(np.linalg.norm(points, axis=1) - r) < 1e-9
    return np.einsum("kd,kd->k", displacement[at][:, :dim], points[at]) / r


def free() -> list[Check]:
    """Displacement of the surfaces, and energy."""
    found = list[Check]()
    for model in ("plane stress", "plane strain", "axisymmetric"):
        simulation, (step,) = solved(ring(model))
        solid = model == "axisymmetric"
        inner, outer = (0.0, INNER) if solid else (INNER, JOINT)
        for r in (outer,) if solid else (inner, outer):
            exact = growth(HUB, DENSITIES[0] * SPEED**2, inner, outer, r, model != "plane stress")
            u = farthest(radial(simulation, step.displacement, r), exact)
            found.append(Check(f"{model}, r = {r:g}: u [m]", u, exact, TOLERANCE, relative=True))
        energy = step.energy
        found.append(
            close(f"{model}: external - stored [J]", energy.external - energy.stored, 0.0, 1e-9, energy.stored)
        )
    return found


def loosened(method: str) -> list[Check]:
    """The fit at half and at full speed: its pressure falls with the square of the speed."""
    press = still.Press(cells=0.125, method=method)
    scene = still.scene(press)
    bodies = {
        name: replace(material, density=density)
        for (name, material), density in zip(scene.bodies.items(), DENSITIES, strict=True)
        if isinstance(material, Material)
    }
    scene = replace(
        scene,
        bodies=bodies,
        steps=Steps(count=2),
        sections={"centrifugal": Centrifugal(speed=LOOSENING)},
        solver=solver(method, 1e-10),
    )
    found = list[Check]()
    for step in prepare(scene).steps():
        exact, joint = fit(INTERFERENCE, LOOSENING * step.time), step.contacts["joint"]
        p = joint.normal_force / joint.weight.sum()
        found.append(Check(f"{press}, t = {step.time:g}: mean p [Pa]", p, exact.p, TOLERANCE, relative=True))
    return found


@problem("a ring, a cylinder and a shrink fit spin: closed form", methods=TWO)
def checks(method: str) -> list[Check]:
    """Free rings have no contact: one method is enough for them."""
    return loosened(method) + (free() if method == "condensed-newton" else [])
