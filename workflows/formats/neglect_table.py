"""The neglect report as people read it: a row for each effect, and the largest one beside each main number."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stickslip.geometry.arrays import SLIGHT

HEAD = ("effect", "number", "largest change", "1 % at", "largest at", "seconds")


def largest_neglected(content: Mapping[str, Any], name: str, value: float) -> str:
    """Effect that would change a number most; empty where none is known to do so by a thousandth.

    >>> largest_neglected({"neglect": [{"effect": "gravity", "changes": {"base.normal_force": 0.4}}]},
    ...     "base.normal_force", 10.0)
    'gravity 4 %'
    """
    changes = [(abs(row["changes"].get(name) or 0.0), row["effect"]) for row in content.get("neglect") or ()]
    size, effect = max(changes, default=(0.0, ""))
    return f"{effect} {100 * size / abs(value):.2g} %" if size > SLIGHT * abs(value) > 0 else ""


def neglect_rows(content: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows below `HEAD`, as result.json has them; no rows in results of earlier versions."""
    return [_cells(row) for row in content.get("neglect") or ()]


def neglect_lines(content: Mapping[str, Any]) -> list[str]:
    """The rows as lines of plain text."""
    told = ({head: cell for head, cell in zip(HEAD, row, strict=True) if cell != "–"} for row in neglect_rows(content))
    return [
        f"off: {', '.join(filter(None, (f'{key} {cell}' * bool(cell) for key, cell in row.items())))}" for row in told
    ]


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    where, changes = row["where"], {name: size for name, size in row["changes"].items() if size}
    name = max(changes, key=lambda key: abs(changes[key]), default="")
    at = f"{where['part']} ({', '.join(f'{x:.3g}' for x in where['point'])})" if where else ""
    reaches = ", ".join(f"{key}: {value:.2g}" for key, value in row["reaches"].items())
    number = "–" if row["number"] is None else f"{row['number']:.2g}"
    changed = f"{name} {changes[name]:.2g}" if name else "–"
    return row["effect"], number, changed, "; ".join(filter(None, (reaches, row["says"]))), at, f"{row['seconds']:.1g}"
