"""The commands that say what an accuracy and a mesh cost in seconds and memory."""

import json
import os
import signal
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import stickslip.solvers.simulation.simulation as simulation
import stickslip.workflows.cost.command
import stickslip.workflows.cost.study_folder
from shared.command import Call, assert_said, ended, output_of, result, table
from shared.processes import children, running, wait_for, words_of
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.simulation.memory import Counts, Demand
from stickslip.solvers.stepping.choice import Choice, Size
from stickslip.workflows.cost.measure import solve
from stickslip.workflows.cost.run_record import Run, Rung, mesh_size

SCENE = ["cost", "block", "-o", "out", "--set=geometry.mesh_size=1.0", "--set=solver.method=condensed-newton"]
CHILD = b"stickslip.workflows.cost.measure"
SMALL = [*SCENE, "--set=geometry.contact_mesh_size=0.5"]
PLAIN = [*SMALL, "--set=output.pictures=false"]


def content(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "cost.json").read_text())
    return found


def quick(scene: Scene, rung: Rung, seconds: float) -> Run:
    """A solver of a known price: h^-2, h^order."""
    price = 0.5 * rung.order * rung.factor**-2
    force = 3.0 * (1 + 0.05 * rung.factor**rung.order)
    phases = dict.fromkeys(("mesh", "assemble", "prepare", "output"), 0.0) | {"iterate": price}
    numbers = {"base.max_pressure": 2 * force, "base.normal_force": force, "base.tangential_force": 0.0}
    return Run(
        rung=rung, status="converged", spent=price + 1.0, h=0.5 * rung.factor, phases=phases, residual=1e-9,
        cpu=price, memory=1e8, quantities=numbers,
    )  # fmt: skip


@pytest.mark.slow
def test_two_meshes_are_compared_and_told(call: Call, folder: Path) -> None:
    """Level -4 of a 4 x 2 block is two cells: whatever the machine, two meshes of it fit."""
    words = [*SMALL, "--quantity", "base.normal_force", "--quantity", "energy.stored"]
    for budget in ("4", "8", "16", "32", "64"):  # a busy machine: starting a process takes longer than all the runs
        more = ["--resume"] if (folder / "out").exists() else []
        code, out, err = call(*words, "--budget", budget, *more)
        if code != 3:
            break
    assert code == 0, err
    done = content(folder / "out")
    said = out.strip().splitlines()[-2:]
    assert said == [done["quantities"][name]["sentence"] for name in ("base.normal_force", "energy.stored")]
    assert done["sentence"] == said[0]
    assert set(done["quantities"]) == {"base.normal_force", "energy.stored"}
    rows = table(folder / "out" / "cost.csv")
    assert len(rows) == len(done["runs"]) == len(list((folder / "out" / "runs").iterdir()))
    converged = [row for row in rows if row["status"] == "converged"]
    assert len({row["h"] for row in converged}) >= 2
    assert {row["method"] for row in rows} == {"condensed-newton"}
    for row in converged:
        phases = sum(float(row[f"{phase}_s"]) for phase in ("mesh", "assemble", "prepare", "iterate", "output"))
        assert float(row["seconds"]) == pytest.approx(phases)
        assert 1e7 < float(row["peak_memory_bytes"]) < 1e10
        assert int(row["dofs"]) > 0
        assert int(row["volume_solves"]) > 0
    # the same number as `run` gives, from the scene with the cells of that row
    row = converged[0]
    factor = float(row["cells_times"])
    sizes = [f"--set=geometry.mesh_size={factor}", f"--set=geometry.contact_mesh_size={factor / 2}"]
    words = [f"--set=geometry.order={row['order']}", "--set=output.pictures=false", *sizes]
    assert call("run", "block", "-q", "-o", "once", *words)[0] == 0
    last = result(folder / "once")["steps"][-1]
    assert float(row["base.normal_force"]) == pytest.approx(last["contacts"]["base"]["normal_force"], rel=1e-9)
    assert float(row["energy.stored"]) == pytest.approx(last["energy"]["stored"], rel=1e-9)
    for name in ("cost_base_normal_force.png", "cost_energy_stored.png"):
        assert (folder / "out" / name).read_bytes().startswith(b"\x89PNG")


def test_ctrl_c_keeps_the_finished_runs_and_resume_makes_none_of_them_again(
    folder: Path, command: list[str], environment: dict[str, str], call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = [*SMALL, "--budget", "600", "--set=output.pictures=false"]
    pipes = {"stderr": subprocess.PIPE, "stdout": subprocess.PIPE}
    with running([*command, *words], cwd=folder, env=environment, **pipes) as process:
        for line in process.stderr:
            if "unknowns" in line:
                break
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=100)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    before = content(folder / "out")
    assert before["status"] == "interrupted"
    assert before["runs"]
    assert sorted(path.name for path in folder.iterdir()) == ["out"]
    spent = before["spent"]
    monkeypatch.setattr(stickslip.workflows.cost.command, "measure", quick)
    ended(call(*words[:-2], f"{spent + 90}", "--resume", words[-1]))
    after = content(folder / "out")
    kept = {run["name"]: run["spent"] for run in after["runs"]}
    assert {run["name"]: run["spent"] for run in before["runs"]}.items() < kept.items()


def test_resume_after_any_stop_gives_the_same_table(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["--budget", "90", "-q", "--set=output.pictures=false"]
    monkeypatch.setattr(stickslip.workflows.cost.command, "measure", quick)
    assert call(*SMALL, *words)[0] == 0
    whole, text = content(folder / "out"), (folder / "out" / "cost.csv").read_text()
    for stop in (1, len(whole["runs"]) // 2, len(whole["runs"]) - 1):
        left = iter(range(stop))

        def pause(*arguments: Any, left: Any = left) -> Run | None:
            return quick(*arguments) if next(left, None) is not None else None

        monkeypatch.setattr(stickslip.workflows.cost.command, "measure", pause)
        assert_said(call(*SMALL, *words), 130, alone=False)
        assert len(content(folder / "out")["runs"]) == stop
        monkeypatch.setattr(stickslip.workflows.cost.command, "measure", quick)
        assert call(*SMALL, *words, "--resume")[0] == 0
        assert (folder / "out" / "cost.csv").read_text() == text
        assert content(folder / "out")["sentence"] == whole["sentence"]


def test_a_killed_study_is_taken_up_where_it_was(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = iter(range(3))

    def die(*arguments: Any) -> Run:
        if next(left, None) is None:
            raise ZeroDivisionError  # nothing is tidied up, as after a power cut
        return quick(*arguments)

    monkeypatch.setattr(stickslip.workflows.cost.command, "measure", die)
    with pytest.raises(ZeroDivisionError):
        call(*PLAIN, "-q")
    assert not (folder / "out").exists()
    before = sorted(str(path) for path in folder.rglob("*"))
    assert_said(
        call(*PLAIN, "-q"),
        2,
        "out: a study that was killed has left 3 finished runs in .out.running; go on with --resume",
    )
    assert call("run", "block", "-q", "-o", "out")[0] == 2
    assert sorted(str(path) for path in folder.rglob("*")) == before
    made: list[Rung] = []

    def count(scene: Scene, rung: Rung, *more: Any) -> Run:
        made.append(rung)
        return quick(scene, rung, *more)

    monkeypatch.setattr(stickslip.workflows.cost.command, "measure", count)
    assert call(*PLAIN, "-q", "--resume", "--budget", "60")[0] == 0
    assert len(content(folder / "out")["runs"]) == len(made) + 3


def test_a_study_killed_while_taken_up_loses_no_run(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stickslip.workflows.cost.command, "measure", quick)
    assert call(*PLAIN, "-q", "--budget", "20")[0] == 0
    before = content(folder / "out")["runs"]

    def die(*arguments: Any) -> None:
        raise ZeroDivisionError  # the first run is about to be copied

    with monkeypatch.context() as killed:
        killed.setattr(stickslip.workflows.cost.study_folder, "write_json", die)
        with pytest.raises(ZeroDivisionError):
            call(*PLAIN, "-q", "--budget", "30", "--resume")
    made: list[Rung] = []

    def count(scene: Scene, rung: Rung, *more: Any) -> Run:
        made.append(rung)
        return quick(scene, rung, *more)

    monkeypatch.setattr(stickslip.workflows.cost.command, "measure", count)
    assert call(*PLAIN, "-q", "--budget", "30", "--resume")[0] == 0
    assert len(content(folder / "out")["runs"]) == len(before) + len(made)


def test_a_changed_scene_is_not_resumed(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stickslip.workflows.cost.command, "measure", quick)
    assert call(*PLAIN, "--budget", "20", "-q")[0] == 0
    assert_said(
        call(*PLAIN, "--budget", "30", "-q", "--resume", "--set=contacts.base.friction.mu=0.4"),
        2,
        "contacts.base.friction.mu was 0.3 in out, and is 0.4",
    )
    assert sorted(path.name for path in folder.iterdir()) == ["out"]


@pytest.mark.parametrize("how", ["cut", "other", "table", "scene"])
def test_a_damaged_run_of_a_study_is_named(how: str, call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stickslip.workflows.cost.command, "measure", quick)
    assert call(*PLAIN, "--budget", "20", "-q")[0] == 0
    first, second, *_ = sorted((folder / "out" / "runs").iterdir())
    path = folder / "out" / "scene.json" if how == "scene" else first
    path.write_text({"other": second.read_text(), "table": '{"rung": 3}'}.get(how, path.read_text()[:-9]))
    assert_said(call(*PLAIN, "--budget", "30", "-q", "--resume"), 4, f"{path.name}: ")


def test_methods_are_laid_side_by_side(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On the same meshes, whatever the scene names; without the option nothing of it is written."""

    def solver(scene: Scene, rung: Rung, *more: Any) -> Run:
        run, slow = quick(scene, rung, *more), 5 if rung.method == "block-uzawa" else 1
        phases = {phase: slow * value for phase, value in run.phases.items()}
        return replace(run, phases=phases, spent=slow * run.spent, volume_solves=100 * slow)

    monkeypatch.setattr(stickslip.workflows.cost.command, "measure", solver)
    out, err = ended(call(*SMALL, "--methods", "block-uzawa, uzawa", "--budget", "90"))
    done = content(folder / "out")
    assert {run["rung"]["method"] for run in done["runs"]} == {"block-uzawa", "uzawa"}
    both = [line for line in done["side_by_side"] if all(line["methods"].values())]
    assert len(both) >= 3
    for line in both:
        block, plain = line["methods"]["block-uzawa"], line["methods"]["uzawa"]
        assert (block["volume_solves"], plain["volume_solves"]) == (500, 100)
        assert block["seconds"] == pytest.approx(5 * plain["seconds"])
    assert done["comparison"].endswith("block-uzawa 5 times the seconds, 5 times the volume solves.")
    assert done["comparison"] in err
    assert "block-uzawa" in out
    assert (folder / "out" / "cost_methods.png").read_bytes().startswith(b"\x89PNG")
    assert call(*SMALL[:3], "plain", *SMALL[4:], "--budget", "20", "-q")[0] == 0
    assert {"side_by_side", "comparison"}.isdisjoint(content(folder / "plain"))
    assert not (folder / "plain" / "cost_methods.png").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--quantity", "base.norml_force"], "did you mean base.normal_force?"),
        (["--quantity", "bse.normal_force"], "did you mean base.normal_force?"),
        (["--budget", "0"], "--budget 0: must be positive"),
        (["--budget", "-3"], "must be positive"),
        (["--set=solver.method=uzwa"], "did you mean uzawa?"),
        (["--resume"], "out: holds no cost study to resume"),
        (["--methods", "uzawa,block-uzava"], "--methods block-uzava: no such method; did you mean block-uzawa?"),
        (["--methods", ""], "no such method; known: auto, block-uzawa"),
        (["--set=contacts.base.friction.k_T=1.0", "--methods", "uzawa,regularised"], "--methods regularised: "),
        (['--set=exact.values={"base.presure"=1.0}'], "no such quantity"),
    ],
)
def test_what_is_wrong_is_refused_with_one_line(words: list[str], message: str, call: Call, folder: Path) -> None:
    assert_said(call(*SMALL, *words), 2, message)
    assert not list(folder.iterdir())


def test_a_foreign_folder_is_left_alone(call: Call, folder: Path) -> None:
    (folder / "out").mkdir()
    (folder / "out" / "thesis.txt").write_text("years of work")
    assert_said(call(*SMALL), 2, "not the result of a run")
    assert (folder / "out" / "thesis.txt").read_text() == "years of work"


def test_a_budget_for_nothing_is_said(call: Call, folder: Path) -> None:
    code, _, err = call(*SMALL, "--budget", "0.5", "-q")
    assert (code, err) == (3, "stickslip: give it a larger --budget\n")
    assert not list(folder.iterdir())


def test_one_mesh_is_no_comparison(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stickslip.workflows.cost.command, "measure", quick)
    assert_said(call(*SMALL, "--budget", "3", "-q"), 3, "fewer than 2 meshes", alone=False)
    assert {run["rung"]["level"] for run in content(folder / "out")["runs"]} == {-4}


def test_a_run_that_fails_is_a_row_and_not_the_end(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One iteration is not enough for Uzawa on any mesh."""

    def here(scene: Scene, rung: Rung, *rest: Any) -> Run:
        mine = rung.scene(scene)
        found = {key: value for key, value in solve(mine).items() if key != "lasted"}
        return Run(rung=rung, h=mesh_size(mine), spent=1.0, **found)  # as its own process does

    monkeypatch.setattr(stickslip.workflows.cost.command, "measure", here)
    words = ["--set=solver.method=uzawa", "--set=solver.max_iterations=1", "--set=output.pictures=false"]
    assert_said(call(*SMALL, *words, "--budget", "600", "-q"), 3, "no run converged", alone=False)
    rows = table(folder / "out" / "cost.csv")
    assert {row["status"] for row in rows} == {"not_converged"}
    assert len(rows) == 4  # two of each order


def test_the_child_dies_with_its_parent(folder: Path, command: list[str], environment: dict[str, str]) -> None:
    """A study that is killed leaves no process behind that goes on computing."""
    words = [*command, *SCENE, "--set=geometry.contact_mesh_size=0.02", "--set=steps.count=100000"]
    pipes = {"stderr": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
    with running(words, cwd=folder, env=environment, **pipes) as process:
        computing = wait_for(
            lambda: [pid for pid in children(process.pid) if CHILD in words_of(pid)], "a computing child", process.pid
        )
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    wait_for(lambda: not any(CHILD in words_of(pid) for pid in computing), "the end of the child")


COARSE = ("--set=geometry.mesh_size=0.5", "--set=geometry.contact_mesh_size=0.5", "--set=output.pictures=false")


def swollen(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """From now on a part of the memory is foretold to take a million GB."""
    known = simulation.memory_of

    def memory_of(output: Output, counts: Counts, size: Size, choice: Choice) -> Demand:
        found = known(output, counts, size, choice)
        return replace(found, parts=tuple(replace(p, rank=1e15) if p.name == name else p for p in found.parts))

    monkeypatch.setattr(simulation, "memory_of", memory_of)


def test_plan_tells_the_memory_of_each_part(call: Call) -> None:
    out = output_of(call("plan", "block", "--mesh", *COARSE))
    for said in ("memory of", "stiffness", "error estimate", "bytes an unknown", "peak while", "GB are free"):
        assert said in out
    memory = json.loads(call("plan", "block", "--mesh", "--json", *COARSE)[1])["memory"]
    assert memory["peak"] == max(memory["stages"].values())
    for stage, taken in memory["stages"].items():
        assert taken == pytest.approx(sum(p["rank"] for p in memory["parts"] if stage in p["stages"]))
    assert 1e8 < memory["peak"] < memory["free"]


def test_plan_without_a_mesh_goes_by_the_expected_number_of_cells(call: Call) -> None:
    assert "GB of memory, by the expected number of cells" in call("plan", "block", *COARSE)[1]
    expected, counted = (
        json.loads(call("plan", "block", "--json", *more, *COARSE)[1])["memory"]["peak"] for more in ((), ("--mesh",))
    )
    assert expected == pytest.approx(counted, rel=0.2)


def test_a_run_says_its_memory_in_the_log(call: Call, folder: Path) -> None:
    assert call("run", "block", "-q", "-o", "out", *COARSE)[0] == 0
    assert "GB at the most" in (folder / "out" / "run.log").read_text()
    assert not any("memory" in line for line in result(folder / "out")["warnings"])


def test_errors_of_no_room_are_left_out_and_said(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    swollen(monkeypatch, "error estimate")
    assert call("run", "block", "-q", "-o", "out", *COARSE)[0] == 0
    done = result(folder / "out")
    assert any("errors are not estimated" in line for line in done["warnings"])
    assert done["status"] == "converged"
    assert done["steps"][-1]["contacts"]["base"]["error"] is None
    assert "errors are not estimated" in (folder / "out" / "run.log").read_text()


def test_a_run_that_does_not_fit_ends_with_4_and_says_what_to_set(
    call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    swollen(monkeypatch, "stiffness")
    assert_said(call("run", "block", "-q", "-o", "out", *COARSE), 4, "use a larger mesh_size, or more machines")
    assert not (folder / "out").exists()
