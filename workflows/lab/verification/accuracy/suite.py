"""The suite: each problem on three meshes in both orders, its stated errors beside those by far finer runs.

The error of the mesh is the distance to order 2 on a mesh two to three times finer, in the same steps; that of the time
steps the distance to 16 times the steps on the same mesh; that of the iteration the distance of a loose iteration
to the run; the total the distance to both together, the fine mesh in 16 times the steps. Where order 2 on the finest of
the three meshes is farther from the fine mesh than a run of order 1 is, the latter's error is not known.
"""

from __future__ import annotations

import os
import resource
import time as clock
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import numpy as np

from stickslip import Scene, Solver, StepError, StickslipError, read
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.lab.verification.accuracy.drawn import FIRST, MORE, RUN, SECOND, TRUTH, Drawn
from stickslip.workflows.lab.verification.accuracy.judge import (
    ITERATION,
    MESH,
    SURE,
    TIME,
    TOTAL,
    Answer,
    Case,
    Endless,
    compare,
    endless,
    solve,
)
from stickslip.workflows.lab.verification.accuracy.problems import MESHES, PROBLEMS, Problem

ORDERS: tuple[Literal[1, 2], ...] = (1, 2)
LOOSE = 1e-2  # tolerance of the loose iteration
Key = tuple[Literal[1, 2], float]  # order, and factor on the mesh sizes


@dataclass(frozen=True, kw_only=True)
class Study:
    """Results of a problem."""

    problem: str
    cases: tuple[Case, ...] = ()
    endless: tuple[Endless, ...] = ()
    unknowns: tuple[int, ...] = ()  # of order 1 on the meshes, and of the truth
    seconds: float = 0.0
    price: float = np.nan  # of the stated errors, in seconds of all else of the run
    failure: str = ""  # why it has given nothing


def studies(
    study: Callable[[Any], Study], tasks: Iterable[Any], jobs: int, limit: int = resource.RLIM_INFINITY
) -> Iterator[Study]:
    """Studies in their order, each in a process of its own, of one core and so many seconds of its time."""
    os.environ.update(ONE_THREAD)
    with ThreadPoolExecutor(jobs) as threads:
        yield from threads.map(partial(_performed, study, limit), tasks)


def _performed(study: Callable[[Any], Study], limit: int, task: Any) -> Study:
    began = clock.perf_counter()
    with ProcessPoolExecutor(1, get_context("spawn"), _limited, (limit,)) as process:
        try:
            found = process.submit(_tried, study, task).result()
        except BrokenProcessPool:
            found = Study(problem=str(task), failure=f"no end after {limit} s of the processor's time")
    return replace(found, seconds=clock.perf_counter() - began)


def _tried(study: Callable[[Any], Study], task: Any) -> Study:
    try:
        return study(task)
    except StickslipError as error:
        return Study(problem=str(task), failure=str(error))


def _limited(seconds: int) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))


def studied(name: str) -> Study:
    """The study of a problem."""
    return judged(name, PROBLEMS[name], solved(PROBLEMS[name]))


@dataclass(frozen=True)
class Draft:
    """A drawn scene and the folder in which its files are written."""

    scene: Drawn
    folder: Path
    budget: float | None = None  # see `solve`

    def __str__(self) -> str:
        return self.scene.name


def judged_alone(draft: Draft) -> Study:
    """The study of a drawn scene."""
    name, order = draft.scene.name, draft.scene.order
    files = draft.scene.files(draft.folder)
    run = solve(read(files[RUN]), budget=draft.budget)
    truth, second, first = (
        solve(read(files[key]), errors=False, sharp=run.times).at(run.times) for key in (TRUTH, SECOND, FIRST)
    )
    grow = [*_endless(name, {1.0: run}, (first, second, truth), (1.0, *draft.scene.cells))]
    doubt = {key: np.abs(value - second.values[key]) for key, value in truth.values.items()}
    return Study(
        problem=name,
        cases=limited(compare(name, order, 1.0, TOTAL, run, truth, doubt), grow),
        endless=tuple(grow),
        unknowns=(run.unknowns, truth.unknowns),
        price=run.price,
    )


def limited(cases: Iterable[Case], found: Iterable[Endless]) -> tuple[Case, ...]:
    """The cases of numbers that have a limit."""
    growing = {(each.time, each.name) for each in found if each.true}
    return tuple(case for case in cases if (case.time, case.name) not in growing)


def drawn_studies(
    scenes: Iterable[Drawn], number: int, jobs: int, folder: Path, budget: float | None = None
) -> Iterator[Study]:
    """So many scenes; others are taken for those that end without an answer, which come too, with why.

    Args:
        budget: see `solve`.
    """
    left, drafts = number, (Draft(scene, folder / scene.name, budget) for scene in scenes)
    while some := [*islice(drafts, left)]:
        for study in studies(judged_alone, some, jobs, 3 * 60):
            left -= not study.failure
            yield study


@dataclass(frozen=True, kw_only=True)
class Runs:
    """All runs of a problem, by order and mesh; truths at the times of the problem."""

    own: Mapping[Key, Answer]  # whose stated errors are judged
    many: Mapping[Key, Answer]  # on the same mesh, in `MORE` times the steps
    loose: Mapping[Key, Answer]  # by a loose iteration
    fine: Answer  # of order 2 on the fine mesh
    best: Answer | None  # the same in `MORE` times the steps


def solved(problem: Problem) -> Runs:
    """Solve a problem on all its meshes."""
    times = np.array(problem.scene().requested_times())
    keys: list[Key] = [(order, mesh) for order in ORDERS for mesh in MESHES]
    fine = problem.meshed(2, problem.fine)
    loosely = dict[Key, Answer]()
    for key in (key for key in keys if key[1] == MESHES[0]):
        with suppress(StepError):  # an iteration need not come to an end by itself alone
            loosely[key] = solve(loose(problem.meshed(*key))).at(times)
    return Runs(
        own={key: solve(problem.meshed(*key)) for key in keys},
        many={key: solve(in_steps(problem.meshed(*key), MORE), errors=False).at(times) for key in keys},
        loose=loosely,
        fine=solve(fine, errors=False, sharp=times).at(times),
        best=solve(in_steps(fine, MORE), errors=False, sharp=times).at(times) if problem.long else None,
    )


def judged(name: str, problem: Problem, runs: Runs) -> Study:
    """Compare the runs of a problem."""
    fine, best = (known(each, problem) if each else None for each in (runs.fine, runs.best))
    assert fine is not None
    own = {mesh: runs.own[1, mesh] for mesh in MESHES}
    found = tuple(_endless(name, own, [*(runs.own[2, mesh] for mesh in MESHES), runs.fine], (*MESHES, problem.fine)))
    cases = list[Case]()
    near = runs.own[2, min(MESHES)]
    distance = {key: np.abs(value - near.values[key]) for key, value in fine.values.items()}
    for (order, mesh), run in runs.own.items():
        doubt = {key: value / SURE for key, value in distance.items()} if order == 1 else None
        to_mesh = [*compare(name, order, mesh, MESH, run, fine, doubt)]
        to_mesh += [*compare(name, order, mesh, TOTAL, run, best, doubt)] if best else []
        cases += limited(to_mesh, found)
        cases += compare(name, order, mesh, TIME, run, runs.many[order, mesh])
    for (order, mesh), run in runs.loose.items():
        cases += compare(name, order, mesh, ITERATION, run, runs.own[order, mesh])
    return Study(
        problem=name,
        cases=tuple(cases),
        endless=found,
        unknowns=(*(runs.own[1, mesh].unknowns for mesh in MESHES), fine.unknowns),
    )


def known(truth: Answer, problem: Problem) -> Answer:
    """The truth with the exact values of the last step, where they are known."""
    values = dict(truth.values)
    for name, value in (problem.exact or {}).items():
        values[name] = np.append(values[name][:-1], value)
    return replace(truth, values=values)


def in_steps(scene: Scene, times: int) -> Scene:
    """The same history in so many times the steps."""
    return replace(scene, steps=replace(scene.steps, count=times * scene.steps.count))


def loose(scene: Scene) -> Scene:
    """The same by iterative volume solves, and an iteration that ends early."""
    return replace(scene, solver=Solver(method="surface-uzawa", surface="matrix-free", tolerance=LOOSE))


def _endless(
    name: str, said_by: Mapping[float, Answer], answers: Sequence[Answer], sizes: Sequence[float]
) -> Iterator[Endless]:
    """Largest pressures that grow without end, and what runs say of them.

    Args:
        said_by: runs by mesh.
        answers: on meshes of these sizes, each finer than the one before.
    """
    for key in (key for key in answers[-1].values if key.endswith((".max_pressure", ".max_von_mises"))):
        grow = endless([answer.ends[key] for answer in answers], sizes)
        for mesh, run in said_by.items():
            for k, time in enumerate(run.times):
                said = bool(run.endless[key][k])
                if said or grow[k]:
                    yield Endless(problem=name, mesh=mesh, time=float(time), name=key, said=said, true=bool(grow[k]))
