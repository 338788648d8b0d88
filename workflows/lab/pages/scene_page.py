"""workflows/SCENE.md, from the dataclasses: `python -m stickslip.workflows.lab.pages.scene_page` renews it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from stickslip.geometry.amplitude import Amplitude
from stickslip.geometry.builders import Builder
from stickslip.geometry.keys import ByKeys, Choice, Components, Key, Noun
from stickslip.geometry.user_files.user_file import Box, UserFile
from stickslip.solvers.effects import EFFECTS
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Output
from stickslip.workflows.scene_file.read import kinds_of_keys
from stickslip.workflows.writers.writer import added_keys

FILE = Path(__file__).parents[2] / "SCENE.md"
HEAD = """# Scene file, version 1

Generated from the dataclasses; do not edit. Every table and key that a scene may hold; unknown ones are refused.
A *value in time* is a number, reached at `steps.end` from 0 at t = 0, or a table `[[time, value], ...]`: piecewise
linear, constant after the last, 0 at t = 0 unless listed; or `{ csv = "pressure.csv", time = "t", column = "p" }`: such
a table from two columns of a CSV file, relative to the scene file, whose first line names the columns. Units are those
that `units` names, SI without it; no number is converted, and the tables here say that of the SI. Plane models: forces
and areas per metre of thickness.

An *expression* is a formula in quotes, such as `"-0.2*E*sin(pi*x/2)"`: numbers, `+ - * / **`, parentheses; `x`, `y`,
`z` [m] of the undeformed body, `t` [s], `pi`, `E` [Pa] and `nu` of the body, or its constants by axis; `sin cos tan exp
sqrt log abs`, `min` and `max` of two or more. Without `t` it is reached at `steps.end` from 0 at t = 0, like a number;
with `t` it is what it says at every time that is solved. When its rate turns is not known: request such times by
`steps.count` or a table. Loads integrate it exactly up to degree 5 at order 1, 6 at order 2; supports follow it at the
nodes. steps.csv does not list it.
"""
# fields of a scene in Python: the keys that writers add, and the unit that a scene sets
NO_KEYS: Mapping[Any, Sequence[str]] = {Output: ("writers",), UserFile: ("scene_length",)}
TABLES = (
    "bodies",
    "obstacles",
    "contacts",
    "supports",
    "loads",
    "probes",
    "steps",
    "solver",
    "output",
    "exact",
    "accuracy",
)


def reference() -> str:
    """The whole page."""
    hints = kinds_of_keys()
    parts = [HEAD, "## Top level\n", *_table(_top_level(hints))]
    parts += _section("geometry", Builder)
    parts += ["### file\n", UserFile.__doc__ or "", "", *_table(_rows(UserFile)), ""]
    for name in TABLES:
        parts += _section(name, hints[name])
    for effect in EFFECTS:
        if effect.table is not None:
            parts += _section(effect.name, effect.table)
    return "\n".join(parts) + "\n"


def _section(name: str, kind: Any) -> Iterator[str]:
    several = get_origin(kind) is Mapping
    noun = get_args(kind)[1] if several else kind
    yield f"\n## [{name}{'.NAME' if several else ''}]\n"
    if isinstance(noun, type) and issubclass(noun, ByKeys):  # the keys of a table choose the kind
        for word, kind in noun.kinds.items():
            yield f"### {word}\n"
            yield (kind.__doc__ or "").strip().split("\n")[0] + "\n"
            yield from _table(_rows(kind))
            yield ""
        return
    kinds = noun.kinds if _is_family(noun) else [noun]
    for each in kinds:
        if len(kinds) > 1 or _is_family(noun):
            yield f"### {noun.tag} = {_default_text(_tag_field(noun, each))}\n"
        yield (each.__doc__ or "").strip().split("\n")[0] + "\n"
        yield from _table(_rows(each))
        yield ""
        for key, family in _families(each):
            for law in family.kinds:
                yield f"### {name}.NAME.{key}: {family.tag} = {_default_text(_tag_field(family, law))}\n"
                yield (law.__doc__ or "").strip().split("\n")[0] + "\n"
                yield from _table(_rows(law))
                yield ""


def _top_level(hints: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    for f in fields(Scene):
        if f.name in ("title", "model", "units"):
            yield _row(f, hints[f.name])


def _rows(noun: Any) -> Iterator[tuple[str, ...]]:
    assert is_dataclass(noun)
    hints = get_type_hints(noun, include_extras=True)
    added = added_keys() if noun is Output else {}
    for f in fields(noun):
        if f.name not in NO_KEYS.get(noun, ()):
            yield _row(f, hints[f.name])
    for keys in dict.fromkeys(added.values()):
        yield from _rows(keys)


def _row(f: Field[Any], hint: Any) -> tuple[str, ...]:
    key = next(found for found in get_args(hint)[1:] if isinstance(found, Key))
    kind = _type_text(get_args(hint)[0])
    if any(isinstance(found, Components) for found in get_args(hint)):
        kind = re.sub("^(list|table) of", "list or table of", kind)
    return f"`{f.name.rstrip('_')}`", kind, key.unit, _default_text(f), key.meaning


def _table(rows: Iterator[tuple[str, ...]]) -> Iterator[str]:
    yield "| key | type | unit | default | meaning |"
    yield "|---|---|---|---|---|"
    for row in rows:
        yield f"| {' | '.join(cell.replace('|', '/') for cell in row)} |"


def _type_text(kind: Any) -> str:
    if kind == Amplitude or set(get_args(Amplitude)) <= set(get_args(kind)):
        return "value in time" + " or expression" * (str in get_args(kind))
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _type_text(parts[0])
    if origin is Literal:
        return " or ".join(f'"{part}"' if isinstance(part, str) else str(part) for part in parts)
    if origin in (Union, UnionType):
        return " or ".join(_type_text(part) for part in parts if part is not NoneType)
    if origin is tuple:
        return f"list of {_type_text(parts[0])}"
    if origin is Mapping:
        return f"table of {_type_text(parts[1])}"
    if _is_family(kind):
        return "table, see below"
    if is_dataclass(kind):
        return f"{{ {', '.join(f'{key[1:-1]} = {word} [{unit}]' for key, word, unit, *_ in _rows(kind))} }}"
    return {
        Box: "{ box = list of number }",
        float: "number",
        int: "whole number",
        str: "text",
        bool: "true or false",
    }.get(kind, str(kind))


def _default_text(f: Field[Any]) -> str:
    if f.default is not MISSING:
        value = f.default
    elif f.default_factory is not MISSING:
        value = f.default_factory()
    else:
        return "required"
    if value is None:
        return "absent"
    if isinstance(value, Choice):
        return " ".join(f"{{ {k} = {v!r} }}".replace("'", '"') for k, v in vars(value).items())
    if isinstance(value, Noun):
        known = {k: v for k, v in vars(value).items() if v is not None}
        return f"{{ {', '.join(f'{k} = {v!r}' for k, v in known.items())} }}".replace("'", '"')
    if isinstance(value, str):
        return f'"{value}"'
    return str(value).lower() if isinstance(value, bool) else str(value)


def _is_family(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Choice) and Choice in kind.__bases__


def _tag_field(family: Any, kind: Any) -> Field[Any]:
    return next(f for f in fields(kind) if f.name == family.tag)


def _families(noun: Any) -> Iterator[tuple[str, Any]]:
    hints = get_type_hints(noun)
    for name, hint in hints.items():
        for part in (hint, *get_args(hint)):
            if _is_family(part):
                yield name, part


if __name__ == "__main__":
    FILE.write_text(reference(), encoding="utf-8")
