"""What the house depends on is listed and pinned; mutants and sources name what exists."""

import ast
import re
import tomllib
from functools import cache
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest

from mutation.mutants import TABLE, Mutant, Reason, reasons
from stickslip.workflows.run.result import packages

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


def test_what_the_numbers_depend_on_is_listed_with_debians_versions() -> None:
    found = packages()
    for begin in ("libpetsc-real", "libdolfinx-real", "libmumps-", "libgmsh", "libopenblas0-pthread", "python3-gmsh"):
        assert any(name.startswith(begin) for name in found), begin
    assert found["numpy"] == np.__version__
    assert all(re.match(r"(\d+:)?\d+\.\d+", version) for version in found.values())
    assert not any(name.endswith(("-dev", "-doc")) for name in found)


def test_where_dolfinx_is_a_wheel_debians_packages_are_no_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stickslip.workflows.run.result.version", lambda name: f"1.0+{name}")
    found = packages.__wrapped__()
    assert found["dolfinx-solver-real"] == "1.0+dolfinx-solver-real"
    assert {"gmsh", "h5py", "mpich", "numpy"} < set(found)
    assert not any(name.startswith(("lib", "python3-")) for name in found)


@pytest.mark.parametrize(
    ("name", "least"), [("requirements", 40), ("requirements-docs", 60), ("requirements-mutants", 9)]
)
def test_every_package_of_pypi_is_pinned_with_a_hash(name: str, least: int) -> None:
    text = (ROOT / f"{name}.txt").read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert len(lines) >= least
    pin, sha256 = r'[a-z0-9-]+==[\w.]+(; python_version [<>=]+ "3.12")?', r" +--hash=sha256:[0-9a-f]{64}"
    for line in lines:
        assert re.fullmatch(f"{pin}({sha256})+", line), line


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
        name, _, function = test.removeprefix("--deselect=").partition("::")
        assert f"def {function.partition('[')[0]}" in (ROOT / name).read_text() if function else (ROOT / name).exists()


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


TEXT = (ROOT / "solvers/SOURCES.md").read_text(encoding="utf-8")
NUMBERED = {1: 3, 2: 6, 4: 5, 5: 7}  # Pop (1999): the last number of each section; those of its section 3 go on from 2
NAMES = named(TEXT)


def test_it_names_many_things() -> None:
    assert len(NAMES) > 30


@pytest.mark.parametrize(("file", "name"), NAMES)
def test_every_name_exists(file: str, name: str) -> None:
    assert (ROOT / file).is_file()
    assert name in definitions(file)


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


PAGE = (ROOT / "docs/the_method.md").read_text(encoding="utf-8")
EXCERPTS = re.findall(r"^([^\n]*)\n```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
EQUATION = re.compile(r"^\| (\(\d\.\d\)) \|", re.MULTILINE)
NOT_USED = "not used by this method"


def windows(text: str, size: int) -> list[str]:
    """All runs of `size` lines, without the indentation that they share."""
    lines = text.splitlines()
    return [dedent("\n".join(lines[k : k + size])) for k in range(len(lines) - size + 1)]


def test_every_block_of_python_is_an_excerpt() -> None:
    assert len(EXCERPTS) == PAGE.count("```python") > 8
    assert all(len(named(above)) == 1 for above, _ in EXCERPTS)


@pytest.mark.parametrize(("above", "excerpt"), EXCERPTS)
def test_every_excerpt_stands_in_what_the_line_above_names(above: str, excerpt: str) -> None:
    ((file, name),) = named(above)
    wanted = dedent(excerpt).rstrip("\n")
    assert 1 <= len(wanted.splitlines()) <= 12
    assert wanted in windows(definitions(file)[name], len(wanted.splitlines()))


@pytest.mark.parametrize(("file", "name"), named(PAGE))
def test_every_name_of_the_method_page_exists(file: str, name: str) -> None:
    assert (ROOT / file).is_file()
    assert name in definitions(file)


def test_every_equation_of_the_source_has_a_place_or_is_said_not_to_be_used() -> None:
    listed = EQUATION.findall((ROOT / "solvers/SOURCES.md").read_text(encoding="utf-8"))
    assert listed
    assert EQUATION.findall(PAGE) == listed
    rows = [line for line in PAGE.splitlines() if EQUATION.match(line)]
    assert all(named(row) or NOT_USED in row for row in rows)
