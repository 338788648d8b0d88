"""The files cost.csv and cost.json: every run, and the study of every quantity."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stickslip import VERSION
from stickslip.geometry.dolfinx_versions import DOLFINX
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.cost.run_record import PHASES, Run
from stickslip.workflows.cost.sentence import headline, sentence
from stickslip.workflows.cost.study import Study
from stickslip.workflows.formats.aside import write_aside
from stickslip.workflows.formats.regular import write_json
from stickslip.workflows.run.result import scene_hash
from stickslip.workflows.scene_file.read import to_dict

COUNTS = ("dofs", "contact_points", "volume_solves", "linear_iterations")


def write_csv(path: Path, runs: Sequence[Run], studies: Sequence[Study]) -> None:
    """One row for each run, in the order of the runs; a cell without a number is empty.

    Raises:
        MachineError: the disk is full.
    """
    head = ["order", "method", "h", "cells_times", "tolerance", "status", "seconds", *(f"{p}_s" for p in PHASES)]
    head += ["cpu_s", "spent_s", "peak_memory_bytes", *COUNTS, "residual", "compiled"]
    for study in studies:
        name = study.truth.name
        head += [name, f"{name}:error", f"{name}:error_is_known", f"{name}:on_front"]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([*_row(run), *(cell for study in studies for cell in _judged(run, study))] for run in runs)
    write_aside(path, text.getvalue().encode())


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
            run.plain()
            | {"name": run.rung.name, "seconds": run.seconds}
            | {"errors": {study.truth.name: study.errors.get(run.rung) for study in studies}}
            for run in runs
        ],
        "notes": list(notes),
    }


def write_summary(path: Path, content: dict[str, Any]) -> None:
    """Write cost.json."""
    write_json(path, content)


def _row(run: Run) -> list[object]:
    rung, solved = run.rung, bool(run.phases)
    numbers: list[object] = [run.seconds if solved else "", *(run.phases[p] if solved else "" for p in PHASES)]
    numbers += [run.cpu or "", run.spent, run.memory or "", *(getattr(run, key) if solved else "" for key in COUNTS)]
    return [
        rung.order,
        rung.method,
        run.h or "",
        rung.factor,
        rung.tolerance,
        run.status,
        *numbers,
        run.residual,
        int(run.compiled),
    ]


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
    }
