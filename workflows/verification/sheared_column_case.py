"""The sheared column as a scene: periodic lateral faces, pressed first, then its top driven to and fro.

The state is uniform, so any mesh is exact, and a step of any size is.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from geometry.builders.block import Block
from geometry.obstacles.plane import Plane
from solvers.effects.friction import Coulomb, Tresca
from solvers.effects.laws import FrictionLaw
from solvers.effects.periodic import Periodic
from solvers.nouns.contact import Contact
from solvers.nouns.material import Material
from solvers.nouns.scene import Scene
from solvers.nouns.stepping import Solver, Steps
from solvers.nouns.support import Support
from solvers.simulation import prepare
from solvers.step_result import ContactState
from workflows.verification import sheared_column
from workflows.verification.check import Check, close, farthest
from workflows.verification.circular_drive import Array
from workflows.verification.column import constrained_modulus

E, NU = 2600.0, 0.3  # G = 1000 Pa
PRESSURE = 10.0  # [Pa]
MU = 0.3
TOLERANCE = 1e-9  # the solver's 1e-12, summed over six steps, and two digits to spare


def scene(*, dim: int, method: str, E: float, friction: FrictionLaw | None, path: Array) -> Scene:
    """Column of side 1 m, pressed at t = 1, its top at path[k] (steps, dim - 1) [m] at t = k + 2."""
    opposite = {"right": "left"} | ({"back": "front"} if dim == 3 else {})
    periodic = {slave: Periodic(boundary=f"block.{slave}", with_=f"block.{m}") for slave, m in opposite.items()}
    up, across = "xyz"[dim - 1], (0.0,) * (dim - 1)
    times = [float(k + 2) for k in range(len(path))]
    moves = zip("xy"[: dim - 1], path.T.tolist(), strict=True)
    top = {axis: ((1.0, 0.0), *zip(times, values, strict=True)) for axis, values in moves}
    top[up] = ((1.0, -PRESSURE / constrained_modulus(E, NU)),)
    return Scene(
        title="Column sheared on a frictional base",
        model="3d" if dim == 3 else "plane strain",
        geometry=Block(length=1.0, width=1.0 if dim == 3 else None, height=1.0, mesh_size=0.5, cells="tensor"),
        bodies={"block": Material(E=E, nu=NU)},
        obstacles={"floor": Plane(point=(*across, 0.0), normal=(*across, 1.0))},
        contacts={"base": Contact(surface="block.bottom", against="floor", friction=friction)},
        supports={"top": Support(boundary="block.top", displacement=top)},  # type: ignore[arg-type]
        sections={"periodic": periodic},
        steps=Steps(end=times[-1], count=len(path) + 1),
        solver=Solver(method=method, tolerance=1e-12),
    )


def bases(scene: Scene) -> list[ContactState]:
    """The base after each step, the pressing first; t = 0 is reported too where a table has a value there."""
    return [step.contacts["base"] for step in prepare(scene).steps() if step.time > 0]


def laws(mu: float = MU) -> dict[str, FrictionLaw]:
    """Two laws with the bound mu p; Tresca's needs a table, a bare number would be ramped over the history."""
    return {"Coulomb": Coulomb(mu=mu), "Tresca": Tresca(bound=((0.0, mu * PRESSURE),))}


def driven(method: str, name: str, friction: FrictionLaw, top: Array = sheared_column.TOP) -> list[Check]:
    """Traction, slip and dissipation after each of the top's moves, at the worst node of the base."""
    pressed, *moved = bases(scene(dim=2, method=method, E=E, friction=friction, path=top[:, None]))
    exact = sheared_column.drive(sheared_column.COLUMN, top)
    found = [close(f"{name}: pressure [Pa]", farthest(pressed.pressure, PRESSURE), PRESSURE, TOLERANCE, PRESSURE)]
    scale = abs(top).max()
    for k, base in enumerate(moved):
        at = f"{name}, top at {1000 * top[k]:+g} mm (move {k + 1})"
        tau, slip, work = exact.tau[k], exact.slip[k], exact.dissipation[k]
        bound = sheared_column.COLUMN.bound
        found += [
            # sigma_T acts on the column and opposes the slip; tau is its negative
            close(f"{at}: tau [Pa]", farthest(-base.traction[:, 0], tau), tau, TOLERANCE, bound),
            close(f"{at}: force on the column [N]", base.force[0], -tau, TOLERANCE, bound),
            close(f"{at}: slip [m]", farthest(base.slip[:, 0], slip), slip, TOLERANCE, scale),
            close(f"{at}: dissipation so far [J]", base.dissipation_total, work, TOLERANCE, bound * scale),
        ]
    return found


def cycled(method: str, mu: float = MU, cycles: int = 5) -> list[Check]:
    """Many reversals: cycles 2 to 5 dissipate 4 s (A - s H / G), each the same."""
    amplitude = 0.01
    top = np.tile([amplitude, -amplitude], cycles)
    states = bases(scene(dim=2, method=method, E=E, friction=Coulomb(mu=mu), path=top[:, None]))[1:]
    totals = [state.dissipation_total for state in states[1::2]]
    column = sheared_column.COLUMN
    loop = 4 * column.bound * (amplitude - column.bound * column.height / column.G)
    return [
        close(f"cycle {k + 2}: loop area [J]", after - before, loop, 1e-8, loop)
        for k, (before, after) in enumerate(pairwise(totals))
    ]


def checks(method: str, mu: float = MU) -> list[Check]:
    """All of them; with another mu than 0.3 they must fail."""
    return [check for name, law in laws(mu).items() for check in driven(method, name, law)] + cycled(method, mu)
