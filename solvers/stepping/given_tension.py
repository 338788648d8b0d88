"""Bolts whose tension is given: steps are solved again with better lengths, or once with shortenings as unknowns.

With the forces G (dofs, b) of unit shortenings a, and C (b, b) the energies of their strains, the tensions are
F = C a - G^T u. On the contact dofs, with H = G_c - K_ci K_ii^-1 G_i and M = C - G_i^T K_ii^-1 G_i,

    (S - H M^-1 H^T) u_c = f_c + H M^-1 (F - F_0) - N^T W p,    a = a_0 + M^-1 (F - F_0 + H^T u_c),

where f_c and F_0 are those of shortenings a_0 and u_c = 0: static condensation of b dofs that no contact touches.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from itertools import count

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from stickslip.geometry.arrays import CLOSE, ROUNDING, Array, Ints
from stickslip.geometry.protocols import Vec
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.iteration import OnStep, Solution, Status
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.newton import condensed_system
from stickslip.solvers.newton.semismooth import SemismoothNewton
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.substep import Attempt, Substep, SubstepSolver
from stickslip.solvers.stepping.tightening import Tightening
from stickslip.solvers.stepping.update import displacement
from stickslip.solvers.system.system import System

log = logging.getLogger(__name__)


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
        self, solver: SubstepSolver, problem: SurfaceProblem, u_s: Vec, state: State, p: Array, on_step: OnStep
    ) -> tuple[Solution, SurfaceProblem] | None:
        """Solve a step, and set the shortenings that are found; None: not this way; collective.

        That is Newton's way with condensed bodies where no law remembers slip, at a step's end, in its first try.

        Args:
            solver: with the method in use.
            problem: with the shortenings a_0.
            u_s: prescribed displacement of all dofs [m].
            state: that the step starts from.
            p: tractions (rows,) [Pa] that the iteration starts from.
            on_step: called with each iteration.

        Returns:
            The solution, and the problem with the shortenings that are found.
        """
        lengths, surface = self._lengths, problem.surface
        if lengths is None or solver.chain.stage.method != CondensedNewton.NAME:
            return None
        free = np.flatnonzero(lengths.free)
        ends = problem.cone.time == lengths.target and lengths.tried is None
        ours = len(free) and not lengths.springs.any() and not state.memory
        if not (ends and ours and isinstance(surface, CondensedSurface)):
            return None
        settings = self._system.problem.solver
        newton = SemismoothNewton(
            rtol=settings.tolerance, max_it=settings.max_iterations, linear=condensed_system.solve
        )
        try:
            given = self._given(surface, lengths.places[free])
            q = given.volume.expand(problem.load.f_q, np.zeros(len(given.volume.contact.rows)))
            _, strained = displacement(self._system, lengths.target, q, u_s)
            missing = (lengths.wanted - lengths.tension_at(strained))[free]
            found = newton(given.posed(problem, missing), p, on_step)
        except np.linalg.LinAlgError as error:
            log.info("t = %g: shortenings are found by trying: %s", lengths.target, error)
            return None
        if found.status is not Status.CONVERGED or problem.natural_residual(found.p, found.w) > settings.tolerance:
            log.info("t = %g: shortenings are found by trying: %s", lengths.target, found.status.value)
            return None
        shorter = np.zeros(len(lengths.free))
        shorter[free] = given.shortenings(missing, found.u_c)
        lengths.shorten(shorter)
        return found, solver.posed(state, lengths.target)[0]

    def _given(self, surface: CondensedSurface, places: Ints) -> GivenTensions:
        system, key = self._system, places.tobytes()
        if key not in self._known or self._known[key].volume is not surface.volume:  # they may be condensed anew
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
            surface: the bodies with bolts whose shortening is given.
            pulls: G over the free displacements, a vector [N/m] a bolt.
            C: (b, b) [N/m].

        Raises:
            LinAlgError: whether a bolt resists to be stretched cannot be said for certain.
        """
        self.volume, own = surface.volume, len(surface.volume.contact.rows)
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
