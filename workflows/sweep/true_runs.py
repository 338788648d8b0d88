"""Runs with each uncertain number one standard deviation away, beside what derivatives say of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from stickslip.geometry.arrays import CLOSE
from stickslip.geometry.errors import SceneError, SolverError, require
from stickslip.geometry.keys import AXES
from stickslip.solvers.scene.parameters import Sensitivity, scaled
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.scene_file.read import to_dict
from stickslip.workflows.sweep.sweep import Solved, sweep, unheard

Row = Mapping[str, Any]  # numbers of a last step by column, as in steps.csv


@dataclass(frozen=True)
class TrueRuns:
    """The last steps of a scene's neighbours, by uncertain number, with a smaller and with a larger value of it."""

    covariance: Mapping[str, Mapping[str, float]]
    rows: Mapping[str, tuple[Row, Row]]

    def spread(self, name: str, value: float) -> tuple[float, float]:
        """Lower and upper end of a number by its runs, one standard deviation to both sides; as differences.

        Args:
            name: of the number, as in steps.csv.
            value: what it is in the scene itself.
        """
        away = {by: [float(row[name]) - value for row in pair] for by, pair in self.rows.items()}
        bias = sum(below + above for below, above in away.values()) / 2
        slopes = {by: (pair[1] - pair[0]) / 2 / math.sqrt(self.covariance[by][by]) for by, pair in away.items()}
        variance = sum(slopes[i] * slopes[j] * size for i, row in self.covariance.items() for j, size in row.items())
        half = math.sqrt(max(variance, 0.0))
        return bias - half, bias + half

    def doubts(self, name: str, value: float, inputs: float) -> bool:
        """Whether the uncertainty by derivatives lies: ends of the interval differ in its first digit.

        Args:
            inputs: the standard uncertainty by derivatives.

        Source: Supplement 1 to the Guide to the expression of uncertainty in measurement, JCGM 101 (2008), 8.1.
        """
        low, high = self.spread(name, value)
        allowed = 10 ** math.floor(math.log10(inputs)) / 2 if inputs > 0 else CLOSE * abs(value)
        return max(abs(low + inputs), abs(high - inputs)) > allowed


def true_runs(
    scene: Scene, folder: Path, jobs: int, on_member: Callable[[int, int, Solved], None] = unheard
) -> TrueRuns:
    """Solve a scene's neighbours, two for each uncertain number, in folders below one.

    Raises:
        SceneError: no number is uncertain; or under mpirun, for each run is a process of its own.
        SolverError: one was not solved.
    """
    from mpi4py import MPI

    require(MPI.COMM_WORLD.size == 1, "--check", f"{MPI.COMM_WORLD.size} ranks", "leave mpirun out, use --jobs")
    if not scene.covariance:
        raise SceneError("uncertainty: no number has one, so there is nothing to check; see docs/theory/sensitivity.md")
    output = replace(scene.output, error=False, pictures=False)
    plain, known = replace(scene, sensitivity=Sensitivity(), uncertainty={}, output=output), scene.parameters()
    found = dict[str, tuple[Row, Row]]()
    for key, row in scene.covariance.items():
        size = math.sqrt(row[key]) / known[key]
        both = [_value(to_dict(scaled(plain, key, 1 + by)), key) for by in (-abs(size), abs(size))]
        if size < 0:
            both = both[::-1]
        done = sweep(plain, {key: both}, folder / key, jobs, on_member)
        off = [str(one) for one in done.solved if one.status not in ("converged", "doubtful")]
        if off:
            raise SolverError(f"uncertainty.{key}: {off[0]}")
        below, above = done.rows
        found[key] = below, above
    return TrueRuns(scene.covariance, found)


def _value(data: Any, key: str) -> Any:
    """The value of a dotted key in plain data."""
    for word in key.split("."):
        data = data[AXES.index(word)] if isinstance(data, list) else data[word]
    return data
