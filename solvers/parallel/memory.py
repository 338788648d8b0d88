"""How much memory this process may still take: what the machine and the control groups around us have left."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path


def available(root: Path = Path("/")) -> int:
    """Bytes that can be taken before the system swaps or kills.

    Where nothing can be read, as on systems without /proc, memory is taken to be without limit.
    """
    return min((_of_machine(root), *_of_groups(root)))


def _of_machine(root: Path) -> int:
    for line in _text(root / "proc/meminfo").splitlines():
        if line.startswith("MemAvailable:"):
            return 1024 * int(line.split()[1])
    return 2**63


def _of_groups(root: Path) -> Iterator[int]:
    """What each control group around this process leaves: its limit less what is in use, file cache given back."""
    for line in _text(root / "proc/self/cgroup").splitlines():
        _, controllers, path = line.split(":", 2)
        if controllers not in ("", "memory"):
            continue
        top = root / "sys/fs/cgroup" / controllers  # the second version has no folders of controllers
        limit, used = (
            ("memory.limit_in_bytes", "memory.usage_in_bytes") if controllers else ("memory.max", "memory.current")
        )
        group = top / path.strip("/")
        for folder in (group, *group.parents):
            if not folder.is_relative_to(top):
                break
            bound = _text(folder / limit).strip()
            if bound.isdigit():  # else it says max, or the folder is not seen from here
                yield max(0, int(bound) - int(_text(folder / used) or 0) + _cache(folder))


def _cache(folder: Path) -> int:
    """File cache of a group that is not in active use: the kernel drops it first."""
    lines = (line.split() for line in _text(folder / "memory.stat").splitlines())
    found = {key: int(value) for key, value in lines}
    return found.get("total_inactive_file", found.get("inactive_file", 0))


def _text(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:
        return ""
