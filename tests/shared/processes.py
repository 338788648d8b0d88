"""Processes that a test has started, and theirs."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")
LIMIT = 60  # s


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
