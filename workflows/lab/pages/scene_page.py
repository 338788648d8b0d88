"""Pages made from classes, renewed by `python -m stickslip.workflows.lab.pages.scene_page`.

They are workflows/SCENE.md, of the dataclasses of a scene, and the table of methods in docs/theory/methods.md.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from stickslip import Box, Builder, Key, Output, Scene, UserFile
from stickslip.geometry.amplitude import Amplitude
from stickslip.geometry.field import Field as PlaceAndTime
from stickslip.geometry.field import HeightMap
from stickslip.geometry.keys import ByKeys, Choice, Components, Noun
from stickslip.solvers.effects import EFFECTS
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.methods.method import Applicability
from stickslip.workflows.formats.templates import render
from stickslip.workflows.scene_file.read import kinds_of_keys
from stickslip.workflows.writers.writer import added_keys

FILE = Path(__file__).parents[2] / "SCENE.md"
# fields of a scene in Python: the keys that writers add, and the unit that a scene sets
NO_KEYS: Mapping[Any, Sequence[str]] = {Output: ("writers",), UserFile: ("scene_length",)}
TABLES = (
    "bodies", "obstacles", "contacts", "supports", "loads", "probes", "steps", "solver", "output", "exact", "accuracy",
    "sensitivity",
)  # fmt: skip
METHODS_PAGE = Path(__file__).resolve().parents[3] / "docs" / "theory" / "methods.md"
COLUMNS = ("normal laws", "friction", "operators", "bodies", "`solver.surface`")
METHODS_HEAD = f"| `solver.method` | when | {' | '.join(COLUMNS)} |"
Row = tuple[str, ...]  # cells of a table


class Kind(NamedTuple):
    """A noun of a scene file: its heading, what it is, and its keys."""

    heading: str
    words: str
    rows: list[Row]


def reference() -> str:
    """Return the whole page."""
    hints = kinds_of_keys()
    tables = {name: hints[name] for name in TABLES} | {e.name: e.table for e in EFFECTS if e.table is not None}
    sections = {"geometry": [*_kinds("geometry", Builder), _kind("file", UserFile)]}
    for name, kind in tables.items():
        several = get_origin(kind) is Mapping
        noun = get_args(kind)[1] if several else kind
        sections[f"{name}{'.NAME' if several else ''}"] = list(_kinds(name, noun))
    top_level = [_row(f, hints[f.name]) for f in fields(Scene) if f.name in ("title", "model", "units", "uncertainty")]
    return render("lab/pages/templates/scene.md", top_level=top_level, sections=sections)


def _kinds(name: str, noun: Any) -> Iterator[Kind]:
    """Yield what a table may hold, and the kinds of the tables in it."""
    if isinstance(noun, type) and issubclass(noun, ByKeys):  # the keys of a table choose the kind
        yield from (_kind(word, kind) for word, kind in noun.kinds.items())
        return
    for each in noun.kinds if _is_family(noun) else [noun]:
        yield _kind(_tagged(noun, each) if _is_family(noun) else "", each)
        for key, family in _families(each):
            for law in family.kinds:
                yield _kind(f"{name}.NAME.{key}: {_tagged(family, law)}", law)


def _kind(heading: str, noun: Any) -> Kind:
    return Kind(heading, (noun.__doc__ or "").strip().split("\n")[0], list(_rows(noun)))


def _tagged(family: Any, kind: Any) -> str:
    """Return the tag of a family and its word for a kind."""
    tag = next(f for f in fields(kind) if f.name == family.tag)
    return f"{family.tag} = {_default_text(tag)}"


def _rows(noun: Any) -> Iterator[Row]:
    assert is_dataclass(noun)
    hints = get_type_hints(noun, include_extras=True)
    added = added_keys() if noun is Output else {}
    for f in fields(noun):
        if f.name not in NO_KEYS.get(noun, ()):
            yield _row(f, hints[f.name])
    for keys in dict.fromkeys(added.values()):
        yield from _rows(keys)


def _row(f: Field[Any], hint: Any) -> Row:
    key = next(found for found in get_args(hint)[1:] if isinstance(found, Key))
    kind = _type_text(get_args(hint)[0])
    if any(isinstance(found, Components) for found in get_args(hint)):
        kind = re.sub("^(list|table) of", "list or table of", kind)
    return f"`{f.name.rstrip('_')}`", kind, key.unit, _default_text(f), key.meaning


def _type_text(kind: Any) -> str:
    if isinstance(kind, type) and issubclass(kind, HeightMap):
        return "map"
    if kind == PlaceAndTime:
        return "field"
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


def _families(noun: Any) -> Iterator[tuple[str, Any]]:
    hints = get_type_hints(noun)
    for name, hint in hints.items():
        for part in (hint, *get_args(hint)):
            if _is_family(part):
                yield name, part


def renewed(text: str) -> str:
    """Return the page with every method's row as its class has it."""
    rows = [
        f"| `{name}` | {method.WHEN} | {' | '.join(columns(method.WORKS_WITH))} |" for name, method in METHODS.items()
    ]
    table = "\n".join([METHODS_HEAD, "|" + "---|" * (2 + len(COLUMNS)), *rows, ""])
    return re.sub(r"^\| `solver.method` \|.*\n(\|.*\n)*", lambda _: table, text, count=1, flags=re.MULTILINE)


def columns(method: Applicability) -> tuple[str, ...]:
    """Return abilities of the method, a cell for each of `COLUMNS`.

    >>> columns(METHODS["regularised"].WORKS_WITH)
    ('unilateral, bilateral, compliance', 'coulomb, tresca; no k_T', 'rigid', 'held by supports',
     'condensed or matrix-free')
    """
    return (
        _known(method.normal),
        _known(method.friction) + ("" if method.k_T else "; no k_T") + ("" if method.rates else "; none by rate"),
        _known(method.operators),
        f"held or floating{'' if method.driven else '; no driven obstacles'}"
        if method.floating
        else f"held by supports{' or compliance' if method.bedded else ''}",
        " or ".join(form for form in ("condensed", "matrix-free") if getattr(method, form.replace("-", "_"))) or "-",
    )


def _known(names: tuple[str, ...] | None) -> str:
    return "all" if names is None else ", ".join(names)


if __name__ == "__main__":
    FILE.write_text(reference(), encoding="utf-8")
    METHODS_PAGE.write_text(renewed(METHODS_PAGE.read_text(encoding="utf-8")), encoding="utf-8")
