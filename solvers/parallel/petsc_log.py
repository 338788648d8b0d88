"""PETSc's own log: how often its events happened on this rank, how long they took, and what they sent."""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc


@dataclass(frozen=True)
class Event:
    """One event of PETSc so far on this rank, what it called included; two of them can be subtracted."""

    calls: float
    seconds: float  # wall time [s]
    messages: float
    bytes: float  # of the messages

    def __sub__(self, earlier: Event) -> Event:
        return Event(
            self.calls - earlier.calls,
            self.seconds - earlier.seconds,
            self.messages - earlier.messages,
            self.bytes - earlier.bytes,
        )


def begin_log() -> None:
    """Start PETSc's log; events before this call are not in it."""
    PETSc.Log.begin()


def logged(name: str) -> Event:
    """The event of that name, such as MatMult, in the current stage."""
    found = PETSc.Log.Event(name).getPerfInfo()
    return Event(*(float(found[key]) for key in ("count", "time", "numMessages", "messageLength")))
