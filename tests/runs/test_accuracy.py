"""`stickslip run --accuracy`: rounds that reach what is asked, budgets that do not suffice, goals without an error."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from shared.cases import slow
from shared.command import Call, result
from stickslip.geometry.mesh.mesh import write_msh
from stickslip.workflows.formats.results import read_results
from stickslip.workflows.pictures.report_page import page
from stickslip.workflows.run.result import result_schema
from stickslip.workflows.scene_file.read import READY, read

COARSE = ["--set=geometry.mesh_size=0.5", "--set=geometry.contact_mesh_size=0.5", "--set=output.pictures=false"]


Stickslip = Callable[..., tuple[int, str]]


@pytest.fixture
def stickslip(call: Call) -> Stickslip:
    """Exit code of a run, and all that it says, on one line."""

    def act(*words: str) -> tuple[int, str]:
        code, out, err = call("run", *words)
        return code, " ".join((out + err).split())

    return act


def test_rounds_reach_what_is_asked(stickslip: Stickslip, tmp_path: Path) -> None:
    goals = ["--accuracy", "base.normal_force=0.2%", "--accuracy=base.dissipation_total=20%", "--set=geometry.order=2"]
    code, said = stickslip("block", *COARSE, *goals, "-o", str(tmp_path / "out"))
    assert code == 0, said
    assert "rounds begin with order 1, in place of geometry.order = 2" in said
    content = result(tmp_path / "out")
    assert f"Refined in {len(content['accuracy']['rounds'])} rounds" in page(read_results(tmp_path / "out"))
    force = content["steps"][-1]["contacts"]["base"]
    assert force["error"]["normal_force"]["total"] <= 0.002 * force["normal_force"]
    assert force["error"]["dissipation_total"]["total"] <= 0.2 * force["dissipation_total"]
    rounds = content["accuracy"]["rounds"]
    assert content["accuracy"]["met"]
    assert len(rounds) > 1
    assert f"round {len(rounds)}:" in said
    assert rounds[0]["goals"]["base.normal_force"]["error"] > 0.002
    assert 0.2428 * 0.996 < force["normal_force"] < 0.2428 * 1.004  # order 2, h = .0125
    assert not (tmp_path / ".out.running").exists()


@pytest.mark.parametrize(
    ("goal", "takes"),
    [
        ("0.0001", "longer than can be told; --resume"),
        pytest.param("0.1", r"about \d+ s; --resume", marks=pytest.mark.slow),
    ],
)
def test_a_budget_that_does_not_suffice_is_said(goal: str, takes: str, stickslip: Stickslip, tmp_path: Path) -> None:
    words = [f"--accuracy=base.normal_force={goal}%", "--budget=0.01", "-o", str(tmp_path / "out")]
    code, said = stickslip("block", *COARSE, *words)
    assert code == 3
    assert re.search(f"of base.normal_force, {goal} % would take {takes}", said)
    content = result(tmp_path / "out")
    assert not content["accuracy"]["met"]
    assert (content["status"], content["sentence"] in said) == ("inaccurate", True)
    Draft202012Validator(result_schema()).validate(content)


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        ("base.max_pressure=1%", "grows without end"),
        ("base.nothing=1%", "no such quantity"),
        ("base.max_penetration=1%", "is 0 at the end"),
    ],
)
def test_goals_without_an_error_are_refused_in_one_line(
    goal: str, said: str, stickslip: Stickslip, tmp_path: Path
) -> None:
    code, output = stickslip("block", *COARSE, f"--accuracy={goal}", "-o", str(tmp_path / "out"), "-q")
    assert code == 2
    assert said in output
    assert not (tmp_path / "out").exists()
    assert not (tmp_path / ".out.running").exists()


def test_grids_are_refined_as_a_whole(stickslip: Stickslip, tmp_path: Path) -> None:
    words = ["--set=geometry.mesh_size=0.5", "--set=output.pictures=false", "--accuracy=base.normal_force=1%"]
    code, said = stickslip("cube", *words, "-o", str(tmp_path / "out"))
    assert code == 0, said
    assert result(tmp_path / "out")["accuracy"]["rounds"][-1]["unknowns"] > 200


@pytest.mark.parametrize("cells", ["simplex", *slow("tensor")])  # as the grid above
def test_the_cells_of_a_mesh_of_ones_own_are_cut(cells: str, stickslip: Stickslip, tmp_path: Path) -> None:
    scene = read("block", ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5", f"geometry.cells={cells!r}"])
    write_msh(scene.geometry, scene.request(), tmp_path / "mine.msh")
    text = (READY / "block.toml").read_text()
    head, _, rest = text.partition("[geometry]")
    (tmp_path / "mine.toml").write_text(f'{head}[geometry]\nfile = "mine.msh"\n{rest[rest.index("[bodies") :]}')
    words = ["--accuracy=base.normal_force=0.2%", "--set=output.pictures=false", "-o", str(tmp_path / "out")]
    code, said = stickslip(str(tmp_path / "mine.toml"), *words)
    if cells == "tensor":
        assert code == 3
        assert "of base.normal_force; geometry.mesh_size: there is none to refine, a .msh file has its own mesh" in said
        return
    assert code == 0, said
    assert "mine.msh: its cells are cut; curved sides stay the facets that they are" in said
    force = result(tmp_path / "out")["steps"][-1]["contacts"]["base"]["normal_force"]
    assert 0.2428 * 0.996 < force < 0.2428 * 1.004  # order 2, h = .0125
