"""A disk that fails as another one would: for tests that may be run by root, whom no permission stops."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


def make_read_only(place: Path, patch: pytest.MonkeyPatch) -> None:
    """As a disk is that is mounted for reading."""

    def refuse(act: Callable[..., Any], writes: Callable[..., bool]) -> Callable[..., Any]:
        def acted(path: Any, *rest: Any, **options: Any) -> Any:
            if (
                isinstance(path, str | Path)
                and Path(path).absolute().is_relative_to(place)
                and writes(*rest, **options)
            ):
                raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
            return act(path, *rest, **options)

        return acted

    def by_mode(mode: str = "r", *rest: Any, **options: Any) -> bool:
        return bool(set("wax+") & set(mode))

    def by_flags(flags: int, *rest: Any, **options: Any) -> bool:
        return bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))

    patch.setattr(io, "open", refuse(io.open, by_mode))
    patch.setattr(os, "open", refuse(os.open, by_flags))
    for name in ("rename", "replace", "unlink", "mkdir", "rmdir", "truncate"):
        patch.setattr(os, name, refuse(getattr(os, name), lambda *rest, **options: True))
