"""The command line in environments that are drawn by lot: exit codes as documented, never a traceback or a hang."""

from __future__ import annotations

import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time as clock
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shared.command import COARSE, result
from shared.fuzzing import fuzzed
from shared.processes import catches, wait_for
from shared.ranks import STICKSLIP

LIMIT = 60  # s
NOWHERE = ("/proc/1/nohome", "/dev/null", "", "/", "relative", "\u00fc", os.fsdecode(b"\xff"))
NAMES = (
    "out",
    "a b",
    "ü²",
    "a\nb",
    "-x",
    "%s",
    "'\"",
    os.fsdecode(b"\xfe"),
    "x" * 240,
    "x" * 300,
    "a/b/c",
    "./out",
    "/dev/null/x",
)
COMMANDS = (
    ["run", "block", *COARSE],
    ["run", "block", "-q", *COARSE],
    ["run", "block", "-v", *COARSE],
    ["plan", "block", "--json"],
    ["plan", "block", "--mesh", *COARSE],
    ["mesh", "block", *COARSE[:2]],
    ["scenes"],
    ["new", "block", "mine.toml"],
    ["--help"],
    ["--version"],
    [],
    ["nonsense"],
    ["run", "nowhere.toml"],
)


def environment(lots: random.Random, place: Path) -> dict[str, str]:
    """Variables, some of which lead nowhere."""
    found = dict(os.environ) | {"TMPDIR": str(place)}
    for name in ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "MPLCONFIGDIR"):
        choice = lots.randrange(4)
        if choice == 0:
            found.pop(name, None)
        elif choice == 1:
            found[name] = lots.choice(NOWHERE)
    if lots.randrange(2):
        found |= {"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    if lots.randrange(3) == 0:
        found |= {"TERM": lots.choice(("dumb", "", "xterm")), "COLUMNS": lots.choice(("1", "0", "-3", "x", "100000"))}
    return found


def spoil(lots: random.Random, place: Path) -> tuple[Callable[[], None], bool]:
    """What the process does to its own streams, disk and folder before it begins, and whether its output is lost."""
    acts: list[Callable[[], Any]] = []
    lost = False
    for number in range(3):
        choice = lots.randrange(8)
        if choice == 0:
            acts.append(lambda number=number: os.close(number))
        elif choice == 1 and number:
            acts.append(lambda number=number: os.dup2(os.open("/dev/full", os.O_WRONLY), number))
        elif choice == 2 and number:
            acts.append(lambda number=number: _deaf(number))
        lost = lost or (choice < 3 and number > 0)
    if lots.randrange(5) == 0:
        room = lots.randrange(1, 100_000)
        acts.append(lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)))
        acts.append(lambda: signal.signal(signal.SIGXFSZ, signal.SIG_IGN))
    if lots.randrange(8) == 0:
        acts.append(lambda: ((place / "gone").mkdir(), os.chdir(place / "gone"), (place / "gone").rmdir()))
    return (lambda: [act() for act in acts] and None), lost


def _deaf(number: int) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    os.dup2(writer, number)


@fuzzed(0.25, least=2)  # whole runs
@given(seed=st.integers(0, 2**32 - 1))
def test_every_environment_ends_as_documented(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    lots, place = random.Random(seed), tmp_path_factory.mktemp("place")
    words = list(lots.choice(COMMANDS))
    name = lots.choice(NAMES)
    if words[:1] == ["run"]:
        words.append(f"--output={name}")
    before, lost = spoil(lots, place)
    number = lots.choice((signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)) if lots.randrange(4) == 0 else None
    with subprocess.Popen(
        [sys.executable, *STICKSLIP, *words],
        cwd=place,
        env=environment(lots, place),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=before,
    ) as process:
        if number is not None:
            wait_for(lambda: process.poll() is not None or catches(process.pid, signal.SIGUSR1), "the first lines")
            clock.sleep(2 * lots.random())
            process.send_signal(number)
        try:
            _, err = process.communicate(timeout=LIMIT)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
    said, code = err.decode(errors="replace"), process.returncode
    assert "Traceback" not in said, (words, said)
    assert "PETSC ERROR" not in said, (words, said)
    expected = {0, 2, 4} | ({1} if lost or words == [] else set()) | ({130} if number else set())
    assert code in expected, (words, code, said)
    if code == 0 and words[:1] == ["run"]:
        assert result(place / name)["status"] == "converged"
    for line in said.splitlines():
        if line.startswith("stickslip: ") and " go on with: " not in line:
            assert len(line) < 300
    if code in (2, 4, 130) and not lost and words[:1] != ["run"]:
        assert said.count("\n") == 1, (words, said)
    shutil.rmtree(place)
