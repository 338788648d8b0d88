"""Solve discrete Coulomb problems, each with several methods: `stickslip fclib`."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from stickslip import VERSION
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError
from stickslip.solvers.interface.discrete import discrete_problem, rank
from stickslip.solvers.stepping.discrete_chain import AUTO, refuse_unusable, solve, usable
from stickslip.workflows.commands.process import say
from stickslip.workflows.formats.fclib import LocalProblem, read_problem, write_solved
from stickslip.workflows.formats.files import write_json, write_output
from stickslip.workflows.pictures.performance_profile import FACTORS, draw_profile, shares
from stickslip.workflows.run.folder import ResultsFolder
from stickslip.workflows.run.ranks import refuse_mpirun

ALL = "all"
NAME = 38  # letters of a problem's name
HEAD = f"{'problem':{NAME}} d contacts      rank  method                  iterations  seconds  residual"


@dataclass(frozen=True, kw_only=True)
class Result:
    """One problem, solved with one method."""

    method: str  # that was asked for
    by: str  # that found the answer
    solved: bool
    iterations: int
    seconds: float  # of scaling, preparing and solving; not of reading and writing
    residual: float  # |r - P_K(r - v)| / |q| after scaling


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One problem with the results of all methods."""

    file: str
    dim: int
    contacts: int
    rank: int | None  # of W; None: too large to compute
    results: tuple[Result, ...]

    def lines(self) -> Iterator[str]:
        """A line for each result."""
        rank = f"{'?' if self.rank is None else self.rank}/{self.dim * self.contacts}"
        for found in self.results:
            by = found.method if found.by == found.method else f"{found.method}: {found.by}"
            yield (
                f"{Path(self.file).stem[:NAME]:{NAME}} {self.dim} {self.contacts:8} {rank:>9}  {by:22}  "
                f"{found.iterations:10} {found.seconds:8.3f}  {found.residual:.1e}"
                f"{'' if found.solved else '  NOT SOLVED'}"
            )


def solve_all(files: Sequence[Path], output: Path, asked: Sequence[str], tolerance: float, report: Path | None) -> int:
    """Solve the problems, print a line for each, write copies with solutions into `output`.

    Args:
        files: of FCLIB; they are only read.
        output: folder of the copies.
        asked: names of methods, or `all`; none: `auto`.
        tolerance: on the residual.
        report: file for the figures, JSON.

    Returns:
        Exit code: 0, or 3 if no method has solved some problem.

    Raises:
        SceneError: a file, a method or an option is wrong; nothing is written.
        MachineError: the disk is full, or the report cannot be written; the copies are there then.
    """
    refuse_mpirun("fclib: solves small problems on one core")
    if not 0 < tolerance < 1:
        raise SceneError(f"--tolerance {tolerance:g}: must lie between 0 and 1")
    methods = _methods(asked)
    folder = ResultsFolder(output)
    _refuse_clashes(files, folder)
    problems = {path: read_problem(path) for path in files}
    with _filled(folder, [*(path.name for path in files), "profile.png", "fclib.json"]):
        print(HEAD)
        entries = []
        for path, problem in problems.items():
            entries.append(_entry(path, problem, methods, tolerance, folder.work))
            say("\n".join(entries[-1].lines()))
        found = {name: seconds(entries, name) for name in methods}
        say("\n".join(summary(entries, found)))
        if len(methods) > 1:
            draw_profile(folder.work / "profile.png", f"{len(entries)} discrete problems at {tolerance:g}", found)
        content = _content(entries, tolerance, found)
        write_json(folder.work / "fclib.json", content)
    if report is not None:
        write_json(report, content, write_output)
    every = all(any(result.solved for result in entry.results) for entry in entries)
    return 0 if every else 3


def seconds(entries: Sequence[Entry], method: str) -> list[float]:
    """Time of a method on each problem [s]; inf where it did not solve it."""
    results = [result for entry in entries for result in entry.results if result.method == method]
    return [result.seconds if result.solved else math.inf for result in results]


def summary(entries: Sequence[Entry], found: Mapping[str, Sequence[float]]) -> Iterator[str]:
    """Count the problems that each method has solved, with times; with several methods also their profile."""
    for name, times in found.items():
        solved = [time for time in times if math.isfinite(time)]
        yield f"{name}: {len(solved)} of {len(entries)} solved, in {sum(solved):.3f} s"
    if len(found) > 1:
        yield "share of the problems that a method solves within a factor of the fastest one's time:"
        yield f"{'method':16} " + " ".join(f"{factor:>6g}" for factor in FACTORS) + "    any"
        for name, values in shares(found).items():
            yield f"{name:16} " + " ".join(f"{100 * value:5.0f}%" for value in values)


def _methods(asked: Sequence[str]) -> tuple[str, ...]:
    """The methods to try, each once."""
    for name in asked:
        if name != ALL:
            refuse_unusable(name)
    every = [known for name in asked or (AUTO,) for known in (usable() if name == ALL else (name,))]
    return tuple(dict.fromkeys(every))


def _refuse_clashes(files: Sequence[Path], folder: ResultsFolder) -> None:
    """Check that copies do not overwrite each other, nor the folder's replacement move what is read."""
    names = [path.name for path in files]
    for path in files:
        if names.count(path.name) > 1:
            raise SceneError(f"{path.name}: two files of this name, but one folder for their copies")
        for place in folder.replaced:
            if path.resolve().is_relative_to(place.resolve()):
                raise SceneError(f"{path}: lies in {place}, which is replaced; choose another folder with -o")


@contextmanager
def _filled(folder: ResultsFolder, names: Sequence[str]) -> Iterator[None]:
    """The working folder, put in its place if all goes well, and removed if not."""
    folder.start()
    folder.declare(names)
    try:
        yield
        folder.finish()
    except BaseException:  # also on Ctrl-C
        folder.abandon()
        raise


def _entry(path: Path, stored: LocalProblem, methods: Sequence[str], tolerance: float, folder: Path) -> Entry:
    """Solve a problem with each method, and write the copy with the first answer that is good enough, or the best."""
    results: list[Result] = []
    answers: list[tuple[bool, float, Array]] = []  # not solved, residual if so, r
    for method in methods:
        began = clock.perf_counter()
        problem = discrete_problem(stored.W, stored.q, stored.mu)
        outcome = solve(problem, method, tolerance)
        taken, solution = clock.perf_counter() - began, outcome.solution
        results.append(
            Result(
                method=method,
                by=outcome.method,
                solved=outcome.solved,
                iterations=outcome.iterations,
                seconds=taken,
                residual=solution.residual,
            )
        )
        answers.append((not outcome.solved, 0.0 if outcome.solved else solution.residual, solution.p))
    first = min(range(len(answers)), key=lambda k: answers[k][:2])
    r, u = problem.reactions(answers[first][2]), problem.velocities(answers[first][2])
    chosen = results[first]
    status = "solved" if chosen.solved else "not solved"
    about: dict[str, str | float] = {"method": chosen.by, "residual": chosen.residual, "status": status}
    write_solved(path, folder / path.name, {"u": u, "r": r, **stored.others(r)}, about)
    return Entry(
        file=str(path),
        dim=stored.dim,
        contacts=len(stored.mu),
        rank=rank(problem.surface.matrix),
        results=tuple(results),
    )


def _content(entries: Sequence[Entry], tolerance: float, found: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """The figures as plain data."""
    return {
        "format": 1,
        "version": VERSION,
        "tolerance": tolerance,
        "problems": [asdict(entry) for entry in entries],
        "solved": {name: sum(map(math.isfinite, times)) for name, times in found.items()},
        "profile": {"factors": [*FACTORS, None], "shares": shares(found)},
    }
