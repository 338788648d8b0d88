"""The block of Raous, Chabrand and Lebon: linear triangles, 32 x 32 x 2."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.builders.cuboid import Block
from stickslip.geometry.obstacles.plane import Plane
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.laws.normal import Compliance, Unilateral
from stickslip.solvers.results.step_result import OPEN, SLIP, STICK, StepResult
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.scene.loads import Load, Support
from stickslip.solvers.scene.material import Material
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Steps
from stickslip.workflows.lab.verification.check import Check, within
from stickslip.workflows.lab.verification.closed_forms import raous
from stickslip.workflows.lab.verification.cycles import accounted
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.lab.verification.solver import solver

SLOW = ("surface-uzawa",)  # methods that take more than some seconds
N = 32
RAMPS = (1, 2, 5, 20)  # steps
CELL = raous.SIDE / N  # [m]


def scene(method: str, steps: int = 1, mu: float = raous.MU, n: int = N, k: float | None = None) -> Scene:
    """n x n x 2 triangles, the loads growing in proportion; compliant with c_n = k_T = k E / SIDE, or rigid contact."""
    stiffness = None if k is None else k * raous.E / raous.SIDE
    base = Contact(
        surface="block.bottom",
        against="floor",
        normal=Unilateral() if stiffness is None else Compliance(c_n=stiffness),
        friction=Coulomb(mu=mu, k_T=stiffness),
    )
    low, up, corner = (0.0, 0.0), (0.0, 1.0), (raous.SIDE, 0.0)
    return Scene(
        title="Block of Raous, Chabrand and Lebon",
        model="plane strain",
        geometry=Block(length=raous.SIDE, height=raous.SIDE, mesh_size=raous.SIDE / n),
        bodies={"block": Material(E=raous.E, nu=raous.NU)},
        obstacles={"floor": Plane(point=low, normal=up)},
        contacts={"base": base},
        supports={
            "wall": Support(boundary="block.right", displacement={"x": 0.0}),
            "corner": Support(point=corner, displacement={"y": 0.0}),
        },
        loads={
            "top": Load(boundary="block.top", pressure=raous.TOP_PRESSURE),
            "left": Load(boundary="block.left", pressure=raous.SIDE_PRESSURE),
        },
        steps=Steps(count=steps),
        solver=solver(method, 1e-11),
    )


@lru_cache
def march(method: str, steps: int = 1, mu: float = raous.MU, n: int = N) -> tuple[tuple[StepResult, ...], Array]:
    """All steps, and the abscissae of the nodes of the contact [m]."""
    simulation = prepare(scene(method, steps, mu, n))
    return tuple(simulation.steps()), simulation.data.surfaces["base"][0][:, 0]


def solve(method: str, steps: int = 1, mu: float = raous.MU, n: int = N) -> tuple[StepResult, Array]:
    """The last step."""
    done, x = march(method, steps, mu, n)
    return done[-1], x


def displacements(method: str, steps: int = 1, mu: float = raous.MU) -> list[Check]:
    """u_x at the five samples, all of them nodes, against the column of the same mesh."""
    last, x = solve(method, steps, mu)
    order = np.argsort(x)
    u_x = np.interp(raous.X, x[order], last.contacts["base"].slip[order, 0])
    # the other code's column is one of figures rounded to 4 digits, from another way of averaging the contact: 0.2 %
    return [
        Check(f"u_x at x = {1000 * at:g} mm [m]", float(found), float(reference), 2e-3, relative=True)
        for at, found, reference in zip(raous.X, u_x, raous.U_X_P1_32, strict=True)
    ]


def forces(method: str, mu: float = raous.MU) -> list[Check]:
    """Equilibrium of forces, and the friction force.

    How the corner shares F_n with its neighbour is a matter of the discretisation: with multipliers at nodes a node
    that a support holds carries none, its neighbour takes over, and CORNER_SHARE_P1_32 does not apply.
    """
    last, _ = solve(method, mu=mu)
    base, corner = last.contacts["base"], last.supports["corner"][0][1]
    return [
        # balance only: as exact as the solver
        Check("F_n, contact and corner [N/m]", base.normal_force + corner, raous.F_N, 1e-9, relative=True),
        # the mesh: 1.6, .41, .10 % too large at n = 16, 32, 64, which extrapolates to the converged figure
        Check("F_t [N/m]", base.tangential_force, raous.F_T, 6e-3, relative=True),
    ]


def zones(method: str, mu: float = raous.MU) -> list[Check]:
    """Open, slip and stick zones, to the resolution of cells of 1.25 mm."""
    last, x = solve(method, mu=mu)
    status = last.contacts["base"].status[np.argsort(x)]
    x = np.sort(x)
    slipping, sticking = x[status == SLIP], x[status == STICK]
    opened, ordered = x[status == OPEN], np.all(np.diff(status) >= 0)  # OPEN < SLIP < STICK
    return [
        Check("open, slip, stick come in this order (1: yes)", float(ordered), 1.0, 0.0, relative=False),
        # a limit lies between the last node of one state and the first of the next: a cell, and its half each way
        within("last open node [m]", opened.max(initial=0), raous.OPEN_UNTIL - 1.5 * CELL, raous.OPEN_UNTIL + CELL / 2),
        within("last slipping node [m]", slipping.max(initial=0), raous.SLIP_UNTIL - 2 * CELL, raous.SLIP_UNTIL + CELL),
        within("first sticking node [m]", sticking.min(initial=1), raous.SLIP_UNTIL - CELL, raous.SLIP_UNTIL + CELL),
    ]


def ramped(method: str, mu: float = raous.MU, counts: tuple[int, ...] = RAMPS, n: int = N) -> list[Check]:
    """A ramp of many steps dissipates (steps + 1) / steps of the limit, and its displacements do not depend on them."""
    found = []
    one, _ = solve(method, 1, mu, n)
    for steps in counts:
        last, name = solve(method, steps, mu, n)[0], f"{n} cells, {steps} steps"
        work, alone = last.contacts["base"].dissipation_total, one.contacts["base"].dissipation_total
        # the mesh: .8, .23, .06 % too small at 16, 32, 64 cells
        mesh = 5e-3 * (N / n) ** 2
        found.append(Check(f"{name}: dissipation [J/m]", work, raous.dissipation(steps), mesh, relative=True))
        found += accounted(name, march(method, steps, mu, n)[0])
        if steps > 1:
            ratio = work / alone if mu else 0.0
            # the law itself, free of the mesh: as exact as the solver
            found.append(Check(f"{name}: dissipation over that in one", ratio, (steps + 1) / steps / 2, 1e-7, True))
            apart = float(np.abs(last.displacement - one.displacement).max() / np.abs(one.displacement).max())
            found.append(Check(f"{name}: displacement less that in one, relative", apart, 0.0, 1e-8, relative=False))
    return found


def once(method: str, mu: float = raous.MU) -> list[Check]:
    """The checks of a single step; with another mu than 1 they must fail."""
    return displacements(method, mu=mu) + forces(method, mu) + zones(method, mu)


def checks(method: str) -> list[Check]:
    """All of them."""
    return once(method) + ramped(method)
