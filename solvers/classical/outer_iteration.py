"""The outer loop that Uzawa's methods share: solve the bodies, measure the residual, take a step, project."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Literal

from scipy import sparse

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.admissible_set import AdmissibleSet, ContactBlock
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.methods.method import Keys
from stickslip.solvers.newton.solution import OnStep, Plateau, Solution, Status, Step, ending


@dataclass(frozen=True)
class GivenFriction(AdmissibleSet):
    """Friction bounds s from the pressures `given`, independent of p_n: j_T with its p_T frozen, a convex problem.

    Source: Pop (1999), (2.2) and the remark after (2.6), "contact problem with given friction".
    """

    given: Array  # (rows,) [Pa]

    def bound(self, place: ContactBlock, p_n: Array) -> Array:
        return super().bound(place, self.given[place.normal])

    def bound_slope(self, place: ContactBlock, p_n: Array) -> Sparse:
        found: Sparse = sparse.csr_matrix(place.average.shape)
        return found


def with_given_friction(problem: SurfaceProblem, p: Array) -> SurfaceProblem:
    """The same step with friction bounds fixed at those of tractions p (rows,) [Pa]."""
    cone = problem.cone
    return replace(problem, cone=GivenFriction(cone.contacts, cone.time, cone.end, p))


FrictionUpdate = Literal["every iteration", "outer"]


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


STALL_WINDOW = 500  # iterations in which the largest residual must fall
GIVEN = 0.1  # residual of a problem of given friction, relative to the whole one, at which its bounds are updated


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
        frozen = self.friction_update == "outer"
        step = with_given_friction(problem, p) if frozen else problem
        history: list[Step] = []
        stalled = Plateau(STALL_WINDOW)
        for k in range(self.max_it + 1):
            inner = solve(p)
            p, w = inner.p, problem.relative_displacement(inner.u_c)
            residual = problem.natural_residual(p, w)
            history.append(Step(k, residual, problem.volume_solves))
            on_step(history[-1])
            status = ending(residual, self.rtol, stalled(k, residual))
            if status or k == self.max_it:
                break
            if frozen and step.natural_residual(p, w) <= GIVEN * residual:
                step = with_given_friction(problem, p)
            moved = self.advance(step, inner, w, residual)
            if moved is None:
                status = Status.NO_HOLD
                break
            p = moved
        return Solution(p, w, inner.u_c, status or Status.MAX_IT, residual, tuple(history))
