"""Counters of work, incremented where the work is done."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass
class Counters:
    """One instance a run; `result.json` shows it."""

    forms: int = 0  # UFL forms compiled or loaded
    searches: int = 0  # closest-point passes; analytic obstacles need none
    factorisations: int = 0
    schur_size: int = 0
    volume_solves: int = 0  # applications of K_B^-1 (of K_ii^-1 when the contact dofs are condensed)
    linear_iterations: int = 0  # of iterative linear solvers
    lanczos_applications: int = 0  # applications of K_B^-1 for lambda_max, kept apart

    def add(self, earlier: Counters) -> None:
        """Take in the work of a process before this one."""
        for f in fields(self):
            if f.name != "schur_size":
                setattr(self, f.name, getattr(self, f.name) + getattr(earlier, f.name))
