"""Files appear whole or not at all, and are read only if they are regular files: a pipe or a device has no end."""

from __future__ import annotations

import errno
import json
import math
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from stickslip.geometry.errors import MachineError


def write_aside(path: Path, *content: bytes | memoryview) -> None:
    """Write beside `path`, bring it to the disk, then rename: readers and a crash see the old file or the new one.

    A link is followed and kept.

    Raises:
        MachineError: disk full, no permission; `path` is then as it was.
    """
    with disk_errors(path):
        path = Path(os.path.realpath(path)) if path.is_symlink() else path
        aside = path.with_name(f".{path.name}.part")
        try:
            with aside.open("wb") as file:
                file.writelines(content)
                file.flush()
                os.fsync(file.fileno())
            aside.replace(path)
        except BaseException:  # also on Ctrl-C
            aside.unlink(missing_ok=True)
            raise
        sync_folder(path.parent)


def write_output(path: Path, content: bytes) -> None:
    """Write a file that the user names, in a folder that is made where it is missing; see `write_aside`."""
    if not path.parent.exists():
        make_folder(path.parent)
    write_aside(path, content)


def make_folder(folder: Path) -> None:
    """Create a folder that outlives a crash.

    Raises:
        MachineError: disk full, no permission.
    """
    if folder.is_dir():
        return
    with disk_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        sync_folder(folder.parent)


def sync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk: a rename is not safe before."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Say in one line which file could not be written."""
    try:
        yield
    except OSError as error:
        raise MachineError(f"{path}: cannot be written: {error.strerror or error}") from error


def read_regular(path: Path, size: int = -1) -> bytes:
    """Bytes of a regular file, the first `size` of them.

    Raises:
        OSError: there is none, or it is something else.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "not a regular file", str(path))
        return file.read(size)


def parse_json(content: bytes) -> Any:
    """
    Raises:
        ValueError: it is not JSON, or nested too deeply.
    """
    try:
        return json.loads(content)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def read_json(path: Path) -> dict[str, Any]:
    """The table in a JSON file; an empty one where there is none, or no such file."""
    try:
        found = parse_json(read_regular(path))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def write_json(path: Path, content: dict[str, Any], write: Callable[[Path, bytes], None] = write_aside) -> None:
    """Write a JSON file whole; see `write_aside`."""
    write(path, f"{json_text(content)}\n".encode())


def json_text(content: dict[str, Any], indent: int | None = 1) -> str:
    """Return the text of a JSON file, on one line without an indent; a number that is not finite becomes null."""
    return json.dumps(_finite(content), indent=indent, ensure_ascii=False, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
