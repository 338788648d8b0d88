"""One run: solve the steps, write each as it is accepted, audit what was written, put the results in place."""

from __future__ import annotations

import logging
import re
import time as clock
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from operator import methodcaller
from pathlib import Path
from typing import Any

from stickslip.geometry.errors import MachineError, SceneError
from stickslip.geometry.mesh_sizes import SizeField
from stickslip.solvers.accuracy.budget import Coarser
from stickslip.solvers.parallel.counters import Clock, Counters, Row
from stickslip.solvers.parallel.serialise import serialise
from stickslip.solvers.results.linear_reference import LinearReference, linear_reference
from stickslip.solvers.results.step_result import Errors, StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.checkpoint import Checkpoints
from stickslip.solvers.simulation.simulation import Bodies, Simulation, prepare
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import NoEquilibriumError, StepError
from stickslip.workflows.formats.files import write_json
from stickslip.workflows.formats.marker import LOG, is_marked
from stickslip.workflows.formats.mesh_file import mesh_checksum
from stickslip.workflows.formats.results import profile_lines
from stickslip.workflows.formats.steps import step_files, write_light, write_step
from stickslip.workflows.run import resume as resuming
from stickslip.workflows.run.audit import Audited, audit_files, audit_steps
from stickslip.workflows.run.folder import BEGUN, FORMER, ResultsFolder, work_of
from stickslip.workflows.run.mesh_report import report_mesh
from stickslip.workflows.run.neglect import Neglected, neglected
from stickslip.workflows.run.ranks import Interrupt, all_act, raise_together
from stickslip.workflows.run.result import Outcome, summary, write_result
from stickslip.workflows.run.warnings import Fields, Seen, beyond_linear, doubts, reasons_to_doubt
from stickslip.workflows.run.watch import RunLog, Watch, foreseen, tell
from stickslip.workflows.scene_file.identity import DECIDES_NOTHING, identity
from stickslip.workflows.writers.writer import Ended, Job, Turn, Writer, wanted

BEFORE = (Turn.BEFORE,)  # the run's own file is safe
AFTER = (Turn.AFTER, Turn.LAST)
log = logging.getLogger(__name__)
Keep = Callable[[Simulation, Sequence[StepResult], Sequence[Errors]], bool]


class Outputs:
    """All writers that a scene asks for; every method is collective.

    Raises:
        MachineError: on every rank, from any method: one writer cannot write.
    """

    def __init__(self, job: Job) -> None:
        self._comm, self._writers = job.comm, [kind(job) for kind in wanted(job.scene)]
        self._clock = job.simulation.clock if job.simulation else Clock()

    @property
    def names(self) -> list[str]:
        """Names of the files that the writers will make, see `Writer.names`."""
        return [name for writer in self._writers for name in writer.names()]

    def __call__(self, act: Callable[[Writer], None], turns: Sequence[Turn] = tuple(Turn)) -> None:
        """Have those whose turn it is act."""
        for writer in self._writers:
            if writer.turn in turns:
                with self._clock.phase("output", part_of(writer)):
                    (all_act if writer.collective else raise_together)(self._comm, partial(act, writer))


def part_of(writer: Writer) -> str:
    """Its name in the profile: that of its class in words.

    >>> from stickslip.workflows.writers.tables import StepsTable
    >>> part_of(StepsTable.__new__(StepsTable))
    'steps table'
    """
    return re.sub(r"\B([A-Z])", r" \1", type(writer).__name__).lower()


class Run:
    """A scene on its way from step to step, from the first one or from where an earlier run was stopped."""

    def __init__(
        self,
        simulation: Simulation,
        outputs: Outputs,
        place: Path,
        name: str,
        earlier: resuming.EarlierRun,
        interrupt: Interrupt,
    ) -> None:
        """Collective.

        Args:
            place: where the results will stand.
            name: of the run, see `run_of`.
        """
        folder = work_of(place)
        self._place, self._name = place, name
        self._simulation, self._outputs, self._folder, self._interrupt = simulation, outputs, folder, interrupt
        self._checkpoints = Checkpoints(simulation.stepper)
        self._learnt = resuming.LearntFiles(
            folder, simulation.mesh.comm, earlier.learnt_before, earlier.last.learnt if earlier.last else ""
        )
        self._light: resuming.RunCheckpoint | None = None  # of the last step, if its file is a light one
        self._state: State | None = None  # that the last step has left
        self.steps = list(earlier.steps)  # the last one with its fields on rank 0, the others without
        self._errors: tuple[Errors, ...] | None = None  # of the numbers of each step; None: not estimated
        self._coarser: Coarser | None = None  # its steps on longer cells
        self._choice = earlier.choice
        seen = Seen()
        if earlier.last:
            self._state, usable = self._checkpoints.put_back(earlier.last.checkpoint, self._learnt.read())
            if earlier.learnt and not usable:
                log.info("other ranks than before: what the method had learnt is left out")
            simulation.clock.add(earlier.last.spent)
            seen = earlier.last.seen
        if simulation.mesh.comm.rank == 0:  # where the mesh and the displacements are
            start = self.steps[-1].displacement if self.steps else None
            self._fields = Fields(simulation.problem, simulation.data, simulation.system.contacts, seen, start)

    def march(self, watch: Watch) -> tuple[str, str]:
        """Solve and write step by step: status, and what to tell the user."""
        ended = self._march(watch)
        if self._light is not None:
            with self._simulation.clock.phase("output", "step files"):
                self._store(len(self.steps), self.steps[-1], self._light)
        return ended

    def _march(self, watch: Watch) -> tuple[str, str]:
        comm = self._simulation.mesh.comm

        def on_iteration(row: HistoryRow) -> None:
            self._on_rank_0(partial(watch.on_iteration, row))
            self._interrupt.check(comm)

        try:
            marching = self._simulation.steps(on_iteration, len(self.steps), self._state)
            for index, step in enumerate(marching, start=len(self.steps) + 1):
                with self._simulation.clock.phase("output"):
                    self._write(index, step)
                    self.steps = [*self.steps[:-1], *(s.without_fields() for s in self.steps[-1:]), step]
                    self._outputs(methodcaller("step", index, step), AFTER)
                    self._on_rank_0(partial(watch.on_step, step))
            if self._simulation.scene.output.error:
                self._estimate(watch)
        except StepError as error:
            log.error("%s", error)
            written = len(error.last_good.history) if error.last_good else 0  # with the last good substep
            attempts = [row.as_tuple() for row in error.history[written:]]
            failed = len(self.steps) + (not written)
            self._outputs(methodcaller("failed", failed, attempts))
            return "no_equilibrium" if isinstance(error, NoEquilibriumError) else "not_converged", str(error)
        except KeyboardInterrupt:
            return self._stopped
        return "converged", ""

    def _estimate(self, watch: Watch) -> None:
        """Find the errors of all numbers, as far as they are paid for; what is there is kept where that is stopped."""

        def tell(line: str) -> None:
            self._on_rank_0(partial(watch.on_estimate, line))

        comm, choice = self._simulation.mesh.comm, self._choice
        tell("estimating the error")
        estimates = self._simulation.estimates(self.steps, lambda row: self._interrupt.check(comm), tell)
        try:
            if choice is None or choice.asked != estimates.choice.asked:
                choice = estimates.choose()
                self._on_rank_0(partial(resuming.note_choice, self._folder, choice))
            estimates.solve(choice)
        finally:
            self._errors, self._choice, self._coarser = estimates.errors, choice, estimates.coarser

    @property
    def _seen(self) -> Seen:
        return self._fields.seen if self._simulation.mesh.comm.rank == 0 else Seen()

    @property
    def _stopped(self) -> tuple[str, str]:
        """Status and sentence of a run that was told to stop."""
        count, by = len(self._simulation.scene.requested_times()), self._interrupt.by or "the user"
        return "interrupted", f"stopped by {by} after {len(self.steps)} of {count} steps"

    def _unless_stopped(self, status: str, sentence: str) -> tuple[str, str]:
        """Return them, or those of a run that was told to stop since; collective."""
        try:
            self._interrupt.check(self._simulation.mesh.comm)
        except KeyboardInterrupt:
            return self._stopped
        return status, sentence

    def kept(self, keep: Keep) -> bool:
        """Whether the results are to be kept; collective."""
        return keep(self._simulation, self.steps, self._errors or ())

    def _write(self, index: int, step: StepResult) -> None:
        """Write rows and the step's file: when this returns, the step is safe; all ranks fail or none."""
        self._on_rank_0(self._find_folder)
        accepted, scene = self._simulation.reported, self._simulation.scene
        assert accepted is not None
        stored = scene.output.stores(index) or step.time == scene.requested_times()[-1]
        with self._simulation.clock.part("step files"):
            checkpoint = self._checkpoints.take(accepted)
            learnt = self._learnt.write(index, self._checkpoints.learnt()) if stored else ""
        self._outputs(methodcaller("step", index, step), BEFORE)
        with self._simulation.clock.part("step files"):
            self._on_rank_0(lambda: self._fields.see(step))
            last = resuming.RunCheckpoint(
                checkpoint=checkpoint,
                spent=self._simulation.clock.rows(),
                seen=self._seen,
                run=self._name,
                learnt=learnt,
            )
            self._light = None if stored else last
            if stored:
                self._store(index, step, last)
            else:
                self._on_rank_0(lambda: write_light(self._folder, index, step, {"run": self._name}))

    def _store(self, index: int, step: StepResult, last: resuming.RunCheckpoint) -> None:
        """Write the step with its fields and all that a run needs to go on."""

        def write() -> None:
            write_step(self._folder, index, step, serialise(last))
            self._learnt.forget()
            resuming.remove_light(self._folder, index)

        self._on_rank_0(write)

    def _find_folder(self) -> None:
        """
        Raises:
            MachineError: somebody has removed it.
        """
        if not is_marked(self._folder):
            raise MachineError(f"{self._folder}: is gone, and with it the steps so far; nothing is left to go on with")

    def finish(self, status: str, sentence: str, told: Sequence[str]) -> tuple[Outcome, dict[str, Any]]:
        """Judge the answer, write result.json, finish the outputs: how the run ended, and the content of result.json.

        A run that was told to stop has no time for an audit, and a scene may leave it out. result.json is written
        before the outputs that can fail.

        Args:
            told: warnings of before the first step.
        """
        simulation, audited = self._simulation, Audited()
        if self._errors is None and simulation.scene.output.error and self.steps:  # of a run that ended early
            estimates = simulation.estimates(self.steps)
            estimates.price()
            self._errors = estimates.errors
        simulation.release()  # audit and pictures come when nothing more is solved
        status, sentence = self._unless_stopped(status, sentence)
        if simulation.scene.output.audit and status != "interrupted":
            with simulation.clock.phase("audit"):
                audited = audit_steps(simulation, self._folder, self.steps)
            status, sentence = self._unless_stopped(status, sentence)
        warnings = self._on_all(lambda: (*self._fields.warnings(), *doubts(simulation, self.steps, self._errors)))
        status, sentence, found = _with_audit(status, sentence, audited)
        warnings += found
        if status == "converged" and (invalid := self._invalid()):
            status, sentence = "doubtful", f"{invalid}: the answer is that of small strain"
        for reason in self._on_all(lambda: reasons_to_doubt(simulation, self.steps)):
            warnings += (reason,) * (status != "converged")
            status, sentence = ("doubtful", reason) if status == "converged" else (status, sentence)
        outcome, left_out = Outcome(status, sentence, self._place, warnings), list[Neglected]()
        state = simulation.reported.state if simulation.reported else self._state
        if state is not None and status != "interrupted":
            with simulation.clock.phase("output", "neglected effects"):
                left_out = neglected(simulation, self.steps, state, self._seen, self._errors)
        ended = Ended(status=status, steps=self.steps, errors=self._errors, coarser=self._coarser)
        reference: LinearReference | None = None

        def content() -> dict[str, Any]:
            said = replace(outcome, warnings=(*told, *warnings))
            return summary(simulation, said, self.steps, audited, reference, self._errors, self._choice, left_out)

        for line in (*warnings, *[sentence] * (status == "doubtful")):
            log.warning("%s", line)
        with simulation.clock.phase("output"):
            self._outputs(methodcaller("finish", ended), BEFORE)
            self._on_rank_0(lambda: write_result(self._folder, content()))
            self._outputs(methodcaller("finish", ended), AFTER)
        if audited.audits:
            with simulation.clock.phase("audit"):
                audited, known = audit_files(simulation, self._folder, self.steps, self._errors, audited), audited
            if audited.passed != known.passed:
                status, sentence, found = _with_audit(status if status != "doubtful" else "converged", "", audited)
                warnings += found
                outcome = Outcome(status, sentence, self._place, warnings)
        if simulation.scene.output.linear_reference and not ended.in_haste:
            reference = linear_reference(simulation.system)
        final = content()
        self._on_rank_0(lambda: write_result(self._folder, final))
        log.info("profile of %.3f s\n%s", final["seconds"]["total"], "\n".join(profile_lines(final["profile"])))
        return outcome, final

    def _invalid(self) -> str:
        """Why linear elasticity does not hold, else empty, the same on every rank; collective."""

        def judge() -> Iterator[str]:
            for note in self._fields.notes():
                log.info("%s", note)
            if inside_out := self._fields.seen.inverted:
                yield f"cells are turned inside out, of {inside_out}"

        return "".join(self._on_all(judge)) or beyond_linear(self.steps)

    def _on_all(self, judge: Callable[[], Iterable[str]]) -> tuple[str, ...]:
        """Sentences that rank 0 finds, the same on every rank; collective."""
        found: list[str] = []
        self._on_rank_0(lambda: found.extend(judge()))
        return tuple(self._simulation.mesh.comm.bcast(found))

    def _on_rank_0(self, act: Callable[[], object]) -> None:
        """Act on rank 0; if that fails, every rank raises the same error."""
        raise_together(self._simulation.mesh.comm, act)


def _with_audit(status: str, sentence: str, audited: Audited) -> tuple[str, str, tuple[str, ...]]:
    """Status, sentence and further warnings of a run that ended so, with what the audit finds."""
    if not audited.passed:
        return status, sentence, ()
    if status == "converged":
        return "doubtful", f"the audit finds that {'; '.join(audited.passed)}", ()
    return status, sentence, tuple(f"the audit finds that {one}" for one in audited.passed)


def run(
    scene: Scene,
    folder: str | Path,
    watch: Watch | None = None,
    resume: bool = False,
    keep: Keep | None = None,
    sizes: SizeField | None = None,
    bodies: Bodies | None = None,
    began: float | None = None,
    former: str = FORMER,
) -> tuple[Outcome, dict[str, Any]]:
    """Run a scene once, as `accuracy.rounds.run` tells of its arguments; collective.

    Args:
        former: how the name of the folder ends in which former results are kept.
    """
    from mpi4py import MPI

    comm, counters, watch = MPI.COMM_WORLD, Counters(), watch or Watch()
    counters.clock.on_phase = watch.on_phase
    if began is not None:
        imports = clock.perf_counter() - began
        counters.clock.add([Row(phase="imports", part="", seconds=imports, calls=1, volume_solves=0)])
    wanted(scene)  # refuses keys that no writer has
    place, earlier = Path(folder), resuming.EarlierRun()
    results: list[ResultsFolder] = []  # on rank 0
    raise_together(comm, lambda: results.append(ResultsFolder(place, former)))

    def look() -> None:
        nonlocal earlier
        if resume:
            earlier = resuming.find_earlier_run(results[0], scene)
        else:
            results[0].refuse_to_lose()

    try:
        raise_together(comm, look)
        earlier = earlier.shared(comm)
        if earlier.finished is not None:
            said = [earlier.notes[0], str(earlier.finished.get("sentence") or "")]
            warnings = tuple(earlier.finished.get("warnings") or ())
            return Outcome(earlier.finished["status"], ": ".join(filter(None, said)), place, warnings), earlier.finished
        return _solve(scene, place, results, earlier, watch, counters, keep, sizes, bodies)
    finally:
        for held in results:
            held.release()


def _solve(
    scene: Scene,
    place: Path,
    results: list[ResultsFolder],
    earlier: resuming.EarlierRun,
    watch: Watch,
    counters: Counters,
    keep: Keep | None,
    sizes: SizeField | None,
    bodies: Bodies | None,
) -> tuple[Outcome, dict[str, Any]]:
    """Prepare, march, finish; `results` on rank 0 only."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    with Interrupt(watch.answer, watch.kept) as interrupt:
        reached = earlier.last.checkpoint.reached if earlier.last else None
        simulation = prepare(scene, comm, reached, sizes, bodies, counters)
        scene = simulation.scene  # without estimates of errors where they do not fit
        interrupt.check(comm)
        system = simulation.system
        report = report_mesh(scene, simulation.mesh, system.nodes.total, system.contacts)
        begun: dict[str, Any] = {}  # on rank 0
        raise_together(comm, lambda: begun.update(begun_with(simulation)))
        work = work_of(place)
        with counters.clock.phase("output"):
            outputs = Outputs(Job(folder=work, scene=scene, mesh=simulation.data, comm=comm, simulation=simulation))
        raise_together(comm, lambda: _open(results[0], begun, earlier, outputs.names))
        with counters.clock.phase("output"):
            outputs(lambda writer: writer.begin() if earlier.folder is None else writer.resume(earlier.steps))
        with ExitStack() as stack:
            raise_together(comm, lambda: stack.enter_context(RunLog(work / LOG)))
            notes = results[0].notes if results else ()
            raise_together(comm, lambda: tell(simulation, report, replace(earlier, notes=notes + earlier.notes), watch))
            working = Run(simulation, outputs, place, resuming.run_of(begun), earlier, interrupt)
            try:
                try:
                    status, sentence = working.march(watch)
                    if keep is not None and status == "converged":
                        status = status if working.kept(keep) else "abandoned"
                except SceneError:
                    if keep is not None or not working.steps:  # solved steps are not lost
                        raise_together(comm, lambda: results[0].abandon())
                    raise
                if status != "abandoned":
                    outcome, content = working.finish(status, sentence, foreseen(simulation, report))
            except MachineError as error:
                there = len(step_files(work)) if (work / BEGUN).is_file() else 0
                kept = f"; {there} steps are kept, go on with --resume" if there else ""
                raise MachineError(f"{error}{kept}") from None
        if status == "abandoned":
            raise_together(comm, lambda: results[0].abandon())
            interrupt.check(comm)  # there is no other place to stop before the next round
            return Outcome(status, sentence, place), {}
        raise_together(comm, lambda: _close(results[0], outcome.status))
    return outcome, content


def _close(results: ResultsFolder, status: str) -> None:
    """Certify the results, then put them in their place: a run that is killed in between is not solved again."""
    results.certify()
    if status in resuming.FINISHED:
        resuming.remove_learnt(results.work)
    results.finish()


def begun_with(simulation: Simulation) -> dict[str, Any]:
    """Return scene, mesh and versions that a run is begun with; the mesh is on rank 0 alone."""
    scene, mesh = identity(simulation.scene, DECIDES_NOTHING), mesh_checksum(simulation.data)
    return {"scene": scene, "mesh": mesh, "units": simulation.scene.units} | resuming.VERSIONS


def _open(results: ResultsFolder, begun: dict[str, Any], earlier: resuming.EarlierRun, names: Sequence[str]) -> None:
    """The working folder: a new one that says what scene it is for, or the one to go on in."""
    if earlier.folder is None:
        work = results.start()
        results.declare(names)
        write_json(work / BEGUN, begun)
    elif earlier.mesh != begun["mesh"]:
        raise MachineError(
            f"{results.target}: gmsh meshes this scene differently now; leave out --resume, and choose another folder"
        )
    else:
        folder = results.take_up(earlier.folder)
        results.declare(names)
        resuming.remove_surplus(folder, len(earlier.steps))
