"""The accuracy suite: its judges see what is wrong, and a small sibling passes."""

import json
from pathlib import Path

import numpy as np
import pytest

from stickslip.geometry.errors import SceneError
from stickslip.workflows.lab.verification.accuracy.answer import MESH, TIME, TOTAL, Answer, solve
from stickslip.workflows.lab.verification.accuracy.judge import Case, Share, compare, endless
from stickslip.workflows.lab.verification.accuracy.page import line, passed, write_page
from stickslip.workflows.lab.verification.accuracy.problems import PROBLEMS
from stickslip.workflows.lab.verification.accuracy.run import accuracy
from stickslip.workflows.lab.verification.accuracy.suite import Study, in_steps

NAME = "contacts.base.normal_force"


def case(
    stated: float | None,
    true: float = 1.0,
    scale: float = 10.0,
    order: int = 1,
    problem: str = "block",
    part: str = TOTAL,
) -> Case:
    return Case(
        problem=problem,
        order=order,
        mesh=1.5,
        time=1.0,
        name=NAME,
        part=part,
        stated=stated,
        true=true,
        scale=scale,
    )


def test_shares_count_what_is_stated_and_large_enough() -> None:
    share = Share.of([case(1.0), case(0.4), case(20.0), case(None), case(1.0, true=1e-3)])
    assert (share.counted, share.above) == (3, 1)
    assert (share.inside, share.below) == (pytest.approx(1 / 3), pytest.approx(1 / 3))
    assert not share.enough


@pytest.mark.parametrize(("wrong", "expected"), [(0, True), (1, True), (3, False)])
def test_a_suite_passes_with_nine_in_ten(wrong: int, expected: bool) -> None:
    cases = (case(1.0),) * (20 - wrong) + (case(0.6),) * wrong
    assert passed([Study(problem="block", cases=cases)]) is expected
    assert not passed([Study(problem="block", cases=cases, failure="no")])


def test_an_estimator_that_states_nothing_does_not_pass() -> None:
    """True errors of 30 % of the scale, and not a word of them."""
    silent = Study(problem="block", cases=(case(None, true=3.0),) * 50)
    assert not Share.of(silent.cases).enough
    assert not passed([silent])
    assert "none of 50 errors is stated" in line(silent)
    assert passed([Study(problem="block", cases=(case(None, true=1e-3),) * 50)])  # too small to count


@pytest.mark.parametrize(("silent", "expected"), [(0, True), (10, True), (12, False)])
def test_one_in_ten_may_be_left_unstated(silent: int, expected: bool) -> None:
    cases = (case(1.0),) * (100 - silent) + (case(None),) * silent
    assert passed([Study(problem="block", cases=cases)]) is expected


@pytest.mark.parametrize("where", [{"problem": "cube"}, {"part": MESH}])
def test_something_is_stated_in_each_problem_and_part(where: dict[str, str]) -> None:
    mute = case(None, **where)  # type: ignore[arg-type]
    studies = [Study(problem="block", cases=(case(1.0),) * 100)]
    assert passed(studies)
    assert not passed([*studies, Study(problem=mute.problem, cases=(mute,))])


def test_the_page_says_how_much_finer_the_truth_is(tmp_path: Path) -> None:
    write_page(tmp_path / "accuracy.md", [Study(problem="block", cases=(case(1.0),))], "command")
    told = "order 2 on a mesh 2 to 3 times finer than the finest"
    asked_for = "at most 10 % of the true errors that are large enough to count not stated"
    for page in (tmp_path / "accuracy.md", Path(__file__).parents[2] / "docs/accuracy.md"):
        assert told in page.read_text()
        assert asked_for in page.read_text()
    assert {round(1 / problem.fine) for problem in PROBLEMS.values()} == {2, 3}


def test_the_same_number_under_two_names_counts_once() -> None:
    def answer(value: float) -> Answer:
        both = {NAME: np.array([value]), "supports.top.force.y": np.array([value])}
        stated = {part: {key: np.array([0.1]) for key in both} for part in (MESH, TIME, TOTAL)}
        scales = {key: np.ones(1) for key in both}
        zero = {key: np.zeros(1) for key in both}
        return Answer(times=np.ones(1), values=both, stated=stated, endless=zero, scales=scales, unknowns=1)

    found = list(compare("block", 1, 1.0, MESH, answer(1.0), answer(0.9)))
    assert len(found) == 1
    assert found[0].effectivity == pytest.approx(1.0)
    for doubt, counts in ((0.2, 0), (0.05, 1)):  # how far the truth itself may be off
        known = compare("block", 1, 1.0, MESH, answer(1.0), answer(0.9), {NAME: np.full(1, doubt)})
        assert Share.of(known).counted == counts


def test_a_pressure_that_slows_down_has_a_limit() -> None:
    h = np.array([4.0, 2.0, 1.0, 0.5])
    assert endless([np.array([a**-0.3, 1 + np.log(1 / a) / 9, 2 - a**2 / 32]) for a in h], h.tolist()).tolist() == [
        True,
        True,
        False,
    ]


def test_small_sibling(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert accuracy(["column"], folder=tmp_path)
    assert "100.0 %" in capsys.readouterr().out
    assert (tmp_path / "accuracy.png").stat().st_size > 10_000
    rows = [json.loads(row) for row in (tmp_path / "accuracy.jsonl").read_text().splitlines()]
    assert {row["part"] for row in rows if "part" in row} >= {MESH, TIME, TOTAL}


def test_total_errors_of_a_block_against_a_finer_mesh_in_more_steps() -> None:
    problem = PROBLEMS["block"]
    run = solve(problem.meshed(1, 2.25))
    best = solve(in_steps(problem.meshed(2, 0.75), 4), errors=False, sharp=True).at(run.times)
    share = Share.of(compare("block", 1, 2.25, TOTAL, run, best))
    assert share.counted > 5
    assert share.enough


def test_unknown_problems_are_refused() -> None:
    with pytest.raises(SceneError, match="--scenes blok: no such problem"):
        accuracy(["blok"])


def test_the_page_tells_shares_and_the_worst_cases(tmp_path: Path) -> None:
    cases = (case(1.0), case(0.1), case(2.0, order=2))
    write_page(tmp_path / "accuracy.md", [Study(problem="block", cases=cases, unknowns=(10, 20))], "command")
    page = (tmp_path / "accuracy.md").read_text()
    assert "| total, order 1 | 2 | 50.0 % | 50.0 % |" in page
    assert "stated / true 0.10" in page
    assert "stickslip run block --set=" in page
