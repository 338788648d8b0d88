"""What is said of results that are lost, edited or odd is true, and short."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from petsc4py import PETSc

from shared.command import Call, assert_one_line
from shared.drawn import write_hinge
from shared.histories import RUN_FOUR, assert_same, names_in
from stickslip.geometry.errors import MachineError, SceneError
from stickslip.solvers.interface import factorised
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.commands.cli import LONGEST, shortened
from stickslip.workflows.formats.steps import step_name
from stickslip.workflows.run.folder import BEGUN, RESULT


def test_steps_that_are_gone_are_not_said_to_be_kept(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def lose(self: object, step: StepResult) -> None:
        if step.time == 1.0:
            shutil.rmtree(folder / ".out.running")

    monkeypatch.setattr("stickslip.workflows.run.terminal.Reporter._step", lose)
    code, _, err = call(*RUN_FOUR)
    assert code == 4
    assert_one_line(err)
    assert ".out.running: is gone, and with it the steps so far" in err
    assert "kept" not in err
    assert "--resume" not in err


def test_lost_beginning_does_not_send_in_a_circle(call: Call, stopped: Path) -> None:
    (stopped / BEGUN).unlink()
    before = {name: (stopped / name).read_bytes() for name in names_in(stopped)}
    code, _, err = call(*RUN_FOUR)
    assert (code, "--resume" in err, f"without its {BEGUN}" in err) == (2, False, True)
    assert_one_line(err)
    code, _, err = call(*RUN_FOUR, "--resume")
    assert (code, f"{BEGUN}: is lost" in err) == (4, True)
    assert_one_line(err)
    assert {name: (stopped / name).read_bytes() for name in names_in(stopped)} == before


@pytest.mark.parametrize("content", [None, "", "{", "[]", "[" * 100_000, "\0" * 100])
def test_result_that_is_lost_or_damaged_does_not_block_sound_steps(
    content: str | None, call: Call, stopped: Path, whole: Path
) -> None:
    (stopped / RESULT).unlink()
    if content is not None:
        (stopped / RESULT).write_text(content)
    assert call(*RUN_FOUR, "--resume")[0] == 0
    assert_same(stopped, whole)


@pytest.mark.parametrize("status", ["converged", "doubtful"])
def test_result_that_was_edited_is_not_believed(status: str, call: Call, stopped: Path, whole: Path) -> None:
    text = (stopped / RESULT).read_text()
    (stopped / RESULT).write_text(text.replace('"status": "interrupted"', f'"status": "{status}"'))
    code, _, err = call(*RUN_FOUR, "--resume")
    assert code == 0
    assert "out/result.json: was changed after the run; the steps decide" in err
    assert_same(stopped, whole)


def test_edited_result_without_steps_is_left_alone(call: Call, stopped: Path) -> None:
    (stopped / RESULT).write_text('{"status": "converged"}')
    shutil.rmtree(stopped / "steps")
    before = {name: (stopped / name).read_bytes() for name in names_in(stopped)}
    code, _, err = call(*RUN_FOUR, "--resume")
    assert code == 4
    assert_one_line(err)
    assert "was changed after the run, and its steps are gone" in err
    assert {name: (stopped / name).read_bytes() for name in names_in(stopped)} == before


@pytest.mark.parametrize("content", ["[" * 100_000, '{"a":' * 100_000, "1" * 10_000, '{"scene": ' + "[" * 5000])
def test_beginning_that_is_nested_or_endless_is_refused(content: str, call: Call, stopped: Path) -> None:
    (stopped / BEGUN).write_text(content)
    code, _, err = call(*RUN_FOUR, "--resume")
    assert code == 4
    assert_one_line(err)
    assert f"out/{BEGUN}" in err


NAMES = [step_name(1), step_name(2), BEGUN, RESULT, "run.log", "fields.h5", "history.csv"]
KINDS = ["pipe", "device", "folder"]
OFTEN = {(step_name(1), "pipe"), (RESULT, "device"), ("run.log", "folder")}


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    ("name", "kind"),
    [  # each kind of each file when there is time
        pytest.param(name, kind, marks=[] if (name, kind) in OFTEN else pytest.mark.slow)
        for name in NAMES
        for kind in KINDS
    ],
)
def test_what_is_no_file_is_not_read_for_ever(name: str, kind: str, call: Call, stopped: Path) -> None:
    path = stopped / name
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    for words in (["--resume"], []):
        code, _, err = call(*RUN_FOUR, *words)
        assert code in (0, 2, 4), err
        assert "Traceback" not in err
        if code:
            assert_one_line(err)
        assert os.path.lexists(path)


def test_refusals_are_short_lines_that_keep_beginning_and_end() -> None:
    text = "bodies.block.E = " + "9" * 100_000 + ": must be positive"
    assert len(shortened(text, LONGEST)) == LONGEST < 300
    assert shortened(text).startswith("bodies.block.E = ")
    assert shortened(text).endswith(": must be positive")
    assert shortened("short") == "short"


@pytest.mark.parametrize(
    "words",
    [
        ["run", "x" * 100_000],
        ["run", "block", f"--set=title={'x' * 100_000}", "--set=nothing=1"],
        ["run", "block", f"--set={'x' * 100_000}=1"],
        ["x" * 100_000],
        ["new", "x" * 100_000],
        ["verify", "x" * 100_000],
        ["fclib", "x" * 100_000],
        ["cost", "block", "--quantity", "x" * 100_000],
        ["mesh", "block", "-o", "x" * 100_000],
    ],
)
def test_endless_words_are_not_echoed(words: list[str], call: Call) -> None:
    code, _, err = call(*words)
    assert code in (2, 4)
    assert_one_line(err)


def _factorised(*pivots: float) -> None:
    K = PETSc.Mat().createAIJ((len(pivots), len(pivots)), nnz=1)
    K.setUp()
    for row, pivot in enumerate(pivots):
        K.setValue(row, row, pivot)
    K.assemble()
    factorised.FactorisedVolume(K, np.zeros(0, np.int32), Counters())


def test_mechanism_is_not_reported_as_too_little_memory() -> None:
    with pytest.raises(SceneError, match="stiffness of the bodies is singular: part of a body moves") as found:
        _factorised(1.0, 0.0, 1.0)
    assert (found.value.exit_code, "memory" in str(found.value)) == (2, False)
    _factorised(1.0, 1.0, 1.0)


def test_mechanism_is_refused_and_named_before_anything_is_factorised(call: Call, folder: Path) -> None:
    scene = write_hinge(folder)
    code, _, err = call("run", str(scene), "-q", "-o", "out")
    assert code == 2
    assert_one_line(err)
    assert "a part of the mesh that no contact touches can turn about (1, 1), where it hangs on the rest" in err
    assert not (folder / "out").exists()
    held = "--set=supports.right={boundary='block.right',displacement={x=0.0,y=0.0}}"
    assert call("run", str(scene), "-q", "-o", "out", held) == (0, "", "")


def test_too_little_memory_is_called_so(monkeypatch: pytest.MonkeyPatch) -> None:
    for word, numbers in (("SINGULAR", ()), ("NO_MEMORY", (-10, -40))):
        monkeypatch.setattr(factorised, word, numbers)
    with pytest.raises(MachineError, match="too little memory to factorise the bodies") as found:
        _factorised(0.0)
    assert found.value.exit_code == 4
