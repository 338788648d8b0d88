"""A sweep: the same scene with other values, each a run with a folder of its own, spread over processes or ranks.

Members that are solved already are not solved again. One that fails, or whose process is killed, is reported; the
others go on. Under `mpirun` the ranks but the first are the workers, by mpi4py.futures, over all machines of the job;
each member then runs on one core.
"""

from __future__ import annotations

import csv
import fcntl
import hashlib
import json
import math
import os
import re
import tempfile
import time as clock
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, pairwise, product
from multiprocessing.pool import ThreadPool
from pathlib import Path
from queue import SimpleQueue
from threading import Event, Thread
from typing import Any

from stickslip.geometry.errors import FolderError, SceneError
from stickslip.geometry.keys import plain, typed
from stickslip.geometry.protocols import DataFrame
from stickslip.geometry.user_files.child_process import LOOK, run_child
from stickslip.solvers.results.step_result import data_frame
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.csv_tables import STEPS, csv_text, read_steps_table
from stickslip.workflows.formats.files import disk_errors, read_json, read_regular, write_aside
from stickslip.workflows.formats.marker import is_certified
from stickslip.workflows.run.folder import BEGUN, NO_LOCKS, RESULT, place_of
from stickslip.workflows.run.ranks import raise_together
from stickslip.workflows.run.result import scene_hash
from stickslip.workflows.run.resume import FINISHED
from stickslip.workflows.scene_file.identity import DECIDES_NOTHING, identity
from stickslip.workflows.scene_file.read import to_dict, with_keys

UNSAFE = re.compile(r"[^A-Za-z0-9.+=-]+")
TABLE = "sweep.csv"
OWN = ("status", "folder")  # columns of the table, behind those of the keys
NOTHING_NEW = ("failed", "killed")  # statuses of members that have left no results
PARTS = 4  # tasks for each process: members of one task share their bodies, and are told of together
OF_MPIRUN = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "ORTE_", "HYDI_", "MPI_LOCAL")  # variables that make a child a rank
ROOT_MAY = "OMPI_ALLOW_RUN_AS_ROOT"
Task = Sequence[Mapping[str, Any]]
Answer = tuple[str, dict[str, Any]]  # name of a member, and how it ended
OnChecked = Callable[[int, int], None]


def unheard(*told: object) -> None:
    """Do nothing with what is told."""


@dataclass(frozen=True)
class Member:
    """One scene of a sweep."""

    name: str  # of its folder
    values: Mapping[str, Any]  # of the keys that are swept
    scene: Scene = field(repr=False)

    @property
    def bodies(self) -> str:
        """Hash that is the same for members that may share mesh and factor."""
        whole = to_dict(self.scene)
        return json.dumps([whole["geometry"], whole["bodies"]], sort_keys=True)


def members(
    scene: Scene, over: Mapping[str, Sequence[Any]], files: Path | None = None, on_checked: OnChecked = unheard
) -> list[Member]:
    """All combinations; the last key changes fastest.

    Args:
        over: values by dotted key, as in a scene file.
        files: where a relative `geometry.file` begins, by default the working folder.
        on_checked: told how many scenes are found right, of how many.

    Raises:
        SceneError: a key has no values, or a scene with one of them is wrong.
    """
    if not over:
        raise SceneError("sweep: needs a key and its values, for example contacts.base.friction.mu=[0.1, 0.2, 0.3]")
    for key, values in over.items():
        if isinstance(values, str) or not isinstance(values, Sequence) or not len(values):
            raise SceneError(f"sweep: {key}: expected a list of values, for example {key}=[0.1, 0.2, 0.3]")
    found, names, count = dict[str, Member](), short(list(over)), 1
    for values in over.values():
        count *= len(values)
    if count > 10_000:
        raise SceneError(f"sweep: {count} members; at most 10000")
    for combination in product(*over.values()):
        chosen = {key: plain(value) for key, value in zip(over, combination, strict=True)}
        name = _safe(",".join(f"{names[key]}={said(value)}" for key, value in chosen.items()))
        try:
            changed = with_keys(scene, chosen, files)
        except SceneError as error:
            raise SceneError(f"sweep: {name}: {error}") from None
        if name in found:
            raise SceneError(f"sweep: {name}: stands there twice")
        found[name] = Member(name, chosen, changed)
        on_checked(len(found), count)
    return [*found.values()]


def short(keys: Sequence[str]) -> dict[str, str]:
    """The shortest ends of dotted keys that tell them apart."""
    found = {}
    for key in keys:
        parts = key.split(".")
        ends = [".".join(parts[k:]) for k in range(len(parts) - 1, -1, -1)]
        others = [other for other in keys if other != key]
        found[key] = next((end for end in ends if not any(f".{other}".endswith(f".{end}") for other in others)), key)
    return found


def said(value: Any) -> str:
    """A value in a word or two."""
    return value if isinstance(value, str) else json.dumps(value, default=str)


def _safe(name: str) -> str:
    """A name of at most 80 letters for a folder, and a short hash where letters are lost."""
    safe = UNSAFE.sub("_", name.replace(",", "+").replace(" ", ""))
    if safe == name.replace(",", "+") and len(safe) <= 80:
        return safe
    return f"{safe[:71]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


@dataclass(frozen=True)
class Solved:
    """Ending of a member of a sweep."""

    member: Member
    folder: Path
    status: str  # converged, doubtful, not_converged, no_equilibrium, interrupted, failed, killed
    sentence: str
    seconds: float | None  # None: it was solved before

    def __str__(self) -> str:
        took = "was solved before" if self.seconds is None else f"{self.seconds:.1f} s"
        why = f": {self.sentence}" if self.sentence else ""
        return f"{self.member.name}: {self.status.replace('_', ' ')}, {took}{why}"


@dataclass(frozen=True)
class Sweep:
    """A sweep that was solved.

    Attributes:
        solved: its members, in their order.
        path: of the table, sweep.csv.
    """

    solved: tuple[Solved, ...]
    path: Path

    def __repr__(self) -> str:
        ended = Counter(one.status for one in self.solved)
        said = ", ".join(f"{count} {status.replace('_', ' ')}" for status, count in ended.items())
        return f"Sweep({str(self.path)!r}: {len(self.solved)} members, {said})"

    @property
    def rows(self) -> list[dict[str, Any]]:
        """A row for each member: its values, how it ended, and all numbers of its last step as in steps.csv.

        Where the folder of one that has failed or was killed holds results of an earlier scene, it has no numbers.
        """
        found = []
        for one in self.solved:
            place = place_of(one.folder)
            own = dict(one.member.values) | dict(zip(OWN, (one.status, str(one.folder)), strict=True))
            found.append(own | (_last_row(place) if _is_of(place, one) else {}))
        return found

    def to_pandas(self) -> DataFrame:
        """The rows as a `pandas.DataFrame`.

        Raises:
            ImportError: pandas is not installed.
        """
        return data_frame(self.rows)


@typed
def sweep(
    scene: Scene,
    over: Mapping[str, Sequence[Any]],
    folder: str | Path,
    jobs: int = 1,
    on_member: Callable[[int, int, Solved], None] = unheard,
    files: Path | None = None,
    on_checked: OnChecked = unheard,
) -> Sweep:
    """Solve a scene with all combinations of values of some keys; not collective: one process calls it, or all ranks.

    Args:
        scene: from `read` or built from its parts.
        over: values by dotted key, as in a scene file: {"contacts.base.friction.mu": [0.1, 0.2]}.
        folder: each member has a folder in it; `sweep.csv` there has a row for each.
        jobs: number of processes; under mpirun the ranks are taken instead.
        on_member: told how many members have ended, of how many, and the last one.
        files: where a relative `geometry.file` begins, by default the working folder.
        on_checked: told how many scenes are found right, of how many, before anything is solved.

    Returns:
        All members; each folder is as `run` leaves it.

    Raises:
        SceneError: a key or a value is wrong, or the scene has goals of accuracy; nothing is solved.
        FolderError: another sweep works in the folder, or its sweep.csv is over other keys or no sweep's; or it is
            none; nothing is solved.
        MachineError: the folder cannot be written.
    """
    from mpi4py import MPI

    if jobs < 1:
        raise SceneError(f"jobs = {jobs}: expected a number of processes, at least 1")
    every, place = members(scene, over, files, on_checked), Path(folder)
    if any(member.scene.accuracy.goals for member in every):
        raise SceneError(
            "sweep: accuracy.goals: each member is solved once, without rounds towards an accuracy; leave the goals "
            "out (accuracy.goals = {}), or run the scenes one by one"
        )
    with ExitStack() as held:
        raise_together(MPI.COMM_WORLD, lambda: _make(place, over, held))
        ended = {member.name: found for member in every if (found := _already(member, place / member.name))}
        for number, found in enumerate(ended.values(), start=1):
            on_member(number, len(every), found)
        left = sorted((m for m in every if m.name not in ended), key=lambda member: member.bodies)
        by_name = {member.name: member for member in left}
        for name, answer in _spread(left, place, jobs):
            ended[name] = Solved(by_name[name], place / name, **answer)
            on_member(len(ended), len(every), ended[name])
        done = Sweep(tuple(ended[member.name] for member in every if member.name in ended), place / TABLE)
        if len(done.solved) == len(every) and MPI.COMM_WORLD.rank == 0:
            _write(done)
        return done


def solve_task(task: Task, tell: Callable[[Answer], object] = unheard) -> list[Answer]:
    """Solve some members in a process of their own; whoever ends it ends one member, and the next ones go on.

    Args:
        tell: told of each as it ends.
    """
    found, left = list[Answer](), list(task)
    while left:
        with tempfile.TemporaryDirectory(prefix="stickslip_") as here:
            order, answers = Path(here) / "task.json", Path(here) / "answers"
            order.write_text(json.dumps(left), encoding="utf-8")
            answers.touch()
            began, names = clock.perf_counter(), [Path(member["folder"]).name for member in left]
            with _hearing(answers, names, tell) as told:
                ended = run_child("stickslip.workflows.sweep.child", [str(order), str(answers)], None, math.inf)
        found += list(zip(names, told, strict=False))
        left = left[len(told) :]
        if left:
            last = (ended.printed.splitlines() or ["it has printed nothing"])[-1]
            code, before = ended.code or 0, sum(answer["seconds"] for answer in told)
            why = f"its process was ended by signal {-code}" if code < 0 else f"its process ended: {last}"
            why += "; memory was full" if ended.full else ""
            spent = clock.perf_counter() - began - before
            found.append((names[len(told)], {"status": "killed", "sentence": why, "seconds": spent}))
            tell(found[-1])
            left = left[1:]
    return found


@contextmanager
def _hearing(answers: Path, names: Sequence[str], tell: Callable[[Answer], object]) -> Iterator[list[dict[str, Any]]]:
    """Context that reads each answer once it is whole, and tells it; yields the list of those that were read."""
    told, over = list[dict[str, Any]](), Event()

    def read() -> None:
        last = False
        while not last:
            last = over.wait(LOOK)
            for line in answers.read_text(encoding="utf-8").rpartition("\n")[0].splitlines()[len(told) :]:
                told.append(json.loads(line))
                tell((names[len(told) - 1], told[-1]))

    thread = Thread(target=read, daemon=True)
    thread.start()
    try:
        yield told
    finally:
        over.set()
        thread.join()


def _spread(left: Sequence[Member], place: Path, jobs: int) -> Iterator[Answer]:
    """Solve members, by tasks, in processes or, under mpirun, on the other ranks; answers on rank 0 alone.

    A process tells of each member as it ends, a rank of a task.
    """
    from mpi4py import MPI

    ranks = MPI.COMM_WORLD.size
    tasks = list(_tasks(left, place, ranks - 1 if ranks > 1 else jobs))
    if ranks > 1:
        from mpi4py.futures import MPICommExecutor

        if MPI.COMM_WORLD.rank:
            _leave_mpirun()
        with MPICommExecutor(MPI.COMM_WORLD, root=0) as executor:
            if executor is not None:
                yield from chain.from_iterable(executor.map(solve_task, tasks, unordered=True))
    elif tasks:
        told = SimpleQueue[Answer]()
        with ThreadPool(min(jobs, len(tasks))) as pool:  # a thread for each process
            done = pool.map_async(partial(solve_task, tell=told.put), tasks)
            for _ in left:
                while told.empty() and not done.ready():
                    done.wait(LOOK)
                if told.empty():
                    done.get()  # raises what has ended it
                yield told.get()
            done.get()  # processes have told all, and end


def _tasks(left: Sequence[Member], place: Path, workers: int) -> Iterator[Task]:
    size = max(1, math.ceil(len(left) / (PARTS * workers)))
    for start in range(0, len(left), size):
        yield [
            {"folder": str((place / member.name).absolute()), "scene": to_dict(member.scene), "bodies": member.bodies}
            for member in left[start : start + size]
        ]


def _leave_mpirun() -> None:
    """Make sure that what this process starts is no rank of its job."""
    for key in [*os.environ]:
        if key.startswith(OF_MPIRUN) and not key.startswith(ROOT_MAY):
            del os.environ[key]


def _make(place: Path, keys: Collection[str], held: ExitStack) -> None:
    """Make the folder, for the table too if no member writes anything; before the hours are spent; and lock it.

    Args:
        keys: that are swept.
        held: releases the lock at its end.

    Raises:
        FolderError: a file is there, or a table over other keys or of no sweep; or another sweep works there.
        MachineError: it cannot be made.
    """
    if place.exists() and not place.is_dir():
        raise FolderError(f"-o {place}: is not a folder; choose another one with -o")
    _refuse_foreign(place / TABLE, keys)
    with disk_errors(place):
        os.makedirs(os.path.realpath(place), exist_ok=True)
        lock = os.open(place, os.O_RDONLY)
        held.callback(os.close, lock)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise FolderError(f"-o {place}: another sweep works there; choose another folder with -o") from None
        except OSError as error:
            if error.errno not in NO_LOCKS:  # of network disks: members have notes of their own there
                raise


def _refuse_foreign(path: Path, keys: Collection[str]) -> None:
    """
    Raises:
        FolderError: a table is there that no sweep, or one over other keys, has written.
    """
    if not os.path.lexists(path):
        return
    try:
        first = read_regular(path, 100_000).decode(errors="replace").splitlines()[:1]
    except OSError:
        first = []
    head = next(csv.reader(first), [])
    if OWN not in pairwise(head[1:]):
        raise FolderError(f"{path}: is not the table of a sweep; move it away, or choose another folder with -o")
    if {*head[: head.index(OWN[0])]} != {*keys}:
        raise FolderError(f"{path}: is the table of a sweep over other keys; choose another folder with -o")


def _is_of(place: Path, one: Solved) -> bool:
    """Whether the results in a member's folder are those of its scene."""
    scene = one.member.scene
    if one.status in NOTHING_NEW:
        return bool(_hash_of(read_json(place / RESULT)) == scene_hash(scene))
    return bool(read_json(place / BEGUN).get("scene") == identity(scene, DECIDES_NOTHING))


def _hash_of(content: Mapping[str, Any]) -> Any:
    """Hash of the scene of a result.json."""
    return (content.get("scene") or {}).get("hash")


def _already(member: Member, folder: Path) -> Solved | None:
    """A member that is solved, with the same scene."""
    path = place_of(folder) / RESULT
    found = read_json(path)
    known = found.get("status") in FINISHED and _hash_of(found) == scene_hash(member.scene)
    if not known or not is_certified(path):
        return None
    return Solved(member, folder, found["status"], str(found.get("sentence") or ""), None)


def _last_row(folder: Path) -> dict[str, Any]:
    """Numbers of the last step, by column; nothing if there is none.

    Raises:
        MachineError: the table is damaged, or not what the run has left.
    """
    columns = read_steps_table(folder) if (folder / STEPS).exists() else {}
    last = {key: float(values[-1]) for key, values in columns.items() if len(values)}
    return {key: "" if math.isnan(value) else value for key, value in last.items()}


def _write(done: Sweep) -> None:
    """Write sweep.csv."""
    rows = done.rows
    head = [*dict.fromkeys(key for row in rows for key in row)]
    write_aside(done.path, csv_text([head, *([row.get(key) for key in head] for row in rows)]).encode())
