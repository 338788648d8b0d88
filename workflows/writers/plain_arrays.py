"""Plain data as two arrays, its text and its bytes: one file holds it, however many arrays it is made of."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from solvers.plain import ByNode, Plain
from workflows.writers.hdf5 import AnyArray

TEXT, BYTES = "text", "bytes"
ARRAY, BY_NODE = "@array", "@by node"  # keys that no name of a scene can be


class _Bytes:
    """Arrays one after the other, equal ones once; those that the file holds anyway are pointed at."""

    def __init__(self, known: Mapping[str, AnyArray]) -> None:
        self.parts: list[bytes] = []
        self._length = 0
        self._places: dict[bytes, str | int] = {}
        for name, array in known.items():
            self._places.setdefault(_digest(array), name)

    def place(self, array: AnyArray) -> dict[str, Any]:
        digest = _digest(array)
        if digest not in self._places:
            self._places[digest] = self._length
            self._length += array.nbytes
            self.parts.append(array.tobytes())
        # rounding depends on the order in memory: sums follow it
        across = array.flags.f_contiguous and not array.flags.c_contiguous
        return {ARRAY: [self._places[digest], array.dtype.str, list(array.shape), "F" if across else "C"]}


def _digest(array: AnyArray) -> bytes:
    return hashlib.sha256(np.ascontiguousarray(array).data).digest()


def to_arrays(plain: Plain, known: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """The arrays `text` and `bytes`.

    Args:
        known: arrays that will stand beside them under these names.
    """
    store = _Bytes(known)

    def say(value: Plain) -> Any:
        if isinstance(value, ByNode):
            return {BY_NODE: say(value.values)}
        if isinstance(value, np.ndarray):
            return store.place(value)
        if isinstance(value, dict):
            return {key: say(item) for key, item in value.items()}
        return [say(item) for item in value] if isinstance(value, list) else value

    text = json.dumps(say(plain)).encode()
    return {TEXT: np.frombuffer(text, np.uint8), BYTES: np.frombuffer(b"".join(store.parts), np.uint8)}


def from_arrays(text: AnyArray, content: AnyArray, known: Mapping[str, AnyArray]) -> Plain:
    """The plain data again, to the same bits."""
    rest = content.tobytes()

    def hear(value: Any) -> Plain:
        if isinstance(value, list):
            return [hear(item) for item in value]
        if not isinstance(value, dict):
            return value
        if BY_NODE in value:
            return ByNode(hear(value[BY_NODE]))
        if ARRAY not in value:
            return {key: hear(item) for key, item in value.items()}
        place, kind, shape, order = value[ARRAY]
        source, offset = (known[place].tobytes(), 0) if isinstance(place, str) else (rest, place)
        count = int(np.prod(shape, dtype=np.int64))
        array = np.frombuffer(source, np.dtype(kind), count, offset).reshape(shape)
        return np.array(array, order=order)

    return hear(json.loads(text.tobytes()))
