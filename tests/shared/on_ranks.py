"""Cells solved by all ranks of one mpirun, and what they find kept: `python on_ranks.py CELLS.json FOUND.npz`."""

import json
import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from shared.cells import Cell, solved
from stickslip.solvers.results.step_result import StepResult

TOLERANCE = 1e-11
Answer = dict[str, np.ndarray]


def answer(steps: list[StepResult]) -> Answer:
    """All steps; of displacements whole on rank 0 alone."""
    return {
        "displacement": np.array([step.displacement for step in steps]),
        "force": np.array([step.contacts["base"].force for step in steps]),
    }


def main(cells: Path, found: Path) -> None:
    """An error ends all ranks."""
    kept: Answer = {}
    for k, words in enumerate(json.loads(cells.read_text())):
        cell = Cell(**words)
        try:
            steps = solved(cell.scene(TOLERANCE), MPI.COMM_WORLD)[1]
        except Exception as error:
            sys.stderr.write(f"{cell}: {type(error).__name__}: {error}\n")
            MPI.COMM_WORLD.Abort(1)
        kept |= {f"{k} {name}": values for name, values in answer(steps).items()}
    if MPI.COMM_WORLD.rank == 0:
        np.savez(found, **kept)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
