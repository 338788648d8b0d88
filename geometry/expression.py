"""Expressions of place and time that a user writes, such as "-0.2*E*sin(pi*x/2)": read as formulas, never executed."""

from __future__ import annotations

import ast
import re
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property, partial, reduce
from typing import Any

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check, value_at
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError, nearest, shortened

Varying = Amplitude | str  # a value in time, or an expression of place and time
FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "exp": np.exp, "sqrt": np.sqrt, "log": np.log, "abs": np.abs,
    "min": np.minimum, "max": np.maximum,
}  # fmt: skip
AXES = (("E", (1, 2, 3)), ("G", (12, 13, 23)), ("nu", (12, 13, 23)))  # of orthotropic bodies
OF_SEVERAL = ("min", "max")
CONSTANTS = ("E", "nu", *(f"{kind}_{axes}" for kind, found in AXES for axes in found))
RATE = "V"  # the slip rate [m/s], in friction laws alone
NAMES = ("x", "y", "z", "t", "pi", RATE, *CONSTANTS)
LONGEST, DEEPEST = 400, 40  # characters of an expression, operations within each other
FOREIGN = re.compile(r"[^A-Za-z0-9_ .+\-*/(),]")
OPERATORS: Mapping[type[ast.AST], Callable[..., Any]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
    ast.UAdd: lambda a: a,
    ast.USub: lambda a: -1 * a,
}


@dataclass(frozen=True)
class Expression:
    """An expression that was read, with the constants that it may name."""

    text: str
    constants: Mapping[str, float] = field(default_factory=dict)  # those of `CONSTANTS` that the body has

    @cached_property
    def _tree(self) -> ast.expr:
        return _read(self.text)

    @cached_property
    def names(self) -> frozenset[str]:
        """Names of variables and constants in it."""
        return frozenset(node.id for node in ast.walk(self._tree) if isinstance(node, ast.Name)) - FUNCTIONS.keys()

    @property
    def numbers(self) -> frozenset[float]:
        """Numbers that are written in it."""
        values = (node.value for node in ast.walk(self._tree) if isinstance(node, ast.Constant))
        return frozenset(float(value) for value in values if isinstance(value, int | float))

    @property
    def in_time(self) -> bool:
        """Whether it says how it changes in time; otherwise it is ramped like a number."""
        return "t" in self.names

    def ramp(self, time: float, end: float) -> float:
        """Factor of the formula at a time [s]."""
        return 1.0 if self.in_time else value_at(1.0, time, end)

    def __call__(self, points: Array, time: float, end: float) -> Array:
        """Values (m,) at points (m, d) [m] at a time [s]; inf or NaN where it has none.

        Args:
            end: when an expression without t is reached [s].

        >>> Expression("E*x**2", {"E": 2.0})(np.array([[3.0, 0.0]]), time=0.5, end=1.0)
        array([9.])
        >>> Expression("x + t")(np.array([[3.0, 0.0]]), time=0.5, end=1.0)
        array([3.5])
        """
        with np.errstate(all="ignore"):
            values = dict(zip("xyz", points.T, strict=False)) | {"t": np.float64(time)}
            found = self.build(values, np.float64, FUNCTIONS)
            found = found * self.ramp(time, end)
        return np.broadcast_to(np.asarray(found, float), len(points))

    def build(
        self, values: Mapping[str, Any], number: Callable[[float], Any], functions: Mapping[str, Callable[..., Any]]
    ) -> Any:
        """The same formula of other objects.

        Args:
            values: for x, y, z and t.
            number: makes a number one of the objects.
            functions: by the names of FUNCTIONS; min and max of two.
        """
        known = {**values, **{name: number(value) for name, value in self.constants.items()}, "pi": number(np.pi)}
        return _built(self._tree, known, number, functions)


def _built(
    node: ast.expr,
    known: Mapping[str, Any],
    number: Callable[[float], Any],
    functions: Mapping[str, Callable[..., Any]],
) -> Any:
    of = partial(_built, known=known, number=number, functions=functions)
    match node:
        case ast.Constant(value=int() | float() as value):
            return number(float(value))
        case ast.Name(id=name):
            return known[name]
        case ast.UnaryOp(op=op, operand=one):
            return OPERATORS[type(op)](of(one))
        case ast.BinOp(left=left, op=op, right=right):
            return OPERATORS[type(op)](of(left), of(right))
        case ast.Call(func=ast.Name(id=name), args=args):
            parts = [of(arg) for arg in args]
            return reduce(functions[name], parts) if name in OF_SEVERAL else functions[name](*parts)
    raise AssertionError(node)


def check_varying(value: Varying, key: str) -> None:
    """Refuse a wrong value in time, see `amplitude.check`, or a text that is no expression.

    Raises:
        SceneError: for an expression with the column of what is wrong.
    """
    if not isinstance(value, str):
        check(value, key)
        return
    try:
        _read(value)
    except _WrongError as wrong:
        raise SceneError(f'{key} = "{shortened(value)}": column {wrong.column}: {wrong}') from None


class _WrongError(Exception):
    """Error in an expression."""

    def __init__(self, column: int, text: str) -> None:
        super().__init__(text)
        self.column = column  # from 1


@cache
def _read(text: str) -> ast.expr:
    """The tree of an expression, with nothing in it but what `Expression.build` knows.

    Raises:
        _WrongError: it is none.
    """
    foreign = FOREIGN.search(text)
    if len(text) > LONGEST:
        raise _WrongError(LONGEST + 1, f"longer than {LONGEST} characters")
    if foreign:
        hint = "; a power is written **" if foreign.group() == "^" else ""
        raise _WrongError(foreign.start() + 1, f"{foreign.group()!r} has no place in an expression{hint}")
    body = text.lstrip()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # of Python: a name that follows a number without a space
            tree = ast.parse(body, mode="eval").body
    except (SyntaxError, Warning) as error:
        column = getattr(error, "offset", None) or len(body) + 1  # Python has none at the end
        reason = error.msg if isinstance(error, SyntaxError) else str(error)
        raise _WrongError(column + len(text) - len(body), reason) from None
    except (ValueError, MemoryError, RecursionError) as error:
        raise _WrongError(1, str(error) or "too many operations within each other") from None
    _refuse(tree, len(text) - len(body) + 1, DEEPEST)
    return tree


def _refuse(node: ast.AST, first: int, deepest: int) -> None:
    """Refuse all but numbers, known names, operators and functions.

    Args:
        node: of the tree.
        first: column of the first character.
        deepest: operations within each other that are left.
    """
    column, parts = first + getattr(node, "col_offset", 0), list[ast.expr]()
    if deepest == 0:
        raise _WrongError(column, f"more than {DEEPEST} operations within each other")
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            if not abs(value) <= sys.float_info.max:
                raise _WrongError(column, "a number that is too large")
        case ast.Name(id=name):
            if name in FUNCTIONS:
                raise _WrongError(column, f"{name} needs its value in parentheses")
            if name not in NAMES:
                raise _WrongError(column, f"{shortened(name, 20)} is not known; {nearest(name, (*NAMES, *FUNCTIONS))}")
        case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=one):
            parts = [one]
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div() | ast.Pow(), right=right):
            parts = [left, right]
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
            _refuse_call(name, len(args), column)
            parts = args
        case _:
            raise _WrongError(column, "only numbers, + - * / **, parentheses, known names and functions are allowed")
    for part in parts:
        _refuse(part, first, deepest - 1)


def _refuse_call(name: str, count: int, column: int) -> None:
    """Refuse an unknown function, or one with a wrong number of values."""
    if name not in FUNCTIONS:
        raise _WrongError(column, f"{shortened(name, 20)} is no function; {nearest(name, FUNCTIONS)}")
    if count < 2 if name in OF_SEVERAL else count != 1:
        needed = "at least two values" if name in OF_SEVERAL else "one value"
        raise _WrongError(column, f"{name} needs {needed}")
