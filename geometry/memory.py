"""Memory of a process: what it has had, and may still take by the machine, its control groups and its own limit."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from pathlib import Path


def available(root: Path = Path("/")) -> int:
    """Bytes that can be taken before the system swaps or ends the process.

    Where nothing can be read, as on systems without /proc, the answer is 2**63: no limit.

    Args:
        root: the folder that holds proc and sys.
    """
    return min((_of_machine(root), *_of_groups(root), _of_process(root)))


def peak() -> float:
    """The most that this process has had [bytes]; ru_maxrss would include what its parent held when it was started."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return 1024.0 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def resident() -> float:
    """Resident memory of this process now [bytes]; 0 on systems without /proc."""
    taken = _text(Path("/proc/self/statm")).split()
    return float(taken[1]) * resource.getpagesize() if taken else 0.0


def is_full(process: int) -> bool:
    """Whether a process has ever taken nearly all the address space that its limit lets it have."""
    try:
        limit, _ = resource.prlimit(process, resource.RLIMIT_AS)
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
    except OSError:  # it has ended
        return False
    peak = next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmPeak:")), 0)
    return limit != resource.RLIM_INFINITY and peak > 0.9 * limit


def ended_for_memory(root: Path = Path("/")) -> int:
    """Number of processes that the system has ended since it started because memory was out; 0 if unknown."""
    lines = (line.split() for line in _text(root / "proc/vmstat").splitlines())
    return next((int(count) for name, count in lines if name == "oom_kill"), 0)


def _of_process(root: Path) -> int:
    """Bytes that the limit of the process (`ulimit -v`) leaves it."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    taken = _text(root / "proc/self/statm").split()
    if limit == resource.RLIM_INFINITY or not taken:
        return 2**63
    return max(0, limit - int(taken[0]) * resource.getpagesize())


def _of_machine(root: Path) -> int:
    for line in _text(root / "proc/meminfo").splitlines():
        if line.startswith("MemAvailable:"):
            return 1024 * int(line.split()[1])
    return 2**63


def _of_groups(root: Path) -> Iterator[int]:
    """Bytes left in each control group that holds this process: limit - use + file cache that can be dropped."""
    for line in _text(root / "proc/self/cgroup").splitlines():
        _, controllers, path = line.split(":", 2)
        if controllers not in ("", "memory"):
            continue
        top = root / "sys/fs/cgroup" / controllers  # cgroups version 2 have no folders of controllers
        limit, used = (
            ("memory.limit_in_bytes", "memory.usage_in_bytes") if controllers else ("memory.max", "memory.current")
        )
        group = top / path.strip("/")
        for folder in (group, *group.parents):
            if not folder.is_relative_to(top):
                break
            bound = _text(folder / limit).strip()
            if bound.isdigit():  # otherwise it is "max", or the folder is not visible to this process
                yield max(0, int(bound) - int(_text(folder / used) or 0) + _cache(folder))


def _cache(folder: Path) -> int:
    """Bytes of file cache of a group that are not in active use: the kernel drops them first."""
    lines = (line.split() for line in _text(folder / "memory.stat").splitlines())
    found = {key: int(value) for key, value in lines}
    return found.get("total_inactive_file", found.get("inactive_file", 0))


def _text(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:
        return ""
