"""A run tells how it goes while it works: to run.log, and to whoever watches."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from stickslip.geometry.dolfinx_versions import CACHE_NOTE
from stickslip.geometry.errors import printable
from stickslip.solvers.parallel.counters import Clock
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.simulation.plan import warnings
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.workflows.run.folder import at_work
from stickslip.workflows.run.mesh_report import MeshReport
from stickslip.workflows.run.ranks import KEPT
from stickslip.workflows.run.resume import EarlierRun

LOGGERS = ("stickslip",)
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Watch:
    """Callbacks of whoever watches; rank 0 only."""

    on_mesh: Callable[[MeshReport], None] = lambda report: None
    on_prepared: Callable[[Simulation], None] = lambda simulation: None
    on_iteration: Callable[[HistoryRow], None] = lambda row: None
    on_step: Callable[[StepResult], None] = lambda step: None
    on_estimate: Callable[[str], None] = lambda line: None  # all steps are solved; how it goes on with their errors
    on_resume: Callable[[int, float], None] = lambda done, time: None  # number of steps that are there, and their end
    on_note: Callable[[str], None] = lambda line: None
    on_phase: Callable[[Clock, str, str], None] = lambda clock, phase, part: None  # and part that begin
    answer: str | None = None  # what is said to Ctrl-C, see `Interrupt`
    kept: str = KEPT  # likewise
    on_round: Callable[[str], None] = lambda line: None  # of rounds towards an accuracy: a line on each


def tell(simulation: Simulation, report: MeshReport, earlier: EarlierRun, watch: Watch) -> None:
    """Say what there is to say before the first step; rank 0 only."""
    log.info("%s", at_work())
    for line in report.lines():
        log.info("%s", line)
    log.info("memory: about %.2g GB at the most, of rank 0", simulation.demand.peak / 1e9)
    for line in foreseen(simulation, report):
        log.warning("%s", line)
    watch.on_mesh(report)
    watch.on_prepared(simulation)
    for line in filter(None, (CACHE_NOTE, *earlier.notes)):
        log.warning("%s", line)
        watch.on_note(line)
    if earlier.folder is not None:
        time = earlier.steps[-1].time if earlier.steps else 0.0
        log.info("resumed after step %d, t = %g", len(earlier.steps), time)
        watch.on_resume(len(earlier.steps), time)


def foreseen(simulation: Simulation, report: MeshReport) -> tuple[str, ...]:
    """Warnings of before the first step."""
    return (*warnings(simulation.scene), *report.warnings(), *filter(None, [simulation.short]))


class Onward(logging.Handler):
    """Passes records on to whoever listens above, from the level on that the loggers have had by themselves."""

    def emit(self, record: logging.LogRecord) -> None:
        logging.getLogger().handle(record)


class RunLog(logging.FileHandler):
    """Context in which the lines of the program's own loggers go to a file; a resumed run goes on in the same file.

    A script that calls `run` hears no more of them than it has asked for: a library may have made the root speak.
    Nothing is said here of a full disk: the step that cannot be written says it.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, encoding="utf-8")
        self._former: dict[str, tuple[int, bool]] = {}  # of the loggers: level, and whether they propagate
        self._onward = Onward()
        self.setFormatter(logging.Formatter("%(asctime)s %(name)s %(levelname)s %(message)s"))

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))

    def __enter__(self) -> RunLog:
        for name in LOGGERS:
            logger = logging.getLogger(name)
            self._former[name] = logger.level, logger.propagate
            if logger.propagate:
                self._onward.setLevel(logger.getEffectiveLevel())
                logger.addHandler(self._onward)
                logger.propagate = False
            logger.addHandler(self)
            logger.setLevel(logging.INFO)
        return self

    def __exit__(self, *error: object) -> None:
        for name in LOGGERS:
            logger = logging.getLogger(name)
            logger.removeHandler(self)
            logger.removeHandler(self._onward)
            level, logger.propagate = self._former[name]
            logger.setLevel(level)
        with suppress(OSError):
            self.close()

    def handleError(self, record: logging.LogRecord) -> None:
        """Say nothing."""
