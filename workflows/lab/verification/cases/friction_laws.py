"""Laws of friction beyond Coulomb's, at the base of the sheared column: cohesion, tables, weakening, two coefficients.

A column that slips keeps its traction on the ellipse of the two coefficients: far behind its top at its support point
in the way of the slip, t_i = mu_i² V_i p / |mu V|; from rest, at the nearest point to the trial traction.

A point on a spring whose coefficient of friction depends on its slip so far: stick, weakening, jump, plateau.

The spring's end is moved by V, and drags the point at w under a pressure p: tau = k (V - w), |tau| <= mu(l) p, l the
length of the path of w. In a step the point slips until friction balances the spring for the first time. On a straight
piece of mu(l) the excess |tau| - mu(l) p is linear in the slip: it falls if p d mu/dl > -k, otherwise slip jumps to the
next piece.

Source: derived here; the condition of stability is that of Rice & Ruina, J. Appl. Mech. 50 (1983), without a rate.
"""

from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.laws.friction import Cohesion, OrthotropicCoulomb
from stickslip.solvers.laws.law import FrictionLaw
from stickslip.solvers.laws.pressure_dependent import PressureDependent
from stickslip.solvers.laws.slip_dependent import SlipDependent, StaticKinetic
from stickslip.workflows.lab.verification.cases import sheared_column
from stickslip.workflows.lab.verification.cases.sheared_column import K_T, PRESSURE, E, bases, compare, scene, solve
from stickslip.workflows.lab.verification.check import Check, close, farthest, problem


def drag(table: tuple[tuple[float, float], ...], p: float, k: float, ends: Array) -> tuple[Array, Array]:
    """Traction tau [Pa] and length of slip [m] after each step (steps,), from rest.

    Args:
        table: mu [-] by length of slip [m], linear between its lines and constant beyond them.
        p: pressure [Pa].
        k: stiffness of the spring [Pa/m].
        ends: V after each step (steps,) [m], monotone between them.

    >>> tau, length = drag(((0.0, 0.3), (1.0, 0.2)), 10.0, 2.0, np.array([1.0, 2.0, 5.0]))
    >>> tau.round(9), length.round(9)
    (array([2., 2., 2.]), array([0., 1., 4.]))
    """
    at, mu = np.array(table).T
    tau, lengths, w, length = np.zeros(len(ends)), np.zeros(len(ends)), 0.0, 0.0
    for i, V in enumerate(ends):
        way = np.sign(V - w)
        corners = [length, *at[at > length]]
        excess = [k * (abs(V - w) - (x - length)) - p * float(np.interp(x, at, mu)) for x in corners]
        slip = 0.0
        if excess[0] > 0:
            j = next((j for j, e in enumerate(excess) if e <= 0), len(corners))
            if j == len(corners):  # beyond the last line mu stays what it is
                slip = corners[-1] - length + excess[-1] / k
            else:
                part = excess[j - 1] / (excess[j - 1] - excess[j])
                slip = corners[j - 1] - length + part * (corners[j] - corners[j - 1])
        w, length = w + way * slip, length + slip
        tau[i], lengths[i] = k * (V - w), length
    return tau, lengths


G = sheared_column.COLUMN.G  # the column is 1 m high: the stiffness of its base against slip [Pa/m]
TOP = np.array([0.001, 0.0035, 0.01, 0.005, -0.01, 0.01])  # [m]: stick, little slip, much, unloading, back, forth
BOUNDED: tuple[tuple[FrictionLaw, float], ...] = (  # laws whose bound is a number [Pa] at the column's pressure
    (Cohesion(a=1.2, mu=0.1), 2.2),
    (Cohesion(a=0.7, mu=0.0, k_T=K_T), 0.7),
    (PressureDependent(mu=((0.0, 0.4), (20.0, 0.24))), 3.2),
    (PressureDependent(mu=((1.0, 0.1), (5.0, 0.25)), k_T=K_T), 2.5),
)
SOFT = StaticKinetic(mu_s=0.3, mu_k=0.2, slip_length=3e-3)  # falls by 333 Pa/m at 10 Pa: a third of G
BRITTLE = StaticKinetic(mu_s=0.3, mu_k=0.2, slip_length=5e-4)  # twice G
HARDENING = SlipDependent(mu=((0.0, 0.1), (2e-3, 0.3), (8e-3, 0.25)))
WEAKENING: tuple[StaticKinetic | SlipDependent, ...] = (
    SOFT, BRITTLE, HARDENING, replace(SOFT, k_T=2 * G), replace(BRITTLE, k_T=2 * G)
)  # fmt: skip
MU, AXIS = np.array([0.3, 0.12]), np.array([0.8, 0.6])
TWO = OrthotropicCoulomb(mu_1=0.3, mu_2=0.12, axis=(1.6, 1.2, 0.7))  # the part along the normal is of no account
FAR = 1e2  # slip in each step of the column in 3D [m]


def bounded(method: str, law: FrictionLaw, bound: float) -> list[Check]:
    """A law as Tresca's: its bound depends on the pressure, which is uniform."""
    states = bases(scene(dim=2, method=method, E=E, friction=law, path=sheared_column.TOP[:, None]))
    exact = replace(sheared_column.COLUMN, bound=bound, k_T=law.k_T or np.inf)
    return compare(f"{type(law).__name__}, k_T = {law.k_T}", states, PRESSURE, exact, sheared_column.TOP)


def weakened(method: str, law: StaticKinetic | SlipDependent) -> list[Check]:
    """Static friction that falls to kinetic with the length of slip."""
    steps = solve(scene(dim=2, method=method, E=E, friction=law, path=TOP[:, None]))[1:]
    tau, length = drag(law.table, PRESSURE, G * (2 / 3 if law.k_T else 1.0), TOP)
    steepest = f"{type(law).__name__}, mu falls by {law.weakening:.3g} /m, k_T = {law.k_T}"
    found = list[Check]()
    for k, step in enumerate(steps):
        at, base = f"{steepest}, move {k + 1}", step.contacts["base"]
        stress, slid = farthest(-base.traction[:, 0], tau[k]), farthest(step.memory["base"], length[k])
        found += [
            close(f"{at}: tau [Pa]", stress, tau[k], 1e-9, abs(tau).max()),
            close(f"{at}: length of slip [m]", slid, length[k], 1e-9, length.max()),
        ]
    return found


def dragged(method: str) -> list[Check]:
    """Two coefficients: the forces that make the column slip far, in four ways, are an ellipse."""
    frame = np.array([AXIS, [-AXIS[1], AXIS[0]]])
    angles = np.radians([0.0, 40.0, 80.0, 120.0])
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    path = np.cumsum(FAR * np.arange(1, 5)[:, None] * ways, axis=0)
    states, found = bases(scene(dim=3, method=method, E=E, friction=TWO, path=path))[1:], list[Check]()
    for angle, base, way in zip(np.degrees(angles), states, ways, strict=True):
        v, t = frame @ way, -base.traction[:, :2] @ frame.T
        exact, name = MU**2 * v * PRESSURE / np.linalg.norm(MU * v), f"two coefficients, dragged at {angle:.0f}°"
        found += [
            close(f"{name}: t_1 [Pa]", farthest(t[:, 0], exact[0]), exact[0], 1e-3, PRESSURE),
            close(f"{name}: t_2 [Pa]", farthest(t[:, 1], exact[1]), exact[1], 1e-3, PRESSURE),
            close(f"{name}: |t / (mu p)| [-]", farthest(np.linalg.norm(t / (MU * PRESSURE), axis=1), 1), 1, 1e-6, 1.0),
        ]
    return found


def nearest(method: str) -> list[Check]:
    """From rest the trial traction G V is projected onto the ellipse: by its normal there."""
    mu, V = np.array([0.3, 0.15]), np.array([0.006, 0.004])
    law = OrthotropicCoulomb(mu_1=0.3, mu_2=0.15, axis=(1.0, 0.0, 0.0))
    _, base = bases(scene(dim=3, method=method, E=E, friction=law, path=V[None]))
    t, name = -base.traction[0, :2], "two coefficients, from rest"
    left, normal = G * V - t, t / mu**2
    return [
        close(f"{name}: |t / (mu p)| [-]", float(np.linalg.norm(t / (mu * PRESSURE))), 1.0, 1e-6, 1.0),
        close(f"{name}: slip by normal, 1 over 2 [-]", left[0] / left[1], normal[0] / normal[1], 1e-6, 1.0),
        close(f"{name}: bound [Pa]", float(base.bound[0]), float(np.linalg.norm(t)), 1e-6, PRESSURE),
    ]


@problem("cohesion, tables of mu, static and kinetic, two coefficients", slow=("surface-uzawa",))
def checks(method: str) -> list[Check]:
    """All of them."""
    found = [check for law, bound in BOUNDED for check in bounded(method, law, bound)]
    found += [check for law in WEAKENING for check in weakened(method, law)]
    return found + dragged(method) + nearest(method)
