"""A value in time: a number ramped from zero, or a table that is piecewise linear, written out or in a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic_core import PydanticKnownError, core_schema

from stickslip.geometry.arrays import ROUNDING
from stickslip.geometry.errors import SceneError, nearest, require, require_known, shortened

COLUMNS = {"csv": "a file with a line of names", "time": "its column of times", "column": "its column of values"}
LONGEST = 2**26  # characters of a CSV file


class FromCsv:
    """Beside a type: the value may be a table { csv, time, column }, and is read from there; then it is written out."""

    @staticmethod
    def __get_pydantic_core_schema__(source: Any, handler: Callable[[Any], Any]) -> Any:
        def accept(value: Any) -> Any:
            if not isinstance(value, Mapping) or "csv" not in value:
                raise PydanticKnownError("tuple_type")
            return read_csv(value)

        return core_schema.no_info_plain_validator_function(accept)

    @staticmethod
    def __get_pydantic_json_schema__(schema: Any, handler: Callable[[Any], Any]) -> dict[str, Any]:
        keys = {key: {"type": "string", "description": meaning} for key, meaning in COLUMNS.items()}
        return {"type": "object", "properties": keys, "required": list(COLUMNS), "additionalProperties": False}


Table = tuple[tuple[float, float], ...]
Amplitude = float | Table | Annotated[Table, FromCsv]


def read_csv(keys: Mapping[str, Any]) -> Table:
    """Read the table of a value in time from two columns of a CSV file.

    Args:
        keys: `csv`, a path, relative to the working folder, and `time` and `column`, names in the file's first line.

    Raises:
        SceneError: key, value, what is expected.
    """
    for key in keys:
        if key not in COLUMNS:
            raise SceneError(f"{key}: unknown key; {nearest(str(key), COLUMNS)}")
    for key, meaning in COLUMNS.items():
        if key not in keys:
            raise SceneError(f"{key}: missing, {meaning}")
        require(isinstance(keys[key], str), key, keys[key], "expected a text, in quotes")
    path = Path(keys["csv"])
    table = tuple(_rows(path, keys["time"], keys["column"]))
    require(len(table) > 0, "csv", path, "has no rows below the names of its columns")
    return table


def _rows(path: Path, *names: str) -> Iterator[tuple[float, float]]:
    """Time and value of each row; the keys of `COLUMNS` are named where something is wrong."""
    last = -1.0
    for line, (time, value) in rows_of(path, dict(zip(("time", "column"), names, strict=True))):
        rises = time > last if last >= 0 else time >= 0
        require(rises, "csv", path, f"{line}: times must increase, from 0 or later; found {time:g}")
        last = time
        yield time, value


def header_of(path: Path) -> list[str]:
    """Names in the first line of a CSV file."""
    return [name.strip() for name in next(_lines(path), ("", []))[1]]


def rows_of(path: Path, names: Mapping[str, str]) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Line and numbers of each row of a CSV file, of columns by the key that names each of them.

    Raises:
        SceneError: there is no such file or column; a cell is no finite number.
    """
    lines = _lines(path)
    header = [name.strip() for name in next(lines, ("", []))[1]]
    for key, name in names.items():
        require_known(key, name, header, f"{path.name} has no such column")
        require(header.count(name) == 1, key, name, f"{path.name} has several columns of this name")
    for line, row in lines:
        if not any(cell.strip() for cell in row):
            continue
        where = f"{path.name}, {line}"
        if any(cell.strip() for cell in row[len(header) :]):
            raise SceneError(f"csv = {where}: more cells than names in the first line; is there a decimal comma?")
        yield line, tuple(_number(row, header.index(name), name, where) for name in names.values())


def _lines(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Cells of each line, after its name; one whose quotes never close is named where they open."""
    lines = csv.reader(_text(path).splitlines(), skipinitialspace=True)
    begun = 1
    try:
        for row in lines:
            yield f"line {lines.line_num}", row
            begun = lines.line_num + 1
    except csv.Error as error:
        raise SceneError(f"csv = {shortened(path)}: line {begun}: {error}; is a quote not closed?") from None


def _number(row: list[str], place: int, name: str, where: str) -> float:
    text = row[place].strip() if place < len(row) else ""
    try:
        number = float(text)
    except ValueError:
        number = np.nan
    if not isfinite(number):
        raise SceneError(f'csv = {where}: "{shortened(text, 40)}" in column {shortened(name, 40)} is no finite number')
    return number


def _text(path: Path) -> str:
    try:
        require(path.is_file(), "csv", path, "is a folder" if path.is_dir() else "no such file")
        with path.open(encoding="utf-8-sig", newline="") as file:
            text = file.read(LONGEST + 1)
    except UnicodeDecodeError:
        raise SceneError(f"csv = {shortened(path)}: is not a text file in UTF-8") from None
    except OSError as error:
        raise SceneError(f"csv = {shortened(path)}: cannot be read: {error.strerror}") from None
    require(bool(text.strip()), "csv", path, "is empty; expected a line with the names of columns, and rows below")
    require(len(text) <= LONGEST, "csv", path, f"is longer than {LONGEST // 2**20} million characters")
    return text


def value_at(amplitude: Amplitude, time: float, end: float) -> float:
    """Value at `time`: a bare number is reached at `end`; a table starts from 0 at t = 0 unless it lists t = 0.

    >>> value_at(4.0, 0.5, end=2.0)
    1.0
    >>> [value_at(((1.0, -0.1), (3.0, 0.3)), t, end=4.0) for t in (0.5, 2.0, 9.0)]
    [-0.05, 0.1, 0.3]
    """
    if isinstance(amplitude, float | int):
        return float(amplitude) * min(time / end, 1.0)
    table = amplitude if amplitude[0][0] == 0.0 else ((0.0, 0.0), *amplitude)
    times, values = np.array(table).T
    return float(np.interp(time, times, values))


def listed_times(amplitude: Amplitude) -> tuple[float, ...]:
    """Times that a table lists; a bare number lists none."""
    return () if isinstance(amplitude, float | int) else tuple(t for t, _ in amplitude)


def turns(amplitude: Amplitude, end: float) -> tuple[float, ...]:
    """Times at which the rate of change changes; a straight line may be listed in many pieces.

    >>> turns(((1.0, 0.1), (2.0, 0.2), (3.0, -0.1)), end=4.0), turns(0.5, end=4.0)
    ((0.0, 2.0, 3.0), (0.0, 4.0))
    """
    table = ((0.0, 0.0), (end, float(amplitude))) if isinstance(amplitude, float | int) else amplitude
    times, values = np.array(table if table[0][0] == 0.0 else ((0.0, 0.0), *table)).T
    rates = np.concatenate([[0.0], np.diff(values) / np.diff(times), [0.0]])
    # of the largest rate: by so much the pieces of a straight line differ
    found = times[np.abs(np.diff(rates)) > ROUNDING * np.abs(rates).max()]
    return tuple(found.tolist())


def check(amplitude: Amplitude, key: str) -> None:
    """Refuse a table that is empty or whose times do not increase from 0 on."""
    if isinstance(amplitude, float | int):
        return
    times = listed_times(amplitude)
    require(len(times) > 0, key, "[]", "a table needs at least one [time, value]")
    increasing = all(a < b for a, b in pairwise(times))
    require(times[0] >= 0 and increasing, key, list(times), "times must increase, from 0 or later")
