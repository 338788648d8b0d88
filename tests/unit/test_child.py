"""gmsh's process ends with ours, and what ended it is named."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

import pytest

from shared.drawn import GEO, LONG
from shared.processes import is_there, running, wait_for
from stickslip.geometry.errors import GeometryError, MachineError, StickslipError
from stickslip.geometry.memory import ended_for_memory, is_full
from stickslip.geometry.user_files import reader
from stickslip.geometry.user_files.child_process import child_environment, run_child
from stickslip.geometry.user_files.meshing import MeshOptions
from stickslip.geometry.user_files.reader import Question, ask

FINE = LONG["meshing"]  # in gigabytes
SOLID = """
SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 4, 2, 2};
Physical Volume("block") = {1};
Physical Surface("block.bottom") = {5};
MeshSize{:} = 0.08;
"""
MESH = MeshOptions(size=None, fine_size=None, fine_sides=(), periodic=(), order=1)


def why(path: Path, text: str, dim: int = 2, **more: Any) -> StickslipError:
    """What is said of a file with this text."""
    path.write_text(text)
    with pytest.raises(StickslipError) as caught:
        ask(Question(path=path, dim=dim, unit=1.0, **more))
    assert "\n" not in str(caught.value)
    assert not re.search(r"says:\s*$|;\s*$|\(\s*\)", str(caught.value))
    return caught.value


@pytest.fixture
def limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Start child processes behind a limit of the shell."""

    def act(limit: str) -> None:
        start = tmp_path / "limited"
        start.write_text(f'#!/bin/sh\n{limit}\nexec {sys.executable} "$@"\n')
        start.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(start))

    return act


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGABRT, signal.SIGFPE])
def test_crash_is_named(number: signal.Signals, tmp_path: Path) -> None:
    text = f"import os\nprint('it was the edge', flush=True)\nos.kill(os.getpid(), {int(number)})\n"
    error = why(tmp_path / "b.py", text)
    assert isinstance(error, GeometryError)
    assert f"gmsh crashed on it ({number.name}: it was the edge)" in str(error)


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (signal.SIGKILL, r"ended from outside \(SIGKILL\), by somebody or by a limit of this shell"),
        (signal.SIGTERM, r"ended from outside \(SIGTERM\)"),
        (signal.SIGXCPU, r"more seconds of the processor than this shell allows \(ulimit -t\)"),
    ],
)
def test_end_from_outside_is_not_the_fault_of_the_file(number: signal.Signals, said: str, tmp_path: Path) -> None:
    error = why(tmp_path / "b.py", f"import os\nos.kill(os.getpid(), {int(number)})\n")
    assert isinstance(error, MachineError)
    assert re.search(rf"b\.py: gmsh .*{said}", str(error))


def test_process_that_the_system_ends_for_memory_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    counts = iter((7, 8))
    monkeypatch.setattr(reader, "ended_for_memory", lambda: next(counts))
    error = why(tmp_path / "b.py", "import os\nos.kill(os.getpid(), 9)\n")
    assert isinstance(error, MachineError)
    assert "the system was out of memory, and ended gmsh (SIGKILL)" in str(error)
    vmstat = tmp_path / "proc" / "vmstat"
    vmstat.parent.mkdir()
    vmstat.write_text("pgfault 5\noom_kill 3\n")
    assert ended_for_memory(tmp_path) == 3
    assert ended_for_memory(tmp_path / "nowhere") == 0


OPENED = """
from stickslip.geometry.user_files import reader
import gmsh
gmsh.initialize()
print(*(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmPeak")))
"""


@pytest.fixture(scope="module")
def needed() -> int:
    """Address space [kB] of a process that has loaded gmsh: one version needs twice that of another."""
    done = subprocess.run([sys.executable, "-c", OPENED], env=child_environment(), capture_output=True, text=True)
    return int(done.stdout)


@pytest.mark.parametrize(
    ("text", "dim", "more"),
    [
        (FINE, 2, 20),
        pytest.param(SOLID, 3, 80, marks=pytest.mark.slow),
        pytest.param(SOLID, 3, 110, marks=pytest.mark.slow),
        (SOLID, 3, -20),
    ],
)
def test_mesh_that_does_not_fit_into_memory_is_named(
    text: str, dim: int, more: int, tmp_path: Path, limited: Any, needed: int
) -> None:
    """gmsh ends by an uncaught bad_alloc, by a null pointer, by an error without a text; or it cannot be loaded.

    Args:
        more: megabytes beyond those that gmsh itself needs.
    """
    limited(f"ulimit -v {needed + 1024 * more}")
    assert str(why(tmp_path / "b.geo", text, dim, mesh=MESH)).startswith("b.geo: does not fit into memory")


@pytest.mark.parametrize(
    ("full", "said"), [(True, "does not fit into memory"), (False, "gmsh fails on it and does not say why")]
)
def test_error_without_a_text_is_explained(
    full: bool, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(question: Question) -> None:
        raise Exception("")

    monkeypatch.setattr(reader, "answer", fail)
    monkeypatch.setattr(reader, "is_full", lambda process: full)
    monkeypatch.setattr(reader, "contain", lambda memory: None)
    question = Question(path=tmp_path / "b.geo", dim=2, unit=1.0)
    assert str(reader._answer_or_why_not(question, tmp_path)).startswith(said)


def test_mistake_of_ours_is_not_said_by_gmsh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(question: Question) -> None:
        raise KeyError("x")

    monkeypatch.setattr(reader, "answer", fail)
    question = Question(path=tmp_path / "b.py", dim=2, unit=1.0)
    assert reader._answer_or_why_not(question, tmp_path) == "reading it fails: KeyError: 'x'"


def test_disk_without_room_for_the_mesh_is_named(tmp_path: Path, limited: Any) -> None:
    limited("ulimit -f 1")  # of 512 bytes
    error = why(tmp_path / "b.geo", GEO.replace("lc = 0.5", "lc = 0.1"), mesh=MESH)
    assert isinstance(error, MachineError)
    assert f"what gmsh made of it cannot be written to {tempfile.gettempdir()}: File too large" in str(error)


def test_time_limit_ends_also_what_prints_without_end(tmp_path: Path) -> None:
    """And what prints nothing more: its standard output is closed."""
    for loop in ("print('again and again')", "os.closerange(1, 3)"):
        error = why(tmp_path / "b.py", f"import os\nwhile True:\n    {loop}\n", time_limit=1.0)
        assert "gmsh does not finish reading it within 1 s; try a longer geometry.time_limit" in str(error)
    error = why(tmp_path / "b.geo", FINE, mesh=MESH, time_limit=1.0)
    assert "gmsh does not finish meshing it within 1 s; try a larger mesh_size or a longer" in str(error)


FULL = """
import os, resource
from stickslip.geometry.memory import is_full
(peak,) = (1024 * int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmPeak"))
found = []
for part in (2.0, 1.05):
    resource.setrlimit(resource.RLIMIT_AS, (int(part * peak), resource.RLIM_INFINITY))
    found.append(is_full(os.getpid()))
print(found, is_full(2**22 + 1))  # there is no such process
"""


def test_memory_that_is_taken_is_seen() -> None:
    done = subprocess.run([sys.executable, "-c", FULL], env=child_environment(), capture_output=True, text=True)
    assert done.stdout == "[False, True] False\n", done.stderr
    assert not is_full(os.getpid())  # without a limit


HOLD = """
import sys, threading
from stickslip.geometry.user_files.child_process import run_child
run_child("shared.sleeper", [sys.argv[1]], None, 3600.0)
"""


def test_child_of_a_process_that_is_killed_ends(tmp_path: Path) -> None:
    place = tmp_path / "number"
    tests = str(Path(__file__).parents[1])
    environment = child_environment() | {"PYTHONPATH": f"{tests}{os.pathsep}{child_environment()['PYTHONPATH']}"}
    with running([sys.executable, "-c", HOLD, str(place)], env=environment) as process:
        child = int(wait_for(lambda: place.exists() and place.read_text(), "its child", process.pid))
    wait_for(lambda: not is_there(child), "the end of the child")


def test_signal_that_is_only_noted_ends_the_child_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a run notes it until its iteration ends: it has none while it waits for gmsh."""
    noted: list[int] = []
    former = signal.signal(signal.SIGTERM, lambda number, frame: noted.append(number))
    threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGTERM)).start()
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))
    try:
        with pytest.raises(KeyboardInterrupt):
            run_child("shared.sleeper", [str(tmp_path / "number")], None, 3600.0)
        assert signal.getsignal(signal.SIGTERM).__name__ == "<lambda>"
    finally:
        signal.signal(signal.SIGTERM, former)
    assert noted == [signal.SIGTERM]
