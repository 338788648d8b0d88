"""A problem with simpler laws, piecewise linear, solved whole: its solution leads to that of the problem itself.

Powers p = c d^m are replaced by their tangents at the last pressures, p = k (d - d_0)_+, and friction bounds by
Coulomb's law through the bounds at these pressures, with a coefficient for each point. A path then leads to the
solution where Newton's method fails, see `path`. Tangents and coefficients are taken anew at its pressures. With
Coulomb's friction that is Newton's method for generalised equations, in which opening, stick and slip stay exact.

Source: Josephy, Newton's method for generalized equations, Technical Summary Report 1965, Univ. of Wisconsin (1979).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.laws.coulomb_by_point import CoulombByPoint
from stickslip.solvers.laws.law import NormalLaw
from stickslip.solvers.newton.solution import Solution, Status
from stickslip.solvers.newton.starts import Start

MOST = 30  # tangents
FLOOR = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-9)  # of the largest pressure: tangents at less would hold nothing
NEAR = 1e-4  # residual from which plain Newton takes over

Solve = Callable[[SurfaceProblem, Array], Solution]


@dataclass(frozen=True, kw_only=True)
class Tangent(NormalLaw):
    """p = k (u_n - g)_+, each point with a stiffness of its own."""

    at_quadrature: ClassVar[bool] = True
    power: ClassVar[float] = 1.0
    k: Array  # (m,) [Pa/m]

    def resolvent(self, p_hat: Array, gamma: Array) -> Array:
        return np.asarray(np.maximum(p_hat, 0.0) * (self.k / (self.k + gamma)))

    def stiffness(self, p: Array, p_hat: Array) -> Array:
        return np.where(p_hat > 0, self.k, 0.0)

    def penetration(self, p: Array) -> Array:
        return np.asarray(np.maximum(p, 0.0) / self.k)


def applies(problem: SurfaceProblem) -> bool:
    """Whether there are simpler laws: pressures or friction bounds are not proportional, and no bound jumps."""
    jump = any(place.rows.friction is not None and place.rows.friction.continuous for place in problem.cone.places)
    return not problem.cone.homogeneous and not jump


def ends(problem: SurfaceProblem, p: Array, solve: Solve) -> Iterator[Start]:
    """Solutions with simpler laws that are near to the one that is sought.

    Args:
        problem: the contact problem of the step.
        p: tractions (rows,) [Pa] of the first tangents.
        solve: solves a problem with simpler laws, from tractions (rows,) [Pa].
    """
    if not applies(problem):
        return
    for k in range(MOST):
        found = solve(simplified(problem, p, FLOOR[min(k, len(FLOOR) - 1)]), p)
        if found.status is not Status.CONVERGED:
            return
        p, w = found.p, problem.relative_displacement(found.u_c)
        if max(problem.natural_residual(p, w), problem.imbalance(p)) < NEAR:
            yield Start.at(problem, p, found.u_c)


def resting(problem: SurfaceProblem, p: Array, solve: Solve) -> Iterator[Start]:
    """Where bodies that nothing pushes come to rest: if nothing presses there, linear laws lead to the same place.

    With a power of the penetration Newton's method would halve it without end. If they are squeezed all the same, by
    obstacles or loads that balance each other, it is a start like any other.

    Args:
        problem: the contact problem of the step.
        p: tractions (rows,) [Pa] of the last step.
        solve: solves a problem with simpler laws, from tractions (rows,) [Pa].
    """
    curved = [place.rows.normal.at_quadrature and place.rows.normal.power != 1 for place in problem.cone.places]
    if not (problem.idle and any(curved)):
        return
    contacts = [
        replace(place.rows, normal=Tangent(k=problem.gamma[place.normal])) if law else place.rows
        for place, law in zip(problem.cone.places, curved, strict=True)
    ]
    cone = AdmissibleSet(tuple(contacts), problem.cone.time, problem.cone.end)
    found = solve(replace(problem, cone=cone), p)
    if found.status is Status.CONVERGED:
        yield Start.at(problem, found.p, found.u_c)


def simplified(problem: SurfaceProblem, p: Array, floor: float) -> SurfaceProblem:
    """The problem with simpler laws at tractions p (rows,) [Pa].

    Args:
        problem: the contact problem of the step.
        p: tractions (rows,) [Pa].
        floor: of the largest pressure; tangents and coefficients are taken at no less.
    """
    gap, contacts = problem.gap.copy(), list[ContactRows]()
    for place in problem.cone.places:
        n, rows, law = place.normal, place.rows, place.rows.normal
        at = np.maximum(p[n], floor * max(float(p[n].max(initial=0.0)), problem.p_ref * floor))
        if rows.friction is not None:
            mean = place.average @ at
            mu = problem.cone.bound(place, at) / np.where(mean > 0, mean, np.inf)
            rows = replace(rows, friction=CoulombByPoint(mu=mu, k_T=rows.friction.k_T))
        if law.at_quadrature:
            k = law.stiffness(at, at)
            gap[n] += law.penetration(at) - at / k
            rows = replace(rows, normal=Tangent(k=k))
        contacts.append(rows)
    cone = AdmissibleSet(tuple(contacts), problem.cone.time, problem.cone.end)
    return replace(problem, cone=cone, gap=gap)
