"""The wheel holds all that a run needs, and stands beside other packages."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("geometry", "solvers", "workflows", "stickslip")
COARSE = (
    "--set=geometry.mesh_size=1.0",
    "--set=geometry.contact_mesh_size=0.5",
    "--set=output.pictures=false",
    "--set=output.error=false",
    "--set=output.report=true",
)
PIP = [sys.executable, "-m", "pip"]
ALONE = ["--disable-pip-version-check", "--no-index", "--no-deps", "-q"]


def test_a_wheel_runs_from_an_empty_folder(tmp_path: Path) -> None:
    source, site, empty = (tmp_path / name for name in ("source", "site", "empty"))
    for name in COPIED:
        shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    empty.mkdir()
    made = subprocess.run(
        [*PIP, "wheel", *ALONE, "--no-build-isolation", "-w", tmp_path, source], capture_output=True, text=True
    )
    assert made.returncode == 0, made.stderr
    (wheel,) = tmp_path.glob("*.whl")
    made = subprocess.run([*PIP, "install", *ALONE, "--target", site, wheel], capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    assert {path.name for path in site.iterdir() if path.suffix != ".dist-info"} <= {"stickslip", "bin"}
    run = subprocess.run(
        [sys.executable, "-P", "-m", "stickslip", "run", "block", *COARSE, "-o", "out"],
        cwd=empty,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    assert (empty / "out" / "result.json").exists()
    assert (empty / "out" / "report.html").exists(), "the files of the page are in the wheel"
