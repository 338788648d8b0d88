"""How small the residual delta_k of an inner solve has to be, so that the outer iteration does not notice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from geometry.arrays import Array
from solvers.interface.problem import SurfaceProblem
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


def negligible(problem: SurfaceProblem, rtol: float) -> Allowed:
    """Beside the outer tolerance: B K_B^-1 B^T <= lambda_max W, w_i is wrong by ||delta|| (lambda_max / W_i)^(1/2)."""
    surface = problem.surface
    if not len(surface.W):
        return constant(problem, 0.0)
    return constant(problem, CERTAIN * rtol * problem.u_ref * np.sqrt(surface.W.min() / surface.lambda_max))


def constant(problem: SurfaceProblem, value: float) -> Allowed:
    agreed = float(problem.surface.agreed(value))  # inner solves are collective
    return lambda start: agreed
