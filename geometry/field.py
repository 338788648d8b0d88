"""A field over a side: one number, a value in time, an expression of place and time, or a map of heights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic_core import PydanticKnownError, core_schema

from stickslip.geometry.amplitude import Amplitude, Table, check, header_of, read_csv, rows_of, value_at
from stickslip.geometry.arrays import ROUNDING, Array, Bools
from stickslip.geometry.errors import SceneError, nearest, require
from stickslip.geometry.expression import Expression, Varying, check_varying
from stickslip.geometry.keys import Key, Noun

AXES = ("x", "y", "z")
KEYS = ("csv", "over", "height", "plus")


@dataclass(frozen=True, kw_only=True)
class HeightMap(Noun):
    """Values over places along one or two axes, on a grid or scattered, with a smooth cubic in between.

    Source: Akima, J. ACM 17 (1970), along one axis; splines on a grid; Clough & Tocher (1965), scattered; by scipy.
    """

    over: Annotated[tuple[str, ...], Key("-", "axes x, y, z that the places are along: one or two")]
    rows: Annotated[tuple[tuple[float, ...], ...], Key("m", "[place, height], or [place, place, height]")]
    plus: Annotated[Amplitude, Key("m", "added everywhere; a number: at all times")] = 0.0

    def __post_init__(self) -> None:
        require(self.over in _choices(), "over", list(self.over), "expected one or two of x, y, z")
        check(self.plus, "plus")
        count = len(self.over) + 1
        wrong = next((row for row in self.rows if len(row) != count), None)
        require(wrong is None, "rows", list(wrong or ()), f"expected rows of {count} numbers, the height last")
        places = [row[:-1] for row in self.rows]
        require(len(set(places)) == len(places), "rows", len(places), "rows; a place is listed twice")
        if len(places) < count or np.linalg.matrix_rank(np.array(places) - places[0]) < len(self.over):
            raise SceneError(f"rows: {len(self.rows)} places do not span {', '.join(self.over)}")

    @cached_property
    def _interpolate(self) -> Callable[[Array], Array]:
        from scipy.interpolate import (
            Akima1DInterpolator,
            CloughTocher2DInterpolator,
            RectBivariateSpline,
            make_interp_spline,
        )

        table = np.array(sorted(self.rows))
        places, heights = table[:, :-1], table[:, -1]
        axes = [np.unique(column) for column in places.T]
        if len(axes) == 1:
            few = len(table) == 2  # a straight line
            line = make_interp_spline(places[:, 0], heights, k=1) if few else Akima1DInterpolator(places[:, 0], heights)
            return lambda at: np.where(self._inside(at), line(at[:, 0]), np.nan)
        if np.prod([len(axis) for axis in axes]) == len(table):  # sorted rows of a full grid are in its order
            orders = {f"k{axis}": min(3, len(each) - 1) for axis, each in zip("xy", axes, strict=True)}
            grid = RectBivariateSpline(*axes, heights.reshape([len(axis) for axis in axes]), **orders)
            return lambda at: np.where(self._inside(at), grid(*at.T, grid=False), np.nan)
        scattered = CloughTocher2DInterpolator(places, heights, rescale=True)
        return lambda at: np.asarray(scattered(at))

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        places = np.array([row[:-1] for row in self.rows])
        return places.min(axis=0), places.max(axis=0)

    def _inside(self, at: Array) -> Bools:
        low, high = self._box
        return np.asarray(((low <= at) & (at <= high)).all(axis=1))

    def heights(self, points: Array) -> Array:
        """Heights (m,) [m] at points (m, d), without `plus`; NaN outside the map."""
        middle = sum(self._box) / 2
        return self._interpolate(middle + (self._along(points) - middle) * (1 - ROUNDING))  # its edge lies inside

    def _along(self, points: Array) -> Array:
        return points[:, [AXES.index(axis) for axis in self.over]]

    def clipped(self, points: Array) -> Array:
        """Points (m, d) [m], those beyond the map moved to its edge."""
        found, columns = points.copy(), [AXES.index(axis) for axis in self.over]
        found[:, columns] = np.clip(points[:, columns], *self._box)
        return found

    def __call__(self, points: Array, key: str) -> Array:
        """The same where all points lie in the map; the key is named in errors.

        Raises:
            SceneError: a point lies outside the map.

        >>> HeightMap(over=("x",), rows=((0.0, 0.0), (2.0, 4.0)))(np.array([[0.5, 7.0]]), "gap")
        array([1.])
        """
        found, at, (low, high) = self.heights(points), self._along(points), self._box
        outside = np.flatnonzero(np.isnan(found))
        if len(outside):
            where = ", ".join(f"{axis} = {x:.6g}" for axis, x in zip(self.over, at[outside[0]], strict=True))
            reach = ", ".join(f"{a} {x:.6g} to {y:.6g}" for a, x, y in zip(self.over, low, high, strict=True))
            raise SceneError(f"{key}: the map has no height at {where}; its places are {reach}")
        return found


def _choices() -> tuple[tuple[str, ...], ...]:
    return (*((axis,) for axis in AXES), *((a, b) for a in AXES for b in AXES if a != b))


class FieldTable:
    """Beside a type: a table is a `HeightMap`, or names a CSV file with one, or with a value in time."""

    @staticmethod
    def __get_pydantic_core_schema__(source: Any, handler: Callable[[Any], Any]) -> Any:
        return core_schema.no_info_plain_validator_function(_accepted)

    @staticmethod
    def __get_pydantic_json_schema__(schema: Any, handler: Callable[[Any], Any]) -> dict[str, Any]:
        keys = "{ csv, over, height, plus }, { over, rows, plus } or { csv, time, column }"
        return {"type": "object", "description": keys}


def _accepted(value: Any) -> HeightMap | Table:
    if isinstance(value, HeightMap):
        return value
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise PydanticKnownError("tuple_type")
    if "csv" not in value:
        return HeightMap(**value)
    return read_csv(value) if "time" in value else read_map(value)


def read_map(keys: Mapping[str, Any]) -> HeightMap:
    """Read a map of heights from a CSV file whose columns of places are named x, y, z.

    Args:
        keys: `csv`, a path, relative to the working folder; `over`, axes: absent, all other columns in their order;
            `height`, a column: absent, the last one; `plus`.

    Raises:
        SceneError: key, value, what is expected.
    """
    for key in keys:
        if key not in KEYS:
            raise SceneError(f"{key}: unknown key; {nearest(key, KEYS)}")
    for key in ("csv", "height"):
        require(isinstance(keys.get(key, ""), str), key, keys.get(key), "expected a text, in quotes")
    path = Path(keys["csv"])
    header = header_of(path)
    height = keys.get("height", header[-1] if header else "")
    chosen = keys.get("over", [name for name in header if name != height])
    over = tuple(chosen) if isinstance(chosen, list | tuple) else (chosen,)
    names = {**{f"over.{k}": axis for k, axis in enumerate(over)}, "height": height}
    require(over in _choices(), "over", list(over), f"expected one or two of x, y, z, columns of {path.name}")
    rows = tuple(row for _, row in rows_of(path, names))
    require(len(rows) > 0, "csv", path, "has no rows below the names of its columns")
    return HeightMap(over=over, rows=rows, plus=keys.get("plus", 0.0))


Field = float | Table | str | Annotated[HeightMap, FieldTable]
"""A number holds at all times; a table is linear in time; an expression may name x, y, z, t."""


def check_field(value: Field, key: str) -> None:
    """Refuse a table whose times do not increase, or a text that is no expression."""
    if not isinstance(value, HeightMap):
        check_varying(value, key)


def in_time(value: Field, key: str) -> dict[tuple[str, ...], Varying]:
    """What of a field changes in time, a table or an expression with t, by its key and component."""
    if isinstance(value, HeightMap):
        return {(key, "plus"): value.plus} if isinstance(value.plus, tuple) else {}
    if isinstance(value, str):
        return {(key,): value} if Expression(value).in_time else {}
    return {(key,): value} if isinstance(value, tuple) else {}


def number(field: Field) -> float:
    """The number that a field is, where no other one may come."""
    assert isinstance(field, float | int), "a field has `values` at points"
    return field


def values(field: Field, key: str, points: Array, time: float, end: float) -> Array:
    """Values (m,) of a field at points (m, d) [m] at a time [s]; of one that has no place, as one number ().

    Args:
        key: in the scene.
        end: last time of the scene [s].

    Raises:
        SceneError: it has no finite value at a point.
    """
    if isinstance(field, HeightMap):
        return field(points, key) + values(field.plus, key, points, time, end)
    if isinstance(field, float | int):
        return np.asarray(field, float)
    if not isinstance(field, str):
        return np.asarray(value_at(field, time, end))
    formula = Expression(field)
    found = formula(points, time if formula.in_time else end, end)
    wrong = ~np.isfinite(found)
    if wrong.any():
        at = ", ".join(f"{x:.6g}" for x in points[np.argmax(wrong)])
        raise SceneError(f'{key} = "{field}": has no finite value at the point ({at}) at t = {time:g}')
    return found
