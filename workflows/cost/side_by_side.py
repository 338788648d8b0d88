"""Methods side by side: the work and the seconds of each on the same meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stickslip.workflows.cost.run_record import Run
from stickslip.workflows.cost.sentence import seconds


@dataclass(frozen=True)
class Line:
    """One mesh: the run of each method on it, at the scene's tolerance."""

    order: int
    level: int
    runs: tuple[Run | None, ...]  # in the order of the methods; None: the method did not get so far

    @property
    def h(self) -> float:
        """Edge length where bodies touch [m]."""
        return next((run.h for run in self.runs if run and run.h), 0.0)


def lines(runs: Sequence[Run], methods: Sequence[str], tolerance: float) -> list[Line]:
    """One line for each mesh that any of the methods has solved, coarse to fine."""
    tight = {
        (r.rung.chain, r.rung.level): r for r in runs if r.rung.tolerance == tolerance and r.rung.method in methods
    }
    solved = sorted({(r.rung.order, r.rung.level) for r in tight.values() if r.converged})
    return [Line(o, level, tuple(tight.get(((o, name), level)) for name in methods)) for o, level in solved]


def plain(found: Sequence[Line], methods: Sequence[str]) -> list[dict[str, Any]]:
    """As plain data for JSON: for each mesh, the numbers of every method; null where it did not get so far."""
    return [
        {"order": line.order, "h": line.h, "methods": dict(zip(methods, map(_numbers, line.runs), strict=True))}
        for line in found
    ]


def comparison(found: Sequence[Line], methods: Sequence[str]) -> str:
    """The finest mesh that all methods solved, in one sentence; empty without one.

    The cheapest comes first, the others as multiples of it.
    """
    whole = [line for line in found if all(run and run.converged for run in line.runs)]
    if len(methods) < 2 or not whole:
        return ""
    line = min(whole, key=lambda line: (line.h, line.order))
    first, *others = sorted((run for run in line.runs if run), key=lambda run: run.seconds)
    told = [
        f"{run.rung.method} {run.seconds / first.seconds:.2g} times the seconds, "
        f"{run.volume_solves / max(first.volume_solves, 1):.2g} times the volume solves"
        for run in others
    ]
    start = f"On the finest mesh that all solved (order {line.order}, h = {line.h:.3g}) {first.rung.method} takes "
    return f"{start}{seconds(first.seconds)} and {first.volume_solves} volume solves; {'; '.join(told)}."


def _numbers(run: Run | None) -> dict[str, Any] | None:
    if run is None:
        return None
    counts = ("seconds", "volume_solves", "linear_iterations", "dofs", "memory")
    return {"status": run.status} | {key: getattr(run, key) if run.converged else None for key in counts}
