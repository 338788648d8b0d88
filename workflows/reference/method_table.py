"""README's table of methods, written from the code: `python -m workflows.reference.method_table` renews it.

The column `when` is written by hand.
"""

from __future__ import annotations

import re
from pathlib import Path

from solvers.scene.applicability import METHODS, Applicability

README = Path(__file__).parents[2] / "README.md"
COLUMNS = ("normal laws", "friction", "operators", "bodies", "`solver.surface`")
HEAD = f"| `solver.method` | when | {' | '.join(COLUMNS)} |"
ROW = re.compile(r"^\| `([a-z-]+)` \| ([^|]*) \|.*$")


def renewed(text: str) -> str:
    """README with every method's row as the code has it; what stands in `when` is kept.

    Raises:
        ValueError: a method has no row.
    """
    before, table, after = _split(text)
    when = {found[1]: found[2] for line in table if (found := ROW.match(line))}
    if missing := [name for name in METHODS if name not in when]:
        raise ValueError(f"README's table of methods has no row for {', '.join(missing)}")
    rows = [f"| `{name}` | {when[name]} | {' | '.join(columns(method))} |" for name, method in METHODS.items()]
    return "\n".join([*before, HEAD, "|" + "---|" * (2 + len(COLUMNS)), *rows, *after])


def columns(method: Applicability) -> tuple[str, ...]:
    """What the method can do, a cell for each of `COLUMNS`.

    >>> columns(METHODS["regularised"])
    ('unilateral, bilateral, compliance', 'coulomb, tresca; no k_T', 'rigid; no sliding', 'held by supports',
     'condensed')
    """
    return (
        _known(method.normal),
        _known(method.friction) + ("" if method.k_T else "; no k_T"),
        _known(method.operators) + ("" if method.sliding else "; no sliding"),
        "held or floating" if method.floating else "held by supports",
        "any" if method.condensed and method.matrix_free else "condensed" if method.condensed else "matrix-free",
    )


def _known(names: tuple[str, ...] | None) -> str:
    return "all" if names is None else ", ".join(names)


def _split(text: str) -> tuple[list[str], list[str], list[str]]:
    """Lines before the table, of it, and after it."""
    lines = text.split("\n")
    first = next(k for k, line in enumerate(lines) if line.startswith("| `solver.method` |"))
    last = next(k for k in range(first, len(lines)) if not lines[k].startswith("|"))
    return lines[:first], lines[first:last], lines[last:]


if __name__ == "__main__":
    README.write_text(renewed(README.read_text(encoding="utf-8")), encoding="utf-8")
