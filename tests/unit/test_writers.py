"""The contract of a writer: found by its class, called in its turn, with keys of its own in the scene's [output]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

import pytest

import stickslip
from shared.command import result
from shared.histories import SMALL, Stop
from stickslip import HistoryTuple, Key, MachineError, Output, Scene, SceneError, StepResult, Watch
from stickslip.workflows.formats.steps import step_name
from stickslip.workflows.lab.pages.scene_page import reference
from stickslip.workflows.run.result import scene_hash
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict, read, to_dict
from stickslip.workflows.writers.tables import TableWriter
from stickslip.workflows.writers.writer import Ended, Keys, Turn, Writer, added_keys, keys_of, registered

READY = {"Animation", "ContactTables", "FieldFiles", "HistoryTable", "Pictures", "ProbeTable", "StepsTable"}
TWO = [*SMALL, "steps.count=2"]


@pytest.fixture(autouse=True)
def _kinds_of_a_test_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Writer, "kinds", [*Writer.kinds])


def diary(turn: Turn, said: list[tuple[Any, ...]]) -> type[Writer]:
    """A writer that notes when it is called, and which of the run's own files are there."""

    class Diary(Writer):
        def begin(self) -> None:
            said.append((self.turn.name, "begin"))

        def resume(self, steps: Sequence[StepResult]) -> None:
            said.append((self.turn.name, "resume", len(steps), len(steps[-1].displacement) > 0))

        def step(self, index: int, result: StepResult) -> None:
            assert len(result.displacement) > 0
            said.append((self.turn.name, "step", index, (self.job.folder / step_name(index)).exists()))

        def failed(self, index: int, history: Sequence[HistoryTuple]) -> None:
            said.append((self.turn.name, "failed", index, len(history) > 0))

        def finish(self, ended: Ended) -> None:
            there = (self.job.folder / "result.json").exists()
            said.append((self.turn.name, "finish", ended.status, len(ended.steps), there))

    Diary.turn = turn
    return Diary


def test_every_ready_writer_is_found_and_bases_are_not() -> None:
    assert {kind.__name__ for kind in registered()} >= READY
    assert TableWriter not in registered()


@pytest.mark.parametrize("key", ["vtu", "pictures"])
def test_a_key_that_is_there_already_is_an_error_of_the_writer(key: str) -> None:
    namespace = {key: False, "__annotations__": {key: Annotated[bool, Key("-", "once more")]}}
    again = dataclass(frozen=True, kw_only=True)(type("Again", (Keys,), namespace))
    diary(Turn.AFTER, []).keys = again
    with pytest.raises(TypeError, match=f"Diary adds output.{key}, which is there already"):
        added_keys()


def test_a_writer_is_called_in_its_turn(tmp_path: Path) -> None:
    said: list[tuple[Any, ...]] = []
    for turn in (Turn.LAST, Turn.BEFORE, Turn.AFTER):
        diary(turn, said)
    run(read("block", TWO), tmp_path / "out")
    order = ("BEFORE", "AFTER", "LAST")
    assert said == [
        *((turn, "begin") for turn in order),
        *((turn, "step", index, turn != "BEFORE") for index in (1, 2) for turn in order),
        *((turn, "finish", "converged", 2, turn != "BEFORE") for turn in order),
    ]


def test_a_writer_is_told_of_a_run_that_goes_on(tmp_path: Path) -> None:
    said: list[tuple[Any, ...]] = []
    diary(Turn.AFTER, said)
    run(read("block", TWO), tmp_path / "out", Watch(on_step=Stop(1)))
    assert said[-1] == ("AFTER", "finish", "interrupted", 1, True)
    del said[:]
    run(read("block", TWO), tmp_path / "out", resume=True)
    assert said == [("AFTER", "resume", 1, True), ("AFTER", "step", 2, True), ("AFTER", "finish", "converged", 2, True)]


def test_a_writer_is_told_of_a_step_that_failed(tmp_path: Path) -> None:
    said: list[tuple[Any, ...]] = []
    diary(Turn.BEFORE, said)
    words = ["solver.method=uzawa", "solver.max_iterations=1"]
    assert run(read("block", [*TWO, *words]), tmp_path / "out")[0].status == "not_converged"
    assert said[1:] == [("BEFORE", "failed", 1, True), ("BEFORE", "finish", "not_converged", 0, False)]


@pytest.mark.parametrize(("when", "kept"), [pytest.param(Turn.BEFORE, 1, marks=pytest.mark.slow), (Turn.AFTER, 2)])
def test_a_writer_that_fails_ends_the_run_and_the_steps_before_are_kept(when: Turn, kept: int, tmp_path: Path) -> None:
    """A step whose file is there is safe, whatever fails after it; resumed, the run ends like any other."""

    class Full(Writer):
        turn = when
        room = 1

        def resume(self, steps: Sequence[StepResult]) -> None:
            Full.room = 9

        def step(self, index: int, result: StepResult) -> None:
            if index > self.room:
                raise MachineError("no room")

    with pytest.raises(MachineError, match=f"^no room; {kept} steps are kept, go on with --resume$"):
        run(read("block", [*SMALL, "steps.count=4"]), tmp_path / "out")
    outcome, content = run(read("block", [*SMALL, "steps.count=4"]), tmp_path / "out", resume=True)
    assert (outcome.status, len(content["steps"])) == ("converged", 4)


# keys of their own


@dataclass(frozen=True, kw_only=True)
class NoteKeys(Keys):
    note: Annotated[str, Key("-", "a text that is left in the folder")] = ""
    times: Annotated[int, Key("-", "how often")] = 1

    def __post_init__(self) -> None:
        if self.times < 1:
            raise SceneError(f"times = {self.times}: must be at least 1")


@pytest.fixture
def note() -> type[Writer]:
    class Note(Writer):
        keys = NoteKeys

        @classmethod
        def wanted(cls, scene: Scene) -> bool:
            return keys_of(NoteKeys, scene.output).note != ""

        def resume(self, steps: Sequence[StepResult]) -> None:
            return None

        def finish(self, ended: Ended) -> None:
            keys = keys_of(NoteKeys, self.job.scene.output)
            (self.job.folder / "note.txt").write_text(keys.note * keys.times)

    return Note


def test_no_two_writers_have_the_same_key() -> None:
    names = [field.name for kind in {kind.keys for kind in registered()} for field in fields(kind)]
    names += [field.name for field in fields(Output)]
    assert len(names) == len(set(names))


@pytest.mark.usefixtures("note")
def test_a_writer_adds_keys_to_the_table_of_output(tmp_path: Path) -> None:
    plain = read("block", TWO)
    asks = read("block", [*TWO, "output.note=tick", "output.times=2"])
    run(asks, tmp_path / "asks")
    assert (tmp_path / "asks" / "note.txt").read_text() == "ticktick"
    told = result(tmp_path / "asks")["scene"]["output"]
    assert (told["note"], told["times"], told["pictures"], "writers" in told) == ("tick", 2, False, False)
    assert from_dict(to_dict(asks)) == asks
    run(plain, tmp_path / "plain")
    assert not (tmp_path / "plain" / "note.txt").exists()
    for keys in ({"writers": {"note": "tick", "times": 2}}, {"note": "tick", "times": 2}):
        output = stickslip.Output(pictures=False, **keys)
        assert replace(plain, output=output) == asks
        assert replace(output, note="", times=1) == plain.output


def test_a_scene_that_asks_for_nothing_new_stays_the_same(request: pytest.FixtureRequest) -> None:
    before = read("block", TWO)
    plain, hashed = to_dict(before), scene_hash(before)
    request.getfixturevalue("note")
    for words in ([], ['output.note=""'], ["output.times=1"]):
        scene = read("block", [*TWO, *words])
        assert (to_dict(scene), scene_hash(scene), scene) == (plain, hashed, before)


@pytest.mark.usefixtures("note")
@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("output.nite=tick", r"output\.nite: unknown key; did you mean note\?"),
        ("output.note=3", r"output\.note = 3: expected a text, in quotes"),
        ("output.times=0", r"output\.times = 0: must be at least 1"),
        ("output.every=0", r"output\.every = 0: must be at least 1"),
        ("output=3", "output = 3: expected a table"),
        ("output.writers={}", r"output\.writers: unknown key"),
    ],
)
def test_wrong_keys_are_refused_like_all_others(word: str, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        read("block", [word])


@pytest.mark.usefixtures("note")
def test_a_script_that_asks_for_what_nobody_writes_is_told_before_anything_is_solved(tmp_path: Path) -> None:
    scene = replace(read("block", TWO), output=stickslip.Output(writers={"nite": "tick"}))
    with pytest.raises(SceneError, match=r"nite: unknown key; did you mean note\?"):
        stickslip.Output(nite="tick")
    with pytest.raises(SceneError, match=r"note = 3: expected a text, in quotes"):
        stickslip.Output(note=3)
    with pytest.raises(SceneError, match=r"output\.nite = tick: no writer has this key; did you mean note\?"):
        run(scene, tmp_path / "out")
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("note")
def test_the_page_of_the_scene_file_lists_them() -> None:
    _, _, table = reference().partition("## [output]")
    assert '| `note` | text | - | "" | a text that is left in the folder |' in table.partition("##")[0]
    assert "`writers`" not in table
