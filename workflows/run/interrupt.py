"""Signals that take effect at the end of an iteration or of a step only, so that no file is left half written."""

from __future__ import annotations

import os
import signal
import threading
from types import FrameType
from typing import Any

from stickslip.geometry.errors import MachineError

NOTED = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)  # Ctrl-C, and signals of batch queues before the time limit
IMPATIENT = 3  # presses of Ctrl-C after which the program stops at once


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
