"""A run leaves for one that resumes it its steps, the newest one's checkpoint, and what methods have learnt.

The latter, learnt/000012.0.bin of rank 0, stands beside the newest two steps only, for it can be large. It serves the
same ranks alone, so each keeps its own part: nothing is gathered. A step names the files that belong to it by its
reference: their number, and the checksum of each rank's.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Container, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from stickslip import VERSION
from stickslip.geometry.dolfinx_versions import DOLFINX
from stickslip.geometry.errors import DamagedError, FolderError, MachineError
from stickslip.solvers.accuracy.budget import Choice
from stickslip.solvers.parallel.counters import Row
from stickslip.solvers.parallel.serialise import Plain, broadcast, deserialise
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.checkpoint import Checkpoint
from stickslip.workflows.formats.files import disk_errors, make_folder, read_json, write_json
from stickslip.workflows.formats.marker import OF_STEP, is_certified, read_checked_json, remove_unfinished
from stickslip.workflows.formats.serialised import PlainFile, read_plain
from stickslip.workflows.formats.steps import light_files, light_name, read_checkpoint, step_files, step_name
from stickslip.workflows.run.folder import BEGUN, RESULT, ResultsFolder
from stickslip.workflows.run.ranks import all_act, raise_together
from stickslip.workflows.run.warnings import Seen
from stickslip.workflows.scene_file.identity import DECIDES_NOTHING, identity, refuse_changes

FOLDER = "learnt"
VERSIONS = {"stickslip": VERSION, "dolfinx": DOLFINX}
FINISHED = ("converged", "doubtful")
CHOICE = "estimates"  # of what a run was begun with: which are made at its end, see `Choice`
UNTOUCHED = "nothing is resumed, nothing was changed"
STATES = ("state", "refined", "surplus")  # of a checkpoint, with values by node: these stay on rank 0


class LearntFiles:
    """Files of the last two steps; one that is the same as at the step before is not written again."""

    def __init__(self, folder: Path, comm: Any, before: str = "", last: str = "") -> None:
        """
        Args:
            before, last: references of the last two steps.
        """
        self._folder, self._comm, self._two = folder / FOLDER, comm, (before, last)

    def write(self, index: int, learnt: Plain) -> str:
        """Bring it to the disk before the step's file: the step's reference; collective.

        Raises:
            MachineError: a disk is full; on all ranks.
        """
        file, last = PlainFile(learnt), self._two[1]
        sums = self._comm.allgather(file.checksum)
        if last.split()[1:] != sums:
            last = " ".join([f"{index:06d}", *sums])

            raise_together(self._comm, lambda: make_folder(self._folder))
            all_act(self._comm, lambda: file.write(self._folder / _name(last, self._comm.rank)))
        self._two = self._two[1], last
        return last

    def read(self) -> Plain | None:
        """Read that of the last step; None on all ranks if one's is lost, or if they were others; collective."""
        last = self._two[1]
        sums, rank = last.split()[1:], self._comm.rank
        if len(sums) != self._comm.size:
            return None
        found = read_plain(self._folder / _name(last, rank), sums[rank])
        return found if all(self._comm.allgather(found is not None)) else None

    def forget(self) -> None:
        """Remove the files of earlier steps, of all ranks; rank 0, when the last step is safe."""
        numbers = {reference.partition(" ")[0] for reference in self._two}
        _remove(self._folder, numbers)


def remove_learnt(folder: Path) -> None:
    """Remove what was learnt in a run that is done and certified: nothing will go on from here, nor be estimated again.

    Raises:
        MachineError: no permission.
    """
    _remove(folder / FOLDER, ())
    with suppress(OSError):  # the user keeps something there, or there is none
        (folder / FOLDER).rmdir()


def _remove(folder: Path, but: Container[str]) -> None:
    """Remove the files of all steps but some."""
    with disk_errors(folder):
        for path in folder.glob("*.bin"):
            if OF_STEP.fullmatch(path.name) and path.name[:6] not in but:
                path.unlink()


def is_kept(folder: Path, reference: str) -> bool:
    """Whether every rank's file is there, and whole."""
    sums = reference.split()[1:]
    files = (folder / FOLDER / _name(reference, rank) for rank in range(len(sums)))
    return bool(sums) and all(read_plain(path, total) is not None for path, total in zip(files, sums, strict=True))


def _name(reference: str, rank: int) -> str:
    return f"{reference.partition(' ')[0]}.{rank}.bin"


@dataclass(frozen=True, kw_only=True)
class RunCheckpoint:
    """State from which a run goes on, besides the result of a step; it stands in each step's file."""

    checkpoint: Checkpoint  # of the solver
    spent: tuple[Row, ...]  # by phase, until then, by all processes that have worked on the run
    run: str  # the run that the step belongs to, see `run_of`
    seen: Seen  # of the fields, until then
    learnt: str  # reference to its files, see `LearntFiles`


@dataclass(frozen=True, kw_only=True)
class EarlierRun:
    """Remains of an earlier run to go on with; by default nothing: the run begins."""

    steps: tuple[StepResult, ...] = ()  # the last one with its fields, on rank 0; the others without
    last: RunCheckpoint | None = None  # of the last step
    learnt_before: str = ""  # reference to what was learnt at the step before the last one
    learnt: bool = False  # whether the files of what was learnt at the last one are there
    notes: tuple[str, ...] = ()  # for the user
    finished: dict[str, Any] | None = None  # content of result.json, where nothing is left to solve
    folder: Path | None = None  # where all that stands
    mesh: str = ""  # checksum of the mesh that it was begun with
    choice: Choice | None = None  # of the estimates at its end, once it is made

    def shared(self, comm: Any) -> EarlierRun:
        """The same on every rank, told by rank 0; collective."""
        steps = comm.bcast([step.without_fields() for step in self.steps])
        states = {name: broadcast(comm, self.last and getattr(self.last.checkpoint, name)) for name in STATES}
        rest: EarlierRun = comm.bcast(replace(self, steps=(), last=_without_states(self.last)))
        last = rest.last and replace(rest.last, checkpoint=replace(rest.last.checkpoint, **states))
        return replace(rest, steps=self.steps if comm.rank == 0 else tuple(steps), last=last)


def _without_states(last: RunCheckpoint | None) -> RunCheckpoint | None:
    nothing: dict[str, Any] = dict.fromkeys(STATES)
    return last and replace(last, checkpoint=replace(last.checkpoint, **nothing))


def find_earlier_run(results: ResultsFolder, scene: Scene) -> EarlierRun:
    """Find what there is to resume, in the working folder or, if the run ended early, in the target; rank 0.

    The folder is locked. A damaged last step is left out, with a note: it is solved again. One that cannot be read may
    be sound: it is not touched.

    Raises:
        FolderError: another process is at work there; or results of another run would be lost.
        SceneError: the scene or a version was another one.
        MachineError: the last step cannot be read, or one before it is damaged or missing; or what the run was begun
            with cannot be known.
    """
    places = (results.work, results.place)
    folder = next((f for f in places if (f / BEGUN).is_file()), None)
    if folder != results.place:
        results.refuse_to_replace()
    if folder is None:
        for place in places:
            if left := len({*step_files(place), *light_files(place)}):
                raise MachineError(f"{place / BEGUN}: is lost, so its {left} steps belong to no scene; {UNTOUCHED}")
        return EarlierRun(notes=(f"nothing to resume in {results.target}: begins at the start",))
    results.lock(folder)
    try:
        begun = read_checked_json(folder / BEGUN)
    except MachineError as error:
        raise MachineError(f"{error}; {UNTOUCHED}") from None
    if not isinstance(begun.get("scene"), dict) or not isinstance(begun.get("mesh"), str):
        raise MachineError(f"{folder / BEGUN}: damaged: names no scene or no mesh; {UNTOUCHED}")
    refuse_changes(begun["scene"], identity(scene, DECIDES_NOTHING), results.target)
    ended = read_json(folder / RESULT)
    if ended.get("status") in (*FINISHED, "inaccurate") and is_certified(folder / RESULT):
        done = "nothing was changed"
        if folder == results.work:  # killed when there was nothing left to do but this
            remove_learnt(folder)
            results.finish()
            done = "its results are in their place now"
        return EarlierRun(finished=ended, notes=(f"{results.target}: the run is finished; {done}",))
    _refuse_versions(begun, results.target)
    found = _read(folder, None if scene.steps.clock else scene.requested_times(), run_of(begun))
    if folder == results.place and (folder / RESULT).exists() and not is_certified(folder / RESULT):
        if not found.steps:
            raise MachineError(f"{folder / RESULT}: was changed after the run, and its steps are gone; {UNTOUCHED}")
        found = replace(found, notes=(f"{folder / RESULT}: was changed after the run; the steps decide", *found.notes))
    choice = begun.get(CHOICE)
    return replace(found, folder=folder, mesh=begun["mesh"], choice=choice and Choice(**choice))


def run_of(begun: Mapping[str, Any]) -> str:
    """Hash of what a run was begun with: scene, mesh and versions, not its labels; each of its steps carries it."""
    plain = {key: value for key, value in begun.items() if key not in ("units", CHOICE)}
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def note_choice(folder: Path, choice: Choice) -> None:
    """Note which estimates are made at the end of a run, for whoever goes on with it.

    Raises:
        MachineError: the disk is full.
    """
    write_json(folder / BEGUN, read_checked_json(folder / BEGUN) | {CHOICE: asdict(choice)})


def _read(folder: Path, times: Sequence[float] | None, run: str) -> EarlierRun:
    """Read what there is of a run whose steps end at these times [s]; None: a clock finds them."""
    steps: list[StepResult] = []
    references, last, notes = [""], None, []
    files = step_files(folder)
    count = max(files, default=0)
    whole = 0  # steps up to the last one with its fields, which alone can be gone on from
    for index in range(1, count + 1):
        light = folder / light_name(index)
        try:
            step, reached, of = _step(folder / step_name(index) if index in files or not light.exists() else light)
        except MachineError as error:
            if isinstance(error, DamagedError) and index == count:
                notes.append(f"{error}; it is solved again")
                break
            later = "later steps build on it: " if index < count else ""
            raise MachineError(f"{error}; {later}{UNTOUCHED}") from None
        if of != run:
            raise MachineError(f"{folder / step_name(index)}: is a step of another run; {UNTOUCHED}")
        if times is not None and (index > len(times) or step.time != times[index - 1]):
            if index == count:  # as far as a step came that failed
                break
            raise MachineError(f"{folder / step_name(index)}: is not that step: its t = {step.time:g}; {UNTOUCHED}")
        if reached is None:
            steps.append(step)
            continue
        steps = [*steps[:whole][:-1], *(s.without_fields() for s in steps[:whole][-1:]), *steps[whole:], step]
        last, whole = reached, index
        references.append(last.learnt)
    steps = steps[:whole]
    learnt = is_kept(folder, references[-1])
    if last and not learnt and (times is None or len(steps) < len(times)):
        notes.append("what the method had learnt is lost: the answer is the same to the tolerance, not to the last bit")
    before = references[-2] if last else ""
    return EarlierRun(steps=tuple(steps), last=last, learnt_before=before, learnt=learnt, notes=tuple(notes))


def _step(path: Path) -> tuple[StepResult, RunCheckpoint | None, str]:
    """A step, its checkpoint unless its file is a light one, and the run that it is of.

    Raises:
        MachineError: missing, damaged, or of another version.
    """
    step, plain = read_checkpoint(path)
    try:
        found = deserialise(RunCheckpoint, plain, lambda whole: whole) if "checkpoint" in plain else None
        return step, found, plain["run"]
    except (KeyError, TypeError) as error:
        raise MachineError(f"{path}: not a step of this version of stickslip") from error


def remove_surplus(work: Path, count: int) -> None:
    """Remove the files of steps beyond the first `count`, and those that a crash has left half written.

    Raises:
        MachineError: no permission.
    """
    with disk_errors(work):
        for index, path in step_files(work).items():
            if index > count:
                path.unlink()
        for index, path in light_files(work).items():
            if index > count or (work / step_name(index)).exists():
                path.unlink()
        remove_unfinished(work)


def remove_light(work: Path, index: int) -> None:
    """Remove the light file of a step that has its fields now, if there is one.

    Raises:
        MachineError: no permission.
    """
    path = work / light_name(index)
    with disk_errors(work):
        path.unlink(missing_ok=True)


def _refuse_versions(begun: Mapping[str, Any], target: Path) -> None:
    """One history is of one program: half of it by another would be a mixture that nobody can repeat."""
    for name, now in VERSIONS.items():
        before = begun.get(name, "of unknown version")
        if before != now:
            raise FolderError(
                f"--resume: {target} was begun with {name} {before}, this is {name} {now}; go on with that one, or "
                "leave out --resume and choose another folder with -o"
            )
