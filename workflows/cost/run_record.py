"""The record of one run: numbers, seconds, work, memory, and how it ended; each in its own file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from stickslip.workflows.cost.rung import Rung
from stickslip.workflows.formats.aside import write_aside

PHASES = ("mesh", "assemble", "prepare", "iterate", "output")


@dataclass(frozen=True, kw_only=True)
class Run:
    """Record of one run; only a run with status `converged` has quantities."""

    rung: Rung
    status: str  # converged, not_converged, no_equilibrium, refused, out_of_memory, out_of_time, failed
    number: int = 0  # position in the order of the runs
    sentence: str = ""  # what went wrong
    spent: float = 0.0  # of the budget: start of the process and compiling of forms included [s]
    h: float = 0.0  # edge length where bodies touch [m]
    phases: Mapping[str, float] = field(default_factory=dict)  # wall time [s]
    cpu: float = 0.0  # in those phases [s]; less than their sum: others used the core too
    memory: float = 0.0  # peak of the process [bytes]
    dofs: int = 0
    contact_points: int = 0
    volume_solves: int = 0
    linear_iterations: int = 0
    residual: float | None = None  # the largest of the steps
    law_error: float | None = None  # what the method's approximation of the laws leaves, relative, energy norm
    compiled: bool = False  # forms were compiled during the run: its seconds do not count
    quantities: Mapping[str, float] = field(default_factory=dict)
    time_steps: Mapping[str, float] = field(default_factory=dict)  # errors of the time steps; empty: not measured

    @property
    def converged(self) -> bool:
        return self.status == "converged"

    @property
    def seconds(self) -> float:
        """Wall time of all phases [s]."""
        return sum(self.phases.values())

    def plain(self) -> dict[str, Any]:
        """As plain data for JSON."""
        return asdict(self)


def store(run: Run, folder: Path) -> None:
    """Write the run's file atomically.

    Raises:
        MachineError: the disk is full.
    """
    text = json.dumps(run.plain(), indent=1, ensure_ascii=False)
    write_aside(folder / f"{run.rung.name}.json", (text + "\n").encode())


def load(folder: Path) -> list[Run]:
    """All runs of a folder, in the order in which they were made."""
    found = [from_plain(json.loads(path.read_text(encoding="utf-8"))) for path in folder.glob("order*.json")]
    return sorted(found, key=lambda run: run.number)


def from_plain(content: Mapping[str, Any]) -> Run:
    """The run that `plain` has written."""
    return Run(**{**content, "rung": Rung(**content["rung"])})
