"""Files that were drawn by lot or tampered with are refused in one line."""

from __future__ import annotations

import json
import os
import random
import shutil
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpi4py import MPI

from shared.disks import Disk
from shared.drawn import FACES, GEO, draw, scene_data
from shared.fuzzing import accepted, assert_refusal, fuzzed
from shared.histories import LEARNS, SMALL, assert_same, names_in
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.commands.cli import app, guarded
from stickslip.workflows.formats.marker import MARKER, PART
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict, read

SCENE = [*SMALL, *LEARNS, "steps.count=3"]
WORDS = ["run", "block", "-q", "-o", "out", *(f"--set={word}" for word in SCENE)]
PLACES = ("out", ".out.running", "out.1")
MINE = "of the user"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a run that was left alone."""
    folder = tmp_path_factory.mktemp("whole") / "out"
    run(read("block", SCENE), folder)
    return folder


def command(place: Path, words: list[str], killed_at: int = 0) -> tuple[int, str]:
    """Exit code (-9: killed) and standard error of the command, in a process with the libraries of this one."""
    said = place.parent / "said"
    process = os.fork()
    if not process:
        try:
            os.chdir(place)
            for number, name in ((1, os.devnull), (2, said)):
                os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
            sys.stdout, sys.stderr = open(1, "w"), open(2, "w")  # noqa: SIM115
            if killed_at:
                Disk(place, killed_at).watch(pytest.MonkeyPatch())
            os._exit(guarded(lambda: app(words, standalone_mode=False)))
        except BaseException as error:
            os.write(2, f"Traceback: {error!r}\n".encode())
        finally:
            os._exit(99)
    code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    return code, said.read_text(errors="replace")


def keep(place: Path, lots: random.Random) -> dict[str, str]:
    """Put files of the user into the folders that are there: what they hold, by name."""
    kept = {}
    for _ in range(lots.randrange(4)):
        folder = place / lots.choice(PLACES) / lots.choice(("", "steps", "learnt", "vtu", "mine/of/mine"))
        if (place / folder.relative_to(place).parts[0] / MARKER).exists():
            folder.mkdir(parents=True, exist_ok=True)
            path = folder / lots.choice(("notes.txt", "000001 copy.h5", ".a.part", "contact_mine.csv", "run.log.bak"))
            path.write_text(MINE)
            kept[str(path.relative_to(place))] = MINE
    return kept


def assert_kept(place: Path, kept: dict[str, str]) -> None:
    """Each lies where it did in its folder, which may have another name now."""
    for name, text in kept.items():
        assert text in [path.read_text() for path in moved(place, name) if path.is_file()], name


def moved(place: Path, name: str) -> list[Path]:
    """Where a file may be now."""
    return [folder / Path(*Path(name).parts[1:]) for folder in place.iterdir()]


def remove(place: Path, kept: dict[str, str]) -> None:
    for name in kept:
        for path in moved(place, name):
            path.unlink(missing_ok=True)
    for folder in sorted((place / "out").rglob("*"), key=lambda path: len(path.parts), reverse=True):
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


@fuzzed(0.25, least=2)  # whole runs
@given(seed=st.integers(0, 2**32 - 1))
def test_killed_again_and_again_it_ends_with_the_same_bits(
    seed: int, whole: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    lots, place = random.Random(seed), tmp_path_factory.mktemp("killed") / "place"
    place.mkdir()
    kept: dict[str, str] = {}
    for _ in range(1 + lots.randrange(3)):
        words = [*WORDS, *["--resume"] * lots.randrange(2)]
        code, said = command(place, words, 1 + int(150 * lots.random() ** 2))
        assert code in (-9, 0, 2), said
        if code == 2:
            assert_refusal(said)
        kept |= keep(place, lots)
    code, said = command(place, [*WORDS, "--resume"])
    assert code == 0, said
    assert_kept(place, kept)
    remove(place, kept)
    (place / "out" / PART).unlink(missing_ok=True)
    assert_same(place / "out", whole)
    shutil.rmtree(place.parent)


WAYS = ("cut", "flip", "empty", "zero", "gone", "pipe", "folder", "loop", "device", "other", "nested", "json")
TABLES: tuple[Any, ...] = (None, 1, "x", [], {}, {"scene": []}, {"status": "converged"}, {"status": 3})


def tamper(path: Path, lots: random.Random) -> str:
    """Do something to a file; what."""
    how = lots.choice(WAYS)
    content = path.read_bytes()
    path.unlink()
    if how == "cut":
        path.write_bytes(content[: lots.randrange(len(content) + 1)])
    elif how == "flip":
        changed = bytearray(content or b"\0")
        changed[lots.randrange(len(changed))] ^= 1 << lots.randrange(8)
        path.write_bytes(changed)
    elif how == "empty":
        path.touch()
    elif how == "zero":
        path.write_bytes(bytes(len(content)))
    elif how == "pipe":
        os.mkfifo(path)
    elif how == "folder":
        path.mkdir()
    elif how == "loop":
        path.symlink_to(path.name)
    elif how == "device":
        path.symlink_to(lots.choice(("/dev/zero", "/dev/full", "/dev/null", "/nowhere")))
    elif how == "other":
        path.write_bytes(lots.randbytes(lots.randrange(2000)))
    elif how == "nested":
        path.write_text(lots.choice('[{("') * 100_000)
    elif how == "json":
        path.write_text(json.dumps(lots.choice(TABLES)))
    return how


@fuzzed(0.25, least=2)  # whole runs
@given(seed=st.integers(0, 2**32 - 1))
def test_whatever_becomes_of_the_files_the_answer_is_the_same_or_one_line(
    seed: int, whole: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Nothing outside of the results is touched, and nothing of the user's."""
    lots, place = random.Random(seed), tmp_path_factory.mktemp("tampered") / "place"
    place.mkdir()
    (place.parent / "precious").mkdir()
    (place.parent / "precious" / "data").write_text(MINE)
    assert command(place, WORDS, 1 + lots.randrange(150))[0] in (-9, 0)
    kept, done = keep(place, lots), []
    for _ in range(1 + lots.randrange(2)):
        files = [path for path in sorted(place.rglob("*")) if path.is_file() and path.stat().st_size < 1e9]
        files = [path for path in files if str(path.relative_to(place)) not in kept and not path.is_symlink()]
        if files:
            path = lots.choice(files)
            done.append(f"{path.relative_to(place)}: {tamper(path, lots)}")
    before = names_in(place)
    for words in ([*WORDS, "--resume"], WORDS, [*WORDS, "--resume"]):
        code, said = command(place, words)
        assert code in (0, 2, 4), (done, said)
        if code:
            assert_refusal(said, code)
        assert_kept(place, kept)
        assert (place.parent / "precious" / "data").read_text() == MINE
    if code == 0:
        ours, theirs = (json.loads((folder / "result.json").read_text()) for folder in (place / "out", whole))
        assert ours["status"] == "converged", (done, before)
        for key in ("normal_force", "tangential_force"):
            one, other = (found["steps"][-1]["contacts"]["base"][key] for found in (ours, theirs))
            assert one == pytest.approx(other, rel=1e-7), done  # of a tolerance of 1e-8: what was learnt may be lost
    shutil.rmtree(place.parent)


SHARE = 0.4  # of the examples: each starts two processes
LIMIT = 20.0  # [s] of gmsh
FILE_WORDS = [
    "0", "-1", "1e308", "nan", "1e-9", "9" * 400, "", ";", "{", "}", "(", "*/", "/*", '"', "\n", " ", "\0", "é",
    'SystemCall "touch made";', 'Printf("x") > "made";', 'Merge "b.geo";', 'Include "b.geo";', "Mesh 2;",
    "Delete Model;", "Physical Surface", "Box(9) = {0,0,0,1,1,1};", "For i In {0:9}", "EndFor",
    "If (0)", "EndIf", "Exit;", "Abort;", "$EndElements", "$Nodes", "#10", "ISO-10303-21;", "ENDSEC;", "$",
]  # fmt: skip


@cache
def original(kind: str) -> bytes:
    with TemporaryDirectory() as folder:
        return (
            GEO.encode() if kind == ".geo" else draw(Path(folder) / f"b{kind}", 2 if kind == ".msh" else 3).read_bytes()
        )


@st.composite
def mutated(draw_from: st.DrawFn, kind: str) -> bytes:
    """A file of a kind with words, numbers or bytes of it changed, left out, repeated or exchanged."""
    text = original(kind)
    for _ in range(draw_from(st.integers(1, 3))):
        if draw_from(st.booleans()):  # words
            parts = text.split(b" ")
            i, j = (draw_from(st.integers(0, len(parts) - 1)) for _ in range(2))
            word = draw_from(st.sampled_from([*(w.encode() for w in FILE_WORDS), parts[j]]))
            text = b" ".join([*parts[:i], word, *parts[i + draw_from(st.integers(0, 1)) :]])
        elif draw_from(st.booleans()):  # lines
            lines = text.split(b"\n")
            i, j = (draw_from(st.integers(0, len(lines) - 1)) for _ in range(2))
            text = b"\n".join([*lines[:i], lines[j], *lines[i + draw_from(st.integers(0, 1)) :]])
        else:  # bytes
            at = draw_from(st.integers(0, max(0, len(text) - 1)))
            text = text[:at] + draw_from(st.binary(max_size=4)) + text[at + draw_from(st.integers(0, 4)) :]
        if draw_from(st.integers(0, 9)) == 0:
            text = text[: draw_from(st.integers(0, len(text)))]
    return text


def use(name: str, content: bytes) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        solid = name.endswith((".step", ".brep"))
        keys: dict[str, Any] = {"mesh_size": 0.5, "names": FACES} if solid else {}
        data = scene_data(path, 3 if solid else 2, "part" if solid else "block", time_limit=LIMIT, **keys)
        scene = accepted(lambda: from_dict(data))
        if scene is not None and accepted(lambda: make_plan(scene)) is not None:
            accepted(lambda: build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF))
        assert [p.name for p in Path(folder).iterdir()] == [name]


@pytest.mark.parametrize("kind", [".geo", ".msh", ".step", ".brep"])
def test_a_mutated_file(kind: str) -> None:
    @fuzzed(SHARE)
    @given(mutated(kind))
    def check(content: bytes) -> None:
        use(f"b{kind}", content)

    check()


@fuzzed(SHARE)
@given(st.sampled_from(["b.geo", "b.msh", "b.step", "b.brep", "b.geo.gz", "b.msh.gz"]), st.binary(max_size=300))
def test_any_bytes(name: str, content: bytes) -> None:
    use(name, content)
