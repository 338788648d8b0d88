"""The process of the command line: signals that stop it, what it prints, how its ranks end; imports no library."""

from __future__ import annotations

import os
import signal
import sys
import time as clock

from stickslip.geometry.errors import printable

BEGAN = clock.perf_counter()  # about when the process began
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)
STOPPED = 130  # exit code
LEAVING = 7401  # tag of the message by which a rank says that it ends
PATIENCE, SHORT = 60.0, 5.0  # s for the other ranks to end too: after an error, and after a signal
LOOK = 0.01  # s between two looks for their messages
refused = list[str]()  # the lines with which this process says that it fails, printed or not


def speaks() -> bool:
    """Whether this process prints: rank 0 only."""
    return os.environ.get("OMPI_COMM_WORLD_RANK", os.environ.get("PMI_RANK", "0")) == "0"


def say(line: str) -> None:
    """Print a line in which names of files and scenes may stand."""
    print(printable(line), flush=True)


def complain(line: str) -> None:
    """Print such a line on stderr, on rank 0."""
    if speaks():
        print(f"stickslip: {printable(line)}", file=sys.stderr, flush=True)


def leave_together(code: int) -> None:
    """Before a rank ends with an error, see that the others end too: they would wait for it for ever.

    Where all ranks fail alike, each ends by itself, and rank 0 has said why. One that fails alone says it, and ends
    them all.

    Args:
        code: exit code of this rank.
    """
    if "mpi4py.MPI" not in sys.modules:  # mpirun itself ends the others
        return
    from mpi4py import MPI

    comm, until = MPI.COMM_WORLD, clock.monotonic() + (SHORT if code == STOPPED else PATIENCE)
    if comm.size == 1:
        return
    if comm.rank:
        comm.isend(None, 0, LEAVING)
    waited_for = [0] if comm.rank else list(range(1, comm.size))
    while code and waited_for:
        waited_for = [rank for rank in waited_for if not comm.iprobe(rank, LEAVING)]
        if waited_for and clock.monotonic() > until:
            if comm.rank and refused:
                print(f"{refused[-1]} (rank {comm.rank} alone)", file=sys.stderr, flush=True)
            comm.Abort(code)
        clock.sleep(LOOK)
    for rank in range(1, comm.size) if comm.rank == 0 else ():
        comm.isend(None, rank, LEAVING)
