"""Counters of work, incremented where the work is done, with the clock of the run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace

from stickslip.solvers.parallel.clock import Clock


@dataclass
class Counters:
    """Work done since the start of a run; one instance per run, written to `result.json`.

    Attributes:
        clock: what that took, by phase.
    """

    forms: int = 0  # UFL forms compiled or loaded
    searches: int = 0  # closest-point passes; analytic obstacles need none
    factorisations: int = 0  # of K_B, or of its interior block K_ii
    schur_size: int = 0  # c, order of the Schur complement on the contact dofs
    volume_solves: int = 0  # applications of K_B^-1 (of K_ii^-1 when the contact dofs are condensed)
    linear_iterations: int = 0  # of iterative linear solvers
    error_solves: int = 0  # applications of K_B^-1 for estimates of errors; not in volume_solves
    lanczos_applications: int = 0  # of K_B^-1 for lambda_max (Lanczos, power iteration); not in volume_solves

    def __post_init__(self) -> None:
        self.clock = Clock(lambda: self.volume_solves + self.error_solves)

    def __reduce__(self) -> tuple[type[Counters], tuple[int, ...]]:
        """Another process has a clock of its own."""
        return Counters, tuple(getattr(self, f.name) for f in fields(self))

    @contextmanager
    def for_error(self) -> Iterator[None]:
        """Count the volume solves of a block as `error_solves`, and nothing else."""
        before = replace(self)
        try:
            yield
        finally:
            solves = self.error_solves + self.volume_solves - before.volume_solves
            for f in fields(self):
                setattr(self, f.name, getattr(before, f.name))
            self.error_solves = solves

    def add(self, earlier: Counters) -> None:
        """Add the work of an earlier process of the same run; `schur_size` is a size and stays."""
        for f in fields(self):
            if f.name != "schur_size":
                setattr(self, f.name, getattr(self, f.name) + getattr(earlier, f.name))
        self.clock.leave_out(earlier.volume_solves + earlier.error_solves)
