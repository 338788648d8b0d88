"""The judges of the hard suite: where a second method makes an answer wrong, and what becomes of it and of a twin."""

import json
import os
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stickslip.geometry.errors import MachineError, SolverError
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.lab.verification.hard import judge as judging
from stickslip.workflows.lab.verification.hard import suite
from stickslip.workflows.lab.verification.hard.judge import AGREEMENT, Outcome, Solved, Verdict, apart, judge
from stickslip.workflows.lab.verification.hard.page import confirmed, twins
from stickslip.workflows.lab.verification.hard.run import _line, _lines, _rows
from stickslip.workflows.lab.verification.hard.suite import Row, Task, Worker
from stickslip.workflows.scene_file.read import read

COARSE = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5"]
SMOOTH = 'contacts.base={surface="block.bottom", against="foundation", normal={law="unilateral"}}'
SPHERE = ["geometry.mesh_size=4.0", "geometry.contact_mesh_size=0.004"]


def block(*words: str) -> Scene:
    return read("block", [*COARSE, *words])


# the second opinion


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        (SMOOTH, Outcome.WRONG),
        ("contacts.base.friction.mu=0.0", Outcome.WRONG),
        ("contacts.base.friction.mu=0.3", Outcome.BRANCH),
    ],
)
def test_a_second_answer_is_wrong_without_friction_and_another_solution_with_it(
    word: str, expected: Outcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second method is given a body of twice the stiffness: its forces are twice as large."""
    solve = judging.solve

    def solved(scene: Scene) -> Solved:
        second = scene.solver.method == "nsgs"
        return solve(block(word, "bodies.block.E=2.0", 'solver.method="nsgs"') if second else scene)

    monkeypatch.setattr(judging, "solve", solved)
    first, last = judge(block(word))
    assert (first.outcome, last.outcome) == (Outcome.SOLVED, expected)
    assert "nsgs: resultants differ by 5.0e-01" in last.reason


@pytest.mark.parametrize(
    ("scene", "key", "by", "expected"),
    [
        (block(SMOOTH), "displacement", 2 * AGREEMENT, Outcome.WRONG),
        (block(SMOOTH), "nodal forces", np.nan, Outcome.WRONG),
        (read("sphere", SPHERE), "displacement", 2 * AGREEMENT, Outcome.BRANCH),  # a force moves the plane
        (read("sphere", SPHERE), "nodal forces", 2 * AGREEMENT, Outcome.WRONG),
    ],
)
def test_without_supports_only_forces_are_unique(
    scene: Scene, key: str, by: float, expected: Outcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    off = dict.fromkeys(("resultants", "displacement", "nodal forces"), 0.0) | {key: by}
    monkeypatch.setattr(judging, "_differences_of_methods", lambda own, other: off)
    *_, last = judge(scene)
    assert last.outcome is expected


def test_a_loose_run_is_judged_by_its_own_tolerance() -> None:
    """Nodal forces of the ball, on a small surface far from its support, are known to about 20 times the tolerance."""
    *_, last = judge(
        read("sphere", ["geometry.mesh_size=2.0", "geometry.contact_mesh_size=0.002", "solver.tolerance=1e-4"])
    )
    assert (last.outcome, last.second) == (Outcome.SOLVED, "surface-uzawa: agrees")


def test_numbers_of_other_places_are_not_compared() -> None:
    with pytest.raises(ValueError, match=r"shape \(1, 2\) cannot be compared with others of \(1, 3\)"):
        apart(np.ones((1, 2)), np.ones((1, 3)))


def test_nodal_forces_of_sliding_contact_are_left_out() -> None:
    def found(nodal: tuple[int, int]) -> Any:
        return SimpleNamespace(quantities=lambda: {"resultants": ("N", np.ones((1, 1)))}, nodal=lambda: np.ones(nodal))

    assert judging._differences_of_methods(found((0, 0)), found((1, 4))) == {"resultants": 0.0, "nodal forces": 0.0}


class Pipe:
    """What a worker's process says, word by word; then it is silent, or has died."""

    def __init__(self, words: list[object], dies: bool) -> None:
        self._words, self._dies = words, dies

    def send(self, task: Task) -> None:
        pass

    def poll(self, seconds: float) -> bool:
        return bool(self._words) or self._dies

    def recv(self) -> object:
        if not self._words:
            raise EOFError
        return self._words.pop(0)


@pytest.mark.parametrize("first", [Outcome.SOLVED, Outcome.WRONG])
@pytest.mark.parametrize(
    ("then", "dies", "lost"),
    [(["IndexError: list"], False, "IndexError: list"), ([], True, "the process died"), ([], False, "")],
)
def test_a_second_opinion_that_breaks_is_a_failure_and_a_slow_one_is_not(
    first: Outcome, then: list[object], dies: bool, lost: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = Row("block", "mu", "mu x 2", (), Verdict(outcome=first, iterations=3))
    worker = Worker(opinion=0.01)
    monkeypatch.setattr(worker, "_started", lambda: Pipe([row, *then], dies))
    found = worker.perform(Task("block", "mu x 2", 0))
    assert found is not None
    if lost and first is Outcome.SOLVED:
        assert (found.verdict.outcome, found.verdict.reason) == (Outcome.FAILED, f"second opinion: {lost}")
    else:
        assert (found.verdict.outcome, found.verdict.reason) == (first, "")
    assert found.verdict.second.startswith(f"none: {lost}")
    assert not confirmed(found)


def _dies_at_first(pipe: Connection) -> None:
    """A process that MPI ends as it begins, the first time."""
    began = Path(os.environ["BEGAN"])
    if not began.exists():
        began.touch()
        os._exit(1)
    pipe.send(suite.BEGUN)
    task = pipe.recv()
    pipe.send(Row(task.scene, "as it is", task.name, (), Verdict(outcome=Outcome.SOLVED)))
    pipe.send("done")


def test_a_process_that_dies_before_its_task_is_begun_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BEGAN", str(tmp_path / "began"))
    monkeypatch.setattr(suite, "_work", _dies_at_first)
    worker = Worker(opinion=0.01)
    found = worker.perform(Task("block", "mu x 2", 0))
    worker.end()
    assert found is not None
    assert found.verdict.outcome is Outcome.SOLVED
    monkeypatch.setattr(suite, "STARTS", 1)
    (tmp_path / "began").unlink()
    with pytest.raises(MachineError, match="processes one after the other died"):
        worker.perform(Task("block", "mu x 2", 0))
    worker.end()


# the twin


def test_what_became_of_the_twin_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    own = block()
    assert next(judge(own)).twin == ""
    assert next(judge(own, block())).twin == "agrees"
    assert next(judge(own, block("bodies.block.E=2.0"))).twin == "differs"
    assert next(judge(own, block("geometry.contact_mesh_size=0.4"))).twin == "other mesh"
    solve = judging.solve

    def solved(scene: Scene) -> Solved:
        if scene.solver.max_iterations == 1:
            raise SolverError("no answer")
        return solve(scene)

    monkeypatch.setattr(judging, "solve", solved)
    verdict = next(judge(own, replace(own, solver=replace(own.solver, max_iterations=1))))
    assert (verdict.outcome, verdict.twin) == (Outcome.SOLVED, "no answer")


def test_the_page_counts_the_twins_that_were_compared() -> None:
    words = ("agrees", "agrees", "differs", "other mesh", "")
    rows = [Row("block", "units", "mm, N", (), Verdict(outcome=Outcome.SOLVED, twin=word)) for word in words]
    rows.append(Row("block", "mu", "mu x 2", (), Verdict(outcome=Outcome.SOLVED)))  # has none
    rows.append(Row("block", "units", "mm, N", (), Verdict(outcome=Outcome.REFUSED)))
    said = "Of 5 answers with a twin, a scene whose answer is known to be the same, 3 were compared with it"
    assert twins(rows) == f"{said} (other mesh: 1; not recorded: 1)."


def test_rows_from_before_twins_were_recorded_are_read(tmp_path: Path) -> None:
    row = Row("block", "units", "mm, N", ("a=1",), Verdict(outcome=Outcome.SOLVED, twin="agrees"))
    plain = json.loads(_line(row))
    assert plain["verdict"].pop("twin") == "agrees"
    (tmp_path / "hard.jsonl").write_text(_line(row) + json.dumps(plain) + "\n")
    assert _rows(tmp_path, _lines(tmp_path / "hard.jsonl")) == [
        row,
        replace(row, verdict=replace(row.verdict, twin="")),
    ]
