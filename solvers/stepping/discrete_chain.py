"""The default method of discrete problems: sweeps get near, Newton arrives, each helps the other where it fails.

Gauss-Seidel is fast at first and slow near the solution, Newton the other way round. So they take turns, each from the
best reactions so far, with more iterations every time. A point that many sweeps lead to can be one that Newton does not
leave: once it also starts from rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError, nearest
from stickslip.solvers.interface.discrete import DiscreteProblem, GivenSurface
from stickslip.solvers.iteration import Solution, Status, ignore
from stickslip.solvers.method_registry import METHODS

AUTO = "auto"
REST, BEST = "from r = 0", "from the best reactions so far"
TURNS = (  # method, iterations, start
    ("nsgs", 50, BEST),
    ("condensed-newton", 200, BEST),
    ("nsgs", 1000, BEST),
    ("condensed-newton", 500, BEST),
    ("condensed-newton", 500, REST),
    ("nsgs", 20000, BEST),
    ("surface-uzawa", 200, BEST),
)
MAX_IT = 100000  # of a method that is asked for by name


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The best answer to a discrete problem, and what it took."""

    solution: Solution
    method: str  # that found it
    iterations: int  # of all methods that were tried

    @property
    def solved(self) -> bool:
        return self.solution.status is Status.CONVERGED


def usable() -> tuple[str, ...]:
    """Names of the methods that solve discrete problems, `auto` first."""
    probe = GivenSurface(sparse.identity(2, format="csr"), 1)
    return AUTO, *(name for name, kind in METHODS.items() if kind().discrete(probe) is not None)


def refuse_unusable(method: str) -> None:
    """Check that a method can solve discrete problems.

    Raises:
        SceneError: it needs the bodies, or no method has that name.
    """
    known = usable()
    if method in METHODS and method not in known:
        names = ", ".join(known)
        raise SceneError(f"--method {method}: needs the bodies, a discrete problem has none; these do not: {names}")
    if method not in known:
        raise SceneError(f"--method {method}: no such method; {nearest(method, known)}")


def solve(problem: DiscreteProblem, method: str, rtol: float) -> Outcome:
    """Solve a discrete problem from r = 0.

    Args:
        problem: scaled.
        method: one of `usable`.
        rtol: on the residual, relative to the norm of q.
    """
    nothing = np.zeros(len(problem.gap))
    best, by, iterations = _broken(nothing), "", 0
    for name, max_it, start in TURNS if method == AUTO else ((method, MAX_IT, REST),):
        prepared = METHODS[name](rtol=rtol, max_it=max_it).discrete(problem.surface)
        assert prepared is not None, "one of `usable`"
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # what is not finite ends by name
                found = prepared(problem, best.p if start == BEST else nothing, ignore)
        except np.linalg.LinAlgError:
            found = _broken(best.p)
        iterations += found.iterations
        if not by or found.residual < best.residual:
            best, by = found, name
        if not np.isfinite(best.residual):
            best = replace(best, p=nothing, residual=np.inf)
        if best.status is Status.CONVERGED:
            break
    return Outcome(solution=best, method=by, iterations=iterations)


def _broken(p: Array) -> Solution:
    return Solution(p=p, w=np.zeros_like(p), u_c=np.zeros_like(p), status=Status.BROKEN, residual=np.inf, history=())
