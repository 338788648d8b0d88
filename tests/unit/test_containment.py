"""A geometry's file starts nothing and changes nothing, whatever it holds; only a .py file is a program."""

import gzip
import json
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from mpi4py import MPI

from shared.cases import every_nth
from shared.drawn import GEO, PY, scene_data
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.user_files import open_file
from stickslip.geometry.user_files.child_process import child_environment, walls
from stickslip.geometry.user_files.reader import AnswerReader
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
