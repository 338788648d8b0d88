"""Numbers of a scene by their dotted keys: which ones results may be derived by, and the scene with one changed.

A value in time is one number, its largest: all of its values change in proportion. A component of a vector has its
axis as last word, as in `--set`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Annotated, Any, Literal

from stickslip.geometry.errors import SceneError, require, require_known
from stickslip.geometry.keys import AXES, Key, Noun

PHYSICAL = ("bodies", "contacts", "obstacles", "supports", "loads")  # tables, beside those of effects
NUMERICAL = ("search_distance", "mesh_size", "contact_mesh_size", "inner_mesh_size")  # keys that say how, not what


@dataclass(frozen=True, kw_only=True)
class Sensitivity(Noun):
    """Derivatives of the numbers of every step by numbers of the scene."""

    parameters: Annotated[
        Literal["all"] | tuple[str, ...],
        Key("-", 'numbers by key, "contacts.base.friction.mu"; all: every one but those of the geometry'),
    ] = ()


def numbers(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], float]]:
    """Yield the numbers of tables by the parts of their keys; of a value in time the largest in size, with its sign."""
    if isinstance(value, float):
        yield path, value
    elif _in_time(value):
        yield path, max((size for _, size in value), key=abs)
    elif isinstance(value, tuple) and len(value) <= len(AXES):
        for axis, item in zip(AXES, value, strict=False):
            yield from numbers(item, (*path, axis))
    else:
        for name, item in _items(value):
            yield from numbers(item, (*path, name))


def parameters(scene: Any, geometry: bool = False) -> dict[str, float]:
    """Numbers of a scene that results may be derived by, by key; of value 0 too.

    Args:
        scene: a `Scene`.
        geometry: whether those of the geometry count.
    """
    tables = {key: getattr(scene, key) for key in PHYSICAL} | dict(scene.sections)
    found = numbers(tables | ({"geometry": scene.geometry} if geometry else {}))
    return {".".join(path): value for path, value in found if path[-1] not in NUMERICAL}


def chosen(scene: Any) -> tuple[str, ...]:
    """Keys of the numbers that a scene asks derivatives by: its own, and those that are uncertain.

    Raises:
        SceneError: one is no number, or has no size that it could be varied by.
    """
    asked, known = scene.sensitivity.parameters, parameters(scene, geometry=True)
    every = [key for key, value in parameters(scene).items() if value != 0] if asked == "all" else asked
    for key in (*every, *scene.uncertainty):
        owner = "sensitivity.parameters" if key in every else "uncertainty"
        if key.rpartition(".")[2] in NUMERICAL:
            raise SceneError(f"{owner}: {key} says how the scene is solved; its error is estimated, see output.error")
        require_known(owner, key, known, "no such number in the scene")
        require(known[key] != 0, owner, key, "is 0, which has no size to vary it by; leave it out, or give it a value")
    return tuple(dict.fromkeys((*every, *scene.uncertainty)))


def deviations(scene: Any) -> dict[str, float]:
    """Standard uncertainties of the numbers that have one, in their own units.

    Raises:
        SceneError: one is no positive number and no share in percent.
    """
    values, found = parameters(scene, geometry=True), dict[str, float]()
    for key, said in scene.uncertainty.items():
        try:
            share = isinstance(said, str) and float(said.removesuffix("%")) / 100
        except ValueError:
            share = 0.0
        size = share * abs(values[key]) if isinstance(said, str) and said.endswith("%") else said
        good = isinstance(size, float) and size > 0
        require(good, f"uncertainty.{key}", said, 'expected one standard deviation, a positive number or "3 %"')
        found[key] = float(size)
    return found


def scaled(value: Any, path: tuple[str, ...], factor: float) -> Any:
    """A scene, or a part of it, with the number at a path multiplied."""
    if not path:
        return tuple((time, factor * size) for time, size in value) if _in_time(value) else factor * value
    first, *rest = path
    if isinstance(value, Mapping):
        return {**value, first: scaled(value[first], tuple(rest), factor)}
    if isinstance(value, tuple):
        own = AXES.index(first)
        return tuple(scaled(item, tuple(rest), factor) if at == own else item for at, item in enumerate(value))
    if first in getattr(value, "sections", ()):
        return replace(value, sections=scaled(value.sections, path, factor))
    name = next(f.name for f in fields(value) if f.name.rstrip("_") == first)
    return replace(value, **{name: scaled(getattr(value, name), tuple(rest), factor)})


def _items(value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        yield from value.items()
    elif is_dataclass(value):
        yield from ((f.name.rstrip("_"), getattr(value, f.name)) for f in fields(value))


def _in_time(value: Any) -> bool:
    """Whether a value is a table [[time, value], ...] of numbers."""
    pair = isinstance(value, tuple) and bool(value) and all(isinstance(row, tuple) and len(row) == 2 for row in value)
    return pair and all(isinstance(x, float | int) for row in value for x in row)
