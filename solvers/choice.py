"""Which methods a scene is tried with, on which form of the bodies: by dimension and size, never by the clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from solvers.system import System

Form = Literal["condensed", "matrix-free"]


@dataclass(frozen=True)
class Stage:
    """One method on one form of the bodies."""

    method: str
    surface: Form

    def __str__(self) -> str:
        return f"{self.method} ({self.surface})"


@dataclass(frozen=True)
class Choice:
    """Stages tried one after the other, and why the first of them comes first."""

    stages: tuple[Stage, ...]
    because: str


def choose(system: System) -> Choice:
    """What a scene's `solver.method` and `solver.surface` come to at the size it has."""
    solver = system.scene.solver
    method = "condensed-newton" if solver.method == "auto" else solver.method
    return Choice((Stage(method, "condensed"),), f"solver.method = {solver.method}")
