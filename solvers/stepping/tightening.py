"""Bolts tightened by force, springs that act in one way: in each step their shortening, or their slack, is found.

The shortening of a bolt is that at which its tension is what the scene gives; a bolt that is held keeps it. The slack a
and the force T of a spring obey min(T, k (a + gap)) = 0: its stiffness k belongs to the bodies, which stay linear, and
slack is a length that is added to it. A step is solved for some lengths, and again for better ones by Newton's method,
semismooth where springs take up their slack, with Broyden's matrix, whose first one are the secants of each; where
bodies and contact answer in proportion, as where nothing opens or slips, two solutions find that of a bolt that is
alone, and three that of a spring.

With condensed bodies the shortenings are unknowns of one solution. With the forces G (dofs, b) of unit shortenings a,
and C (b, b) the energies of their strains, the tensions are F = C a - G^T u. On the contact dofs, with
H = G_c - K_ci K_ii^-1 G_i and M = C - G_i^T K_ii^-1 G_i,

    (S - H M^-1 H^T) u_c = f_c + H M^-1 (F - F_0) - N^T W p,    a = a_0 + M^-1 (F - F_0 + H^T u_c),

where f_c and F_0 are those of shortenings a_0 and u_c = 0: static condensation of b dofs that no contact touches.

Source: Broyden, Math. Comp. 19 (1965).
"""

from __future__ import annotations

import logging
from dataclasses import replace
from itertools import count

import numpy as np
from petsc4py import PETSc
from scipy.linalg import cho_factor, cho_solve

from stickslip.geometry.arrays import CLOSE, EXACT, ROUNDING, TINY, Array, Bools, Ints
from stickslip.geometry.protocols import Vec
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.iteration import OnStep, Solution, Status
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.newton import condensed_system
from stickslip.solvers.newton.semismooth import SemismoothNewton
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.substep import Attempt, Substep, SubstepSolver
from stickslip.solvers.stepping.update import displacement
from stickslip.solvers.system.system import System

MOST, EACH = 30, 3  # solutions of a step, and for each bolt and spring
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
        """Explain why a step ends without a solution."""
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
            size = np.abs(moved).max()
            way = moved / size  # whose square is no denormal number
            self.J += np.outer((off - residual - self.J @ moved) / size, way) / (way @ way)
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
        # times solver.tolerance: that is allowed where another solution comes no nearer
        return 10.0 * self.system.problem.solver.tolerance * scale

    def _scale(self, state: State) -> Array:
        """Of the forces of bolts and springs (b,) [N]; collective."""
        far = max(float(u.norm(PETSc.NormType.NORM_INFINITY)) for u in (self.start.u, state.u))
        own = np.maximum(np.abs(self.tension(state)), stretched(self.k, far))
        # of the force that displacements would make of a bolt's stiffness: less is known by rounding only
        return np.where(self.springs | (self.largest == 0), own, np.maximum(self.largest, 1e-5 * own))

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


class BoltsAndSprings:
    """Solves steps again until bolts and springs have their forces, and where it can together with their lengths."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._lengths: Tightening | None = None  # in the present step
        self._known: dict[bytes, GivenTensions] = {}  # by the places of the bolts

    def active(self) -> bool:
        """Whether a bolt is tightened by force, or a spring acts in one way."""
        return bool(self._system.initial.tightened)

    def around(self, inner: Substep) -> Substep:
        def tightened(start: State, target: float) -> Attempt:
            lengths = self._lengths = Tightening(self._system, start, target)
            for tries in count(1):
                attempt = inner(start, target)
                if attempt.state is None:
                    held = attempt.good and attempt.good.state and lengths.holds(attempt.good.state)
                    return attempt if held else replace(attempt, good=None)  # lengths that were only tried
                if lengths.done(attempt.state):
                    return attempt
                if tries >= lengths.most or lengths.lost:
                    return replace(attempt, state=None, why=f"{lengths.names}: {lengths.unfound}", when=target)
            raise AssertionError

        return tightened

    def at_once(
        self, solver: SubstepSolver, problem: SurfaceProblem, state: State, p: Array, on_step: OnStep
    ) -> tuple[Solution | None, SurfaceProblem]:
        """Solve a step, and set the shortenings that are found; collective.

        That is Newton's way with condensed bodies where no law remembers slip, at a step's end, in its first try.

        Args:
            solver: with the method in use.
            problem: with shortenings of any try.
            state: that the step starts from.
            p: tractions (rows,) [Pa] that the iteration starts from.
            on_step: called with each iteration.

        Returns:
            The solution, None: not this way; and the problem with the shortenings that are set.
        """
        lengths, surface = self._lengths, problem.surface
        if lengths is None or solver.chain.stage.method != CondensedNewton.NAME:
            return None, problem
        free = np.flatnonzero(lengths.free)
        ends = problem.cone.time == lengths.target and lengths.tried is None
        ours = len(free) and not lengths.springs.any() and not state.memory
        if not (ends and ours and isinstance(surface, CondensedSurface)):
            return None, problem
        settings = self._system.problem.solver
        newton = SemismoothNewton(
            rtol=settings.tolerance, max_it=settings.max_iterations, linear=condensed_system.solve
        )

        def tightened() -> SurfaceProblem:
            """The problem with the shortenings that are set."""
            return replace(problem, load=solver.posed(state, lengths.target)[0].load)

        problem = tightened()
        try:
            given = self._given(surface, lengths.places[free])
            q = given.volume.expand(problem.load.f_q, np.zeros(len(given.volume.contact.rows)))
            _, strained = displacement(self._system, lengths.target, q, self._system.prescribed(lengths.target))
            missing = (lengths.wanted - lengths.tension_at(strained))[free]
            found = newton(given.posed(problem, missing), p, on_step)
        except np.linalg.LinAlgError as error:
            log.info("t = %g: shortenings are found by trying: %s", lengths.target, error)
            return None, problem
        ended = problem if found.gap is None else replace(problem, gap=found.gap)
        if found.status is not Status.CONVERGED or ended.natural_residual(found.p, found.w) > settings.tolerance:
            log.info("t = %g: shortenings are found by trying: %s", lengths.target, found.status.value)
            return None, problem
        shorter = np.zeros(len(lengths.free))
        shorter[free] = given.shortenings(missing, found.u_c)
        lengths.shorten(shorter)
        return found, tightened()

    def _given(self, surface: CondensedSurface, places: Ints) -> GivenTensions:
        system, key = self._system, places.tobytes()
        if key not in self._known or self._known[key].rigid is not surface:  # other pairs, or bodies condensed anew
            pulls = []
            for place in places:
                pulls.append(system.T.createVecRight())
                system.T.multTranspose(system.initial.forces[place], pulls[-1])
            self._known[key] = GivenTensions(surface, pulls, system.initial.coupling[np.ix_(places, places)])
        return self._known[key]


class GivenTensions:
    """Condensed bodies whose bolts give way: `surface` has S - H M^-1 H^T in place of S."""

    def __init__(self, surface: CondensedSurface, pulls: list[Vec], C: Array) -> None:
        """
        Args:
            surface: the bodies with bolts whose shortening is given: `rigid`.
            pulls: G over the free displacements, a vector [N/m] a bolt.
            C: (b, b) [N/m].

        Raises:
            LinAlgError: whether a bolt resists to be stretched cannot be said for certain.
        """
        self.rigid, self.volume, own = surface, surface.volume, len(surface.volume.contact.rows)
        self._H, D = np.zeros((surface.size, len(pulls))), np.zeros_like(C)
        for j, pull in enumerate(pulls):
            inside = self.volume.expand(pull, np.zeros(own))
            self._H[:own, j] = self.volume.contact.read(pull - self.volume.K * inside)
            D[:, j] = [inside.dot(other) for other in pulls]
        M, moved = C - D, surface.flexibility @ self._H
        self._factor = cho_factor(M)
        resists = np.abs(M - self._H.T @ moved).max(axis=0) / np.diag(M)
        # of the stiffness of a bolt: less is rounding; it can be stretched between its ends without force
        # likewise: more is stiffness, of a shank whose ends cut through cells
        if np.any((resists > ROUNDING) & (resists < CLOSE)):
            raise np.linalg.LinAlgError("a bolt resists to be stretched, or does not: rounding decides")
        self.surface = surface.softened(self._H, self._compliant(self._H.T), moved[:, resists <= ROUNDING])

    def posed(self, problem: SurfaceProblem, missing: Array) -> SurfaceProblem:
        """The problem with bolts that give way, of one with shortenings a_0; missing: F - F_0 (b,) [N]."""
        f_c = problem.load.f_c + self._H @ self._compliant(missing)
        load = replace(problem.load, f_c=f_c, resultant=self.surface.R.T @ f_c, free=self.surface.displacement(f_c))
        return replace(problem, surface=self.surface, load=load)

    def shortenings(self, missing: Array, u_c: Array) -> Array:
        """a - a_0 (b,) [m] at the displacement u_c (c,) [m] of the contact dofs."""
        return self._compliant(missing + self._H.T @ u_c)

    def _compliant(self, tension: Array) -> Array:
        """M^-1 F, of tensions F (b,) [N], or (b, k)."""
        return np.asarray(cho_solve(self._factor, tension))
