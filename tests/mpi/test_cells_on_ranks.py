"""Every method finds on several ranks what it finds on one: cells of its table, one mpirun for many of them."""

import json
from collections.abc import Iterator
from dataclasses import asdict
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

from shared import on_ranks
from shared.cases import slow
from shared.cells import MODELS, Cell, refused, solved, whole
from shared.ranks import mpirun
from stickslip.solvers.method_registry import METHODS

SAME = 1e-8  # three decades above the tolerance: friction's condition, and hundreds of iterations
LIMIT = 600  # s; a rank that waits for the others for ever must not hold up the tests
TURN = 11  # how far the cell of one method lies from that of the next


def sample() -> Iterator[Cell]:
    """One cell of each method, in 2D and, of each second one of them, in 3D; other laws and operators for each."""
    models = cycle(("plane strain", "plane strain", "3d", "3d"))
    for turn, (method, model) in enumerate(zip(METHODS, models, strict=False)):
        cells = [cell for cell in whole(method, model) if cell.friction]
        first = turn * TURN % len(cells)
        yield next(cell for cell in (*cells[first:], *cells[:first]) if refused(cell) is None)


def differences(ranks: int, cells: list[Cell], folder: Path) -> list[str]:
    """A sentence for each cell of which several ranks find something else."""
    asked, found = folder / "cells.json", folder / "found.npz"
    asked.write_text(json.dumps([asdict(cell) for cell in cells]))
    done = mpirun(ranks, [str(asked), str(found)], folder, (on_ranks.__file__,), LIMIT)
    assert done.returncode == 0, done.stderr[-2000:]  # 124: it hung until the time limit
    wrong, many = [], np.load(found)
    for k, cell in enumerate(cells):
        for name, one in on_ranks.answer(solved(cell.scene(on_ranks.TOLERANCE))[1]).items():
            off = np.abs(many[f"{k} {name}"] - one).max() / np.abs(one).max()
            if not off <= SAME:
                wrong.append(f"{cell}: {name} {off:.1e} off")
    return wrong


@pytest.mark.parametrize("first", [0, *slow(1)])
def test_each_method_finds_on_two_ranks_what_it_finds_on_one(first: int, tmp_path: Path) -> None:
    assert differences(2, [*sample()][first::2], tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("method", METHODS)
def test_every_cell_finds_on_two_ranks_what_it_finds_on_one(method: str, model: str, tmp_path: Path) -> None:
    """Some of them have two cells of the mesh: there is none for a third rank."""
    cells = [cell for cell in whole(method, model) if refused(cell) is None]
    assert differences(2, cells, tmp_path) == []
