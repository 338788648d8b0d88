"""A run that was stopped goes on to the result, bit for bit, of one that was not."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_array_equal

from shared.command import result
from solvers.plain import packed
from workflows.run import run
from workflows.scene import read
from workflows.watch import Watch
from workflows.writers.hdf5 import stored_checksum
from workflows.writers.steps import read_checkpoint

EXCEPTED = {"seconds", "factorisations", "forms", "searches", "coarse_mesh"}  # of two preparations
STEPS = "--set=steps.count=6"


class Stop:
    """Ends the run after so many steps, as Ctrl-C does."""

    def __init__(self, after: int) -> None:
        self.left = after

    def __call__(self, step: Any) -> None:
        self.left -= 1
        if not self.left:
            raise KeyboardInterrupt


def leaves(value: Any, at: str = "") -> Iterator[tuple[str, Any]]:
    """Every number, word and array with the keys that lead to it, seconds and counters of preparation left out."""
    if isinstance(value, dict):
        for key, item in value.items():
            if key not in EXCEPTED:
                yield from leaves(item, f"{at}.{key}")
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            yield from leaves(item, f"{at}.{index}")
    else:
        yield at, value


def table(path: Path) -> list[dict[str, str]]:
    rows = list(csv.DictReader(path.read_text().splitlines()))
    return [{key: text for key, text in row.items() if key != "seconds"} for row in rows]


def assert_same(found: Path, expected: Path) -> None:
    """All files but the seconds in them: the same to the last bit."""
    names = {str(path.relative_to(expected)) for path in expected.rglob("*") if path.is_file()}
    assert {str(path.relative_to(found)) for path in found.rglob("*") if path.is_file()} == names
    for name in sorted(names):
        if name.endswith(".h5") and name.startswith("steps"):
            plain = [packed(read_checkpoint(folder / name)[0]) for folder in (found, expected)]
            for step in plain:
                step["history"] = [[*row[:4], row[5]] for row in step["history"]]
            (ours, theirs) = (dict(leaves(step)) for step in plain)
            assert ours.keys() == theirs.keys()
            for key, value in theirs.items():
                assert_array_equal(ours[key], value, err_msg=f"{name}: {key}")
        elif name.endswith(".csv"):
            assert table(found / name) == table(expected / name), name
        elif name == "result.json":
            assert dict(leaves(result(found))) == dict(leaves(result(expected)))
        elif name == "fields.h5":  # HDF5 writes the time of day
            assert stored_checksum(found / name) == stored_checksum(expected / name)
        elif name != "run.log":
            assert (found / name).read_bytes() == (expected / name).read_bytes(), name


SMALL = ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=0.5", "output.pictures=false", "steps.count=6"]
CUBE = ["geometry.mesh_size=0.25", "output.pictures=false", "steps.count=5"]
MATRIX_FREE = ["solver.surface=matrix-free"]
HISTORIES = {
    "condensed-newton": ("block", [*SMALL, "solver.method=condensed-newton"]),
    "uzawa": ("block", [*SMALL, "solver.method=uzawa"]),
    "surface-uzawa": ("cube", [*CUBE, "solver.method=surface-uzawa", *MATRIX_FREE]),
    "inexact-uzawa": ("cube", [*CUBE, "solver.method=inexact-uzawa"]),
    "perturbed-lagrangian": ("block", [*SMALL, "solver.method=perturbed-lagrangian"]),
    "regularised": ("block", [*SMALL, "solver.method=regularised"]),
    "gram-uzawa": ("block", [*SMALL, "solver.method=gram-uzawa"]),
    "sliding": ("sliding", ["geometry.mesh_size=0.25", "geometry.lower_mesh_size=0.2", "output.pictures=false"]),
    "floating": ("foundation", ["geometry.mesh_size=0.4", "output.pictures=false", "steps.count=4"]),
}


@pytest.mark.parametrize("name", HISTORIES)
def test_stopped_after_two_steps_it_goes_on_to_the_same_bits(name: str, tmp_path: Path) -> None:
    scene = read(*HISTORIES[name])
    run(scene, tmp_path / "whole")
    outcome, _ = run(scene, tmp_path / "out", Watch(on_step=Stop(2)))
    assert (outcome.status, len(result(tmp_path / "out")["steps"])) == ("interrupted", 2)
    outcome, _ = run(scene, tmp_path / "out", resume=True)
    assert outcome.status == "converged"
    assert_same(tmp_path / "out", tmp_path / "whole")
