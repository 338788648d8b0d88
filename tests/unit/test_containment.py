"""Geometry programs run behind walls, in a child that tells how it ended."""

from __future__ import annotations

import gzip
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

from shared.cases import every_nth
from shared.drawn import GEO, LONG, PY, scene_data
from shared.processes import is_there, running, wait_for
from stickslip.geometry.errors import GeometryError, MachineError, StickslipError
from stickslip.geometry.memory import ended_for_memory, is_full
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.user_files import open_file, reader
from stickslip.geometry.user_files.child_process import child_environment, run_child, walls
from stickslip.geometry.user_files.meshing import MeshOptions
from stickslip.geometry.user_files.reader import AnswerReader, Question, ask
from stickslip.solvers.simulation import plan
from stickslip.solvers.simulation.plan import warnings
from stickslip.workflows.scene_file.read import from_dict

CALL = "SystemCall 'touch made';\n"
SCRIPTS = {  # each of these reaches beyond the model
    "SystemCall": GEO + CALL,
    "System": GEO + "System 'touch made';\n",
    "NonBlockingSystemCall": GEO + "NonBlockingSystemCall 'touch made';\n",
    "OnelabRun": GEO + 'OnelabRun("a", "touch made");\n',
    "in a skipped block": GEO + f'If (0)\nx = "EndIf {CALL[:-1]} //";\nEndIf\n',
    "ExternalProcess": GEO
    + 'Field[9] = ExternalProcess;\nField[9].CommandLine = "touch made";\nBackground Field = 9;\n',
    "Printf": GEO + 'Printf("x") > "made";\n',
    "Printf, then Merge": GEO + f'Printf("{CALL[:-1]}") > "made";\nMerge "made";\n',
    "appending Printf": GEO + 'Printf("x") >> "kept.txt";\n',
    "Save": GEO + 'Mesh 2;\nSave "made.msh";\n',
    "Save over a file": GEO + 'Mesh 2;\nSave "kept.txt";\n',
    "Print": GEO + 'Print "made.msh";\n',
    "CreateDir": GEO + 'CreateDir "made";\n',
    "option files": GEO + 'General.OptionsFileName = "made";\nSave Options "made";\n',
    "Include": GEO + 'Include "call.txt";\n',
    "Merge": GEO + 'Merge "call.txt";\n',
    "Merge of a .gz": GEO + 'Merge "call.geo.gz";\n',
    "a computed name": GEO + 'Include StrCat("call", ".txt");\n',
}
DISGUISED = {"b.msh": "// $MeshFormat\n", "b.Step": "// ISO-10303-21\n", "b.STP": "/* ISO-10303-21 */\n",
             "b.Brep": "// CASCADE Topology\n", "b.geo.GZ": ""}  # fmt: skip

WAITS = 3.0  # [s] for gmsh, which waits without end for the program that it may not start


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A working folder with a file to keep; afterwards it holds what it held."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "kept.txt").write_text("kept")
    (tmp_path / "call.txt").write_text(CALL)
    (tmp_path / "call.geo.gz").write_bytes(gzip.compress(CALL.encode()))
    yield tmp_path
    left = {path.name for path in tmp_path.rglob("*")} - {"kept.txt", "call.txt", "call.geo.gz"}
    assert {name for name in left if not name.startswith("b.")} == set()
    assert (tmp_path / "kept.txt").read_text() == "kept"


def use(file: Path) -> str:
    """Outline and mesh of the file; what is wrong with it, "" if nothing is."""
    sizes = {} if file.suffix in (".geo", ".msh", ".GZ") else {"mesh_size": 0.5}
    try:
        scene = from_dict(scene_data(file, time_limit=WAITS, **sizes))
        build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF)
    except GeometryError as error:
        return str(error)
    return ""


def test_this_machine_can_contain() -> None:
    assert walls() == ("Landlock", "seccomp") or walls() == ("seccomp",)  # packages.txt has python3-seccomp


def test_a_machine_that_cannot_says_so(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "b.geo").write_text(GEO)
    scene = from_dict(scene_data(folder / "b.geo"))
    assert warnings(scene) == ()
    monkeypatch.setattr(plan, "walls", lambda: ())
    (line,) = warnings(scene)
    assert line.startswith("geometry.file: this machine has neither seccomp (Debian's python3-seccomp) nor Landlock")


@pytest.mark.parametrize("name", every_nth(3, SCRIPTS))
def test_a_script_starts_nothing_and_writes_nothing(name: str, folder: Path) -> None:
    script = folder / "b.geo"
    script.write_text(SCRIPTS[name])
    says = use(script)
    assert "\n" not in says
    assert len(says) < 300
    # of these gmsh says nothing; the last one newer versions skip to its end
    assert says or name in ("CreateDir", "ExternalProcess", "in a skipped block")


def test_a_script_knows_no_variable_of_the_users(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither gets a secret into a name of the results, nor is a mesh another one elsewhere."""
    monkeypatch.setenv("SECRET", "token")
    (folder / "b.geo").write_text(f'{GEO}Physical Curve(StrCat("block.left", GetEnv("SECRET"))) = {{4}};\n')
    assert {*from_dict(scene_data(folder / "b.geo")).geometry.bodies(2)["block"]} == {"bottom", "left", "top"}


@pytest.mark.parametrize("name", DISGUISED)
def test_a_script_under_another_name_starts_nothing(name: str, folder: Path) -> None:
    text = (DISGUISED[name] + GEO + CALL).encode()
    (folder / name).write_bytes(gzip.compress(text) if name.endswith("GZ") else text)
    says = use(folder / name)
    # of a .brep that is none gmsh says nothing
    assert any(
        words in says for words in ("starts a program, and a geometry may not", "Could not read", "has no surfaces")
    )


DEEDS = """
import json, os, signal, socket, sys, threading
from pathlib import Path
from stickslip.geometry.user_files import child_process as containment
if sys.argv[1] == "seccomp":
    containment._landlock_version = lambda: 0
if sys.argv[1] == "Landlock":
    containment._has_seccomp = lambda: False
before = open("answer", "w")
containment.contain(2**30)

def child():
    if os.fork() == 0:
        try:
            os.execv("/usr/bin/touch", ["touch", "made"])
        finally:
            os._exit(1)
    assert os.wait()[1] == 0

deeds = {
    "system": lambda: 1 / (os.system("touch made") == 0),
    "fork and exec": child,
    "exec": lambda: os.execv("/usr/bin/touch", ["touch", "made"]),
    "write": lambda: open("made", "w"),
    "append": lambda: open("kept.txt", "a"),
    "truncate": lambda: os.truncate("kept.txt", 0),
    "mkdir": lambda: os.mkdir("made"),
    "unlink": lambda: os.unlink("kept.txt"),
    "rename": lambda: os.rename("kept.txt", "made"),
    "symlink": lambda: os.symlink("kept.txt", "made"),
    "link": lambda: os.link("kept.txt", "made"),
    "fifo": lambda: os.mkfifo("made"),
    "temporary": lambda: os.open(".", os.O_TMPFILE | os.O_WRONLY),
}
if sys.argv[1] != "Landlock":  # these change no file's content, and Landlock of older kernels lets them pass
    deeds |= {
        "chmod": lambda: os.chmod("kept.txt", 0o777),
        "times": lambda: os.utime("kept.txt", (1, 1)),
        "socket": lambda: socket.socket(socket.AF_INET, socket.SOCK_STREAM),
        "kill": lambda: os.kill(os.getppid(), signal.SIGCONT),
    }
done = []
for name, act in deeds.items():
    try:
        act()
        done.append(name)
    except (OSError, ZeroDivisionError, AssertionError):
        pass
thread = threading.Thread(target=lambda: done.append("thread"))
thread.start()
thread.join()
assert Path("kept.txt").read_text() == "kept"
bytearray(2**20)
try:
    bytearray(2**31)
    done.append("memory")
except MemoryError:
    pass
json.dump(done, before)
before.close()
"""


@pytest.mark.parametrize("wall", ["seccomp", "Landlock", "both"])
def test_each_wall_is_enough_alone(wall: str, tmp_path: Path) -> None:
    if wall == "Landlock" and "Landlock" not in walls():
        wall = "both"
    (tmp_path / "kept.txt").write_text("kept")
    words = [sys.executable, "-c", DEEDS, wall]
    done = subprocess.run(words, cwd=tmp_path, env=child_environment(), capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr.decode()
    assert json.loads((tmp_path / "answer").read_text()) == ["thread"]
    assert {path.name for path in tmp_path.iterdir()} == {"answer", "kept.txt"}


WINDOW = """
import os, sys
from pathlib import Path
from stickslip.geometry.user_files.child_process import restrict_files
restrict_files((Path("own"),))
Path("own/made").write_text("x")
for act in (lambda: Path("made").write_text("x"), lambda: os.execv("/usr/bin/touch", ["touch", "made"])):
    try:
        act()
    except PermissionError:
        continue
    sys.exit(1)
"""


def test_behind_the_window_only_the_folder_of_the_geometry_changes(tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    words = [sys.executable, "-c", WINDOW]
    done = subprocess.run(words, cwd=tmp_path, env=child_environment(), capture_output=True, timeout=60)
    if "Landlock" not in walls():  # nothing holds the window then, as docs/security.md says
        assert done.returncode == 1
        return
    assert done.returncode == 0, done.stderr.decode()
    assert (tmp_path / "own" / "made").exists()
    assert not (tmp_path / "made").exists()


def test_a_python_geometry_is_a_program(tmp_path: Path) -> None:
    made = tmp_path / "made"
    (tmp_path / "b.py").write_text(f"open({str(made)!r}, 'w').close()\n" + PY)
    from_dict(scene_data(tmp_path / "b.py", mesh_size=0.5, length=4.0))
    assert made.exists()


def test_files_of_the_working_folder_are_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", ".", os.environ.get("PYTHONPATH", ""), ""]))
    for name in ("gmsh", "numpy", "geometry", "pickle", "seccomp"):
        (tmp_path / f"{name}.py").write_text("open('made', 'w').close()\nraise SystemExit(1)\n")
    (tmp_path / "b.geo").write_text(GEO)
    assert use(tmp_path / "b.geo") == ""
    (tmp_path / "geometry.py").write_text(PY)
    assert from_dict(scene_data(tmp_path / "geometry.py", mesh_size=0.5, length=4.0)).geometry.bodies(2)
    assert not (tmp_path / "made").exists()


def test_a_file_that_unpacks_to_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(open_file, "LARGEST", 2**20)
    packed = tmp_path / "b.geo.gz"
    packed.write_bytes(gzip.compress(bytes(2**20 + 1)))
    with pytest.raises(GeometryError, match="unpacks to more than 1 MiB"):
        open_file.unpacked(packed, tmp_path)
    packed.write_bytes(gzip.compress(bytes(2**20)))
    assert open_file.unpacked(packed, tmp_path).stat().st_size == 2**20


def test_a_script_that_never_ends_is_stopped(folder: Path) -> None:
    (folder / "b.geo").write_text(GEO + "For i In {0:1e12}\nx = i;\nEndFor\n")
    with pytest.raises(GeometryError, match=r"b\.geo: gmsh does not finish reading it within 1 s; try a longer geom"):
        from_dict(scene_data(folder / "b.geo", time_limit=1.0))


def test_an_answer_that_would_call_something_is_no_answer(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str, ...]]:
            return os.system, (f"touch {tmp_path / 'made'}",)

    with (tmp_path / "answer").open("wb") as file:
        pickle.dump(Evil(), file)
    with (tmp_path / "answer").open("rb") as file, pytest.raises(pickle.UnpicklingError, match="no part of an answer"):
        AnswerReader(file).load()
    assert not (tmp_path / "made").exists()


def test_long_words_of_a_file_are_not_repeated_whole(folder: Path) -> None:
    (folder / "b.geo").write_text(GEO + f"{'w' * 100_000};\n")
    assert 0 < len(use(folder / "b.geo")) < 300


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
    """What is said of a file with this text; a .py file that names no build is not run."""
    path.write_text(text + "\nbuild = None\n" * (path.suffix == ".py"))
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
def test_error_of_no_text_is_explained(full: bool, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    said = r"gmsh does not finish meshing it within 1 s( and is at [^;]+)?; try a larger mesh_size or a longer"
    assert re.search(said, str(error))


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
