"""The hard suite: its small sibling passes, `--set` repeats its variations, and its judges see what is wrong."""

import json
import os
from collections.abc import Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from shared.command import READY_NAMES
from stickslip import MachineError, Scene, SceneError, SolverError, read
from stickslip.workflows.lab.verification.hard import judge as judging
from stickslip.workflows.lab.verification.hard import run as command
from stickslip.workflows.lab.verification.hard import suite
from stickslip.workflows.lab.verification.hard.judge import AGREEMENT, Outcome, Solved, Verdict, apart, judge
from stickslip.workflows.lab.verification.hard.run import (
    BAD,
    _line,
    _rows,
    _stored_lines,
    confirmed,
    hard,
    repeating,
    table,
    twins,
    write_page,
)
from stickslip.workflows.lab.verification.hard.suite import NAMES, Row, Task, Worker, performed, results, tasks
from stickslip.workflows.lab.verification.hard.tables import overrides, ready
from stickslip.workflows.lab.verification.hard.variations import FIXED, Scale, variation, varied
from stickslip.workflows.scene_file.read import from_dict, to_dict

SMALL = (6, 1)  # variations, and the seed of their order
SEED = 0
COARSE = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25"]


@pytest.fixture(scope="module")
def blocks() -> list[Row]:
    return list(results(("block",), 3, SEED, jobs=1))


def assert_solved(rows: list[Row], number: int) -> None:
    assert len(rows) == number
    assert not [f"{repeating(row)}: {row.verdict.reason}" for row in rows if row.verdict.outcome in BAD]
    assert sum(row.verdict.outcome is Outcome.SOLVED for row in rows) >= number / 2


@pytest.mark.slow
def test_small_sibling_has_no_failure_and_no_wrong_answer() -> None:
    assert_solved(list(results(NAMES, *SMALL, jobs=1, opinion=2.0)), SMALL[0])


def test_variations_of_a_block_have_neither(blocks: list[Row]) -> None:
    assert_solved(blocks, 3)


def test_the_scene_with_the_fewest_variations_has_25_at_least() -> None:
    random = np.random.default_rng(0)
    base = ready("sphere")  # an axisymmetric body without friction: fewest apply
    assert sum(varied(base, one.change, random) is not None for one in FIXED.values()) >= 25


@pytest.mark.parametrize("scene", READY_NAMES)
def test_every_variation_is_made_or_left_out(scene: str) -> None:
    base, random = to_dict(read(scene)), np.random.default_rng(0)  # as a row that is lost makes it, with all keys
    for one in FIXED.values():
        for change in (one.change, one.twin):
            if change is not None and one.kind != "limit":  # which solves
                with suppress(SceneError):  # "at once" may leave out a time that others need
                    varied(base, change, random)


@pytest.mark.parametrize("scene", ["spring_slider", "fault"])
def test_scenes_with_a_clock_keep_it_and_vary_by_it(scene: str) -> None:
    base, random = ready(scene), np.random.default_rng(0)
    found = {name: varied(base, one.change, random) for name, one in FIXED.items() if one.kind != "limit"}
    for name in ("reversed", "everything back", "time x 1000", "error x 10", "largest x 0.1", "one step", "Dc x 100"):
        made = found[name]
        assert made is not None, name
        assert from_dict(made).steps.clock is not None
    assert found["one big step"] is None
    tresca = found["friction tresca"]
    assert tresca is not None
    assert from_dict(tresca).steps.count > 1
    assert sum(made is not None for made in found.values()) >= 60


def test_another_unit_of_time_changes_nothing_where_rates_matter() -> None:
    """The slider's state, rates, clock and damping are converted with its times; up to its first event."""
    drive = {"x": [[0, 0], [110, 1.1e-4]], "y": 0.0}
    base = to_dict(read("spring_slider", ["geometry.mesh_size=1.0", "steps.clock.error=1e-3", "steps.end=110"]))
    base["supports"]["top"]["displacement"] = drive
    one = variation("time x 1000")
    made = varied(base, one.change, np.random.default_rng(0))
    assert made is not None
    assert made["steps"]["end"] == 110e3
    assert judged(made, base).twin == "agrees"
    made["contacts"]["base"]["friction"]["V0"] *= 1000
    assert judged(made, base).twin == "differs"


def judged(made: dict[str, Any], twin: dict[str, Any]) -> Verdict:
    """The verdict without a second opinion."""
    return next(judge(from_dict(made), from_dict(twin)))


@pytest.mark.parametrize("scene", ["block", "arch", "shrink_fit"])
@pytest.mark.parametrize(
    "name", ["mu x 1000", "friction none", "one big step", "reversed", "force x 1e-12", "random 1"]
)
def test_set_makes_the_same_scene(scene: str, name: str) -> None:
    found = varied(ready(scene), variation(name).change, np.random.default_rng(0))
    assert found is not None
    words = overrides(to_dict(read(scene)), found)
    assert to_dict(read(scene, words)) == to_dict(from_dict(found))


def test_only_the_unsolved_is_judged_again(blocks: list[Row], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as known:
        known.setattr(command, "results", lambda *_, **__: blocks)
        assert hard(["block"], number=3, seed=SEED, folder=tmp_path)
    lines = (tmp_path / "hard.jsonl").read_text().splitlines()
    spoilt = [lines[0], lines[1].replace('"outcome": "solved"', '"outcome": "failed"'), lines[2]]
    spoilt[0] = spoilt[0].replace('"iterations": ', '"iterations": 7')  # solved: is kept as it is
    (tmp_path / "hard.jsonl").write_text("\n".join(spoilt) + "\n")
    assert hard(["block"], seed=SEED, folder=tmp_path, again=True)
    now = (tmp_path / "hard.jsonl").read_text().splitlines()
    assert now[0] == spoilt[0]
    assert '"outcome": "solved"' in now[1]
    assert "--number 3" in (tmp_path / "hard.md").read_text()
    assert "--again`" in (tmp_path / "hard.md").read_text()
    assert str(tmp_path) not in (tmp_path / "hard.md").read_text()  # where it was made is nobody's business
    with pytest.raises(SceneError, match="needs the folder"):
        hard(again=True)
    (tmp_path / "hard.jsonl").write_text("{}\n")
    with pytest.raises(MachineError, match="is not what"):
        hard(folder=tmp_path, again=True)


def test_a_run_that_was_ended_goes_on_behind_its_rows(
    blocks: list[Row], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def ended(*_: Any, **__: Any) -> Iterator[Row]:
        yield blocks[0]
        raise KeyboardInterrupt

    with monkeypatch.context() as killed:
        killed.setattr(command, "results", ended)
        with pytest.raises(KeyboardInterrupt):
            hard(["block"], number=2, seed=SEED, folder=tmp_path)
    part = tmp_path / "hard.part.jsonl"
    part.write_text(part.read_text().replace('"iterations": ', '"iterations": 7') + '{"scene": "blo')  # a torn line
    with pytest.raises(SceneError, match="go on with --resume"):
        hard(["block"], number=2, seed=SEED, folder=tmp_path)
    with pytest.raises(SceneError, match="of another run"):
        hard(["block"], number=2, seed=SEED + 1, folder=tmp_path, resume=True)
    assert hard(["block"], number=2, seed=SEED, folder=tmp_path, resume=True)
    rows = [json.loads(line) for line in (tmp_path / "hard.jsonl").read_text().splitlines()]
    assert [row["name"] for row in rows] == [row.name for row in blocks[:2]]
    assert [row["verdict"]["outcome"] for row in rows] == [row.verdict.outcome.value for row in blocks[:2]]
    assert '"iterations": 7' in (tmp_path / "hard.jsonl").read_text()  # was not solved again
    assert not part.exists()


def test_tasks_follow_from_the_seed() -> None:
    def first(seed: int) -> list[Task]:
        return [task for task, _ in zip(tasks(NAMES, seed), range(50), strict=False)]

    assert first(3) == first(3)
    assert [task.name for task in first(3)] != [task.name for task in first(4)]


def test_variation_that_does_not_apply_is_left_out() -> None:
    assert list(performed(Task("block", "E of last x 100", 0))) == [None]  # one body only


def test_twin_of_another_answer_is_wrong() -> None:
    scene = read("block", COARSE)
    assert next(judge(scene, read("block", COARSE))).outcome is Outcome.SOLVED
    stiffer = read("block", [*COARSE, "bodies.block.E=1.001"])
    verdict = next(judge(scene, stiffer))
    assert verdict.outcome is Outcome.WRONG
    assert "twin: resultants differ by 1.0e-03" in verdict.reason
    assert next(judge(scene, scene, Scale(length=1.0, force=1.001))).outcome is Outcome.WRONG


@pytest.mark.parametrize("friction", [True, False])
def test_second_method_confirms(friction: bool) -> None:
    """Without friction condensed-newton condenses onto the pressed dofs alone, and nsgs onto all of the contact."""
    smooth = 'contacts.base={surface="block.bottom", against="foundation", normal={law="unilateral"}}'
    *_, last = judge(read("block", [*COARSE, *[smooth] * (not friction)]))
    assert (last.outcome, last.second) == (Outcome.SOLVED, "nsgs: agrees")


def test_outcomes_without_an_answer() -> None:
    lifted = read("block", [*COARSE, "supports={}", "loads.up={boundary='block.top',force=[0.0,1.0]}"])
    assert next(judge(lifted)).outcome is Outcome.PROVED
    refused = next(judge(read("shrink_fit", ["solver.method=nsgs"])))
    assert (refused.outcome, refused.held) == (Outcome.REFUSED, False)
    lost = next(judge(read("block", [*COARSE, "solver.method=uzawa", "solver.max_iterations=1"])))
    assert (lost.outcome, lost.held) == (Outcome.FAILED, True)


def test_answer_that_its_audit_doubts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weight on springs so soft that the stones slide 1e7 m: refused, or else rounding takes their stresses."""
    soft = [f"contacts.{name}.friction.k_T=1e-6" for name in read("stack").contacts]
    scene = read("stack", ["geometry.mesh_size=0.25", *soft])
    verdict = next(judge(scene))
    assert verdict.outcome is Outcome.REFUSED
    assert "(contacts.ground.friction.k_T is too soft beside the bodies)" in verdict.reason
    monkeypatch.setattr("stickslip.solvers.simulation.resolve.least_springs", lambda scene: 0.0)
    verdict = next(judge(scene))
    assert (verdict.outcome, verdict.held) == (Outcome.DOUBTFUL, False)
    assert "rounding is" in verdict.reason


def test_several_solutions_are_counted() -> None:
    words = [
        "contacts.base.friction.mu=6.0",
        "bodies.block.nu=0.4999",
        "geometry.order=1",
        "bodies.block.formulation=displacement",
    ]
    verdict = next(judge(read("raous", words)))
    assert (verdict.outcome, verdict.reason) == (Outcome.BRANCH, "4 other solutions were met")


def test_process_that_does_not_end_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suite, "LIMIT", 0.01)
    (row,) = results(["block"], 1, 0, jobs=1)
    assert row.verdict.outcome is Outcome.FAILED
    assert "no end" in row.verdict.reason


def test_page_counts_and_repeats(tmp_path: Path) -> None:
    good = Row("block", "mu", "mu x 2", ("contacts.base.friction.mu=0.6",), Verdict(outcome=Outcome.SOLVED))
    bad = replace(good, name="mu x 10", verdict=Verdict(outcome=Outcome.WRONG, reason="two judges disagree"))
    assert list(table("scene", [good, bad], lambda row: row.scene))[-1].startswith(
        "| block | 2 | 1 | 0 | 0 | 0 | 0 | 0 | 0 | 1 |"
    )
    write_page(tmp_path / "hard.md", [good, bad], "stickslip verify hard")
    page = (tmp_path / "hard.md").read_text()
    assert "block, mu x 10 (held, 0.0 s): two judges disagree" in page
    assert "`stickslip run block --set=contacts.base.friction.mu=0.6`" in page
    assert (tmp_path / "hard.png").read_bytes().startswith(b"\x89PNG")


def test_wrong_options_are_refused() -> None:
    with pytest.raises(SceneError, match=r"--scenes blok: no such ready scene; did you mean block\?"):
        hard(["blok"])
    with pytest.raises(SceneError, match="--number = 0: must be at least 1"):
        hard(number=0)


@pytest.mark.parametrize("outcome", [Outcome.SOLVED, Outcome.WRONG])
def test_command_writes_its_page_and_says_how_it_ended(
    outcome: Outcome, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    row = Row("cube", "mu", "mu x 2", (), Verdict(outcome=outcome))
    monkeypatch.setattr(command, "results", lambda *arguments, **keys: iter([row]))
    assert hard(["cube"], number=1, folder=tmp_path) == (outcome is Outcome.SOLVED)
    assert f"1 variations: 1 {outcome.value}" in capsys.readouterr().out
    assert len((tmp_path / "hard.jsonl").read_text().splitlines()) == 1
    assert "stickslip verify hard --number 1 --seed 0 --scenes cube" in (tmp_path / "hard.md").read_text()


COARSER = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5"]
SMOOTH = 'contacts.base={surface="block.bottom", against="foundation", normal={law="unilateral"}}'
SPHERE = ["geometry.mesh_size=4.0", "geometry.contact_mesh_size=0.004"]


def block(*words: str) -> Scene:
    return read("block", [*COARSER, *words])


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
        resultants = {"resultants": ("N", np.ones((1, 1)))}
        return SimpleNamespace(steps=(), quantities=lambda: resultants, nodal=lambda: np.ones(nodal))

    assert judging._differences_of_methods(found((0, 0)), found((1, 4))) == {"resultants": 0.0, "nodal forces": 0.0}


class Process:
    """What a worker's process says, word by word; then it is silent, or has died."""

    def __init__(self, words: list[object], dies: bool) -> None:
        self._words, self._dies = words, dies

    def submit(self, act: object, task: Task | None) -> Future[object]:
        said = Future[object]()
        if self._words:
            said.set_result(self._words.pop(0))
        elif self._dies:
            said.set_exception(BrokenProcessPool())
        return said


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
    monkeypatch.setattr(worker, "_started", lambda: Process([row, *then], dies))
    found = worker.perform(Task("block", "mu x 2", 0))
    if lost and first is Outcome.SOLVED:
        assert (found.verdict.outcome, found.verdict.reason) == (Outcome.FAILED, f"second opinion: {lost}")
    else:
        assert (found.verdict.outcome, found.verdict.reason) == (first, "")
    assert found.verdict.second.startswith(f"none: {lost}")
    assert not confirmed(found)


def _dies_at_first() -> None:
    """A process that MPI ends as it begins, the first time."""
    began = Path(os.environ["BEGAN"])
    if not began.exists():
        began.touch()
        os._exit(1)


def test_a_process_that_dies_before_its_task_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BEGAN", str(tmp_path / "began"))
    monkeypatch.setattr(suite, "_begin", _dies_at_first)
    worker = Worker(opinion=0.01)
    found = worker.perform(Task("block", "mu x 2", 0))
    worker.end()
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
    assert _rows(tmp_path, _stored_lines(tmp_path / "hard.jsonl")) == [
        row,
        replace(row, verdict=replace(row.verdict, twin="")),
    ]
