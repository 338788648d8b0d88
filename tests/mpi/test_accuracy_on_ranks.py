"""Rounds towards an accuracy, and errors, are the same on any number of ranks."""

from pathlib import Path
from typing import Any

import pytest

from shared.command import result
from shared.ranks import mpirun
from stickslip.workflows.commands.cli import app, guarded

WORDS = ["run", "block", "--set=geometry.mesh_size=0.5", "--set=geometry.contact_mesh_size=0.5"]
WORDS += ["--set=output.pictures=false", "--accuracy=base.normal_force=0.3%", "-q"]


def done(ranks: int, words: list[str], folder: Path) -> Any:
    """The result of a command on several ranks, or in this process, which is one."""
    where = folder / f"on_{ranks}"
    if ranks == 1:
        assert guarded(lambda: app([*words, "-o", str(where)], standalone_mode=False)) == 0
    else:
        ended = mpirun(ranks, [*words, "-o", str(where)], folder)
        assert ended.returncode == 0, ended.stderr
    return result(where)


def test_ranks_take_the_same_rounds(tmp_path: Path) -> None:
    rounds = []
    for ranks in (1, 2):
        rounds.append(done(ranks, WORDS, tmp_path)["accuracy"]["rounds"])
    assert len(rounds[0]) > 1
    assert [one["unknowns"] for one in rounds[0]] == [one["unknowns"] for one in rounds[1]]


@pytest.mark.slow  # test_recovered_stress has its siblings on one rank
def test_ranks_state_the_same_errors_of_stress(tmp_path: Path) -> None:
    """Each rank recovers the stress of its own cells, from those of all around its nodes."""
    points = {f"p{i}": {"point": [0.1 + 0.4 * i, 0.45]} for i in range(5)}
    table = ", ".join(f"{name} = {{ point = {probe['point']} }}" for name, probe in points.items())
    words = [*WORDS[:4], "--set=output.pictures=false", f"--set=probes={{ {table} }}", "-q"]
    one, two = (done(ranks, words, tmp_path) for ranks in (1, 2))
    for name in points:
        stated, same = (run["steps"][-1]["probes"][name]["error"]["stress"]["mesh"] for run in (one, two))
        assert max(stated) > 0
        assert same == pytest.approx(stated, rel=1e-6)
    assert two["error"]["discretisation"] == pytest.approx(one["error"]["discretisation"], rel=1e-9)


@pytest.mark.slow  # test_left_out has its siblings on one rank
def test_ranks_state_the_same_errors_of_curved_bodies(tmp_path: Path) -> None:
    words = ["run", "half_disc", "--set=geometry.order=1", "--set=steps.count=1", "--set=output.pictures=false", "-q"]
    one, two = (done(ranks, words, tmp_path)["steps"][-1]["supports"]["top"]["error"]["force"] for ranks in (1, 2))
    assert max(one["geometry"]) > 0
    assert two["geometry"] == pytest.approx(one["geometry"], rel=1e-6)


@pytest.mark.slow  # test_scripts_on_ranks has its sibling in 2D
def test_ranks_state_the_same_errors_of_order_2_in_3d(tmp_path: Path) -> None:
    stated = []
    words = [
        "run",
        "cube",
        "--set=geometry.order=2",
        "--set=geometry.mesh_size=0.5",
        "--set=output.pictures=false",
        "-q",
    ]
    for ranks in (1, 2):
        step = done(ranks, words, tmp_path)["steps"][-1]
        stated.append(step["contacts"]["base"]["error"]["normal_force"]["mesh"])
    assert stated[0] > 0
    assert stated[1] == pytest.approx(stated[0], rel=1e-6)
