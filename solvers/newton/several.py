"""Other solutions of the same step: with much friction there may be several, and all of them are right.

Below some coefficient of friction the solution of the discrete problem is unique; above it there may be an odd number
of them, or a continuum. Nothing in the quasi-static model says which one a body takes.

Source: Klarbring, Ing.-Arch. 60 (1990), of one node; Hild, Q. J. Mech. Appl. Math. 57 (2004), of discrete problems.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from stickslip.geometry.arrays import CLOSE, SLIGHT, Array
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.newton import path

ENOUGH = 1.0  # coefficient of friction above which others are looked for; one node of steel has others above 1.5
MOST = 200  # rows up to which they are looked for; on 160 rows it takes 0.1 s a step, on 640 rows 6 s
KINKS = 2000  # on the path that is followed


def others(
    problem: SurfaceProblem, p: Array, keeps: Callable[[Array, Array], bool] = lambda p, w: True
) -> Iterator[Array]:
    """Tractions (rows,) [Pa] of solutions that differ from p, on the path from all open; none where it does not apply.

    It finds no others of floating bodies, of curved laws, in 3D, off this path, or where there are many rows.

    Args:
        problem: the contact problem of the step.
        p: tractions (rows,) [Pa] that solve it.
        keeps: whether tractions (rows,) [Pa] and relative displacement (rows,) [m] have the laws of the problem.
    """
    if len(p) > MOST or problem.surface.floating or _most_friction(problem) <= ENOUGH or not path.applies(problem):
        return
    known = [p]
    for found in path.path_from_open(problem, KINKS):
        w = problem.relative_displacement(found.u_c)
        # natural residual of another solution: it is the end of a path, not iterated
        if problem.natural_residual(found.p, w) > CLOSE or not keeps(found.p, w):
            continue
        size = max(problem.scale(found.p), problem.scale(p))
        # of the largest traction: solutions that differ by less are one
        if all(np.abs(found.p - one).max(initial=0.0) > SLIGHT * size for one in known):
            known.append(found.p)
            yield found.p


def _most_friction(problem: SurfaceProblem) -> float:
    """The largest coefficient of friction of the step [-]."""
    cone = problem.cone
    most = [place.rows.friction.lines(place.rows.normal, cone.time, cone.end)[2] for place in cone.with_friction()]  # type: ignore[union-attr]
    return max((float(np.max(mu, initial=0.0)) for mu in most), default=0.0)
