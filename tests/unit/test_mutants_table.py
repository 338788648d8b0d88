"""The table of `make mutants` names files, tests and functions that exist."""

import ast
import tomllib
from pathlib import Path

import pytest

from mutation.mutants import ROOT, TABLE, Mutant, Reason, reasons

MODULES = tomllib.loads(TABLE.read_text())


def functions(path: Path) -> set[str]:
    """Dotted names of the functions and methods in a file."""
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    found = set()
    for node in ast.parse(path.read_text()).body:
        inner = node.body if isinstance(node, ast.ClassDef) else []
        for each, prefix in [(node, ""), *((child, f"{getattr(node, 'name', '')}.") for child in inner)]:
            if isinstance(each, ast.FunctionDef):
                found.add(f"{module}.{prefix}{each.name}")
    return found


@pytest.mark.parametrize("module", MODULES["modules"])
def test_files_and_tests_exist(module: str) -> None:
    row = MODULES["modules"][module]
    assert set(row) == {"files", "tests"}
    for pattern in row["files"]:
        assert list(ROOT.glob(pattern)), pattern
    for test in row["tests"]:
        name, _, function = test.partition("::")
        assert (ROOT / name).exists(), test
        assert f"def {function}(" in (ROOT / name).read_text() if function else True, test


def test_each_reason_is_for_a_function_and_a_change() -> None:
    files = {path for row in MODULES["modules"].values() for pattern in row["files"] for path in ROOT.glob(pattern)}
    known = {name for path in files for name in functions(path)}
    for reason in reasons(MODULES):
        begin, star, _ = reason.function.partition("*")
        assert any(name.startswith(begin) if star else name == begin for name in known), reason
        assert reason.why


def test_a_reason_holds_for_its_line_alone() -> None:
    reason = Reason(function="a.b.c", was="x > 0", now=("x >= 0",), why="x is never 0")
    assert reason.holds(Mutant("a.b.c", "x > 0", "x >= 0"))
    for other in (("a.b.d", "x > 0", "x >= 0"), ("a.b.c", "y > 0", "x >= 0"), ("a.b.c", "x > 0", "x > 1")):
        assert not reason.holds(Mutant(*other))
    alike = Reason(function="a.*", like=r"x >= \d", why="x is never 0")
    assert alike.holds(Mutant("a.b.d", "x > 0", "x >= 3"))
    assert not alike.holds(Mutant("b.d", "x > 0", "x >= 3"))
    with pytest.raises(ValueError, match=r"a\.b: `now` or `like` says which changes"):
        Reason(function="a.b", why="so it is")
