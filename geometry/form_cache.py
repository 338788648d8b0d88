"""Compiled forms: each is loaded once, from a folder in which no compilation that was killed holds up others.

FFCx marks a form that is being compiled by an empty file, and waits for its end wherever it finds one. Whoever
compiles here holds a shared lock, so files without an end are left over if nobody holds it.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import stat
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path
from typing import Any

from stickslip.geometry.errors import MachineError

LOCK = ".lock"
TURN, TURNS = 10, 60  # [s] to wait for another process between two looks for left-overs, and how often
MANY_POINTS = "Number of integration points per cell"  # a warning of FFCx
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)


def find_cache() -> tuple[Path, str]:
    """The folder, and why it is not the usual one.

    It is `stickslip` in XDG_CACHE_HOME, or in ~/.cache; if that cannot be written, one of the user's own among the
    temporary files.

    Raises:
        MachineError: no folder can be written.
    """
    try:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        usual = base.expanduser().absolute() / "stickslip"
        usual.mkdir(parents=True, exist_ok=True)
        if os.access(usual, os.W_OK | os.X_OK):
            return usual, ""
        why = f"{usual} cannot be written"
    except (OSError, RuntimeError) as error:
        why = str(error) if isinstance(error, RuntimeError) else f"{error.filename}: {error.strerror}"
    folder = _temporary()
    return folder, f"compiled forms are kept in {folder}, for {' '.join(why.split())}"


def _temporary() -> Path:
    try:
        folder = Path(tempfile.gettempdir()) / f"stickslip-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        about = folder.lstat()
        if stat.S_ISDIR(about.st_mode) and about.st_uid == os.getuid() and not about.st_mode & 0o022:
            return folder  # nobody else can put a program there
        return Path(tempfile.mkdtemp(prefix="stickslip_"))
    except OSError as error:
        raise MachineError(f"compiled forms can be kept nowhere: {error.strerror}; set XDG_CACHE_HOME") from None


def remove_left_over(cache: Path) -> int:
    """Remove what compilations that were killed have left; none if somebody compiles now. Returns their number."""
    if not _unfinished(cache):
        return 0
    with _locked(cache, fcntl.LOCK_EX) as alone:
        found = _unfinished(cache) if alone else []
        for path in found:
            for other in (*cache.glob(f"{path.stem}.*"), path):
                other.unlink(missing_ok=True)
    return len(found)


def _unfinished(cache: Path) -> list[Path]:
    """Sources of compilations that did not end; one listing, for the folder can hold thousands of files."""
    names = set(os.listdir(cache))
    return [cache / name for name in sorted(names) if name.endswith(".c") and f"{name}.cached" not in names]


@contextmanager
def _locked(cache: Path, kind: int) -> Iterator[bool]:
    """Hold a lock; False if it cannot be had at once, or the disk has none."""
    descriptor = os.open(cache / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        try:
            fcntl.flock(descriptor, kind | (fcntl.LOCK_NB if kind == fcntl.LOCK_EX else 0))
        except OSError as error:
            if not isinstance(error, BlockingIOError) and error.errno not in NO_LOCKS:
                raise
            yield False
        else:
            yield True
    finally:
        os.close(descriptor)


@contextmanager
def _silent() -> Iterator[None]:
    """FFCx warns of dense quadrature, which is asked for where it is needed; setuptools tells all loggers of gcc."""
    former = logging.root.manager.disable
    logging.disable(max(former, logging.INFO))
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", MANY_POINTS)
            yield
    finally:
        logging.disable(former)


def patient(compile_object: Callable[..., Any], cache: Path) -> Callable[..., Any]:
    """A compiler of UFL objects that waits for other processes, and clears away what killed ones have left.

    Args:
        compile_object: of dolfinx, collective on the communicator that is its first argument.
    """

    clean = 0  # when the folder was last changed [ns], if nothing was unfinished there: a look at it takes 5 ms

    @wraps(compile_object)
    def act(comm: Any, *arguments: Any, **options: Any) -> Any:
        nonlocal clean
        for turn in range(TURNS):
            if comm.rank == 0:
                with suppress(OSError):  # the compiler will say it
                    changed = cache.stat().st_mtime_ns
                    if (turn or changed != clean) and remove_left_over(cache) == 0:
                        clean = changed
            comm.barrier()  # the other ranks must not hold the lock meanwhile
            try:
                with _locked(cache, fcntl.LOCK_SH), _silent():
                    return compile_object(comm, *arguments, **options)
            except Exception as error:
                late = comm.bcast("compilation timed out" in str(error)) if comm.size > 1 else "timed out" in str(error)
                if not late or turn + 1 == TURNS:
                    raise MachineError(f"{cache}: forms cannot be compiled there: {_first_line(error)}") from None
        raise AssertionError

    return act


def once(compile_object: Callable[..., Any]) -> Callable[..., Any]:
    """A compiler of UFL objects that asks FFCx once for each: it lists the whole folder to load a form, 8 ms a time.

    Args:
        compile_object: of dolfinx, collective on the communicator that is its first argument.
    """
    known: dict[str, Any] = {}

    @wraps(compile_object)
    def act(comm: Any, asked: Any, *arguments: Any, **options: Any) -> Any:
        if isinstance(asked, tuple):  # an expression, and points that no text tells apart
            return compile_object(comm, asked, *arguments, **options)
        # forms and elements, as FFCx tells them apart
        same = asked.signature() if hasattr(asked, "signature") else repr(asked)
        key = f"{same} {arguments} {options}"
        if not all(comm.allgather(key in known)):  # some ranks may have compiled it by themselves
            known[key] = compile_object(comm, asked, *arguments, **options)
        return known[key]

    return act


def _first_line(error: Exception) -> str:
    if isinstance(error, OSError):
        return error.strerror or str(error)
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
