"""solvers/SOURCES.md: every numbered equation of the source has its row, and every name in it exists."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "solvers/SOURCES.md").read_text(encoding="utf-8")
NUMBERED = {1: 3, 2: 6, 4: 5, 5: 7}  # Pop (1999): the last number of each section; those of its section 3 go on from 2
NAMES = sorted(set(re.findall(r"`([^`\s]+)::([^`\s]+)`", TEXT)))


@cache
def names_in(path: Path) -> frozenset[str]:
    """All that a file defines: name, and Class.name."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return frozenset(_defined(tree.body, ""))


def _defined(body: list[ast.stmt], prefix: str) -> list[str]:
    found: list[str] = []
    for node in body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            found.append(prefix + node.name)
        if isinstance(node, ast.ClassDef):
            found += _defined(node.body, f"{prefix}{node.name}.")
        assigned = getattr(node, "targets", [getattr(node, "target", None)])
        found += [prefix + target.id for target in assigned if isinstance(target, ast.Name)]
    return found


def test_it_names_many_things() -> None:
    assert len(NAMES) > 30


@pytest.mark.parametrize(("file", "name"), NAMES)
def test_every_name_exists(file: str, name: str) -> None:
    assert (ROOT / file).is_file()
    assert name in names_in(ROOT / file)


def test_what_stands_in_code_type_is_such_a_name() -> None:
    """A name in another form would not be held to exist."""
    assert set(re.findall(r"`([^`]+)`", TEXT)) == {"::".join(pair) for pair in NAMES}


def test_every_numbered_equation_has_one_row_with_a_place() -> None:
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in TEXT.splitlines() if line.startswith("| ")]
    assert {len(row) for row in rows} == {3}
    numbered = [row for row in rows if re.fullmatch(r"\(\d\.\d\)", row[0].strip())]
    expected = [f"({section}.{k})" for section, last in NUMBERED.items() for k in range(1, last + 1)]
    assert sorted(row[0].strip() for row in numbered) == expected
    assert all("::" in row[1] and row[2].strip() for row in numbered)
