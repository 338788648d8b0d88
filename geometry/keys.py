"""Scene keys: the unit and meaning of each, families of which a scene chooses one kind, and the check of all values.

A value is checked against the types of its dataclass by pydantic, whether it comes from a file or from Python, and a
wrong one is refused in the same words.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from functools import cache, reduce, wraps
from inspect import get_annotations, signature
from operator import or_
from pathlib import Path
from types import MappingProxyType, UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    NotRequired,
    ParamSpec,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from pydantic import Discriminator, TypeAdapter, ValidationError
from pydantic_core import core_schema
from typing_extensions import TypedDict

from stickslip.geometry.errors import SceneError, nearest, shortened

_TABLE, _OPTIONAL = cast(Any, TypedDict), cast(Any, NotRequired)  # of keys that are known at run time only
EXPECTED = {  # pydantic speaks of JSON; a user wrote TOML
    "float_type": "expected a number",
    "int_type": "expected a whole number",
    "int_from_float": "expected a whole number",
    "string_type": "expected a text, in quotes",
    "bool_type": "expected true or false",
    "dict_type": "expected a table",
    "dataclass_type": "expected a table",
    "model_attributes_type": "expected a table",
    "mapping_type": "expected a table",
    "is_instance_of": "expected a table",
    "finite_number": "must be a finite number",
    "tuple_type": "expected a list",
}
OF_KIND = "kind of table: "  # before the name of a kind that the keys of a table have chosen; no key begins so
UNKNOWN = ("unexpected_keyword_argument", "extra_forbidden")
Keys = Mapping[str, Any]  # values, or types, by key
Vector = tuple[float, ...]
Given = ParamSpec("Given")
Returned = TypeVar("Returned")


@dataclass(frozen=True)
class Key:
    """Unit and meaning of a scene key; `workflows/SCENE.md` is generated from these."""

    unit: str
    meaning: str

    def __get_pydantic_json_schema__(self, schema: Any, handler: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        unit = f" [{self.unit}]" if self.unit not in ("", "-") else ""
        return {**handler(schema), "description": f"{self.meaning}{unit}"}


class Checked(type):
    """Metaclass of the nouns: a call checks the values, as `parse` does for those of a file."""

    def __call__(cls, *args: Any, **values: Any) -> Any:
        if args or not is_dataclass(cls) or not cls.is_key():
            return super().__call__(*args, **values)
        given = {key: plain(value) for key, value in values.items()}
        try:
            checked = _adapter(cls, frozenset(cls.added())).validate_python(given, strict=True, by_name=True)
        except ValidationError as error:
            raise SceneError(*_explained(error, cls, given, ())) from None
        return super().__call__(**cls.gathered(checked))


class Noun(metaclass=Checked):
    """Base of the frozen dataclasses that a scene is made of; keys that are no fields are refused."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {
        "extra": "forbid",
        "allow_inf_nan": False,
        "alias_generator": lambda name: name.rstrip("_"),  # a key may be a word of Python, as `from`
    }

    @classmethod
    def is_key(cls) -> bool:
        """Whether a scene file can hold it, so that all its values have types that can be checked."""
        return True

    @classmethod
    def added(cls) -> Keys:
        """Type of each key that is no field; `gathered` puts their values where they belong."""
        return {}

    @classmethod
    def gathered(cls, values: Keys) -> Keys:
        """Values by field, of values by key."""
        return values

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Callable[[Any], Any]) -> Any:
        return handler(source) if is_dataclass(cls) else core_schema.is_instance_schema(cls)


class Choice(Noun):
    """Base of a family of kinds, of which a scene chooses one by a literal key (`builder`, `shape`, `law`).

    A direct subclass is the family. A subclass of the family that declares the key as a field is a kind, and its
    definition registers it. A subclass that does not declare the key is a base that several kinds share.
    """

    tag: ClassVar[str]  # name of the key
    kinds: ClassVar[list[type[Any]]]  # filled by the definitions of the kinds
    registered: ClassVar[int] = 0  # kinds of all families

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if Choice in cls.__bases__:
            cls.kinds = []
        elif cls.tag in get_annotations(cls):
            cls.kinds.append(cls)
            Choice.registered += 1

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Callable[[Any], Any]) -> Any:
        if Choice not in cls.__bases__:
            return handler(source)
        if len(cls.kinds) == 1:
            known = handler(cls.kinds[0])
        else:
            any_kind: Any = Annotated[reduce(or_, cls.kinds), Discriminator(cls.tag)]
            known = handler.generate_schema(any_kind)  # type: ignore[attr-defined]
        return _or_own(cls, known)

    @classmethod
    def is_key(cls) -> bool:
        return cls in cls.kinds


class ByKeys(Noun):
    """Base of a family of kinds, of which a table chooses one by the keys that it has.

    A direct subclass is the family. A subclass of the family registers its kind; the first one is that of a table
    without a key that only another one has.
    """

    kinds: ClassVar[dict[str, type[Any]]]  # by name, filled by the definitions of the kinds

    def __init_subclass__(cls, kind: str = "", **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if ByKeys in cls.__bases__:
            cls.kinds = {}
        elif kind:
            cls.kinds[kind] = cls
            Choice.registered += 1

    @classmethod
    def kind_of(cls, value: Any) -> type[Any]:
        """The kind of a table; of what is none, the first kind."""
        first, *others = cls.kinds.values()
        for kind in others:
            if isinstance(value, kind):
                return kind
            if isinstance(value, Mapping) and not (get_annotations(kind).keys() - get_annotations(first)).isdisjoint(
                value
            ):
                return kind
        return first

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Callable[[Any], Any]) -> Any:
        if ByKeys not in cls.__bases__:
            return handler(source)
        tags = {kind: f"{OF_KIND}{name}" for name, kind in cls.kinds.items()}
        known = core_schema.tagged_union_schema(
            {tag: handler.generate_schema(kind) for kind, tag in tags.items()},  # type: ignore[attr-defined]
            discriminator=lambda value: tags[cls.kind_of(value)],
        )
        return _or_own(cls, known)

    @classmethod
    def is_key(cls) -> bool:
        return cls in cls.kinds.values()


def _or_own(family: type[Any], known: Any) -> Any:
    """Schema of the known kinds of a family, and from Python of all others: a program may have kinds of its own."""

    def accept(value: Any, check: Callable[[Any], Any]) -> Any:
        return value if isinstance(value, family) else check(value)

    from_python = core_schema.no_info_wrap_validator_function(accept, known)
    return core_schema.json_or_python_schema(json_schema=known, python_schema=from_python)


def plain(value: Any) -> Any:
    """A value from Python as a scene file has it: numpy's numbers and arrays, paths and lists become plain ones."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return tuple(plain(item) for item in value)
    return value


@cache
def type_hints(kind: Any) -> Mapping[str, Any]:
    """Types of the fields of a class, or of the arguments of a function, with their keys; read once."""
    return MappingProxyType(get_type_hints(kind, include_extras=True))


@cache
def _adapter(kind: Any, added: frozenset[str]) -> TypeAdapter[Any]:
    """Checks the values of a dataclass by name, those of added keys too; made again when there are more of these."""
    hints = type_hints(kind)
    optional = {f.name for f in fields(kind) if f.default is not MISSING or f.default_factory is not MISSING}
    table = {f.name: _OPTIONAL[hints[f.name]] if f.name in optional else hints[f.name] for f in fields(kind)}
    table |= {key: _OPTIONAL[kind.added()[key] | None] for key in added}
    values = _TABLE(kind.__name__, table)
    values.__pydantic_config__ = kind.__pydantic_config__
    return TypeAdapter(values)


def adapter(kind: Any) -> TypeAdapter[Any]:
    """Reads and writes values of a type; made once, and again when there are more kinds to choose from."""
    return _made(kind, Choice.registered)


@cache
def _made(kind: Any, count: int) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def parse(kind: Any, value: Any, at: tuple[str, ...]) -> Any:
    """The value of a key of a scene file, checked against its type.

    Args:
        kind: type of the key.
        value: as a TOML reader gives it.
        at: the key, by its parts.

    Raises:
        SceneError: of each mistake key, what was found, what is expected, the nearest valid name.
    """
    try:
        return adapter(kind).validate_json(json.dumps(value, default=str), strict=True)
    except ValidationError as error:
        raise SceneError(*_explained(error, kind, value, at)) from None


def numbers_in(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], float]]:
    """Yield the numbers of a table with the parts of their keys."""
    if isinstance(value, float):
        yield path, value
    items: Any = value.items() if isinstance(value, Mapping) else ()
    if is_dataclass(value):
        items = ((f.name.rstrip("_"), getattr(value, f.name)) for f in fields(value))
    for name, item in enumerate(value) if isinstance(value, list | tuple) else items:
        yield from numbers_in(item, (*path, str(name)))


def typed(act: Callable[Given, Returned]) -> Callable[Given, Returned]:
    """Decorate a public function: values of other kinds than it declares are refused in a line, as those of a scene."""

    @wraps(act)
    def checked(*args: Given.args, **values: Given.kwargs) -> Returned:
        hints = type_hints(act)
        for name, value in signature(act).bind(*args, **values).arguments.items():
            if not _fits(value, hints[name]):
                words = re.sub(r"<class '|'>|\w+\.", "", str(hints[name]))
                raise SceneError(f"{act.__name__}: {name} = {shortened(repr(value))}: expected {words}")
        return act(*args, **values)

    return checked


def _fits(value: Any, kind: Any) -> bool:
    """Whether a value is of a kind; a text is no list of texts."""
    of, parts = get_origin(kind), get_args(kind)
    if of in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if of is Sequence:
        return isinstance(value, Sequence) and not isinstance(value, str) and all(_fits(v, parts[0]) for v in value)
    if of is Mapping:
        return isinstance(value, Mapping) and all(_fits(key, parts[0]) for key in value)
    if of is Callable:
        return callable(value)
    loose = kind is Any or of is not None or getattr(kind, "_is_protocol", False)
    return loose or isinstance(value, (int, float) if kind is float else kind)


def _explained(error: ValidationError, kind: Any, data: Any, at: tuple[str, ...]) -> Iterator[str]:
    """A line for each mistake, in the scene's words; where several types were tried, of the most specific error."""
    rank = dict.fromkeys(UNKNOWN, 0) | {"value_error": 1, "missing": 2}
    by_place: dict[tuple[str, ...], list[Any]] = {}
    for one in error.errors(include_url=False):
        by_place.setdefault(_followed(one, data)[2], []).append(one)
    unknown = [place for place, found in by_place.items() if found[0]["type"] in UNKNOWN]
    for place, found in by_place.items():
        misspelt = [name for *table, name in unknown if tuple(table) == place[:-1]]
        if found[0]["type"].startswith("missing") and get_close_matches(place[-1], misspelt):
            continue  # it is there, and said to be unknown
        problem = min(found, key=lambda e: (rank.get(e["type"], 3), len(e["loc"])))
        path, node, _ = _followed(problem, data)
        if problem["type"] != "value_error":
            known = set(_keys_at(kind, data, path[:-1])) if problem["type"] in UNKNOWN else set()
            unit = _unit_at(kind, data, path) if problem["type"] == "float_type" else ""
            yield _line(problem, [*at, *path], node, known, found, unit)
            continue
        cause, key = problem["ctx"]["error"], shortened(".".join([*at, *path]))
        for line in cause.lines if isinstance(cause, SceneError) else (str(cause),):
            yield f"{key}{'.' if isinstance(node, Mapping) else ': '}{line}" if key else line


def _followed(problem: Any, data: Any) -> tuple[list[str], Any, tuple[str, ...]]:
    """Key and value of an error, and the key of what is wrong: one that is missing, or for which all types were tried.

    pydantic also names the type that was tried, and the kind that a table chooses; the file does not.
    """
    path, node, place = list[str](), data, None
    for part in problem["loc"]:
        if isinstance(part, str) and part.startswith(OF_KIND):
            continue
        inside = isinstance(node, list | tuple) and isinstance(part, int) and part < len(node)
        if inside or (isinstance(node, Mapping) and part in node):
            path.append(str(part))
            node = node[part]
        elif place is None and not (isinstance(node, Mapping) and part in node.values()):
            absent = problem["type"].startswith("missing") and part is problem["loc"][-1]
            place = (*path, str(part)) if absent else tuple(path)
    return path, node, tuple(path) if place is None else place


def _line(problem: Any, path: Sequence[str], node: Any, known: set[str], beside: Sequence[Any], unit: str) -> str:
    """One of pydantic's errors.

    Args:
        path: of the key.
        node: its value.
        known: valid names in the key's table.
        beside: the errors of all types that were tried.
        unit: of a number; may be empty.
    """
    key, found = shortened(".".join(path)), shortened(json.dumps(node, ensure_ascii=False, default=str, skipkeys=True))
    what, context, inner = problem["type"], problem.get("ctx", {}), f"{key}." if key else ""
    if what == "missing" and isinstance(node, list | tuple):  # a row of a value in time
        return f"{key} = {found}: expected a pair [time, value]"
    if what in ("missing", "missing_argument", "missing_keyword_only_argument"):
        return f"{inner}{problem['loc'][-1]}: missing, it has no default"
    if what in UNKNOWN:
        return f"{key}: unknown key; {nearest(path[-1], known)}"
    if what in ("union_tag_invalid", "union_tag_not_found"):
        tag = context["discriminator"].strip("'")
        if what == "union_tag_not_found":
            return f"{inner}{tag}: missing, it says which kind is meant"
        wanted = [name.strip(" '") for name in context["expected_tags"].split(",")]
        named = str(context["tag"])
        return f"{inner}{tag} = {shortened(json.dumps(named))}: not one of these; {nearest(named, wanted)}"
    words = [name for e in beside if e["type"] == "literal_error" for name in _words(e)]
    if what == "literal_error":
        return f"{key} = {found}: not one of these; {nearest(str(node), words)}"
    if what in EXPECTED and words:
        quoted = [f'"{word}"' for word in words]
        return f"{key} = {found}: {EXPECTED[what]}{f' in {unit}' if unit else ''}, or {' or '.join(quoted)}"
    if what == "float_type" and "float" in problem["loc"]:  # one branch of a value in time
        texts = any(e["type"] == "string_type" for e in beside)
        more = ", or an expression in quotes" if texts else ""
        number = f"a number{f' in {unit}' if unit else ''}"
        if any("tuple[float, float]" in e["loc"] for e in beside):
            return f"{key} = {found}: expected {number}, or two of them"
        if not any("tuple[float" in str(e["loc"]) for e in beside):
            dots = "; write a key with dots in quotes" if isinstance(node, Mapping) else ""
            return f"{key} = {found}: expected {number}, or a text{dots}"
        return f"{key} = {found}: expected {number}, or a table [[time, value], ...]{more}"
    if what == "dataclass_exact_type":
        return f"{key} = {found}: expected a {context['class_name']}"
    said = EXPECTED.get(what, problem["msg"][0].lower() + problem["msg"][1:])
    return f"{key} = {found}: {said}{f', in {unit}' if unit else ''}"


def _words(problem: Any) -> list[str]:
    """The texts that a key may have."""
    return [name.strip(" '") for name in problem["ctx"]["expected"].replace(" or ", ",").split(",")]


def _unit_at(kind: Any, data: Any, path: Sequence[str]) -> str:
    """Unit of the number at `path`, which is that of the innermost key around it; empty if it has none."""
    for place in range(len(path) - 1, -1, -1):
        hint = _keys_at(kind, data, path[:place]).get(path[place])
        units = [key.unit for key in getattr(hint, "__metadata__", ()) if isinstance(key, Key)]
        if units:
            return "" if units[0] == "-" or "," in units[0] else units[0]
    return ""


def _keys_at(kind: Any, data: Any, path: Sequence[str]) -> dict[str, Any]:
    """Valid names in the table at `path`, with their types, found by walking the types along the data."""
    if get_origin(kind) in (Union, UnionType):
        kind = next((k for k in get_args(kind) if k is not type(None)), kind)
    if get_origin(kind) is Annotated:
        return _keys_at(get_args(kind)[0], data, path)
    if get_origin(kind) is Mapping:
        return _keys_at(get_args(kind)[1], data[path[0]], path[1:]) if path else {}
    if isinstance(kind, type) and issubclass(kind, Choice) and Choice in kind.__bases__:
        tags = {get_args(get_type_hints(k)[kind.tag])[0]: k for k in kind.kinds}
        kind = tags[data[kind.tag]] if len(tags) > 1 else kind.kinds[0]
    if isinstance(kind, type) and issubclass(kind, ByKeys) and ByKeys in kind.__bases__:
        kind = kind.kind_of(data)
    if not (isinstance(kind, type) and issubclass(kind, Noun) and is_dataclass(kind)):
        return {}
    hints = type_hints(kind)
    names = {f.name.rstrip("_"): hints[f.name] for f in fields(kind)} | dict(kind.added())
    return _keys_at(names[path[0]], data[path[0]], path[1:]) if path else names


AXES = ("x", "y", "z")
Table = TypeVar("Table")


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


def completed(noun: Table, dim: int) -> Table:
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
