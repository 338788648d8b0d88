"""Rounds of solving, estimating and refining until the numbers are as accurate as they are asked to be.

A round is a run like any other. Its results are kept if it reaches the goals, or if the next one would exceed the
budget; else only what it shows of the errors is used: the mesh is refined where the energy norm of the error is large,
around the contacts first if pressures or areas are asked for, and the steps are split. What the next round needs is
written down first, so that rounds that are stopped go on from there. Without goals, `run` makes one run.
"""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from stickslip.geometry.arrays import EXACT, TINY, Array
from stickslip.geometry.errors import SceneError
from stickslip.geometry.keys import typed
from stickslip.geometry.memory import available, peak
from stickslip.geometry.mesh_sizes import SizeField, adapted, volumes
from stickslip.geometry.protocols import Comm
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.accuracy.budget import growing, size_of
from stickslip.solvers.accuracy.mesh_error import AT_NODES
from stickslip.solvers.results.step_result import OPEN, Errors, StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Accuracy
from stickslip.solvers.simulation.simulation import Bodies, Simulation
from stickslip.workflows.accuracy.goals import Standing, percent, standings
from stickslip.workflows.accuracy.level import TIGHTER, Level, Move, Round, finer_sides, is_loose, nearness, next_move
from stickslip.workflows.accuracy.saved_rounds import SavedRounds
from stickslip.workflows.formats.files import read_json
from stickslip.workflows.formats.marker import certify, is_certified
from stickslip.workflows.formats.steps import read_step, step_files
from stickslip.workflows.run import run as once
from stickslip.workflows.run.folder import BEGUN, RESULT, place_of, work_of
from stickslip.workflows.run.ranks import from_rank_0, raise_together
from stickslip.workflows.run.result import Outcome, scene_hash, write_result
from stickslip.workflows.run.resume import FINISHED, run_of
from stickslip.workflows.run.run import Keep, begun_with
from stickslip.workflows.run.watch import Watch

log = logging.getLogger(__name__)
COARSE = Move(0.5, 1)  # where a contact is too coarse for its errors to be known
MOST = 12  # rounds
LIBRARIES = 5e8  # bytes that the first round takes for libraries, on each rank
ADAPTABLE = ("triangle", "tetrahedron")
TOUCHING = {2: 4, 3: 9}  # nodes; with fewer nothing is known of a contact, its errors least of all
RESOLVING = 3  # rounds at most that are there for that: a corner never touches with more


class Rounds:
    """All rounds of a scene; on every rank."""

    def __init__(self, scene: Scene, say: Callable[[str], None]) -> None:
        """
        Args:
            scene: with goals.
            say: told one line a round, on rank 0.
        """
        self.scene, self.done = scene, list[Round]()
        self._say, self._began = say, clock.perf_counter()
        self._error: Array = np.zeros(0)  # of the present round, by cell, largest of all steps; on rank 0
        self._next: Level | None = Level()
        self._level = Level()
        self._saved: SavedRounds | None = None  # on rank 0
        self._stuck = ""  # why the mesh cannot be refined
        self._before = peak()  # memory without any round [bytes]

    def __call__(self, folder: str | Path, watch: Watch, resume: bool = False) -> tuple[Outcome, dict[str, Any]]:
        """Run until the goals are reached or the budget is spent; results as `run` leaves them; collective.

        Args:
            folder: where the results stand at the end.
            watch: what is told while the rounds work.
            resume: go on behind the rounds that earlier ones have finished there, and behind the last step of the one
                that was stopped, or that the budget has ended.

        Raises:
            SceneError: the error of a goal is not known; or earlier rounds were of another scene.
            FolderError: without `resume`, rounds that were stopped would be lost.
        """
        from mpi4py import MPI

        comm = MPI.COMM_WORLD
        finished, going_on = from_rank_0(comm, lambda: self._take_up(Path(folder), resume))
        if finished:
            note = f"{folder}: the rounds are finished; nothing was changed"
            return Outcome(finished["status"], note, Path(folder), tuple(finished.get("warnings") or ())), finished
        self.done = comm.bcast(self.done)
        level = comm.bcast(self._next and replace(self._next, sizes=None))
        self._next = self._next if comm.rank == 0 else level
        self._began -= sum(one.seconds for one in self.done)
        while self._next is not None:
            self._level, self._next = self._next, None
            self._error, count = np.zeros(0), len(self.done)
            seen = replace(watch, on_step=self._seeing(watch.on_step), on_resume=self._reading(folder, watch.on_resume))
            scene = self._paying(self._level.scene(self.scene), comm)
            outcome, content = once.run(scene, folder, seen, going_on, keep=self._judge, sizes=self._level.sizes)
            if going_on and len(self.done) == count and outcome.status in FINISHED:
                self._next = self._level  # a crash came between its end and the verdict on it
            going_on = False
        if outcome.status == "interrupted":
            return outcome, content
        if outcome.status not in FINISHED or not self.done:
            self._forget(comm)
            return outcome, content
        last = self.done[-1]
        if not last.met and outcome.status != "doubtful":
            outcome = replace(outcome, status="inaccurate", sentence=self._missed(last))
        accuracy = {"met": last.met, "rounds": [one.plain for one in self.done], "scene": _hash(self.scene)}
        content = content | {"status": outcome.status, "sentence": outcome.sentence, "accuracy": accuracy}

        def write() -> None:
            write_result(outcome.folder, content)
            certify(outcome.folder, RESULT)

        raise_together(comm, write)
        if last.met or (self._stuck and outcome.status == "inaccurate"):
            self._forget(comm)
        return outcome, content

    def _paying(self, scene: Scene, comm: Comm) -> Scene:
        """The scene of the round, whose errors may take all that is left where its level says so; collective."""
        left = comm.bcast(self.scene.accuracy.budget - (clock.perf_counter() - self._began))
        if not self._level.pays or scene.output.error_budget is not None:
            return scene
        return replace(scene, output=replace(scene.output, error_budget=max(left, 0.0)))

    def _missed(self, last: Round) -> str:
        """Say which goals are not reached."""
        missed = max(last.goals, key=lambda goal: (not goal.known, goal.reached / goal.asked))
        said = f"reached {percent(missed.reached)} of {missed.name}"
        if missed.grows:
            said = f"{missed.name} grows so far as the mesh is refined"
        elif missed.lacks:
            times = f"about {missed.price:.2g} times the round, which took {last.seconds:.0f} s"
            return f"{missed.name}: its error by {missed.lacks} would take {times}; --resume with a larger --budget"
        if self._stuck:
            return f"{said}; {self._stuck}"
        longer = "longer than can be told" if last.price is None else f"about {last.price:.0f} s"
        return f"{said}, {percent(missed.asked)} would take {longer}; --resume with a larger --budget goes on from here"

    def _take_up(self, folder: Path, resume: bool) -> tuple[dict[str, Any] | None, bool]:
        """Finished rounds; content of result.json if all are; whether a round was stopped in its course; on rank 0."""
        self._saved = SavedRounds(folder, self.scene)
        if not resume:
            self._saved.refuse_to_lose()
            if self.scene.geometry.degree > self._level.order:
                self._say("rounds begin with order 1, in place of geometry.order = 2, and go to 2 where it is cheaper")
            return None, False
        found = self._saved.load()
        place, work = place_of(folder), work_of(folder)
        ended = read_json(place / RESULT)
        if found is None:
            told = ended.get("accuracy") or {}
            whole = told.get("met") and told.get("scene") == _hash(self.scene) and is_certified(place / RESULT)
            if whole:
                return ended, False
        else:
            self.done, self._next = found
            self._say(f"{len(self.done)} finished rounds are taken over")
        return None, (work / BEGUN).is_file() or ended.get("status") == "interrupted"

    def _forget(self, comm: Comm) -> None:
        """Nothing is left to go on with; collective."""

        def remove() -> None:
            assert self._saved is not None
            self._saved.remove()

        raise_together(comm, remove)

    def _seeing(self, also: Callable[[StepResult], None]) -> Callable[[StepResult], None]:
        """Keep the errors of cells of each step, on rank 0, beside what else is told of it."""

        def see(step: StepResult) -> None:
            self._error = np.maximum(self._error, step.stress_error) if len(self._error) else step.stress_error
            also(step)

        return see

    def _reading(self, folder: str | Path, also: Callable[[int, float], None]) -> Callable[[int, float], None]:
        """Read the errors of cells of the steps that a round had solved when it was stopped, on rank 0."""

        def read(done: int, time: float) -> None:
            for path in step_files(work_of(Path(folder))).values():
                error = read_step(path).stress_error
                self._error = np.maximum(self._error, error) if len(self._error) else error
            also(done, time)

        return read

    def _judge(self, simulation: Simulation, steps: Sequence[StepResult], errors: Sequence[Errors]) -> bool:
        """Whether the results of this round are kept; if not, `_next` is the level of the next one; collective."""
        comm = simulation.mesh.comm
        spent, coarse = comm.bcast(clock.perf_counter() - self._began), len(self.done) < RESOLVING
        try:
            goals = standings(self.scene.accuracy.goals, steps[-1], errors[-1], coarse)
        except SceneError:
            if self._level.order == 2:
                self._next = _lowered(self._level, comm)
                return False
            self._forget(comm)
            raise
        here = Round(self._level, goals, simulation.system.constraints.free_total, len(steps))
        here.seconds = spent - sum(one.seconds for one in self.done)
        self.done.append(here)
        if comm.rank == 0:
            self._say(f"round {len(self.done)}: {here}")
        if here.met and (not coarse or _resolved(simulation, steps)):
            return True
        try:
            level, ends, price = self._after(simulation, steps, here, spent)
            if _in_vain(self.done):
                level = _lowered(level, comm)
        except SceneError as error:
            self._stuck = str(error)
            return True

        def write() -> None:
            assert self._saved is not None
            self._saved.keep(self.done, level, run_of(begun_with(simulation)), ends)
            shape = self.scene.geometry
            if isinstance(shape, UserFile) and shape.own_mesh and level.sizes and not self._level.sizes and not ends:
                self._say(f"{Path(shape.file).name}: its cells are cut; curved sides stay the facets that they are")

        raise_together(comm, write)
        self._next = None if ends else level
        if comm.rank == 0 and not ends:
            self._say(f"round {len(self.done) + 1} takes about {price:.0f} s")
        return ends

    def _after(
        self, simulation: Simulation, steps: Sequence[StepResult], here: Round, spent: float
    ) -> tuple[Level, bool, float]:
        """The level after a round, whether the rounds end before it, and about how long it takes [s]; collective.

        Args:
            spent: seconds of all rounds.

        Raises:
            SceneError: the mesh cannot be refined, or no further round lowers the errors.
        """
        comm, dim, budget = simulation.mesh.comm, self.scene.dim, self.scene.accuracy.budget
        last, dear = len(self.done) >= MOST, max(goal.price for goal in here.goals)
        if dear:  # the same once more, with all its errors
            price = here.seconds * (1 + dear)
            return replace(self._level, pays=True), last or self._level.pays or spent + price > budget, price
        grows = _growing(simulation, steps)
        told, room = comm.bcast((simulation.seconds, self._room(comm)))

        def fits(move: Move) -> bool:
            return spent + move.price(told, dim, grows) <= budget and move.cells(dim) <= room

        orders = self._orders(simulation)
        move = replace(COARSE, order=orders[0])
        if not here.met and all(goal.known for goal in here.goals):
            best = next_move(here.goals, len(steps), dim, orders)
            if best is None:
                raise SceneError("neither a finer mesh nor more steps would lower it much")
            here.price = best.price(told, dim, grows) if best.enough else None
            smaller = None if fits(best) else next_move(here.goals, len(steps), dim, orders, fits)
            move = smaller or best
        near = here.met or any(goal.name.endswith(AT_NODES) and not goal.met for goal in here.goals)
        level, ends = self._refined(simulation, steps, move, here.goals, near), last or not fits(move)
        return level, ends, move.price(told, dim, grows)

    def _refined(
        self, simulation: Simulation, steps: Sequence[StepResult], move: Move, goals: Sequence[Standing], near: bool
    ) -> Level:
        """The level that a move leads to.

        Args:
            near: whether the mesh is refined around the contacts first.

        Raises:
            SceneError: the mesh cannot be refined, or the next round does not fit into the memory.
        """
        self._refuse_too_large(simulation.mesh.comm, move)
        level, tolerance = self._level, self._level.tolerance or self.scene.solver.tolerance
        if any(map(is_loose, goals)):
            tolerance = max(tolerance / TIGHTER, EXACT)
        level = replace(level, order=move.order, splits=level.splits * move.splits, tolerance=tolerance)
        if move.finer == 1 and not move.raises:
            return level
        if simulation.mesh.domain.topology.cell_type.name not in ADAPTABLE:
            level = replace(level, factor=level.factor * move.finer)
            level.scene(self.scene)
            return level
        self.scene.geometry.refuse_sizes(self.scene.request())
        return replace(level, sizes=self._sizes(simulation, steps, move, near))

    def _room(self, comm: Comm) -> float:
        """How many times the unknowns of a round there is memory for, by what the rounds have taken; collective."""
        taken, free = self._memory(comm)
        return free / taken if taken else np.inf

    def _memory(self, comm: Comm) -> tuple[float, float]:
        """Bytes that the rounds have taken, and that the next one may take; collective."""
        taken = float(comm.allreduce(max(peak() - self._before - LIBRARIES, 0.0)))
        return taken, taken + comm.bcast(available())

    def _refuse_too_large(self, comm: Comm, move: Move) -> None:
        """Refuse a move to more unknowns than there is memory for; collective."""
        taken, free = self._memory(comm)
        needed = taken * move.cells(self.scene.dim)
        if needed > free:
            raise SceneError(f"the next round would take about {needed / 1e9:.1f} GB of memory, of {free / 1e9:.1f} GB")

    def _sizes(self, simulation: Simulation, steps: Sequence[StepResult], move: Move, near: bool) -> SizeField | None:
        """Sizes of the next mesh, on rank 0."""
        if simulation.mesh.comm.rank:
            return None
        mesh, problem = simulation.data, simulation.problem
        cells = mesh.cells[:, : self.scene.dim + 1]  # corners
        volume = volumes(mesh.points, cells)
        middle = mesh.points[cells].mean(axis=1)
        if problem.model == "axisymmetric":
            volume = volume * 2 * np.pi * middle[:, 0]
        modulus = np.array([problem.bodies[name].modulus for name in mesh.bodies])[mesh.body]
        error = self._error * np.sqrt(volume / modulus)
        if near:
            error = error * nearness(simulation, steps, middle)
        used, place = np.unique(cells, return_inverse=True)
        wanted = adapted(mesh.points[used], place.reshape(cells.shape), error, move.finer, move.order)
        return (finer_sides(wanted, simulation, steps, move.finer) if move.order == 2 else wanted).smooth()

    def _orders(self, simulation: Simulation) -> Sequence[Literal[1, 2]]:
        """The order of this round, and 2 where the next one may have it: where its errors are known too."""
        shape, level = self.scene.geometry, self._level
        straight = isinstance(shape, UserFile) and shape.own_mesh  # cells are cut without their curved sides
        may = level.highest == 2 and simulation.stepper.chain.exact_laws
        return (level.order, 2) if level.order == 1 and may and not straight else (level.order,)


def _growing(simulation: Simulation, steps: Sequence[StepResult]) -> float:
    """Share of the seconds of solving a round that grow with its unknowns and steps; collective."""
    size, clock = size_of(simulation.system, steps), simulation.clock
    own = sum(map(clock.worked, ("assemble", "prepare", "iterate")))
    share = min(growing(clock, size, simulation.stepper.chain.stage) / max(own, TINY), 1.0)
    return float(simulation.mesh.comm.bcast(share))


def _in_vain(done: Sequence[Round]) -> bool:
    """Whether the last round, of order 2 like the one before, has not come closer to its goals."""
    last = [one for one in done[-2:] if one.level.order == 2]
    off = [max(goal.reached / goal.asked for goal in one.goals) for one in last]
    return len(off) == 2 and off[1] > off[0]


def _lowered(level: Level, comm: Comm) -> Level:
    """The level of order 1 with about as many unknowns, where order 2 is of no use, or its error is not known.

    Collective: rank 0 alone has sizes.
    """
    sizes = level.sizes and replace(level.sizes, sizes=level.sizes.sizes / 2)
    by_sizes = comm.bcast(sizes is not None)
    return replace(level, order=1, highest=1, sizes=sizes, factor=level.factor if by_sizes else level.factor / 2)


def _hash(scene: Scene) -> str:
    """Return a hash that is the same for a scene with the same goals, whatever the budget."""
    return scene_hash(replace(scene, accuracy=Accuracy(goals=scene.accuracy.goals)))


def _resolved(simulation: Simulation, steps: Sequence[StepResult]) -> bool:
    """Whether all contacts that touch do so with enough nodes; the same on every rank."""
    states = [[step.contacts[c.name].status != OPEN for step in steps] for c in simulation.system.contacts]
    touching = [int(np.any(closed, axis=0).sum()) for closed in states]
    return all(count == 0 or count >= TOUCHING[simulation.scene.dim] for count in touching)


def aiming(scene: Scene, goals: Sequence[str], budget: float | None) -> Scene:
    """A scene with the goals and the budget of the command line in addition to its own.

    Raises:
        SceneError: one is wrong.
    """
    if not goals and budget is None:
        return scene
    own = scene.accuracy
    accuracy = Accuracy(goals={**own.goals, **parsed(goals)}, budget=own.budget if budget is None else budget)
    if not accuracy.goals:
        raise SceneError("--budget: nothing to spend it on; name a goal with --accuracy NUMBER=1%")
    return replace(scene, accuracy=accuracy)


def parsed(words: Sequence[str]) -> dict[str, float]:
    """Goals of the command line, NAME=1% or NAME=0.01.

    Raises:
        SceneError: one is not of that form.

    >>> parsed(["plate.max_pressure=1%", "plate.stick_area=0.05"])
    {'plate.max_pressure': 0.01, 'plate.stick_area': 0.05}
    """
    found = {}
    for word in words:
        name, _, share = word.partition("=")
        try:
            found[name] = float(share[:-1]) / 100 if share.endswith("%") else float(share)
        except ValueError:
            raise SceneError(f"--accuracy {word[:80]}: expected NAME=1% or NAME=0.01") from None
    return found


@typed
def run(
    scene: Scene,
    folder: str | Path,
    watch: Watch | None = None,
    resume: bool = False,
    keep: Keep | None = None,
    sizes: SizeField | None = None,
    bodies: Bodies | None = None,
    began: float | None = None,
) -> tuple[Outcome, dict[str, Any]]:
    """Run a scene and leave its results in `folder`; collective.

    Where the scene has goals, `accuracy.goals`, rounds of runs follow until they are reached or the budget is spent;
    the status of one that has not reached them is "inaccurate". With `keep` or `sizes` it is one run all the same.

    Args:
        scene: what to solve.
        folder: where the results stand at the end; former ones are kept beside it.
        watch: what is told while the run works; absent: nobody.
        resume: go on where an earlier run of the same scene was stopped there, if there is one.
        keep: asked once all steps are solved, on every rank, with the errors of their numbers: whether the results are
            kept. None: they are.
        sizes: mesh sizes instead of those of the scene, on rank 0.
        bodies: of an earlier simulation, see `prepare`; rounds make their own.
        began: `time.perf_counter()` when the program began, whose imports count too; None: it begins here.

    Returns:
        How it ended, and the content of result.json; that is empty, and the status "abandoned", if they are not kept.

    Raises:
        SceneError, GeometryError: known before solving; nothing is written.
        MachineError: the results cannot be written, or a step to resume from is damaged.
    """
    watch = watch or Watch()
    if scene.accuracy.goals and keep is None and sizes is None:
        return Rounds(scene, watch.on_round)(folder, watch, resume)
    return once.run(scene, folder, watch, resume, keep, sizes, bodies, began)
