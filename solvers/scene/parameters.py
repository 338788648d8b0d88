"""Numbers of a scene by their dotted keys: which ones results may be derived by, and the scene with one changed.

A value in time is one number, its largest: all of its values change in proportion. A component of a vector has its
axis as last word, as in `--set`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Annotated, Any, Literal, TypeVar

import numpy as np

from stickslip.geometry.arrays import EXACT
from stickslip.geometry.errors import SceneError, require, require_known
from stickslip.geometry.keys import AXES, Key, Noun
from stickslip.solvers.scene.settings import LARGEST

T = TypeVar("T")
Uncertain = float | str | tuple[tuple[str, str, float], ...]
PHYSICAL = ("bodies", "contacts", "obstacles", "supports", "loads")  # tables, beside those of effects
CORRELATIONS = "correlations"  # key of [uncertainty] that is no number's
NUMERICAL = ("search_distance", "mesh_size", "contact_mesh_size", "inner_mesh_size")  # keys that say how, not what


@dataclass(frozen=True, kw_only=True)
class Sensitivity(Noun):
    """Derivatives of the numbers of every step by numbers of the scene."""

    parameters: Annotated[
        Literal["all"] | tuple[str, ...],
        Key("-", 'numbers by key, "contacts.base.friction.mu"; all: every one but those of the geometry'),
    ] = ()


def parameters(tables: object, path: tuple[str, ...] = ()) -> dict[str, float]:
    """Numbers of tables by their keys, of value 0 too; of a value in time the largest in size, with its sign."""
    found = dict[str, float]()
    if path and path[-1] in NUMERICAL:
        return found
    if isinstance(tables, float):
        return {".".join(path): tables}
    if _in_time(tables):
        return {".".join(path): max((size for _, size in tables), key=abs)}  # type: ignore[attr-defined]
    for name, item in _items(tables):
        found |= parameters(item, (*path, name))
    return found


def chosen(
    asked: str | Sequence[str], uncertain: Collection[str], known: Mapping[str, float], every: Mapping[str, float]
) -> tuple[str, ...]:
    """Keys of the numbers that a scene asks derivatives by: its own, and those that are uncertain.

    Args:
        asked: see `Sensitivity`.
        uncertain: keys of numbers that are.
        known: all numbers.
        every: those that `all` means.

    Raises:
        SceneError: one is no number, or has no size that it could be varied by.
    """
    own = [key for key, value in every.items() if value != 0] if asked == "all" else asked
    for owner, keys in (("sensitivity.parameters", own), ("uncertainty", uncertain)):
        for key in keys:
            if key.rpartition(".")[2] in NUMERICAL:
                why = "says how the scene is solved: its error is estimated, see output.error"
                raise SceneError(f"{owner}: {key} {why}")
            require_known(owner, key, known, "no such number in the scene")
            require(known[key] != 0, owner, key, "is 0, which has no size to vary it by; leave it out, or give it one")
    return tuple(dict.fromkeys((*own, *uncertain)))


def covariance(uncertain: Mapping[str, Uncertain], known: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Covariances of the numbers that are uncertain, in their own units, by both.

    Raises:
        SceneError: one is no positive number and no share in percent; or correlations are none.
    """
    found, owner = dict[str, float](), f"uncertainty.{CORRELATIONS}"
    for key, said in ((key, said) for key, said in uncertain.items() if key != CORRELATIONS):
        size = said if isinstance(said, float) else 0.0
        if isinstance(said, str) and said.endswith("%"):
            with suppress(ValueError):
                size = float(said.removesuffix("%")) / 100 * abs(known[key])
        wanted = 'expected one standard deviation, a positive number or "3 %"'
        require(0 < size <= LARGEST, f"uncertainty.{key}", said, wanted)
        found[key] = size
    keys, R = [*found], np.eye(len(found))
    correlated = uncertain.get(CORRELATIONS, ())
    require(isinstance(correlated, tuple), owner, correlated, "expected [[KEY, KEY, CORRELATION], ...]")
    for row in correlated if isinstance(correlated, tuple) else ():
        one, two, size = row
        for key in (one, two):
            require_known(owner, key, found, "no number with an uncertainty")
        require(one != two and abs(size) <= 1, owner, row, "expected two numbers, and a correlation from -1 to 1")
        R[keys.index(one), keys.index(two)] = R[keys.index(two), keys.index(one)] = size
    positive = np.linalg.eigvalsh(R).min(initial=0.0) >= -EXACT
    require(positive, owner, correlated, "no numbers are correlated so: their matrix has a negative eigenvalue")
    C = R * np.outer([*found.values()], [*found.values()])
    return {key: dict(zip(keys, row, strict=True)) for key, row in zip(keys, C.tolist(), strict=True)}


def scaled(scene: T, key: str, factor: float) -> T:
    """A scene with one of its `parameters` multiplied."""
    found: T = _scaled(scene, tuple(key.split(".")), factor)
    return found


def _scaled(value: Any, path: tuple[str, ...], factor: float) -> Any:
    if not path:
        return tuple((time, factor * size) for time, size in value) if _in_time(value) else factor * value
    first, *rest = path
    if isinstance(value, Mapping):
        return {**value, first: _scaled(value[first], tuple(rest), factor)}
    if isinstance(value, tuple):
        own = AXES.index(first)
        return tuple(_scaled(item, tuple(rest), factor) if at == own else item for at, item in enumerate(value))
    if first in getattr(value, "sections", ()):
        return replace(value, sections=_scaled(value.sections, path, factor))
    name = next(f.name for f in fields(value) if f.name.rstrip("_") == first)
    return replace(value, **{name: _scaled(getattr(value, name), tuple(rest), factor)})


def _items(value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, tuple) and len(value) <= len(AXES):
        yield from zip(AXES, value, strict=False)
    elif isinstance(value, Mapping):
        yield from value.items()
    elif is_dataclass(value):
        yield from ((f.name.rstrip("_"), getattr(value, f.name)) for f in fields(value))


def _in_time(value: Any) -> bool:
    """Whether a value is a table [[time, value], ...] of numbers."""
    pair = isinstance(value, tuple) and bool(value) and all(isinstance(row, tuple) and len(row) == 2 for row in value)
    return pair and all(isinstance(x, float | int) for row in value for x in row)
