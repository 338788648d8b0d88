"""Runs of several steps, stopped or not, and whether their files say the same."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numpy.testing import assert_array_equal

from shared.command import table
from stickslip.solvers.parallel.serialise import ByNode
from stickslip.workflows.formats.hdf5 import read_arrays, stored_checksum
from stickslip.workflows.formats.marker import MARKER
from stickslip.workflows.formats.results import BEGUN
from stickslip.workflows.formats.serialised import BYTES, TEXT, from_arrays

SMALL = ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=0.5", "output.pictures=false", "steps.count=6"]
LEARNS = ["solver.method=surface-uzawa", "solver.surface=matrix-free"]
PUSHED = [  # of half_disc: as many steps to push as to press
    "supports.top.displacement={x=[[0, 0], [1, 0], [2, 0.006]], y=[[0, 0], [1, -0.03]]}",
    "steps.end=2",
]
FOUR = [*SMALL, "steps.count=4", "output.error=false"]
RUN_FOUR = ["run", "block", "-q", "-o", "out", *(f"--set={word}" for word in FOUR)]
EXCEPTED = {
    "seconds",
    "total",
    "learnt",
    "spent",
    "room",
    "profile",
    "factorisations",
    "forms",
    "searches",
    "coarse",
    "coarse_mesh",
}  # of two preparations
SECONDS = 4  # where they stand in a row of history


class Stop:
    """Sends a signal after so many calls."""

    def __init__(self, after: int, number: int = signal.SIGINT) -> None:
        self.left, self.number = after, number

    def __call__(self, told: Any) -> None:
        self.left -= 1
        if not self.left:
            os.kill(os.getpid(), self.number)


def leaves(value: Any, at: str = "") -> Iterator[tuple[str, Any]]:
    """Every number, word and array with the keys that lead to it, seconds and counters of preparation left out."""
    if isinstance(value, ByNode):
        value = value.values
    if isinstance(value, dict):
        for key, item in value.items():
            if key not in EXCEPTED:
                yield from leaves(item, f"{at}.{key}")
    elif isinstance(value, list):
        for index, item in enumerate(value):
            if not (".history." in at and index == SECONDS):
                yield from leaves(item, f"{at}.{index}")
    else:
        yield at, value


def stored(path: Path) -> dict[str, Any]:
    """All that a step's file holds."""
    arrays, numbers = read_arrays(path)
    text, content = (arrays.pop(f"checkpoint/{name}") for name in (TEXT, BYTES))
    return {**arrays, **numbers, **dict(leaves(from_arrays(text, content, arrays)))}


def rows(path: Path) -> list[dict[str, str]]:
    """Of a table, without its seconds."""
    return [{key: text for key, text in row.items() if key != "seconds"} for row in table(path)]


def names_in(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


@contextmanager
def unchanged(folder: Path) -> Iterator[None]:
    """Context in which all files of a folder stay what they are."""

    def content() -> dict[str, bytes]:
        return {name: (folder / name).read_bytes() for name in names_in(folder)}

    before = content()
    yield
    assert content() == before


def assert_same(found: Path, expected: Path) -> None:
    """Two results folders say the same to the last bit, but for seconds, the log and the list of files."""
    assert names_in(found) == names_in(expected)
    for name in sorted(names_in(expected) - {"run.log", MARKER}):
        ours, theirs = found / name, expected / name
        if name.startswith("steps/"):
            assert_equal(stored(ours), stored(theirs), name)
        elif name.endswith(".h5"):  # HDF5 notes the time of day
            assert stored_checksum(ours) == stored_checksum(theirs), name
        elif name.endswith(".csv"):
            assert rows(ours) == rows(theirs), name
        elif name in ("result.json", BEGUN):
            assert_equal(*(dict(leaves(json.loads(path.read_text()))) for path in (ours, theirs)), name)
        else:
            assert ours.read_bytes() == theirs.read_bytes(), name


def assert_equal(found: dict[str, Any], expected: dict[str, Any], name: str) -> None:
    assert found.keys() == expected.keys(), name
    for key, value in expected.items():
        assert_array_equal(found[key], value, err_msg=f"{name}: {key}")
