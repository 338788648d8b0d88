"""Any text as an expression is read as a formula or refused in one line; nothing of it is executed."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from shared.fuzzing import accepted, fuzzed
from stickslip.geometry.expression import CONSTANTS, FUNCTIONS, NAMES, Expression, check_varying

PIECES = [
    *NAMES, *FUNCTIONS, "+", "-", "*", "/", "**", "(", ")", ",", ".", " ", "1", "0", "2.5", "1e308", "1e-308", "1_0",
    "0x1", "1j", "9" * 50, "(" * 30, "-" * 30, "lambda", "if", "else", "and", "not", "for", "in", "await", "yield",
    "print", "__import__", "None", "True", "é", "[", "]", "{", ":", "=", "'", "#", "\\", "\n", "\0", "ｘ", "@", "%",
]  # fmt: skip
POINTS = np.array([[0.0, -1.0, 1e300], [1.0, 0.5, 2.0]])


def examined(text: str) -> None:
    def read() -> Expression:
        check_varying(text, "key")
        return Expression(text, dict.fromkeys(CONSTANTS, 0.3))

    expression = accepted(read)
    if expression is not None:
        assert expression.names <= {*NAMES}
        assert expression(POINTS, 0.5, 1.0).shape == (2,)


@fuzzed(40)
@given(st.lists(st.sampled_from(PIECES), max_size=30).map("".join))
def test_pieces_of_formulas(text: str) -> None:
    examined(text)


@fuzzed(10)
@given(st.text(max_size=500))
def test_any_text(text: str) -> None:
    examined(text)


leaves = st.one_of(st.sampled_from(NAMES), st.floats(0, allow_nan=False, allow_infinity=False).map(repr))
formulas = st.recursive(
    leaves,
    lambda part: st.one_of(
        st.tuples(part, st.sampled_from(["+", "-", "*", "/", "**"]), part).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        st.tuples(st.sampled_from(sorted(FUNCTIONS)), part).map(
            lambda t: f"{t[0]}({t[1]}, 1)" if t[0] in ("min", "max") else f"{t[0]}({t[1]})"
        ),
        part.map(lambda text: f"-{text}"),
    ),
    max_leaves=8,
)


@fuzzed(20)
@given(formulas)
def test_every_formula_is_read(text: str) -> None:
    """And is worth what Python says of the same text, where that is a real number."""
    check_varying(text, "key")
    points = np.full((1, 3), 2.0)
    values = {name: points[:, i] for i, name in enumerate("xyz")} | {
        name: np.float64(2.0) for name in ("t", *CONSTANTS)
    }
    with np.errstate(all="ignore"):
        try:
            expected = eval(text, {"__builtins__": {}}, values | {"pi": np.float64(np.pi), **FUNCTIONS})
        except (OverflowError, ZeroDivisionError):  # of Python's own numbers
            return
        found = Expression(f"{text} + 0*t", dict.fromkeys(CONSTANTS, 2.0))(points, 2.0, 1.0)
    if not isinstance(expected, complex):
        np.testing.assert_allclose(found, expected, rtol=1e-12)
