"""A disk that fails as another one would, or whose process does: for tests that may be run by root as well."""

from __future__ import annotations

import errno
import io
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from shared.processes import exit_code, forked

CHANGES = ("fsync", "replace", "rename", "unlink", "mkdir", "rmdir")  # of the module os: what outlives a process


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


def make_full(patch: pytest.MonkeyPatch) -> None:
    """As a disk is without room: what is written does not get there."""

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    patch.setattr(os, "fsync", full)


class Disk:
    """Counts the changes of what lies below a folder; before the n-th one the process is killed, as by a power cut."""

    def __init__(self, below: Path, killed_at: int = 0, torn: int = 0) -> None:
        """`torn`: bytes of a table's last row that the power cut keeps from the disk."""
        self.below, self.killed_at, self.torn, self.count = f"{below}/", killed_at, torn, 0

    def watch(self, patch: pytest.MonkeyPatch) -> None:
        for name in CHANGES:
            patch.setattr(os, name, self._counted(name, getattr(os, name)))

    def _counted(self, name: str, act: Callable[..., Any]) -> Callable[..., Any]:
        def counted(path: Any, *rest: Any, **options: Any) -> Any:
            place = os.readlink(f"/proc/self/fd/{path}") if isinstance(path, int) else os.path.abspath(path)
            if f"{place}/".startswith(self.below):  # not in the cache of compiled forms
                self.count += 1
                if self.count == self.killed_at:
                    if name == "fsync" and place.endswith(".csv") and os.fstat(path).st_size > self.torn:
                        os.truncate(path, os.fstat(path).st_size - self.torn)
                    os.kill(os.getpid(), signal.SIGKILL)
            return act(path, *rest, **options)

        return counted


def killed_at(change: int, below: Path, act: Callable[[], object], torn: int = 0) -> bool:
    """Whether it did so much below a folder, in a process of its own, that it was killed before this change."""

    def watched() -> None:
        Disk(below, change, torn).watch(pytest.MonkeyPatch())
        act()

    code = exit_code(forked(watched))
    assert code in (0, -signal.SIGKILL)
    return code != 0
