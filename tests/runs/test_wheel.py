"""The wheel holds all that a run needs, and stands beside other packages; a clone is found from anywhere."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from stickslip import VERSION

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("geometry", "solvers", "workflows", "stickslip", "src")
COARSE = (
    "--set=geometry.mesh_size=1.0",
    "--set=geometry.contact_mesh_size=0.5",
    "--set=output.pictures=false",
    "--set=output.error=false",
    "--set=output.report=true",
)
PIP = [sys.executable, "-m", "pip"]
ALONE = ["--disable-pip-version-check", "--no-index", "--no-deps", "-q"]


def copied(target: Path) -> None:
    """Copy what a clone holds of the package."""
    for name in COPIED:
        shutil.copytree(
            ROOT / name, target / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info")
        )
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, target)


def test_a_wheel_runs_from_an_empty_folder(tmp_path: Path) -> None:
    source, site, empty = (tmp_path / name for name in ("source", "site", "empty"))
    copied(source)
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


def test_a_clone_named_stickslip_is_imported_from_the_folder_that_holds_it(tmp_path: Path) -> None:
    """There the clone looks like a package without code; a path to the real one goes before it, which editors read."""
    clone = tmp_path / "stickslip"
    copied(clone)
    python = clone / ".venv/bin/python"
    subprocess.run(
        [sys.executable, "-m", "venv", "--without-pip", "--system-site-packages", clone / ".venv"], check=True
    )
    words = [*PIP, "--python", python, "install", *ALONE, "--no-build-isolation", "-e", clone]
    made = subprocess.run(words, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    (site,) = clone.glob(".venv/lib/python3.*/site-packages")
    (path,) = site.glob("*stickslip*.pth")
    assert path.read_text().strip() == str(clone / "src")
    assert (clone / "src/stickslip/py.typed").exists()
    (site / "others.pth").write_text(sysconfig.get_path("purelib"))  # what the tests' Python has, this one has too
    program = "import stickslip; print(stickslip.__file__); stickslip.read('block')"
    for words, said in (
        ([python, "-c", program], str(clone / "src/stickslip/__init__.py")),
        ([python, "-m", "stickslip", "--version"], VERSION),
    ):
        run = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
        assert (run.stdout.strip(), run.stderr) == (said, "")
