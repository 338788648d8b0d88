"""Ctrl-C that waits for a safe moment: the end of an iteration or of a step, never the middle of a file."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any

IMPATIENT = 3  # presses after which the program stops at once


class Interrupt:
    """Context in which Ctrl-C is only noted; `check` raises it where the run can stop."""

    def __init__(self) -> None:
        self._presses = 0
        self._former: Any = None

    def __enter__(self) -> Interrupt:
        if threading.current_thread() is threading.main_thread():  # signals reach the main thread only
            self._former = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *error: object) -> None:
        if self._former is not None:
            signal.signal(signal.SIGINT, self._former)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._presses += 1
        if self._presses >= IMPATIENT:
            signal.default_int_handler(number, frame)

    @property
    def pressed(self) -> bool:
        """Whether Ctrl-C was pressed on this rank."""
        return self._presses > 0

    def check(self, comm: Any) -> None:
        """Stop here if Ctrl-C was pressed on any rank; collective.

        Raises:
            KeyboardInterrupt: on every rank.
        """
        if any(comm.allgather(self.pressed)):
            raise KeyboardInterrupt
