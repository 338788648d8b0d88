"""One run of a study: the rung of the ladder that it solves, and the record of how it ended and what it took."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Any, Literal
from urllib.parse import quote

import numpy as np

from stickslip.geometry.errors import SceneError, prefixed
from stickslip.solvers.accuracy.budget import budget_of
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Output
from stickslip.workflows.scene_file.read import with_method

PHASES = ("mesh", "assemble", "prepare", "iterate", "output")
RATIO = sqrt(2)  # between the cells of neighbouring levels


@dataclass(frozen=True, order=True)
class Rung:
    """Level 0 has the mesh sizes of the scene; each further level divides them by RATIO."""

    order: Literal[1, 2]
    method: str  # name, or name and keys, see `with_method`
    level: int
    tolerance: float

    @property
    def factor(self) -> float:
        """Mesh size over that of the scene."""
        return float(RATIO**-self.level)

    @property
    def chain(self) -> tuple[int, str]:
        """Order and method, which stay fixed while the mesh is refined."""
        return self.order, self.method

    @property
    def name(self) -> str:
        """Name of its file, different for each rung."""
        method = quote(self.method, safe="+=")
        return f"order{self.order}_{method}_level{self.level:+03d}_{self.tolerance:.0e}"

    def scene(self, scene: Scene) -> Scene:
        """The scene as this rung solves it, without pictures.

        Raises:
            SceneError: its geometry offers no size to refine, or refuses this one.
        """
        with prefixed("geometry"):
            geometry = replace(scene.geometry.refined(self.factor), order=self.order)
        solver = replace(with_method(scene.solver, self.method), tolerance=self.tolerance)
        return replace(scene, geometry=geometry, solver=solver, output=Output(pictures=False, error=False))


def mesh_size(scene: Scene) -> float:
    """Edge length where bodies touch [m].

    Raises:
        SceneError: the geometry is a file that says none.
    """
    found = scene.geometry.contact_mesh_size or scene.geometry.mesh_size
    if found is None:
        raise SceneError("geometry.mesh_size: missing, there is none to refine")
    return float(found)


@dataclass(frozen=True, kw_only=True)
class Run:
    """Record of one run; only a run with status `converged` has quantities."""

    rung: Rung
    status: str  # converged, not_converged, no_equilibrium, refused, out_of_memory, out_of_time, failed
    number: int = 0  # position in the order of the runs
    sentence: str = ""  # what went wrong
    spent: float = 0.0  # of the budget: start of the process and compiling of forms included [s]
    h: float = 0.0  # edge length where bodies touch [m]
    phases: Mapping[str, float] = field(default_factory=dict)  # wall time [s]
    start: float = 0.0  # of the process, and its end [s]
    estimate: float | None = None  # of the errors as `stickslip run` makes it [s]; None: not measured
    cpu: float = 0.0  # in those phases [s]; less than their sum: others used the core too
    memory: float = 0.0  # peak of the process [bytes]
    dofs: int = 0
    contact_points: int = 0
    volume_solves: int = 0
    linear_iterations: int = 0
    residual: float | None = None  # the largest of the steps
    law_error: float | None = None  # what the method's approximation of the laws leaves, relative, energy norm
    compiled: bool = False  # forms were compiled during the run: its seconds do not count
    quantities: Mapping[str, float] = field(default_factory=dict)
    time_steps: Mapping[str, float] = field(default_factory=dict)  # errors of the time steps; empty: not measured

    @property
    def converged(self) -> bool:
        return self.status == "converged"

    @property
    def seconds(self) -> float:
        """Wall time of all phases [s]."""
        return sum(self.phases.values())

    @property
    def waited(self) -> float:
        """What a user waits for [s]: also for the start of the program and the estimate of errors."""
        return self.seconds + self.start + (self.estimate or 0.0)


def with_estimates(runs: Sequence[Run]) -> list[Run]:
    """The runs; where the estimate of errors was not measured it takes the share of the finest on which it was.

    A run gives it as many seconds as the budget of errors has by default.
    """
    known = [run for run in runs if run.estimate is not None and run.seconds > 0]
    if not known:
        return [*runs]
    last = max(known, key=lambda run: (run.rung.level, run.seconds))
    share = (last.estimate or 0.0) / last.seconds
    budgets = [budget_of(Output(), run.seconds) or np.inf for run in runs]
    return [
        replace(run, estimate=min(share * run.seconds, budget)) if run.converged and run.estimate is None else run
        for run, budget in zip(runs, budgets, strict=True)
    ]


def from_plain(content: Mapping[str, Any]) -> Run:
    """The run that `asdict` has made plain."""
    return Run(**{**content, "rung": Rung(**content["rung"])})
