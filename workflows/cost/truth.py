"""The reference value of a quantity: the scene's exact one, else the most certain limit of a sequence of meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from stickslip.geometry.arrays import CLOSE
from stickslip.solvers.scene.settings import Exact
from stickslip.workflows.cost.limit import Limit, limit
from stickslip.workflows.cost.run_record import Run

SEQUENCE = 3  # meshes of one order that say more than two of another
NOISE = 10.0  # times the tolerance: differences that the iteration alone can leave


@dataclass(frozen=True)
class Truth:
    """The reference value that errors are measured against."""

    name: str
    value: float
    uncertainty: float  # relative; errors below it mean nothing
    source: str
    scale: float  # what errors are relative to
    converges: bool = True
    meshes: int = 2  # number of meshes it rests on; one alone proves nothing
    warning: str = ""  # how the runs contradict it, in words
    exact: bool = False  # given by the scene, not by the runs


def truth_of(name: str, runs: Sequence[Run], exact: Exact, tolerance: float) -> Truth | None:
    """The reference value of a quantity; None if no run has it, or if it is zero in all runs."""
    found = [abs(run.quantities[name]) for run in runs if run.converged]
    if name in exact.values:
        value = exact.values[name]
        source = f"exact: {exact.source}" if exact.source else "exact, says the scene"
        scale = abs(value) or max(found, default=0.0)
        if not scale:
            return None
        warning = _against(name, value, exact.accuracy * scale, runs, tolerance)
        return Truth(name, value, max(exact.accuracy, NOISE * tolerance), source, scale, warning=warning, exact=True)
    if not any(found):
        return None
    sure, meshes = _limits(name, runs, tolerance)
    if not sure:
        return None
    order = min(sure, key=lambda k: sure[k].uncertainty)
    best = sure[order]
    # the orders must agree: a difference beyond the other one's uncertainty is uncertainty too
    doubt = max([best.uncertainty, *(abs(best.value - o.value) - o.uncertainty for o in sure.values() if o.converges)])
    scale = abs(best.value) or max(found)
    if best.rate is None or not best.converges:
        source = f"finest mesh, order {order}"
    else:
        source = f"extrapolated, order {order}, h^{best.rate:.1f}"
    converges = meshes > 1 and all(limit.converges for limit in sure.values())  # no order hides a singular corner
    return Truth(name, best.value, doubt / scale, source, scale, converges, meshes)


def _limits(name: str, runs: Sequence[Run], tolerance: float) -> tuple[dict[int, Limit], int]:
    """The limit of each order with about as many meshes as the best one; and that number."""
    points = {order: _sequence(name, order, runs, tolerance) for order in sorted({run.rung.order for run in runs})}
    most = max((len(sequence) for sequence in points.values()), default=0)
    enough = max(1, min(SEQUENCE, most))
    return {order: _limit(sequence, tolerance) for order, sequence in points.items() if len(sequence) >= enough}, most


def _against(name: str, value: float, accuracy: float, runs: Sequence[Run], tolerance: float) -> str:
    """Whether the runs converge to another value than the scene's exact one, in words."""
    limits, meshes = _limits(name, runs, tolerance)
    settled = [limit for limit in limits.values() if limit.converges and meshes >= SEQUENCE]
    best = min(settled, key=lambda limit: limit.uncertainty, default=None)
    if best is None or abs(best.value - value) <= accuracy + best.uncertainty:
        return ""
    return f"warning: {name} settles at {best.value:.6g} +- {best.uncertainty:.1g}; [exact] says {value:.6g}"


def _sequence(name: str, order: int, runs: Sequence[Run], tolerance: float) -> dict[float, float]:
    """Values by mesh size, of one order at the tightest tolerance.

    Methods that solve the scene's own laws agree on every mesh.
    """
    return {
        run.h: run.quantities[name]
        for run in runs
        if run.converged
        and run.rung.order == order
        and run.rung.tolerance == tolerance
        # relative law error (energy norm) above which a method solves other laws than the scene's
        and (run.law_error or 0.0) <= CLOSE
    }


def _limit(points: Mapping[float, float], tolerance: float) -> Limit:
    floor = NOISE * tolerance * max(abs(value) for value in points.values())
    return limit(list(points), list(points.values()), floor)
