"""The hard suite: its small sibling passes, `--set` repeats its variations, and its judges see what is wrong."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip.geometry.errors import MachineError, SceneError
from stickslip.workflows.lab.verification.hard import run as command
from stickslip.workflows.lab.verification.hard import suite
from stickslip.workflows.lab.verification.hard.judge import Outcome, Verdict, judge
from stickslip.workflows.lab.verification.hard.page import BAD, again, table, write_page
from stickslip.workflows.lab.verification.hard.run import hard
from stickslip.workflows.lab.verification.hard.suite import NAMES, Row, Task, performed, results, tasks
from stickslip.workflows.lab.verification.hard.tables import overrides, ready, scene_of
from stickslip.workflows.lab.verification.hard.variations import FIXED, Scale, variation, varied
from stickslip.workflows.scene_file.read import read, to_dict

FEW, SMALL = (2, 3), (6, 0)  # variations, and the seed of their order; of the few all are solved in a second
SEED = 0
COARSE = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25"]


@pytest.fixture(scope="module")
def blocks() -> list[Row]:
    return list(results(("block",), 3, SEED, jobs=1))


@pytest.mark.parametrize(("number", "seed"), [FEW, pytest.param(*SMALL, marks=pytest.mark.slow)])
def test_small_sibling_has_no_failure_and_no_wrong_answer(number: int, seed: int) -> None:
    rows = list(results(NAMES, number, seed, jobs=1, opinion=2.0))
    assert len(rows) == number
    assert not [f"{again(row)}: {row.verdict.reason}" for row in rows if row.verdict.outcome in BAD]
    assert sum(row.verdict.outcome is Outcome.SOLVED for row in rows) >= number / 2


def test_the_scene_with_the_fewest_variations_has_25_at_least() -> None:
    random = np.random.default_rng(0)
    base = ready("sphere")  # an axisymmetric body without friction: fewest apply
    assert sum(varied(base, one.change, random) is not None for one in FIXED.values()) >= 25


@pytest.mark.parametrize("scene", ["block", "arch", "shrink_fit"])
@pytest.mark.parametrize(
    "name", ["mu x 1000", "friction none", "one big step", "reversed", "force x 1e-12", "random 1"]
)
def test_set_makes_the_same_scene(scene: str, name: str) -> None:
    found = varied(ready(scene), variation(name).change, np.random.default_rng(0))
    assert found is not None
    words = overrides(to_dict(read(scene)), found)
    assert to_dict(read(scene, words)) == to_dict(scene_of(found))


def test_only_what_was_not_solved_is_judged_again(
    blocks: list[Row], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    monkeypatch.setattr("stickslip.solvers.simulation.unresisted_modes.least_springs", lambda scene: 0.0)
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
