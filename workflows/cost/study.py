"""One quantity over all runs: the reference value that errors are measured by, observed orders, the Pareto front."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from stickslip.geometry.arrays import CLOSE, EPS, ROUNDING
from stickslip.geometry.errors import SceneError, nearest
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Exact
from stickslip.workflows.cost.extrapolation import Limit, limit, rate_of
from stickslip.workflows.cost.run_record import RATIO, Run, Rung

SEQUENCE = 3  # meshes of one order that say more than two of another
NOISE = 10.0  # times the tolerance: differences that the iteration alone can leave
USUAL = ("max_pressure", "normal_force", "tangential_force")


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the points (cost, error) on the front, by rising cost.

    >>> front([(1.0, 0.1), (2.0, 0.2), (3.0, 0.01), (3.0, 0.02)])
    [0, 2]
    """
    found: list[int] = []
    least = float("inf")
    for index in sorted(range(len(points)), key=lambda i: points[i]):
        if points[index][1] < least:
            found.append(index)
            least = points[index][1]
    return found


@dataclass(frozen=True)
class Truth:
    """The reference value that errors are measured against."""

    name: str
    value: float
    uncertainty: float  # relative; errors below it mean nothing
    source: str
    scale: float  # what errors are relative to
    converges: bool = True
    meshes: int = 2  # number of meshes it rests on; one alone proves nothing
    warning: str = ""  # how the runs contradict it, in words
    exact: bool = False  # given by the scene, not by the runs


def truth_of(name: str, runs: Sequence[Run], exact: Exact, tolerance: float) -> Truth | None:
    """The reference value of a quantity; None if no run has it, or if it is zero in all runs."""
    found = [abs(run.quantities[name]) for run in runs if run.converged]
    if name in exact.values:
        value = exact.values[name]
        source = f"exact: {exact.source}" if exact.source else "exact, says the scene"
        scale = abs(value) or max(found, default=0.0)
        if not scale:
            return None
        warning = _against(name, value, exact.accuracy * scale, runs, tolerance)
        return Truth(name, value, max(exact.accuracy, NOISE * tolerance), source, scale, warning=warning, exact=True)
    if not any(found):
        return None
    sure, meshes = _limits(name, runs, tolerance)
    if not sure:
        return None
    order = min(sure, key=lambda k: sure[k].uncertainty)
    best = sure[order]
    # the orders must agree: a difference beyond the other one's uncertainty is uncertainty too
    doubt = max([best.uncertainty, *(abs(best.value - o.value) - o.uncertainty for o in sure.values() if o.converges)])
    scale = abs(best.value) or max(found)
    if best.rate is None or not best.converges:
        source = f"finest mesh, order {order}"
    else:
        source = f"extrapolated, order {order}, h^{best.rate:.1f}"
    converges = meshes > 1 and all(limit.converges for limit in sure.values())  # no order hides a singular corner
    return Truth(name, best.value, doubt / scale, source, scale, converges, meshes)


def _limits(name: str, runs: Sequence[Run], tolerance: float) -> tuple[dict[int, Limit], int]:
    """The limit of each order with about as many meshes as the best one; and that number."""
    points = {order: _sequence(name, order, runs, tolerance) for order in sorted({run.rung.order for run in runs})}
    most = max((len(sequence) for sequence in points.values()), default=0)
    enough = max(1, min(SEQUENCE, most))
    return {order: _limit(sequence, tolerance) for order, sequence in points.items() if len(sequence) >= enough}, most


def _against(name: str, value: float, accuracy: float, runs: Sequence[Run], tolerance: float) -> str:
    """Whether the runs converge to another value than the scene's exact one, in words."""
    limits, meshes = _limits(name, runs, tolerance)
    settled = [limit for limit in limits.values() if limit.converges and meshes >= SEQUENCE]
    best = min(settled, key=lambda limit: limit.uncertainty, default=None)
    if best is None or abs(best.value - value) <= accuracy + best.uncertainty:
        return ""
    return f"warning: {name} settles at {best.value:.6g} +- {best.uncertainty:.1g}; [exact] says {value:.6g}"


def _sequence(name: str, order: int, runs: Sequence[Run], tolerance: float) -> dict[float, float]:
    """Values by mesh size, of one order at the tightest tolerance.

    Methods that solve the scene's own laws agree on every mesh.
    """
    return {
        run.h: run.quantities[name]
        for run in runs
        if run.converged
        and run.rung.order == order
        and run.rung.tolerance == tolerance
        # relative law error (energy norm) above which a method solves other laws than the scene's
        and (run.law_error or 0.0) <= CLOSE
    }


def _limit(points: Mapping[float, float], tolerance: float) -> Limit:
    floor = NOISE * tolerance * max(abs(value) for value in points.values())
    return limit(list(points), list(points.values()), floor)


def check(asked: Sequence[str], scene: Scene) -> None:
    """Refuse names that no quantity of the scene has.

    Raises:
        SceneError: with the nearest name.
    """
    known = scene.quantities()
    for name in asked:
        if name not in known:
            raise SceneError(f"--quantity {name}: no such quantity; {nearest(name, known)}")
    if not asked and not scene.contacts:
        raise SceneError("contacts: there is none; name what to look at by --quantity, for example energy.stored")


def chosen(asked: Sequence[str], scene: Scene, runs: Sequence[Run]) -> tuple[str, ...]:
    """Names to study: first those with an exact value in the scene; of the usual ones those that are not zero."""
    if asked:
        return tuple(dict.fromkeys(asked))
    usual = [f"{contact}.{key}" for contact in scene.contacts for key in USUAL]
    largest = {key: max((_size(f"{c}.{key}", runs) for c in scene.contacts), default=0.0) for key in USUAL}
    pushed = largest["normal_force"]
    # relative to the largest of its kind: smaller numbers count as zero
    least = {"max_pressure": 0.0, "normal_force": ROUNDING * pushed, "tangential_force": ROUNDING * pushed}
    alive = [name for name in usual if _size(name, runs) > least[name.rpartition(".")[2]]]
    return tuple(dict.fromkeys([*scene.exact.values, *alive]))


def _size(name: str, runs: Sequence[Run]) -> float:
    return max((abs(run.quantities[name]) for run in runs if run.converged), default=0.0)


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
        from the next two coarser meshes no error falls faster than with the power 2 order.
        """
        return {
            a: max(
                error * _at_best(a, b)
                for b, error in self.errors.items()
                if b.chain == a.chain and b.tolerance <= a.tolerance and b.level >= a.level - 2
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
        return tuple(runs[i] for i in front([(run.waited, self.sturdy[run.rung]) for run in runs]))

    def cheapest(self, level: float) -> Run | None:
        """The cheapest run among those whose error is surely at most this."""
        good = [run for run in self.timed if self.truth.converges and self.sure[run.rung] <= level]
        return min(good, key=lambda run: run.waited, default=None)

    @cached_property
    def most_exact(self) -> Run | None:
        """The cheapest of the runs with the smallest error; one whose time counts, if there is one."""
        if not self.runs or not self.truth.converges:
            return None
        return min(self.timed or self.runs, key=lambda run: (self.sturdy[run.rung], run.waited))

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
    """Return the factor by which the error of another mesh of the chain becomes the least that this rung may have."""
    return RATIO ** (-2 * rung.order * max(rung.level - other.level, 0))
