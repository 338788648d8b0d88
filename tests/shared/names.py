"""Names in pages, written as path::name in code type: which there are, and the lines that define them."""

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def named(text: str) -> list[tuple[str, str]]:
    """All pairs of file and name in a page."""
    return sorted(set(re.findall(r"`([^`\s]+)::([^`\s]+)`", text)))


@cache
def definitions(file: str) -> dict[str, str]:
    """What a file defines, name and Class.name, with the lines of each."""
    text = (ROOT / file).read_text(encoding="utf-8")
    lines = text.splitlines()
    return {name: "\n".join(lines[first - 1 : last]) for name, first, last in _defined(ast.parse(text).body, "")}


def _defined(body: list[ast.stmt], prefix: str) -> list[tuple[str, int, int]]:
    found: list[tuple[str, int, int]] = []
    for node in body:
        first, last = node.lineno, node.end_lineno or node.lineno
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            found.append((prefix + node.name, first, last))
        if isinstance(node, ast.ClassDef):
            found += _defined(node.body, f"{prefix}{node.name}.")
        assigned = getattr(node, "targets", [getattr(node, "target", None)])
        found += [(prefix + target.id, first, last) for target in assigned if isinstance(target, ast.Name)]
    return found
