"""Uzawa's methods with one step size: solve the bodies, project the contact traction onto its cone.

The outer loop is shared by all of Uzawa's methods here: solve the bodies, measure the residual, take a step, project.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import count
from typing import Annotated, ClassVar, Literal

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.admissible_set import AdmissibleSet, ContactBlock
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import PATIENT, Driver, Iterate, OnStep, Plateau, Solution, ignore
from stickslip.solvers.laws.law import Trial
from stickslip.solvers.linear.petsc_solver import Allowed
from stickslip.solvers.methods.method import Applicability, Keys, Method, Stateless


@dataclass(frozen=True)
class GivenFriction(AdmissibleSet):
    """Friction bounds s from the pressures `given`, independent of p_n: j_T with its p_T frozen, a convex problem.

    Source: Pop (1999), (2.2) and the remark after (2.6), "contact problem with given friction".
    """

    given: Array  # (rows,) [Pa]

    def bound(self, place: ContactBlock, p_n: Array, trial: Trial | None = None) -> Array:
        return super().bound(place, self.given[place.normal], trial)

    def bound_slope(self, place: ContactBlock, p_n: Array) -> Sparse:
        return sparse.csr_matrix(place.average.shape)


def with_given_friction(problem: SurfaceProblem, p: Array) -> SurfaceProblem:
    """The same step with friction bounds fixed at those of tractions p (rows,) [Pa]."""
    cone = problem.cone
    return replace(problem, cone=GivenFriction(cone.contacts, cone.time, cone.end, p))


FrictionUpdate = Literal["every iteration", "outer"]


@dataclass(frozen=True)
class Solved:
    """Result of an inner solve."""

    p: Array  # tractions (rows,) [Pa]: the given ones, and those that the inner solve computes (compliant faces)
    u_c: Array  # displacement (c,) [m] of the contact dofs
    alpha: float  # size of the next step [Pa/m]


Advance = Callable[[SurfaceProblem, Solved, Array, float], Array | None]  # problem, inner solve, w, residual


def projected(problem: SurfaceProblem, inner: Solved, w: Array, residual: float) -> Array:
    """P_C(p + alpha (w - gap)) (rows,) [Pa], point by point."""
    return problem.project(inner.p + inner.alpha * (w - problem.gap), inner.alpha)


@dataclass(frozen=True, kw_only=True)
class Outer:
    """p_{k+1} = P_C(p_k + alpha_k (w(u_{k+1}) - gap)), metric Q = W; an inner solve gives u_{k+1}.

    A method with another metric passes its own step, `advance`, which returns None if no tractions hold the bodies.

    The friction bound follows p_n in every iteration. Or (`outer`) it is frozen, the problem of given friction is
    solved, and the bound is updated: the fixed-point iteration of the source, a contraction only if friction is small.

    Source: Pop (1999), (1.2), (1.3), section 5; given friction: Nečas, Jarušek & Haslinger, Boll. UMI 17-B (1980).
    """

    rtol: float
    max_it: int
    friction_update: FrictionUpdate = "every iteration"
    advance: Advance = projected

    def __call__(
        self, problem: SurfaceProblem, p: Array, solve: Callable[[Array], Solved], on_step: OnStep
    ) -> Solution:
        driver = Driver(problem.surface.counters, self.rtol, self.max_it, on_step)
        return driver.run(self._iterates(problem, p, solve), Plateau(PATIENT))

    def _iterates(self, problem: SurfaceProblem, p: Array, solve: Callable[[Array], Solved]) -> Iterator[Iterate]:
        frozen, moved = self.friction_update == "outer", p
        step = with_given_friction(problem, p) if frozen else problem
        for k in count():
            inner = solve(moved)
            p, w = inner.p, problem.relative_displacement(inner.u_c)
            residual = problem.natural_residual(p, w)
            yield Iterate(k, residual, p, w, inner.u_c)
            if frozen and step.natural_residual(p, w) <= 0.1 * residual:
                step = with_given_friction(problem, p)
            found = self.advance(step, inner, w, residual)
            if found is None:
                return
            moved = found


@dataclass(frozen=True, kw_only=True)
class Relaxation(Keys):
    """Key of [solver] for the step size alpha = relaxation / lambda_max."""

    relaxation: Annotated[
        float, Key("-", "step of Uzawa's methods, alpha = relaxation / lambda_max; 2 is the sharp bound")
    ] = 1.5

    def __post_init__(self) -> None:
        super().__post_init__()
        require(0 < self.relaxation < 2, "relaxation", self.relaxation, "must lie between 0 and 2")


@dataclass(frozen=True, kw_only=True)
class FrictionUpdates(Keys):
    """Key of [solver]: when the friction bound follows the pressure."""

    friction_update: Annotated[
        FrictionUpdate,
        Key("-", "when Uzawa's methods update the friction bound; outer: after each problem of given friction"),
    ] = "every iteration"

    def iteration(self, advance: Advance = projected) -> Outer:
        """Return the outer iteration of a method with these keys."""
        assert isinstance(self, Method)
        return Outer(rtol=self.rtol, max_it=self.max_it, friction_update=self.friction_update, advance=advance)


@dataclass(frozen=True, kw_only=True)
class FixedStep(Relaxation, FrictionUpdates):
    """Keys of [solver] for a fixed step size: alpha, or relaxation / lambda_max(W^-1 B K_B^-1 B^T)."""

    alpha: Annotated[float | None, Key("Pa/m", "step size of Uzawa's methods; absent: from relaxation")] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.alpha is None or self.alpha > 0, "alpha", self.alpha, "must be positive, in Pa/m")

    def step_size(self, problem: SurfaceProblem) -> float:
        """alpha [Pa/m]; without contact rows it has no effect."""
        if self.alpha is not None or not len(problem.gap):
            return self.alpha or 1.0
        return self.relaxation / problem.surface.lambda_max


InnerRule = Literal["elman-golub", "bramble-pasciak-vassilev"]


@dataclass(frozen=True, kw_only=True)
class InnerKeys(Keys):
    """Keys of [solver] for the accuracy of inner solves: ||delta_k|| <= tau_k.

    ||.|| is the energy norm of the error that delta_k causes [J^(1/2)]. elman-golub: tau_k is `inner_tolerance` times
    the outer residual B u_k + K_C p_{k-1} - R_C. The source has no projection; here the outer residual is
    (p_k - p_{k-1}) / alpha, after projection. Its norm in the metric Q times sqrt(alpha) is an energy norm.
    bramble-pasciak-vassilev: tau_k is `inner_tolerance` times ||delta|| at the start u_k of the inner solve.

    Source: Elman & Golub, SIAM J. Numer. Anal. 31 (1994); Bramble, Pasciak & Vassilev, ibid. 34 (1997). The norm is
    that of the second; Elman & Golub use the Euclidean norm, which would add newtons to metres here.
    """

    inner_rule: Annotated[
        InnerRule,
        Key("-", "what inner_tolerance is relative to: the outer residual, or the inner one at the start of the solve"),
    ] = "elman-golub"
    inner_tolerance: Annotated[float, Key("-", "residual of inner solves, relative to that of inner_rule")] = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        require(0 < self.inner_tolerance < 1, "inner_tolerance", self.inner_tolerance, "must lie between 0 and 1")

    def inner(
        self, problem: SurfaceProblem, last: Solved | None, p: Array, outer: float | None = None, share: float = 1.0
    ) -> Allowed:
        """Tolerance of an inner solve; for the first one it is relative to ||delta|| at its start.

        Args:
            last: the inner solve before; None: this is the first one.
            p: tractions (rows,) [Pa] that load the bodies.
            outer: norm of their change in the metric Q / alpha [J^(1/2)]; None: Q = W.
            share: of `inner_tolerance`.
        """
        share *= self.inner_tolerance
        if last is None or self.inner_rule == "bramble-pasciak-vassilev":
            return lambda start: share * start
        if outer is None:
            outer = float(np.sqrt((p - last.p) @ (problem.surface.W * (p - last.p)) / last.alpha))
        return constant(problem, share * outer)


def negligible(problem: SurfaceProblem, rtol: float) -> Allowed:
    """Tolerance of an inner solve whose error is negligible compared with the outer tolerance.

    B K_B^-1 B^T <= lambda_max W, so the error of w_i is at most ||delta|| (lambda_max / W_i)^(1/2).
    """
    surface = problem.surface
    if not len(surface.W):
        return constant(problem, 0.0)
    return constant(problem, 0.1 * rtol * problem.u_ref * np.sqrt(surface.W.min() / surface.lambda_max))


def constant(problem: SurfaceProblem, value: float) -> Allowed:
    """A tolerance [J^(1/2)] that does not depend on the start of the inner solve, the same on every rank."""
    agreed = float(problem.surface.agreed(value))  # inner solves are collective
    return lambda start: agreed


NEWTON_STEPS = 100  # of an inner solve


def step_length(force: Callable[[float], float], slope: float) -> float:
    """Length in (0, 1] of a step along which a convex energy falls, at most halved 30 times.

    Its slope at the end of the step shows whether the step is too long: 0.9 of that at its start, of opposite sign.

    Args:
        force: minus the slope of the energy at a length [J].
        slope: the same at the start.
    """
    return next((length for length in (0.5 ** np.arange(30)).tolist() if force(length) >= -0.9 * slope), 0.5**30)


@dataclass(frozen=True, kw_only=True)
class Uzawa(FixedStep, Stateless):
    """K_B u_{k+1} = R_B - B^T p_k exactly, then p_{k+1} = P_C(p_k + alpha (w(u_{k+1}) - gap)), metric Q = W.

    alpha is fixed: given, or relaxation / lambda_max(W^-1 B K_B^-1 B^T). Converges for 0 < relaxation < 2 if the
    friction bounds are fixed. That limit is sharp without projection; K_C enters implicitly, by the laws' resolvents,
    and does not change it. With Coulomb's law the bound follows p_n in every iteration: contraction is not guaranteed,
    and the iteration ends with Status.STALLED if the residual no longer decreases.

    Source: Elman & Golub, SIAM J. Numer. Anal. 31 (1994); Pop (1999), section 5.
    """

    NAME: ClassVar = "uzawa"
    WHEN: ClassVar = "the classical projected iteration, to compare with: hundreds to thousands of cheap iterations"
    WORKS_WITH: ClassVar = Applicability(floating=False)
    ROW: ClassVar = 4

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        alpha = self.step_size(problem)

        def solve(p: Array) -> Solved:  # K_B u = R_B - B^T p: one volume solve
            return Solved(p, problem.contact_displacement(p), alpha)

        return self.iteration()(problem, p, solve, on_step)
