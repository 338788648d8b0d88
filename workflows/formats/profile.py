"""What a run spent its time on: the seconds of result.json, and a table for run.log and the report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from stickslip.solvers.parallel.counters import PHASES, Row

HEAD = ("phase", "seconds", "share", "calls", "volume solves")
REFERENCE = "linear_reference"


def seconds_of(rows: Sequence[Row], reference: float | None) -> dict[str, float | None]:
    """Wall time by phase [s], and `total`, which is the sum of all others.

    Args:
        rows: of the run's clock.
        reference: of the fastest solver of the linear reference [s], which stands apart; None: it was not measured.

    >>> row = Row(phase="linear_reference", part="", seconds=3.0, calls=1, volume_solves=0)
    >>> found = seconds_of([row], 1.0)
    >>> found["linear_reference"], found["linear_reference_others"], found["total"]
    (1.0, 2.0, 3.0)
    """
    found: dict[str, float | None] = {phase: sum(r.seconds for r in rows if r.phase == phase) for phase in PHASES}
    spent = found[REFERENCE] or 0.0
    found[REFERENCE] = reference
    found[f"{REFERENCE}_others"] = None if reference is None else spent - reference
    return found | {"total": sum(row.seconds for row in rows)}


def profile_rows(profile: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, ...]]:
    """Rows below `HEAD` of the profile of result.json: each phase as a whole, and its parts below it."""
    total = sum(row["seconds"] for row in profile)
    for phase in dict.fromkeys(row["phase"] for row in profile):
        own = [row for row in profile if row["phase"] == phase]
        calls = sum(row["calls"] for row in own if not row["part"]) or max(row["calls"] for row in own)
        yield _cells(phase, sum(r["seconds"] for r in own), total, calls, sum(r["volume_solves"] for r in own))
        for row in own if len(own) > 1 else ():
            name = f"  {row['part'] or 'all else'}"
            yield _cells(name, row["seconds"], total, row["calls"], row["volume_solves"])
    yield _cells("total", total, total, 0, sum(row["volume_solves"] for row in profile))


def profile_lines(profile: Sequence[Mapping[str, Any]]) -> list[str]:
    """The same as a table of plain text."""
    rows = [HEAD, *profile_rows(profile)]
    wide = [max(len(row[column]) for row in rows) for column in range(len(HEAD))]
    return [
        "  ".join([row[0].ljust(wide[0]), *(cell.rjust(w) for cell, w in zip(row[1:], wide[1:], strict=True))]).rstrip()
        for row in rows
    ]


def _cells(name: str, seconds: float, total: float, calls: int, solves: int) -> tuple[str, ...]:
    share = f"{seconds / total:.1%}" if total else ""
    return name.replace("_", " "), f"{seconds:.3f}", share, str(calls or ""), str(solves or "")
