"""Files of JSON, and others that are read only if they are files: a pipe or a device in their place has no end."""

from __future__ import annotations

import errno
import json
import math
import os
import stat
from pathlib import Path
from typing import Any

from stickslip.workflows.formats.aside import write_aside


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


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a JSON file whole; see `write_aside`."""
    write_aside(path, f"{json_text(content)}\n".encode())


def json_text(content: dict[str, Any], indent: int | None = 1) -> str:
    """As a JSON file has it, on one line without an indent; a number that is not finite becomes null."""
    return json.dumps(_finite(content), indent=indent, ensure_ascii=False, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
