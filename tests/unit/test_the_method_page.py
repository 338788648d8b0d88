"""docs/the_method.md is true: its excerpts stand in the code, its names exist, and no equation is left out."""

import re
from textwrap import dedent

import pytest

from shared.names import ROOT, definitions, named

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
def test_every_name_exists(file: str, name: str) -> None:
    assert (ROOT / file).is_file()
    assert name in definitions(file)


def test_every_equation_of_the_source_has_a_place_or_is_said_not_to_be_used() -> None:
    listed = EQUATION.findall((ROOT / "solvers/SOURCES.md").read_text(encoding="utf-8"))
    assert listed
    assert EQUATION.findall(PAGE) == listed
    rows = [line for line in PAGE.splitlines() if EQUATION.match(line)]
    assert all(named(row) or NOT_USED in row for row in rows)
