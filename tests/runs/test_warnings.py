"""What can be solved but answers badly is said before solving: by the plan, by the run, and in its log."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from shared.command import COARSE, Spoken
from solvers.simulation.plan import warnings
from workflows.scene_file.read import read

Call = Callable[..., Spoken]
SOFT = "--set=bodies.block.nu=0.4999"
LOCKS = "warning: bodies.block.nu = 0.4999: displacements of order 1 lock"


def flat(text: str) -> str:
    """Without the line breaks of a narrow terminal."""
    return " ".join(text.split())


def test_plan_and_run_warn_of_linear_elements_that_lock(call: Call, folder: Path) -> None:
    code, out, _ = call("plan", "block", SOFT)
    assert code == 0
    assert LOCKS in flat(out)
    assert json.loads(call("plan", "block", "--json", SOFT)[1])["warnings"] == [*warnings(read("block", [SOFT[6:]]))]
    code, _, err = call("run", "block", "-o", "out", SOFT, *COARSE)
    assert code == 0
    assert LOCKS in flat(err)
    assert "WARNING bodies.block.nu = 0.4999" in (folder / "out" / "run.log").read_text()


@pytest.mark.parametrize("override", ["bodies.block.nu=0.49", "geometry.order=2", "model='plane stress'"])
def test_no_warning_where_nothing_locks(override: str) -> None:
    assert warnings(read("block", ["bodies.block.nu=0.4999"]))
    assert warnings(read("block", ["bodies.block.nu=0.4999", override])) == ()


def test_displacements_that_are_not_small_are_doubted(call: Call, folder: Path) -> None:
    """A block 2 m high, pressed by 1.8 m; or moved by 10 m as a whole, together with its foundation."""
    coarse = ("--set", "geometry.mesh_size=0.5", "--set", "geometry.contact_mesh_size=0.5")
    pressed = "supports.top.displacement={x=0, y=[[0, 0], [1, -1.8]]}"
    code, _, err = call("run", "block", *coarse, "--set", pressed)
    assert code == 0
    assert "warning: displacements differ by up to 0.4" in flat(err)  # 1.8 and more, of the diagonal 20^(1/2)
    assert "displacements differ" in (folder / "results" / "block" / "run.log").read_text()
    moved = ("--set", "supports.top.displacement={x=10, y=0}", "--set", "obstacles.foundation.displacement={x=10}")
    for overrides in ((), moved):
        assert "displacements differ" not in call("run", "block", *coarse, *overrides)[2]


def test_steps_too_large_for_what_friction_dissipates_are_doubted(call: Call, folder: Path) -> None:
    coarse = ["--set=geometry.mesh_size=0.1", "--set=output.pictures=false", "-o", "out"]
    code, _, err = call("run", "hysteresis", "--set=steps.count=22", *coarse)
    assert code == 0
    assert "warning: friction's work by the ends of the steps is" in flat(err)
    assert "for the dissipation take smaller steps" in flat(err)
    code, _, err = call("run", "hysteresis", "--set=steps.count=88", *coarse)
    assert (code, "smaller steps" in err) == (0, False)
