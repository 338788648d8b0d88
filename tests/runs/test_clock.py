"""Where the time of a run goes: all phases add up to the whole, whatever the run does."""

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from shared.histories import SMALL, Stop
from stickslip.solvers.parallel.counters import PHASES
from stickslip.workflows.commands import start
from stickslip.workflows.formats.results import profile_lines, read_results
from stickslip.workflows.pictures.report_page import page
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

ROUNDING = 1e-9  # of sums of a few dozen numbers, relative
BETWEEN = 0.3  # largest share of what is in no phase; it takes a fiftieth of that
CHOSEN = {"OMPI_MCA_pml": "cm"}  # by the user
LEARNS = ("solver.method=tangent-cg", "solver.surface=matrix-free")


def of_run(folder: Path, *more: str, **keys: Any) -> dict[str, Any]:
    return run(read("block", [*SMALL, *more]), folder, **keys)[1]


def assert_adds_up(content: dict[str, Any]) -> None:
    seconds = content["seconds"]
    parts = [value for name, value in seconds.items() if name != "total" and value is not None]
    assert min(parts) >= 0
    assert sum(parts) == pytest.approx(seconds["total"], rel=ROUNDING)
    assert sum(row["seconds"] for row in content["profile"]) == pytest.approx(seconds["total"], rel=ROUNDING)
    assert {row["phase"] for row in content["profile"]} <= set(PHASES) <= set(seconds)
    counted = content["counters"]["volume_solves"] + content["counters"]["error_solves"]
    assert sum(row["volume_solves"] for row in content["profile"]) == counted


def row(content: dict[str, Any], phase: str, part: str = "") -> dict[str, Any]:
    (found,) = (row for row in content["profile"] if (row["phase"], row["part"]) == (phase, part))
    return dict(found)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("clock") / "out"


@pytest.fixture(scope="module")
def content(folder: Path) -> dict[str, Any]:
    asked = ("output.linear_reference=true", "output.pictures=true", "output.report=true")
    return of_run(folder, *asked, began=time.perf_counter() - 50.0)


def test_seconds_add_up_to_the_total(content: dict[str, Any]) -> None:
    assert_adds_up(content)
    assert content["seconds"]["imports"] >= 50.0
    assert content["seconds"]["other"] < BETWEEN * (content["seconds"]["total"] - content["seconds"]["imports"])


def test_all_solvers_of_the_linear_reference_are_in_it(content: dict[str, Any]) -> None:
    solvers, seconds = content["linear_reference"]["solvers"].values(), content["seconds"]
    took = sum((one["setup"] or 0.0) + (one["solve"] or 0.0) for one in solvers)
    assert seconds["linear_reference"] == content["linear_reference"]["seconds"]
    assert seconds["linear_reference"] + seconds["linear_reference_others"] >= took > seconds["linear_reference"]


def test_each_phase_has_its_parts(content: dict[str, Any]) -> None:
    count = len(content["steps"])
    assert row(content, "iterate")["calls"] == count
    assert row(content, "iterate")["volume_solves"] == content["counters"]["volume_solves"]
    assert row(content, "error", "time steps")["volume_solves"] > 0
    assert row(content, "audit")["seconds"] == content["seconds"]["audit"] > 0
    assert all(row(content, "output", part)["seconds"] > 0 for part in ("results", "step files", "pictures", "report"))


def test_run_log_ends_with_the_profile(folder: Path, content: dict[str, Any]) -> None:
    lines = (folder / "run.log").read_text().splitlines()
    told = profile_lines(content["profile"])
    assert lines[-len(told) :] == told
    assert [told[0].split()[0], told[-1].split()[:2]] == ["phase", ["total", f"{content['seconds']['total']:.3f}"]]


def test_the_report_shows_the_profile(folder: Path, content: dict[str, Any]) -> None:
    text = page(read_results(folder))
    assert all(f"<td>{cell}</td>" in text for cell in ("  step files", "  pictures", "imports", "audit"))


def test_a_run_that_goes_on_adds_to_what_was_spent(tmp_path: Path) -> None:
    scene = read("block", [*SMALL, "output.error=false"])
    _, before = run(scene, tmp_path / "out", Watch(on_step=Stop(3)), began=time.perf_counter() - 50.0)
    _, after = run(scene, tmp_path / "out", resume=True)
    for content in (before, after):
        assert_adds_up(content)
    assert before["seconds"]["audit"] == 0.0  # it was told to stop
    assert after["seconds"]["imports"] >= 50.0
    assert (row(after, "iterate")["calls"], row(after, "prepare")["calls"]) == (6, 4)
    assert row(after, "iterate")["volume_solves"] == after["counters"]["volume_solves"]


def test_setting_up_the_tangent_is_told(tmp_path: Path) -> None:
    content = of_run(tmp_path / "out", *LEARNS, "output.error=false")
    assert_adds_up(content)
    assert row(content, "prepare", "tangent")["seconds"] > 0
    assert row(content, "iterate", "certificate")["calls"] > 0


@pytest.mark.parametrize("launched", [*start.LAUNCHED, ""])
def test_mpi_is_told_of_a_process_that_is_alone(launched: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "environ", {launched: "1"} | CHOSEN)
    start._stay_alone()
    assert dict(os.environ) == os.environ | CHOSEN
    assert (set(start.ALONE) <= set(os.environ)) == (not launched)


@pytest.mark.parametrize(
    ("module", "late"),
    [
        ("workflows.commands.cli", ("numpy", "mpi4py", "rich")),
        ("workflows.scene_file.read", ("gmsh", "matplotlib", "pyvista", "scipy.integrate")),
        ("workflows.pictures.draw", ("pyvista", "vtkmodules")),
    ],
)
def test_what_takes_long_to_load_is_loaded_late(module: str, late: tuple[str, ...]) -> None:
    program = f"import sys, stickslip.{module}; print(*(name for name in {late} if name in sys.modules))"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout == "\n"
