"""One quantity over all runs: errors, observed orders, the Pareto front."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from stickslip.geometry.arrays import EPS
from stickslip.workflows.cost.limit import rate_of
from stickslip.workflows.cost.pareto import front
from stickslip.workflows.cost.run_record import Run
from stickslip.workflows.cost.rung import RATIO, Rung
from stickslip.workflows.cost.truth import Truth

SPAN = 2  # levels: the error of a mesh that is still coarser says nothing of the trend


@dataclass(frozen=True)
class Study:
    """Errors and orders of one quantity over all runs."""

    truth: Truth
    runs: tuple[Run, ...]  # converged
    tolerance: float  # the tightest

    @property
    def picture(self) -> str:
        """Name of its picture."""
        return f"cost_{self.truth.name.replace('.', '_')}.png"

    @cached_property
    def errors(self) -> Mapping[Rung, float]:
        """Relative error of every run."""
        truth = self.truth
        # smallest error, so that an exact answer has a logarithm
        return {run.rung: max(EPS, abs(run.quantities[truth.name] - truth.value) / truth.scale) for run in self.runs}

    def known(self, rung: Rung) -> bool:
        """Whether the error is larger than the uncertainty of what it is measured by."""
        return self.truth.converges and self.errors[rung] > self.truth.uncertainty

    @cached_property
    def worst(self) -> Mapping[Rung, float]:
        """Largest error of a run and of all finer or tighter ones of its chain, not below the trend of coarser ones.

        An error that changes its sign is small by luck on some mesh. Finer ones show that; for the finest it is that
        from the next coarser meshes no error falls faster than with the power 2 order.
        """
        return {
            a: max(
                error * _at_best(a, b)
                for b, error in self.errors.items()
                if b.chain == a.chain and b.tolerance <= a.tolerance and b.level >= a.level - SPAN
            )
            for a in self.errors
        }

    @cached_property
    def time_step(self) -> float | None:
        """Relative error that the time steps leave, as the finest mesh shows on which it was measured; None: not known.

        0 where the truth is exact: errors have it in them.
        """
        if self.truth.exact:
            return 0.0
        measured = [run for run in self.runs if self.truth.name in run.time_steps]
        finest = max((run.rung.level for run in measured), default=0)
        each = [run.time_steps[self.truth.name] for run in measured if run.rung.level == finest]
        return max(each) / self.truth.scale if each else None

    @cached_property
    def sturdy(self) -> Mapping[Rung, float]:
        """The worst error, not below the uncertainty and what the time steps leave, where that is known."""
        least = max(self.truth.uncertainty, self.time_step or 0.0)
        return {rung: max(least, error) for rung, error in self.worst.items()}

    @cached_property
    def sure(self) -> Mapping[Rung, float]:
        """Upper bound of the error: the worst error, the uncertainty of the reference, and that of the time steps.

        The latter is left out where it is not known.
        """
        more = self.truth.uncertainty + (self.time_step or 0.0)
        return {rung: error + more for rung, error in self.worst.items()}

    @cached_property
    def timed(self) -> tuple[Run, ...]:
        """Runs whose time counts: no forms were compiled."""
        return tuple(run for run in self.runs if not run.compiled)

    @cached_property
    def front(self) -> tuple[Run, ...]:
        """The Pareto front by rising cost; errors below the uncertainty count as equal."""
        runs = self.timed if self.truth.converges else ()
        return tuple(runs[i] for i in front([(run.seconds, self.sturdy[run.rung]) for run in runs]))

    def cheapest(self, level: float) -> Run | None:
        """The cheapest run among those whose error is surely at most this."""
        good = [run for run in self.timed if self.truth.converges and self.sure[run.rung] <= level]
        return min(good, key=lambda run: run.seconds, default=None)

    @cached_property
    def most_exact(self) -> Run | None:
        """The cheapest of the runs with the smallest error; one whose time counts, if there is one."""
        if not self.runs or not self.truth.converges:
            return None
        return min(self.timed or self.runs, key=lambda run: (self.sturdy[run.rung], run.seconds))

    @cached_property
    def rates(self) -> Mapping[tuple[int, str], float]:
        """Observed powers of h, by order and method, at the tightest tolerance."""
        chains = dict.fromkeys(run.rung.chain for run in self.runs)
        found = {chain: self._rate([run for run in self.runs if run.rung.chain == chain]) for chain in chains}
        return {chain: rate for chain, rate in found.items() if rate is not None}

    def _rate(self, runs: Sequence[Run]) -> float | None:
        used = [run for run in runs if run.rung.tolerance == self.tolerance and self.known(run.rung)]
        return rate_of([run.h for run in used], [self.errors[run.rung] for run in used])


def _at_best(rung: Rung, other: Rung) -> float:
    """What the error of another mesh of the chain is multiplied by to be one that this rung may have at best."""
    return RATIO ** (-2 * rung.order * max(rung.level - other.level, 0))
