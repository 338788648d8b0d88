"""Coefficients of friction as a table: linear between its lines, constant before the first and after the last."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require

MuTable = tuple[tuple[float, float], ...]  # of a pressure [Pa] or a slip [m], and mu [-]


def check(table: MuTable, key: str) -> None:
    """Refuse a table that is empty, whose first column does not increase from 0 or more, or with a negative mu."""
    require(len(table) > 0, key, "[]", "a table needs at least one [value, mu]")
    at, mu = [x for x, _ in table], [y for _, y in table]
    require(
        at[0] >= 0 and all(a < b for a, b in pairwise(at)), key, at, "its first column must increase from 0 or more"
    )
    require(min(mu) >= 0, key, min(mu), f"{key} must not be negative")


def read(table: MuTable, at: Array) -> Array:
    """mu (m,) [-] at the values `at` (m,) of the first column.

    >>> read(((1.0, 0.5), (3.0, 0.3)), np.array([0.0, 2.0, 9.0]))
    array([0.5, 0.4, 0.3])
    """
    return np.asarray(np.interp(at, *np.array(table).T))


def largest_from(table: MuTable, at: Array) -> Array:
    """Largest mu (m,) [-] at the values `at` (m,) of the first column and beyond.

    >>> largest_from(((0.0, 0.2), (1.0, 0.5), (3.0, 0.3)), np.array([0.0, 2.0, 9.0]))
    array([0.5, 0.4, 0.3])
    """
    x, y = np.array(table).T
    beyond = np.append(np.maximum.accumulate(y[::-1])[::-1], y[-1])
    return np.maximum(read(table, at), beyond[np.searchsorted(x, at)])


def slope(table: MuTable, at: Array) -> Array:
    """Its derivative (m,), zero beyond both ends; at a corner that of the piece before it.

    >>> slope(((1.0, 0.5), (3.0, 0.3)), np.array([0.0, 2.0, 9.0]))
    array([ 0. , -0.1,  0. ])
    """
    x, y = np.array(table).T
    pieces = np.concatenate([[0.0], np.diff(y) / np.diff(x), [0.0]])
    return np.asarray(pieces[np.searchsorted(x, at)])


def steepest_fall(table: MuTable) -> float:
    """Largest -d mu / dx of a piece, at least 0."""
    x, y = np.array(table).T
    return float(np.max(-np.diff(y) / np.diff(x), initial=0.0))
