"""Whether a substep has one solution: a proof for all sets of points and ways of slip, and reasons to look for others.

Two solutions differ by dp, and dv along the surface. By Coulomb's law sum W mu |dp_n| |dv| >= dp^T W G dp, with the
flexibility G: normal laws, and directions of slip, only add to the left. So there is one solution where for some c > 0

    sum W mu (c dp_n^2 + |G_t dp|^2 / c) / 2 < dp^T W G dp     for all dp.

That is never so for large mu. A set K of closed points that all slip one way is singular where G_nn + mu G_nt is, or
S_tt q = mu S_nt q in the stiffness of the bodies: another solution may branch off there. Others are looked for where mu
is above the least of these coefficients, of all points, of points alone, and of runs from either end of the rows.

Source: Hild, Q. J. Mech. Appl. Math. 57 (2004), of singular sets; Hassani, Hild, Ionescu & Sakki, Comput. Methods Appl.
Mech. Engrg. 192 (2003), of their eigenvalues.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import minimize_scalar

from stickslip.geometry.arrays import EXACT, ROUNDING, Array, Ints
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.laws.friction import CappedCoulomb, Proportional
from stickslip.solvers.laws.wear import Worn

MOST = 200  # rows up to which it is asked: on 160 rows others take 0.1 s a step, on 640 rows 6 s
_known: WeakKeyDictionary[CondensedSurface, dict[bytes, tuple[bool, float]]] = WeakKeyDictionary()


def proved(problem: SurfaceProblem) -> bool:
    """Whether it is proved that the problem has one solution."""
    return _found(problem)[0]


def critical(problem: SurfaceProblem) -> float:
    """Part of the friction of the problem at which a set of slipping points is singular; inf: none was met."""
    return _found(problem)[1]


def _found(problem: SurfaceProblem) -> tuple[bool, float]:
    """Both; they depend on bodies, rows and coefficients alone."""
    surface, (slopes, sure) = problem.surface, _slopes(problem)
    if surface.floating or not slopes.any():
        return sure and not surface.floating, np.inf
    if not isinstance(surface, CondensedSurface) or len(problem.gap) > MOST:
        return False, np.inf
    known = _known.setdefault(surface, {})
    key = slopes.tobytes() + problem.cone.carrying.tobytes()
    if key not in known:
        G = surface.flexibility.between(surface.N, (surface.N.T.multiply(surface.W)).tocsr())
        known[key] = _bounded(problem, G, slopes), _singular(problem, G, slopes)
    return sure and known[key][0], known[key][1]


def _slopes(problem: SurfaceProblem) -> tuple[Array, bool]:
    """Largest slope of the friction bound by the mean pressure (rows,) [-], and whether it is all there is to it."""
    found, sure = np.zeros(len(problem.gap)), True
    for place in problem.cone.with_friction():
        law, normal = place.rows.friction, place.rows.normal
        assert law is not None
        follows = isinstance(law, Proportional | CappedCoulomb) and getattr(law, "most", None) is None
        sure &= follows and not (law.remembers or law.drags or law.changes or isinstance(normal, Worn))
        mu: Array | float = law.lines(normal, problem.cone.time, problem.cone.end)[2]
        if follows and isinstance(law, Proportional):
            mu = law.coefficient_now
        mu = np.where(np.isfinite(mu), mu, 0.0)
        found[place.tangential] = np.repeat(np.broadcast_to(mu, len(place.rows.free)), place.components)
    return found, sure


def _bounded(problem: SurfaceProblem, G: Array, slopes: Array) -> bool:
    """Whether the sufficient bound holds."""
    W, carries = problem.surface.W, problem.cone.carrying
    pressed, rubbed = np.zeros_like(slopes), np.zeros_like(slopes)
    for place in problem.cone.with_friction():
        t = place.tangential
        weight = (W * slopes)[t][:: place.components]
        pressed[place.normal] += place.average.T @ weight
        rubbed[t] = np.repeat(weight, place.components)
    energy = (W[:, None] * G)[np.ix_(carries, carries)]
    A, B = np.diag(pressed[carries]), ((G.T * rubbed) @ G)[np.ix_(carries, carries)]
    scale = float(np.sqrt(np.trace(B) / np.trace(A)))

    def largest(power: float) -> float:
        c = scale * 10.0**power
        top = len(energy) - 1
        return float(eigh(c * A + B / c, energy + energy.T, eigvals_only=True, subset_by_index=(top, top))[0])

    try:
        least = minimize_scalar(largest, bounds=(-3.0, 3.0), method="bounded", options={"maxiter": 20}).fun
    except np.linalg.LinAlgError:  # rows that depend on each other
        return False
    return bool(least < 1 - ROUNDING)


def _singular(problem: SurfaceProblem, G: Array, slopes: Array) -> float:
    """The least part of the friction at which a set that slips one way, or a point in any way, is singular."""
    least = np.inf
    for place in problem.cone.with_friction():
        n = np.arange(place.normal.start, place.normal.stop)
        for component in range(place.components):
            t = np.arange(place.tangential.start, place.tangential.stop)[component :: place.components]
            rubs = (slopes[t][:, None] * place.average.toarray()) * problem.cone.carrying[t][:, None]
            across, along = G[np.ix_(n, n)], G[np.ix_(n, t)] @ rubs
            for some in _runs(len(n)):
                part = np.ix_(some, some)
                least = min(least, _least_real(across[part], along[part]))
    return least


def _runs(count: int) -> list[Ints]:
    """Sets of points: all, single ones, and runs from either end, each twice as long as the one before."""
    every = np.arange(count)
    lengths = [2**k for k in range(1, count.bit_length()) if 2**k < count]
    ends = [run for length in lengths for run in (every[:length], every[count - length :])]
    return [every, *every[:, None], *ends]


def _least_real(across: Array, along: Array) -> float:
    """Least |k| at which G_nn + k G_nt is singular, k real; inf: none."""
    try:
        found = np.linalg.eigvals(np.linalg.solve(across, along))
    except np.linalg.LinAlgError:
        return np.inf
    real = np.abs(found[np.abs(found.imag) <= ROUNDING * np.abs(found)])
    return float(1 / real.max(initial=EXACT))
