"""Load steps: each starts from the slip of the one before; one that fails is halved."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.errors import SolverError
from solvers.bodies import Load
from solvers.cone import Cone
from solvers.energy import Energy
from solvers.equilibrium import decide, unbalanced_motion
from solvers.history import HistoryRow
from solvers.iterative_volume import IterativeVolume
from solvers.methods.condensed_newton import CondensedNewton
from solvers.methods.solution import OnStep, Solution, Status, Step
from solvers.methods.uzawa import Uzawa
from solvers.motion_in_words import in_words
from solvers.plan import method_of
from solvers.prepare import prepare_surface, prepare_volume, trial_stiffness
from solvers.regularised import Regularised
from solvers.sliding import positions, stay, told_in
from solvers.state import State
from solvers.surface_problem import SurfaceProblem
from solvers.system import System
from solvers.volume import Volume

Array = NDArray[np.float64]
Method = Callable[[SurfaceProblem, Array, OnStep], Solution]
log = logging.getLogger(__name__)
SEARCHES = 6  # of a step whose points leave their facets
HALVINGS = 8  # a step is cut to 1/256 before it is given up


@dataclass(frozen=True, kw_only=True)
class Accepted:
    """A requested time, reached."""

    stepper: Stepper  # whose rows the state is told in
    state: State
    before: State  # at the last requested time
    last: State  # before the last substep
    problem: SurfaceProblem  # of the last substep
    substeps: int
    iterations: int
    volume_solves: int
    residual: float
    slack: float  # of the friction bound, see `Solution`
    linear_error: float  # of the last substep, see `Bodies`
    history: tuple[HistoryRow, ...]


class StepError(SolverError):
    """The smallest step failed; `reached` is the last good substep, if there is one."""

    def __init__(self, time: float, text: str, history: tuple[HistoryRow, ...], reached: Accepted | None) -> None:
        super().__init__(f"t = {time:g}: {text}")
        self.history, self.reached = history, reached


class NoEquilibriumError(StepError):
    """It failed, and at the time named there is no equilibrium: that is proved."""


class Stepper:
    """The bodies prepared once, and the march through the requested times."""

    def __init__(
        self,
        system: System,
        volume: Volume | IterativeVolume | None = None,
        searched: Mapping[str, Array] = MappingProxyType({}),
    ) -> None:
        """Factorise and condense, unless the volume is prepared already; collective.

        Args:
            searched: where the pairs of sliding contacts were found, (n_all, d) [m] by contact; see `positions`.
        """
        self.searched = searched
        self.system = system
        self.volume = volume or prepare_volume(system)
        self.surface = prepare_surface(system, self.volume)
        self.cone = Cone(system.contacts, 0.0, system.scene.steps.end)
        self.gap = np.concatenate([np.zeros(0), *(c.gap for c in system.contacts)])
        self.gamma = trial_stiffness(system)
        self.method_after = self._method()

    def _method(self) -> Callable[[State], Method]:
        """The method for the step that follows a state; those that see the surface only are the same for all."""
        name, solver = method_of(self.system.scene), self.system.scene.solver
        if name == "regularised":
            regularised = Regularised(self.system, self.volume, self.surface)
            return lambda state: regularised.after(state.u, state.motion)
        kind = Uzawa if name == "uzawa" else CondensedNewton
        method = kind(rtol=solver.tolerance, max_it=solver.max_iterations)
        return lambda state: method

    def start(self) -> State:
        """Nothing has happened yet."""
        zero, vector = np.zeros(self.cone.size), self.system.K.createVecRight
        energy = Energy(0.0, 0.0, 0.0, 0.0, np.zeros(len(self.system.contacts)))
        driven = np.zeros(len(self.system.driven))
        motion = {c.name: np.zeros_like(c.points) for c in self.system.contacts}
        slip = {c.name: np.zeros_like(c.surface.points) for c in self.system.contacts}
        forces, rows = {name: np.zeros_like(m) for name, m in motion.items()}, self.system.contacts
        return State(
            0.0, vector(), vector(), vector(), vector(), zero, zero, motion, driven, slip, forces, rows, energy
        )

    def reach(self, start: State, target: float, on_iteration: Callable[[HistoryRow], None]) -> Accepted:
        """Solve up to `target`, halving steps that fail; each retry starts from the last accepted state.

        Raises:
            StepError: the smallest step failed; it carries what was reached.
        """
        state, substeps, iterations = start, 0, 0
        history: list[HistoryRow] = []
        unbalanced: tuple[float, str] | None = None  # the earliest time known to have no equilibrium
        solves = self.system.counters.volume_solves
        size = target - start.time
        smallest = size / 2**HALVINGS
        reached: Accepted | None = None
        while reached is None or state.time < target:
            last = target - state.time <= size * (1 + 1e-9)
            end = target if last else state.time + size
            stepper, solution, problem, accept = self._follow(state, end, history, on_iteration)
            iterations += solution.iterations
            if solution.status is Status.NO_EQUILIBRIUM:
                unbalanced = end, f"{solution.status.value}: {in_words(stepper.system, solution.u_c)}"
            if solution.status is Status.CONVERGED:
                before_substep, state, substeps = state, accept(), substeps + 1
                if stepper is not self:
                    unbalanced = None  # it was known for the pairs of another place
                reached = Accepted(
                    stepper=stepper,
                    state=state,
                    before=start,
                    last=before_substep,
                    problem=problem,
                    substeps=substeps,
                    iterations=iterations,
                    volume_solves=self.system.counters.volume_solves - solves,
                    residual=solution.residual,
                    slack=solution.slack,
                    linear_error=stepper.surface.linear_error,
                    history=tuple(history),
                )
            elif size <= smallest * (1 + 1e-9):
                if unbalanced is not None:
                    raise NoEquilibriumError(*unbalanced, tuple(history), reached)
                text = f"residual {solution.residual:.1e} after {solution.iterations} iterations"
                known = f" ({decide(problem).value})" if self.surface.floating else ""
                raise StepError(end, f"{text}; {solution.status.value}{known}", tuple(history), reached)
            else:
                size /= 2
                log.warning("t = %g: %s; the step is halved", end, solution.status.value)
        return reached

    def _follow(
        self, state: State, end: float, history: list[HistoryRow], on_iteration: Callable[[HistoryRow], None]
    ) -> tuple[Stepper, Solution, SurfaceProblem, Callable[[], State]]:
        """One attempt at a step; the pairs of sliding contacts are those of where it starts, or of where it ends."""
        names = [c.name for c in self.system.contacts if self.system.scene.contacts[c.name].sliding]
        if not names:
            return self, *self._solve(state, end, history, on_iteration)
        where = positions(self.system, state, names)
        for _ in range(SEARCHES):
            stepper = self._searched(where)
            told = told_in(state, stepper.system, stepper._rows)
            solution, problem, accept = stepper._solve(told, end, history, on_iteration)
            if solution.status is not Status.CONVERGED:
                break
            new = accept()
            accept = partial(_known, new)
            reached = positions(stepper.system, new, names)
            if stay(stepper.system, where, reached):
                break
            where = reached
        else:
            log.warning("t = %g: pairs still change after %d searches; the last ones stand", end, SEARCHES)
        return stepper, solution, problem, accept

    def _searched(self, where: Mapping[str, Array]) -> Stepper:
        """The same bodies with other pairs."""
        other = Stepper(self.system.searched(where), self.volume, where)
        other.surface.adopt(self.surface)
        return other

    def _solve(
        self, state: State, end: float, history: list[HistoryRow], on_iteration: Callable[[HistoryRow], None]
    ) -> tuple[Solution, SurfaceProblem, Callable[[], State]]:
        """One attempt at the step from `state` to `end`, and what makes it the new state."""
        system, began = self.system, clock.perf_counter()
        load, u_s = system.load(end), system.prescribed(end)
        f_q = system.T.createVecRight()
        system.T.multTranspose(load - system.K * u_s, f_q)
        driving = system.driving_force(end)
        pull = self.surface.load(f_q, driving)
        problem = self._problem(state, end, u_s, pull, load.norm(0) + float(np.abs(driving).sum()))

        def record(step: Step) -> None:
            row = HistoryRow(end, step, clock.perf_counter() - began)
            history.append(row)
            log.info("t = %g  iteration %d  residual %.2e", row.time, step.iteration, step.residual)
            on_iteration(row)

        start = state.p if problem.p_ref > 0 else np.zeros_like(state.p)  # no load, no motion: no traction
        motion = unbalanced_motion(problem) if self.surface.floating else None
        if motion is None:
            solution = self.method_after(state)(problem, start, record)
        else:
            solution = Solution(start, state.w, motion, Status.NO_EQUILIBRIUM, np.inf, ())

        def accept() -> State:
            driven = solution.u_c[len(solution.u_c) - len(driving) :]
            u = system.T * self.surface.recover(pull, solution.p, solution.u_c) + u_s
            residual = system.K * u - load + system.contact_forces(*self.split(solution.p))
            new = self._with_energy(state, problem, end, u, u_s, load, residual, solution.p, driven)
            return replace(new, law_error=state.law_error + solution.law_error)

        return solution, problem, accept

    def split(self, p: Array) -> tuple[list[Array], list[Array]]:
        """Flat tractions to normal (m_n,) and tangential (m_t, d-1) ones of each contact."""
        places = self.cone.places
        return [p[s.normal] for s in places], [p[s.tangential].reshape(-1, s.components) for s in places]

    def _problem(self, state: State, time: float, u_s: Any, load: Load, force: float) -> SurfaceProblem:
        system, n = self.system, self.surface.normal_rows
        return SurfaceProblem(
            surface=self.surface,
            cone=self.cone.at(time),
            load=load,
            offset=self._relative(u_s, time, np.zeros(self.surface.driven)),
            gap=np.concatenate([self.gap, (state.w - self.cone.give(state.p))[n:]]),
            gamma=self.gamma,
            force=force,
            stiffness=min(m.E for m in system.scene.bodies.values()) / system.extent,
        )

    def _relative(self, u: Any, time: float, driven: Array) -> Array:
        """Rows (rows,) [m] of a displacement, the obstacles' motion taken off."""
        motion = self.system.obstacle_motion(time, driven)
        surfaces = self.system.contact_displacement(u)
        return self._rows([v - motion[c.name] for c, v in zip(self.system.contacts, surfaces, strict=True)])

    def _rows(self, relative: list[Array]) -> Array:
        pairs = list(zip(self.system.contacts, relative, strict=True))
        blocks = [c.N_n @ v.ravel() for c, v in pairs] + [c.N_t @ v.ravel() for c, v in pairs]
        return np.concatenate([np.zeros(0), *blocks])

    def _with_energy(
        self,
        old: State,
        problem: SurfaceProblem,
        time: float,
        u: Any,
        u_s: Any,
        load: Any,
        residual: Any,
        p: Array,
        driven: Array,
    ) -> State:
        system, W, contacts = self.system, self.surface.W, self.system.contacts
        w, motion = self._relative(u, time, driven), system.obstacle_motion(time, driven)
        external = (load + old.load).dot(u - old.u) / 2 + (residual + old.residual).dot(u_s - old.u_s) / 2
        contact, slip = 0.0, {}
        forces = {c.name: c.nodal_forces(*parts) for c, *parts in zip(contacts, *self.split(p), strict=True)}
        here, there = system.contact_displacement(u), system.contact_displacement(old.u)
        for c, v, v_old in zip(contacts, here, there, strict=True):
            # forces of both ends of the step, each in its own rows, so that the balance of energy is exact
            mean, pushed = (forces[c.name] + old.forces[c.name]) / 2, motion[c.name] - old.motion[c.name]
            external -= float(np.sum(mean * pushed))
            contact += float(np.sum(mean * (v - v_old - pushed)))
            slip[c.name] = old.slip[c.name] + c.node_motion(v - v_old - pushed)[1]
        slipping = W * p * (w - problem.gap - self.cone.give(p))
        energy = Energy(
            external=old.energy.external + external,
            stored=(system.K * u).dot(u) / 2,
            contact=old.energy.contact + contact,
            compliance=float(W @ self.cone.energy(p)),
            dissipation=old.energy.dissipation
            + np.array([slipping[place.tangential].sum() for place in self.cone.places]),
        )
        return State(time, u, u_s, load, residual, p, w, motion, driven, slip, forces, contacts, energy)


def _known(state: State) -> State:
    return state
