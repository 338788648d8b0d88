"""What a quantity ought to be: what the scene knows to be exact, else the limit of the surest sequence of meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from solvers.nouns.exact import Exact
from workflows.cost.limit import Limit, limit
from workflows.cost.run_record import Run

LAW_ERROR = 1e-6  # relative, energy norm, beyond which a method solves other laws than the scene's
NOISE = 10.0  # times the tolerance: differences that the iteration alone may leave


@dataclass(frozen=True)
class Truth:
    """The number that errors are measured by, relative to its size."""

    name: str
    value: float
    uncertainty: float  # relative; errors below it mean nothing
    source: str
    scale: float  # what errors are relative to
    converges: bool = True


def truth_of(name: str, runs: Sequence[Run], exact: Exact, tolerance: float) -> Truth | None:
    """The truth about a quantity; None if no run has it, or if it is zero in all."""
    found = [abs(run.quantities[name]) for run in runs if run.converged]
    if name in exact.values:
        value = exact.values[name]
        source = f"exact: {exact.source}" if exact.source else "exact, says the scene"
        scale = abs(value) or max(found, default=0.0)
        return Truth(name, value, max(exact.accuracy, NOISE * tolerance), source, scale) if scale else None
    if not any(found):
        return None
    limits = {order: _limit(name, order, runs, tolerance) for order in sorted({run.rung.order for run in runs})}
    sure = {order: each for order, each in limits.items() if each is not None}
    if not sure:
        return None
    order = min(sure, key=lambda k: sure[k].uncertainty)
    best = sure[order]
    # the orders must agree: what they differ by, beyond what the other one admits, is uncertain too
    doubt = max([best.uncertainty, *(abs(best.value - o.value) - o.uncertainty for o in sure.values() if o.converges)])
    scale = abs(best.value) or max(found)
    source = f"extrapolated, order {order}"
    if best.rate is not None and best.converges:
        source += f", h^{best.rate:.1f}"
    return Truth(name, best.value, doubt / scale, source, scale, best.converges)


def _limit(name: str, order: int, runs: Sequence[Run], tolerance: float) -> Limit | None:
    """Of one order at the tightest tolerance: methods that solve the scene's own laws agree on every mesh."""
    points = {
        run.h: run.quantities[name]
        for run in runs
        if run.converged
        and run.rung.order == order
        and run.rung.tolerance == tolerance
        and (run.law_error or 0.0) <= LAW_ERROR
    }
    if not points:
        return None
    floor = NOISE * tolerance * max(abs(value) for value in points.values())
    return limit(list(points), list(points.values()), floor)
