"""Values by component: a scene may give any of them as a list, or as a table by axis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

from pydantic_core import core_schema

from stickslip.geometry.keys import plain

AXES = ("x", "y", "z")
Noun = TypeVar("Noun")


class ByAxis(tuple[Any, ...]):
    """Components that a table by axis gives: those behind the last one are zero, as many as the model has."""


def listed(value: Any) -> Any:
    """A table by axis as a list; components that are not named are zero.

    >>> listed({"y": -9.81}), listed([1.0, 2.0])
    ((0.0, -9.81), (1.0, 2.0))
    """
    if isinstance(value, Mapping) and value and set(value) <= set(AXES):
        count = max(2, 1 + max(map(AXES.index, value)))
        value = [value.get(axis, 0.0) for axis in AXES[:count]]
    return plain(value)


def tabled(value: Any) -> Any:
    """A list of all components as a table by axis.

    >>> tabled([0.0, [[1, 2]]]), tabled({"normal": 0.0})
    ({'x': 0.0, 'y': ((1, 2),)}, {'normal': 0.0})
    """
    if isinstance(value, list | tuple) and 2 <= len(value) <= 3:
        value = dict(zip(AXES, value, strict=False))
    return plain(value)


def completed(noun: Noun, dim: int) -> Noun:
    """A dataclass whose values by axis have `dim` components at least."""
    short = {f.name: value for f in fields(noun) if isinstance(value := getattr(noun, f.name), ByAxis)}  # type: ignore[arg-type]
    return replace(noun, **{key: (*value, *[0.0] * (dim - len(value))) for key, value in short.items()})  # type: ignore[type-var]


@dataclass(frozen=True)
class Components:
    """Beside the type of a key: a value of the other form is converted before it is checked."""

    convert: Callable[[Any], Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: Callable[[Any], Any]) -> Any:
        return core_schema.no_info_wrap_validator_function(self._read, handler(source))

    def _read(self, value: Any, check: Callable[[Any], Any]) -> Any:
        found = check(self.convert(value))
        return ByAxis(found) if self.convert is listed and isinstance(value, Mapping) else found

    def __get_pydantic_json_schema__(self, schema: Any, handler: Callable[[Any], Any]) -> Any:
        own = handler(schema)
        forms = own.get("anyOf", [own])
        if self.convert is listed:
            each = next(form["items"] for form in forms if "items" in form)
            other = {"type": "object", "properties": dict.fromkeys(AXES, each), "additionalProperties": False}
        else:
            each = next(form["additionalProperties"] for form in forms if "additionalProperties" in form)
            other = {"type": "array", "items": each, "minItems": 2, "maxItems": 3}
        return {"anyOf": [*forms, other]}


LIST, TABLE = Components(listed), Components(tabled)
