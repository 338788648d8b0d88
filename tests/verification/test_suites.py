"""The suites of the command verify pass their small siblings, and their judges see what is wrong."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shared.failures import failures
from stickslip import FrictionLaw, SceneError, SolverError, prepare
from stickslip.geometry.dolfinx_versions import CACHE
from stickslip.solvers import effects as registry
from stickslip.solvers.simulation.resolve import plan_rows
from stickslip.workflows.lab.verification import registry as module
from stickslip.workflows.lab.verification.accuracy.judge import (
    MESH,
    OF_PROBLEMS,
    TIME,
    TOTAL,
    Answer,
    Share,
    compare,
    endless,
    solve,
)
from stickslip.workflows.lab.verification.accuracy.judge import Case as Figure
from stickslip.workflows.lab.verification.accuracy.problems import PROBLEMS
from stickslip.workflows.lab.verification.accuracy.run import accuracy, line, passed
from stickslip.workflows.lab.verification.accuracy.run import write_page as write_accuracy_page
from stickslip.workflows.lab.verification.accuracy.suite import Study as Figures
from stickslip.workflows.lab.verification.accuracy.suite import in_steps
from stickslip.workflows.lab.verification.check import Check
from stickslip.workflows.lab.verification.effects.run import Found, effects, faults, write_page
from stickslip.workflows.lab.verification.effects.suite import (
    EFFECTS,
    LAWS,
    ROOT,
    SCENES,
    Absent,
    Study,
    Work,
    calls,
    studied,
    taken_out,
    work,
)
from stickslip.workflows.lab.verification.registry import Case, verify
from stickslip.workflows.scene_file.read import from_dict


def right(method: str) -> list[Check]:
    return [Check("right [m]", 1.0, 1.0, 0.0, relative=True)]


def test_a_problem_is_a_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(module, "CASES", {"zeros": Case(about="a right figure", checks=right)})
    assert verify(["zeros"])
    one, last = capsys.readouterr().out.splitlines()
    assert one.split()[0] == "zeros"
    assert one.split()[2] == "passed"
    assert last.endswith("checks passed")


def test_named_problem_is_solved_and_tabulated(capsys: pytest.CaptureFixture[str]) -> None:
    assert verify(["zeros"], every_row=True)
    printed = capsys.readouterr().out
    for word in ("no increment", "condensed-newton", "uzawa", "surface-uzawa", "deviation", "checks passed"):
        assert word in printed


def test_unknown_problem_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(SceneError, match=r"raus: no such verification problem; did you mean raous\?"):
        verify(["zeros", "raus"])


def test_one_wrong_figure_fails_the_whole(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def checks(method: str) -> list[Check]:
        return [*right(method), Check("wrong [m]", 1.0, 2.0, 0.1, relative=True)]

    monkeypatch.setattr(module, "CASES", {"wrong": Case(about="a wrong figure", checks=checks)})
    assert not verify([])
    printed = capsys.readouterr().out
    assert "3 of 6 checks failed" in printed  # with each of three methods
    assert "3 of 6 FAILED" in printed
    assert "wrong [m]" in printed
    assert "right [m]" not in printed


def test_problem_without_an_answer_fails_and_the_others_go_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def checks(method: str) -> list[Check]:
        raise SolverError("t = 1: not converged")

    monkeypatch.setattr(
        module, "CASES", {"stuck": Case(about="no answer", checks=checks), "right": Case(about="", checks=right)}
    )
    assert not verify([])
    printed = capsys.readouterr().out
    assert "not solved: t = 1: not converged" in printed
    assert "passed" in printed


def test_check_that_is_not_a_number_fails_and_no_check_is_no_success() -> None:
    assert not Check("force [N]", float("nan"), 0.0, 1.0, relative=False).passed
    missed = "force [N]: 2, expected 1; absolute deviation 1.0e+00, allowed 1.0e-01"
    assert failures([Check("force [N]", 2.0, 1.0, 0.1, relative=False)]) == [missed]
    with pytest.raises(ValueError, match="nothing was checked"):
        failures([])
    with pytest.raises(ValueError, match="cannot be relative"):
        Check("force [N]", 1.0, 0.0, 1.0, relative=True)


WORK = Work(
    forms=2,
    unknowns=10,
    rows=4,
    nonzeros=50,
    factorisations=1,
    condensed=4,
    volume_solves=3,
    error_solves=0,
    iterations=2,
    answer="a",
)
ABSENT = Absent(scene="held, 2D", with_it=WORK, without=WORK, calls=1000, asked=5, idle=10, seconds=1.0)
STUDY = Study(name="heat", absent=(ABSENT,), base="held, 2D", idle=0, before=WORK, after=replace(WORK, answer="b"))


def on(tables: dict[str, object]) -> set[str]:
    return {row.effect for row in plan_rows(from_dict(tables)) if row.on}


def names() -> set[str]:
    return {effect.name for effect in registry.EFFECTS}


def test_the_plan_says_what_each_effect_and_law_adds() -> None:
    of_laws = {"unilateral", "compliance", "bilateral", "tied"}  # the row of the law; contact has their words
    for name, part in EFFECTS.items():
        tables = {**SCENES[part.base], **part.calls}
        assert name in of_laws or {row.effect: row.adds for row in plan_rows(from_dict(tables))}[name]
    for name, part in LAWS.items():
        rows = {row.effect: row.adds for row in plan_rows(from_dict({**SCENES[part.base], **part.calls}))}
        assert rows["friction"].startswith(f"{name}: ")
        assert ("again until mu" in rows["friction"]) == (name in ("slip_dependent", "static_kinetic"))
        assert ("along its directions" in rows["friction"]) == name.startswith("orthotropic")


def test_every_effect_and_every_law_has_a_scene_that_calls_for_it() -> None:
    assert set(EFFECTS) == names()
    assert set(LAWS) == {law.law for law in FrictionLaw.kinds}
    for name, part in EFFECTS.items():
        assert on({**SCENES[part.base], **part.calls}) > on(SCENES[part.base]) - {"unilateral"}
        assert name not in on(SCENES[part.base])
    files = {file for part in (*EFFECTS.values(), *LAWS.values()) for file in part.serves}
    assert all((ROOT / file).is_file() for file in files)


@pytest.mark.parametrize(
    ("scene", "nth"),  # of the effects; each of them when there is time
    [("rubbing, 2D", 3), *(pytest.param(name, 1, marks=pytest.mark.slow) for name in ("rubbing, 2D", "held, 2D"))],
)
def test_a_scene_that_does_not_call_for_an_effect_pays_nothing_for_it(scene: str, nth: int) -> None:
    prepared = from_dict(SCENES[scene])
    (whole, _), every = work(prepared), names()
    off = every - on(SCENES[scene])
    assert len(off) > 10
    for name in sorted(off)[::nth]:
        with taken_out(name):
            assert names() == every - {name}
            assert work(prepared)[0] == whole
        assert names() == every


@pytest.mark.slow
@pytest.mark.parametrize("name", [*EFFECTS, *(f"friction.{law}" for law in LAWS)])
def test_the_whole_suite(name: str) -> None:
    study = studied(name, repeats=0)
    assert name.startswith("friction.") or study.absent
    assert not faults(Found(studies=[study], noise=[1.0]))


def test_calls_do_not_depend_on_what_ran_before_or_runs_beside() -> None:
    scene = from_dict(SCENES["held, 2D"])
    first = calls(scene)
    kept = [prepare(scene) for _ in range(3)]  # meshes that live on
    os.utime(CACHE)  # as another process does that compiles a form
    assert calls(scene) == first
    assert len(kept) == 3


def test_the_judge_sees_what_an_effect_costs(tmp_path: Path) -> None:
    def fault(study: Study, smooth: Work | None = None) -> str:
        return "; ".join(faults(Found(studies=[study], noise=[1.0], smooth=smooth, rubbing=smooth and WORK)))

    costly = replace(ABSENT, without=replace(WORK, forms=1, answer="c"))
    assert not fault(STUDY)
    assert "which does not call for it, has another forms, answer" in fault(replace(STUDY, absent=(costly,)))
    assert "asks 400 calls" in fault(replace(STUDY, absent=(replace(ABSENT, asked=400),)))
    assert "has the answer of the one that does not" in fault(replace(STUDY, after=WORK))
    assert "Schur complement" in fault(STUDY, smooth=WORK)
    page = tmp_path / "effects.md"
    write_page(page, Found(studies=[STUDY], noise=[0.98, 1.01]), "stickslip verify effects")
    assert "| heat | held, 2D | 0 | 5 | 1.0 % | 1.00 |" in page.read_text()


def test_an_unknown_effect_is_refused() -> None:
    with pytest.raises(SceneError, match=r"--scenes sprigs: no such effect or law; did you mean springs"):
        effects(["sprigs"])


NAME = "contacts.base.normal_force"


def case(
    stated: float | None,
    true: float = 1.0,
    scale: float = 10.0,
    order: int = 1,
    problem: str = "block",
    part: str = TOTAL,
) -> Figure:
    return Figure(
        problem=problem, order=order, mesh=1.5, time=1.0, name=NAME, part=part, stated=stated, true=true, scale=scale
    )


def test_shares_count_what_is_stated_and_large_enough() -> None:
    share = Share.of([case(1.0), case(0.4), case(20.0), case(None), case(1.0, true=1e-3)])
    assert (share.counted, share.above) == (3, 1)
    assert (share.inside, share.below) == (pytest.approx(1 / 3), pytest.approx(1 / 3))
    assert not share.meets(OF_PROBLEMS)


@pytest.mark.parametrize(("wrong", "expected"), [(0, True), (1, True), (3, False)])
def test_a_suite_passes_with_nine_in_ten(wrong: int, expected: bool) -> None:
    cases = (case(1.0),) * (20 - wrong) + (case(0.6),) * wrong
    assert passed([Figures(problem="block", cases=cases)]) is expected
    assert not passed([Figures(problem="block", cases=cases, failure="no")])


def test_an_estimator_that_states_nothing_does_not_pass() -> None:
    """True errors of 30 % of the scale, and not a word of them."""
    silent = Figures(problem="block", cases=(case(None, true=3.0),) * 50)
    assert not Share.of(silent.cases).meets(OF_PROBLEMS)
    assert not passed([silent])
    assert "none of 50 errors is stated" in line(silent)
    assert passed([Figures(problem="block", cases=(case(None, true=1e-3),) * 50)])  # too small to count


@pytest.mark.parametrize(("silent", "expected"), [(0, True), (10, True), (12, False)])
def test_one_in_ten_may_be_left_unstated(silent: int, expected: bool) -> None:
    cases = (case(1.0),) * (100 - silent) + (case(None),) * silent
    assert passed([Figures(problem="block", cases=cases)]) is expected


@pytest.mark.parametrize("where", [{"problem": "cube"}, {"part": MESH}])
def test_something_is_stated_in_each_problem_and_part(where: dict[str, str]) -> None:
    mute = case(None, **where)
    studies = [Figures(problem="block", cases=(case(1.0),) * 100)]
    assert passed(studies)
    assert not passed([*studies, Figures(problem=mute.problem, cases=(mute,))])


def test_the_page_says_how_much_finer_the_truth_is(tmp_path: Path) -> None:
    write_accuracy_page(tmp_path / "accuracy.md", [Figures(problem="block", cases=(case(1.0),))], {})
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
    for doubt, counts in ((0.04, 0), (0.01, 1)):  # how far the truth itself may be off
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
    (row,) = (json.loads(row) for row in (tmp_path / "accuracy.jsonl").read_text().splitlines())
    assert {case["part"] for case in row["cases"]} >= {MESH, TIME, TOTAL}


def test_total_errors_of_a_block_against_a_finer_mesh_in_more_steps() -> None:
    problem = PROBLEMS["block"]
    run = solve(problem.meshed(1, 2.25))
    best = solve(in_steps(problem.meshed(2, 0.75), 4), errors=False, sharp=run.times).at(run.times)
    share = Share.of(compare("block", 1, 2.25, TOTAL, run, best))
    assert share.counted > 5
    assert share.meets(OF_PROBLEMS)


def test_unknown_problems_are_refused() -> None:
    with pytest.raises(SceneError, match="--scenes blok: no such problem"):
        accuracy(["blok"])


def test_the_page_tells_shares_and_the_worst_cases(tmp_path: Path) -> None:
    cases = (case(1.0), case(0.1), case(2.0, order=2))
    write_accuracy_page(tmp_path / "accuracy.md", [Figures(problem="block", cases=cases, unknowns=(10, 20))], {})
    page = (tmp_path / "accuracy.md").read_text()
    assert "| total, order 1 | 2 | 50.0 % | 50.0 % |" in page
    assert "stated / true 0.10" in page
    assert "stickslip run block --set=" in page
