"""Values in time and place are numbers, tables and expressions, hit where they turn."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from stickslip.geometry.amplitude import Amplitude, check, listed_times, turns, value_at
from stickslip.geometry.errors import SceneError
from stickslip.geometry.expression import DEEPEST, LONGEST, Expression, check_varying
from stickslip.solvers.scene.loads import Load


def test_a_bare_number_is_ramped_from_zero_and_held_after_the_end() -> None:
    assert [value_at(-3.0, t, end=2.0) for t in (0.0, 0.5, 2.0, 9.0)] == [0.0, -0.75, -3.0, -3.0]
    assert value_at(2, 1.0, end=2.0) == 1.0  # an integer is a number
    assert listed_times(4.0) == ()


def test_a_table_starts_from_zero_unless_it_lists_time_zero() -> None:
    table = ((1.0, 4.0), (3.0, -2.0))
    assert [value_at(table, t, end=99.0) for t in (0.0, 0.25, 1.0, 2.0, 3.0, 50.0)] == [0.0, 1.0, 4.0, 1.0, -2.0, -2.0]
    preload = ((0.0, 5.0), (2.0, 6.0))
    assert [value_at(preload, t, end=99.0) for t in (0.0, 1.0, 3.0)] == [5.0, 5.5, 6.0]


@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=6, unique=True), st.data())
def test_a_table_is_hit_at_its_times_and_stays_between_its_values(times: list[float], data: st.DataObject) -> None:
    values = data.draw(st.lists(st.floats(-1e6, 1e6), min_size=len(times), max_size=len(times)))
    table = tuple(zip(sorted(times), values, strict=True))
    check(table, "x")
    assert listed_times(table) == tuple(sorted(times))
    assert [value_at(table, t, end=1.0) for t, _ in table] == values
    between = value_at(table, data.draw(st.floats(0.0, 2e6)), end=1.0)
    slack = 1e-9 * max(map(abs, values))  # interpolation rounds
    assert min(0.0, *values) - slack <= between <= max(0.0, *values) + slack


@pytest.mark.parametrize("table", [((1.0, 0.0), (1.0, 2.0)), ((2.0, 0.0), (1.0, 2.0)), ((-1.0, 0.0),)])
def test_times_that_do_not_increase_from_zero_are_refused(table: tuple[tuple[float, float], ...]) -> None:
    with pytest.raises(SceneError, match=r"pressure = \[.*\]: times must increase, from 0 or later"):
        check(table, "pressure")


def test_an_empty_table_is_refused() -> None:
    with pytest.raises(SceneError, match=r"pressure = \[\]: a table needs at least one \[time, value\]"):
        check((), "pressure")


def test_a_straight_line_in_many_pieces_has_no_turn_inside() -> None:
    x = [0.1 * k / 7 for k in range(1, 1001)]
    line = tuple((k / 3, value) for k, value in enumerate(x, start=1))
    assert turns(line, end=1000.0) == (0.0, line[-1][0])
    bent = (*line, (1001 / 3, x[-1]), (1002 / 3, x[-1] + 1e-3))
    assert turns(bent, end=1000.0) == (0.0, line[-1][0], 1001 / 3, 1002 / 3)
    assert turns(((0.0, 5.0), (1.0, 5.0)), end=1.0) == ()  # it jumps there, and then it stays
    assert turns(0.0, end=2.0) == ()


def column(folder: Path, text: str, column: str = "p") -> Amplitude:
    """Pressure of a load that is read from a CSV file with this text."""
    (folder / "p.csv").write_text(text, encoding="utf-8")
    keys: Any = {"csv": folder / "p.csv", "time": "t", "column": column}
    pressure = Load(boundary="block.top", pressure=keys).pressure
    assert pressure is not None
    assert not isinstance(pressure, str)
    return pressure


def test_a_column_of_a_csv_file_is_the_table_written_out(tmp_path: Path) -> None:
    text = '\ufefft, "p" ,q\r\n0,1e3,high\r\n\r\n 0.5 ,-2.5,\r\n1e1,0\r\n'
    assert column(tmp_path, text) == ((0.0, 1000.0), (0.5, -2.5), (10.0, 0.0))


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        ("", "p", "csv = .*p.csv: is empty; expected a line with the names of columns"),
        ("t,p\n", "p", "has no rows"),
        ("t,p\n0,1\n", "P", r"column = P: p.csv has no such column; did you mean p\?"),
        ("t,p,p\n0,1,2\n", "p", "several columns of this name"),
        ("t,p\n0,1\n1,one\n", "p", 'p.csv, line 3: "one" in column p is no finite number'),
        ("t,p\n0,1\n1,nan\n", "p", 'line 3: "nan" in column p'),
        ("t,p\n0,1\ninf,1\n", "p", 'line 3: "inf" in column t'),
        ("t,p\n0,1\n1\n", "p", 'line 3: "" in column p'),
        ("t,p\n0,1\n1,5,2,5\n", "p", "line 3: more cells than names in the first line; is there a decimal comma"),
        ("t,p\n0,1\n2,1\n2,3\n", "p", "line 4: times must increase, from 0 or later; found 2"),
        ('t,p\n0,1\n1,"' + "2,3\n" * 60_000, "p", r"p.csv: line 3: field larger than .*; is a quote not closed\?"),
        ("t,p\n-1,1\n", "p", "line 2: times must increase, from 0 or later; found -1"),
    ],
)
def test_a_wrong_csv_file_is_refused_with_one_line(text: str, name: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=said) as caught:
        column(tmp_path, text, name)
    assert str(caught.value).startswith("pressure.")
    assert len(caught.value.lines) == 1


def test_what_is_no_csv_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_bytes(b"t,p\n\xff\xfe")
    for keys, said in (
        ({"csv": tmp_path / "p.csv"}, "not a text file in UTF-8"),
        ({"csv": tmp_path}, "is a folder"),
        ({"csv": tmp_path / "q.csv"}, "no such file"),
        ({"csv": "p" * 300}, "csv = pp.*: cannot be read: File name too long"),
        ({"csv": 3}, "expected a text"),
        ({"csv": "p.csv", "colum": "p"}, r"colum: unknown key; did you mean column\?"),
    ):
        wrong: Any = {"time": "t", "column": "p"} | keys
        with pytest.raises(SceneError, match=said):
            Load(boundary="block.top", pressure=wrong)


POINTS = np.random.default_rng(1).random((5, 3)) + 0.1
X, Y, Z = POINTS.T
T, END, E, NU = 0.25, 2.0, 200.0, 0.3


def value(text: str) -> np.ndarray:
    return Expression(text, {"E": E, "nu": NU})(POINTS, T, END)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("t*(-0.2*E*sin(pi*x/2))", T * -0.2 * E * np.sin(math.pi * X / 2)),
        ("  2*x - -y**2 / z + t*0", 2 * X + Y**2 / Z),
        ("-x**2 + t", -(X**2) + T),  # a power binds stronger than the sign
        ("2**3**x*t", 2 ** (3**X) * T),
        ("min(x, y, 0.5) + max(z, nu)*t", np.minimum(np.minimum(X, Y), 0.5) + np.maximum(Z, NU) * T),
        ("tan(x) + exp(-y) + sqrt(z) + log(x) + abs(y-1) + cos(t)",
         np.tan(X) + np.exp(-Y) + np.sqrt(Z) + np.log(X) + np.abs(Y - 1) + math.cos(T)),
        ("1e-3*t", np.full(5, 1e-3 * T)),
    ],
)  # fmt: skip
def test_values_are_those_of_numpy(text: str, expected: np.ndarray) -> None:
    check_varying(text, "key")
    assert_allclose(value(text), expected, rtol=1e-14)


def test_without_t_it_is_ramped_like_a_number() -> None:
    assert_allclose(value("x"), X * T / END)
    assert_allclose(Expression("x")(POINTS, 3 * END, END), X)
    assert_allclose(value("x + 0*t"), X)


def test_what_has_no_finite_value_is_inf_or_nan_without_a_warning() -> None:
    found = [value(text)[0] for text in ("1/(x-x)", "log(-x)", "(-x)**0.5", "10.0**400", "exp(1000)", "1/0")]
    assert not np.isfinite(found).any()


@pytest.mark.parametrize(
    ("text", "column", "reason"),
    [
        ("", 1, "invalid syntax"),
        ("2*x +", 6, "invalid syntax"),
        ("  (x", 3, "never closed"),
        ("x^2", 2, r"'\^' has no place in an expression; a power is written \*\*"),
        ("x + y[0]", 6, r"'\[' has no place"),
        ("x\ny", 2, "has no place"),
        ("x + q", 5, "q is not known; known: E"),
        ("1 + sine(x)", 5, r"sine is no function; did you mean sin\?"),
        ("sin", 1, "needs its value in parentheses"),
        ("x + sin(x, y)", 5, "sin needs one value"),
        ("max(x)", 1, "max needs at least two values"),
        ("x.real", 1, "only numbers"),
        ("x*(1).real", 3, "only numbers"),
        ("True", 1, "only numbers"),
        ("1j", 1, "only numbers"),
        ("x if y else z", 1, "only numbers"),
        ("x or y", 1, "only numbers"),
        ("x // y", 1, "only numbers"),
        ("sin(*x)", 5, "only numbers"),
        ("x, y", 1, "only numbers"),
        ("__import__(x)", 1, "is no function"),
        ("x + 1e999", 5, "too large"),
        ("9" * 399, 1, "too large"),
        ("x" * (LONGEST + 1), LONGEST + 1, f"longer than {LONGEST}"),
        ("-" * 60 + "x", DEEPEST + 1, "operations within each other"),
        ("(" * 300 + "x" + ")" * 300, LONGEST + 1, "longer than"),
        ("+".join("x" * 60), 1, "operations within each other"),
    ],
)
def test_what_is_wrong_is_named_with_its_column(text: str, column: int, reason: str) -> None:
    with pytest.raises(SceneError, match=rf"^key = .*: column {column}: .*{reason}"):
        check_varying(text, "key")


@pytest.mark.parametrize("text", ["1or 2", "0xfor x", "01", "1if x else 2", "..."])
def test_what_python_only_warns_of_is_refused(text: str) -> None:
    with pytest.raises(SceneError, match=r"^key = .*: column \d+: "):
        check_varying(text, "key")
