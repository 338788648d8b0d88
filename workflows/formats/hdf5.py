"""Named arrays and numbers in an HDF5 file that knows its own checksum.

HDF5 recovers badly from a full disk, and a single wrong byte in its metadata can make it loop for ever. So a file is
built in memory and written by plain Python, and its user block (512 bytes ahead of what HDF5 reads) holds a line with
the sha256 of all that follows, which is compared before HDF5 sees the file.
"""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np

from stickslip.geometry.arrays import AnyArray
from stickslip.geometry.errors import DamagedError, MachineError
from stickslip.geometry.user_files.hdf5_datasets import datasets
from stickslip.workflows.formats.files import read_regular, write_aside
from stickslip.workflows.formats.marker import USER_BLOCK, read_checked

Numbers = Mapping[str, float | int]
LINE = "stickslip: sha256 of the bytes from 512 on {bytes}, of the arrays {arrays}\n"
PATTERN = re.compile(re.escape(LINE).replace(r"\{bytes\}", "([0-9a-f]{64})").replace(r"\{arrays\}", "([0-9a-f]{64})"))


def checksum(arrays: Mapping[str, AnyArray], numbers: Numbers) -> str:
    """sha256 over name, type, shape and bytes of every array, and name and value of every number.

    >>> checksum({}, {"time": 1.0}) == checksum({}, {"time": 2.0})
    False
    """
    total = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(np.ascontiguousarray(array).data)
    for name, number in sorted(numbers.items()):
        total.update(f"{name} {number!r}\n".encode())
    return total.hexdigest()


def write_arrays(path: Path, arrays: Mapping[str, AnyArray], numbers: Numbers) -> None:
    """Write datasets and attributes (with the attribute `checksum`); a name may hold slashes (groups).

    Raises:
        MachineError: the disk is full.
    """
    content, total = io.BytesIO(), checksum(arrays, numbers)
    with h5py.File(content, "w", libver=("v108", "v108"), userblock_size=USER_BLOCK) as file:
        for name, array in arrays.items():
            file[name] = array
        file.attrs.update(numbers)
        file.attrs["checksum"] = total
    with content.getbuffer() as whole, whole[USER_BLOCK:] as rest:
        line = LINE.format(bytes=hashlib.sha256(rest).hexdigest(), arrays=total)
        write_aside(path, line.encode().ljust(USER_BLOCK, b"\0"), rest)


def read_arrays(path: Path, but: str = "") -> tuple[dict[str, AnyArray], dict[str, float | int]]:
    """Arrays and numbers, verified.

    Args:
        but: beginning of names of arrays that are not read.

    Raises:
        DamagedError: the file is cut short, or its content does not match its checksum.
        MachineError: it cannot be read, is foreign, or has its numbers elsewhere; see `read_checked`.
    """
    content = read_checked(path)
    if len(content) < USER_BLOCK:
        raise DamagedError(f"{path}: damaged: cut short")
    sums = _sums(content)
    if sums is None:
        raise MachineError(f"{path}: damaged, or not a file of stickslip: it does not begin with its checksum")
    if hashlib.sha256(memoryview(content)[USER_BLOCK:]).hexdigest() != sums[0]:
        raise DamagedError(f"{path}: damaged or cut short: its content does not match its checksum")
    with h5py.File(io.BytesIO(content), "r") as file:
        found, arrays = datasets(file), dict[str, AnyArray]()
        for name, item in found.items():
            if item is None:
                raise MachineError(f"{path}: {name} has its numbers in another file; no run writes that")
            if not (but and name.startswith(but)):
                arrays[name] = np.empty(item.shape, item.dtype)
                item.read(h5py.h5s.ALL, h5py.h5s.ALL, arrays[name])
        return arrays, {name: value.item() for name, value in file.attrs.items() if name != "checksum"}


def is_whole(path: Path, total: str) -> bool:
    """Return whether a file is there, undamaged, and its arrays have this checksum."""
    try:
        read_arrays(path)
    except MachineError:
        return False
    return stored_checksum(path) == total


def stored_checksum(path: Path) -> str | None:
    """Return the checksum of its arrays that the file states; None where there is no such file."""
    try:
        sums = _sums(read_regular(path, USER_BLOCK))
    except OSError:
        return None
    return sums[1] if sums else None


def _sums(content: bytes) -> tuple[str, str] | None:
    """Checksums of bytes and arrays, from the user block."""
    block = content[:USER_BLOCK]
    found = PATTERN.match(block.decode("latin-1"))
    if found is None or block[found.end() :].strip(b"\0") or len(block) < USER_BLOCK:
        return None
    return found[1], found[2]
