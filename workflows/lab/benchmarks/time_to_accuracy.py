"""Seconds to an accuracy: `python -m stickslip.workflows.lab.benchmarks.time_to_accuracy -o PAGE`.

Each program climbs a ladder of meshes of its own: cells, order, penalty and linear solver are those that came closest
soonest. The page tells after how many seconds of the processor a number is within 1 % and .1 % of the truth, and stays
there on all finer meshes of the ladder. The truth is decided on three meshes of order 2. `--only` names rows whose
measurements are made again; without it, what a file keeps is not repeated. One thread.
"""

from __future__ import annotations

import json
import os
import tempfile
import time as clock
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from stickslip import Accuracy, Counters, Scene, StepResult, Watch, prepare, read
from stickslip.geometry.memory import peak
from stickslip.solvers.parallel.counters import Clock, processors
from stickslip.workflows.accuracy.rounds import Rounds
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.cost.pictures import log_log
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.formats.templates import render
from stickslip.workflows.lab.benchmarks.own_process import Run, apart, child, kept
from stickslip.workflows.lab.benchmarks.peers.programs import PROGRAMS, write_bolted, write_problem
from stickslip.workflows.pictures.sheet import CURVES, INK, PALE, Sheet

os.environ.update(ONE_THREAD)  # before the first operation that would start them
STARTED = clock.process_time()  # libraries are loaded

ASKED = (1e-2, 1e-3)
LIMIT = 15.0  # seconds of the processor that a point may be expected to take
Numbers = Mapping[str, float]
COLUMNS = ("ladder", "seconds", "times", "error", "dofs", "mesh", "start", "memory")
KEPT = Path("results/time_to_accuracy")
OURS, ROUNDS = "stickslip, mesh by hand", "stickslip, --accuracy"


@dataclass(frozen=True, kw_only=True)
class Ladder:
    """Meshes that a program is given, one after the other, until its numbers are right.

    Attributes:
        program: `OURS`, or the name of one of `PROGRAMS`.
        cells: a grid of quadrilaterals or hexahedra, or a free mesh of triangles or tetrahedra.
        order: of the displacements.
        first: cells of the first mesh, in those of the scene.
        settings: what problem.json has more, such as a penalty in units of E / height.
        finer: cells of a mesh in those of the one before.
    """

    program: str
    cells: Literal["tensor", "simplex"] = "tensor"
    order: Literal[1, 2] = 1
    first: float = 4.0
    settings: Mapping[str, Any] = field(default_factory=dict)
    finer: float = 0.6

    @property
    def name(self) -> str:
        words = "grid" if self.cells == "tensor" else "free mesh"
        told = [f"{key} {value:g}" if isinstance(value, float) else str(value) for key, value in self.settings.items()]
        return ", ".join([f"{words} of order {self.order}", *told])


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A scene, its numbers, and the ladders that are climbed; sizes of meshes are in those of the scene.

    Attributes:
        title: for the page.
        scene: a ready one, of one body, one support that moves, and one contact with a rigid obstacle; or a file beside
            this one, of two plates and a bolt.
        change: settings in it.
        goals: numbers of the contact, or whole names of others, by what the page calls them.
        ladders: what is climbed.
        start: the mesh that rounds begin with.
        truth: three meshes of order 2.
        grids: whether its builder has them, beside free meshes.
        note: what the page says of the rows.
    """

    title: str
    scene: str
    change: Sequence[str] = ()
    goals: Mapping[str, str]
    ladders: Sequence[Ladder]
    start: float
    truth: Sequence[float]
    grids: bool = True
    note: str = ""

    def on(self, order: int, cells: str, size: float) -> Scene:
        """Return the scene on a mesh, of cells `size` times as large as its own."""
        keys = [f"geometry.order={order}", "output={ error = false, pictures = false }"]
        beside = Path(__file__).with_name(f"{self.scene}.toml")
        scene = read(
            beside if beside.exists() else self.scene,
            [*self.change, *keys, *([f'geometry.cells="{cells}"'] if self.grids else [])],
        )
        return replace(scene, geometry=scene.geometry.refined(size))


PROBLEMS = {
    name: Problem(**table | {"ladders": tuple(Ladder(**ladder) for ladder in table["ladders"])})
    for name, table in tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")).items()
}


def _run(problem: Problem, ladder: Ladder, size: float) -> Run:
    """Return what our program finds on a mesh, in this process, after a first run that loads and compiles."""
    scene = problem.on(ladder.order, ladder.cells, size)
    list(prepare(problem.on(ladder.order, ladder.cells, problem.start)).steps())
    counters = Counters()
    counters.clock = Clock(now=clock.process_time)
    began = clock.process_time()
    simulation = prepare(scene, counters=counters)
    *_, last = simulation.steps()
    seconds, mesh = clock.process_time() - began, simulation.seconds.mesh
    found = {goal: number_of(last, goal) for goal in problem.goals.values()}
    dofs, memory = simulation.system.constraints.free_total, peak() / 1e9
    return {"seconds": seconds - mesh, "mesh": mesh, "start": STARTED, "dofs": dofs, "memory": memory, "found": found}


def number_of(step: StepResult, goal: str) -> float:
    """Return a number of the only contact, or of a bolt by its whole name."""
    (contact,), (_, owner, key) = step.contacts.values(), f"..{goal}".rsplit(".", 2)
    return float(getattr(step.bolts[owner] if owner else contact, key))


def _rounds(problem: Problem, goal: str, asked: float) -> Run:
    """Return what the rounds of `--accuracy` find, whose seconds count all of them, meshes, results and audit."""
    scene = problem.on(1, "simplex", problem.start)
    list(prepare(scene).steps())
    (contact,) = scene.contacts
    name = goal if "." in goal else f"{contact}.{goal}"
    goals = Accuracy(goals={name: asked})
    scene = replace(scene, output=replace(scene.output, error=True), accuracy=goals)
    with tempfile.TemporaryDirectory() as folder:
        began = processors()
        _, content = Rounds(scene, lambda line: None)(Path(folder) / "run", Watch())
        seconds = processors() - began
    last = content["accuracy"]["rounds"][-1]
    told = last["goals"][name]
    counts = {"dofs": last["unknowns"], "count": len(content["accuracy"]["rounds"]), "met": content["accuracy"]["met"]}
    found = {"found": {goal: told["value"]}, "stated": told["error"]}
    return {"seconds": seconds, "mesh": 0.0, "start": STARTED, "memory": peak() / 1e9} | counts | found


def _peer(problem: Problem, ladder: Ladder, size: float, folder: Path) -> Run:
    """Return what another program finds on a mesh, which gmsh makes here: its seconds are added to those of reading it.

    Args:
        problem: whose scene gives body, obstacle and motion.
        ladder: names the program and its settings.
        size: of the cells, in those of the scene.
        folder: for the files that the program reads.
    """
    program = next(program for program in PROGRAMS if program.name == ladder.program)
    if not (command := program.command()):
        return {"status": f"not installed: {program.install}"}
    began = clock.process_time()
    scene = problem.on(ladder.order, ladder.cells, size)
    path = write_bolted(scene, folder) if "bolts" in scene.sections else write_problem(scene, folder)
    drawn = clock.process_time() - began
    path.write_text(json.dumps(json.loads(path.read_text()) | ladder.settings))
    found = child([*command, str(path), *program.arguments], LIMIT)
    if "steps" in found:
        last = found.pop("steps")[-1]
        known = {goal: last[goal] for goal in problem.goals.values() if goal in last}
        found |= {"mesh": found["mesh"] + drawn, "found": known}
    return found


def climbed(name: str, ladder: Ladder, truth: Numbers, folder: Path) -> list[Run]:
    """Return measurements on finer and finer meshes, until the first number is right twice, or one would take too long.

    It also ends where the number does not change any more, as that of a penalty.

    Args:
        name: of the problem.
        ladder: of meshes.
        truth: the true numbers.
        folder: that keeps each measurement in a file.
    """
    problem, before, found = PROBLEMS[name], list[Run](), list[Run]()
    goal = next(iter(problem.goals.values()))
    while len(before) < 3 or any(abs(run["found"][goal] / truth[goal] - 1) > min(ASKED) for run in before[-2:]):
        seconds, values = (
            [*map(value, before[-2:])] for value in (itemgetter("seconds"), lambda run: run["found"][goal])
        )
        settled = len(before) > 2 and abs(values[1] / values[0] - 1) < min(ASKED) / 3
        if settled or (len(before) > 1 and seconds[1] ** 2 / seconds[0] > LIMIT):
            break
        k = len(before)
        size, path = ladder.first * ladder.finer**k, folder / f"{k}.json"
        ours = partial(_run, problem, ladder, size)
        run = kept(path, ours if ladder.program == OURS else partial(_peer, problem, ladder, size, folder / str(k)))
        found.append(run | {"size": size})
        if "found" not in run:
            break
        before.append(run)
    return found


def truths(name: str, folder: Path) -> tuple[dict[str, float], dict[str, float]]:
    """Return the numbers on the finest of three meshes of order 2, and how far those on the second are from them.

    The distances are relative. What converges like the cell size or faster is no farther from the true number than
    from the mesh before it, whose cells are half as large again or more.
    """
    folder.mkdir(parents=True, exist_ok=True)
    problem, ladder = PROBLEMS[name], Ladder(program=OURS, order=2)
    found = [
        kept(folder / f"truth_{k}.json", partial(apart, _run, problem, ladder, size))["found"]
        for k, size in enumerate(problem.truth)
    ]
    return found[-1], {goal: abs(found[-2][goal] / value - 1) for goal, value in found[-1].items()}


@dataclass(frozen=True)
class Curve:
    """What a program has found on a ladder, or in its rounds.

    Attributes:
        program: its name.
        ladder: name of the ladder.
        runs: from coarse to fine; those that failed have a `status`, and nothing `found`.
    """

    program: str
    ladder: str
    runs: tuple[Run, ...]

    @property
    def maker(self) -> str:
        """The program, whatever solves its linear systems."""
        return self.program.split(",")[0] if self.program not in (OURS, ROUNDS) else self.program

    @property
    def way(self) -> str:
        """How the maker's program was used."""
        return f"{self.program}, {self.ladder}".removeprefix(f"{self.maker}, ")

    def errors(self, goal: str, truth: float) -> list[tuple[float, float, Run]]:
        """Return seconds, relative error and run, of those that know the number."""
        known = [run for run in self.runs if goal in run.get("found", ())]
        return [(run["seconds"], abs(run["found"][goal] / truth - 1), run) for run in known]

    def reached(self, goal: str, truth: float, asked: float) -> Run | None:
        """Return the run from which on all are within an accuracy; of rounds, the one that was asked for it."""
        points = self.errors(goal, truth)
        if self.program == ROUNDS:
            return next((run for _, _, run in points if run["asked"] == asked and run["met"]), None)
        bad = [k for k, (_, error, _) in enumerate(points) if error > asked]
        return next((run for _, _, run in points[bad[-1] + 1 if bad else 0 :]), None)


def rows(problem: Problem, curves: Sequence[Curve], truth: Numbers, spread: Numbers) -> Iterator[Run]:
    """Yield what each program takes for each number and accuracy, its best ladder alone.

    Args:
        problem: whose numbers are asked for.
        curves: ours first.
        truth: the true numbers.
        spread: how well they are known, relatively; what is not known to a third of an accuracy has no row.
    """
    for (word, goal), asked in product(problem.goals.items(), ASKED):
        if spread[goal] > asked / 3:
            continue
        hand = None
        for maker in dict.fromkeys(curve.maker for curve in curves):
            mine = [curve for curve in curves if curve.maker == maker]
            met = [(run, curve) for curve in mine if (run := curve.reached(goal, truth[goal], asked))]
            row: Run = dict.fromkeys(COLUMNS) | {"number": word, "asked": asked, "program": maker}
            if met:
                run, curve = min(met, key=lambda pair: pair[0]["seconds"])
                hand = hand or run["seconds"]
                error = abs(run["found"][goal] / truth[goal] - 1)
                row |= run | {"ladder": curve.way, "times": run["seconds"] / hand, "error": error}
            else:
                closest = [
                    run.get("stated", error) for curve in mine for _, error, run in curve.errors(goal, truth[goal])[-1:]
                ]
                failed = dict.fromkeys(run["status"] for curve in mine for run in curve.runs if "found" not in run)
                row["ladder"] = (
                    f"ends at {'± ' * (maker == ROUNDS)}{100 * min(closest):.3g} %"
                    if closest
                    else "; ".join(failed) or "does not tell it"
                )
            yield row


def draw(path: Path, problem: Problem, curves: Sequence[Curve], truth: Numbers, spread: Numbers) -> None:
    """Draw the errors of each number over the seconds, none below how well the truth is known.

    Raises:
        MachineError: the disk is full.
    """
    sheet = Sheet(10.0, 4.6, dpi=110)
    makers, wide = list(dict.fromkeys(curve.maker for curve in curves)), 9.0 / len(problem.goals)
    for k, (word, goal) in enumerate(problem.goals.items()):
        axes = sheet.axes(0.75 + k * wide, 1.15, wide - 0.75, 2.75)
        log_log(axes)
        for curve in curves:
            points = [(seconds, max(error, spread[goal])) for seconds, error, _ in curve.errors(goal, truth[goal])]
            order = "2" if "order 2" in curve.ladder else "1"
            look: dict[str, Any] = {"marker": {"1": "o", "2": "s"}[order], "linewidth": 1.3, "markersize": 4}
            if curve.program == ROUNDS:
                look = {"marker": "*", "linestyle": "none", "markersize": 11}
            if points:
                axes.plot(*zip(*points, strict=True), color=CURVES[makers.index(curve.maker)], **look)
        for asked in ASKED:
            axes.axhline(asked, color=PALE, linewidth=0.8, linestyle=(0, (4, 3)))
        axes.yaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
        axes.set_xlabel("seconds of the processor, without meshing and start", fontsize=8, color=INK)
        axes.set_ylabel(f"error of {word}", fontsize=8, color=INK)
    for k, maker in enumerate(makers):
        sheet.write(0.75 + k * 9.0 / len(makers), 0.45 - 0.25 * (k % 2), maker, color=CURVES[k], fontweight="bold")
    told = "discs: order 1; squares: order 2; stars: all rounds of --accuracy; a line is a ladder of meshes"
    sheet.head(problem.title, told, 0.75)
    sheet.save(path)


def measured(name: str, only: str = "") -> tuple[list[Curve], dict[str, float], dict[str, float]]:
    """Return all curves of a problem, its truth and how well it is known; what has a file is not measured again."""
    problem, folder = PROBLEMS[name], KEPT / name
    truth, spread = truths(name, folder)
    curves = list[Curve]()
    for ladder in problem.ladders:
        place = folder / "-".join((ladder.program, ladder.name)).replace(", ", "-").replace(" ", "_")
        _forget(only in f"{ladder.program}, {ladder.name}" and bool(only), place)
        own = ladder.program == OURS and not place.joinpath("0.json").exists()  # libraries are loaded once
        runs = apart(climbed, name, ladder, truth, place) if own else climbed(name, ladder, truth, place)
        curves.append(Curve(ladder.program, ladder.name, tuple(runs)))
    found = list[Run]()
    for goal, asked in product(problem.goals.values(), ASKED):
        if spread[goal] <= asked / 3:
            place = folder / f"rounds_{goal}_{asked:g}"
            _forget(only in ROUNDS and bool(only), place)
            found.append(kept(place / "0.json", partial(apart, _rounds, problem, goal, asked)) | {"asked": asked})
    return [*curves, Curve(ROUNDS, "rounds from a free mesh", tuple(found))], truth, spread


def _forget(again: bool, place: Path) -> None:
    place.mkdir(parents=True, exist_ok=True)
    for path in place.glob("*.json") if again else ():
        path.unlink()


def main(
    names: Annotated[list[str] | None, typer.Argument(help=f"of {', '.join(PROBLEMS)} [all]")] = None,
    only: Annotated[str, typer.Option(help="programs and ladders whose name contains this are measured again")] = "",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="page to write, with pictures beside it")
    ] = None,
) -> None:
    """Measure what is missing, print a line for each row, and write the page."""
    sections = []
    for name in names or PROBLEMS:
        problem, (curves, truth, spread) = PROBLEMS[name], measured(name, only)
        found = list(rows(problem, curves, truth, spread))
        sections.append({"name": name, "problem": problem, "truth": truth, "spread": spread, "rows": found})
        for row in found:
            print(name, {key: value for key, value in row.items() if key != "found"}, flush=True)
        if output:
            draw(output.with_name(f"{output.stem}_{name}.png"), problem, curves, truth, spread)
    if output:
        page = render("lab/benchmarks/templates/time_to_accuracy.md", sections=sections, limit=LIMIT, page=output.stem)
        write_aside(output, page.encode())


if __name__ == "__main__":
    typer.run(main)
