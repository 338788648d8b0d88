"""The suite: each problem on three meshes in both orders, its stated errors beside those by far finer runs.

The error of the mesh is the distance to order 2 on a mesh two to three times finer, in the same steps; that of the time
steps the distance to 16 times the steps on the same mesh; that of the iteration the distance of a loose iteration
to the run; the total the distance to both together, the fine mesh in 16 times the steps. Where order 2 on the finest of
the three meshes is farther from the fine mesh than a run of order 1 is, the latter's error is not known.
"""

from __future__ import annotations

import os
import time as clock
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import Literal

import numpy as np

from stickslip import Scene, Solver, StepError, StickslipError
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.lab.verification.accuracy.judge import (
    ITERATION,
    MESH,
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

MORE = 16  # times the steps
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
    failure: str = ""  # why it has given nothing


def studies(names: Sequence[str], jobs: int) -> Iterator[Study]:
    """The problems in their order, each in a process of one core."""
    os.environ.update(ONE_THREAD)
    with ProcessPoolExecutor(jobs, get_context("spawn"), max_tasks_per_child=1) as processes:
        yield from processes.map(studied, names)


def studied(name: str) -> Study:
    """The study of one problem, or why there is none."""
    began = clock.perf_counter()
    try:
        found = judged(name, PROBLEMS[name], solved(PROBLEMS[name]))
    except StickslipError as error:
        found = Study(problem=name, failure=str(error))
    return replace(found, seconds=clock.perf_counter() - began)


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
        fine=solve(fine, errors=False, sharp=True).at(times),
        best=solve(in_steps(fine, MORE), errors=False, sharp=True).at(times) if problem.long else None,
    )


def judged(name: str, problem: Problem, runs: Runs) -> Study:
    """Compare the runs of a problem."""
    fine, best = (known(each, problem) if each else None for each in (runs.fine, runs.best))
    assert fine is not None
    found = tuple(_endless(name, problem, runs))
    growing = {(each.time, each.name) for each in found if each.true}
    cases = list[Case]()
    near = runs.own[2, min(MESHES)]
    distance = {key: np.abs(value - near.values[key]) for key, value in fine.values.items()}
    for (order, mesh), run in runs.own.items():
        doubt = distance if order == 1 else None
        to_mesh = [*compare(name, order, mesh, MESH, run, fine, doubt)]
        to_mesh += [*compare(name, order, mesh, TOTAL, run, best, doubt)] if best else []
        cases += [case for case in to_mesh if (case.time, case.name) not in growing]
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


def _endless(name: str, problem: Problem, runs: Runs) -> Iterator[Endless]:
    """Largest pressures that grow without end, by order 2 on all meshes, and what order 1 says of them."""
    sizes = (*MESHES, problem.fine)
    for key in (key for key in runs.fine.values if key.endswith(".max_pressure")):
        grow = endless([*(runs.own[2, mesh].values[key] for mesh in MESHES), runs.fine.values[key]], sizes)
        for mesh in MESHES:
            for k, time in enumerate(runs.fine.times):
                said = bool(runs.own[1, mesh].endless[key][k])
                if said or grow[k]:
                    yield Endless(problem=name, mesh=mesh, time=float(time), name=key, said=said, true=bool(grow[k]))
