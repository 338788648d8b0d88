"""docs/folders.md, from the packages' docstrings: `python -m stickslip.workflows.lab.pages.folder_map` renews it.

A row is the first line of a package's docstring. What stands outside the two marker lines is written by hand.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "folders.md"
PACKAGES = ("geometry", "solvers", "workflows")
BEGIN = "<!-- folders: generated from the packages' docstrings, do not edit -->"
END = "<!-- end of folders -->"


def rows() -> Iterator[tuple[str, str]]:
    """Each package as `folder/` and the first line of its docstring; the face first.

    Raises:
        ValueError: a package says nothing, or its first line is no sentence on one line.
    """
    yield "stickslip/", first_line(ROOT / "stickslip" / "__init__.py")
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("__init__.py")):
            yield f"{path.parent.relative_to(ROOT).as_posix()}/", first_line(path)


def first_line(path: Path) -> str:
    """First line of a module's docstring, without the full stop.

    Raises:
        ValueError: there is none, or it does not end with a full stop.
    """
    line = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split("\n")[0]
    if not line.endswith("."):
        raise ValueError(f"{path}: the docstring's first line must be one sentence with a full stop; found {line!r}")
    return line[:-1]


def table() -> str:
    """The map as a table."""
    cells = [f"| `{folder}` | {line.replace('|', '/')} |" for folder, line in rows()]
    return "\n".join(["| folder | what it holds |", "|---|---|", *cells])


def renewed(text: str) -> str:
    """The page with the map as the packages have it.

    Raises:
        ValueError: a marker line is missing.
    """
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"the map lacks the lines {BEGIN} and {END}, between which the map stands")
    return f"{before}{begin}\n{table()}\n{end}{after}"


if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
