"""How small the residual delta_k of an inner solve has to be, so that the outer iteration does not notice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from geometry.arrays import Array
from geometry.errors import require
from geometry.keys import Key
from solvers.interface.problem import SurfaceProblem
from solvers.methods.method import Keys
from solvers.methods.outer_iteration import Solved

InnerRule = Literal["elman-golub", "bramble-pasciak-vassilev"]
Allowed = Callable[[float], float]  # from ||delta|| at the start of an inner solve to ||delta|| at its end
CERTAIN = 0.1  # of the outer tolerance, what the last inner solve may put the natural residual off


@dataclass(frozen=True, kw_only=True)
class InnerTolerance:
    """||delta_k|| <= tau_k, in the energy norm of the error that delta_k makes [J^(1/2)].

    elman-golub: tau_k is `share` of the outer residual B u_k + K_C p_{k-1} - R_C. As the source has no projection,
    ours is what is left of it, (p_k - p_{k-1}) / alpha; in the metric Q its norm times sqrt(alpha) is an energy.
    bramble-pasciak-vassilev: tau_k is `share` of ||delta|| where the inner solve begins, at u_k.

    Source: Elman & Golub, SIAM J. Numer. Anal. 31 (1994); Bramble, Pasciak & Vassilev, ibid. 34 (1997), whose norm
    this is; Elman & Golub have the Euclidean one, which would add newtons to metres here.
    """

    rule: InnerRule = "elman-golub"
    share: float = 0.3

    def __call__(self, problem: SurfaceProblem, last: Solved | None, p: Array) -> Allowed:
        """For the inner solve under tractions p (rows,), `last` the one before; the first one goes by its start."""
        if last is None or self.rule == "bramble-pasciak-vassilev":
            return lambda start: self.share * start
        change = p - last.p
        outer = np.sqrt(change @ (problem.surface.W * change) / last.alpha)
        return constant(problem, self.share * outer)


@dataclass(frozen=True, kw_only=True)
class InnerKeys(Keys):
    """How exact inner solves are, as a scene says it."""

    inner_rule: Annotated[
        InnerRule,
        Key("-", "what inner solves are measured by: the outer residual, or their own where they begin"),
    ] = "elman-golub"
    inner_tolerance: Annotated[float, Key("-", "part of that which an inner solve may leave")] = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        require(0 < self.inner_tolerance < 1, "inner_tolerance", self.inner_tolerance, "must lie between 0 and 1")

    @property
    def inner(self) -> InnerTolerance:
        return InnerTolerance(rule=self.inner_rule, share=self.inner_tolerance)


def negligible(problem: SurfaceProblem, rtol: float) -> Allowed:
    """Beside the outer tolerance: B K_B^-1 B^T <= lambda_max W, w_i is wrong by ||delta|| (lambda_max / W_i)^(1/2)."""
    surface = problem.surface
    if not len(surface.W):
        return constant(problem, 0.0)
    return constant(problem, CERTAIN * rtol * problem.u_ref * np.sqrt(surface.W.min() / surface.lambda_max))


def constant(problem: SurfaceProblem, value: float) -> Allowed:
    agreed = float(problem.surface.agreed(value))  # inner solves are collective
    return lambda start: agreed
