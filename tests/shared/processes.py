"""Processes that a test has started, and theirs."""

from __future__ import annotations

import re
import subprocess
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")
LIMIT = 60  # s


@contextmanager
def running(words: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A process that lives no longer than this block, also where the test fails: nothing waits for it then."""
    with subprocess.Popen(words, text=True, **options) as process:
        try:
            yield process
        finally:
            process.kill()


def children(process: int) -> list[int]:
    """Process numbers, in the order in which they were started; those of mpirun are its ranks."""
    return [int(number) for number in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def is_there(process: int) -> bool:
    """Whether any of its threads runs: until the last one ends, its files are open and locked."""
    states = []
    for thread in Path(f"/proc/{process}/task").glob("*/stat"):
        with suppress(OSError):
            states.append(thread.read_text().rpartition(")")[2].split()[0])
    return any(state not in "ZX" for state in states)


def catches(process: int, number: int) -> bool:
    """Whether it has a handler for this signal."""
    (mask,) = re.findall(r"^SigCgt:\s*(\w+)$", Path(f"/proc/{process}/status").read_text(), re.MULTILINE)
    return bool(int(mask, 16) >> (number - 1) & 1)


def words_of(process: int) -> list[bytes]:
    """Its command line; empty if it has ended."""
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return []


def wait_for(look: Callable[[], T], what: str) -> T:
    """What `look` finds, as soon as it finds something."""
    until = clock.monotonic() + LIMIT
    while not (found := look()):
        assert clock.monotonic() < until, f"waited in vain for {what}"
        clock.sleep(1e-3)
    return found


def gmsh_child(process: int, doing: str) -> int:
    """The child in which gmsh reads a file or meshes it for this process."""

    def look() -> int:
        for child in children(process):
            if b"stickslip.geometry.user_files.reader" in words_of(child) and child not in others:
                if doing == "reading" or others:
                    return child
                others.add(child)
        return 0

    others = set[int]()
    return wait_for(look, f"gmsh's process, {doing}")
