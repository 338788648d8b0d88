"""Points that close within a substep: their slip counts from where they touch, not from where the substep begins.

A point that is open at the beginning moves freely until its gap g is closed, and sticks or slips from there on. Without
the tractions of all points that close it would have gone on to where it is D closer: it touches at the part g / (g + D)
of that way. The way is that of a solution, for the tractions that hold a point back are then all left out; D follows
from them and the flexibility. Floating bodies are held by other points, which do what they do at the end: D is that of
one solve with the laws of these points linearised, where the bodies are condensed; else these points stay where they
are, as well as they can. An obstacle goes the same way whether it is driven by a force or its motion is given. Of
bodies that nothing held before the way is a rigid motion in the direction of the contact's force: their solution sticks
wherever it is started. So bodies that fall on each other, and loads in proportion, have the slip of infinitely short
steps; elsewhere the error is of second order in the step, as long as ways are straight.

Source: Jäger, Arch. Appl. Mech. 65 (1995), and Ciavarella, Int. J. Solids Struct. 35 (1998): under loads in proportion
what stops a point along a side and what stops it across are alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from stickslip.geometry.arrays import CLOSE, EXACT, ROUNDING, SLIGHT, Array, Bools
from stickslip.solvers.contact.admissible_set import ContactBlock, project_disc
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.iteration import Correction, Solution, Status
from stickslip.solvers.laws.law import touching
from stickslip.solvers.newton import condensed_system
from stickslip.solvers.newton.active_set import linearise
from stickslip.solvers.newton.correction import CONTRACTION, SOLVES, UNSURE

Solve = Callable[[SurfaceProblem, Array], tuple[Solution, SurfaceProblem]]  # from tractions (rows,) [Pa]


@dataclass(frozen=True)
class Way:
    """The way of points within a substep."""

    problem: SurfaceProblem  # slip is counted from its beginning
    p: Array  # tractions (rows,) [Pa] there
    w: Array  # relative displacement (rows,) [m] there
    tolerance: float  # of the solutions [-]: changes that are this part of the scale of motion are none
    added: Array | float = 0.0  # (c,) [N] to forces that hold points back, where bodies are softer than `problem` knows

    @property
    def any(self) -> bool:
        """Whether a point with friction has room to close."""
        return any((place.average @ self.room[place.normal]).any() for place in self.problem.cone.with_friction())

    def from_touch(self, found: tuple[Solution, SurfaceProblem], solve: Solve) -> tuple[Solution, SurfaceProblem]:
        """The solution of the substep with the slip of points that close in it counted from their touch; collective.

        Args:
            found: a solution, and the problem with slip and laws as they are then.
            solve: solves such a problem.
        """
        (solution, last), touch = found, Touch(self)
        while solution.status is Status.CONVERGED and (gap := touch(solution.p, solution.w, last.gap)) is not last.gap:
            solution, last = solve(replace(self.problem, gap=gap), solution.p)
        if (correct := solution.correct) is not None and touch.felt is not None:
            left = self._left(solution.p, touch.felt)
            solution = replace(solution, correct=lambda before: _larger(correct(before), left))
        return solution, replace(last, gap=touch.idle) if touch.idle is not None else last

    @cached_property
    def room(self) -> Array:
        """Gaps (normal rows,) [m] at the beginning, where more than rounding: also of places, beside the motions."""
        n, scales = self.problem.surface.normal_rows, self.problem.scales
        room = np.where(self.p[:n] == 0, self.problem.gap[:n] - self.w[:n], 0.0)
        return np.where(room > np.maximum(scales.no_motion(self.w)[:n], ROUNDING * scales.motion), room, 0.0)

    @cached_property
    def _motions(self) -> Array:
        """Rigid motions (rows, modes), without what is rounding: a motion along a surface closes nothing."""
        motions = np.asarray(self.problem.surface.N @ self.problem.surface.R)
        return np.where(np.abs(motions) > CLOSE * np.abs(motions).max(axis=0, initial=0.0), motions, 0.0)

    def closing(self, place: ContactBlock, p: Array) -> Bools:
        """Which points (m_t,) of a contact close before there are tractions p (rows,) [Pa]: what presses had room."""
        law, average, n = place.rows.normal, place.average, place.normal
        closed = touching(self.p[n], average, law)
        return np.asarray(touching(p[n], average, law) & ~closed & (average @ (p[n] * self.room[n]) > 0))

    def touched(self, p: Array, w: Array, before: Array) -> Array:
        """Gap (rows,) [m] with slip counted from where points touch that close; collective.

        Args:
            p: tractions (rows,) [Pa] at the end.
            w: relative displacement (rows,) [m] at the end.
            before: gap (rows,) [m] that they are found with.
        """
        problem, gap = self.problem, self.problem.gap.copy()
        closes = self._closes(p)
        rooms = [place.average @ self.room[place.normal] for place in problem.cone.with_friction()]
        if not any(which.any() for which in closes):
            return gap
        found = self._free(p, w, before, closes)
        free = w - problem.cone.softness * p + self._freed(p, closes) if found is None else found[1]
        beyond = free - problem.gap
        for place, which, ahead in zip(problem.cone.with_friction(), closes, rooms, strict=True):
            n, t = place.normal, place.tangential
            along, pushed = self._adrift(place, p), problem.surface.W[n] * p[n] * (self.room[n] > 0)
            way, whole, length = beyond, ahead + np.maximum(place.average @ beyond[n], 0.0), float(pushed @ along[n])
            if length > 0:
                way = along * (pushed @ (self.room[n] + beyond[n]) / length)
                whole = np.maximum(place.average @ way[n], ahead)
            part = np.divide(ahead, whole, out=np.zeros_like(ahead), where=which)
            gap[t] += np.repeat(part, place.components) * way[t]
        return gap

    def _adrift(self, place: ContactBlock, p: Array) -> Array:
        """Relative motion (rows,) of bodies that no closed point held, along the force of a contact; 0: there is none.

        Args:
            p: tractions (rows,) [Pa] at the end.
        """
        surface, rows, along = self.problem.surface, place.rows, np.zeros_like(p)
        if not surface.floating or self.problem.idle:
            return along
        own, motions = np.r_[place.normal, place.tangential], self._motions
        slave = np.arange(len(rows.points))[:, None] < len(rows.surface.points)
        force = rows.nodal_forces(p[place.normal], p[place.tangential])
        push = np.where(slave, force[slave[:, 0]].sum(axis=0), 0.0).ravel()
        pushed = np.concatenate([rows.N_n @ push, rows.N_t @ push])
        motion = np.linalg.lstsq(motions[own], pushed, rcond=None)[0]
        held = motions[self.p != 0]
        motion = motion - np.linalg.lstsq(held, held @ motion, rcond=None)[0]
        along[own] = motions[own] @ motion
        return along if np.abs(along).max() > CLOSE * np.abs(pushed).max(initial=0.0) else np.zeros_like(p)

    def _closes(self, p: Array) -> list[Bools]:
        return [self.closing(place, p) for place in self.problem.cone.with_friction()]

    def holding(self, p: Array, w: Array, gap: Array) -> Array:
        """What of tractions p (rows,) [Pa] holds back points that close, with what it changes at others."""
        closes = self._closes(p)
        free = self._free(p, w, gap, closes) if any(which.any() for which in closes) else None
        return np.where(self._rows(closes), p, 0.0) if free is None else p - free[0]

    def _rows(self, closes: list[Bools]) -> Bools:
        """Rows (rows,) of the points that close, by contact with friction."""
        rows = np.zeros(len(self.p), bool)
        for place, which in zip(self.problem.cone.with_friction(), closes, strict=True):
            n = place.normal
            rows[n] = (place.average.T @ which.astype(float) > 0) & (self.p[n] == 0)
            rows[place.tangential] = np.repeat(which, place.components)
        return rows

    def _free(self, p: Array, w: Array, gap: Array, closes: list[Bools]) -> tuple[Array, Array] | None:
        """What would be without points that close, if all others did what they do at the end and held floating bodies.

        Returns:
            Tractions (rows,) [Pa] and relative displacement (rows,) [m]; None: nothing else holds them, none float, or
            the form of the bodies is iterative.
        """
        surface, load = self.problem.surface, self.problem.load
        bodies = surface.R.shape[1] - surface.driven
        if not bodies or not isinstance(surface, CondensedSurface):
            return None
        f_c = load.f_c + self.added
        load = replace(load, f_c=f_c, resultant=surface.R.T @ f_c)
        problem = replace(self.problem, gap=gap, load=load)
        laws = linearise(problem, p + problem.gamma * (w - gap), problem.gamma).without(self._rows(closes))
        u = surface.flexibility @ (f_c - surface.forces(p))
        moved = problem.relative_displacement(u)
        at = u + surface.R @ np.linalg.lstsq(surface.N @ surface.R, w - moved, rcond=None)[0]
        if condensed_system.unfelt(laws, surface, bodies).any():
            return None
        stays = np.diag(np.where(np.arange(surface.R.shape[1]) < bodies, 0.0, surface.rho / ROUNDING))  # obstacles
        try:
            found, u = condensed_system.by_tractions(laws, surface, stays, at)
            carried = surface.R.T @ surface.forces(found)
            load = replace(load, resultant=np.append(load.resultant[:bodies], carried[bodies:]))
            replace(laws, problem=replace(problem, load=load)).refuse_unbalanced(found)
        except np.linalg.LinAlgError:
            return None
        return found, problem.relative_displacement(u)

    def _freed(self, p: Array, closes: list[Bools]) -> Array:
        """Relative displacement (rows,) [m] that the tractions of points that close have taken; collective.

        Obstacles stay where they are at the end, floating bodies where points were closed before, which take up the
        forces, so that the way has an energy; or they give way across the surface as points of their softness do.

        Args:
            p: tractions (rows,) [Pa] at the end.
            closes: by contact with friction, points that close.
        """
        problem, surface, acting = self.problem, self.problem.surface, np.where(self._rows(closes), p, 0.0)
        forces, closed, wanted = surface.forces(acting) + self.added, self.p != 0, np.zeros_like(p)
        bodies = self._motions[:, : surface.R.shape[1] - surface.driven]
        if surface.floating and closed.any():  # these take up the forces, as rigid bodies would share them out
            left = (surface.R.T @ forces)[: bodies.shape[1]]
            forces = forces - surface.N[closed].T @ np.linalg.lstsq(bodies[closed].T, left, rcond=None)[0]
        u = surface.displacement(forces, self.tolerance * problem.u_ref)
        freed = surface.N @ (u - surface.R @ (surface.R.T @ u))
        if surface.floating:
            if not closed.any():
                closed = (acting != 0) & (np.arange(len(p)) < surface.normal_rows)
                wanted = wanted + (p / problem.gamma)[closed].mean()
            freed = freed + bodies @ np.linalg.lstsq(bodies[closed], (wanted - freed)[closed], rcond=None)[0]
        return np.asarray(freed)

    def felt(self, change: Array, p: Array, w: Array, gap: Array) -> Array:
        """The part (rows,) [m] of a change (rows,) [m] of gaps that friction feels.

        It is what the change does to the tractions that project the trial ones onto the bound, over gamma: all of it
        where a point sticks, none where one slips on.

        Args:
            p, w: tractions (rows,) [Pa] and relative displacement (rows,) [m] of a solution; the bound is theirs.
            gap: what it was found with (rows,) [m].
        """
        problem, felt = self.problem, change.copy()
        trial, moved = p + problem.gamma * (w - gap - problem.cone.give(p)), problem.gamma * change
        for place in problem.cone.with_friction():
            t, bound, law = place.tangential, problem.cone.bound(place, p[place.normal]), place.rows.friction
            if place.rows.wears or (law and (law.remembers or law.drags)):  # the length of the slip counts, too
                whole = 2 * np.repeat(bound, place.components) / problem.gamma[t]
                felt[t] = np.clip(change[t], -whole, whole)
                continue
            before, after = (
                project_disc(x[t].reshape(-1, place.components), bound).ravel() for x in (trial, trial - moved)
            )
            felt[t] = (before - after) / problem.gamma[t]
        return felt

    def _left(self, p: Array, change: Array) -> float:
        """Energy norm [J^(1/2)] of what a further change (rows,) [m] of slip from touch would add; collective.

        Tractions q of the rows that touch move the bodies by it, F q = c; conjugate gradients find the energy q . c
        from below.
        """
        surface, held, energy = self.problem.surface, ((p != 0) | (change != 0)) * self.problem.gamma, 0.0
        r, d = change, held * change
        size = first = float((surface.W * d) @ change)
        with surface.counters.for_error():
            for _ in range(SOLVES if size else 0):
                u = surface.displacement(surface.forces(d), SLIGHT * float(np.abs(change).max()))
                answer = surface.N @ (u - surface.R @ (surface.R.T @ u))
                if (given := float((surface.W * d) @ answer)) <= 0 or size <= CONTRACTION**2 * first:
                    break
                energy, r = energy + size**2 / given, r - size / given * answer
                size, last = float((surface.W * held) @ r**2), size
                d = held * r + size / last * d
        return UNSURE * float(np.sqrt(energy))


def _larger(known: Correction, further: float) -> Correction:
    return replace(known, size=known.size + further)


@dataclass
class Touch:
    """Where points touch, found again from each iterate until the places stay, or go to and fro; collective.

    What friction does not feel stays; what goes to and fro goes half the way. While the same points are closed the gap
    is extrapolated through those before, as many as there are rows that change, on the way through the last two.

    Source: Anderson, J. ACM 12 (1965).
    """

    way: Way
    on_the_way: bool = False  # whether it is asked of iterates that are no solutions yet
    halved: float = np.inf  # size [m] of the last change that was halved
    sizes: list[float] = field(default_factory=list)  # of changes since then [m]
    tried: dict[bytes, list[tuple[Array, Array]]] = field(default_factory=dict)  # gaps, changes
    felt: Array | None = None  # what is felt (rows,) [m] of the last change; None: not yet
    idle: Array | None = None  # gap (rows,) [m] before, with the changes that friction does not feel; None: not yet

    def __call__(self, p: Array, w: Array, before: Array) -> Array:
        """Gap (rows,) [m] with slip counted from touch; that of before if it stays.

        Args:
            p: tractions (rows,) [Pa] of an iterate.
            w: its relative displacement (rows,) [m].
            before: gap (rows,) [m] that it was found with.
        """
        problem, gap = self.way.problem, self.way.touched(p, w, before)
        change, settled = gap - before, max(self.way.tolerance, EXACT) * problem.u_ref
        allowed = np.maximum(settled, problem.scales.no_motion(self.way.w))
        self.felt = change if self.on_the_way else self.way.felt(change, p, w, before)
        heard = np.abs(self.felt) > allowed
        for place in problem.cone.with_friction():  # a slip that turns is felt in all directions
            t = place.tangential
            heard[t] = np.repeat(heard[t].reshape(-1, place.components).any(axis=1), place.components)
        self.idle = np.where(heard | (np.abs(change) <= allowed), before, gap)
        if not heard.any():
            return before
        gap, change = np.where(heard, gap, before), np.where(heard, change, 0.0)
        if not np.any(before != problem.gap):  # slip has counted from the beginning
            return gap
        which = (p[: problem.surface.normal_rows] > 0).tobytes()
        known = [*self.tried.get(which, []), (gap, change)]
        # on the way the iterate moves too; later as many tell of touch as rows change: before them friction was other
        del known[: -2 if self.on_the_way else -1 - int(heard.sum())]
        gaps, changes = (np.array(each) for each in zip(*known, strict=True))
        sizes = np.abs(changes).max(axis=1)
        self.tried, self.sizes = self.tried | {which: known}, [*self.sizes, float(sizes[-1])]  # copies keep their own
        if self.on_the_way:
            falls = len(known) == 1 or sizes[-1] <= sizes[-2] / 2
        else:
            falls = len(self.sizes) < 3 or sizes[-1] < self.sizes[-3]
        if not falls:  # to and fro
            if self.on_the_way or sizes[-1] >= self.halved:
                return before
            self.halved, self.sizes = float(sizes[-1]), []
            return np.asarray(before + change / 2)
        turns = np.linalg.lstsq(np.diff(changes, axis=0).T, change, rcond=None)[0]  # Anderson's acceleration
        return np.asarray(gap - turns @ np.diff(gaps, axis=0))
