"""The command line, called as a user calls it: in this process, which is fast, or as one of its own."""

import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from shared.cases import often
from shared.command import LIMIT, Start
from shared.histories import FOUR, Stop
from shared.solved import Solved, coarse, solve
from stickslip.workflows.commands.cli import app, guarded
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import READY, read

Spoken = tuple[int, str, str]  # exit code, standard output, standard error
COMMANDS = get_command(app)  # calling `app` makes it again each time


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def call(folder: Path, capfd: pytest.CaptureFixture[str]) -> Callable[..., Spoken]:
    """Run `stickslip WORDS` in this process; what C libraries print is captured too."""

    def act(*words: str) -> Spoken:
        capfd.readouterr()
        code = guarded(lambda: COMMANDS(list(words), standalone_mode=False))
        return code, *capfd.readouterr()

    return act


@pytest.fixture
def command() -> list[str]:
    """What starts the command line as a process."""
    return [sys.executable, "-m", "stickslip.workflows.commands.start"]


@pytest.fixture
def environment() -> dict[str, str]:
    """Python's own copy of the environment: MPI has left its variables in the C library's."""
    return {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}


@pytest.fixture
def start(folder: Path, command: list[str], environment: dict[str, str]) -> Start:
    """Run `stickslip WORDS` as a process, with other variables and streams."""

    def act(*words: str, variables: dict[str, str | None] | None = None, **options: Any) -> Any:
        found = {key: value for key, value in (environment | (variables or {})).items() if value is not None}
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
        return subprocess.run(
            [*command, *words], **{"cwd": folder, "env": found, "text": True, "timeout": LIMIT, **streams}, check=False
        )

    return act


@pytest.fixture
def spawn(start: Start) -> Callable[..., Spoken]:
    """Run `stickslip WORDS` as a process."""

    def act(*words: str) -> Spoken:
        done = start(*words)
        return done.returncode, done.stdout, done.stderr

    return act


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a run of `FOUR` steps."""
    folder = tmp_path_factory.mktemp("whole") / "out"
    run(read("block", FOUR), folder)
    return folder


@pytest.fixture(scope="session")
def stopped_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stopped") / "out"
    run(read("block", FOUR), folder, Watch(on_step=Stop(2)))
    return folder


@pytest.fixture
def stopped(folder: Path, stopped_once: Path) -> Path:
    """Results of a run that was stopped after two of `FOUR` steps."""
    return Path(shutil.copytree(stopped_once, folder / "out"))


# test_mesh_command solves those of files: the identities tested on `solved` are those of builders' shapes
# those of clocks have steps of their own: test_time_by_error
TABLES = {p.stem: tomllib.loads(p.read_text()) for p in READY.glob("*.toml")}
BUILT_SHAPES = sorted(n for n, t in TABLES.items() if "file" not in t["geometry"] and "clock" not in t.get("steps", {}))
KEPT = {  # always run: every model, order, kind of cells and obstacle, law and effect; one contact, and several
    *("arch", "axisymmetric", "block", "cube", "dam", "foundation", "lap_joint", "ring", "rotor", "rubber_mount"),
    *("shaft", "sledge", "sliding", "sphere", "spruce", "stick_slip", "two_blocks"),
}


@pytest.fixture(scope="session", params=often(BUILT_SHAPES, KEPT))
def solved(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Solved:
    return solve(read(request.param, coarse(request.param)), tmp_path_factory.mktemp(request.param) / "out")
