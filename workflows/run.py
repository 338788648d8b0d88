"""One run: solve the steps, write each as it is accepted, audit what was written, put the results in place."""

from __future__ import annotations

import logging
import sys
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from geometry.errors import MachineError, StickslipError
from solvers.audit import Audit, Auditor, Record
from solvers.history import HistoryRow
from solvers.linear_reference import LinearReference, linear_reference
from solvers.nouns.scene import Scene
from solvers.plan import warnings
from solvers.simulation import Simulation, prepare
from solvers.step_result import StepResult
from solvers.stepping import NoEquilibriumError, StepError
from workflows.folder import MARK, ResultsFolder
from workflows.interrupt import Interrupt
from workflows.mesh_report import MeshReport, report_mesh
from workflows.results import Outcome, summary, write_result
from workflows.small import Smallness
from workflows.writers.by_time import write_by_time
from workflows.writers.steps import read_step, step_name, write_step
from workflows.writers.tables import write_history, write_tables
from workflows.writers.xdmf import FieldFiles

log = logging.getLogger(__name__)
LOGGERS = ("geometry", "solvers", "workflows")


@dataclass(frozen=True)
class Watch:
    """What a run tells while it works; rank 0 only."""

    on_mesh: Callable[[MeshReport], None] = lambda report: None
    on_prepared: Callable[[Simulation], None] = lambda simulation: None
    on_iteration: Callable[[HistoryRow], None] = lambda row: None
    on_step: Callable[[StepResult], None] = lambda step: None


@dataclass
class Run:
    """The state of a run between its phases."""

    simulation: Simulation
    folder: Path
    began: float
    interrupt: Interrupt
    steps: list[StepResult] = field(default_factory=list)  # the last one with its fields, the others without
    fields: FieldFiles = field(init=False)
    smallness: Smallness = field(init=False)

    def __post_init__(self) -> None:
        self.fields = FieldFiles(self.folder, self.simulation.data, self.simulation.scene.output.every)
        if self.rank == 0:
            self.smallness = Smallness(self.simulation.data)

    @property
    def rank(self) -> int:
        return int(self.simulation.mesh.comm.rank)

    def march(self, watch: Watch) -> tuple[str, str]:
        """Solve and write step by step: status and what to tell the user."""
        tell, comm = watch if self.rank == 0 else Watch(), self.simulation.mesh.comm

        def on_iteration(row: HistoryRow) -> None:
            tell.on_iteration(row)
            self.interrupt.check(comm)

        try:
            for index, step in enumerate(self.simulation.steps(on_iteration), start=1):
                began = clock.perf_counter()
                self.steps = [*(s.without_fields() for s in self.steps), step]
                self._write(index, step)
                tell.on_step(step)
                self.simulation.seconds.output += clock.perf_counter() - began
        except StepError as error:
            log.error("%s", error)
            written = len(error.reached.history) if error.reached else 0  # with the last good substep
            rows = [row.as_tuple() for row in error.history[written:]]
            self.on_rank_0(lambda: write_history(self.folder, len(self.steps) + (not written), rows))
            return "no_equilibrium" if isinstance(error, NoEquilibriumError) else "not_converged", str(error)
        except KeyboardInterrupt:
            return "interrupted", "stopped by the user; the steps so far are kept"
        return "converged", ""

    def _write(self, index: int, step: StepResult) -> None:
        """Tables, step file, and the XDMF that shows it; all ranks fail or none."""

        def write() -> None:
            write_tables(self.folder, index, self.simulation.data, step)
            write_by_time(self.folder, index, self.simulation.scene, step)
            write_step(self.folder, index, step)
            self.fields.add(index, step.time)
            self.smallness.see(step)

        self.on_rank_0(write)

    def audit(self) -> list[Audit]:
        """Every step against equilibrium and the laws, from its file."""
        if not self.steps:
            return []
        began = clock.perf_counter()
        auditor = Auditor(self.simulation.scene, self.simulation.mesh)
        dim = self.simulation.mesh.dim
        found = []
        for index, step in enumerate(self.steps, start=1):
            stored = read_step(self.folder / step_name(index))
            found.append(
                auditor(
                    Record(
                        time=stored.time,
                        displacement=stored.displacement[:, :dim],
                        p=stored.p,
                        w=stored.w,
                        reference=stored.reference,
                        driven=stored.driven,
                        searched=stored.searched,
                        p_ref=stored.p_ref,
                        u_ref=stored.u_ref,
                        external_work=step.energy.external,
                    )
                )
            )
        self.simulation.seconds.output += clock.perf_counter() - began
        return found

    def finish(self, status: str) -> dict[str, Any]:
        """Audit, result.json, pictures."""
        audits, began = self.audit(), clock.perf_counter()
        seconds, scene = self.simulation.seconds, self.simulation.scene
        reference: LinearReference | None = None

        def content() -> dict[str, Any]:
            total = clock.perf_counter() - self.began
            return summary(self.simulation, status, self.steps, audits, total, reference)

        self.on_rank_0(lambda: write_result(self.folder, content()))  # before the pictures: they can fail
        self.on_rank_0(self.fields.finish)
        if self.steps:
            self.on_rank_0(lambda: _draw(self.folder, self.simulation, self.steps, status != "interrupted"))
        seconds.output += clock.perf_counter() - began
        if scene.output.linear_reference and status != "interrupted":
            reference = linear_reference(self.simulation.system)
        final = content()
        self.on_rank_0(lambda: write_result(self.folder, final))
        return final

    def on_rank_0(self, act: Callable[[], object]) -> None:
        """Act on rank 0; if that fails, every rank raises the same error."""
        raise_together(self.simulation.mesh.comm, act)


def run(scene: Scene, folder: str | Path, watch: Watch | None = None) -> tuple[Outcome, dict[str, Any]]:
    """Run a scene and leave its results in `folder`; collective.

    Returns:
        How it ended, and the content of result.json.

    Raises:
        SceneError, GeometryError: known before solving; nothing is written.
        MachineError: the results cannot be written.
    """
    from mpi4py import MPI

    comm, began = MPI.COMM_WORLD, clock.perf_counter()
    results: list[ResultsFolder] = []
    raise_together(comm, lambda: results.append(ResultsFolder(Path(folder))))
    with Interrupt() as interrupt:
        simulation = prepare(scene, comm)
        interrupt.check(comm)
        watch = watch or Watch()
        system = simulation.system
        report = report_mesh(scene, simulation.mesh, system.nodes.total, system.contacts)
        work = Path(folder).with_name(f".{Path(folder).name}.running")
        raise_together(comm, lambda: results[0].start())
        handler = _log_to(work / MARK) if comm.rank == 0 else None
        try:
            if comm.rank == 0:
                for warning in warnings(scene):
                    log.warning("%s", warning)
                _tell(report, watch)
                watch.on_prepared(simulation)
            going = Run(simulation, work, began, interrupt)
            status, sentence = going.march(watch)
            doubts = going.smallness.warnings() if comm.rank == 0 else ()
            for warning in doubts:
                log.warning("%s", warning)
            content = going.finish(status)
        finally:
            if handler is not None:
                _stop_log(handler)
        raise_together(comm, lambda: results[0].finish())
    return Outcome(status, sentence, Path(folder), doubts), content


def _tell(report: MeshReport, watch: Watch) -> None:
    for line in report.lines():
        log.info("%s", line)
    for line in report.warnings():
        log.warning("%s", line)
    watch.on_mesh(report)


def raise_together(comm: Any, act: Callable[[], object]) -> None:
    """Run `act` on rank 0; its error, if any, is raised on every rank."""
    failure: StickslipError | None = None
    mistake: Exception | None = None
    if comm.rank == 0:
        try:
            act()
        except StickslipError as error:
            failure = error
        except OSError as error:
            failure = MachineError(f"{error.filename or 'results'}: {error.strerror or error}")
        except Exception as error:  # a mistake of ours: rank 0 shows it, the others must not wait for ever
            failure, mistake = StickslipError(f"rank 0 failed: {error}"), error
    failure = comm.bcast(failure)
    if mistake is not None:
        raise mistake
    if failure is not None:
        raise failure


def _draw(folder: Path, simulation: Simulation, steps: Sequence[StepResult], animated: bool) -> None:
    """Draw what is wanted; a machine that cannot is told so, its results stand."""
    scene, wanted = simulation.scene, simulation.scene.output
    try:
        if wanted.pictures:
            from workflows.pictures import draw, draw_course

            draw(folder, simulation.data, steps[-1], scene.title)
            draw_course(folder, scene)
        if wanted.animation == "gif" and animated:
            from workflows.writers.animation import animate

            animate(folder, scene, simulation.data, len(steps))
    except (ImportError, RuntimeError) as error:
        log.warning("no pictures: %s", error)
        print(f"stickslip: no pictures could be drawn: {error}", file=sys.stderr)


def _log_to(path: Path) -> logging.Handler:
    handler = logging.FileHandler(path, encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(name)s %(levelname)s %(message)s"))
    for name in LOGGERS:
        logging.getLogger(name).addHandler(handler)
        logging.getLogger(name).setLevel(logging.INFO)
    return handler


def _stop_log(handler: logging.Handler) -> None:
    for name in LOGGERS:
        logging.getLogger(name).removeHandler(handler)
    handler.close()
