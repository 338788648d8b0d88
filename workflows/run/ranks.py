"""Ranks act together: all of them fail or none, and all of them stop where one is told to; or there is one alone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, TypeVar

from stickslip.geometry.errors import MachineError, SceneError, StickslipError

T = TypeVar("T")
NOTED = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)  # Ctrl-C, and signals of batch queues before the time limit
IMPATIENT = 3  # presses of Ctrl-C after which the program stops at once
PATIENCE = 4.0  # s after Ctrl-C in which the program may stop by itself
GUARD = """
import os, select, signal, sys, time
run, said, patience, presses, kept = int(sys.argv[1]), sys.argv[2], float(sys.argv[3]), int(sys.argv[4]), sys.argv[5]
signal.signal(signal.SIGTERM, signal.SIG_IGN)
def gone(seconds):
    until = time.monotonic() + seconds
    while select.select([0], [], [], max(until - time.monotonic(), 0))[0]:
        if not os.read(0, 1):
            return True
while heard := os.read(0, 1):
    if heard[0] == signal.SIGINT:
        break
else:
    sys.exit()
os.write(2, (said and said + chr(10)).encode())
if gone(patience):
    sys.exit()
for number in [signal.SIGINT] * presses + [signal.SIGKILL]:
    os.kill(run, number)
    if gone(patience / 20):
        break
if said:
    os.write(2, f"stickslip: interrupted{kept}{chr(10)}".encode())
"""
KEPT = "; solved steps are kept, --resume goes on from them"
SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")  # that mpirun sets


def raise_together(comm: Any, act: Callable[[], object]) -> None:
    """Run `act` on rank 0; its error, if any, is raised on every rank."""
    failure, mistake = _failed(act, 0) if comm.rank == 0 else (None, None)
    _raise(comm.bcast(failure), mistake)


def all_act(comm: Any, act: Callable[[], object]) -> None:
    """Run `act` on every rank; the first error, if any, is raised on every rank."""
    failure, mistake = _failed(act, comm.rank)
    _raise(next((f for f in comm.allgather(failure) if f is not None), None), mistake)


def _failed(act: Callable[[], object], rank: int) -> tuple[StickslipError | None, BaseException | None]:
    """Return the error to tell the others, and the one to show here."""
    try:
        act()
    except StickslipError as error:
        return error, None
    except OSError as error:
        return MachineError(f"{error.filename or 'results'}: {error.strerror or error}"), None
    except (Exception, SystemExit) as error:  # this rank shows it, the others must not wait for ever
        return StickslipError(f"rank {rank} failed: {error}"), error
    return None, None


def _raise(failure: StickslipError | None, mistake: BaseException | None) -> None:
    if mistake is not None:
        raise mistake
    if failure is not None:
        raise failure


def from_rank_0(comm: Any, act: Callable[[], T]) -> T:
    """Return on every rank what `act` returns on rank 0; its error, if any, is raised on every rank."""
    found: list[T] = []
    raise_together(comm, lambda: found.append(act()))
    shared: T = comm.bcast(found[0] if found else None)
    return shared


class Interrupt:
    """Context in which signals are only noted; `check` raises where the run can stop.

    What the process ignores stays ignored: Ctrl-C is not for a program in the background of a script. Of a process that
    is alone another one answers Ctrl-C at once, for a library may keep Python from hearing it, and ends what does not
    stop in time.
    """

    def __init__(self, answer: str | None = None, kept: str = KEPT) -> None:
        """
        Args:
            answer: what is said at once after Ctrl-C, "" for nothing; None: there is no time in which it must end.
            kept: what is said of what there is, where it was ended.
        """
        self._presses, self._answer, self._kept = 0, answer, kept
        self._guard: tuple[subprocess.Popen[bytes], int, int] | None = None  # its pipe, and who was woken before
        self._former: dict[signal.Signals, Any] = {}
        self.by = ""  # name of the first signal, on any rank

    def __enter__(self) -> Interrupt:
        if threading.current_thread() is threading.main_thread():  # signals reach the main thread only
            heard = [number for number in NOTED if signal.getsignal(number) is not signal.SIG_IGN]  # nohup ignores some
            self._former = {number: signal.signal(number, self._note) for number in heard}
            if self._answer is not None and signal.SIGINT in heard and not any(size in os.environ for size in SIZES):
                self._guard = guarded(self._answer, self._kept)
        return self

    def _let_go(self) -> None:
        """End the guard."""
        if self._guard is not None:
            process, pipe, before = self._guard
            signal.set_wakeup_fd(before)
            os.close(pipe)
            process.wait()
            self._guard = None

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._let_go()
        for number, former in self._former.items():
            signal.signal(number, former)
        if self.by and isinstance(error, MachineError):  # Ctrl-C also ends a compiler that the run waits for
            raise KeyboardInterrupt from error

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.by = self.by or signal.Signals(number).name
        self._presses += number == signal.SIGINT
        if self._presses >= IMPATIENT:
            os._exit(128 + signal.SIGINT)  # every step is on the disk; under mpirun the other ranks end too

    @property
    def pressed(self) -> bool:
        """Whether a signal came to this rank."""
        return bool(self.by)

    def check(self, comm: Any) -> None:
        """Stop here if a signal came to any rank; collective.

        Raises:
            KeyboardInterrupt: on every rank.
        """
        named = next((name for name in comm.allgather(self.by) if name), "")
        if named:
            self._let_go()
            self.by = named
            raise KeyboardInterrupt


def guarded(answer: str, kept: str) -> tuple[subprocess.Popen[bytes], int, int]:
    """Start the process that answers Ctrl-C of this one: it, the pipe that wakes it, and what was woken before.

    Signals wake it also while a library works. It ends where the pipe is closed.
    """
    here, wakes = os.pipe()
    os.set_blocking(wakes, False)
    words = [sys.executable, "-I", "-S", "-c", GUARD, str(os.getpid()), answer, str(PATIENCE), str(IMPATIENT), kept]
    with open(here, "rb", buffering=0) as pipe:
        process = subprocess.Popen(words, stdin=pipe, stdout=subprocess.DEVNULL, start_new_session=True)
    return process, wakes, signal.set_wakeup_fd(wakes, warn_on_full_buffer=False)


def refuse_mpirun(why: str) -> None:
    """Refuse ranks of `mpirun`.

    Args:
        why: the command, and why it takes none.

    Raises:
        SceneError: it was started by mpirun.
    """
    if any(size in os.environ for size in SIZES):
        raise SceneError(f"{why}; start it without mpirun")
