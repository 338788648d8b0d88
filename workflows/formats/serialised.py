"""Plain data as a text and its arrays as they lie in memory: one file holds it, however many arrays it is made of."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.geometry.arrays import AnyArray
from stickslip.solvers.parallel.serialise import ByNode, Plain
from stickslip.workflows.formats.files import read_regular, write_aside

TEXT, BYTES = "text", "bytes"
ARRAY, BY_NODE = "@array", "@by node"  # keys that no name of a scene can be


class Parts:
    """Arrays one after the other, equal ones once, none copied; those that the file holds anyway are pointed at."""

    def __init__(self, known: Mapping[str, AnyArray]) -> None:
        self.arrays: list[AnyArray] = []
        self.digests: list[str] = []
        self._length = 0
        self._places: dict[str, str | int] = {}
        for name, array in known.items():
            self._places.setdefault(digest_of(array), name)

    def place(self, array: AnyArray) -> dict[str, Any]:
        # rounding depends on the order in memory: sums follow it
        across = array.flags.f_contiguous and not array.flags.c_contiguous
        lying = array.T if across else np.ascontiguousarray(array)
        digest = digest_of(lying)
        if digest not in self._places:
            self._places[digest] = self._length
            self._length += array.nbytes
            self.arrays.append(lying)
            self.digests.append(digest)
        return {ARRAY: [self._places[digest], array.dtype.str, list(array.shape), "F" if across else "C"]}


def digest_of(array: AnyArray) -> str:
    """SHA-256 of what an array holds, row by row."""
    return hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()


def to_parts(plain: Plain, known: Mapping[str, AnyArray]) -> tuple[Any, Parts]:
    """Return plain data as JSON can say them, and the arrays that these point at.

    Args:
        known: arrays that will stand beside them under these names.
    """
    parts = Parts(known)

    def say(value: Plain) -> Any:
        if isinstance(value, ByNode):
            return {BY_NODE: say(value.values)}
        if isinstance(value, np.ndarray):
            return parts.place(value)
        if isinstance(value, dict):
            return {key: say(item) for key, item in value.items()}
        return [say(item) for item in value] if isinstance(value, list) else value

    return say(plain), parts


def from_parts(said: Any, rest: bytes, known: Mapping[str, AnyArray]) -> Plain:
    """The plain data again, to the same bits."""

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
        flat = np.frombuffer(source, np.dtype(kind), count, offset).copy()
        return flat.reshape(shape[::-1]).T if order == "F" else flat.reshape(shape)

    return hear(said)


def to_arrays(plain: Plain, known: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """The arrays `text` and `bytes`; see `to_parts`."""
    said, parts = to_parts(plain, known)
    content = b"".join(array.data for array in parts.arrays)
    return {TEXT: np.frombuffer(json.dumps(said).encode(), np.uint8), BYTES: np.frombuffer(content, np.uint8)}


def from_arrays(text: AnyArray, content: AnyArray, known: Mapping[str, AnyArray]) -> Plain:
    """Return what `to_arrays` was given."""
    return from_parts(json.loads(text.tobytes()), content.tobytes(), known)


class PlainFile:
    """Valid until one of the arrays changes."""

    def __init__(self, plain: Plain) -> None:
        said, self._parts = to_parts(plain, {})
        sizes = [array.nbytes for array in self._parts.arrays]
        self._line = json.dumps([said, sizes, self._parts.digests]).encode() + b"\n"
        self.checksum = hashlib.sha256(self._line).hexdigest()

    def write(self, path: Path) -> None:
        """
        Raises:
            MachineError: the disk is full.
        """
        write_aside(path, self._line, *(array.data for array in self._parts.arrays))


def read_plain(path: Path, checksum: str) -> Plain | None:
    """The plain data, to the same bits; None if the file is lost, damaged, or another one."""
    try:
        file = io.BytesIO(read_regular(path))
    except OSError:
        return None
    line = file.readline()
    if hashlib.sha256(line).hexdigest() != checksum:
        return None
    said, sizes, digests = json.loads(line)
    parts = [file.read(size) for size in sizes]
    if [hashlib.sha256(part).hexdigest() for part in parts] != digests:
        return None
    return from_parts(said, b"".join(parts), {})
