"""Methods side by side: they climb over the same meshes, and their work stands in one table, sentence and picture."""

from pathlib import Path
from typing import Any

import pytest

from stickslip.geometry.errors import SceneError
from stickslip.workflows.cost.ladder import Budget, Ladder, climb, ladder_of
from stickslip.workflows.cost.pictures import draw_methods
from stickslip.workflows.cost.progress import Teller
from stickslip.workflows.cost.run_record import PHASES, Run, Rung
from stickslip.workflows.cost.tables import comparison, lines, plain
from stickslip.workflows.scene_file.read import read

TIGHT = 1e-8
BOTH = ("newton", "uzawa")


def made_up(rung: Rung, seconds: float = 1.0, solves: int = 8, **more: Any) -> Run:
    phases = dict.fromkeys(PHASES, 0.0) | {"iterate": seconds}
    told = {"status": "converged", "h": 0.1 * rung.factor, "spent": seconds + 1.0, "memory": 1e8, "residual": 1e-9}
    return Run(rung=rung, phases=phases, volume_solves=solves, **(told | more))


def rung(method: str, level: int = 0, order: int = 1, tolerance: float = TIGHT) -> Rung:
    return Rung(order, method, level, tolerance)  # type: ignore[arg-type]


def climbed(ladder: Ladder, slow: float, seconds: float = 200.0) -> list[Run]:
    """Runs by a solver whose `uzawa` takes so many times as long as its `newton`."""
    runs: list[Run] = []

    def solve(each: Rung, left: float) -> Run:
        return made_up(each, 0.3 * each.factor**-2 * (slow if each.method == "uzawa" else 1.0))

    climb(ladder, runs, Budget(seconds=seconds, memory=1e12, dim=2), solve, lambda run: None)
    return runs


def levels(runs: list[Run], method: str) -> list[int]:
    return [run.rung.level for run in runs if run.rung.method == method and run.rung.tolerance == TIGHT]


@pytest.mark.parametrize("slow", [1.0, 7.0, 40.0])
def test_methods_side_by_side_are_on_the_same_meshes(slow: float) -> None:
    runs = climbed(Ladder((1,), BOTH, TIGHT, together=True), slow)
    quick, late = levels(runs, "newton"), levels(runs, "uzawa")
    assert len(late) >= 3
    assert late == quick[: len(late)]  # the slow one is the first that no longer fits
    for line in lines(runs, BOTH, TIGHT)[: len(late)]:
        assert all(line.runs)


def test_without_the_option_every_method_climbs_by_itself() -> None:
    """Its strides are its own: a slow method leaves no coarse mesh out, a fast one does."""
    runs = climbed(Ladder((1,), BOTH, TIGHT), 7.0)
    assert levels(runs, "uzawa")[:4] != levels(runs, "newton")[:4]


def test_no_method_waits_for_one_that_does_not_fit_any_more() -> None:
    runs = climbed(Ladder((1,), BOTH, TIGHT, together=True), 40.0)
    assert len(levels(runs, "newton")) > len(levels(runs, "uzawa"))


def test_a_mesh_is_finished_before_the_next_one() -> None:
    order = [run.rung.level for run in climbed(Ladder((1, 2), BOTH, TIGHT, together=True), 7.0, 60.0)]
    fitting = order[: order.index(max(order))]
    assert fitting == sorted(fitting)


def test_named_methods_are_taken_whatever_the_scene_names() -> None:
    scene = read("block", ["solver.method=surface-uzawa"])
    ladder, _ = ladder_of(scene, ["block-uzawa", "condensed-newton", "block-uzawa"])
    assert (ladder.methods, ladder.together) == (("block-uzawa", "condensed-newton"), True)
    alone, _ = ladder_of(scene)
    assert (alone.methods, alone.together) == (("surface-uzawa",), False)
    contending, _ = ladder_of(read("block"))
    assert "block-uzawa" not in contending.methods


def test_a_wrong_name_or_a_method_that_cannot_solve_the_scene_is_refused() -> None:
    with pytest.raises(SceneError, match=r"^--methods block-uzava: no such method; did you mean block-uzawa\?$"):
        ladder_of(read("block"), ["uzawa", "block-uzava"])
    with pytest.raises(SceneError, match=r"^--methods regularised: .*works with rigid obstacles only"):
        ladder_of(read("cylinders"), ["condensed-newton", "regularised"])


def test_one_method_is_laid_beside_itself_with_other_keys() -> None:
    inexact = "block-uzawa+preconditioner=mass+inner_solves=inexact+inner_tolerance=0.1"
    ladder, _ = ladder_of(read("block"), ["block-uzawa", inexact])
    assert ladder.methods == ("block-uzawa", inexact)
    plain, varied = (Rung(1, method, 0, 1e-6).scene(read("block")).solver for method in ladder.methods)
    assert (plain.method, plain.preconditioner, plain.tolerance) == ("block-uzawa", "gram", 1e-6)
    assert (varied.method, varied.preconditioner, varied.tolerance) == ("block-uzawa", "mass", 1e-6)
    assert (varied.inner_solves, varied.inner_tolerance) == ("inexact", 0.1)
    assert Rung(1, inexact, 0, 1e-6).name != Rung(1, "block-uzawa", 0, 1e-6).name


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("block-uzawa+preconditioner=mas", 'preconditioner = "mas"'),
        ("block-uzawa+precondition=mass", "solver.precondition: unknown key"),
        ("uzawa+preconditioner=mass", "use block-uzawa"),
        ("uzawa+mass", "expected KEY=VALUE"),
    ],
)
def test_keys_of_a_method_are_checked(name: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        ladder_of(read("block"), ["condensed-newton", name])


def some_runs() -> list[Run]:
    """Level 0: both; level 2: uzawa fails; level 4: newton alone. A loose tolerance does not count."""
    return [
        made_up(rung("newton"), 0.5, 8),
        made_up(rung("uzawa"), 2.0, 240),
        made_up(rung("uzawa", tolerance=1e-2), 0.1, 5),
        made_up(rung("newton", 2), 1.0, 8),
        Run(rung=rung("uzawa", 2), status="out_of_time", h=0.05, spent=30.0),
        made_up(rung("newton", 4), 4.0, 8),
        made_up(rung("nsgs", 4), 1.0, 8),
    ]


def test_one_line_for_each_mesh_coarse_to_fine() -> None:
    found = lines(some_runs(), BOTH, TIGHT)
    assert [line.h for line in found] == pytest.approx([0.1, 0.05, 0.025])
    assert [tuple(run and run.status for run in line.runs) for line in found] == [
        ("converged", "converged"),
        ("converged", "out_of_time"),
        ("converged", None),
    ]
    told = plain(found, BOTH)
    assert told[0]["methods"]["uzawa"]["volume_solves"] == 240
    assert told[0]["methods"]["uzawa"]["seconds"] == 2.0
    assert told[1]["methods"]["uzawa"] == {
        "status": "out_of_time", "seconds": None, "volume_solves": None, "linear_iterations": None, "dofs": None,
        "memory": None,
    }  # fmt: skip
    assert told[2]["methods"]["uzawa"] is None


def test_the_sentence_compares_on_the_finest_mesh_that_all_have_solved() -> None:
    assert comparison(lines(some_runs(), BOTH, TIGHT), BOTH) == (
        "On the finest mesh that all solved (order 1, h = 0.1) newton takes 0.5 s and 8 volume solves; "
        "uzawa 4 times the seconds, 30 times the volume solves."
    )
    turned = tuple(reversed(BOTH))
    assert comparison(lines(some_runs(), turned, TIGHT), turned).startswith("On the finest mesh that all solved (order")
    assert comparison(lines(some_runs(), ("newton",), TIGHT), ("newton",)) == ""
    assert comparison(lines(some_runs()[3:], BOTH, TIGHT), BOTH) == ""


def test_table_and_picture_show_every_method(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = lines(some_runs(), BOTH, TIGHT)
    Teller(60.0, quiet=False).methods(found, BOTH)
    out = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in out.splitlines() if line.startswith("│")]
    assert rows[:2] == [["1", "0.1", "newton", "0.5", "8"], ["", "", "uzawa", "2", "240"]]
    assert rows[3] == ["", "", "uzawa", "out of time", "-"]
    Teller(60.0, quiet=True).methods(found, BOTH)
    assert not capsys.readouterr().out
    assert draw_methods(tmp_path, "a scene", found, BOTH, "said").read_bytes().startswith(b"\x89PNG")
