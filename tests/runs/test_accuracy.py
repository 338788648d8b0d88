"""Runs to an accuracy and sweeps over keys."""

import fcntl
import json
import os
import re
import signal
import sys
import time as clock
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from shared.cases import slow
from shared.command import COARSE as COARSER
from shared.command import Call, assert_one_line, assert_said, ended, output_of, result, table
from shared.histories import Stop
from stickslip.geometry.errors import MachineError, SceneError
from stickslip.geometry.mesh.mesh import write_msh
from stickslip.geometry.user_files.child_process import Ended
from stickslip.workflows.commands._sweep import sweep_scene
from stickslip.workflows.formats.results import read_results
from stickslip.workflows.pictures.report_page import page
from stickslip.workflows.run.result import result_schema, scene_hash
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import READY, read, to_dict
from stickslip.workflows.sweep import child
from stickslip.workflows.sweep import sweep as module
from stickslip.workflows.sweep.child import Bench
from stickslip.workflows.sweep.sweep import Solved, members, sweep

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
def test_goals_without_errors_are_refused_in_a_line(goal: str, said: str, stickslip: Stickslip, tmp_path: Path) -> None:
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
        assert "of base.normal_force; geometry.mesh_size: there is none to refine, a mesh file has its own mesh" in said
        return
    assert code == 0, said
    assert "mine.msh: its cells are cut; curved sides stay the facets that they are" in said
    force = result(tmp_path / "out")["steps"][-1]["contacts"]["base"]["normal_force"]
    assert 0.2428 * 0.996 < force < 0.2428 * 1.004  # order 2, h = .0125


MU = "contacts.base.friction.mu"
SQUARE = """Point(1)={0,0,0,.5}; Point(2)={1,0,0,.5}; Point(3)={1,1,0,.5}; Point(4)={0,1,0,.5};
Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,4}; Line(4)={4,1}; Line Loop(1)={1,2,3,4};
Plane Surface(1)={1}; Physical Surface("part")={1}; Physical Line("part.base")={1}; Physical Line("part.top")={3};
"""
PART = """model = "plane strain"
geometry.file = "a.geo"
bodies.part = { E = 1.0, nu = 0.3 }
supports.base = { boundary = "part.base", displacement = { x = 0.0, y = 0.0 } }
supports.top = { boundary = "part.top", displacement = { y = -0.1 } }
output = { pictures = false, error = false }
"""
SETS = [word.removeprefix("--set=") for word in COARSER]


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tasks are solved in this process: to start another one takes longer than most members."""

    def solve(name: str, words: list[str], folder: Path | None, seconds: float) -> Ended:
        monkeypatch.setattr(sys, "argv", [name, *words, "0"])
        child.main()
        return Ended(code=0, printed="", full=False)

    monkeypatch.setattr(module, "run_child", solve)
    monkeypatch.setattr(child, "end_with", lambda parent: None)


def test_members_are_all_combinations_and_have_short_names() -> None:
    found = members(read("block", SETS), {MU: [0.1, 0.2], "bodies.block.E": np.array([1.0, 2.0]).tolist()})
    assert [m.name for m in found] == ["mu=0.1+E=1.0", "mu=0.1+E=2.0", "mu=0.2+E=1.0", "mu=0.2+E=2.0"]
    assert [m.scene.bodies["block"].E for m in found] == [1.0, 2.0, 1.0, 2.0]
    assert found[0].bodies == found[2].bodies != found[1].bodies
    alike = members(read("two_blocks"), {"bodies.lower.E": [1.0], "bodies.upper.E": [2.0]})
    assert alike[0].name == "lower.E=1.0+upper.E=2.0"
    odd = members(read("block"), {"supports.top.displacement.y": [[[0, 0], [1, -0.1]], [[0, 0], [1, -0.2]]]})
    assert len({m.name for m in odd}) == 2
    assert all(set(m.name) <= set("abcdefghijklmnopqrstuvwxyz0123456789.+=-_") for m in odd)


def test_keys_of_a_member_are_judged_together() -> None:
    """As those of `--set`: the scene's contact_mesh_size is larger than the new mesh_size."""
    sizes = {"geometry.mesh_size": 0.04, "geometry.contact_mesh_size": 0.02}
    for keys in (list(sizes), list(sizes)[::-1]):
        (member,) = members(read("block"), {key: [sizes[key]] for key in keys})
        assert member.scene == read("block", [f"{key}={value}" for key, value in sizes.items()])
    with pytest.raises(SceneError, match=r"contact_mesh_size = 0\.05: must not exceed mesh_size"):
        members(read("block"), {"geometry.mesh_size": [0.04]})


@pytest.mark.usefixtures("here")
def test_files_of_geometries_begin_at_the_scene_file(call: Call, folder: Path) -> None:
    """As those of `--set`."""
    (folder / "sub").mkdir()
    for name in ("a.geo", "b.geo"):
        (folder / "sub" / name).write_text(SQUARE)
    (folder / "sub" / "part.toml").write_text(PART)
    output_of(call("sweep", "sub/part.toml", 'geometry.file=["a.geo", "b.geo"]', "-q", "-o", "out"))
    assert sorted(path.name for path in (folder / "out").iterdir()) == ["file=a.geo", "file=b.geo", "sweep.csv"]


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ({}, "needs a key"),
        ({MU: []}, "expected a list of values"),
        ({MU: "0.1"}, "expected a list of values"),
        ({MU: [0.1, -1.0]}, "mu=-1.0: "),
        ({"contacts.base.friction.my": [0.1]}, "did you mean mu|nearest|mu"),
        ({MU: [0.1, 0.1]}, "stands there twice"),
        ({"steps.count": list(range(101)), MU: list(range(100))}, "10100 members"),
    ],
)
def test_wrong_sweep_is_refused_before_anything_is_solved(over: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=said):
        sweep(read("block", SETS), over, tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_goals_of_accuracy_are_refused_before_anything_is_solved(call: Call, folder: Path) -> None:
    """Each member is solved once: they would be ignored."""
    goals = '--set=accuracy.goals={"base.normal_force" = 0.1}'
    assert_said(
        call("sweep", "block", *COARSER, goals, f"{MU}=[0.2, 0.4]", "-o", "out"),
        2,
        "accuracy.goals: each member is solved once",
    )
    assert not list(folder.iterdir())


@pytest.mark.parametrize("text", ["x,y\n1,2\n", "", "status,folder\n", "mu,folder,status\n", "\0" * 10])
def test_table_that_no_sweep_has_written_is_refused_and_stays(text: str, call: Call, folder: Path) -> None:
    (folder / "out").mkdir()
    (folder / "out" / "sweep.csv").write_text(text)
    assert_said(
        call("sweep", "block", *COARSER, f"{MU}=[0.2]", "-o", "out"),
        2,
        "out/sweep.csv: is not the table of a sweep; move it away",
    )
    assert [path.name for path in (folder / "out").iterdir()] == ["sweep.csv"]
    assert (folder / "out" / "sweep.csv").read_text() == text


def test_two_sweeps_in_one_folder_lose_nothing(call: Call, folder: Path) -> None:
    """One at a time, and over the same keys: the table is one of all members."""
    words = ["sweep", "block", *COARSER, "-q", "-o", "out"]
    assert call(*words, f"{MU}=[0.2]") == (0, "", "")
    before = (folder / "out" / "sweep.csv").read_bytes()
    assert_said(call(*words, "steps.count=[2]"), 2, "out/sweep.csv: is the table of a sweep over other keys; choose")
    held = os.open(folder / "out", os.O_RDONLY)
    fcntl.flock(held, fcntl.LOCK_EX)
    assert_said(call(*words, f"{MU}=[0.2, 0.3]"), 2, "-o out: another sweep works there; choose another folder with -o")
    os.close(held)
    assert (folder / "out" / "sweep.csv").read_bytes() == before
    assert sorted(path.name for path in (folder / "out").iterdir()) == ["mu=0.2", "sweep.csv"]
    assert call(*words, f"{MU}=[0.2, 0.3]") == (0, "", "")


def test_a_large_sweep_says_how_far_it_is(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """While it checks its scenes, and of each member as it ends, not of a whole task."""
    heard = list[tuple[int, float]]()
    monkeypatch.setattr(module, "run_child", slow_child)
    monkeypatch.setattr(module, "PARTS", 1)  # one task
    over = {MU: [0.1, 0.2, 0.3]}
    solved = sweep(read("block", SETS), over, tmp_path, on_member=lambda n, *_: heard.append((n, ENDED[0])))
    assert heard == [(1, 1), (2, 2), (3, 3)]
    assert [one.status for one in solved.solved] == ["converged"] * 3
    many = [f"{MU}={[k / 1e4 for k in range(120)]}"]
    with pytest.raises(MachineError):
        sweep_scene(read("block", SETS), many, tmp_path, tmp_path / "out", 1, False)
    assert capsys.readouterr().out.splitlines()[:2] == [f"{n} of 120 members are checked" for n in (50, 100)]


ENDED = [0]  # members that the process below has told of


def slow_child(module: str, words: Sequence[str], folder: None, seconds: float) -> Ended:
    """Tell of one member after the other, and of more than a few of none."""
    order = json.loads(Path(words[0]).read_text())
    if len(order) > 3:
        raise MachineError("too many")
    for _ in order:
        ENDED[0] += 1
        with Path(words[1]).open("a") as answers:
            answers.write(json.dumps({"status": "converged", "sentence": "", "seconds": 1.0}) + "\n")
        clock.sleep(0.3)  # until the others have heard
    return Ended(code=0, printed="", full=False)


def test_bodies_are_prepared_once_and_answers_are_those_of_runs_alone(tmp_path: Path) -> None:
    bench, scenes = Bench(), [m.scene for m in members(read("block", SETS), {MU: [0.1, 0.3], "steps.count": [2, 3]})]
    for k, scene in enumerate(scenes):
        assert bench(to_dict(scene), tmp_path / str(k))["status"] == "converged"
        run(scene, tmp_path / f"alone{k}")
        together, alone = result(tmp_path / str(k)), result(tmp_path / f"alone{k}")
        assert together["steps"] == alone["steps"]
        assert together["counters"]["factorisations"] == (k == 0)
    stiff = members(read("block", SETS), {"bodies.block.nu": [0.2]})[0].scene
    bench(to_dict(stiff), tmp_path / "stiff")
    assert result(tmp_path / "stiff")["counters"]["factorisations"] == 1


def test_command_tells_each_member_and_solves_only_what_is_missing(
    call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "PARTS", 1)  # one process for both members
    words = ["sweep", "block", *COARSER, "-o", "out"]
    out = output_of(call(*words, f"{MU}=[0.2, 0.4]"))
    assert [line.split()[:2] for line in out.splitlines()][:2] == [["1/2", "mu=0.2:"], ["2/2", "mu=0.4:"]]
    assert re.search(r"mu +┃ contact ┃ +normal force \[N/m\]", out)
    assert re.search(r"│ 0\.4 │ base    │ +0\.2", out)
    rows = table(folder / "out" / "sweep.csv")
    assert [float(row[MU]) for row in rows] == [0.2, 0.4]
    last = result(folder / "out" / "mu=0.4")["steps"][-1]["contacts"]["base"]
    assert float(rows[1]["base.normal_force"]) == last["normal_force"]
    code, out, err = call(*words, f"{MU}=[0.2, 0.3, 0.4]", "--jobs", "2")
    assert (code, err, out.count("was solved before")) == (0, "", 2)
    assert [float(row[MU]) for row in table(folder / "out" / "sweep.csv")] == [0.2, 0.3, 0.4]
    assert call(*words, f"{MU}=[0.2, 0.4]", "-q")[1] == ""
    for wrong in (["mu"], [f"{MU}=0.2"], [f"{MU}=[0.2"], [f"{MU}=[0.2]", f"{MU}=[0.3]"], [f"{MU}=[0.2]", "--jobs=0"]):
        assert_said(call(*words, *wrong), 2)


@pytest.mark.usefixtures("here")
def test_member_that_fails_does_not_take_the_others_with_it(call: Call, folder: Path) -> None:
    words = ["sweep", "block", *COARSER, "solver.max_iterations=[1, 10000]", "--set=solver.method=uzawa", "-o", "out"]
    out, err = ended(call(*words), 3)
    assert "1 of 2 members are not solved, or doubtful: max_iterations=1" in err
    assert "max_iterations=1: not converged" in out
    assert [row["status"] for row in table(folder / "out" / "sweep.csv")] == ["not_converged", "converged"]


def test_members_that_are_all_refused_have_their_table(call: Call, folder: Path) -> None:
    """Nothing else makes the folder."""
    sets = ["--set=supports.top.displacement={x=0.1}", "--set=solver.method=uzawa"]
    out, err = ended(call("sweep", "block", *COARSER, *sets, 'solver.surface=["condensed"]', "-o", "sub/out"), 3)
    assert "1 of 1 members are not solved, or doubtful: surface=condensed" in err
    assert_one_line(err)
    assert "surface=condensed: failed" in out
    assert [path.name for path in (folder / "sub" / "out").iterdir()] == ["sweep.csv"]
    assert [row["status"] for row in table(folder / "sub" / "out" / "sweep.csv")] == ["failed"]


@pytest.mark.parametrize(("place", "code", "said"), [("file", 2, "is not a folder"), ("/proc/out", 4, "be written")])
def test_folder_that_cannot_be_is_known_before_anything_is_solved(
    place: str, code: int, said: str, call: Call, folder: Path
) -> None:
    (folder / "file").write_text("mine")
    spoken = call("sweep", "block", *COARSER, f"{MU}=[0.2]", "-o", place)
    assert spoken[:2] == (code, "")
    assert f"{place}: " in spoken[2]
    assert said in spoken[2]
    assert_one_line(spoken[2])
    assert [path.name for path in folder.iterdir()] == ["file"]


def test_member_whose_process_is_killed_is_told_others_go_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked = list[list[str]]()

    def child(name: str, words: list[str], folder: Path | None, seconds: float) -> Ended:
        task = json.loads(Path(words[0]).read_text())
        asked.append([Path(member["folder"]).name for member in task])
        killed = len(asked) == 1
        with Path(words[1]).open("a") as answers:
            for _ in task[: 1 if killed else None]:
                answers.write(json.dumps({"status": "converged", "sentence": "", "seconds": 0.0}) + "\n")
        return Ended(code=-signal.SIGKILL if killed else 0, printed="", full=killed)

    monkeypatch.setattr(module, "run_child", child)
    monkeypatch.setattr(module, "PARTS", 1)
    told = list[Solved]()
    done = sweep(read("block", SETS), {MU: [0.1, 0.2, 0.3]}, tmp_path, on_member=lambda *each: told.append(each[2]))
    assert asked == [["mu=0.1", "mu=0.2", "mu=0.3"], ["mu=0.3"]]
    assert [one.status for one in done.solved] == ["converged", "killed", "converged"]
    assert re.match(r"mu=0\.2: killed, -?[\d.]+ s: its process was ended by signal 9", str(done.solved[1]))
    assert done.solved[1].sentence == "its process was ended by signal 9; memory was full"
    assert [one.member.name for one in told] == ["mu=0.1", "mu=0.2", "mu=0.3"]
    assert repr(done) == f"Sweep({str(tmp_path / 'sweep.csv')!r}: 3 members, 2 converged, 1 killed)"
    assert len(repr(done.solved[0])) < 500  # no scene in it


@pytest.mark.parametrize(("E", "numbers"), [(2.0, False), (1.0, True)])
def test_row_of_a_killed_member_has_no_numbers_of_an_earlier_scene(
    E: float, numbers: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Of its own scene it has those of the run that was stopped before."""
    over = {"steps.count": [2]}
    (before,) = members(read("block", [*SETS, f"bodies.block.E={E}"]), over)
    assert run(before.scene, tmp_path / before.name, Watch(on_step=Stop(1)))[0].status == "interrupted"
    monkeypatch.setattr(module, "run_child", lambda *rest: Ended(code=-signal.SIGKILL, printed="", full=False))
    done = sweep(read("block", [*SETS, "bodies.block.E=1.0"]), over, tmp_path)
    assert done.solved[0].status == "killed"
    assert ("base.normal_force" in done.rows[0]) == numbers
    assert table(done.path)[0]["status"] == "killed"


def test_members_named_like_former_results_keep_their_own(tmp_path: Path) -> None:
    """As mu = 0 and mu = 0.1; also where the sweep is repeated with another scene."""
    for E in (1.0, 2.0):
        bench, both = Bench(), members(read("block", [*SETS, f"bodies.block.E={E}"]), {MU: [0.1, 0]})
        for member in both:
            assert bench(to_dict(member.scene), tmp_path / member.name)["status"] == "converged"
        for member in both:
            assert result(tmp_path / member.name)["scene"]["hash"] == scene_hash(member.scene)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mu=0", "mu=0.1", "mu=0.1~1", "mu=0~1"]
    assert result(tmp_path / "mu=0~1")["scene"]["bodies"]["block"]["E"] == 1.0


@pytest.mark.usefixtures("here")
def test_table_goes_to_pandas_where_it_is_installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    done = sweep(read("block", SETS), {MU: [0.4]}, tmp_path)
    assert done.rows[0]["base.normal_force"] > 0
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=lambda rows: ("a table of", rows)))
    assert done.to_pandas() == ("a table of", done.rows)
