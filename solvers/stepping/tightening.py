"""Bolts tightened by force, springs that act in one way: in each step their shortening, or their slack, is found.

The shortening of a bolt is that at which its tension is what the scene gives; a bolt that is held keeps it. The slack a
and the force T of a spring obey min(T, k (a + gap)) = 0: its stiffness k belongs to the bodies, which stay linear, and
slack is a length that is added to it. A step is solved for some lengths, and again for better ones by Newton's method,
semismooth where springs take up their slack, with Broyden's matrix, whose first one are the secants of each; where
bodies and contact answer in proportion, as where nothing opens or slips, two solutions find that of a bolt that is
alone, and three that of a spring.

Source: Broyden, Math. Comp. 19 (1965).
"""

from __future__ import annotations

import logging

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import CLOSE, EXACT, ROUNDING, TINY, Array, Bools
from stickslip.geometry.protocols import Vec
from stickslip.solvers.stepping.state import State
from stickslip.solvers.system.system import System

LOOSE = 10.0  # times solver.tolerance: that is allowed where another solution comes no nearer
MOST, EACH = 30, 3  # solutions of a step, and for each bolt and spring
KNOWN = 1e-5  # of the force that displacements would make of a bolt's stiffness: less is known by rounding only
log = logging.getLogger(__name__)


class Tightening:
    """The lengths (b,) of all such bolts and springs in one step; `done` judges a solution, and tries others."""

    def __init__(self, system: System, start: State, target: float) -> None:
        """Guess: the bodies do not give way, and springs stay as slack as they are.

        Args:
            start: of the step.
            target: time at its end [s].
        """
        self.system, self.start, self.target = system, start, target
        self.bolts = system.initial.tightened
        self.places = np.array([bolt.index for bolt in self.bolts])
        self.k = np.diag(system.initial.coupling)[self.places]
        self.before, self.pulled = start.initial[self.places], self.tension(start)
        self.springs = np.array([bolt.tension is None for bolt in self.bolts])
        self.least = np.array([-bolt.gap for bolt in self.bolts])
        self.free = np.array([start.time < bolt.held_from * (1 - EXACT) for bolt in self.bolts])
        self.wanted = self._given(target)
        self.largest = largest_tension(system)
        guessed = self.free & ~self.springs
        self.x = self.before + np.where(guessed, (self.wanted - self.pulled) / self.k, 0.0)
        self.J = np.diag(self.k)
        self.lost = False  # whether no length changes the forces, or a spring is to be longer than the bodies
        self.tried: tuple[Array, Array] | None = None  # shortenings, and by how much tensions were off
        self._set()

    @property
    def names(self) -> str:
        """The bolts and springs, as in the scene."""
        return ", ".join(f"{bolt.shortening.table}.{bolt.shortening.name}" for bolt in self.bolts)

    @property
    def most(self) -> int:
        """Solutions of a step."""
        return MOST + EACH * len(self.bolts)

    @property
    def unfound(self) -> str:
        """Why a step ends without a solution."""
        bolts = "no shortening was found at which the tension is force"
        why = "nothing else holds the bodies there" if self.lost else "take shorter steps, or fewer springs"
        springs = f"no slack was found at which what is slack is free of force; {why}"
        kinds = {bolts: not bool(self.springs.all()), springs: bool(self.springs.any())}
        return " / ".join(text for text, there in kinds.items() if there)

    def tension(self, state: State) -> Array:
        """Of each (b,) [N]; of a spring the force in the way in which it acts."""
        return np.asarray(-state.initial_work[self.places])

    def tension_at(self, u: Vec) -> Array:
        """Of each bolt (b,) [N] at the end of the step, with the shortenings that are set; u without rigid motion."""
        initial = self.system.initial
        return np.asarray(-initial.stress_work(initial.values(self.system.course, self.target), u)[self.places])

    def shorten(self, more: Array) -> None:
        """Set shortenings larger by (b,) [m]."""
        self.x = self.x + more
        self._set()

    def done(self, state: State) -> bool:
        """Whether the tensions are right; if not, the step is to be solved again with other lengths."""
        off, taut, defect = self._compared(state, self.x, self.wanted)
        scale = self._scale(state)
        allowed = self._allowed(scale)
        log.info("t = %g: tension of bolts and springs off by %.1e", self.target, np.abs(defect / scale).max())
        near = np.all(np.abs(defect) <= allowed)  # with a loose solver no length need be better
        # deviation of a tension, relative to the largest of all bolts and times, that is aimed at
        exact = np.all(np.abs(defect) <= np.where(taut, 0.0, ROUNDING * scale))
        if exact or (near and self.tried and _worse(off, self.tried[1]) and not defect[taut].any()):
            return True
        if self.tried is None:  # how much the bodies give way is known now: as if bolts did not loosen each other
            moved, gained = self.x - self.before, self.tension(state) - self.pulled
            rises = np.flatnonzero(gained * moved > 0)
            self.J[rises, rises] = gained[rises] / moved[rises]
        else:
            x, residual = self.tried
            moved = self.x - x
            if not moved.any():
                self.lost = True
                return False
            self.J += np.outer(off - residual - self.J @ moved, moved) / (moved @ moved)
        self.tried = self.x, off
        step, moves = np.where(taut, self.least - self.x, 0.0), self.free & ~taut
        off = off + self.J @ step
        flat = np.flatnonzero(self.springs & (np.diag(self.J) < CLOSE * self.k))  # longer ones answer with no force
        self.J[flat, flat] = CLOSE * self.k[flat]
        step[moves] = np.linalg.lstsq(self.J[np.ix_(moves, moves)], -off[moves], rcond=None)[0]
        longest = np.where(self.springs, self.system.extent, np.inf)
        self.lost = bool(np.any(self.springs & (self.x >= longest) & (step > 0)))
        self.x = np.where(taut, self.least, np.minimum(self.x + step, longest))
        self._set()
        return False

    def holds(self, state: State) -> bool:
        """Whether the tensions are right at a time on the way; collective."""
        defect = self._compared(state, state.initial[self.places], self._given(state.time))[2]
        return bool(np.all(np.abs(defect) <= self._allowed(self._scale(state))))

    def _given(self, time: float) -> Array:
        """Tensions (b,) [N] that the scene gives; 0 for springs."""
        return np.array([0.0 if b.tension is None else self.system.course.value(b.tension, time) for b in self.bolts])

    def _compared(self, state: State, x: Array, wanted: Array) -> tuple[Array, Bools, Array]:
        """By how much tensions are off (b,) [N], which springs are taut, and how far each is from being right [N]."""
        tension = self.tension(state)
        off = np.where(self.free, tension - wanted, 0.0)
        taut = self.springs & (tension > self.k * (x - self.least))
        return off, taut, np.where(taut, self.k * (x - self.least), off)

    def _allowed(self, scale: Array) -> Array:
        """Deviation (b,) [N] that another solution need not mend; scale: see `_scale`."""
        return LOOSE * self.system.problem.solver.tolerance * scale

    def _scale(self, state: State) -> Array:
        """Of the forces of bolts and springs (b,) [N]; collective."""
        far = float(state.u.norm(PETSc.NormType.NORM_INFINITY))
        own = np.maximum(np.abs(self.tension(state)), stretched(self.k, far))
        return np.where(self.springs | (self.largest == 0), own, np.maximum(self.largest, KNOWN * own))

    def _set(self) -> None:
        begun = self.start.time < self.target
        each = zip(self.bolts, self.before.tolist(), self.x.tolist(), strict=True)
        self.system.course.found = {
            bolt.shortening: ((self.start.time, a), (self.target, x)) if begun else ((self.target, x),)
            for bolt, a, x in each
        }


def _worse(off: Array, before: Array) -> bool:
    """Whether the last solution has come no nearer."""
    return bool(np.abs(off).max() > np.abs(before).max() / 2)


def largest_tension(system: System) -> float:
    """Largest tension that the scene gives, of all bolts and times [N]: of a step all are as exact."""
    course = system.course
    places = [bolt.tension for bolt in system.initial.tightened if bolt.tension is not None]
    return max((abs(course.value(place, time)) for place in places for time in course.timeline.times), default=0.0)


def stretched(k: Array, far: float) -> Array:
    """Forces (b,) [N] of bolts or springs of stiffness k (b,) [N/m] that are longer by `far` [m]; never zero."""
    return k * max(far, TINY)  # [m]


def recall(system: System, time: float, shortened: Array) -> None:
    """Use the shortenings and slacks (b,) [m] that were found at a time [s]."""
    bolts = zip(system.initial.tightened, shortened.tolist(), strict=True)
    system.course.found = {bolt.shortening: ((time, x),) for bolt, x in bolts}


def tension_off(system: System, u: Vec, time: float) -> Array:
    """By how much the tension of each bolt differs from what the scene gives [N], 0 where it is held; collective.

    Of a spring that acts in one way it is the smaller one of its force and of what its slack would take.
    """
    course, bolts = system.course, system.initial.tightened
    held = [time > bolt.held_from * (1 + EXACT) for bolt in bolts]
    if all(held):
        return np.zeros(0)
    values, k = system.initial.values(course, time), np.diag(system.initial.coupling)
    work, off = system.initial.stress_work(values, u), list[float]()
    for bolt, gone in zip(bolts, held, strict=True):
        if bolt.tension is None:
            off.append(min(-work[bolt.index], k[bolt.index] * (values[bolt.index] + bolt.gap)))
        elif not gone:
            off.append(-work[bolt.index] - course.value(bolt.tension, time))
    return np.array(off)
