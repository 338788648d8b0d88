"""Calibration: numbers of a scene for which its history fits a measured one, by least squares with their derivatives.

Unknowns are factors of the numbers, so that all have one size; what the data do not tell is found by the singular
values of the derivatives.

Source: Björck, Numerical Methods for Least Squares Problems (1996), sections 1.2 and 9.3.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from stickslip.geometry.arrays import CLOSE, SLIGHT, Array
from stickslip.geometry.errors import SceneError, SolverError, require, require_known
from stickslip.geometry.keys import typed
from stickslip.geometry.protocols import Comm
from stickslip.solvers.results.step_result import slopes_of, values
from stickslip.solvers.scene.parameters import Sensitivity, scaled
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Bodies, prepare

TIME = "time"
Columns = Mapping[str, Array]


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Numbers of a scene that fit data best."""

    scene: Scene  # with them
    start: Mapping[str, float]  # by key
    values: Mapping[str, float]
    covariance: Array  # (k, k) of the values, in their own units; infinite where the data do not tell
    not_told: tuple[str, ...]  # keys that the data do not tell: others may take their place
    remainder: Mapping[str, float]  # root mean square of what is left, by column of the data
    data: Columns
    found: Columns  # of the fitted scene at the times of the data
    runs: int

    @property
    def deviations(self) -> dict[str, float]:
        """Standard uncertainties by key."""
        return dict(zip(self.values, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


def read_data(path: Path) -> dict[str, Array]:
    """Columns of a CSV table: `time`, and numbers by the names of steps.csv.

    Raises:
        SceneError: it cannot be read, or holds something else than numbers.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            head, *rows = [[cell.strip() for cell in row] for row in csv.reader(file) if row]
        table = np.array([[float(cell) for cell in row] for row in rows])
    except (OSError, ValueError, csv.Error) as error:
        raise SceneError(f"{path}: expected a table of numbers below a line of names: {error}") from None
    require(TIME in head and len(head) > 1, str(path), ", ".join(head), f"expected a column {TIME}, and others")
    require(len({*head}) == len(head), str(path), ", ".join(head), "expected each name once")
    require(len(table) > 0, str(path), "no rows", "expected numbers")
    require(
        len(table.T) == len(head), str(path), f"{len(table.T)} columns", f"expected one for each of {len(head)} names"
    )
    return dict(zip(head, table.T, strict=True))


@typed
def fit(
    scene: Scene, data: Columns, vary: Sequence[str], comm: Comm | None = None, tell: Callable[[str], None] = print
) -> Fit:
    """Fit numbers of a scene to data; collective.

    Args:
        scene: its numbers are what is started from.
        data: numbers over time [s], by the names of steps.csv; each column counts by its largest value.
        vary: keys of the numbers.
        comm: MPI communicator; None: all ranks.
        tell: told of each run.

    Returns:
        The numbers, with their covariance, and the fitted history beside the data.

    Raises:
        SceneError: a column or key is none, or there are fewer data than keys.
        SolverError: derivatives are lost.
    """
    columns, start, end = [name for name in data if name != TIME], scene.parameters(), scene.requested_times()[-1]
    require(TIME in data and len({*vary}) == len(vary) > 0, "fit", ", ".join(vary), f"expected {TIME}, each key once")
    for name, column in data.items():
        usable = np.shape(column) == np.shape(data[TIME]) and bool(np.isfinite(column).all())
        require(usable, f"fit.{name}", name, f"expected {len(data[TIME])} finite numbers, as many as times")
    require(min(data[TIME]) >= 0 and max(data[TIME]) <= end, "fit", max(data[TIME]), f"times lie from 0 to {end:g}")
    for name in columns:
        require_known("fit", name, scene.quantities(), "no such number in steps.csv")
    count = len(columns) * len(data[TIME])
    require(count >= len(vary), "fit", f"{count} data", f"fewer than the {len(vary)} numbers to vary")
    asked = replace(scene, sensitivity=Sensitivity(parameters=tuple(vary)), uncertainty={})
    run = _Runs(replace(asked, output=replace(asked.output, error=False)), data, columns, tuple(vary), comm, tell)
    best = least_squares(
        lambda x: run(x)[0].ravel(),
        np.ones(len(vary)),
        jac=lambda x: run(x)[1].reshape(count, len(vary)),
        bounds=(0, np.inf),
        x_scale="jac",
        xtol=CLOSE,
    )
    if not best.success:
        raise SolverError(f"fit: {best.message}")
    known = np.array([start[key] for key in vary])
    spread, not_told = _covariance(best.jac, float(best.fun @ best.fun), vary)
    rest, found = run(best.x)[0] * run.size[:, None], run.of(best.x)
    return Fit(
        scene=replace(found, sensitivity=scene.sensitivity, uncertainty=scene.uncertainty, output=scene.output),
        start={key: start[key] for key in vary},
        values=dict(zip(vary, (best.x * known).tolist(), strict=True)),
        covariance=spread * np.outer(known, known),
        not_told=not_told,
        remainder=dict(zip(columns, np.sqrt(np.mean(rest**2, axis=1)).tolist(), strict=True)),
        data=data,
        found={TIME: data[TIME]} | {name: data[name] + each for name, each in zip(columns, rest, strict=True)},
        runs=run.count,
    )


class _Runs:
    """Runs a scene with its numbers multiplied."""

    def __init__(
        self,
        scene: Scene,
        data: Columns,
        columns: Sequence[str],
        vary: tuple[str, ...],
        comm: Comm | None,
        tell: Callable[[str], None],
    ) -> None:
        self.scene, self.data, self.columns, self.vary, self.comm, self.tell = scene, data, columns, vary, comm, tell
        self.size = np.array([np.abs(data[name]).max() or 1.0 for name in columns])
        self.count = 0
        self._known: tuple[bytes, Array, Array] | None = None
        self._bodies: Bodies | None = None

    def of(self, x: Array) -> Scene:
        """The scene with its numbers multiplied by x (k,)."""
        found = self.scene
        for key, factor in zip(self.vary, x, strict=True):
            found = scaled(found, key, float(factor))
        return found

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """What is left of the data (columns, times), over their size, and its derivatives (columns, times, k)."""
        if self._known is None or self._known[0] != x.tobytes():
            self._known = (x.tobytes(), *self._run(x))
        return self._known[1], self._known[2]

    def _run(self, x: Array) -> tuple[Array, Array]:
        scene = self.of(x)
        simulation = prepare(scene, self.comm, bodies=self._bodies)
        self._bodies = simulation.bodies
        times, numbers, slopes = [0.0], [[0.0] * len(self.columns)], [np.zeros((len(self.columns), len(x)))]  # at rest
        for step in simulation.steps():
            now, each = values(step), slopes_of(step)
            if not each:
                raise SolverError(f"fit: t = {step.time:g}: there are no derivatives")
            for name in self.columns:
                require(name in each, "fit", name, "has no derivative here")
            if step.time == 0:
                times, numbers, slopes = [], [], []
            times.append(step.time)
            numbers.append([now[name] for name in self.columns])
            slopes.append(np.array([[np.mean(each[name][key]) for key in self.vary] for name in self.columns]))
        at = self.data[TIME]

        def between(columns: Array) -> Array:
            """Values at the times of the data (columns, times), of those at the steps (times, columns)."""
            return np.array([np.interp(at, times, column) for column in columns.T])

        known = np.array([self.scene.parameters()[key] for key in self.vary])
        wanted = np.array([self.data[name] for name in self.columns])
        left = (between(np.array(numbers)) - wanted) / self.size[:, None]
        turned = np.stack([between(each) for each in np.moveaxis(np.array(slopes), 2, 0)], axis=2)
        self.count += 1
        said = ", ".join(f"{key} = {value:.6g}" for key, value in zip(self.vary, x * known, strict=True))
        self.tell(f"run {self.count}: {said}, {math.sqrt(np.mean(left**2)):.2e} left")
        return left, turned * known / self.size[:, None, None]


def _covariance(J: Array, squares: float, vary: Sequence[str]) -> tuple[Array, tuple[str, ...]]:
    """Covariance (k, k) of factors, and the keys of those that the data do not tell.

    Args:
        J: derivatives (data, k) of what is left over the size of the data: 1 where a number in proportion tells all.
        squares: of what is left, their sum.
    """
    _, sizes, turn = np.linalg.svd(J, full_matrices=False)
    sure = sizes > CLOSE * sizes.max(initial=1.0)
    variance = squares / max(len(J) - np.count_nonzero(sure), 1)
    spread = (turn[sure].T / sizes[sure] ** 2) @ turn[sure] * variance
    lost = (np.abs(turn[~sure]) > SLIGHT).any(axis=0) | (np.diag(spread) > 1)  # one may be twice as large as well
    spread[lost], spread[:, lost] = np.nan, np.nan
    spread[lost, lost] = np.inf
    return spread, tuple(key for key, off in zip(vary, lost, strict=True) if off)
