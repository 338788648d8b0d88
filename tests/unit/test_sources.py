"""solvers/SOURCES.md: every numbered equation of the source has its row, and every name in it exists."""

import re

import pytest

from shared.names import ROOT, definitions, named

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
