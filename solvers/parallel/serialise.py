"""Serialise dataclasses to plain data (dicts, lists, words, numbers, arrays), and deserialise by their type hints."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from itertools import repeat
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from stickslip.geometry.arrays import AnyArray
from stickslip.geometry.protocols import Comm

Plain = Any  # a dict with words as keys, a list, a word, a number, None, an array, or values by node
T = TypeVar("T")
WORDS = (str, bool, int, float, NoneType)
_type_hints = cache(get_type_hints)


@dataclass(frozen=True, eq=False)
class Own:
    """This rank's part (owned, ...) of vectors over all displacement dofs."""

    values: AnyArray


@dataclass(frozen=True, eq=False)
class ByNode:
    """Such a vector gathered: (nodes, d, ...) in the order of the gmsh model on rank 0; (0, d, ...) elsewhere."""

    values: AnyArray


def serialise(value: object, whole: Callable[[Own], Plain] | None = None, without: Collection[str] = ()) -> Plain:
    """Plain data of a value.

    Args:
        value: a dataclass, a mapping, a list, a tuple, a number, a word, None, an array, an `Own` or a PETSc vector.
        whole: turns `Own` and PETSc vectors into plain data; collective. Without it they are refused.
        without: fields of a dataclass to leave out.

    Raises:
        TypeError: the value contains something that plain data cannot express.

    >>> serialise({"a": (1, 2.5), "b": None})
    {'a': [1, 2.5], 'b': None}
    """
    if isinstance(value, ByNode):
        return value
    if hasattr(value, "array_r"):
        value = Own(value.array_r)
    if isinstance(value, Own):
        if whole is None:
            raise TypeError("vectors have no place here")
        return whole(value)
    if is_dataclass(value):
        names = [f.name for f in fields(value) if f.init and f.name not in without]
        return {name: serialise(getattr(value, name), whole) for name in names}
    if isinstance(value, Mapping):
        return {key: serialise(item, whole) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [serialise(item, whole) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    if not isinstance(value, (*WORDS, np.ndarray)):
        raise TypeError(f"{type(value).__name__} is no plain data")
    return value


def deserialise(kind: type[T], plain: Plain, vector: Callable[[ByNode], object] | None = None, **given: object) -> T:
    """The value of type `kind` that `serialise` turned into plain data.

    Args:
        kind: a type, with type hints such as `dict[str, float]` or `State | None` of its fields.
        plain: what `serialise` returned, perhaps written to a file and read again.
        vector: what `ByNode` becomes; collective.
        given: fields of a dataclass that the plain data leave out.

    Raises:
        KeyError: a field of a dataclass or of a NamedTuple is missing.

    >>> deserialise(dict[str, float], {"a": 1.0})
    {'a': 1.0}
    """
    value: T = _value(kind, plain, vector, **given)
    return value


def _value(kind: Any, plain: Plain, vector: Callable[[ByNode], object] | None, **given: object) -> Any:
    if isinstance(plain, ByNode):
        assert vector is not None
        return vector(plain)
    if is_dataclass(kind) and isinstance(kind, type):
        hints = _type_hints(kind)
        names = [f.name for f in fields(kind) if f.init and f.name not in given]
        return kind(**{name: _value(hints[name], plain[name], vector) for name in names}, **given)
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        inner = tuple(k for k in inner if k is not NoneType)
        return None if plain is None else _value(inner[0], plain, vector)
    if isinstance(plain, dict):
        of = inner[1] if inner else Any
        return {key: _value(of, item, vector) for key, item in plain.items()}
    if isinstance(plain, list) and isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields"):
        hints = _type_hints(kind)
        if len(plain) != len(hints):
            raise KeyError(f"{kind.__name__} has {len(hints)} fields, not {len(plain)}")
        return kind(*(_value(hint, item, vector) for hint, item in zip(hints.values(), plain, strict=True)))
    if isinstance(plain, list):
        each = repeat(inner[0] if inner else Any) if not inner or inner[-1] is Ellipsis or origin is list else inner
        found = [_value(k, item, vector) for k, item in zip(each, plain, strict=False)]
        return tuple(found) if origin is tuple else found
    return plain


def broadcast(comm: Comm, plain: Plain) -> Plain:
    """Plain data of rank 0 on every rank; collective. The arrays of `ByNode` stay on rank 0 and are empty elsewhere."""
    received = comm.bcast(_without_nodes(plain) if comm.rank == 0 else None)
    return plain if comm.rank == 0 else received


def _without_nodes(plain: Plain) -> Plain:
    if isinstance(plain, ByNode):
        return ByNode(plain.values[:0])
    if isinstance(plain, dict):
        return {key: _without_nodes(item) for key, item in plain.items()}
    return [_without_nodes(item) for item in plain] if isinstance(plain, list) else plain
