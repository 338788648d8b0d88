"""The suite: variations of the ready scenes, solved and judged in processes of their own, each with a time limit."""

from __future__ import annotations

import logging
import os
import signal
import zlib
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count, product
from multiprocessing import get_context
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from stickslip import GeometryError, MachineError, SceneError, read
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.lab.verification.hard.judge import Outcome, Verdict, judge, supported
from stickslip.workflows.lab.verification.hard.tables import overrides, ready
from stickslip.workflows.lab.verification.hard.variations import FIXED, variation, varied
from stickslip.workflows.scene_file.read import READY, from_dict, to_dict

LIMIT = 60.0  # [s] of the processor, of a variation; no end until then counts as failed
OPINION = 8.0  # [s] more, of its second opinion
STARTS, START = 3, 60.0  # processes that may die before that, one after the other; [s] for each
UNSOLVED = (Outcome.WRONG, Outcome.FAILED, Outcome.DOUBTFUL, Outcome.UNDECIDED)
NAMES = tuple(sorted(path.stem for path in READY.glob("*.toml")))


@dataclass(frozen=True)
class Task:
    """A variation of a ready scene; random numbers follow from scene, name and seed."""

    scene: str
    name: str
    seed: int


@dataclass(frozen=True)
class Row:
    """Ending of a task."""

    scene: str
    kind: str
    name: str
    overrides: tuple[str, ...]  # of the ready scene, as `--set` takes them
    verdict: Verdict


def tasks(scenes: Sequence[str], seed: int) -> Iterator[Task]:
    """All fixed variations of the scenes in random order, then random ones without end."""
    fixed = list(product(scenes, FIXED))
    for index in np.random.default_rng(seed).permutation(len(fixed)):
        scene, name = fixed[index]
        yield Task(scene, name, seed)
    for index in count(1):
        yield from (Task(scene, f"random {index}", seed) for scene in scenes)


def performed(task: Task) -> Iterator[Row | None]:
    """Solve and judge: None if the variation does not apply; else first without, then with the second opinion."""
    one, original = variation(task.name), to_dict(read(task.scene))
    base = ready(task.scene)
    try:
        found = varied(base, one.change, _random(task)) if one.kind != "as it is" else base
        if found is None:
            yield None
            return
        twin = one.twin and one.twin(ready(task.scene), _random(task))
        words = tuple(overrides(original, found))
        row = Row(task.scene, one.kind, one.name, words, Verdict(outcome=Outcome.SOLVED))
        for verdict in judge(from_dict(found), from_dict(twin) if twin else None, one.scale):
            yield replace(row, verdict=verdict)
    except (SceneError, GeometryError) as error:  # no scene is made of it
        verdict = Verdict(outcome=Outcome.REFUSED, reason=str(error))
        yield Row(task.scene, one.kind, one.name, (), verdict)


def _random(task: Task) -> np.random.Generator:
    return np.random.default_rng([task.seed, zlib.crc32(f"{task.scene} {task.name}".encode())])


def results(
    scenes: Sequence[str], number: int, seed: int, jobs: int, opinion: float = OPINION, known: Sequence[Row] = ()
) -> Iterator[Row]:
    """The first `number` tasks whose variation applies, in their order.

    Args:
        opinion: time limit of a second opinion [s].
        known: the first rows, of the same scenes and seed; they are not solved again, nor returned.
    """
    left, found = tasks(scenes, seed), len(known)
    if known:
        last = known[-1].scene, known[-1].name
        next(task for task in left if (task.scene, task.name) == last)
    if found >= number:
        return
    with Crew(jobs, opinion) as crew:
        for row in crew.map(left):
            if row is not None:
                yield row
                found += 1
            if found >= number:
                return


def judged_again(rows: Sequence[Row], seed: int, jobs: int, opinion: float = OPINION) -> Iterator[Row]:
    """The rows, with those that were not solved judged again.

    Args:
        rows: of an earlier run with the same seed.
        opinion: time limit of a second opinion [s].
    """
    unsolved = [row for row in rows if row.verdict.outcome in UNSOLVED]
    with Crew(jobs, opinion) as crew:
        fresh = crew.map(Task(row.scene, row.name, seed) for row in unsolved)
        found = {(row.scene, row.name): row for row in fresh if row is not None}
    yield from (found.get((row.scene, row.name), row) for row in rows)


class Crew:
    """Processes that solve tasks; one that takes too long, or dies, is replaced."""

    def __init__(self, jobs: int, opinion: float) -> None:
        self.jobs, self._idle, self._all = jobs, SimpleQueue[Worker](), [Worker(opinion) for _ in range(jobs)]
        for worker in self._all:
            self._idle.put(worker)

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *error: object) -> None:
        for worker in self._all:
            worker.end()

    def map(self, tasks: Iterable[Task]) -> Iterator[Row | None]:
        """Their results in order; a few tasks ahead are begun."""
        ahead: deque[Future[Row | None]] = deque()
        with ThreadPoolExecutor(self.jobs) as threads:
            try:
                for task in tasks:
                    ahead.append(threads.submit(self._perform, task))
                    if len(ahead) > 4 * self.jobs:
                        yield ahead.popleft().result()
                yield from (future.result() for future in ahead)
            finally:
                for future in ahead:
                    future.cancel()

    def _perform(self, task: Task) -> Row | None:
        worker = self._idle.get()
        try:
            return worker.perform(task)
        finally:
            self._idle.put(worker)


class Worker:
    """A process of one core that performs one task after the other; it is replaced when it takes too long, or dies."""

    def __init__(self, opinion: float) -> None:
        self._opinion = opinion
        self._process: ProcessPoolExecutor | None = None

    def perform(self, task: Task) -> Row | None:
        """The last row that came in time; failed if none did, or if what followed ended otherwise than by time."""
        process, last, late = self._started(), None, False
        began = self._worked()
        while True:
            asked, limit = (task, LIMIT) if last is None else (None, self._opinion)
            try:
                word = self._in_time(process.submit(_next_row, asked), limit)
            except TimeoutError:
                lost, late = f"no end after {self._worked() - began:.0f} s of the processor's time", True
                break
            except BrokenProcessPool:
                lost = "the process died"
                break
            if word is None:
                return last
            if isinstance(word, str):
                lost = word
                break
            last = word
        seconds = self._worked() - began
        self.end()
        if last is None:
            return _failed(task, lost, seconds)
        verdict = replace(last.verdict, second=f"none: {lost}")
        if not late and verdict.outcome in (Outcome.SOLVED, Outcome.BRANCH):
            verdict = replace(verdict, outcome=Outcome.FAILED, reason=f"second opinion: {lost}")
        return replace(last, verdict=verdict)

    def _in_time(self, future: Future[Row | str | None], limit: float) -> Row | str | None:
        """What comes within a limit [s] of the processor's time, however many others work.

        Raises:
            TimeoutError: it does not, or nothing is done for it.
        """
        last = began = self._worked()
        while True:
            try:
                return future.result(max(began + limit - last, 0.0))
            except TimeoutError:
                last, before = self._worked(), last
                if last == before or last >= began + limit:
                    raise

    def _worked(self) -> float:
        """Processor's time of the process and of what it has waited for [s]; 0: it has ended."""
        pids = list(self._process._processes) if self._process is not None else []
        with suppress(OSError):
            fields = [Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for pid in pids]
            return sum(int(ticks) for each in fields for ticks in each[11:15]) / os.sysconf("SC_CLK_TCK")
        return 0.0

    def _started(self) -> ProcessPoolExecutor:
        """A process that waits for tasks.

        Raises:
            MachineError: none can be started.
        """
        os.environ.update(ONE_THREAD)
        for _ in range(STARTS):
            self._process = self._process or ProcessPoolExecutor(1, get_context("spawn"), _begin)
            with suppress(BrokenProcessPool, TimeoutError):
                self._process.submit(int).result(START)  # it has loaded what it needs
                return self._process
            self.end()
        raise MachineError(f"{STARTS} processes one after the other died, or were not ready in {START:.0f} s")

    def end(self) -> None:
        """End the process; the next task starts another one."""
        if self._process is not None:
            for process in self._process._processes.values():
                process.kill()
            self._process.shutdown()
            self._process = None


def _begin() -> None:
    """Load what tasks need, in a process of their own."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.getLogger().addHandler(logging.NullHandler())  # FFCx would set up the root logger, and lines be printed
    from mpi4py import MPI  # noqa: F401  may end the process, where no task is to blame


def _next_row(task: Task | None, left: list[Iterator[Row | None]] = []) -> Row | str | None:  # noqa: B006  lives on
    """The first row of a task, or the next one of the last task; None if there is none, or what went wrong."""
    if task is not None:
        left[:] = [performed(task)]
    try:
        return next(left[0], None)
    except Exception as error:  # a defect, whatever it is: the variation has failed
        return f"{type(error).__name__}: {error}"


def _failed(task: Task, reason: str, seconds: float) -> Row:
    """The row of a task whose process gave none."""
    one, found = variation(task.name), ready(task.scene)
    if one.kind != "as it is":
        found = varied(found, one.change, _random(task)) or found
    held = supported(from_dict(found))
    verdict = Verdict(outcome=Outcome.FAILED, reason=reason, held=held, seconds=seconds)
    return Row(task.scene, one.kind, task.name, tuple(overrides(to_dict(read(task.scene)), found)), verdict)
