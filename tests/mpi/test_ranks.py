"""The answer does not depend on the number of ranks."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_allclose

from workflows.writers.steps import read_step

COARSE = {
    "block": ["geometry.mesh_size=0.25", "geometry.contact_mesh_size=0.125"],
    "cube": ["geometry.mesh_size=0.25"],
    "foundation": ["geometry.mesh_size=0.25"],
}
ROOT = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
SAME = {"seconds", "ranks", "version", "counters", "audit", "error", "residual", "iterations", "volume_solves"}


def run(ranks: int, *words: str) -> subprocess.CompletedProcess[str]:
    """The command under mpirun; a hang ends after two minutes."""
    mpirun = ["mpirun", "--oversubscribe", "-n", str(ranks)] if ranks > 1 else []
    command = [*mpirun, sys.executable, "-m", "workflows.cli", *words]
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.run(
        command, env=dict(os.environ) | ROOT | threads, capture_output=True, text=True, timeout=120, check=False
    )


def solve(ranks: int, scene: str, folder: Path) -> dict[str, Any]:
    overrides = [*COARSE[scene], "solver.tolerance=1e-11", "output.pictures=false"]
    words = [word for override in overrides for word in ("--set", override)]
    done = run(ranks, "run", scene, "-q", "-o", str(folder), *words)
    assert done.returncode == 0, done.stderr
    content: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return content


def leaves(value: Any, path: str = "") -> dict[str, Any]:
    """All figures of result.json that must agree, by their path."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    if not isinstance(value, dict | list):
        return {path: value}
    found: dict[str, Any] = {}
    for key, item in items:
        if key not in SAME:
            found |= leaves(item, f"{path}.{key}")
    return found


@pytest.mark.parametrize("scene", list(COARSE))
@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks_agree(scene: str, ranks: int, tmp_path: Path) -> None:
    """At tolerance 1e-11 forces, areas, energy and displacements agree to 1e-9 of their largest value."""
    one, many = solve(1, scene, tmp_path / "one"), solve(ranks, scene, tmp_path / "many")
    assert many["ranks"] == ranks
    a, b = leaves(one), leaves(many)
    assert a.keys() == b.keys()
    numbers = [key for key in a if isinstance(a[key], float) and not key.startswith(".scene")]
    assert len(numbers) > 30
    scale = max(abs(a[key]) for key in numbers if key.endswith("normal_force") or ".force" in key)
    for key in numbers:
        assert_allclose(b[key], a[key], rtol=1e-9, atol=1e-9 * scale, err_msg=key)
    assert [a[key] for key in a if key not in numbers] == [b[key] for key in b if key not in numbers]
    names = sorted(str(p.relative_to(tmp_path / "one")) for p in (tmp_path / "one").rglob("*"))
    assert names == sorted(str(p.relative_to(tmp_path / "many")) for p in (tmp_path / "many").rglob("*"))
    for path in (tmp_path / "one" / "steps").iterdir():
        x, y = read_step(path), read_step(tmp_path / "many" / "steps" / path.name)
        assert_allclose(y.displacement, x.displacement, atol=1e-9 * abs(x.displacement).max())
        assert_allclose(y.p, x.p, atol=1e-8 * abs(x.p).max())
        assert_allclose(y.stress, x.stress, atol=1e-8 * abs(x.stress).max())


def test_wrong_scene_is_refused_once_and_no_rank_hangs(tmp_path: Path) -> None:
    done = run(2, "run", "block", "-o", str(tmp_path / "out"), "--set", "bodies.block.nu=0.5")
    assert done.returncode == 2
    assert done.stderr.count("bodies.block.nu = 0.5") == 1
    assert not (tmp_path / "out").exists()


def test_what_only_the_ranks_together_know_ends_them_all(tmp_path: Path) -> None:
    """The probe lies outside: known only to the ranks together, after the mesh."""
    done = run(2, "run", "block", "-o", str(tmp_path / "out"), "--set", "probes.far={point=[9.0, 9.0]}")
    assert done.returncode == 2
    assert done.stderr.count("lies outside the bodies") == 1
    assert not (tmp_path / "out").exists()
