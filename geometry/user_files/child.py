"""A process of Python that ends with this one: at its time limit, at a signal, and when this one is killed."""

from __future__ import annotations

import ctypes
import os
import select
import signal
import subprocess
import sys
import threading
import time as clock
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import IO

from stickslip.geometry.memory import is_full

ROOT = Path(__file__).absolute().parents[3]  # where `stickslip` is found
PR_SET_PDEATHSIG = 1
TELLING = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)  # signals that ask this process to stop
LOOK = 0.02  # s between two looks at the process
PIPE = 2**16  # bytes that a pipe holds; so many of the beginning, and of the end, of what is printed are kept


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a child process ended."""

    code: int | None  # its exit code; -n: signal n ended it; None: its time was over
    printed: str
    full: bool  # whether it had taken nearly all memory that it may take


def run_child(module: str, words: Sequence[str], folder: Path | None, seconds: float) -> Ended:
    """Run `python -m MODULE WORDS PARENT`, PARENT being the number of this process; see `end_with`.

    Args:
        folder: its working folder; None: that of this process.
        seconds: after which it is ended.

    Raises:
        KeyboardInterrupt: a signal came that this process handles.
    """
    command = [sys.executable, "-P", "-m", module, *words, str(os.getpid())]
    until, printed, full, late = clock.monotonic() + seconds, b"", False, False
    with (
        _noted_signals() as came,
        subprocess.Popen(
            command,
            env=child_environment(),
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        ) as process,
    ):
        assert process.stdout is not None
        try:
            while process.poll() is None and not (came or late):
                piece = _read(process.stdout, LOOK)
                printed = _shortened(printed + piece)
                if not piece:  # also where it has closed its end
                    with suppress(subprocess.TimeoutExpired):
                        process.wait(LOOK)
                full = full or is_full(process.pid)
                late = clock.monotonic() > until
        finally:
            process.kill()
            process.wait()
        printed = _shortened(printed + _read(process.stdout, 0.0))
    if came:
        raise KeyboardInterrupt
    text = printed.decode(errors="replace").strip()
    return Ended(code=None if late else process.returncode, printed=text, full=full)


def _read(pipe: IO[bytes], seconds: float) -> bytes:
    """What can be read within some seconds; nothing after its end."""
    poll = select.poll()
    poll.register(pipe, select.POLLIN)
    return os.read(pipe.fileno(), PIPE) if poll.poll(1000 * seconds) else b""


def _shortened(printed: bytes) -> bytes:
    return printed if len(printed) <= 2 * PIPE else printed[:PIPE] + printed[-PIPE:]


@contextmanager
def _noted_signals() -> Iterator[list[int]]:
    """The signals that come meanwhile, if this process has handlers for them: these are called too."""
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():  # signals reach the main thread only
        yield came
        return
    former = {number: handler for number in TELLING if callable(handler := signal.getsignal(number))}

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)
        former[signal.Signals(number)](number, frame)

    try:
        for number in former:
            signal.signal(number, note)
        yield came
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


def child_environment() -> dict[str, str]:
    """Our environment variables; a child finds these packages, and nothing in its working folder."""
    others = [place for place in os.environ.get("PYTHONPATH", "").split(os.pathsep) if os.path.isabs(place)]
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *others])}


def end_with(parent: int) -> None:
    """In a child process: end when the process `parent` ends, however it does, also if it has ended already."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        sys.exit("the process that started this one has ended")
