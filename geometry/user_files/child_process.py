"""A process of Python that ends with this one, and its containment: it starts no program and changes no file.

It ends at its time limit, at a signal, and when this one is killed. It is contained by two walls of the kernel, each
enough alone and both used where the machine has them. Landlock refuses to open a file for writing, to make, rename or
remove one, and to start a program. seccomp leaves only the system calls that reading and computing need; all others
fail. Neither can be taken down again. Files that are open already stay usable: the answer is written through one.
"""

from __future__ import annotations

import ctypes
import errno
import os
import resource
import select
import signal
import subprocess
import sys
import termios
import threading
import time as clock
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
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
    """Ending of a child process."""

    code: int | None  # its exit code; -n: signal n ended it; None: its time was over
    printed: str
    full: bool  # whether it had taken nearly all memory that it may take


def run_child(module: str, words: Sequence[str], folder: Path | None, seconds: float, **variables: str) -> Ended:
    """Run `python -m MODULE WORDS PARENT`, PARENT being the number of this process; see `end_with`.

    Args:
        folder: its working folder; None: that of this process.
        seconds: after which it is ended.
        variables: of its environment, beside those of this process.

    Raises:
        KeyboardInterrupt: a signal came that this process handles.
    """
    command = [sys.executable, "-P", "-m", module, *words, str(os.getpid())]
    until, printed, full, late = clock.monotonic() + seconds, b"", False, False
    with (
        _noted_signals() as came,
        subprocess.Popen(
            command,
            env=child_environment() | variables,
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
    """Read what arrives within some seconds; nothing after its end."""
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


LANDLOCK_CREATE_RULESET, LANDLOCK_ADD_RULE, LANDLOCK_RESTRICT_SELF = 444, 445, 446  # alike on all architectures
LANDLOCK_CREATE_RULESET_VERSION, LANDLOCK_RULE_PATH_BENEATH = 1, 1
PR_SET_NO_NEW_PRIVS = 38
EXECUTE, WRITE_FILE, REMOVE, MAKE = 1 << 0, 1 << 1, 0b11 << 4, 0b1111111 << 6  # rights of <linux/landlock.h>
SINCE = {2: 1 << 13, 3: 1 << 14, 5: 1 << 15}  # version -> refer (rename between folders), truncate, ioctl of devices
TCP, SCOPES = 0b11, 0b11  # bind and connect, from version 4; abstract sockets and signals, from version 6
CLONE_THREAD = 0x10000
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
READING_CALLS = """
access arch_prctl brk clock_getres clock_gettime clock_nanosleep close dup dup2 dup3 epoll_create1 exit exit_group
faccessat faccessat2 fadvise64 fcntl fstat fstatfs futex get_mempolicy get_robust_list getcwd getdents64 getegid
geteuid getgid getpid getppid getrandom getresgid getresuid getrlimit getrusage gettid gettimeofday getuid lseek lstat
madvise membarrier mmap mprotect mremap munmap nanosleep newfstatat pipe2 poll pread64 preadv read readlink readlinkat
readv restart_syscall rseq rt_sigaction rt_sigpending rt_sigprocmask rt_sigreturn rt_sigtimedwait sched_getaffinity
sched_getparam sched_getscheduler sched_setaffinity sched_yield set_robust_list set_tid_address sigaltstack stat statfs
statx sysinfo time times uname write writev
""".split()  # noqa: SIM905  easier to check as words


class RulesetAttr(ctypes.Structure):
    """`struct landlock_ruleset_attr`: what is refused unless a rule allows it."""

    _fields_ = (("fs", ctypes.c_uint64), ("net", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class PathBeneathAttr(ctypes.Structure):
    """`struct landlock_path_beneath_attr`: what is allowed beneath an open folder."""

    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32))


def walls() -> tuple[str, ...]:
    """Names of the walls that this machine has: Landlock, seccomp, both or none."""
    return ("Landlock",) * (_landlock_version() > 0) + ("seccomp",) * _has_seccomp()


def contain(memory: int) -> None:
    """Contain this process, for good: nothing is started, nothing is written, `memory` [bytes] is all it may take.

    Its environment is empty: neither is a mesh another one on another machine, nor do secrets get into its names.
    """
    os.environ.clear()
    limit_memory(memory)
    _libc("prctl", PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    restrict_files(())
    if _has_seccomp():
        _restrict_calls()


def limit_memory(memory: int) -> None:
    """Limit the address space of this process to what it has and `memory` [bytes] more; it leaves no core file."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    has = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = has + memory if hard == resource.RLIM_INFINITY else min(has + memory, hard)
    if limit < 2**63:
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def restrict_files(writable: Sequence[Path]) -> None:
    """By Landlock, if the machine has it: start no program, and change files beneath the folders `writable` only."""
    version = _landlock_version()
    if version == 0:
        return
    changes = WRITE_FILE | REMOVE | MAKE | sum(right for since, right in SINCE.items() if version >= since)
    attr = RulesetAttr(EXECUTE | changes, TCP if version >= 4 else 0, SCOPES if version >= 6 else 0)
    size = 8 * (1 + (version >= 4) + (version >= 6))
    ruleset = _libc("syscall", LANDLOCK_CREATE_RULESET, ctypes.byref(attr), size, 0)
    try:
        for folder in writable:
            parent = os.open(folder, os.O_PATH)
            try:
                rule = ctypes.byref(PathBeneathAttr(changes, parent))
                _libc("syscall", LANDLOCK_ADD_RULE, ruleset, LANDLOCK_RULE_PATH_BENEATH, rule, 0)
            finally:
                os.close(parent)
        _libc("prctl", PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
        _libc("syscall", LANDLOCK_RESTRICT_SELF, ruleset, 0)
    finally:
        os.close(ruleset)


def _restrict_calls() -> None:
    """By seccomp: of all system calls only those of READING_CALLS, opening to read, and starting threads."""
    import seccomp

    # other calls fail as on an older kernel that lacks them: the C library then takes the ones it used before
    wall = seccomp.SyscallFilter(seccomp.ERRNO(errno.ENOSYS))
    wall.set_attr(seccomp.Attr.CTL_TSYNC, 1)  # all threads
    unset, one = partial(seccomp.Arg, op=seccomp.MASKED_EQ), partial(seccomp.Arg, op=seccomp.EQ)
    conditions = {
        "open": unset(1, datum_a=WRITES, datum_b=0),
        "openat": unset(2, datum_a=WRITES, datum_b=0),
        "clone": unset(0, datum_a=CLONE_THREAD, datum_b=CLONE_THREAD),
        "tgkill": one(0, datum_a=os.getpid()),  # to abort, itself
        "prlimit64": one(2, datum_a=0),  # to read limits, not to set them
        "ioctl": one(1, datum_a=termios.TCGETS),  # is it a terminal?
    }
    rules = [*((name, ()) for name in READING_CALLS), *((name, (arg,)) for name, arg in conditions.items())]
    for name, arguments in rules:
        if seccomp.resolve_syscall(seccomp.Arch(), name) >= 0:  # newer architectures have no `open`
            wall.add_rule(seccomp.ALLOW, name, *arguments)
    wall.load()


def _has_seccomp() -> bool:
    try:
        import seccomp  # noqa: F401  Debian's python3-seccomp
    except ImportError:
        return False
    return Path("/proc/sys/kernel/seccomp").is_dir()


def _landlock_version() -> int:
    """Version of the kernel's Landlock; 0 if it has none, or if it is switched off."""
    libc = ctypes.CDLL(None)
    return max(0, int(libc.syscall(LANDLOCK_CREATE_RULESET, None, 0, LANDLOCK_CREATE_RULESET_VERSION)))


def _libc(name: str, *arguments: object) -> int:
    """Call a function of the C library.

    Raises:
        OSError: it fails.
    """
    found = int(getattr(ctypes.CDLL(None, use_errno=True), name)(*arguments))
    if found < 0:
        raise OSError(ctypes.get_errno(), f"{name}: {os.strerror(ctypes.get_errno())}")
    return found
