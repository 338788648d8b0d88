"""What memory a run will take: told by `plan`, in the log, left out or refused before the bodies are assembled."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

import stickslip.solvers.simulation.simulation as simulation
from shared.command import Call, result
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.simulation.memory import Counts, Demand
from stickslip.solvers.stepping.choice import Choice, Size

COARSE = ("--set=geometry.mesh_size=0.5", "--set=geometry.contact_mesh_size=0.5", "--set=output.pictures=false")


def swollen(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """From now on a part of the memory is foretold to take a million GB."""
    known = simulation.memory_of

    def memory_of(output: Output, counts: Counts, size: Size, choice: Choice) -> Demand:
        found = known(output, counts, size, choice)
        return replace(found, parts=tuple(replace(p, rank=1e15) if p.name == name else p for p in found.parts))

    monkeypatch.setattr(simulation, "memory_of", memory_of)


def test_plan_tells_the_memory_of_each_part(call: Call) -> None:
    code, out, err = call("plan", "block", "--mesh", *COARSE)
    assert (code, err) == (0, "")
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


def test_errors_that_do_not_fit_are_left_out_with_a_warning(
    call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    code, out, err = call("run", "block", "-q", "-o", "out", *COARSE)
    assert (code, out, err.count("\n")) == (4, "", 1)
    assert "use a larger mesh_size, or more machines" in err
    assert not (folder / "out").exists()
