"""Soft contact, from which Newton's method starts: p = P_C(c (w - gap)), stiffer in stages.

Where friction alone keeps bodies from turning or sliding most active sets leave a motion free. Soft contact always
holds them. First it is far softer than a contact point, for bodies that travel much farther than they deform; in the
end, stiffer than that, it has nearly the right points closed, slipping the right way. With friction bounds frozen it
has an energy, whose least value along a Newton step is searched for: w is affine, so that this costs no volume solve.

Source: Simo & Laursen, Comput. & Structures 42 (1992), of contact that gives; Haslinger, Hlaváček & Nečas, Handbook of
Numerical Analysis IV (1996), of frozen bounds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import CLOSE, HALF_DIGITS, Array
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Iterate
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw
from stickslip.solvers.newton.active_set import linearise
from stickslip.solvers.newton.attempts import Attempts, Start, closed

STAGES = (0.03, 0.3, 3.0, 30.0)  # c times the flexibility of a point [-]
ENOUGH = 0.6  # change of tractions, relative to the largest, at which a stage ends
SHORT = 0.1  # share of a step below which bounds are frozen
SOLVES = 15  # of a stage, at most


@dataclass(frozen=True, kw_only=True)
class Frozen(FrictionLaw):
    """Friction whose bound is given by point."""

    s: Array  # (m_t,) [Pa]

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return self.s


def soft_starts(attempts: Attempts) -> Iterator[Start]:
    """Where soft contact leads; none where the flexibility of the rows is not known, or no motion is held."""
    give = attempts.problem.give
    if give is None or attempts.problem.p_ref == 0:
        return
    found = attempts.run(softened(attempts, give))
    if not attempts.over and np.isfinite(found.residual):
        problem = attempts.problem
        start = Start.at(problem, found.p, found.u_c, 1 / (give * problem.gamma))
        yield replace(start, in_equilibrium=False, near=True)


def softened(attempts: Attempts, give: Array) -> Iterator[Iterate]:
    """Iterates of soft contact, from all points closed and sticking, with positive gaps left out.

    Args:
        attempts: those so far, at a problem of the bodies.
        give: see `SurfaceProblem.give`.
    """
    problem, bodies, zero = attempts.problem, attempts.bodies, np.zeros_like(give)
    n, solves = problem.surface.normal_rows, attempts.last

    def solve(posed: SurfaceProblem, trial: Array, u: Array) -> Iterate:
        nonlocal solves
        solves += 1
        laws = linearise(posed, trial, stiffness).proximal(zero, 1.0, stiffness, HALF_DIGITS)
        p, u = bodies.solve(laws, zero, u)
        return Iterate(solves, np.inf, p, bodies.relative(p, u), u)

    stiffness, gap = STAGES[0] / give, problem.gap.copy()
    gap[:n] = np.minimum(gap, problem.relative_displacement(problem.u_before))[:n]
    try:
        x = solve(replace(problem, gap=gap), closed(problem), problem.u_before)
        yield (x := attempts.judged(x.number, x.p, x.w, x.u_c))
        x = solve(attempts.problem, x.p, x.u_c)
        yield (x := attempts.judged(x.number, x.p, x.w, x.u_c))
        for stage in STAGES:
            stiffness = stage / give
            for _ in range(SOLVES):
                problem = attempts.problem
                trial = stiffness * (x.w - problem.gap)
                change = x.p - problem.project(trial, stiffness)
                if np.abs(change).max(initial=0.0) < ENOUGH * np.abs(x.p).max(initial=0.0):
                    break
                tresca, to = frozen(problem, trial, stiffness), solve(problem, trial, x.u_c)
                share = least_energy(tresca, stiffness, x, to)
                if share < SHORT:
                    other = solve(tresca, trial, x.u_c)
                    share, to = max((share, to), (least_energy(tresca, stiffness, x, other), other), key=lambda a: a[0])
                share = share or 1.0
                p, w, u = (a + share * (b - a) for a, b in ((x.p, to.p), (x.w, to.w), (x.u_c, to.u_c)))
                yield (x := attempts.judged(solves, p, w, u))
    except np.linalg.LinAlgError:
        return


def frozen(problem: SurfaceProblem, trial: Array, stiffness: Array) -> SurfaceProblem:
    """The problem with the friction bounds of trial tractions (rows,) [Pa], given the stiffness (rows,) [Pa/m]."""
    cone, contacts = problem.cone, []
    p = problem.project(trial, stiffness)
    for place in cone.places:
        rows, law = place.rows, place.rows.friction
        if law is not None:
            rows = replace(rows, friction=Frozen(s=cone.bound(place, p[place.normal]), k_T=law.k_T))
        contacts.append(rows)
    return replace(problem, cone=AdmissibleSet(tuple(contacts), cone.time, cone.end))


def least_energy(problem: SurfaceProblem, stiffness: Array, x: Iterate, to: Iterate) -> float:
    """Share in [0, 1] of a step at which the energy of soft contact is least; 0: it does not fall.

    Args:
        problem: with given friction bounds.
        stiffness: of contact (rows,) [Pa/m].
        x, to: ends of the step.
    """
    surface, r, dr, dp = problem.surface, x.w - problem.gap, to.w - x.w, to.p - x.p
    moved = to.u_c - x.u_c
    db = surface.R.T @ moved if len(moved) == len(surface.R) else moved  # a model's unknowns are the rigid motions

    def slope(share: float) -> float:
        p = x.p + share * dp
        contact = surface.W * (problem.project(stiffness * (r + share * dr), stiffness) - p)
        return float(contact @ dr - (problem.load.resultant - surface.R.T @ surface.forces(p)) @ db)

    if not slope(0.0) < 0:
        return 0.0
    if slope(1.0) <= 0:
        return 1.0
    low, high = 0.0, 1.0
    while high - low > CLOSE + SHORT * high:
        middle = (low + high) / 2
        low, high = (middle, high) if slope(middle) < 0 else (low, middle)
    return (low + high) / 2
