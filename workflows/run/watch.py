"""What a run tells while it works, to its log and to whoever watches."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

from solvers.results.step_result import StepResult
from solvers.simulation.plan import warnings
from solvers.simulation.simulation import Simulation
from solvers.stepping.history import HistoryRow
from workflows.run.folder import at_work
from workflows.run.mesh_report import MeshReport
from workflows.run.resume import Left

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Watch:
    """What a run tells while it works; rank 0 only."""

    on_mesh: Callable[[MeshReport], None] = lambda report: None
    on_prepared: Callable[[Simulation], None] = lambda simulation: None
    on_iteration: Callable[[HistoryRow], None] = lambda row: None
    on_step: Callable[[StepResult], None] = lambda step: None
    on_resume: Callable[[int, float], None] = lambda done, time: None  # after so many steps
    on_note: Callable[[str], None] = lambda line: None


def tell(simulation: Simulation, report: MeshReport, left: Left, watch: Watch) -> None:
    """What there is to say before the first step; rank 0 only."""
    log.info("%s", at_work())
    for warning in warnings(simulation.scene):
        log.warning("%s", warning)
    for line in report.lines():
        log.info("%s", line)
    for line in report.warnings():
        log.warning("%s", line)
    watch.on_mesh(report)
    watch.on_prepared(simulation)
    for line in left.notes:
        log.warning("%s", line)
        watch.on_note(line)
    if left.folder is not None:
        time = left.steps[-1].time if left.steps else 0.0
        log.info("resumed after step %d, t = %g", len(left.steps), time)
        watch.on_resume(len(left.steps), time)
