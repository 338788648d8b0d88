"""One run: solve the steps, write each as it is accepted, audit what was written, put the results in place."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from geometry.errors import MachineError
from solvers.parallel.serialise import serialise
from solvers.results.linear_reference import LinearReference, linear_reference
from solvers.results.step_result import StepResult
from solvers.scene.scene import Scene
from solvers.simulation.checkpoint import Checkpoints
from solvers.simulation.simulation import Simulation, prepare
from solvers.stepping.history import HistoryRow
from solvers.stepping.stepper import NoEquilibriumError, StepError
from workflows.pictures.draw import draw_wanted
from workflows.run.audited import audited
from workflows.run.collective import raise_together
from workflows.run.doubts import Smallness, coarse_steps
from workflows.run.folder import MARK, ResultsFolder
from workflows.run.interrupt import Interrupt
from workflows.run.mesh_report import report_mesh
from workflows.run.resume import BEGUN, VERSIONS, Going, Left, cut_back, find_left
from workflows.run.run_log import RunLog
from workflows.run.watch import Watch, tell
from workflows.scene_file.identity import DECIDES_NOTHING, identity
from workflows.writers.by_time import by_time
from workflows.writers.learnt import LearntFiles
from workflows.writers.result import Outcome, summary, write_json, write_result
from workflows.writers.steps import write_step
from workflows.writers.tables import (
    OTHERS,
    Table,
    bring_to_disk,
    contact_table,
    history_of,
    tables_of,
    write_again,
    write_tables,
)
from workflows.writers.xdmf import FieldFiles

log = logging.getLogger(__name__)


@dataclass
class Run:
    """The state of a run between its phases."""

    simulation: Simulation
    folder: Path
    began: float
    interrupt: Interrupt
    left: Left = Left()  # by the run that this one resumes
    steps: list[StepResult] = field(init=False)  # the last one with its fields, the others without
    fields: FieldFiles = field(init=False)
    learnt: LearntFiles = field(init=False)
    smallness: Smallness = field(init=False)

    def __post_init__(self) -> None:
        """Collective."""
        going, self.steps = self.left.going, list(self.left.steps)
        self._checkpoints = Checkpoints(self.simulation.stepper)
        self._state, self._total = None, 0.0
        self.fields = FieldFiles(self.folder, self.simulation.data, self.simulation.scene.output.every)
        self.fields.know([step.time for step in self.steps])
        last = going.learnt if going else ""
        self.learnt = LearntFiles(self.folder, self.simulation.mesh.comm, self.left.before, last)
        if self.rank == 0:
            self.smallness = Smallness(self.simulation.data)
        if going:
            self._state, usable = self._checkpoints.put_back(going.checkpoint, self.learnt.read())
            if self.left.learnt and not usable:
                log.info("other ranks than before: what the method had learnt is left out")
            self.simulation.seconds.add(going.seconds)
            self._total = going.total
            if self.rank == 0:
                self.smallness.spread = going.spread

    @property
    def rank(self) -> int:
        return int(self.simulation.mesh.comm.rank)

    def march(self, watch: Watch) -> tuple[str, str]:
        """Solve and write step by step: status and what to tell the user."""
        comm = self.simulation.mesh.comm

        def on_iteration(row: HistoryRow) -> None:
            self.on_rank_0(lambda: watch.on_iteration(row))
            self.interrupt.check(comm)

        try:
            marching = self.simulation.steps(on_iteration, len(self.steps), self._state)
            for index, step in enumerate(marching, start=len(self.steps) + 1):
                began = clock.perf_counter()
                self._write(index, step)
                self.steps = [*self.steps[:-1], *(s.without_fields() for s in self.steps[-1:]), step]
                self._show(index, step, watch)
                self.simulation.seconds.output += clock.perf_counter() - began
        except StepError as error:
            log.error("%s", error)
            written = len(error.last_good.history) if error.last_good else 0  # with the last good substep
            rows = [row.as_tuple() for row in error.history[written:]]
            failed = history_of(len(self.steps) + (not written), rows)
            self.on_rank_0(lambda: write_tables(self.folder, [failed]))
            return "no_equilibrium" if isinstance(error, NoEquilibriumError) else "not_converged", str(error)
        except KeyboardInterrupt:
            count, by = len(self.simulation.scene.requested_times()), self.interrupt.by or "the user"
            return "interrupted", f"stopped by {by} after {len(self.steps)} of {count} steps"
        return "converged", ""

    def _write(self, index: int, step: StepResult) -> None:
        """Tables and step file: when this returns, the step is safe; all ranks fail or none."""
        accepted = self.simulation.stepper.reported
        assert accepted is not None
        checkpoint = self._checkpoints.take(accepted)
        learnt = self.learnt.write(index, self._checkpoints.learnt())

        def write() -> None:
            self.smallness.see(step)
            write_tables(self.folder, _tables(self.simulation, index, step))
            going = Going(
                checkpoint=checkpoint,
                seconds=self.simulation.seconds,
                total=self._seconds(),
                spread=self.smallness.spread,
                learnt=learnt,
            )
            write_step(self.folder, index, step, serialise(going))
            self.learnt.forget()

        self.on_rank_0(write)

    def _seconds(self) -> float:
        """Of all processes that worked on this run."""
        return self._total + clock.perf_counter() - self.began

    def _show(self, index: int, step: StepResult, watch: Watch) -> None:
        def show() -> None:
            self.fields.add(index, step.time)
            watch.on_step(step)

        self.on_rank_0(show)

    def finish(self, status: str) -> dict[str, Any]:
        """Audit, result.json, pictures; one that was told to stop has time for neither audit nor pictures."""
        seconds, scene, began = self.simulation.seconds, self.simulation.scene, clock.perf_counter()
        stopped = status == "interrupted"
        audits = [] if stopped else audited(self.simulation, self.folder, self.steps)
        reference: LinearReference | None = None

        def content() -> dict[str, Any]:
            return summary(self.simulation, status, self.steps, audits, self._seconds(), reference)

        self.on_rank_0(lambda: bring_to_disk(self.folder, _table_names(scene)))
        self.on_rank_0(lambda: write_result(self.folder, content()))  # before the pictures: they can fail
        self.on_rank_0(self.fields.finish)
        if self.steps and not stopped:
            self.on_rank_0(lambda: draw_wanted(self.folder, scene, self.simulation.data, self.steps))
        seconds.output += clock.perf_counter() - began
        if scene.output.linear_reference and not stopped:
            reference = linear_reference(self.simulation.system)
        final = content()
        self.on_rank_0(lambda: write_result(self.folder, final))
        if status == "converged":
            self.on_rank_0(self.learnt.remove)
        return final

    def warnings(self) -> tuple[str, ...]:
        """What the answer gives reason to doubt; rank 0 only."""
        return self.smallness.warnings() + coarse_steps(self.steps, self.simulation.system.contacts)

    def on_rank_0(self, act: Callable[[], object]) -> None:
        """Act on rank 0; if that fails, every rank raises the same error."""
        raise_together(self.simulation.mesh.comm, act)


def run(
    scene: Scene, folder: str | Path, watch: Watch | None = None, resume: bool = False
) -> tuple[Outcome, dict[str, Any]]:
    """Run a scene and leave its results in `folder`; collective.

    Args:
        resume: go on where an earlier run of the same scene was stopped there, if there is one.

    Returns:
        How it ended, and the content of result.json.

    Raises:
        SceneError, GeometryError: known before solving; nothing is written.
        MachineError: the results cannot be written, or a step to resume from is damaged.
    """
    from mpi4py import MPI

    comm, began, watch = MPI.COMM_WORLD, clock.perf_counter(), watch or Watch()
    place, left = Path(folder), Left()
    results: list[ResultsFolder] = []
    raise_together(comm, lambda: results.append(ResultsFolder(place)))

    def look() -> None:
        nonlocal left
        if resume:
            left = find_left(results[0], scene)
        else:
            results[0].refuse_to_lose()

    try:
        raise_together(comm, look)
        left = left.shared(comm)
        if left.finished is not None:
            return Outcome("converged", left.notes[0], place), left.finished
        return _solve(scene, place, results, left, watch, began)
    finally:
        for held in results:
            held.release()


def _solve(
    scene: Scene, place: Path, results: list[ResultsFolder], left: Left, watch: Watch, began: float
) -> tuple[Outcome, dict[str, Any]]:
    """Prepare, march, finish; `results` on rank 0 only."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    with Interrupt() as interrupt:
        simulation = prepare(scene, comm, left.going.checkpoint.reached if left.going else None)
        interrupt.check(comm)
        system = simulation.system
        report = report_mesh(scene, simulation.mesh, system.nodes.total, system.contacts)
        raise_together(comm, lambda: _open(results[0], simulation, left))
        work = place.with_name(f".{place.name}.running")
        with ExitStack() as stack:
            raise_together(comm, lambda: stack.enter_context(RunLog(work / MARK)))
            notes = results[0].notes if results else ()
            raise_together(comm, lambda: tell(simulation, report, replace(left, notes=notes + left.notes), watch))
            working = Run(simulation, work, began, interrupt, left)
            try:
                status, sentence = working.march(watch)
                doubts = working.warnings() if comm.rank == 0 else ()
                for warning in doubts:
                    log.warning("%s", warning)
                content = working.finish(status)
            except MachineError as error:
                kept = f"; {len(working.steps)} steps are kept, go on with --resume" if working.steps else ""
                raise MachineError(f"{error}{kept}") from None
        raise_together(comm, lambda: results[0].finish())
    return Outcome(status, sentence, place, doubts), content


def _open(results: ResultsFolder, simulation: Simulation, left: Left) -> None:
    """The working folder: a new one that says what scene it is for, or the one to go on in."""
    mesh = FieldFiles(results.work, simulation.data).checksum
    if left.folder is None:
        folder = results.start()
        begun = {"scene": identity(simulation.scene, DECIDES_NOTHING), "mesh": mesh}
        write_json(folder / BEGUN, begun | VERSIONS)
    elif left.mesh != mesh:
        raise MachineError(
            f"{results.target}: gmsh meshes this scene differently now; leave out --resume, and choose another folder"
        )
    else:
        folder = results.take_up(left.folder)
        cut_back(folder, left)
        steps = (_tables(simulation, index, step) for index, step in enumerate(left.steps, start=1))
        write_again(folder, steps, _table_names(simulation.scene))


def _tables(simulation: Simulation, index: int, step: StepResult) -> Iterator[Table]:
    """What a step adds to the tables."""
    yield from tables_of(index, simulation.data, step)
    yield by_time(index, simulation.scene, step)


def _table_names(scene: Scene) -> list[str]:
    return [*map(contact_table, scene.contacts), *OTHERS]
