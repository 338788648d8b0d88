"""The ladder of a scene: which runs may come next, what each will take, and how it is climbed within a budget.

Every chain of one order and method climbs by itself, from coarse meshes to fine ones.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np

from stickslip.geometry.errors import SceneError, nearest
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.cost.run_record import RATIO, Run, Rung
from stickslip.workflows.cost.tables import seconds
from stickslip.workflows.scene_file.read import with_method

COARSEST, FINEST = -4, 12  # levels: four times as coarse as the scene, 64 times as fine
ORDERS: tuple[Literal[1, 2], ...] = (1, 2)
LOOSE = (1e-2, 1e-4)  # tolerances besides the scene's own
MORE = 1.1  # factor on a time limit that was too short, for another try
UNTRIED = 1.0  # seconds of the first run of all
START = 2.0  # seconds in which a process starts and compiles nothing
ANOTHER = 1.5  # assumed factor on the time of the same mesh with another method or a lower order
T = TypeVar("T", bound=str | int)
Measure = Callable[[Rung, float], Run | None]


@dataclass(frozen=True)
class Ladder:
    """All chains of a scene, and the tolerance that the finest answers are computed with."""

    orders: tuple[Literal[1, 2], ...]
    methods: tuple[str, ...]
    tolerance: float
    together: bool = False  # the methods are laid side by side: all climb over the same meshes

    def candidates(self, runs: Sequence[Run]) -> Iterator[Rung]:
        """The next mesh of every chain, and looser tolerances on the meshes from the scene's own on."""
        done, start = {run.rung for run in runs}, overhead(runs)
        for order in self.orders:
            for method in self.methods:
                mine = [run for run in runs if run.rung.chain == (order, method)]
                tight = sorted((r for r in mine if r.rung.tolerance == self.tolerance), key=lambda r: r.rung.level)
                level = self._next(tight, order, runs, start)
                if level <= FINEST and not _ended(tight):
                    yield Rung(order, method, level, self.tolerance)
                if not _in_vain(mine, self.tolerance):
                    yield from (rung for run in tight if _worth(run) for rung in self._looser(run.rung, done))

    def turn(self, rung: Rung) -> int:
        """Return the key by which rungs are ordered, whatever they cost: methods side by side climb mesh by mesh."""
        return rung.level if self.together else 0

    def _next(self, tight: Sequence[Run], order: int, runs: Sequence[Run], start: float) -> int:
        """Level of a chain's next mesh; of methods side by side, one that another has reached comes first."""
        if not tight:
            return COARSEST
        last = tight[-1].rung.level
        others = [r.rung.level for r in runs if r.rung.order == order and r.rung.method in self.methods]
        ahead = [level for level in others if level > last] if self.together else []
        return min(ahead, default=last + _stride(tight[-1], start))

    def _looser(self, rung: Rung, done: Collection[Rung]) -> Iterator[Rung]:
        loose = (replace(rung, tolerance=each) for each in LOOSE if each >= 10 * rung.tolerance)
        return (each for each in loose if each not in done)


def ladder_of(scene: Scene, named: Sequence[str] = ()) -> tuple[Ladder, list[str]]:
    """The ladder of a scene; and the methods and orders that it leaves out, in words.

    A scene that names its method uses this one; with `auto` all methods that may be cheapest and can solve it compete.

    Args:
        named: methods to lay side by side on the same meshes, whatever the scene names, each as `with_method` reads it;
            empty: as above.

    Raises:
        SceneError: no method can solve the scene, or its mesh cannot be refined; or there is no such method, or it
            cannot solve the scene.
    """
    tolerance, wanted = scene.solver.tolerance, scene.solver.method

    def planned(method: str) -> None:
        make_plan(replace(scene, solver=with_method(scene.solver, method)))

    contenders = [name for name, method in METHODS.items() if name != "auto" and method.WORKS_WITH.contends]
    for name in named:
        if name.split("+")[0] not in METHODS:
            raise SceneError(f"--methods {name}: no such method; {nearest(name.split('+')[0], METHODS)}")
        try:
            planned(name)
        except SceneError as error:
            raise SceneError(f"--methods {name}: {error}") from None
    asked = list(dict.fromkeys(named)) or (contenders if wanted == "auto" else [wanted])
    methods, without_method = _possible(asked, planned)
    orders, without_order = _possible(ORDERS, lambda order: Rung(order, methods[0], 0, tolerance).scene(scene))
    left_out = [f"without {method}: {error}" for method, error in without_method.items()]
    left_out += [f"without order {order}: {error}" for order, error in without_order.items()]
    return Ladder(tuple(orders), tuple(methods), tolerance, together=bool(named)), left_out


def _possible(all_of: Sequence[T], attempt: Callable[[T], object]) -> tuple[list[T], dict[T, SceneError]]:
    """Return those that are not refused, and why the others are.

    Raises:
        SceneError: all of them are.
    """
    possible, refused = list[T](), dict[T, SceneError]()
    for each in all_of:
        try:
            attempt(each)
            possible.append(each)
        except SceneError as error:
            refused[each] = error
    if not possible:
        raise list(refused.values())[-1]
    return possible, refused


def _stride(run: Run, start: float) -> int:
    """Levels to the next mesh: two as long as starting the process takes longer than solving."""
    return 2 if run.seconds < start else 1


def _worth(run: Run) -> bool:
    """Whether a looser tolerance can save time: where the iteration takes a fifth of it and more."""
    return run.converged and run.rung.level >= 0 and run.phases["iterate"] >= run.seconds / 5


def _in_vain(runs: Sequence[Run], tight: float) -> bool:
    """A looser tolerance was tried, and its last residual met the tight one too: it saved nothing."""
    loose = [run.residual for run in runs if run.converged and run.rung.tolerance > tight]
    return any(residual is not None and residual <= tight for residual in loose)


def _ended(tight: Sequence[Run]) -> bool:
    """Time or memory ran out, or the last two runs gave no answer; a mesh too coarse to be made does not count."""
    if tight and tight[-1].status in ("out_of_time", "out_of_memory"):
        return True
    counted = [run for run in tight if run.rung.level >= 0 or run.status != "refused"]
    return len(counted) >= 2 and not any(run.converged for run in counted[-2:])


@dataclass(frozen=True)
class Budget:
    """Seconds and memory that all runs together may use."""

    seconds: float  # [s]
    memory: float  # of one process [bytes]
    dim: int  # of the scene: it decides how fast work grows with the mesh

    def left(self, runs: Sequence[Run]) -> float:
        """Seconds [s]."""
        return self.seconds - sum(run.spent for run in runs)


def climb(
    ladder: Ladder, runs: list[Run], budget: Budget, measure: Measure, keep: Callable[[Run], None]
) -> tuple[bool, list[str]]:
    """Add runs until none fits any more.

    Args:
        runs: those done so far; new ones are appended.
        measure: solves a rung within so many seconds; None: the user wants to stop.
        keep: called with every run when it is done.

    Returns:
        False if the user stopped it; and the rungs that did not fit, in words.
    """
    while True:
        waiting = list(ladder.candidates(runs))
        costs = {rung: expected_seconds(rung, runs, budget.dim) for rung in waiting}
        small = [r for r in waiting if expected_memory(r, runs, budget.dim) <= budget.memory]
        left = budget.left(runs)
        fits = [rung for rung in small if costs[rung] <= left]
        if not fits:
            return True, [_left_out(rung, costs[rung], left, rung in small) for rung in waiting]
        run = measure(min(fits, key=lambda rung: (ladder.turn(rung), costs[rung], rung)), left)
        if run is None:
            return False, []
        runs.append(replace(run, number=1 + max((each.number for each in runs), default=0)))
        keep(runs[-1])


def retry(runs: Sequence[Run], budget: Budget) -> list[Run]:
    """The runs, without those that ran out of time and would get more time now."""
    others = [run for run in runs if run.status != "out_of_time"]
    late = [run for run in runs if run.status == "out_of_time"]
    return others + [run for run in late if budget.left(others) <= MORE * run.spent]


def _left_out(rung: Rung, cost: float, left: float, small: bool) -> str:
    where = f"order {rung.order}, {rung.method}, cells x {rung.factor:.3g}, tolerance {rung.tolerance:.0e}"
    if not small:
        return f"not run: {where}: would not fit into the memory"
    return f"not run: {where}: would take {seconds(cost)}, {seconds(max(left, 0.0))} are left"


def power_law(values: Mapping[int, float], at: float, least: float, most: float) -> float:
    """The value at a level, by a power of the cell size between `least` and `most` through the finest three.

    A single value gives no power: the least one is taken, because the coarsest mesh is all overhead.

    >>> round(power_law({0: 1.0, 2: 4.0, 4: 16.0}, 6, 1.0, 9.0), 9)  # twice as fine every two levels: power 2
    64.0
    >>> round(power_law({0: 1.0}, 2, 3.0, 9.0), 9)
    8.0
    """
    levels = sorted(values)[-3:]
    x, y = np.array(levels) * np.log(RATIO), np.log([values[level] for level in levels])
    power = np.polyfit(x, y, 1)[0] if len(levels) > 1 else least
    return float(np.exp(y[-1] + np.clip(power, least, most) * (at * np.log(RATIO) - x[-1])))


def overhead(runs: Sequence[Run]) -> float:
    """Time of a process outside its phases [s]."""
    found = [run.spent - run.seconds - (run.estimate or 0.0) for run in runs if run.converged and not run.compiled]
    return float(np.median(found)) if found else START


def expected_seconds(rung: Rung, runs: Sequence[Run], dim: int) -> float:
    """Part of the budget that this rung will take [s]; coarse meshes are all overhead, so a small power may fit."""
    return overhead(runs) + _phases(rung, [run for run in runs if run.phases], dim)


def expected_memory(rung: Rung, runs: Sequence[Run], dim: int) -> float:
    """Peak memory [bytes]; unknown for a chain without a run."""
    mine = [run for run in runs if run.rung.chain == rung.chain and run.memory]
    if not mine:
        return 0.0
    return power_law(_by_level(mine, lambda run: run.memory), rung.level, 0.0, 2.0 * dim)


def _phases(rung: Rung, runs: Sequence[Run], dim: int) -> float:
    mine = [run for run in runs if run.rung.chain == rung.chain]
    same = [run.seconds for run in mine if run.rung.level == rung.level]
    if same:  # of a tighter tolerance
        return max(same)
    tight = [run for run in mine if run.rung.tolerance <= rung.tolerance]
    if tight:
        return power_law(_by_level(tight, lambda run: run.seconds), rung.level, dim / 2, 3.0 * dim)
    near = [run for run in runs if run.rung.level == rung.level]
    return max((ANOTHER * run.seconds for run in near), default=UNTRIED)


def _by_level(runs: Sequence[Run], number: Callable[[Run], float]) -> dict[int, float]:
    """The largest of the runs on each level."""
    found: dict[int, float] = {}
    for run in runs:
        found[run.rung.level] = max(number(run), found.get(run.rung.level, 0.0))
    return found
