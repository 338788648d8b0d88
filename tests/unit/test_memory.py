"""Memory that can still be taken: the machine's, or what a control group leaves of it."""

from pathlib import Path

import pytest

from stickslip.geometry.memory import available

GIB = 2**30


def machine(root: Path, files: dict[str, str], gib: int = 16) -> Path:
    """A root folder with so much memory available, and other files."""
    told = {"proc/meminfo": f"MemTotal: 1 kB\nMemAvailable: {gib * 2**20} kB\n"}
    for name, text in (told | files).items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def test_this_machine_has_memory_left_and_no_more_than_it_has() -> None:
    lines = Path("/proc/meminfo").read_text().splitlines()
    total = next(int(line.split()[1]) for line in lines if line.startswith("MemTotal:"))
    assert 2**20 < available() < 1024 * total


def test_without_groups_the_machine_counts(tmp_path: Path) -> None:
    assert available(machine(tmp_path, {})) == 16 * GIB


def test_where_nothing_is_told_memory_is_without_limit(tmp_path: Path) -> None:
    assert available(tmp_path) == 2**63


@pytest.mark.parametrize(
    ("line", "folder", "limit", "used", "cache"),
    [
        ("0::/box/run", "sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"),
        ("4:memory:/box/run", "sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes",
         "total_inactive_file"),
    ],
)  # fmt: skip
def test_the_tightest_group_counts(tmp_path: Path, line: str, folder: str, limit: str, used: str, cache: str) -> None:
    groups = {
        "proc/self/cgroup": f"9:name=systemd:/elsewhere\n{line}\n",
        f"{folder}/box/{limit}": f"{4 * GIB}\n",
        f"{folder}/box/{used}": f"{3 * GIB}\n",
        f"{folder}/box/memory.stat": f"anon 7\n{cache} {GIB // 2}\n",
    }
    inner = {f"{folder}/box/run/{limit}": "max\n"}  # no limit of its own
    root = machine(tmp_path, groups | inner)
    assert available(root) == 3 * GIB // 2  # 4 - 3, and half a GiB of files that are only cached
    (root / f"{folder}/box/{used}").write_text(f"{5 * GIB}\n")
    assert available(root) == 0
    (root / f"{folder}/box/{limit}").write_text(f"{64 * GIB}\n")
    assert available(root) == 16 * GIB  # a group may be promised more than there is


def test_a_group_that_is_not_seen_under_its_name_is_the_one_that_is_seen(tmp_path: Path) -> None:
    hidden = {
        "proc/self/cgroup": "0::/outside/of/this/box\n",
        "sys/fs/cgroup/memory.max": f"{2 * GIB}\n",
        "sys/fs/cgroup/memory.current": f"{GIB}\n",
    }
    assert available(machine(tmp_path, hidden)) == GIB
