"""Named arrays and numbers in an HDF5 file that knows its own checksum.

The file is built in memory and written by plain Python: HDF5 itself recovers badly from a full disk. Its metadata
carry checksums too (format 1.8), so that damage outside the arrays is found as well.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from geometry.errors import MachineError
from workflows.writers.aside import write_aside

AnyArray = NDArray[Any]
Numbers = Mapping[str, float | int]


def checksum(arrays: Mapping[str, AnyArray], numbers: Numbers) -> str:
    """sha256 over name, type, shape and bytes of every array, and name and value of every number.

    >>> checksum({}, {"time": 1.0}) == checksum({}, {"time": 2.0})
    False
    """
    total = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(np.ascontiguousarray(array).tobytes())
    for name, number in sorted(numbers.items()):
        total.update(f"{name} {number!r}\n".encode())
    return total.hexdigest()


def write_arrays(path: Path, arrays: Mapping[str, AnyArray], numbers: Numbers) -> None:
    """Write datasets and attributes; a name may hold slashes (groups).

    Raises:
        MachineError: the disk is full.
    """
    content = io.BytesIO()
    with h5py.File(content, "w", libver=("v108", "v108")) as file:
        for name, array in arrays.items():
            file[name] = array
        file.attrs.update(numbers)
        file.attrs["checksum"] = checksum(arrays, numbers)
    write_aside(path, content.getvalue())


def read_arrays(path: Path) -> tuple[dict[str, AnyArray], dict[str, float | int]]:
    """Arrays and numbers, verified.

    Raises:
        MachineError: the file is missing, cut short or damaged.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise MachineError(f"{path}: cannot be read: {error.strerror}") from error
    arrays: dict[str, AnyArray] = {}

    def keep(name: str, found: object) -> None:
        if isinstance(found, h5py.Dataset):
            arrays[name] = found[()]

    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            file.visititems(keep)
            numbers = {name: value.item() for name, value in file.attrs.items() if name != "checksum"}
            expected = file.attrs["checksum"]
    except Exception as error:  # h5py meets a broken file with almost any exception
        raise MachineError(f"{path}: damaged or cut short, not a readable HDF5 file") from error
    if checksum(arrays, numbers) != expected:
        raise MachineError(f"{path}: damaged: its content does not match its checksum")
    return arrays, numbers


def stored_checksum(path: Path) -> str | None:
    """What the file says its checksum is; None where there is no such file."""
    try:
        with h5py.File(path, "r") as file:
            return str(file.attrs["checksum"])
    except (OSError, KeyError):
        return None
