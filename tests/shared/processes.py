"""Processes that a test has started, and theirs."""

from __future__ import annotations

import os
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


def forked(act: Callable[[], object]) -> int:
    """Do it in a process of its own; the process number. What C libraries have set up is there already."""
    if process := os.fork():
        return process
    code = 1
    try:
        act()
        code = 0
    finally:
        os._exit(code)


def exit_code(process: int) -> int:
    """Of a process that was forked, when it has ended; -n: signal n ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


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


def wait_for(look: Callable[[], T], what: str, process: int | None = None) -> T:
    """What `look` finds, as soon as it finds something; of a process, if given, that has not ended by then."""
    until = clock.monotonic() + LIMIT
    while True:
        runs = process is None or is_there(process)  # asked first: it may end as soon as there is something to find
        if found := look():
            return found
        assert runs, f"the process ended before {what}"
        assert clock.monotonic() < until, f"waited in vain for {what}"
        clock.sleep(1e-3)


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
    return wait_for(look, f"gmsh's process, {doing}", process)
