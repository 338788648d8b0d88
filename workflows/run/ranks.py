"""Ranks act together: all of them fail or none, and all of them stop where one is told to; or there is one alone."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, TypeVar

from stickslip.geometry.errors import MachineError, SceneError, StickslipError

T = TypeVar("T")
NOTED = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)  # Ctrl-C, and signals of batch queues before the time limit
IMPATIENT = 3  # presses of Ctrl-C after which the program stops at once
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

    What the process ignores stays ignored: Ctrl-C is not for a program in the background of a script.
    """

    def __init__(self) -> None:
        self._presses = 0
        self._former: dict[signal.Signals, Any] = {}
        self.by = ""  # name of the first signal, on any rank

    def __enter__(self) -> Interrupt:
        if threading.current_thread() is threading.main_thread():  # signals reach the main thread only
            heard = [number for number in NOTED if signal.getsignal(number) is not signal.SIG_IGN]  # nohup ignores some
            self._former = {number: signal.signal(number, self._note) for number in heard}
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
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
            self.by = named
            raise KeyboardInterrupt


def refuse_mpirun(why: str) -> None:
    """Refuse ranks of `mpirun`.

    Args:
        why: the command, and why it takes none.

    Raises:
        SceneError: it was started by mpirun.
    """
    if any(size in os.environ for size in SIZES):
        raise SceneError(f"{why}; start it without mpirun")
