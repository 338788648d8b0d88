"""Plain data in a file of its own, as large as memory: a line of JSON, then the arrays as they lie, none copied.

The line holds the checksum of every array, so that the line's own checksum tells of all, and is known before a byte
is written.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from solvers.plain import Plain
from workflows.writers.aside import write_aside
from workflows.writers.plain_arrays import from_parts, to_parts


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
        with path.open("rb") as file:
            line = file.readline()
            if hashlib.sha256(line).hexdigest() != checksum:
                return None
            said, sizes, digests = json.loads(line)
            parts = [file.read(size) for size in sizes]
    except OSError:
        return None
    if [hashlib.sha256(part).hexdigest() for part in parts] != digests:
        return None
    return from_parts(said, b"".join(parts), {})
