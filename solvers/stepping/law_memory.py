"""Laws that remember slip: a substep is solved with the mu of each point, until mu is that of its own slip.

So is wear by the slip that friction leaves: the path of the slip in the substep is found by the same turns. They
contract by mu k p f_t / f_n, with f the flexibilities of a point: its slip s wears off k p s, which takes k p s / f_n
of its pressure, and mu times that of its friction; that lets it slip by f_t times as much. From 1 on there may be
several solutions, as with mu that falls by slip. Metals have some 1e-5.

With mu fixed the substep is one of Coulomb's law. From the mu at its start, slip and mu are found by turns. Where
bodies unload by more than friction weakens, these turns approach the one solution. Where friction weakens faster, there
may be several: slip then grows from turn to turn, up to the first solution, which is the nearest to the state before.

Source: Rice & Ruina, J. Appl. Mech. 50 (1983), of the stiffness that slip weakening needs; Irons & Tuck, Int. J.
Numer. Meth. Engng 1 (1969), of the step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import CLOSE, EXACT, Array
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import QUICK, Solution, Stall, Status
from stickslip.solvers.laws.law import touching
from stickslip.solvers.laws.wear import PRESSED, REPEAT, SLID, WORN, Worn
from stickslip.solvers.newton import path
from stickslip.solvers.newton.correction import ENOUGH

Memory = Mapping[str, Array]  # by contact whose law remembers slip, what it does of each point (m_t,); see `WORN` too
Solving = Callable[[SurfaceProblem, Array], tuple[Solution, SurfaceProblem]]  # from tractions (rows,) [Pa]
Exact = Callable[[SurfaceProblem, Solution], tuple[Solution, float]]  # from a near solution, and their distance


def no_memory(cone: AdmissibleSet) -> dict[str, Array]:
    """Memory of laws at t = 0."""
    found = {c.name: c.first_memory() for c in cone.contacts if c.friction is not None and c.friction.remembers}
    for c in cone.contacts:
        if c.fields is None or c.fields.wear is None:
            continue
        asks_for = c.fields.wear.asks_for
        keys = {WORN: True, SLID: c.friction is not None or asks_for("slip"), PRESSED: asks_for("pressure")}
        found |= {f"{c.name}{key}": np.zeros(len(c.W_n)) for key, kept in keys.items() if kept}
    return found


def repeats(memory: Memory) -> float:
    """Number of load cycles that a step from it stands for."""
    return float(memory.get(REPEAT, 1.0))


def worn_depth(cone: AdmissibleSet, memory: Memory) -> Array:
    """Worn depth of each row (rows,) [m]."""
    found = np.zeros(cone.size)
    for place in cone.places:
        found[place.normal] = memory.get(f"{place.rows.name}{WORN}", 0.0)
    return found


def with_memory(
    cone: AdmissibleSet, memory: Memory, step: float | None = None, start: Memory | None = None
) -> AdmissibleSet:
    """The admissible set of points that remember so much at its time.

    Args:
        step: length [s] of a substep that is to be solved, in which what does not `remember` by turns is not known yet.
        start: what they remember at its start; None: the same.
    """
    if not memory:
        return cone
    start = memory if start is None else start

    def now(c: ContactRows) -> ContactRows:
        if (worn := start.get(f"{c.name}{WORN}")) is not None:
            softness = None
            if step is not None:
                path, slid = repeats(start) * c.path(None, cone.time, step), memory.get(f"{c.name}{SLID}")
                if slid is not None:
                    path = np.maximum(path, slid - start[f"{c.name}{SLID}"])
                softness = path * c.wear_rate(cone.time, memory.get(f"{c.name}{PRESSED}"), slid)
            c = c.worn(worn, softness)
        if c.friction is None or c.name not in memory:
            return c
        known = memory[c.name]
        return replace(c, friction=c.friction.at(known) if step is None else c.friction.within(known, step))

    return replace(cone, contacts=tuple(map(now, cone.contacts)))


@dataclass(frozen=True)
class LawMemory:
    """Memory of laws in one substep; the loop around the method that solves it with the mu of its own slip."""

    cone: AdmissibleSet  # with laws that remember
    start: Memory  # at its start
    step: float  # its length [s]
    tolerance: float = 0.0  # difference of a friction bound from that of the slip found, relative to tractions [-]

    def after(self, problem: SurfaceProblem, p: Array, w: Array) -> dict[str, Array]:
        """Memory at the end: points that touch there have slipped by |w - gap - t / k_T|.

        Args:
            problem: of the substep.
            p: tractions (rows,) [Pa].
            w: relative displacement (rows,) [m].
        """
        if not self.start:
            return {}
        moved, worn = w - problem.gap - problem.cone.give(p), dict[str, Array]()
        slips, ways = dict[str, Array](), dict[str, Array]()
        for rows, place in ((place.rows, place) for place in self.cone.places):
            length = np.linalg.norm(moved[place.tangential].reshape(rows.free.shape) * rows.free, axis=1)
            slips[rows.name] = np.where(touching(p[place.normal], rows.average, rows.normal), length, 0.0)
            ways[rows.name] = length
            if (key := f"{rows.name}{WORN}") in self.start:
                way, pressed = self.start.get(f"{rows.name}{SLID}"), self.start.get(f"{rows.name}{PRESSED}")
                path = repeats(self.start) * rows.path(length, self.cone.time, self.step)
                if pressed is not None:
                    pressed = worn[f"{rows.name}{PRESSED}"] = np.maximum(p[place.normal], 0.0)
                rate = rows.wear_rate(self.cone.time, pressed, None if way is None else way + path)
                worn[key] = self.start[key] + rate * path * p[place.normal]
        return self._moved(slips, ways) | worn

    def _moved(self, slips: Mapping[str, Array], ways: Mapping[str, Array]) -> dict[str, Array]:
        """Memory but for worn depths after a substep.

        Args:
            slips: by contact, its length (m_t,) [m] at points that touch.
            ways: at all points: what wears does not jump where they part, for without pressure nothing wears.
        """
        found = {key: self.start[key] for key in (REPEAT,) if key in self.start}
        for c in self.cone.contacts:
            if c.name in self.start and c.friction is not None:
                found[c.name] = c.friction.after(self.start[c.name], slips[c.name], self.step)
            if (key := f"{c.name}{SLID}") in self.start:
                path = repeats(self.start) * c.path(ways[c.name], self.cone.time, self.step)
                found[key] = self.start[key] + path
            if (key := f"{c.name}{PRESSED}") in self.start:
                found[key] = np.zeros(len(c.W_n))
        return found

    def around(self, solve: Solving) -> Solving:
        """Solve a problem with the mu of the slip in its own solution; the problem is returned as it is then."""
        laws = {c.name: c.friction for c in self.cone.contacts}
        turns = [
            k for k in self.start if k.endswith((SLID, PRESSED)) or ((law := laws.get(k)) is not None and not law.drags)
        ]
        return lambda problem, p: self._by_turns(problem, p, solve, turns) if turns else solve(problem, p)

    def _by_turns(
        self, problem: SurfaceProblem, start: Array, solve: Solving, names: list[str]
    ) -> tuple[Solution, SurfaceProblem]:
        """Solve by turns of slip and mu of the contacts of these names."""
        solution, problem = solve(problem, start)
        still = {c.name: np.zeros(len(c.W_t)) for c in self.cone.contacts}
        least = self._moved(still, still)
        known, gap, omega, off, worst = self.start, None, 1.0, 0.0, self._worn_off(problem, solution)
        most, stall = 10.0, Stall(QUICK)  # steps, in units of the change of slip in a turn
        for turn in range(200):  # near the edge of stability turns are slow
            if solution.status is not Status.CONVERGED:
                return solution, problem
            found = self.after(problem, solution.p, solution.w)
            before, gap = gap, np.concatenate([found[name] - known[name] for name in names])
            if before is not None and before.any():
                ratio = 1 - (1 - float(gap @ before) / float(before @ before)) / omega  # of turns without the step
                # times the tolerance; differences of less may be what the method has left
                if (
                    omega == 1.0
                    and off > 100.0 * self.tolerance
                    and not any(name.endswith((SLID, PRESSED)) for name in names)
                ):
                    worst = max(worst, ratio)
                omega = min(max(1 / (1 - ratio), 1e-3) if ratio < 1 else 1.0, most)
            off = self._apart(problem, solution.p, found)
            if stall(turn, off):  # what turns about the solution comes nearer in shorter steps
                most, stall = min(most, omega) / 2, Stall(QUICK, turn)
            if off <= self.tolerance:
                return replace(solution, weakening=worst), problem
            known = {name: np.maximum(known[name] + omega * (found[name] - known[name]), least[name]) for name in least}
            cone = with_memory(self.cone, known, self.step, self.start)
            solution, problem = solve(replace(problem, cone=cone), solution.p)
        return replace(solution, status=Status.UNSTEADY, weakening=worst), problem

    def _worn_off(self, problem: SurfaceProblem, without: Solution) -> float:
        """How much faster than bodies unload friction falls by what its slip wears off, at the most [-]; 0: unknown.

        Args:
            without: the solution without wear in the step, which presses hardest.
        """
        worst, p, give = 0.0, without.p, problem.give
        for place in problem.cone.with_friction():
            rows = place.rows
            if give is not None and f"{rows.name}{SLID}" in self.start:
                p_n, slid = np.maximum(p[place.normal], 0.0), self.start[f"{rows.name}{SLID}"]
                lost = rows.wear_rate(self.cone.time, p_n, slid) * p_n / give[place.normal]  # [Pa/m]
                fall = problem.cone.bound_slope(place, p[place.normal]) @ lost
                worst = max(worst, float((fall * give[place.tangential][:: place.components]).max(initial=0.0)))
        return worst

    def exact(self, problem: SurfaceProblem, found: Solution, exact: Exact) -> tuple[Solution, float, dict[str, Array]]:
        """The exact solution, with the mu of its own slip, from what a method found.

        Args:
            problem: with the mu that the method ended with.
            found: what the method returned.
            exact: the exact solution of a problem, and their distance [J^(1/2)]; nan: not found.

        Returns:
            The solution, an upper estimate of its distance from `found` in the energy norm [J^(1/2)], which is nan
            where it was not found, and its memory at the end.
        """
        at, size = exact(problem, found)
        if not self.start or np.isnan(size):
            return at, size, self.after(problem, at.p, at.w)

        def solve(turned: SurfaceProblem, p: Array) -> tuple[Solution, SurfaceProblem]:
            nonlocal at, size
            if turned is not problem:
                at, farther = exact(turned, at)
                size += farther
            return at if np.isfinite(size) else replace(at, status=Status.BROKEN), turned

        off = self._apart(problem, at.p, self.after(problem, at.p, at.w))
        nearer = replace(self, tolerance=max(ENOUGH * off, EXACT))
        ended, turned = nearer.around(solve)(problem, at.p)
        return at, size if ended.status is found.status else np.nan, self.after(turned, at.p, at.w)

    def others(self, problem: SurfaceProblem, p: Array) -> tuple[Array, ...]:
        """Tractions (rows,) [Pa] of other solutions, with the mu of the slip in each of them.

        Args:
            problem: with the mu that p was found with.
            p: tractions (rows,) [Pa] that solve it.
        """

        def keeps(p: Array, w: Array) -> bool:
            return self._apart(problem, p, self.after(problem, p, w)) <= CLOSE

        return tuple(path.others(problem, p, keeps) if self.start else path.others(problem, p))

    def _apart(self, problem: SurfaceProblem, p: Array, memory: Memory) -> float:
        """Largest difference of its friction bounds at p (rows,) [Pa] from those with a memory, relative to p [-].

        A worn depth counts by the pressure that the bodies answer it with.
        """
        own, other = problem.cone, with_memory(self.cone, memory, self.step, self.start)
        pairs = zip(own.with_friction(), other.with_friction(), strict=True)
        apart = [own.bound(a, p[a.normal]) - other.bound(b, p[b.normal]) for a, b in pairs]
        for a, b in zip(own.places, other.places, strict=True):
            if isinstance(one := a.rows.normal, Worn) and isinstance(two := b.rows.normal, Worn):
                apart.append(problem.gamma[a.normal] * (one.softness - two.softness) * p[a.normal])
        largest = max((float(np.abs(each[np.isfinite(each)]).max(initial=0.0)) for each in apart), default=0.0)
        return largest / (problem.scales.of_tractions(p) or 1.0)  # zero: nothing is loaded
