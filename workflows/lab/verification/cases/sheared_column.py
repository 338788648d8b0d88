"""The sheared column: periodic lateral faces; pressed first, then its top driven back and forth.

The state is uniform, so any mesh is exact, and a step of any size is.

Sheared column on a frictional base: stick, slip, reversal, dissipation.

A column of shear modulus G and height H with periodic lateral faces is in uniform shear: tau = G (V - w) / H, V the
displacement of its top and w that of its base [m]. The base carries |tau| <= s, and slips along tau where
|tau| = s. So the exact answer to a step of V is to clip the trial traction, and w follows from the shear.
A base of tangential stiffness k_T moves by tau / k_T before it slips: a spring in series, w = slip + tau / k_T.

Signs: tau [Pa] is t of the friction law, t dv = s |dv|: it has the sign of the slip v it makes.

Source: derived here. In one dimension the return map is exact along any monotone step, so a step may be of any size.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stickslip import Block, Contact, Coulomb, Material, Periodic, Plane, Scene, Steps, Support, Tresca
from stickslip.geometry.arrays import Array
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw
from stickslip.solvers.laws.normal import Compliance, Unilateral
from stickslip.solvers.laws.tangential_compliance import TangentialCompliance
from stickslip.solvers.results.step_result import ContactState, StepResult
from stickslip.workflows.lab.verification.cases import column
from stickslip.workflows.lab.verification.check import CYCLES, Check, accounted, close, farthest, problem, repeats
from stickslip.workflows.lab.verification.prepared import prepare, solver


@dataclass(frozen=True, kw_only=True)
class ShearedColumn:
    """A column of shear modulus G and height H on a base of friction bound s (mu p, or Tresca's)."""

    G: float  # [Pa]
    bound: float  # s [Pa]
    height: float = 1.0  # [m]
    k_T: float = np.inf  # stiffness of the base before slip [Pa/m]

    @property
    def stiffness(self) -> float:
        """tau over V while the base sticks [Pa/m].

        >>> ShearedColumn(G=1000.0, bound=3.0, k_T=1000.0).stiffness
        500.0
        """
        return self.G / (self.height + self.G / self.k_T)


@dataclass(frozen=True, kw_only=True)
class ShearHistory:
    """The states after each step, (steps,) each."""

    tau: Array  # tangential traction on the base [Pa]
    slip: Array  # displacement of the base, elastic part included [m]
    dissipation: Array  # cumulative, per area of the base [J/m²]


def follow(stiffness: float, bounds: Array, path: Array) -> tuple[Array, Array, Array]:
    """Traction and slip (steps, k), and work so far (steps,), of a base whose top follows a path, from rest.

    Args:
        stiffness: of the column [Pa/m].
        bounds: friction bound at the end of each step (steps,) [Pa].
        path: V at the end of each step (steps, k) [m].
    """
    tau, slip, work, w = np.zeros_like(path), np.zeros_like(path), np.zeros(len(path)), np.zeros(path.shape[1])
    for k, (V, bound) in enumerate(zip(path, bounds, strict=True)):
        trial = stiffness * (V - w)
        size = float(np.linalg.norm(trial))
        tau[k] = trial if size <= bound else trial * (bound / size)
        step = (trial - tau[k]) / stiffness  # exactly 0 where it sticks
        w = slip[k] = w + step
        work[k] = work[k - 1] + tau[k] @ step
    return tau, slip, work


def drive(column: ShearedColumn, top: Array) -> ShearHistory:
    """Drive the top through a sequence of displacements, from an undeformed start.

    Args:
        column: what is sheared.
        top: V at the end of each step (steps,) [m]; V is monotone between them.

    >>> history = drive(ShearedColumn(G=1000.0, bound=3.0), np.array([0.001, 0.01]))
    >>> history.tau
    array([1., 3.])
    """
    tau, slip, work = follow(column.stiffness, np.full(len(top), column.bound), top[:, None])
    return ShearHistory(tau=tau[:, 0], slip=slip[:, 0] + tau[:, 0] / column.k_T, dissipation=work)


COLUMN = ShearedColumn(G=1000.0, bound=3.0)  # p = 10 Pa, mu = 0.3
TOP = np.array([0.001, 0.01, 0.005, -0.01, 0.01])  # [m]: stick, slip, unloading, slip back, slip again
TABLE = ShearHistory(
    tau=np.array([1.0, 3.0, -2.0, -3.0, 3.0]),
    slip=np.array([0.0, 0.007, 0.007, -0.007, 0.007]),
    dissipation=np.array([0.0, 0.021, 0.021, 0.063, 0.105]),
)


E, NU = 2600.0, 0.3  # G = 1000 Pa
PRESSURE = 10.0  # [Pa]
M = column.constrained_modulus(E, NU)
MU = 0.3
K_T = 500.0  # [Pa/m], half of G: the base gives twice as much as the column
RIGID, SOFT = Unilateral(), Compliance(c_n=1e6, m_n=2.0)
BY_PENETRATION = (
    (1e3, 1.0, None),
    (1e6, 2.0, K_T),
    (1e7, 2.5, None),
)  # c_T [Pa/m^m_T], m_T, k_T; bounds of 1.5 to 3.5 Pa
TOLERANCE = 1e-9  # the solver's 1e-12, summed over six steps, and two digits to spare


def scene(
    *, dim: int, method: str, E: float, friction: FrictionLaw | None, path: Array, normal: NormalLaw = RIGID
) -> Scene:
    """Column of side 1 m, pressed at t = 1, its top at path[k] (steps, dim - 1) [m] at t = k + 2."""
    opposite = {"right": "left"} | ({"back": "front"} if dim == 3 else {})
    periodic = {slave: Periodic(boundary=f"block.{slave}", with_=f"block.{m}") for slave, m in opposite.items()}
    up, across = "xyz"[dim - 1], (0.0,) * (dim - 1)
    times = [float(k + 2) for k in range(len(path))]
    moves = zip("xy"[: dim - 1], path.T.tolist(), strict=True)
    top = {axis: ((1.0, 0.0), *zip(times, values, strict=True)) for axis, values in moves}
    top[up] = ((1.0, -PRESSURE / column.constrained_modulus(E, NU)),)
    return Scene(
        model="3d" if dim == 3 else "plane strain",
        geometry=Block(length=1.0, width=1.0 if dim == 3 else None, height=1.0, mesh_size=0.5, cells="tensor"),
        bodies={"block": Material(E=E, nu=NU)},
        obstacles={"floor": Plane(point=(*across, 0.0), normal=(*across, 1.0))},
        contacts={"base": Contact(surface="block.bottom", against="floor", normal=normal, friction=friction)},
        supports={"top": Support(boundary="block.top", displacement=top)},  # type: ignore[arg-type]
        sections={"periodic": periodic},
        steps=Steps(end=times[-1], count=len(path) + 1),
        solver=solver(method, 1e-12),
    )


def solve(scene: Scene) -> list[StepResult]:
    """The pressing and each move; t = 0 is reported too where a table has a value there."""
    return [step for step in prepare(scene).steps() if step.time > 0]


def bases(scene: Scene) -> list[ContactState]:
    """The base after each of them."""
    return [step.contacts["base"] for step in solve(scene)]


def laws(mu: float = MU) -> dict[str, FrictionLaw]:
    """Laws with the bound mu p; Tresca's needs a table, a bare number would be ramped over the history."""
    given = ((0.0, mu * PRESSURE),)
    return {
        "Coulomb": Coulomb(mu=mu),
        "Tresca": Tresca(bound=given),
        "Coulomb, k_T": Coulomb(mu=mu, k_T=K_T),
        "Tresca, k_T": Tresca(bound=given, k_T=K_T),
    }


def driven(method: str, name: str, friction: FrictionLaw, top: Array = TOP) -> list[Check]:
    """Pressed by 10 Pa on a rigid floor, whose bound is 3 Pa."""
    states = bases(scene(dim=2, method=method, E=E, friction=friction, path=top[:, None]))
    return compare(name, states, PRESSURE, _softened(friction), top)


def penetrating(method: str, c_T: float, m_T: float, k_T: float | None = None) -> list[Check]:
    """On a compliant foundation with penetration delta, whose friction bound is c_T delta^m_T."""
    friction = TangentialCompliance(c_T=c_T, m_T=m_T, k_T=k_T)
    exact = column.driven_by_displacement(M=M, U=PRESSURE / M, g=0.0, c_n=SOFT.c_n, m=SOFT.m_n)
    sheared = replace(_softened(friction), bound=c_T * exact.penetration**m_T)
    top = TOP
    states = bases(scene(dim=2, method=method, E=E, friction=friction, path=top[:, None], normal=SOFT))
    return compare(f"bound by penetration, m_T = {m_T:g}, k_T = {k_T}", states, exact.pressure, sheared, top)


def threshold(method: str, c_T: float, m_T: float) -> list[Check]:
    """The base sticks a millionth below the bound and slips a millionth above it."""
    depth = column.driven_by_displacement(M=M, U=PRESSURE / M, g=0.0, c_n=SOFT.c_n, m=SOFT.m_n).penetration
    limit = c_T * depth**m_T / COLUMN.G
    found = []
    for beyond in (-1e-6, 1e-6):
        path = np.array([[limit * (1 + beyond)]])
        friction = TangentialCompliance(c_T=c_T, m_T=m_T)
        last = bases(scene(dim=2, method=method, E=E, friction=friction, path=path, normal=SOFT))[-1]
        name = f"bound by penetration, m_T = {m_T:g}, top at {beyond:+g} of the threshold"
        # the solver's 1e-12 of the pressure, over G: 1e-14 m, with two digits to spare
        slip = max(beyond, 0.0) * limit
        found.append(Check(f"{name}: slip [m]", farthest(last.slip[:, 0], slip), slip, 1e-12, relative=False))
    return found


def _softened(friction: FrictionLaw) -> ShearedColumn:
    return replace(COLUMN, k_T=friction.k_T or np.inf)


def compare(name: str, states: list[ContactState], pressure: float, sheared: ShearedColumn, top: Array) -> list[Check]:
    """Traction, slip and dissipation after each of the top's moves, at the worst node of the base."""
    pressed, *moved = states
    exact = drive(sheared, top)
    found = [close(f"{name}: pressure [Pa]", farthest(pressed.pressure, pressure), pressure, TOLERANCE, pressure)]
    scale = abs(top).max()
    for k, base in enumerate(moved):
        at = f"{name}, top at {1000 * top[k]:+g} mm (move {k + 1})"
        tau, slip, work = exact.tau[k], exact.slip[k], exact.dissipation[k]
        bound = sheared.bound
        found += [
            # sigma_T acts on the column and opposes the slip; tau is its negative
            close(f"{at}: tau [Pa]", farthest(-base.traction[:, 0], tau), tau, TOLERANCE, bound),
            close(f"{at}: force on the column [N]", base.force[0], -tau, TOLERANCE, bound),
            close(f"{at}: slip [m]", farthest(base.slip[:, 0], slip), slip, TOLERANCE, scale),
            close(f"{at}: dissipation so far [J]", base.dissipation_total, work, TOLERANCE, bound * scale),
        ]
    return found


def cycled(method: str, mu: float = MU, k_T: float | None = None, dim: int = 2) -> list[Check]:
    """Many reversals: cycles 2 to 5 are the same, and each dissipates 4 s (A - s H / G - s / k_T)."""
    amplitude = 0.01
    turn = np.array([amplitude, 0.0, -amplitude, 0.0])
    top, friction = np.tile(turn, CYCLES), Coulomb(mu=mu, k_T=k_T)
    along = np.array([[1.0]]) if dim == 2 else np.array([[0.6, 0.8]])  # in 3D along no edge of the mesh
    pressed, *moved = solve(scene(dim=dim, method=method, E=E, friction=friction, path=top[:, None] * along))
    totals = [pressed, *moved][:: len(turn)]
    losses = np.diff([step.contacts["base"].dissipation_total for step in totals])
    sheared = _softened(friction)
    loop = 4 * sheared.bound * (amplitude - sheared.bound / sheared.stiffness)
    name = f"{dim}D, k_T = {k_T}"
    areas = [close(f"{name}, cycle {k}: loop area [J]", losses[k - 1], loop, 1e-8, loop) for k in range(2, CYCLES + 1)]
    return areas + repeats(name, moved, len(turn)) + accounted(name, [pressed, *moved])


@problem("stick, slip, reversal, dissipation, closed form", slow=("surface-uzawa",))
def checks(method: str, mu: float = MU) -> list[Check]:
    """All of them; with another mu than 0.3 those of Coulomb and Tresca must fail."""
    found = [check for name, law in laws(mu).items() for check in driven(method, name, law)]
    found += cycled(method, mu) + cycled(method, mu, k_T=K_T) + cycled(method, mu, dim=3)
    for c_T, m_T, k_T in BY_PENETRATION:
        found += penetrating(method, c_T, m_T, k_T) + threshold(method, c_T, m_T)
    return found
