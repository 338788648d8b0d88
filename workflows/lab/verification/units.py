"""A scene in other units: each number is converted by the unit of its key."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from operator import mul
from typing import Any, TypeVar, get_args

from stickslip import Key, Scene, SceneError
from stickslip.geometry.expression import check_varying
from stickslip.geometry.keys import type_hints

Noun = TypeVar("Noun")
POWER = re.compile(r"([A-Za-z]+)(?:([²³])|\^(\w+))?")
EXPONENT = {"²": 2, "³": 3}


@dataclass(frozen=True, kw_only=True)
class Units:
    """One metre, one newton and one second in the new units; kelvins stay.

    In plane models forces and energies are per length of thickness, whatever their unit says.
    """

    length: float
    force: float
    plane: bool
    time: float = 1.0

    def factor(self, unit: str, noun: Any = None) -> float:
        """Factor for a number of this unit; an exponent may be the name of another field of the same table.

        Units of a table's columns are separated by a comma: then it is the factor of the last one.

        >>> mm = Units(length=1000.0, force=1.0, plane=False)
        >>> mm.factor("m/s²"), mm.factor("Pa"), mm.factor("-")
        (1000.0, 1e-06, 1.0)
        >>> mm.factor("N m")
        1000.0
        """
        symbols = {"m": self.length, "N": self.force, "s": self.time, "rad": 1.0, "K": 1.0}
        symbols |= {"Pa": self.force / self.length**2, "J": self.force * self.length}
        symbols["kg"] = self.force / self.length * self.time**2
        if self.plane:
            symbols |= {"N": self.force / self.length, "J": self.force}
        total, unit = 1.0, unit.split(", ")[-1].replace("N/m³", "Pa/m")  # per volume in plane models too
        parts = [(place, word) for place, part in enumerate(unit.split("/")) for word in part.split()]
        for place, word in parts if unit != "-" else ():
            if word == "1":
                continue
            match = POWER.fullmatch(word)
            assert match, f"{unit}: not a unit"
            symbol, digit, name = match.groups()
            exponent = getattr(noun, name) if name else EXPONENT.get(digit, 1)
            total *= symbols[symbol] ** (-exponent if place else exponent)
        return total


def in_millimetres(scene: Scene) -> Scene:
    """The same scene in mm, N, MPa and tonnes instead of m, N, Pa and kg."""
    return convert(scene, millimetres(scene), {"units": "mm-N-MPa"})


def millimetres(scene: Scene) -> Units:
    """The units mm, N, MPa, t of a scene."""
    return Units(length=1000.0, force=1.0, plane=scene.model in ("plane strain", "plane stress"))


def convert(noun: Noun, units: Units, labels: Mapping[str, str] | None = None) -> Noun:
    """The dataclass with every number in other units, and every dataclass within it; `labels` name them in a scene."""
    changed = dict[str, Any]()
    for field in fields(noun):  # type: ignore[arg-type]
        hint = type_hints(type(noun))[field.name]  # type: ignore[arg-type]
        unit = next((m.unit for m in getattr(hint, "__metadata__", ()) if isinstance(m, Key)), "-")
        value, columns = getattr(noun, field.name), unit.split(", ")
        if len(columns) > 1:  # a table
            changed[field.name] = tuple(tuple(map(mul, row, map(units.factor, columns))) for row in value)
            continue
        if tuple[tuple[float, ...], ...] in (hint, *get_args(hint)[:1]):  # places and heights, alike
            changed[field.name] = tuple(tuple(number * units.factor(unit, noun) for number in row) for row in value)
            continue
        changed[field.name] = _scaled(value, units.factor(unit, noun), units)
    return replace(noun, **(changed | dict(labels or {})))  # type: ignore[type-var]


def _scaled(value: Any, factor: float, units: Units) -> Any:
    if is_dataclass(value):
        return convert(value, units)
    if isinstance(value, Mapping):
        return {name: _scaled(entry, factor, units) for name, entry in value.items()}
    if isinstance(value, tuple) and all(_is_row(row) for row in value):  # a table in time
        return tuple((time * units.time, entry * factor) for time, entry in value)
    if isinstance(value, tuple):
        return tuple(_scaled(entry, factor, units) for entry in value)
    if isinstance(value, str) and _is_formula(value):
        pascal, length = units.factor("Pa"), units.length
        value = re.sub(r"\bt\b", f"(t/{units.time!r})", value)
        value = re.sub(r"\bV\b", f"(V/{units.factor('m/s')!r})", value)
        text = re.sub(r"\b([xyz])\b", rf"(\1/{length!r})", re.sub(r"\b([EG](_\d+)?)\b", rf"(\1/{pascal!r})", value))
        return f"{factor!r}*({text})"
    return value * factor if isinstance(value, float | int) and factor != 1 else value


def _is_formula(text: str) -> bool:
    """Whether a text is an expression of place or time, not the name of a side, a law or a body."""
    try:
        check_varying(text, "")
    except SceneError:
        return False
    return not text.isidentifier()


def _is_row(row: Any) -> bool:
    """Whether this is a [time, value] of a table."""
    return isinstance(row, tuple) and len(row) == 2 and not any(isinstance(number, tuple) for number in row)
