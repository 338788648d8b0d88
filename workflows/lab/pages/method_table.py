"""The table of methods in docs, from the classes: renewed by `python -m stickslip.workflows.lab.pages.method_table`."""

from __future__ import annotations

from pathlib import Path

from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.methods.method import Applicability

PAGE = Path(__file__).resolve().parents[3] / "docs" / "theory" / "methods.md"
COLUMNS = ("normal laws", "friction", "operators", "bodies", "`solver.surface`")
HEAD = f"| `solver.method` | when | {' | '.join(COLUMNS)} |"


def renewed(text: str) -> str:
    """The page with every method's row as its class has it."""
    before, after = _split(text)
    rows = [
        f"| `{name}` | {method.WHEN} | {' | '.join(columns(method.WORKS_WITH))} |" for name, method in METHODS.items()
    ]
    return "\n".join([*before, HEAD, "|" + "---|" * (2 + len(COLUMNS)), *rows, *after])


def columns(method: Applicability) -> tuple[str, ...]:
    """Abilities of the method, a cell for each of `COLUMNS`.

    >>> columns(METHODS["regularised"].WORKS_WITH)
    ('unilateral, bilateral, compliance', 'coulomb, tresca; no k_T', 'rigid', 'held by supports',
     'condensed or matrix-free')
    """
    return (
        _known(method.normal),
        _known(method.friction) + ("" if method.k_T else "; no k_T") + ("" if method.rates else "; none by rate"),
        _known(method.operators),
        f"held or floating{'' if method.driven else '; no driven obstacles'}"
        if method.floating
        else f"held by supports{' or compliance' if method.bedded else ''}",
        " or ".join(form for form in ("condensed", "matrix-free") if getattr(method, form.replace("-", "_"))) or "-",
    )


def _known(names: tuple[str, ...] | None) -> str:
    return "all" if names is None else ", ".join(names)


def _split(text: str) -> tuple[list[str], list[str]]:
    """Lines before the table, and after it."""
    lines = text.split("\n")
    first = next(k for k, line in enumerate(lines) if line.startswith("| `solver.method` |"))
    last = next(k for k in range(first, len(lines)) if not lines[k].startswith("|"))
    return lines[:first], lines[last:]


if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
