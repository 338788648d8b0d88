"""Entry point of the command line: streams, signals and the working folder, before the imports that take seconds."""

from __future__ import annotations

import errno
import os
import resource
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import NoReturn

from stickslip.workflows.commands.process import STOPPED, STOPPING, speaks

LIBRARIES = 1_000_000  # kB; where less is allowed, OpenBLAS may ask for its memory for ever
LAUNCHED = ("OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK", "PMI_FD")  # by mpirun, or by srun of Slurm
ALONE = {  # of Open MPI: a process that has nobody to talk to
    "PMIX_MCA_gds": "hash",  # needs no shared file in a folder that may be full
    "OMPI_MCA_ess_singleton_isolated": "1",  # needs no daemon, which takes .1 s to start
    "OMPI_MCA_orte_create_session_dirs": "0",  # nor a folder, which such processes share and remove while one begins
    "OMPI_MCA_pml": "ob1",  # and no network, where it takes .2 s to find out which there are
}


def main() -> None:
    """Entry point of the console script."""
    try:
        _prepare()
        from stickslip.workflows.commands.cli import main as command

        command()
    except KeyboardInterrupt:  # beside what `command` guards
        _interrupted()


def _prepare() -> None:
    """Signals, streams, folders and MPI's variables."""
    for number in STOPPING:
        if signal.getsignal(number) is not signal.SIG_IGN:  # nohup, or a shell's background
            signal.signal(number, _stop)
    _open_streams()
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if 0 <= limit < 1024 * LIBRARIES:
        _end(f"ulimit -v {limit // 1024}: too little memory, the libraries alone take nearly {LIBRARIES} kB")
    try:
        os.getcwd()
    except OSError as error:
        _end(f"the working folder is gone: {error.strerror}; go to another one")
    _find_temporary_folder()
    _stay_alone()


def _end(why: str) -> NoReturn:
    """The environment fails before anything is read."""
    if speaks():
        with suppress(OSError):
            print(f"stickslip: {why}", file=sys.stderr)
    sys.exit(4)


def _find_temporary_folder() -> None:
    """Replace a TMPDIR that leads nowhere: MPI would end the process with a page of its own."""
    chosen = os.environ.get("TMPDIR")
    if chosen is None:
        return
    import tempfile

    try:
        os.environ["TMPDIR"] = tempfile.gettempdir()
    except OSError:
        _end(f"TMPDIR = {chosen}: nothing can be written there, nor in other folders for temporary files")


def _stay_alone() -> None:
    """Tell MPI so, unless something has launched several ranks, or the user says otherwise."""
    if not any(name in os.environ for name in LAUNCHED):
        for name, value in ALONE.items():
            os.environ.setdefault(name, value)


def _open_streams() -> None:
    """Open standard streams that are closed: nothing is read, and what is written is lost."""
    for number, mode in enumerate("rww"):
        try:
            os.fstat(number)
        except OSError as error:
            if error.errno != errno.EBADF:
                raise
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
            stream = open(number, mode, closefd=False)  # noqa: SIM115  until the process ends
            setattr(sys, ("stdin", "stdout", "stderr")[number], stream)


def _stop(number: int, frame: FrameType | None) -> None:
    """End here: by an error that lets everybody clean up, but at once within an import, which no error may leave."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            _interrupted()
        frame = frame.f_back
    raise KeyboardInterrupt


def _interrupted() -> NoReturn:
    if speaks():
        with suppress(OSError):  # nothing is left to tell it to
            os.write(2, b"stickslip: interrupted\n")
    os._exit(STOPPED)


if __name__ == "__main__":
    main()
