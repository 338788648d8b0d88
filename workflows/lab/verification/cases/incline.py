"""The layer on an incline: periodic sides, gravity, held by friction alone.

A displacement that varies with the height only is exact at the nodes, on any mesh of rectangles.

Layer on an incline: a slab of height H under its own weight, infinite along a slope of tan(alpha).

Nothing varies along the slope, so that sigma_nn and sigma_tn balance the weight above each height y:
sigma_nn = -rho g cos(alpha) (H - y), sigma_tn = rho g sin(alpha) (H - y). The base rests, so that at the top
u_n = -rho g cos(alpha) H^2 / (2 M), u_t = rho g sin(alpha) H^2 / (2 G). It rests if tan(alpha) <= mu, and only then.

Source: equilibrium, derived here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip import STICK, Block, Contact, Coulomb, Gravity, Material, Periodic, Plane, Scene, SolverError, StepResult
from stickslip.workflows.lab.verification.cases.column import constrained_modulus
from stickslip.workflows.lab.verification.check import FLOATING, Check, farthest, problem
from stickslip.workflows.lab.verification.prepared import observed, solver, system_of


@dataclass(frozen=True, kw_only=True)
class Layer:
    """The slab and its slope."""

    E: float  # [Pa]
    nu: float
    weight: float  # rho g [N/m³]
    slope: float  # tan(alpha)
    height: float = 1.0  # [m]

    @property
    def along(self) -> float:
        """rho g sin(alpha) [N/m³]."""
        return float(self.weight * self.slope / np.hypot(1.0, self.slope))

    @property
    def across(self) -> float:
        """rho g cos(alpha) [N/m³]."""
        return float(self.weight / np.hypot(1.0, self.slope))

    @property
    def pressure(self) -> float:
        """p on the base [Pa]."""
        return self.across * self.height

    @property
    def shear(self) -> float:
        """tau on the base [Pa]."""
        return self.along * self.height

    @property
    def top(self) -> tuple[float, float]:
        """u_t down the slope, u_n out of it [m]."""
        G, half = self.E / (2 * (1 + self.nu)), self.height**2 / 2
        return self.along * half / G, -self.across * half / constrained_modulus(self.E, self.nu)


LAYER = Layer(E=10.0, nu=0.2, weight=2.0, slope=0.3)
PRESSURE, SHEAR, TOP = 1.9156526, 0.5746958, (6.8963e-2, -8.6204e-2)  # of LAYER, tabulated
HOLDS, SLIDES = 0.3003, 0.2997  # friction coefficients on either side of its slope


G = 9.81  # any value: only the weight of the layer matters [m/s²]
CELLS = 4  # a side
TOLERANCE = 1e-9  # the solver's 1e-12, the condition of the mesh, about 100, and a digit to spare


def scene(method: str, mu: float) -> Scene:
    """A metre of the layer; x runs down the slope."""
    return Scene(
        model="plane strain",
        geometry=Block(length=1.0, height=LAYER.height, mesh_size=1 / CELLS, cells="tensor"),
        bodies={"block": Material(E=LAYER.E, nu=LAYER.nu, density=LAYER.weight / G)},
        obstacles={"slope": Plane(point=(0.0, 0.0), normal=(0.0, 1.0))},
        contacts={"base": Contact(surface="block.bottom", against="slope", friction=Coulomb(mu=mu))},
        sections={
            "periodic": {"sides": Periodic(boundary="block.right", with_="block.left")},
            "gravity": Gravity(acceleration=(G * LAYER.along / LAYER.weight, -G * LAYER.across / LAYER.weight)),
        },
        solver=solver(method, 1e-12),
    )


def resting(step: StepResult, name: str, tolerance: float = TOLERANCE) -> list[Check]:
    """Checks at the worst nodes of base and top."""
    base, (u_t, u_n) = step.contacts["base"], LAYER.top
    top = step.displacement[np.argsort(step.displacement[:, 1])[: CELLS + 1]]  # the lowest settlement is the top's
    return [
        Check(f"{name}: p [Pa]", farthest(base.pressure, LAYER.pressure), LAYER.pressure, tolerance, relative=True),
        Check(f"{name}: tau [Pa]", farthest(-base.traction[:, 0], LAYER.shear), LAYER.shear, tolerance, relative=True),
        Check(f"{name}: u_t at the top [m]", farthest(top[:, 0], u_t), u_t, tolerance, relative=True),
        Check(f"{name}: u_n at the top [m]", farthest(top[:, 1], u_n), u_n, tolerance, relative=True),
        Check(f"{name}: nodes that stick", np.sum(base.status == STICK), len(base.status), 0, relative=False),
    ]


def holds(method: str, mu: float = HOLDS) -> list[Check]:
    """The slope is a little less steep than friction can hold."""
    (step,) = observed(system_of(scene(method, mu)))
    return resting(step, f"mu = {mu}")


def slides(method: str, mu: float = SLIDES) -> list[Check]:
    """The slope is a little steeper: no step is solved, because every smaller load has the same ratio."""
    reached = 0
    try:
        for _ in observed(system_of(scene(method, mu))):
            reached += 1
    except SolverError:
        pass
    return [Check(f"mu = {mu}: times reached", reached, 0, 0, relative=False)]


@problem("layer that friction holds, and one that it cannot", methods=FLOATING)
def checks(method: str) -> list[Check]:
    """Both sides of the threshold, with a method that can solve bodies held by contact alone."""
    return holds(method) + slides(method)
