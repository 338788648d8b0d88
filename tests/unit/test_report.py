"""What the terminal shows: units stay in the heads, numbers are whole however narrow the window is."""

import io

import pytest
from rich.console import Console
from rich.table import Table

from stickslip.workflows.run.terminal import console, contact_cells, print_table

HEADS = ("contact", "normal force [N]", "touching [m²]", "max penetration [m]")
ROW = ("base", "-1.2346e-10", "1.2346e-06", "-6.9389e-17")


def printed(width: int) -> str:
    table = Table()
    for head in HEADS:
        table.add_column(head)
    table.add_row(*ROW)
    out = Console(file=io.StringIO(), width=width, highlight=False, markup=False)
    print_table(table, out)
    return out.file.getvalue()  # type: ignore[attr-defined]


def test_units_are_no_markup(capsys: pytest.CaptureFixture[str]) -> None:
    console(100).print("touching [m²], gap [m]")
    assert capsys.readouterr().out == "touching [m²], gap [m]\n"


@pytest.mark.parametrize("width", range(10, 90, 5))
def test_a_narrow_window_leaves_columns_out_and_cuts_no_number(width: int) -> None:
    text = printed(width)
    shown = [number for number in ROW if number in text]
    assert shown == list(ROW[: len(shown)])
    assert len(shown) == text.splitlines()[0].count("┳") + 1
    if width >= 15:
        assert "…" not in text
        assert max(map(len, text.splitlines())) <= width
    assert len(shown) == 4 or width < 60


def test_a_wide_window_keeps_heads_on_one_line() -> None:
    assert all(head in printed(90) for head in HEADS)


def test_a_penetration_of_rounding_is_zero() -> None:
    contact = {"max_penetration": 1e-17, "error": {"max_penetration": {"mesh": 2e-17, "converges": True}}}
    assert contact_cells(contact, ["max_penetration"], moved=0.1) == ["0"]
    assert contact_cells(contact, ["max_penetration"], moved=1e-6) == ["(1 ± 2)e-17*"]
