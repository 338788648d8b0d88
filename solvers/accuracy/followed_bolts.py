"""Bolts tightened to a force, with bubbles: found is the shortening at which the tension is that of the solved step.

Bubbles make bodies softer: with the shortening of the step the tension would fall. Once a bolt is held it keeps the
shortening of the steps with bubbles. Each answer to bubbles is found as the step is, see `tightening`; Broyden's matrix
goes on from answer to answer of a substep, and begins anew with the next one: a resumed run has the same bits.
"""

from __future__ import annotations

import logging

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import CLOSE, EXACT, SLIGHT, Array
from stickslip.geometry.protocols import Vec
from stickslip.solvers.accuracy.bubbles import Bubbles
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.tightening import largest_tension, stretched
from stickslip.solvers.system.system import System

MOST, EACH = 8, 2  # solutions of an answer, and for each bolt
log = logging.getLogger(__name__)


class BoltsByForce:
    """The bolts (b,) of a system that are tightened to a force."""

    def __init__(self, system: System) -> None:
        """Guess of their `stiffness` (b, b) [N/m], of tensions against shortenings: the bodies do not give way."""
        self.bolts = tuple(bolt for bolt in system.initial.tightened if bolt.tension is not None)
        self.places = np.array([bolt.index for bolt in self.bolts], np.int64)
        self.largest = largest_tension(system)
        self.stiffness = np.diag(np.diag(system.initial.coupling)[self.places])

    def scale(self, u: Vec) -> Array | float:
        """Of the tensions, [N] or (b,) [N]: where none is given, by the displacement u; collective."""
        far = float(u.norm(PETSc.NormType.NORM_INFINITY))
        return self.largest or stretched(np.diag(self.stiffness), far)


class FollowedBolts:
    """The bolts of one substep with bubbles; `values` are those of all initial strains (k,) of the last answer."""

    def __init__(self, bolts: BoltsByForce, bubbles: Bubbles, before: State, old: State, new: State) -> None:
        """
        Args:
            before: with bubbles, at the start of the substep.
            old, new: without, at its start and its end.
        """
        self._bolts, self._bubbles, places, self._J = bolts, bubbles, bolts.places, bolts.stiffness.copy()
        self._free = np.array([old.time < bolt.held_from * (1 - EXACT) for bolt in bolts.bolts], bool)
        self._wanted, self.values = -new.initial_work[places], new.initial.copy()
        moved = new.initial[places] - old.initial[places]
        self._kept = before.initial[places] + moved
        self._learn(moved, old.initial_work[places] - new.initial_work[places])
        self._tried: tuple[Array, Array] | None = None  # shortenings, and by how much tensions were off
        self._tries, self._moves = 0, self._free

    def _learn(self, moved: Array, gained: Array) -> None:
        """Take over what the tensions gain (b,) [N] when shortenings move by (b,) [m]."""
        if moved.any():
            self._J += np.outer(gained - self._J @ moved, moved) / (moved @ moved)

    def begin(self, trial: bool) -> None:
        """Begin an answer.

        Args:
            trial: whether bolts that are held follow the tension of the step, too: it is one of bubbles around it.
        """
        self._tried, self._tries = None, 0
        self._moves = np.full(len(self._free), True) if trial else self._free
        # deviation of a tension, relative to the largest of all; of an answer that is a trial
        self._near = SLIGHT if trial else CLOSE
        places = self._bolts.places
        self.values = self.values.copy()
        self.values[places] = np.where(self._moves, self.values[places], self._kept)

    @property
    def given_up(self) -> bool:
        """Whether no shortening was found."""
        return self._tries > MOST + EACH * len(self._free)

    def done(self, u: Vec, x: Vec) -> bool:
        """Whether tensions are right at a displacement u without rigid motion and bubbles x; else `values` are better;
        collective."""
        places, moves = self._bolts.places, self._moves
        if not moves.any():
            return True
        system = self._bubbles.system
        work = system.initial.stress_work(self.values, u) + self._bubbles.initial_work(x)
        off = np.where(moves, -work[places] - self._wanted, 0.0)
        scale = self._bolts.scale(u)
        if np.all(np.abs(off) <= self._near * scale):
            return True
        now = self.values[places]
        if self._tried is not None:
            self._learn(now - self._tried[0], off - self._tried[1])
        self._tried, self._tries = (now, off), self._tries + 1
        step = np.zeros(len(moves))
        step[moves] = np.linalg.lstsq(self._J[np.ix_(moves, moves)], -off[moves], rcond=None)[0]
        self.values = self.values.copy()
        self.values[places] = now + step
        log.debug("tension of bolts with bubbles off by %.1e", np.abs(off / scale).max())
        return False
