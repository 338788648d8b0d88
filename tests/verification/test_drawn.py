"""Scenes that are drawn at random to judge stated errors: what is drawn, how well its truth is known, what is told."""

import re
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from shared.cases import slow
from stickslip import SceneError, StepError, read
from stickslip.geometry.mesh.mesh import write_msh
from stickslip.solvers.simulation.resolve import resolve
from stickslip.workflows.lab.verification.accuracy.drawn import RUN, SECOND, TRUTH, draw, drawn, of_file, written
from stickslip.workflows.lab.verification.accuracy.families import FAMILIES
from stickslip.workflows.lab.verification.accuracy.judge import (
    MESH,
    TOTAL,
    Answer,
    Case,
    Share,
    compare,
    quantity,
    solve,
)
from stickslip.workflows.lab.verification.accuracy.run import drawn_tables, random_accuracy, well_drawn, worst_scene
from stickslip.workflows.lab.verification.accuracy.suite import Study, studies
from stickslip.workflows.scene_file.read import READY, to_dict

SEED = 100
IN_FILES = ("mesh_file", "rounded", "pressed_hub", "hub_3d")  # families whose shapes gmsh reads or meshes


def test_a_seed_tells_its_scenes() -> None:
    first, again, other = ([*islice(drawn(seed), len(FAMILIES))] for seed in (SEED, SEED, SEED + 1))
    assert first == again
    assert {scene.name.partition("_")[2] for scene in first} == set(FAMILIES)
    assert [scene.name for scene in first] != [scene.name for scene in other]
    orders = [scene.order for seed in range(SEED, SEED + 4) for scene in islice(drawn(seed), len(FAMILIES))]
    assert 0.5 < np.mean(np.array(orders) == 1) < 0.7


@pytest.mark.parametrize("family", [*(name for name in FAMILIES if name not in IN_FILES), *slow(*IN_FILES)])
def test_each_family_draws_scenes_that_can_be_read(family: str, tmp_path: Path) -> None:
    for index in range(3 if family in IN_FILES else 12):
        scene = draw(family, SEED, index)
        files = scene.files(tmp_path / scene.name)
        run, truth, second = (read(files[key]) for key in (RUN, TRUTH, SECOND))
        resolve(run)
        assert run.output.error
        assert not truth.output.error
        assert truth.geometry.order == second.geometry.order == 2
        assert truth.steps.count == 2 * second.steps.count == 16 * run.steps.count
        assert truth.geometry.mesh_size < second.geometry.mesh_size
        assert second.geometry.mesh_size < (run.geometry.mesh_size if not scene.member.meshed else np.inf)


def answer(value: float, endless: float = 0.0) -> Answer:
    name = "contacts.base.max_pressure"
    column = {name: np.array([value])}
    return Answer(
        times=np.ones(1),
        values=column,
        stated={TOTAL: {name: np.array([0.1])}},
        endless={name: np.array([endless])},
        scales={name: np.ones(1)},
        unknowns=1,
    )


@pytest.mark.parametrize(("doubt", "counted", "silent"), [(0.01, 0, 1), (0.03, 0, 0)])
def test_a_known_number_that_is_said_to_have_no_limit_is_not_stated(doubt: float, counted: int, silent: int) -> None:
    doubts = {"contacts.base.max_pressure": np.array([doubt])}  # the error is .1
    share = Share.of(compare("block", 1, 1.0, TOTAL, answer(1.0, endless=1.0), answer(0.9), doubts))
    assert (share.counted, share.silent) == (counted, silent)
    stated = [*compare("block", 1, 1.0, TOTAL, answer(1.0), answer(0.9), doubts)]
    assert [case.known for case in stated] == [doubt == 0.01]


def test_names_of_pairs_hold_dots() -> None:
    assert quantity("contacts.any.hub.shaft.force.x") == ("contacts", "any.hub.shaft", "force")


def test_files_of_scenes_are_judged_like_drawn_ones(tmp_path: Path) -> None:
    scene = of_file(READY / "block.toml")
    files = scene.files(tmp_path)
    run, truth = (read(files[key]) for key in (RUN, TRUTH))
    assert (scene.name, scene.order, run.output.error, truth.output.error) == ("block", 1, True, False)
    assert truth.geometry.mesh_size == pytest.approx(run.geometry.mesh_size / 8)
    mesh = tmp_path / "fixed.msh"
    write_msh(run.geometry, run.request(), mesh)
    (tmp_path / "fixed.toml").write_text(written(to_dict(run) | {"geometry": {"file": str(mesh)}}))
    with pytest.raises(SceneError, match=r"fixed\.toml: geometry\.mesh_size"):
        of_file(tmp_path / "fixed.toml")


def test_a_budget_is_one_in_seconds_of_the_run() -> None:
    scene = read("block", ["geometry.mesh_size=0.25", "geometry.contact_mesh_size=0.25", "steps.count=1"])
    forces = [solve(scene, budget=budget).stated[MESH]["contacts.base.normal_force"] for budget in (1e-6, 1e6)]
    assert [np.isnan(force).all() for force in forces] == [True, False]


def study(effectivity: float, order: int = 1, number: int = 100, known: bool = True, problem: str = "block") -> Study:
    case = Case(
        problem=problem, order=order, mesh=1.0, time=1.0, name="contacts.base.force.x", part=TOTAL, known=known,
        stated=None if np.isnan(effectivity) else effectivity, true=1.0, scale=10.0,
    )  # fmt: skip
    return Study(problem=problem, cases=(case,) * number, price=0.5)


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (study(1.0), True),
        (study(0.6, number=9), True),
        (study(0.6, number=12), False),
        (study(0.4, number=5), False),
        (study(0.6, 2, number=5), False),  # of order 2 none is of the right size
        (study(20.0, number=2), False),
        (study(np.nan, number=4), False),
        (study(1.0, number=20, known=False), False),
        (study(0.6, number=20, problem="cube"), False),
    ],
)
def test_what_is_asked_of_drawn_scenes(more: Study, expected: bool) -> None:
    assert well_drawn([study(1.0), more]) is expected


def test_the_tables_name_the_worst_scene_and_what_was_drawn_again() -> None:
    found = [study(1.0), study(0.6, number=20, problem="cube"), Study(problem="ring", failure="no answer")]
    assert worst_scene(found).problem == "cube"
    told = drawn_tables(found)
    assert "2 scenes; drawn again: ring (no answer)" in told
    assert "worst scene of 20 numbers or more is cube: 20 errors count" in told
    assert "cost 0.5 times" in told
    assert "| cube, order 1 (0.5) | 20 | 0.0 % |" in told


def ends(task: str) -> Study:
    if task == "dies":
        while True:
            pass
    raise StepError(1.0, "no answer", (), None)


@pytest.mark.slow
def test_scenes_without_an_answer_are_told() -> None:
    refused, died = studies(ends, ["refused", "dies"], 2, limit=4)
    assert (refused.problem, refused.failure) == ("refused", "t = 1: no answer")
    assert (died.problem, died.failure) == ("dies", "no end after 4 s of the processor's time")


@pytest.mark.slow
def test_two_scenes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random_accuracy(2, SEED, 2, tmp_path)
    told = capsys.readouterr().out
    assert "2 scenes; drawn again: none." in told
    first = next(drawn(SEED))
    assert read(tmp_path / f"seed_{SEED}" / first.name / "run.toml").steps.count > 0
    page = (tmp_path / "accuracy.md").read_text()
    assert re.search(rf"\| {SEED} \| \d+ \|", page)
    assert f"{SEED}/{first.name}" in page


@pytest.mark.parametrize(("number", "seed", "said"), [(0, 1, "--number"), (1, -1, "--seed")])
def test_options_out_of_range_are_refused(number: int, seed: int, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        random_accuracy(number, seed)
    with pytest.raises(SceneError, match="--budget"):
        random_accuracy(1, 1, budget=0.0)


def test_orders_are_judged_apart() -> None:
    assert well_drawn([study(1.0), study(0.6, 2, number=14), replace(study(1.0, 2), problem="ring")])
