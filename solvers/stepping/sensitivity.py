"""Derivatives of a history by numbers of its scene: neighbours of the history, each with one number a little different.

With a number of the scene changed, an equilibrium moves to x + dx with F(x + dx) = 0, F the residual of the changed
scene: nothing is formulated by hand, for contact rows, laws, loads and stiffness are those of that scene, assembled on
the same cells. F is solved by the chord method with the laws linearised at the solution, once for all neighbours, and
the bodies as they are prepared; inner forces K u of the changed bodies are taken at the solution's u, which leaves an
error of second order, alike for a larger and a smaller number: it cancels in their difference. Each neighbour starts a
substep from its own state, so histories are chained through slip and friction's memory.

Where a neighbour's points stick, slip or open otherwise than those of the solution, its laws are linearised anew until
they settle: that is the linearised complementarity problem of all points at their bound together. The derivative by a
larger number is then another one than that by a smaller one.

Source: Kikuchi & Oden, Contact Problems in Elasticity (1988), of directional derivatives; Mignot, J. Funct. Anal. 22
(1976); of the step Press et al., Numerical Recipes (2007), section 5.7.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy import sparse
from scipy.linalg.lapack import dgetrf, dgetrs

from stickslip.geometry.arrays import EPS, EXACT, SLIGHT, Array
from stickslip.geometry.errors import SceneError, SolverError, StickslipError
from stickslip.geometry.protocols import Vec
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.newton import condensed_system
from stickslip.solvers.newton.active_set import ActiveSet, linearise, sets
from stickslip.solvers.stepping.choice import Choice, Stage, fits
from stickslip.solvers.stepping.law_memory import LawMemory, with_memory
from stickslip.solvers.stepping.method_chain import MethodChain, Reached
from stickslip.solvers.stepping.pairs import SEARCHES, carried_over, relative_positions
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.substep import Attempt, SubstepSolver
from stickslip.solvers.stepping.touch import Way
from stickslip.solvers.stepping.update import at_rest, displacement, new_state
from stickslip.solvers.system.system import System

log = logging.getLogger(__name__)
T = TypeVar("T")
NO_MEMORY = "the bodies are factorised for it, for which there is not enough memory"
STEP = EPS ** (1 / 3)  # change of a number, relative: what differences leave and what rounding leaves are then alike
MAX_IT = 100  # of the chord method; one that moves where points touch, or what friction remembers, takes a dozen


class Tangent:
    """The contact laws linearised at a solution, with the condensed bodies: one factor for all neighbours.

    Unknowns are the tractions of the rows whose law involves a motion, and the rigid motions b of floating bodies.
    """

    def __init__(self, laws: ActiveSet, surface: CondensedSurface) -> None:
        """Factorise the laws at a solution."""
        self.laws, self.surface = laws, surface
        rows, x = len(laws.rhs), np.flatnonzero(~laws.given)
        eye, W = sparse.eye(rows, format="csr"), sparse.diags(surface.W)
        self._x, self._follow = x, sparse.diags(laws.given.astype(float)) @ (eye - laws.A_p)
        self._E = (self._follow + eye)[:, x]
        self._A_p, self._A_w, R = laws.A_p[x], laws.A_w[x], surface.R
        held = (self._A_p @ self._E).toarray() - surface.coupling(self._A_w, W @ self._E)
        moved, balance = self._A_w @ (surface.N @ R), R.T @ (surface.N.T @ (W @ self._E))
        unfelt = condensed_system.unfelt(laws, surface)
        matrix, self._of, self._by = condensed_system.balanced(held, moved, balance, surface.rho * unfelt)
        self._factor: Array = matrix
        self._pivots: Array = np.zeros(0)
        singular = 0
        if len(matrix):
            self._factor, self._pivots, singular = dgetrf(matrix)
        if singular:
            raise np.linalg.LinAlgError("the linearised laws are singular")

    def __call__(self, left: Array, unbalanced: Array) -> tuple[Array, Array]:
        """Changes of tractions (rows,) [Pa] and of b (r,) [m].

        Args:
            left: residual of the laws (rows,) [Pa].
            unbalanced: forces on the rigid motions (r,) [N].
        """
        surface, given = self.surface, np.where(self.laws.given, left, 0.0)
        given = given + self._follow @ given
        forces = surface.forces(given)
        moved = self._A_w @ (surface.N @ (surface.flexibility @ forces))
        right = [left[self._x] - self._A_p @ given + moved, self._by * (unbalanced - surface.R.T @ forces)]
        found = np.concatenate(right)
        if len(found):
            found = dgetrs(self._factor, self._pivots, found)[0]
        return given + self._E @ found[: len(self._x)], self._of * found[len(self._x) :]


@dataclass(frozen=True)
class Near:
    """The equilibrium of a neighbour at the end of a substep."""

    posed: Posed
    problem: SurfaceProblem  # with gap and laws as they are at the end
    p: Array  # (rows,) [Pa]
    u_c: Array  # (c,) [m]
    smooth: bool  # whether its points do what those of the solution do

    def below(self) -> tuple[Vec, Array]:
        """Forces and motion of the contact dofs, from which the free displacements follow."""
        return self.problem.load.f_q, self.u_c[: len(self.u_c) - self.posed.surface.driven]

    def half_way(self, other: Near) -> tuple[Vec, Array]:
        """Half of their way to those of another one."""
        (force, moved), (its_force, its_moved) = self.below(), other.below()
        return (its_force - force) * 0.5, (its_moved - moved) / 2

    def state(self, q: Vec) -> State:
        """The state, of free displacements q [m]."""
        posed, time = self.posed, self.problem.cone.time
        u, u_strained = displacement(posed.solver.system, time, q, posed.prescribed)
        return new_state(
            system=posed.solver.system,
            old=posed.old,
            problem=self.problem,
            u=u,
            u_strained=u_strained,
            u_s=posed.prescribed,
            load=posed.load,
            p=self.p,
            driven=self.u_c[len(self.u_c) - posed.surface.driven :],
            initial=posed.initial,
        )


@dataclass(frozen=True)
class Posed:
    """The problem of a neighbour in a substep."""

    solver: SubstepSolver
    old: State  # at its beginning
    way: Way  # of points that close in it
    prescribed: Vec  # u_s over all displacements [m]
    load: Vec  # external forces [N]
    initial: Array  # (k,) values of the initial strains

    @classmethod
    def of(cls, solver: SubstepSolver, old: State, shortened: Array | None, time: float) -> Posed:
        """From a state to a time [s], with shortenings (b,) [m] of bolts that are tightened by force; collective."""
        system = solver.system
        if shortened is not None:
            each = zip(system.initial.tightened, shortened.tolist(), strict=True)
            system.course.found = {bolt.shortening: ((time, x),) for bolt, x in each}
        problem, u_s, load = solver.posed(old, time)
        initial = system.initial.values(system.course, time)
        return cls(solver, old, Way(problem, old.p, old.w, 0.0), u_s, load, initial)

    @property
    def surface(self) -> CondensedSurface:
        """The condensed bodies, those of the solution."""
        assert isinstance(self.way.problem.surface, CondensedSurface)
        return self.way.problem.surface

    def softer(self, lacking: tuple[Vec, Array], held: Array | float) -> Posed:
        """The problem of bodies that have not all of the inner forces of those of the solution.

        Args:
            lacking: these forces [N], over the free dofs and condensed (c,).
            held: those of the displacement from which points that close are held back, condensed (c,) [N].
        """
        problem = self.way.problem
        load = self.surface.with_condensed(problem.load, *lacking)
        return replace(self, way=replace(self.way, problem=replace(problem, load=load), added=held))


class Neighbours:
    """The solution of each substep once more, to rounding, and its neighbours with one number smaller and larger."""

    def __init__(
        self,
        stepper: SubstepSolver,
        base: SubstepSolver,
        pairs: Mapping[str, tuple[SubstepSolver, SubstepSolver]],
        sizes: Mapping[str, float],
    ) -> None:
        """Take over the neighbours' solvers.

        Args:
            stepper: that solves the history.
            base: the same with condensed bodies, see `condensed`.
            pairs: by number of the scene, see `beside`, with a smaller and with a larger value.
            sizes: how much smaller and larger these are, relative to the number.
        """
        self.sizes, self.stepper, self.base = sizes, stepper, base
        self.solvers = (base, *(each for pair in pairs.values() for each in pair))
        self.present = self.solvers  # with the pairs of the last substep

    def start(self) -> tuple[State, ...]:
        """The neighbours of the state at rest; collective."""
        return tuple(at_rest(solver.system, solver.cone) for solver in self.solvers)

    def __call__(self, attempt: Attempt) -> Attempt:
        """An accepted substep with the neighbours of its state; collective."""
        counters = self.base.system.counters
        assert attempt.state is not None
        if not attempt.begin.neighbours:
            return attempt
        try:
            with counters.clock.part("sensitivity"), counters.for_error():
                self._follow()
                sliding = [name for name, pair in self.base.system.problem.pairs.items() if pair.contact.sliding]
                self.present, found = self._slid(attempt, sliding) if sliding else (self.solvers, None)
                found = found or _found(self.solvers, attempt)
        except (StickslipError, np.linalg.LinAlgError) as error:  # the step is solved all the same
            log.warning("t = %g: derivatives are not known from here on: %s", attempt.state.time, error)
            found = ()
        return replace(attempt, state=replace(attempt.state, neighbours=found))

    def _slid(self, attempt: Attempt, names: Sequence[str]) -> tuple[tuple[SubstepSolver, ...], tuple[State, ...]]:
        """Solvers with the pairs of where each neighbour ends, and the neighbours; collective.

        Where points have moved, but not slid, the solution has kept its pairs, and so do its neighbours.

        Args:
            names: of sliding contacts.
        """
        solver, new, problem = _of_bodies(self.base, attempt.solver.system), attempt.state, attempt.problem
        assert new is not None
        assert problem is not None
        reached = relative_positions(solver.system, new, names)
        follow = [x for x, at in reached.items() if np.abs(at - new.searched[x]).max() <= SLIGHT * np.abs(at).max()]
        places = [{**new.searched, **{name: reached[name] for name in follow}}] * len(self.solvers)
        for _ in range(SEARCHES):
            present = tuple(
                beside(solver, each.system.searched(at)) for each, at in zip(self.solvers, places, strict=True)
            )
            begun = zip(attempt.begin.neighbours, present, places, strict=True)
            olds = tuple(replace(carried_over(old, each.system), searched=at) for old, each, at in begun)
            begin = replace(attempt.begin, neighbours=olds)
            found = _found(present, replace(attempt, begin=begin))
            ended = [relative_positions(p.system, state, follow) for p, state in zip(present, found, strict=True)]
            pairs = zip(ended, places, strict=True)
            far = max((float(np.abs(now[name] - at[name]).max()) for now, at in pairs for name in follow), default=0.0)
            if far <= SLIGHT * STEP**1.5 * problem.u_ref:  # of what a change of the number moves
                return present, found
            places = [{**at, **now} for at, now in zip(places, ended, strict=True)]
        raise SolverError("pairs do not settle")

    def _follow(self) -> None:
        """Take over bodies that another method has prepared anew; collective.

        Raises:
            SolverError: see `condensed`.
        """
        if isinstance(self.stepper.surface, CondensedSurface) or not isinstance(self.base.surface, CondensedSurface):
            self.base = condensed(self.stepper)
        if any(solver.volume is not self.base.volume for solver in self.solvers):
            self.solvers = (self.base, *(beside(self.base, solver.system) for solver in self.solvers[1:]))


def condensed(stepper: SubstepSolver) -> SubstepSolver:
    """A solver of the same scene with condensed bodies: where they have another form they are factorised; collective.

    Raises:
        SolverError: memory does not suffice for that.
    """
    system = stepper.system
    if isinstance(stepper.surface, CondensedSurface):
        return stepper
    if not fits(system, "condensed"):
        raise SolverError(NO_MEMORY)
    with system.counters.for_error():
        chosen = Choice((Stage("condensed-newton", "condensed"),), "derivatives")
        return SubstepSolver(system, MethodChain(system, Reached(chosen, 0, ())))


def beside(base: SubstepSolver, system: System) -> SubstepSolver:
    """A solver of a changed scene; the bodies stay those of the solution.

    Raises:
        SceneError: it has other contact rows.
    """
    found = _of_bodies(base, system)
    rows, own = ([len(rows.gap) for rows in solver.cone.contacts] for solver in (found, base))
    if rows != own:
        raise SceneError("another value gives a contact other points")
    return found


def _of_bodies(base: SubstepSolver, system: System) -> SubstepSolver:
    """A solver of a system with the bodies of another."""
    found = SubstepSolver(system, base.chain)
    found.surface.adopt(base.surface)
    found.surface.R = base.surface.R  # whose stiffness resists none of these motions
    return found


def _found(solvers: Sequence[SubstepSolver], attempt: Attempt) -> tuple[State, ...]:
    """The states of the neighbours, whose bolts have the tensions that they are given; collective."""
    if not solvers[0].system.initial.tightened:
        return _solved(solvers, attempt, attempt.begin.neighbours)
    assert attempt.state is not None
    assert attempt.problem is not None
    course, before = solvers[0].system.course, solvers[0].system.course.found
    try:
        return _tightened(solvers, attempt, attempt.state, STEP * attempt.problem.u_ref)
    finally:
        course.found = before


def _tightened(solvers: Sequence[SubstepSolver], attempt: Attempt, new: State, by: float) -> tuple[State, ...]:
    """The same with bolts that are tightened by force: their shortenings follow from how tensions answer to them.

    Args:
        new: the solution.
        by: change of a shortening [m] that this is found by.

    Raises:
        SolverError: the step is cut, so that no tension is given at its end.
    """
    (base, *_), olds = solvers, attempt.begin.neighbours
    bolts = base.system.initial.tightened
    places = [bolt.index for bolt in bolts]
    if any(values[-1][0] > new.time for values in base.system.course.found.values()):  # type: ignore[index]
        raise SolverError("a step with bolts that are tightened by force is cut")
    free = np.array([attempt.begin.time < bolt.held_from * (1 - EXACT) for bolt in bolts])

    def solve(those: Sequence[SubstepSolver], begun: Sequence[State], x: Array) -> tuple[tuple[State, ...], Array]:
        """The states with shortenings x (n, b) [m], and their tensions (n, b) [N]."""
        found = _solved(those, attempt, begun, x)
        return found, np.array([-state.initial_work[places] for state in found])

    def given(system: System) -> list[float]:
        return [
            0.0 if b.tension is None else system.course.value(b.tension, new.time) for b in system.initial.tightened
        ]

    x = np.array([np.where(free, new.initial[places], old.initial[places]) for old in olds])
    steps = by * np.kron(np.eye(len(bolts)), [[-1.0], [1.0]])
    _, answers = solve([base] * (1 + len(steps)), [olds[0]] * (1 + len(steps)), x[0] + np.vstack([0 * x[0], steps]))
    J = ((answers[2::2] - answers[1::2]) / (2 * by)).T
    _, tensions = solve(solvers, olds, x)
    off = (np.array([given(solver.system) for solver in solvers]) - tensions)[:, free]
    x[:, free] += np.linalg.solve(J[np.ix_(free, free)], off.T).T
    return solve(solvers, olds, x)[0]


def _solved(
    solvers: Sequence[SubstepSolver], attempt: Attempt, olds: Sequence[State], shortened: Array | None = None
) -> tuple[State, ...]:
    """The states of the neighbours; collective.

    Args:
        olds: their states at the beginning.
        shortened: shortenings (n, b) [m] of their bolts that are tightened by force; None: there are none.
    """
    new, problem, (base, *_) = attempt.state, attempt.problem, solvers
    assert new is not None
    assert problem is not None
    p = attempt.solution.p
    assert isinstance(base.surface, CondensedSurface)
    tangent = Tangent(linearise(problem, p + problem.gamma * (new.w - problem.gap), problem.gamma), base.surface)
    solution = _Solution(p, base.at_contact(new), base.system.free_part(new.u, new.time), tangent)
    lengths = [None] * len(solvers) if shortened is None else [*shortened]
    posed = [Posed.of(*each, new.time) for each in zip(solvers, olds, lengths, strict=True)]
    own, *nears = [solution.near(each) for each in solution.softened(posed)]
    if np.abs(own.p - p).max(initial=0.0) > SLIGHT * problem.scales.of_tractions(p):
        log.warning("t = %g: derivatives are those of another solution", new.time)
    smooth = [below.smooth and above.smooth for below, above in _pairs(nears)]
    asked = [own.below()]
    for once, (below, above) in zip(smooth, _pairs(nears), strict=True):
        asked += [below.half_way(above)] if once else [below.below(), above.below()]
    middle, *ways = own.posed.surface.volume.expanded(asked)
    found, left = [middle], iter(ways)
    for once in smooth:
        way = next(left)
        found += [middle - way, middle + way] if once else [way, next(left)]
    return tuple(near.state(q) for near, q in zip((own, *nears), found, strict=True))


def _pairs(items: Sequence[T]) -> Iterator[tuple[T, T]]:
    return zip(items[::2], items[1::2], strict=True)


@dataclass(frozen=True)
class _Solution:
    """The solution of a substep, from which its neighbours are found."""

    p: Array  # tractions (rows,) [Pa]
    u_c: Array  # displacement of the contact dofs (c,) [m]
    q: Vec  # free displacements [m]
    tangent: Tangent

    def softened(self, posed: Sequence[Posed]) -> list[Posed]:
        """The neighbours, of changed bodies with the inner forces that these have at the solution; collective.

        They are taken as half of the difference of both neighbours, and so in the middle of both.
        """
        (own, *others), volume = posed, posed[0].surface.volume
        changed = [
            k for k in range(0, len(others), 2) if others[k].solver.system.assembled is not own.solver.system.assembled
        ]
        if not changed:
            return [*posed]
        closing = own.way.any
        moved = [self.q]
        if closing:
            solved = self.tangent.laws.problem
            holding = own.way.holding(self.p, solved.relative_displacement(self.u_c), solved.gap)
            u_c = own.surface.flexibility @ own.surface.forces(holding)
            moved += volume.expanded([(self.q * 0.0, u_c[: len(u_c) - own.surface.driven])])
        stiffness = {k: [each.solver.system.assembled().product for each in others[k : k + 2]] for k in changed}
        lacking = [(below * q - above * q) * 0.5 for below, above in stiffness.values() for q in moved]
        condensed = volume.condensed(lacking)
        for at, k in enumerate(changed):
            force, f_c, *held = lacking[at * len(moved)], *condensed[at * len(moved) : (at + 1) * len(moved)]
            for sign, one in ((-1.0, k), (1.0, k + 1)):
                driven = np.zeros(own.surface.driven)
                back = sign * np.concatenate([held[0], driven]) if held else 0.0
                others[one] = others[one].softer((force * sign, sign * f_c), back)
        return [own, *others]

    def near(self, posed: Posed) -> Near:
        """The equilibrium of one neighbour; collective."""
        old, time = posed.old, posed.way.problem.cone.time
        memory = LawMemory(posed.solver.cone.at(time), old.memory, time - old.time)
        return Near(posed, *self._equilibrium(posed.way, memory))

    def _equilibrium(self, way: Way, memory: LawMemory) -> tuple[SurfaceProblem, Array, Array, bool]:
        """The problem with laws as they are then, tractions (rows,) [Pa], displacement (c,) [m], see `Near.smooth`."""
        found = None if memory.start else self._by_tangent(way)
        return (*found, True) if found else (*self._by_turns(way, memory), False)

    def _by_tangent(self, way: Way) -> tuple[SurfaceProblem, Array, Array] | None:
        """The same, where the sets are those of the solution; None: they are not.

        What is left after one solution is of second order. Places of touch are found by turns: laws depend on w - gap.
        """
        problem, p, u_c, R = way.problem, self.p, self.u_c, way.problem.surface.R
        gamma, w, b = problem.gamma, problem.relative_displacement(u_c), R.T @ u_c
        if way.any:
            problem = replace(problem, gap=way.touched(p, w, problem.gap))
        laws = linearise(problem, p + gamma * (w - problem.gap), gamma)
        begun = problem.gap
        for _ in range(MAX_IT):
            under = problem.relative_displacement(self._displacement(problem, p, b))  # of these tractions
            left = laws.rhs + laws.A_w @ (problem.gap - begun) - laws.A_p @ p - laws.A_w @ under
            more, moved = self.tangent(left, problem.load.resultant - R.T @ problem.surface.forces(p))
            p, b = p + more, b + moved
            u_c = self._displacement(problem, p, b)
            w = problem.relative_displacement(u_c)
            if not way.any:
                break
            before, problem = problem.gap, replace(problem, gap=way.touched(p, w, problem.gap))
            if np.abs(problem.gap - before).max() <= EXACT * np.abs(problem.gap - way.problem.gap).max():
                break
        found, projected = sets(problem, p + gamma * (w - problem.gap), gamma)
        # of what a change of the sets leaves, as slip that turns back; all else is of second order
        slight = STEP**1.5 * problem.scales.of_tractions(p)
        same = (found == self.tangent.laws.sets).all() and np.abs(projected - p).max(initial=0.0) <= slight
        return (problem, p, u_c) if same else None

    def _by_turns(self, way: Way, memory: LawMemory) -> tuple[SurfaceProblem, Array, Array]:
        """The same by Newton's method, with laws and places of touch of each iterate."""
        problem, p, u_c = way.problem, self.p, self.u_c
        gamma, scale, size = problem.gamma, problem.scales.of_tractions(p), np.inf
        for _ in range(MAX_IT):
            w = problem.relative_displacement(u_c)
            if way.any:
                problem = replace(problem, gap=way.touched(p, w, problem.gap))
            if memory.start:
                known = memory.after(problem, p, w)
                problem = replace(problem, cone=with_memory(memory.cone, known, memory.step, memory.start))
            laws = linearise(problem, p + gamma * (w - problem.gap), gamma)
            if size <= EXACT * scale:
                break
            before, (p, u_c) = p, condensed_system.solve(laws, u_c)
            size = float(np.abs(p - before).max(initial=0.0))
        else:
            log.warning("t = %g: a derivative is not found to rounding", problem.cone.time)
        return problem, p, u_c

    @staticmethod
    def _displacement(problem: SurfaceProblem, p: Array, b: Array) -> Array:
        """Displacement of the contact dofs (c,) [m] under tractions p (rows,) [Pa], with rigid motions b (r,) [m]."""
        surface = problem.surface
        assert isinstance(surface, CondensedSurface)
        return np.asarray(surface.flexibility @ (problem.load.f_c - surface.forces(p)) + surface.R @ b)


def refuse(base: SubstepSolver) -> None:
    """Refuse what has no derivative that is built, with the reason."""
    system, why = base.system, ""
    if not base.chain.exact_laws:
        why = 'needs a method with the contact laws as they are; set solver.method = "auto"'
    elif any(pair.skins for pair in system.problem.pairs.values()):
        why = "is not built for bodies that may come near all over, whose pairs are searched anew"
    if why:
        raise SceneError(f"sensitivity: {why}")
