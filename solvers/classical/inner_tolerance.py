"""Tolerance for the residual delta_k of an inner solve, small enough for the outer iteration to converge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.solvers.classical.outer_iteration import Solved
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.linear.inner_solver import Allowed
from stickslip.solvers.methods.method import Keys

InnerRule = Literal["elman-golub", "bramble-pasciak-vassilev"]
CERTAIN = 0.1  # largest error of the natural residual after the last inner solve, relative to the outer tolerance


@dataclass(frozen=True, kw_only=True)
class InnerTolerance:
    """||delta_k|| <= tau_k, where ||.|| is the energy norm of the error that delta_k causes [J^(1/2)].

    elman-golub: tau_k is `share` times the outer residual B u_k + K_C p_{k-1} - R_C. The source has no projection; here
    the outer residual is (p_k - p_{k-1}) / alpha, after projection. Its norm in the metric Q times sqrt(alpha) is an
    energy norm. bramble-pasciak-vassilev: tau_k is `share` times ||delta|| at the start u_k of the inner solve.

    Source: Elman & Golub, SIAM J. Numer. Anal. 31 (1994); Bramble, Pasciak & Vassilev, ibid. 34 (1997). The norm is
    that of the second; Elman & Golub use the Euclidean norm, which would add newtons to metres here.
    """

    rule: InnerRule = "elman-golub"
    share: float = 0.3

    def __call__(
        self, problem: SurfaceProblem, last: Solved | None, p: Array, norm: Callable[[Array], float] | None = None
    ) -> Allowed:
        """Tolerance of an inner solve; for the first one it is relative to ||delta|| at its start.

        Args:
            last: the inner solve before; None: this is the first one.
            p: tractions (rows,) [Pa] that load the bodies.
            norm: of a change of tractions (rows,) [Pa] in the metric Q / alpha [J^(1/2)]; None: Q = W.
        """
        if last is None or self.rule == "bramble-pasciak-vassilev":
            return lambda start: self.share * start
        change = p - last.p
        outer = norm(change) if norm else np.sqrt(change @ (problem.surface.W * change) / last.alpha)
        return constant(problem, self.share * outer)


@dataclass(frozen=True, kw_only=True)
class InnerKeys(Keys):
    """Keys of [solver] for the accuracy of inner solves."""

    inner_rule: Annotated[
        InnerRule,
        Key("-", "what inner_tolerance is relative to: the outer residual, or the inner one at the start of the solve"),
    ] = "elman-golub"
    inner_tolerance: Annotated[float, Key("-", "residual of inner solves, relative to that of inner_rule")] = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        require(0 < self.inner_tolerance < 1, "inner_tolerance", self.inner_tolerance, "must lie between 0 and 1")

    @property
    def inner(self) -> InnerTolerance:
        return InnerTolerance(rule=self.inner_rule, share=self.inner_tolerance)


def negligible(problem: SurfaceProblem, rtol: float) -> Allowed:
    """Tolerance of an inner solve whose error is negligible compared with the outer tolerance.

    B K_B^-1 B^T <= lambda_max W, so the error of w_i is at most ||delta|| (lambda_max / W_i)^(1/2).
    """
    surface = problem.surface
    if not len(surface.W):
        return constant(problem, 0.0)
    return constant(problem, CERTAIN * rtol * problem.u_ref * np.sqrt(surface.W.min() / surface.lambda_max))


def constant(problem: SurfaceProblem, value: float) -> Allowed:
    """A tolerance [J^(1/2)] that does not depend on the start of the inner solve, the same on every rank."""
    agreed = float(problem.surface.agreed(value))  # inner solves are collective
    return lambda start: agreed
