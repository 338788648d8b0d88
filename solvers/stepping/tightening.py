"""Bolts tightened by force: in each step the shortening is found at which the tension is what the scene gives.

A step is solved for a shortening, and again for a better one by Broyden's method, whose first matrix are the secants of
each bolt; where bodies and contact answer in proportion, as where nothing opens or slips, two solutions find it for a
bolt that is alone. A bolt that is held keeps its shortening.

Source: Broyden, Math. Comp. 19 (1965).
"""

from __future__ import annotations

import logging

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Vec
from stickslip.solvers.scene.timeline import CLOSE
from stickslip.solvers.stepping.state import State
from stickslip.solvers.system.initial_strain import Tightened
from stickslip.solvers.system.system import System

TIGHT = 1e-9  # deviation of the tension, relative to the largest of a bolt in time, that is aimed at
LOOSE = 10.0  # times solver.tolerance: that is allowed where another solution comes no nearer
MOST = 30  # solutions of a step
log = logging.getLogger(__name__)


class Tightening:
    """The shortenings (b,) of all bolts in one step; `done` judges a solution, and tries others."""

    def __init__(self, system: System, start: State, target: float) -> None:
        """Guess: the bodies do not give way.

        Args:
            start: of the step.
            target: time at its end [s].
        """
        self.system, self.start, self.target = system, start, target
        course = system.course
        self.bolts = system.initial.tightened
        self.places = np.array([bolt.index for bolt in self.bolts])
        self.k = np.diag(system.initial.coupling)[self.places]
        self.before, self.pulled = start.initial[self.places], self.tension(start)
        self.free = np.array([start.time < bolt.held_from * (1 - CLOSE) for bolt in self.bolts])
        self.wanted = np.array([course.value(bolt.tension, target) for bolt in self.bolts])
        self.largest = np.array([_largest(system, bolt) for bolt in self.bolts])
        self.x = self.before + np.where(self.free, (self.wanted - self.pulled) / self.k, 0.0)
        self.J = np.diag(self.k)
        self.tried: tuple[Array, Array] | None = None  # shortenings, and by how much tensions were off
        self.lost = False  # whether no better shortening is known
        self._set()

    @property
    def names(self) -> str:
        """The bolts, as in the scene."""
        return ", ".join(f"{bolt.tension.table}.{bolt.tension.name}" for bolt in self.bolts)

    @classmethod
    def of(cls, system: System, start: State, target: float) -> Tightening | None:
        """None: no bolt is tightened by force."""
        return cls(system, start, target) if system.initial.tightened else None

    def tension(self, state: State) -> Array:
        """Of each bolt (b,) [N]."""
        return np.asarray(-state.initial_work[self.places])

    def tension_at(self, u: Vec) -> Array:
        """Of each bolt (b,) [N] at the end of the step, with the shortenings that are set; u without rigid motion."""
        initial = self.system.initial
        return np.asarray(-initial.stress_work(initial.values(self.system.course, self.target), u)[self.places])

    def shorten(self, more: Array) -> None:
        """Set shortenings larger by (b,) [m]; if there are no such numbers, nothing resists, and `lost` is set."""
        self.lost = not np.isfinite(more).all()
        if not self.lost:
            self.x = self.x + more
            self._set()

    def done(self, state: State) -> bool:
        """Whether the tensions are right; if not, the step is to be solved again with other shortenings."""
        off = np.where(self.free, self.tension(state) - self.wanted, 0.0)
        allowed = LOOSE * self.system.problem.solver.tolerance * self.largest
        log.info("t = %g: tension of bolts off by %.1e", self.target, np.abs(off / self.largest).max())
        near = np.all(np.abs(off) <= allowed)  # with a loose solver no shortening need be better
        if np.all(np.abs(off) <= TIGHT * self.largest) or (near and self.tried and _worse(off, self.tried[1])):
            return True
        if self.tried is None:  # how much the bodies give way is known now: as if bolts did not loosen each other
            moved, gained = self.x - self.before, self.tension(state) - self.pulled
            rises = np.flatnonzero(gained * moved > 0)
            self.J[rises, rises] = gained[rises] / moved[rises]
        else:
            x, residual = self.tried
            moved = self.x - x
            self.J += np.outer(off - residual - self.J @ moved, moved) / (moved @ moved)
        self.tried = self.x, off
        step, J = np.zeros(len(off)), self.J[np.ix_(self.free, self.free)]
        well = np.isfinite(J).all() and np.linalg.cond(J) < 1 / np.finfo(float).eps
        step[self.free] = np.linalg.solve(J, -off[self.free]) if well else np.nan
        self.shorten(step)
        return False

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


def _largest(system: System, bolt: Tightened) -> float:
    """Largest tension that the scene gives [N]; 1 if it is always zero."""
    times = system.course.timeline.times
    return max((abs(system.course.value(bolt.tension, time)) for time in times), default=0.0) or 1.0


def recall(system: System, time: float, shortened: Array) -> None:
    """Use the shortenings (b,) [m] that were found at a time [s]."""
    bolts = zip(system.initial.tightened, shortened.tolist(), strict=True)
    system.course.found = {bolt.shortening: ((time, x),) for bolt, x in bolts}


def tension_off(system: System, u: Vec, time: float) -> Array:
    """By how much the tension of each bolt differs from what the scene gives [N], 0 where it is held; collective."""
    course, bolts = system.course, system.initial.tightened
    held = [time > bolt.held_from * (1 + CLOSE) for bolt in bolts]
    if all(held):
        return np.zeros(0)
    work = system.initial.stress_work(system.initial.values(course, time), u)
    given = zip(bolts, held, strict=True)
    return np.array([-work[bolt.index] - course.value(bolt.tension, time) for bolt, gone in given if not gone])
