"""Expressions of place and time: what they are worth, and what is refused with its column."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.geometry.errors import SceneError
from stickslip.geometry.expression import DEEPEST, LONGEST, Expression, check_varying

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
