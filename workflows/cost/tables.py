"""The study in words and tables: the sentence of each quantity, methods side by side, cost.csv and cost.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from stickslip import VERSION
from stickslip.geometry.arrays import CLOSE
from stickslip.geometry.dolfinx_versions import DOLFINX
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.cost.run_record import PHASES, Run
from stickslip.workflows.cost.study import Study
from stickslip.workflows.formats.csv_tables import csv_text
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.run.result import scene_hash
from stickslip.workflows.scene_file.read import to_dict

COUNTS = ("dofs", "contact_points", "volume_solves", "linear_iterations")


def headline(studies: Sequence[Study]) -> str:
    """The sentence of the first quantity that has a limit."""
    if not studies:
        return "No run came to an end, or no quantity differs from zero."
    return sentence(next((study for study in studies if study.truth.converges), studies[0]))


def sentence(study: Study) -> str:
    """`1 % of base.max_pressure costs 3.1 s with ...; the next digit costs 21 s.`"""
    unknown = "" if study.time_step is not None else "; the error of the time steps is not known"
    name = study.truth.name
    if study.truth.meshes < 2:
        return f"{name}: one mesh only, there is nothing to measure its error by; give it a larger --budget."
    if not study.truth.converges:
        return f"{name} does not settle on these meshes, too coarse yet or close to a singular corner: it has no price."
    run, best = study.cheapest(0.01), study.most_exact
    if best is None:
        return f"{name}: no run came to an end."
    if run is None:
        return f"1 % of {name} was not reached: {_least(study, best)}{unknown}."
    said = f"1 % of {name} costs {seconds(run.waited)} with {choice(run, study)}"
    following = study.cheapest(0.01 / 10)
    if following is run:
        return f"{said}, and the next digit comes with it{unknown}."
    if following is not None:
        return f"{said}; the next digit costs {seconds(following.waited)}{_changes(run, following)}{unknown}."
    return f"{said}; the next digit was not reached: {_least(study, best)}{unknown}."


def explained(study: Study) -> str:
    """The front in words, from cheap to exact: who is on it, what a digit costs, and where it ends."""
    if len(study.front) < 2 or not study.truth.converges:
        return ""
    first, last, told = study.front[0], study.front[-1], list[str]()
    for (order, method), group in groupby(study.front, key=lambda run: run.rung.chain):
        runs = [*group]
        errors, times = ([percent(study.sturdy[run.rung]) for run in runs], [seconds(run.waited) for run in runs])
        way = [f"{one[0]} to {one[-1]}" if len(runs) > 1 else one[0] for one in (errors, times)]
        told.append(f"order {order} with {method} ({way[0]} in {way[1]})")
    digits = np.log10(study.sturdy[first.rung] / study.sturdy[last.rung])
    said = f"{study.truth.name}, front: {', then '.join(told)}. "
    said += f"A tenth of the error costs {(last.waited / first.waited) ** (1 / digits):.2g} times the wait. "
    said += f"Of the cheapest, start and estimate of errors are {percent(1 - first.seconds / first.waited)}. "
    least, of_steps = study.sturdy[last.rung], study.time_step
    if of_steps is not None and of_steps >= least:
        return f"{said}It ends at {percent(least)}, which the time steps leave: it takes more of them (steps.count)."
    if least <= study.truth.uncertainty:
        return f"{said}It ends at {percent(least)}, to which the reference is sure."
    share = "" if of_steps is None else f", of which the time steps are {percent(of_steps / least)}"
    return f"{said}It ends at {percent(least)}{share}: a larger --budget goes on."


def choice(run: Run, study: Study) -> str:
    """Order, mesh size, method, and the tolerance where it is not the scene's."""
    loose = "" if run.rung.tolerance == study.tolerance else f", tolerance {run.rung.tolerance:.0e}"
    return f"order {run.rung.order}, h = {run.h:.3g}, {run.rung.method}{loose}"


def seconds(value: float) -> str:
    """Two digits.

    >>> seconds(0.123), seconds(3.14), seconds(123.4)
    ('0.12 s', '3.1 s', '123 s')
    """
    return f"{value:.0f} s" if value >= 10 else f"{value:.1f} s" if value >= 1 else f"{value:.2g} s"


def duration(value: float) -> str:
    """A time that may be long [s], two digits, in a unit that fits it.

    >>> duration(0.5), duration(900.0), duration(86400.0 * 45), duration(1e12)
    ('0.5 s', '15 min', '45 days', '32000 years')
    """
    for unit, size, most in (("min", 60.0, 120.0), ("h", 3600.0, 48.0), ("days", 86400.0, 730.0)):
        if value < 600.0:
            return seconds(value)
        if value / size < most:
            return f"{float(f'{value / size:.2g}'):.0f} {unit}"
    return f"{float(f'{value / 31557600.0:.2g}'):.0f} years"


def percent(value: float) -> str:
    """A share in per cent, two digits.

    >>> percent(1.234), percent(0.0123), percent(2e-6)
    ('123 %', '1.2 %', '0.0002 %')
    """
    if value >= 0.1:
        return f"{100 * value:.0f} %"
    return f"{100 * value:.2g} %" if value >= CLOSE else f"{100 * value:.0e} %"


def _changes(run: Run, following: Run) -> str:
    """Say what the next digit takes besides a finer mesh."""
    new = [] if following.rung.order == run.rung.order else [f"order {following.rung.order}"]
    new += [f"h = {following.h:.3g}"] if following.h != run.h else []
    new += [following.rung.method] if following.rung.method != run.rung.method else []
    new += [] if following.rung.tolerance == run.rung.tolerance else [f"tolerance {following.rung.tolerance:.0e}"]
    return f" with {', '.join(new)}"


def _least(study: Study, best: Run) -> str:
    """The smallest error, and what limits it."""
    of_steps = study.time_step or 0.0
    if of_steps > study.truth.uncertainty and of_steps > study.worst[best.rung]:
        return f"the time steps alone leave {percent(of_steps)}, it takes more of them (steps.count)"
    if study.worst[best.rung] <= study.truth.uncertainty:
        return f"the reference itself is sure to {percent(study.truth.uncertainty)} only"
    return f"the best is {percent(study.sure[best.rung])} for {seconds(best.waited)} with {choice(best, study)}"


@dataclass(frozen=True)
class Line:
    """One mesh: the run of each method on it, at the scene's tolerance."""

    order: int
    level: int
    runs: tuple[Run | None, ...]  # in the order of the methods; None: the method did not get so far

    @property
    def h(self) -> float:
        """Edge length where bodies touch [m]."""
        return next((run.h for run in self.runs if run and run.h), 0.0)


def lines(runs: Sequence[Run], methods: Sequence[str], tolerance: float) -> list[Line]:
    """One line for each mesh that any of the methods has solved, coarse to fine."""
    tight = {
        (r.rung.chain, r.rung.level): r for r in runs if r.rung.tolerance == tolerance and r.rung.method in methods
    }
    solved = sorted({(r.rung.order, r.rung.level) for r in tight.values() if r.converged})
    return [Line(o, level, tuple(tight.get(((o, name), level)) for name in methods)) for o, level in solved]


def plain(found: Sequence[Line], methods: Sequence[str]) -> list[dict[str, Any]]:
    """Return plain data for JSON: for each mesh, the numbers of every method; null where it did not get so far."""
    return [
        {"order": line.order, "h": line.h, "methods": dict(zip(methods, map(_numbers, line.runs), strict=True))}
        for line in found
    ]


def comparison(found: Sequence[Line], methods: Sequence[str]) -> str:
    """The finest mesh that all methods solved, in one sentence; empty without one.

    The cheapest comes first, the others as multiples of it.
    """
    whole = [line for line in found if all(run and run.converged for run in line.runs)]
    if len(methods) < 2 or not whole:
        return ""
    line = min(whole, key=lambda line: (line.h, line.order))
    first, *others = sorted((run for run in line.runs if run), key=lambda run: run.seconds)
    told = [
        f"{run.rung.method} {run.seconds / first.seconds:.2g} times the seconds, "
        f"{run.volume_solves / max(first.volume_solves, 1):.2g} times the volume solves"
        for run in others
    ]
    start = f"On the finest mesh that all solved (order {line.order}, h = {line.h:.3g}) {first.rung.method} takes "
    return f"{start}{seconds(first.seconds)} and {first.volume_solves} volume solves; {'; '.join(told)}."


def _numbers(run: Run | None) -> dict[str, Any] | None:
    if run is None:
        return None
    counts = ("seconds", "volume_solves", "linear_iterations", "dofs", "memory")
    return {"status": run.status} | {key: getattr(run, key) if run.converged else None for key in counts}


def write_csv(path: Path, runs: Sequence[Run], studies: Sequence[Study]) -> None:
    """One row for each run, in the order of the runs; a cell without a number is empty.

    Raises:
        MachineError: the disk is full.
    """
    head = ["order", "method", "h", "cells_times", "tolerance", "status", "seconds", *(f"{p}_s" for p in PHASES)]
    head += ["waited_s", "cpu_s", "spent_s", "peak_memory_bytes", *COUNTS, "residual", "compiled"]
    for study in studies:
        name = study.truth.name
        head += [name, f"{name}:error", f"{name}:error_is_known", f"{name}:on_front"]
    rows = ([*_row(run), *(cell for study in studies for cell in _judged(run, study))] for run in runs)
    write_aside(path, csv_text([head, *rows]).encode())


def summary(
    scene: Scene, runs: Sequence[Run], studies: Sequence[Study], status: str, budget: float, notes: Sequence[str]
) -> dict[str, Any]:
    """The content of cost.json."""
    return {
        "format": 1,
        "status": status,
        "sentence": headline(studies),
        "scene": to_dict(scene) | {"hash": scene_hash(scene)},
        "version": VERSION,
        "dolfinx": DOLFINX,
        "budget": budget,
        "spent": sum(run.spent for run in runs),
        "quantities": {study.truth.name: _quantity(study) for study in studies},
        "runs": [
            asdict(run)
            | {"name": run.rung.name, "seconds": run.seconds, "waited": run.waited}
            | {"errors": {study.truth.name: study.errors.get(run.rung) for study in studies}}
            for run in runs
        ],
        "notes": list(notes),
    }


def _row(run: Run) -> list[object]:
    rung, solved = run.rung, bool(run.phases)
    numbers: list[object] = [run.seconds if solved else "", *(run.phases[p] if solved else "" for p in PHASES)]
    numbers += [run.waited if solved else "", run.cpu or "", run.spent, run.memory or ""]
    numbers += [getattr(run, key) if solved else "" for key in COUNTS]
    about = [rung.order, rung.method, run.h or "", rung.factor, rung.tolerance, run.status]
    return [*about, *numbers, run.residual, int(run.compiled)]


def _judged(run: Run, study: Study) -> list[object]:
    if not run.converged:
        return ["", "", "", ""]
    known = study.known(run.rung)
    return [run.quantities[study.truth.name], study.errors[run.rung], int(known), int(run in study.front)]


def _quantity(study: Study) -> dict[str, Any]:
    return {
        "truth": {key: value for key, value in asdict(study.truth).items() if key != "name"},
        "observed_orders": [
            {"order": order, "method": method, "rate": rate} for (order, method), rate in study.rates.items()
        ],
        "time_step": study.time_step,
        "front": [run.rung.name for run in study.front],
        "sentence": sentence(study),
        "explained": explained(study),
    }
