"""Laws and gaps a second time, from their closed formulas: the audit judges the solver's own by these.

A law or an obstacle of a file of one's own has no second formula: None is returned, the audit then takes the shared
one, and says so.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from stickslip.geometry.amplitude import Amplitude
from stickslip.geometry.arrays import EPS, TINY, Array
from stickslip.geometry.obstacles.cone import Cone
from stickslip.geometry.obstacles.obstacle import Obstacle
from stickslip.geometry.obstacles.plane import Plane
from stickslip.geometry.obstacles.round import Cylinder, Sphere
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.laws.friction import (
    CappedCoulomb,
    Cohesion,
    Coulomb,
    CoulombByPoint,
    OrthotropicCoulomb,
    Stick,
    Tresca,
)
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw
from stickslip.solvers.laws.mu_table import MuTable
from stickslip.solvers.laws.normal import Bilateral, Compliance, Tied, Unilateral
from stickslip.solvers.laws.pressure_dependent import PressureDependent
from stickslip.solvers.laws.rate_and_state import RateAndStateByPoint
from stickslip.solvers.laws.rate_dependent import RateDependent
from stickslip.solvers.laws.slip_dependent import SlipDependent, StaticKinetic
from stickslip.solvers.laws.tangential_compliance import TangentialCompliance
from stickslip.solvers.laws.wear import Slide, Turned, Wear
from stickslip.solvers.scene.loads import Direction
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.timeline import Place


def gap(obstacle: Obstacle, x: Array) -> Array | None:
    """Distance (m,) [m] of points (m, d) from an obstacle, positive where the body may be; None: no second formula.

    >>> gap(Cylinder(point=(0.0, 0.0), radius=1.0, inside=True), np.array([[0.3, 0.4]]))
    array([0.5])
    >>> gap(Plane(point=(0.0, 1.0), normal=(0.0, 2.0)), np.array([[7.0, 1.5]]))
    array([0.5])
    """
    if type(obstacle) is Plane:
        normal = np.array(obstacle.normal)
        return np.asarray((x @ normal - np.dot(obstacle.point, normal)) / np.hypot.reduce(normal))
    if type(obstacle) is Sphere:
        away = np.sqrt(((x - obstacle.center) ** 2).sum(axis=1)) - obstacle.radius
    elif type(obstacle) is Cylinder:
        arm = x - obstacle.point
        along = arm @ obstacle.axis / np.hypot.reduce(obstacle.axis) if obstacle.axis is not None else 0.0
        away = np.sqrt(np.maximum((arm**2).sum(axis=1) - along**2, 0.0)) - obstacle.radius
    elif type(obstacle) is Cone:
        arm, half = x - obstacle.apex, np.radians(obstacle.half_angle)
        depth = arm @ obstacle.axis / np.hypot.reduce(obstacle.axis)
        radius = np.sqrt(np.maximum((arm**2).sum(axis=1) - depth**2, 0.0))
        off = np.arctan2(radius, depth) - half  # angle from the nearest line of the surface
        length = np.hypot(radius, depth)
        away = np.where(off > np.pi / 2, length, length * np.sin(off))
    else:
        return None
    return np.asarray(-away if obstacle.inside else away)


def penetration(law: NormalLaw, p: Array) -> Array | None:
    """u_n - g (m,) [m] at pressures p (m,) [Pa] where the contact is closed; None: no second formula."""
    if type(law) is Compliance:
        return np.where(p > 0, np.exp((np.log(np.maximum(p, TINY)) - np.log(law.c_n)) / law.m_n), 0.0)
    return np.zeros_like(p) if type(law) in (Unilateral, Bilateral, Tied) else None


def pressure(law: NormalLaw, closing: Array) -> Array | None:
    """Pressure (m,) [Pa] at u_n - g (m,) [m] of a law that gives it; None: no second formula.

    >>> pressure(Compliance(c_n=4.0, m_n=2.0), np.array([-1.0, 0.5]))
    array([0., 1.])
    """
    if type(law) is not Compliance:
        return None
    return np.asarray(law.c_n * np.where(closing > 0, np.abs(closing), 0.0) ** law.m_n)


def stored_energy(law: NormalLaw, p: Array) -> Array | None:
    """Energy per area (m,) [J/m²] that a law stores at pressures p (m,) [Pa]; None: no second formula.

    >>> stored_energy(Compliance(c_n=4.0, m_n=1.0), np.array([2.0]))
    array([0.5])
    """
    depth = penetration(law, p)
    return depth * p / (1 + law.m_n) if depth is not None and type(law) is Compliance else depth


def bound(
    law: FrictionLaw, normal: NormalLaw, p: Array, average: Sparse | Array, time: float, end: float, memory: Array
) -> Array | None:
    """Friction bound s (m_t,) [Pa]; None: no second formula.

    Args:
        p: pressures (m_n,) [Pa].
        average: (m_t, m_n), from values at the points of pressure to means at those of friction.
        time: [s].
        end: last time of the scene [s].
        memory: of laws that remember slip (m_t,): length of slip so far [m], or slip rate [m/s].
    """
    if type(law) is Turned:  # of which the memory is the share that is left in the plane
        whole = bound(law.of, normal, p, average, time, end, memory)
        return None if whole is None else whole * memory
    mean = average @ p
    if type(law) is StaticKinetic:
        fallen = np.minimum(memory / law.slip_length, 1.0)
        return np.asarray((law.mu_s * (1 - fallen) + law.mu_k * fallen) * np.where(mean > 0, mean, 0.0))
    if isinstance(law, RateDependent | RateAndStateByPoint):
        return np.where(mean > 0, _by_rate(law, mean, memory), 0.0)
    if isinstance(law, SlipDependent | PressureDependent):
        by = memory if isinstance(law, SlipDependent) else mean
        return np.asarray(_in_table(law.mu, by) * np.where(mean > 0, mean, 0.0))
    if type(law) is OrthotropicCoulomb:  # of tractions along the law's own directions
        return max(law.mu_1, law.mu_2) * np.where(mean > 0, mean, 0.0)
    if isinstance(law, Coulomb | CoulombByPoint):
        return law.coefficient_now * np.where(mean > 0, mean, 0.0)
    if type(law) is CappedCoulomb:
        return np.minimum(law.mu * np.where(mean > 0, mean, 0.0), law.s_max)
    closed = (mean > 0) | (type(normal) in (Bilateral, Tied))
    part = average @ np.sign(p) if type(normal) is Compliance else closed.astype(float)  # that touches
    if type(law) is Cohesion:
        return np.asarray(law.a * part + law.mu * np.where(mean > 0, mean, 0.0))
    if type(law) is Tresca:
        return np.asarray(in_time(law.bound, time, end) * part)
    if type(law) is Stick:
        return np.where(closed, np.inf, 0.0)
    if type(law) is TangentialCompliance and type(normal) is Compliance:
        depth = (np.where(p > 0, p, 0.0) / normal.c_n) ** (1 / normal.m_n)
        return np.asarray(np.maximum(average @ (law.c_T * depth**law.m_T), 0.0))
    return None


def _by_rate(law: RateDependent | RateAndStateByPoint, mean: Array, memory: Array) -> Array:
    """Traction (m_t,) [Pa] at mean pressures (m_t,) [Pa] of points that touch; memory as in `bound`."""
    if isinstance(law, RateDependent):
        mu = law.coefficient(memory) if isinstance(law.mu, str) else _in_table(law.mu, memory)
        return np.asarray(mu * mean + law.damping * memory)
    (aged, V), of = memory.T, law.of
    with np.errstate(divide="ignore"):
        ln_z = np.log(V / of.V0 / 2) + of.f0 / law.a + law.b / law.a * aged
    z = np.exp(np.minimum(ln_z, -np.log(EPS)))  # beyond it asinh grows as ln z
    asinh = np.log1p(z + z * z / (1 + np.sqrt(1 + z * z))) + np.maximum(ln_z + np.log(EPS), 0.0)
    return np.asarray(law.a * asinh * mean + of.damping * V)


def remembered(law: FrictionLaw, before: Array, slip: Array, step: float) -> Array | None:
    """Memory (m_t,) after a substep of length [s] in which points slip by (m_t,) [m]; None: no second formula.

    Args:
        before: memory at its start.
    """
    if type(law) in (SlipDependent, StaticKinetic):
        return before + slip
    if type(law) is Turned and law.points is not None:
        beside = slid(law.slide, law.points, law.time, step, law.end)
        return np.where(beside > 0, slip / np.maximum(np.sqrt(slip**2 + beside**2), TINY), 1.0)
    if type(law) is RateAndStateByPoint and step:
        aged, V0 = before[:, 0], law.of.V0
        turned, decay = slip / step / V0, np.exp(-slip / law.Dc)  # V / V0, and what is left of the past
        steady = np.maximum(turned, TINY)
        if law.of.evolution == "aging":
            healed = -np.expm1(-slip / law.Dc) / steady
            healed = np.where(turned > TINY, healed, step * V0 / law.Dc)  # nothing but time has passed
            return np.column_stack([np.log(np.exp(aged) * decay + healed), slip / step])
        return np.column_stack([decay * aged + (decay - 1) * np.log(steady), slip / step])
    return slip * (1 / step) if type(law) is RateDependent and step else None


def slid(slide: Slide | None, points: Array, time: float, step: float, end: float) -> Array:
    """Sliding out of the plane (m,) [m] of points (m, d) [m] in a step of a length [s] that no time of its table parts.

    >>> slid(Slide(given=((0.0, 1.0), (2.0, 3.0)), speed=True), np.zeros((1, 2)), 2.0, 1.0, 2.0)
    array([2.5])
    """
    if slide is None:
        return np.zeros(len(points))
    given = slide.given
    if slide.speed and isinstance(given, float | int):
        given = ((0.0, given), (end, given))  # constant
    a, b = (in_time(given, t, end) for t in (time - step, time))
    far = abs(b - a)
    if slide.speed:  # of one that passes zero the triangles on both sides
        far = step * abs(a + b) / 2 if a * b >= 0 else step * (a * a + b * b) / (2 * far)
    return np.asarray(far * (points[:, 0] if slide.turns else np.ones(len(points))))


def worn_rate(wear: Wear, points: Array, time: float, end: float, p: Array, slid: Array) -> Array | float:
    """k of both sides [1/Pa] at points (m, d) [m]; expressions have no second formula.

    Args:
        p: pressures (m,) [Pa].
        slid: way so far (m,) [m].

    >>> worn_rate(Wear(k=((0.0, 1.0), (2.0, 3.0))), np.zeros((1, 2)), 1.0, 1.0, np.ones(1), np.zeros(1))
    array([2.])
    """
    if isinstance(wear.k, str):
        return wear.rate(points, time, end, None, None)
    if wear.table:
        return _in_table(wear.table, np.maximum(p, 0.0) if wear.by == "pressure" else slid)
    return float(np.sum(wear.k))


def prescribed(problem: Problem, support: str, axis: Direction, points: Array, time: float) -> Array:
    """Displacement (m,) [m] that a support prescribes at points (m, d) [m]; expressions have no second formula."""
    value = problem.supports[support].displacement[axis]
    if isinstance(value, str):
        return problem.timeline.values(Place("supports", support, "displacement", axis), points, time)
    return np.full(len(points), in_time(value, time, problem.timeline.end))


def _in_table(table: MuTable, at: Array) -> Array:
    """mu (m,) [-] at values (m,), straight between the lines of a table."""
    found = np.full(len(at), table[0][1])
    for (x_0, mu_0), (x_1, mu_1) in pairwise(table):
        part = np.clip((at - x_0) / (x_1 - x_0), 0.0, 1.0)
        found = found + part * (mu_1 - mu_0)
    return found


def in_time(amplitude: Amplitude, time: float, end: float) -> float:
    """Value at a time [s]: a number grows from zero at t = 0 to its value at the end, a table is read between lines.

    >>> in_time(4.0, 0.5, end=2.0), in_time(((1.0, -0.1), (3.0, 0.3)), 2.0, end=3.0)
    (1.0, 0.1)
    """
    table = [(end, amplitude)] if isinstance(amplitude, float | int) else list(amplitude)
    table = table if table[0][0] == 0 else [(0.0, 0.0), *table]
    for (t_0, a_0), (t_1, a_1) in pairwise(table):
        if t_0 <= time <= t_1:
            return float(a_0 + (a_1 - a_0) * (time - t_0) / (t_1 - t_0))
    return float(table[-1][1])
