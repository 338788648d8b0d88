"""Savings of adaptive rounds beside uniform meshes: `python -m stickslip.workflows.lab.benchmarks.adaptive`.

The rounds of `--accuracy` begin on a coarse mesh of one size. Beside them the same scene is refined as a whole, from
the same mesh in order 1 and 2, and from one that is graded towards the contact by hand, until the true error is below
what was asked, in as many steps as the last round. Of these runs the last one alone counts, as if its mesh had been
known before; of the rounds all count, with their estimates of errors. And as nobody knows that mesh before, the mesh of
one size is also halved, each run with its estimate, until the *stated* error is below: all of these count. The true
error is the distance to order 2 on a
far finer mesh, for the ball in the axisymmetric model. CPU seconds, one thread.
"""

from __future__ import annotations

import gc
import tempfile
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer

from stickslip import Accuracy, Builder, Coulomb, Output, Scene, SolverError, Steps, Watch, prepare
from stickslip.solvers.results.step_result import values
from stickslip.workflows.accuracy.rounds import Rounds
from stickslip.workflows.formats.templates import render
from stickslip.workflows.lab.benchmarks.own_process import apart
from stickslip.workflows.lab.verification.cases import cattaneo, hertz, punch, raous
from stickslip.workflows.lab.verification.cases.raous import SIDE
from stickslip.workflows.run.run import run

METHOD = "condensed-newton"
RATIO = 2**-0.5  # of the mesh sizes, from one mesh to the next
MOST = {2: 120_000, 3: 45_000}  # unknowns that are solved, by dimension; beyond the trend is followed
TREND = 4  # of the finest meshes, that show it
SLOWEST = -0.3  # power of the unknowns with which an error falls that still counts as a trend
WINDOW = 2  # meshes in a row that have to be good enough: an error that changes its sign is small by luck once
BUDGET = 3600.0  # [s] of the rounds, more than they take on a busy machine
RAOUS_FINEST = 1e-4  # where runs of one size take longer than a few rounds
HALVED = "halved, order 1"
WAYS = ("one size, order 1", "one size, order 2", "graded by hand, order 1")


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene, a number of it, and the accuracies that are asked for."""

    scene: Callable[[bool], Scene]  # graded by hand, order 1; or if fine of order 2, for the true value
    size: float  # [m] of the cells of the coarse mesh of one size
    goal: str
    asked: tuple[float, ...] = (1e-2, 1e-3)
    share: float = 1.0  # of the fine scene's number that the scene has

    def start(self) -> Scene:
        """Return the scene on the coarse mesh of one size."""
        scene = self.scene(False)
        shape = scene.geometry
        keys = [key for key in vars(shape) if key.endswith("mesh_size") and getattr(shape, key) is not None]
        return replace(scene, geometry=replace(shape, **dict.fromkeys(keys, self.size)))  # type: ignore[arg-type]

    def truth(self) -> float:
        """Return the true value."""
        simulation = prepare(_bare(self.scene(True)))
        *_, last = simulation.steps()
        return self.share * values(last)[self.goal]


def _punch(friction: bool, fine: bool) -> Scene:
    size = 0.025 if fine else 0.2
    normal, law = (punch.PRESSED, Coulomb(mu=0.3)) if friction else (punch.BONDED, None)
    edge = size / (200 if fine else 2)
    order: Literal[1, 2] = 2 if fine else 1
    return punch.scene(
        punch.Cut(
            method=METHOD, normal=normal, friction=law, fine=size, edge=edge, size=20.0, symmetric=friction, order=order
        )
    )


def _raous(fine: bool) -> Scene:
    scene = raous.scene(METHOD, steps=2, n=256 if fine else 8)
    assert isinstance(scene.geometry, Builder)
    return replace(scene, geometry=replace(scene.geometry, order=2 if fine else 1))


def _cattaneo(fine: bool) -> Scene:
    """Return a scene that is pressed, then sheared; each in one step, or in several."""
    y, x = -cattaneo.DOWN, cattaneo.ASIDE
    pair = cattaneo.Two(cells=3.0, order=2 if fine else 1, ratio=cattaneo.RATIO)
    scene = cattaneo.scene(pair, [(0.0, y), (x, y)])
    return replace(
        scene, geometry=scene.geometry.refined(0.1 if fine else 1.0), steps=Steps(end=2.0, count=8 if fine else 2)
    )


def _ball(fine: bool) -> Scene:
    coarse = hertz.Touch(model="3d", cells=2.0, order=1, driven_by="displacement", method="auto")
    return hertz.scene(replace(coarse, model="axisymmetric", cells=48.0, order=2) if fine else coarse)


CASES: Mapping[str, Case] = {
    "punch, bonded": Case(scene=partial(_punch, False), size=1.0, goal="face.normal_force"),
    "punch, friction": Case(scene=partial(_punch, True), size=1.0, goal="face.normal_force"),
    "raous": Case(scene=_raous, size=SIDE / 8, goal="base.tangential_force", asked=(1e-2, 1e-3, RAOUS_FINEST)),
    "cattaneo": Case(scene=_cattaneo, size=0.4, goal="face.tangential_force"),
    "ball, 3D": Case(scene=_ball, size=1.0, goal="face.normal_force", share=hertz.SHARE["3d"]),
}


@dataclass(frozen=True)
class Price:
    """Price of an accuracy."""

    unknowns: float
    seconds: float
    error: float  # true, relative
    measured: bool = True  # False: beyond what was solved, by the trend

    def __str__(self) -> str:
        about = "" if self.measured else "~"
        return f"{about}{_digits(self.unknowns)} | {about}{_digits(self.seconds)}"


@dataclass(frozen=True)
class Row:
    """A case and an accuracy."""

    name: str
    goal: str
    asked: float
    stated: float
    rounds: Price
    count: int  # of rounds
    order: int  # of the last one
    others: Mapping[str, Price]  # by the way of refining, see `WAYS`, and `HALVED`

    @property
    def number(self) -> str:
        """Name the number that is asked for."""
        return f"{self.name}: {self.goal.split('.')[1]}"

    @property
    def saved(self) -> list[str]:
        """Return the price of a mesh of one size and order 1 over that of the rounds: unknowns, seconds, halved."""
        whole, own = self.others[WAYS[0]], self.rounds
        seconds = (whole.seconds, self.others[HALVED].seconds)
        return [_digits(ratio) for ratio in (whole.unknowns / own.unknowns, *(one / own.seconds for one in seconds))]

    def line(self) -> str:
        """Return the line of the table, in Markdown."""
        told = f"{100 * self.stated:.2g} % | {100 * self.rounds.error:.2g} %"
        prices = " | ".join(map(str, (self.rounds, *self.others.values())))
        return f"| {self.number} | {100 * self.asked:g} % | {self.count} | {self.order} | {told} | {prices} |"


def rows(case: Case, name: str) -> Iterator[Row]:
    """Yield a row for each accuracy of a case."""
    truth = case.truth()
    gc.collect()
    _rounds(case, max(case.asked))  # libraries are loaded, and forms are compiled
    for asked in case.asked:
        content, seconds = _rounds(case, asked)
        last = content["accuracy"]["rounds"][-1]
        if not content["accuracy"]["met"]:
            raise SolverError(f"{name}: the rounds did not reach {asked:g}")
        told = last["goals"][case.goal]
        price = Price(last["unknowns"], seconds, abs(told["value"] / truth - 1))
        others = {way: _whole(case, way, asked, truth, last["steps"]) for way in WAYS}
        others[HALVED] = _halved(case, asked, last["steps"])
        yield Row(
            name, case.goal, asked, told["error"], price, len(content["accuracy"]["rounds"]), last["order"], others
        )


def _rounds(case: Case, asked: float) -> tuple[dict[str, Any], float]:
    """Return result.json of the rounds, and their seconds."""
    scene = replace(case.start(), output=Output(pictures=False))
    scene = replace(scene, accuracy=Accuracy(goals={case.goal: asked}, budget=BUDGET))
    with tempfile.TemporaryDirectory() as folder:
        began = clock.process_time()
        _, content = Rounds(scene, lambda line: None)(Path(folder) / "run", Watch())
        return content, clock.process_time() - began


def _whole(case: Case, way: str, asked: float, truth: float, steps: int) -> Price:
    """Return the price of an accuracy by refining the mesh as a whole."""
    scene = case.scene(False) if way.startswith("graded") else case.start()
    order: Literal[1, 2] = 2 if way.endswith("2") else 1
    found = list[Price]()
    while not (len(found) >= WINDOW and all(one.error <= asked for one in found[-WINDOW:])):
        assert isinstance(scene.geometry, Builder)
        shape = replace(scene.geometry.refined(RATIO ** len(found)), order=order)
        mine = replace(scene, geometry=shape, steps=replace(scene.steps, count=steps))
        found.append(_once(mine, case.goal, truth))
        if found[-1].unknowns * RATIO**-scene.dim > MOST[scene.dim]:
            return next(iter(_good(found, asked)), None) or _beyond(found[-TREND:], asked)
    return _good(found, asked)[0]


def _halved(case: Case, asked: float, steps: int) -> Price:
    """Return the price of all runs, if the mesh of one size is halved until the stated error is below what is asked."""
    scene, found, spent = replace(case.start(), output=Output(pictures=False)), list[Price](), 0.0
    contact, key = case.goal.split(".")
    while not (found and found[-1].error <= asked):
        if found and found[-1].unknowns * 2**scene.dim > MOST[scene.dim]:
            return _beyond(found[-TREND:], asked)
        assert isinstance(scene.geometry, Builder)
        shape = scene.geometry.refined(0.5 ** len(found))
        content, seconds = _run(replace(scene, geometry=shape, steps=replace(scene.steps, count=steps)))
        spent += seconds
        state = content["steps"][-1]["contacts"][contact]
        found.append(Price(content["dofs"], spent, state["error"][key]["total"] / abs(state[key])))
    return found[-1]


def _good(found: Sequence[Price], asked: float) -> list[Price]:
    """Return the meshes from which on all are good enough."""
    bad = [k for k, one in enumerate(found) if one.error > asked]
    return list(found[bad[-1] + 1 if bad else 0 :])


def _once(scene: Scene, goal: str, truth: float) -> Price:
    """Return the price of one run, without estimates of errors."""
    content, seconds = _run(_bare(scene))
    contact, key = goal.split(".")
    found = content["steps"][-1]["contacts"][contact][key]
    return Price(content["dofs"], seconds, abs(found / truth - 1))


def _run(scene: Scene) -> tuple[dict[str, Any], float]:
    """Return result.json of one run, and its seconds."""
    with tempfile.TemporaryDirectory() as folder:
        began = clock.process_time()
        outcome, content = run(scene, Path(folder) / "run")
        seconds = clock.process_time() - began
    if outcome.status != "converged":
        raise SolverError(f"{scene.title}: {outcome.sentence}")
    return content, seconds


def _beyond(found: Sequence[Price], asked: float) -> Price:
    """Return the trend of the finest meshes, continued to the accuracy."""
    size, seconds, error = (np.log([getattr(one, key) for one in found]) for key in ("unknowns", "seconds", "error"))
    fall, level = np.polyfit(size, error, 1)
    unknowns = max((np.log(asked) - level) / min(fall, SLOWEST), size[-1])
    growth = max(1.0, float(np.polyfit(size, seconds, 1)[0]))
    return Price(float(np.exp(unknowns)), float(np.exp(seconds[-1] + growth * (unknowns - size[-1]))), asked, False)


def _bare(scene: Scene) -> Scene:
    return replace(scene, output=Output(pictures=False, error=False))


def _digits(value: float) -> str:
    """Return a number with two digits.

    >>> _digits(0.123), _digits(12345.0)
    ('0.12', '12000')
    """
    return f"{float(f'{value:.2g}'):.10g}"


def measured(name: str) -> list[Row]:
    """Return all rows of a case."""
    return list(rows(CASES[name], name))


def page(found: Sequence[Row]) -> str:
    """Return the page docs/adaptive.md."""
    template = "lab/benchmarks/templates/adaptive.md"
    return render(template, rows=found, ways=(*WAYS, HALVED), trend=TREND, finest=RAOUS_FINEST)


def main(
    only: Annotated[str, typer.Option(help="cases whose name contains this")] = "",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="file for the page, in Markdown")] = None,
) -> None:
    """Measure, print the table, and write the page."""
    found = list[Row]()
    for name in (name for name in CASES if only in name):
        for row in apart(measured, name):
            found.append(row)
            print(row.line(), flush=True)
    if output is not None:
        output.write_text(page(found), encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
