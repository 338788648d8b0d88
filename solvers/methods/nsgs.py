"""Non-smooth Gauss-Seidel: sweep over the contact points, and solve each one's own contact problem exactly."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from geometry.arrays import Array, Ints
from solvers.contact.admissible_set import ContactBlock
from solvers.interface.prepare import condensed
from solvers.interface.problem import SurfaceProblem
from solvers.laws.law import FrictionLaw, NormalLaw
from solvers.methods.applicability import Applicability
from solvers.methods.method import Method, Ready, SameEveryStep, Setup
from solvers.newton.solution import OnStep, Solution, Status, Step, ignore

STALL_WINDOW = 500  # sweeps in which the least residual must halve
LEAST = 1e-12  # give of a point beside the largest: rows that move nothing
NEWTON_STEPS = 50  # on a slipping point's equation: monotone, a handful are enough
ROUNDING = 1e-15  # of a length


@dataclass(frozen=True, kw_only=True)
class NSGS(Method):
    """For each point in turn r = R - D W p, then p <- its own laws' answer while all other points keep their tractions.

    D = N F N^T (rows, rows) is the Delassus operator, F the flexibility of the contact dofs, R = N F f + offset - gap
    what the loads do without contact. A normal row is answered by its law's resolvent with gamma = 1 / (D_ii W_i), a
    tangential point by the disc of the friction bound at the pressures just found, with its own block of D W. Where
    pressures live at quadrature points, each of them is a point by itself, and a node's friction follows the last of
    those that its bound depends on. There is no step size; sweeps grow with the number of points.

    It has no turn in the chain of `auto`: a switch comes before the step is cut and holds for good, so runs whose steps
    are cut and then solved by condensed-newton would go on with sweeps; and it needs bodies that supports hold.

    Source: Jean, Comput. Methods Appl. Mech. Engrg. 177 (1999); Acary & Brogliato, Numerical Methods for Nonsmooth
    Dynamical Systems (2008).
    """

    NAME: ClassVar = "nsgs"
    WHEN: ClassVar = (
        "the standard of non-smooth contact dynamics, to compare with: point by point on the Delassus operator, each "
        "point's laws answered exactly. 70–180 sweeps a step at tolerance 1e-11 on coarse `block`, `cube` and "
        "`cylinders`; they grow with the number of points"
    )
    WORKS_WITH: ClassVar = Applicability(floating=False, matrix_free=False, contends=False)

    def build(self, setup: Setup) -> Ready:
        return Sweeps(self, _delassus(setup))


@dataclass(frozen=True)
class Sweeps(SameEveryStep):
    """The iteration on the rows of a system."""

    method: NSGS
    D: Array  # (rows, rows) [m/N]

    def renewed(self, setup: Setup) -> Ready:
        """The operator belongs to the rows."""
        return self.method.build(setup)

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        W, p = problem.surface.W, np.where(problem.cone.carrying, p, 0.0)
        loaded = problem.relative_displacement(problem.load.free) - problem.gap
        points = list(_points(problem, self.D))
        history: list[Step] = []
        status, least, found_at = Status.MAX_IT, np.inf, 0
        for k in range(self.method.max_it + 1):
            u_c = problem.contact_displacement(p)
            w = problem.relative_displacement(u_c)
            residual = problem.natural_residual(p, w)
            history.append(Step(k, residual, problem.volume_solves))
            on_step(history[-1])
            if not np.isfinite(residual):
                status = Status.NOT_FINITE
                break
            if residual <= self.method.rtol:
                status = Status.CONVERGED
                break
            if residual < least / 2:
                least, found_at = residual, k
            elif k - found_at > STALL_WINDOW:
                status = Status.STALLED
                break
            if k == self.method.max_it:
                break
            p, forces = p.copy(), W * p
            for point in points:
                i = point.rows
                p[i] = point.answer(p, loaded[i] - self.D[i] @ forces)
                forces[i] = W[i] * p[i]
        return Solution(p, w, u_c, status, residual, tuple(history))


@dataclass(frozen=True)
class NormalPoint:
    """One normal row: r = inverse law(p), while r falls by `give` for each pascal."""

    rows: slice
    law: NormalLaw
    gamma: Array  # (1,) 1 / give [Pa/m]

    def answer(self, p: Array, r: Array) -> Array:
        """Pressure (1,) [Pa], r (1,) the relative displacement less the gap at all p (rows,) so far [m]."""
        return self.law.resolvent(p[self.rows] + self.gamma * r, self.gamma)


@dataclass(frozen=True)
class FrictionPoint:
    """One tangential point: r - t / k_T = 0 inside its disc, along t on the edge; r falls by the block A of D W."""

    rows: Ints  # (c,) those that carry a traction
    law: FrictionLaw
    normal: NormalLaw
    pressed_by: Ints  # (k,) normal rows that the bound depends on
    average: Array  # (1, k)
    A: Array  # (c, c) [m/Pa]
    give: Array  # (c,) eigenvalues of A + 1 / k_T
    axes: Array  # (c, c) eigenvectors, columns
    time: float
    end: float

    def answer(self, p: Array, r: Array) -> Array:
        """Traction (c,) [Pa], r (c,) the relative displacement less the gap at all p (rows,) so far [m]."""
        bound = self.law.limit(p[self.pressed_by], self.average, self.normal, self.time, self.end)
        asked = self.axes.T @ (r + self.A @ p[self.rows])
        return np.asarray(self.axes @ in_disc(self.give, asked, float(bound[0])))


def in_disc(give: Array, asked: Array, bound: float) -> Array:
    """t (c,) with (give + x) t = asked, |t| <= bound, x >= 0, and x = 0 where |t| < bound.

    |t| as a function of x is convex and falls; Newton on 1 / |t| rises monotonically onto 1 / bound.

    >>> in_disc(np.array([1.0, 2.0]), np.array([3.0, 8.0]), np.inf)
    array([3., 4.])
    >>> in_disc(np.array([1.0, 1.0]), np.array([3.0, 4.0]), 1.0)
    array([0.6, 0.8])
    """
    t = asked / give
    length = float(np.sqrt(t @ t))
    if length <= bound:
        return np.asarray(t)
    if bound <= 0:
        return np.zeros_like(t)
    x = 0.0
    for _ in range(NEWTON_STEPS if len(t) > 1 else 0):  # along one axis the end is known
        if length <= bound * (1 + ROUNDING):
            break
        x += (length / bound - 1) * length**2 / float(t @ (t / (give + x)))
        t = asked / (give + x)
        length = float(np.sqrt(t @ t))
    return np.asarray(t * (bound / length))


def _delassus(setup: Setup) -> Array:
    """N F N^T (rows, rows) [m/N], symmetric."""
    surface = condensed(setup.surface)
    half = surface.N @ surface.flexibility  # (rows, c)
    return np.ascontiguousarray((surface.N @ half.T).T)


def _points(problem: SurfaceProblem, D: Array) -> Iterator[NormalPoint | FrictionPoint]:
    """All of a step, each contact's friction among its normal rows: right after the last one that its bound needs."""
    give = np.maximum(D.diagonal() * problem.surface.W, 1e-300)
    for place in problem.cone.places:
        least = LEAST * float(give[place.normal].max(initial=0.0))
        gamma = 1 / np.maximum(give[place.normal], least)
        ordered: list[tuple[float, Any]] = [
            (k, NormalPoint(slice(i, i + 1), place.rows.normal, gamma[k : k + 1]))
            for k, i in enumerate(range(place.normal.start, place.normal.stop))
        ]
        ordered += _friction_points(problem, D, place)
        yield from (point for _, point in sorted(ordered, key=lambda each: each[0]))


def _friction_points(problem: SurfaceProblem, D: Array, place: ContactBlock) -> Iterator[tuple[float, FrictionPoint]]:
    """One contact's tangential points, each with the place between normal rows where it is swept."""
    law, cone, W = place.rows.friction, problem.cone, problem.surface.W
    if law is None:
        return
    every = np.arange(place.tangential.start, place.tangential.stop).reshape(-1, place.components)
    average = place.average.tocsr()
    for j, free in enumerate(place.rows.free):
        rows = every[j][free]
        if not len(rows):
            continue
        own = average[j]
        A = D[np.ix_(rows, rows)] * W[rows]
        give, axes = np.linalg.eigh((A + A.T) / 2 + np.diag(cone.softness[rows]))
        give = np.maximum(give, LEAST * float(give.max()))
        yield (
            float(own.indices.max(initial=-1)) + 0.5,
            FrictionPoint(
                rows,
                law,
                place.rows.normal,
                place.normal.start + own.indices,
                own.data[None, :],
                A,
                give,
                axes,
                cone.time,
                cone.end,
            ),
        )
