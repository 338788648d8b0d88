"""Other programs on the meshes of the price benchmark: the problem as files, dolfinx by hand, rows of the page."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stickslip
from stickslip.workflows.lab.benchmarks import price
from stickslip.workflows.lab.benchmarks.peers import programs
from stickslip.workflows.lab.benchmarks.peers.ours import OURS
from stickslip.workflows.lab.benchmarks.peers.problem import write_problem
from stickslip.workflows.lab.benchmarks.price_run import Case

BY_HAND = programs.HERE / "dolfinx_by_hand.py"
N = {2: 8, 3: 4}  # cells over the height
SHIFTED = 1  # index of the second step
CLOSED = 0.05  # [m] least of the compressions


@pytest.mark.parametrize(("dim", "solver"), [(2, "lu"), pytest.param(3, "lu", marks=pytest.mark.slow), (3, "gamg")])
def test_dolfinx_by_hand_has_our_forces_up_to_its_penalty(tmp_path: Path, dim: int, solver: str) -> None:
    problem = write_problem(Case(dim, N[dim]), tmp_path)
    found = programs.child([sys.executable, str(BY_HAND), str(problem), solver], 60.0)
    assert found["status"] == "converged"
    exact = [
        step.contacts["base"] for step, _ in zip(stickslip.steps(Case(dim, N[dim]).scene()), range(2), strict=False)
    ]
    for theirs, ours in zip(found["steps"], exact, strict=True):
        assert theirs["normal_force"] == pytest.approx(ours.normal_force, rel=1e-3)
        assert 0 < theirs["penetration"] < 1e-3 * CLOSED
    shifted = exact[SHIFTED]
    assert found["steps"][SHIFTED]["tangential_force"] == pytest.approx(shifted.tangential_force, rel=1e-3)
    assert shifted.slip_area > 0  # so the figure depends on mu
    assert shifted.stick_area > 0


def test_the_base_and_the_top_of_the_files_are_those_of_the_mesh(tmp_path: Path) -> None:
    problem = write_problem(Case(3, 4), tmp_path)
    data = np.load(tmp_path / "mesh.npz")
    assert data["points"].shape == (125, 3)
    assert data["cells"].shape == (64, 8)
    assert data["facets"].shape == (16, 4)
    assert set(data["base"]) == set(np.flatnonzero(data["points"][:, 2] == 0))
    assert set(data["top"]) == set(np.flatnonzero(data["points"][:, 2] == 1))
    assert json.loads(problem.read_text()) == {
        "dim": 3, "E": 1.0, "nu": 0.3, "mu": 0.3, "height": 1.0, "motion": [[0.0, 0.0, -0.05], [0.02, 0.01, -0.05]],
    }  # fmt: skip


def test_a_peer_that_is_missing_is_said_to_be_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = [
        replace(programs.PROGRAMS[0], name="a module", needs="no_such_module_anywhere", install="Debian: nothing"),
        replace(programs.PROGRAMS[0], name="a program", needs="no-such-program", executable=True),
    ]
    answer = {"status": "converged", "seconds": 1.0}
    monkeypatch.setattr(programs, "PROGRAMS", missing)
    monkeypatch.setattr(programs, "child", lambda command, limit: answer)
    ours, *others = programs.measured(tmp_path, 3, [2], 1.0)
    assert (ours["name"], ours["status"]) == (OURS, "converged")
    assert [run["status"] for run in others] == ["not installed: Debian: nothing", "not installed: is ours too"]
    assert "not installed: Debian: nothing" in price.section(3, [ours, *others])


def test_a_peer_that_would_take_too_long_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(programs, "PROGRAMS", [replace(programs.PROGRAMS[0], growth=(1.0, 3.0))])
    monkeypatch.setattr(programs, "child", lambda command, limit: {"status": "converged", "seconds": 10.0})
    found = [run["status"] for run in programs.measured(tmp_path, 3, [2, 4], 50.0) if run["name"] != OURS]
    assert found == ["converged", "not run: 80 s expected"]


def test_a_program_that_fails_says_why() -> None:
    found = programs.child([sys.executable, "-c", "raise SystemExit('it does not converge')"], 10.0)
    assert found == {"status": "it does not converge"}


def test_a_row_has_the_price_in_our_unit_and_the_errors_of_the_forces(tmp_path: Path) -> None:
    common = {"dim": 3, "n": 8, "status": "converged", "version": "1", "dofs": 9, "memory": 0.5}
    step = {"iterations": 4, "normal_force": 2.0, "tangential_force": 0.5, "penetration": 0.0}
    ours = common | {"name": OURS, "seconds": 1.0, "unit": 0.5, "steps": [step, step]}
    wrong = step | {"normal_force": 2.02, "tangential_force": 0.49, "iterations": 6}
    peer = common | {"name": "GetFEM", "seconds": 6.0, "steps": [step, wrong]}
    found = price.row(peer, [ours, peer])
    assert (found["price"], found["iterations"]) == (12.0, 10)
    assert found["error of N"] == pytest.approx(0.01)
    assert found["error of T"] == pytest.approx(-0.02)
    text = price.write_page(tmp_path, [], [ours, peer]).read_text()
    assert "<td>GetFEM<td>1<td>9<td>12<td>6<td>10<td>0.50<td>1.0e-02<td>-2.0e-02" in text
    assert "Peers on the same meshes" not in price.write_page(tmp_path, []).read_text()
