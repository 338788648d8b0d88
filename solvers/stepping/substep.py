"""One substep: its surface problem is posed, and solved by the method in use; loops around it do all else.

A step is loops around one call: `step = reduce(lambda inner, loop: loop.around(inner), loops, solve)`. From the inside
out these are the methods, one after the other; pairs of sliding contacts; halving; bolts and springs.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from stickslip.geometry.arrays import SLIGHT, Array
from stickslip.geometry.errors import SolverError
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.protocols import Vec
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.limit_analysis import unbalanced_motion
from stickslip.solvers.interface.prepare import elastic_stiffness, prepare_surface
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import OnStep, Solution, Status, Step
from stickslip.solvers.newton.correction import by_schur_complement
from stickslip.solvers.newton.path import applies, continued
from stickslip.solvers.newton.semismooth import branches
from stickslip.solvers.newton.uniqueness import critical
from stickslip.solvers.parallel.replicated import sum_of_sizes
from stickslip.solvers.stepping.choice import Stage
from stickslip.solvers.stepping.law_memory import LawMemory, Memory, Solving, with_memory
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.state import Previous, State
from stickslip.solvers.stepping.touch import Touch, Way
from stickslip.solvers.stepping.update import displacement, new_state, relative_displacement, split
from stickslip.solvers.system.system import System

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One try to get from a state to a later time, in one substep or in several."""

    solver: SubstepSolver  # with the pairs that it was tried with
    begin: State  # that its last substep begins with
    solution: Solution  # of its last substep; `others` and `weakening` are of all
    problem: SurfaceProblem | None = None  # of its last substep; None: it could not be posed
    state: State | None = None  # at its end; None: it was not solved
    linear_error: float = 0.0  # of its last substep [-], see `DelassusOperator`
    unsettled: float = 0.0  # energy norm [J^(1/2)] of what a further search of sliding pairs would change
    substeps: int = 1
    rows: int = 0  # iterations in the history of the step so far
    volume_solves: int = 0  # of the run so far
    good: Attempt | None = None  # of one that is given up: the way up to its last good substep
    why: str = ""  # it is given up, in one line
    when: float = 0.0  # end of the substep that `why` tells of [s]

    @property
    def impossible(self) -> bool:
        """Whether it is shown that nothing balances the loads."""
        return self.solution.status is Status.NO_EQUILIBRIUM

    @property
    def collapses(self) -> bool:
        """Whether that is shown, or a motion was found that grows without end."""
        return self.solution.status in (Status.NO_EQUILIBRIUM, Status.GIVES_WAY)


Substep = Callable[[State, float], Attempt]  # from a state to a time [s]; what is not solved is returned, not raised


class Loop(Protocol):
    """Loop around substeps."""

    def active(self) -> bool:
        """Whether there is anything to do for it."""

    def around(self, inner: Substep) -> Substep:
        """A substep that calls the inner one."""


class Methods:
    """Solves a substep by one method of the chain after the other."""

    def __init__(self, chain: MethodChain) -> None:
        self._chain = chain

    def active(self) -> bool:
        """Always."""
        return True

    def around(self, inner: Substep) -> Substep:
        def tried(state: State, end: float) -> Attempt:
            chain = self._chain
            while True:
                attempt = inner(state, end)
                cut = chain.cut_first and chain.stage.surface == "condensed"
                if attempt.state is not None or attempt.collapses or cut:
                    return attempt
                if not chain.advance(attempt.solver.system, end, attempt.solution):
                    return attempt

        return tried


class AtOnce(Protocol):
    """Another way to solve a posed problem, with more unknowns at once; see `tightening`."""

    def at_once(
        self, solver: SubstepSolver, problem: SurfaceProblem, state: State, p: Array, on_step: OnStep
    ) -> tuple[Solution | None, SurfaceProblem]:
        """The solution, None: not this way; and the problem with what was found; collective."""


class Companion(Protocol):
    """Follows a history with other displacements, step by step."""

    nodes: Nodes  # of the displacements that `State.surplus` holds

    def vector(self) -> Vec:
        """No displacement of these nodes."""

    def __call__(self, stepper: SubstepSolver, old: State, new: State, problem: SurfaceProblem) -> State | None:
        """Find the new `State.refined` after a substep from `old` to `new`; None: it was not found; collective.

        Args:
            stepper: with the contact rows of the substep.
            problem: that was solved.
        """


class SubstepSolver:
    """Bodies that are prepared once, with the contact rows of some pairs: it solves one substep."""

    def __init__(self, system: System, chain: MethodChain) -> None:
        """Prepare the surface; the method is prepared when it is needed; collective.

        Args:
            system: the bodies, and the contact rows of the pairs.
            chain: shared by all solvers of the same bodies with other pairs.
        """
        self.system, self.chain = system, chain
        self.cone = AdmissibleSet(system.contacts, 0.0, system.problem.timeline.end)
        self.gamma, self.weight = elastic_stiffness(system)
        self.bolts: AtOnce | None = None
        self.companion: Companion | None = None  # follows each substep, see `State.refined`
        self.latest: tuple[Mapping[str, Array], SubstepSolver] | None = None  # with other pairs, and where these lie
        self.volume, self.surface = chain.volume, prepare_surface(system, chain.volume)
        self.stage: Stage | None = None  # that `method_after` is of; None: of none yet

    def follow_bodies(self) -> None:
        """Take over the bodies of `chain`; the surface stays if their form does; collective."""
        if self.volume is not self.chain.volume:
            self.volume, self.surface = self.chain.volume, prepare_surface(self.system, self.chain.volume)

    def widen(self, system: System) -> None:
        """Let those nodes enter that are near in a system of the same bodies with other pairs; collective."""
        pairs = [*zip(self.system.contacts, system.contacts, strict=True)]
        if all(c.near is None or other.near is None or (c.near == other.near).all() for c, other in pairs):
            return
        self.system = replace(self.system, contacts=tuple(replace(c, near=other.near) for c, other in pairs))
        self.cone = AdmissibleSet(self.system.contacts, 0.0, self.cone.end)
        self.chain.widen(self.system)
        self.follow_bodies()
        self.stage = None

    def follow(self) -> None:
        """Take over the stage of `chain`, or the next that can be prepared; SolverError: there is none; collective."""
        self.follow_bodies()
        try:
            self.method_after = self.chain.method(self.system, self.surface)
            self.stage = self.chain.stage
        except SolverError as error:
            if not self.chain.leave(self.system, str(error)):
                raise
            self.follow()

    def solve(self, state: State, end: float) -> Attempt:
        """One substep by the method in use; a failure of linear algebra ends as `Status.BROKEN`; collective."""
        rows, problem = list[Step](), None
        on_step = self.chain.history.attempt(end, lambda: self.chain.stage.method, rows)
        tried = Attempt(solver=self, begin=state, solution=unsolved(state, self.surface.size, Status.BROKEN, rows))
        try:
            if self.stage is not self.chain.stage:
                self.follow()
            problem, u_s, load = self.posed(state, end)
            # no load: no traction
            start = self._first_tractions(state, end) if problem.p_ref > 0 else np.zeros_like(state.p)
            if self.surface.floating and (mechanism := unbalanced_motion(problem)) is not None:
                nothing = replace(tried.solution, p=start, status=Status.NO_EQUILIBRIUM)
                nothing = replace(nothing, u_c=mechanism.motion, lacking=mechanism.lacking)
                return replace(tried, solution=nothing, problem=problem)
            solution, problem = self._solved(problem, state, start, on_step)
            tried = replace(tried, solution=solution, problem=problem)
            if solution.status is not Status.CONVERGED:
                return tried
            return self.ended(tried, state, u_s, load)
        except (SolverError, np.linalg.LinAlgError) as error:
            log.warning("t = %g: %s", end, error)
            broken = unsolved(state, self.surface.size, Status.BROKEN, rows)
            return replace(tried, solution=broken, problem=problem)

    def ended(self, tried: Attempt, state: State, u_s: Vec, load: Vec, memory: Memory | None = None) -> Attempt:
        """An attempt from a state with the state at its end, once its problem is solved; collective.

        Args:
            tried: with its problem, and the solution.
            u_s: what is prescribed, over all displacements [m].
            load: external forces, likewise [N].
            memory: of the laws at its end; None: that of one substep.
        """
        problem, solution, system = tried.problem, tried.solution, self.system
        assert problem is not None
        end, q = problem.cone.time, problem.surface.recover(problem.load, solution.p, solution.u_c)
        u, u_strained = displacement(system, end, q, u_s)
        new = new_state(
            system=system,
            old=state,
            problem=problem,
            u=u,
            u_strained=u_strained,
            u_s=u_s,
            load=load,
            p=solution.p,
            driven=solution.u_c[len(solution.u_c) - self.surface.driven :],
            memory=memory,
        )
        if not np.isfinite([new.energy.external, new.energy.stored, new.energy.contact]).all():
            return replace(tried, solution=replace(solution, status=Status.NOT_FINITE))
        return replace(
            tried,
            linear_error=self.surface.linear_error,
            state=replace(
                new,
                previous=Previous(time=state.time, p=state.p) if end > state.time else None,
                law_error=state.law_error + solution.law_error,
                peak=max(state.peak, new.energy.stored),
            ),
        )

    def _solved(
        self, problem: SurfaceProblem, state: State, p: Array, on_step: OnStep
    ) -> tuple[Solution, SurfaceProblem]:
        """Solve a posed problem from tractions p (rows,) [Pa]; returns the problem as it is then too; collective."""
        method = self.method_after(state)
        memory = self.memory(state, problem.cone.time)

        def once(problem: SurfaceProblem, p: Array) -> tuple[Solution, SurfaceProblem]:
            found = None
            if self.bolts:
                found, problem = self.bolts.at_once(self, problem, state, p, on_step)
            found = found or method(problem, p, on_step)
            return found, problem if found.gap is None else replace(problem, gap=found.gap, touch=None)

        solve = memory.around(once)
        way = Way(problem, state.p, state.w, self.system.problem.solver.tolerance)
        found = way.from_touch(
            solve(replace(problem, touch=Touch(way, on_the_way=True)) if way.any else problem, p), solve
        )
        return self._continued(state, found, solve)

    def _continued(
        self, state: State, found: tuple[Solution, SurfaceProblem], solve: Solving
    ) -> tuple[Solution, SurfaceProblem]:
        """The solution that goes on from the state, if there are several; else the one that is found."""
        solution, problem = found
        if solution.status is not Status.CONVERGED or state.jumped:
            return replace(solution, jumps=state.jumped), problem
        end, jumps = continued(problem, state.p, state.w, solution)
        own = _exactly(problem, solution) if end is not None else solution.p
        if end is not None and _apart(problem, end.p, [own]):
            if not jumps:
                nearer, last = solve(problem, end.p)
                if nearer.status is Status.CONVERGED and not _apart(problem, nearer.p, [end.p]):
                    log.info("t = %g: of several solutions that of the path from the step before", problem.cone.time)
                    return replace(nearer, others=(solution.p,)), last
            return replace(solution, jumps=jumps, others=(end.p,)), problem
        if applies(problem) or critical(problem) > 1 or state.memory:
            return replace(solution, jumps=jumps), problem
        settings, chosen = self.system.problem.solver, solution
        tried = branches(problem, state.p, state.w, settings.tolerance, settings.max_iterations)
        solved = [each for each in tried if each.status is Status.CONVERGED]
        own = _exactly(problem, solution)
        if solved and solved[0] is tried[0] and _apart(problem, solved[0].p, [own]):
            chosen = replace(tried[0], history=solution.history)
        known = [own if chosen is solution else chosen.p]
        for each in (own, *(each.p for each in solved)):
            if _apart(problem, each, known):
                known.append(each)
        return replace(chosen, others=tuple(known[1:])), problem

    def memory(self, state: State, end: float) -> LawMemory:
        """Memory of laws in a substep from a state to a time [s]."""
        return LawMemory(self.cone.at(end), state.memory, end - state.time, self.system.problem.solver.tolerance)

    def _first_tractions(self, state: State, end: float) -> Array:
        """Tractions (rows,) [Pa] that the iteration starts from.

        Measured: with exact volume solves extrapolation saves a third to two thirds of Newton's iterations and an
        eighth to a quarter of Uzawa's; with iterative ones it costs a fifth more, so there it is off.
        """
        known = self.surface.exact or state.guess is not None
        return state.ahead(end, self.system.course.timeline.turns) if known else state.p

    def split(self, p: Array) -> tuple[list[Array], list[Array]]:
        """Flat tractions (rows,) [Pa] as pressures (m_n,) and tangential tractions (m_t, d-1) of each contact."""
        return split(self.cone, p)

    def posed(self, state: State, time: float) -> tuple[SurfaceProblem, Vec, Vec]:
        """The surface problem of a substep from `state` to a time [s]; collective.

        Returns:
            The problem, and over all displacements what is prescribed [m] and the external forces [N].
        """
        system, n = self.system, self.surface.normal_rows
        external, u_s = system.load(time), system.prescribed(time)
        driving = system.obstacles.driving_force(time)
        cone = with_memory(self.cone.at(time), state.memory, time - state.time)
        problem = SurfaceProblem(
            surface=self.surface,
            cone=cone,
            load=self.surface.load(system.pull(time, external, u_s), driving),
            offset=relative_displacement(system, u_s, time, np.zeros(self.surface.driven)),
            u_before=self.at_contact(state) if self.surface.floating else np.zeros(self.surface.size),
            gap=np.concatenate([*(c.gap for c in cone.contacts), (state.w - self.cone.give(state.p))[n:]]),
            turned=state.p if state.previous and state.turned(system.course.timeline.turns) else None,
            gamma=self.gamma,
            weight=self.weight,
            force=sum_of_sizes(external) + float(np.abs(driving).sum()),
            stiffness=system.problem.softest / system.extent,
            guess=self.at_contact(state.guess) if state.guess else None,
        )
        return problem, u_s, external

    def at_contact(self, state: State) -> Array:
        """Displacement (c,) [m] of the contact dofs in a state; collective."""
        q = self.system.free_part(state.u, state.time)
        return np.concatenate([self.volume.contact.read(q), state.driven])


def _exactly(problem: SurfaceProblem, found: Solution) -> Array:
    """Tractions (rows,) [Pa] of the exact solution: what loose tolerances and approximate laws leave is no other one.

    The first correction leaves a hundredth of that, which of approximate laws is still too much.
    """
    return by_schur_complement(problem, by_schur_complement(problem, found)[0])[0].p


def _apart(problem: SurfaceProblem, p: Array, known: list[Array]) -> bool:
    """Whether tractions p (rows,) [Pa] differ from all that are known by more than a slight part of the largest."""
    largest = max(problem.scales.of_tractions(each) for each in (p, *known))
    return all(np.abs(p - each).max(initial=0.0) > SLIGHT * largest for each in known)


def unsolved(state: State, size: int, status: Status, rows: list[Step]) -> Solution:
    """Stand-in for the solution of a substep that ended early: the tractions of the state before it."""
    residual = rows[-1].residual if rows else np.inf
    return Solution(p=state.p, w=state.w, u_c=np.zeros(size), status=status, residual=residual, history=tuple(rows))
