"""How much memory this machine has to give, by Linux's own account."""

from __future__ import annotations

from pathlib import Path

LIMITS = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
)


def available() -> int:
    """Bytes that a process can still take: MemAvailable, or what a container leaves, whichever is less."""
    found = _of_machine(Path("/proc/meminfo").read_text())
    for limit, used in LIMITS:
        try:
            most, now = Path(limit).read_text().strip(), Path(used).read_text().strip()
        except OSError:
            continue
        if most != "max":
            found = min(found, int(most) - int(now))
    return max(found, 0)


def _of_machine(meminfo: str) -> int:
    """MemAvailable [bytes] of /proc/meminfo.

    >>> _of_machine("MemTotal: 4000 kB\\nMemAvailable:   2000 kB\\n")
    2048000
    """
    (line,) = (line for line in meminfo.splitlines() if line.startswith("MemAvailable"))
    return int(line.split()[1]) * 1024
