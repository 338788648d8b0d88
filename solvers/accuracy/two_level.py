"""Error of the mesh of every quantity: the same steps once more with bubbles, contact solved again.

After each solved substep of order 1, bubbles x (order 2 on the same mesh) are found by Jacobi's iteration, made
better by a least-squares combination of its steps (nonlinear GMRES); where cells are flat and bend, of more of them.
Each step asks the bodies and the contact for their answer to bubbles: bubbles pull at the nodes of the mesh and shift
the surface, and contact and friction are solved again, with the slip history of the steps with bubbles. The mesh
error of a quantity follows from its difference with and without bubbles, see `mesh_error`; with bubbles it has about
a ninth of the error.

Source: the hierarchical estimates of Bank & Smith, SIAM J. Numer. Anal. 30 (1993), here with contact; nonlinear GMRES:
Washio & Oosterlee, Electron. Trans. Numer. Anal. 6 (1997).

`FollowedBolts` tightens bolts to a force, with bubbles: found is the shortening at which the tension is that of the
solved step. Bubbles make bodies softer: with the shortening of the step the tension would fall. Once a bolt is held it
keeps the shortening of the steps with bubbles. Each answer to bubbles is found as the step is, see `tightening`;
Broyden's matrix goes on from answer to answer of a substep, and begins anew with the next one: a resumed run has the
same bits.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import CLOSE, EXACT, SLIGHT, Array, Ints
from stickslip.geometry.errors import SolverError
from stickslip.geometry.protocols import Vec
from stickslip.geometry.surfaces.surface import gather_surface
from stickslip.solvers.accuracy.bubble_rows import BubbleRows
from stickslip.solvers.accuracy.bubbles import Bubbles, FinerLoads
from stickslip.solvers.accuracy.facet_volume_correction import LeftOut
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Solution, Status, ignore
from stickslip.solvers.methods.method import Solve
from stickslip.solvers.results.recovered_stress import InCell
from stickslip.solvers.results.step_result import Quantity
from stickslip.solvers.scene.record import Value
from stickslip.solvers.stepping.law_memory import worn_depth
from stickslip.solvers.stepping.pairs import carried_over
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import Stepper
from stickslip.solvers.stepping.substep import SubstepSolver
from stickslip.solvers.stepping.tightening import largest_tension, stretched
from stickslip.solvers.stepping.update import Surplus, displacement, new_state
from stickslip.solvers.system.system import System


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
        """Whether no shortening was found in eight solutions of an answer, and two more for each bolt."""
        return self._tries > 8 + 2 * len(self._free)

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


log = logging.getLogger(__name__)
STEPS, MOST = 6, 30  # of Jacobi's iteration: as many are enough but for flat cells in bending
SLOW = 0.33  # residual, by the first, from which on it goes on, and with which nothing is found


@dataclass(frozen=True)
class Answer:
    """Response of the bodies and the contact to bubbles."""

    x: Vec  # the bubbles
    pull: Vec  # their inner forces on the nodes of the mesh [N]
    problem: SurfaceProblem
    solution: Solution
    u: Vec  # displacement of the mesh [m]
    u_strained: Vec
    initial: Array  # (k,) values of the initial strains
    left_out: tuple[Vec, Vec] | None = None  # loads, and inner forces, of what facets leave out of the bodies [N]


class MeshCorrection:
    """Follows a history of load steps with bubbles; called after each substep."""

    @staticmethod
    def works_for(stepper: Stepper) -> bool:
        """Whether it can follow the steps: of order 1, with contact, by a method with exact laws, not by a clock.

        Bodies that do not lock by a mean dilatation are not followed.

        Bubbles vanish where supports hold: a displacement that is an expression of place would be too large a part.
        """
        system = stepper.system
        expressions = system.problem.timeline.expressions.items()
        uneven = any(place.table == "supports" and found.names & {*"xyz"} for place, found in expressions)
        stressed = stepper.clock is not None or system.prestress is not None
        if system.problem.averaged or uneven or system.mesh.degree > 1 or stressed:
            return False
        return len(system.contacts) > 0 and stepper.chain.exact_laws

    def __init__(self, stepper: Stepper) -> None:
        """Prepare the bubbles of a history that is followed; collective."""
        system, bubbles = stepper.system, Bubbles(stepper.system)
        self._bubbles, self.nodes = bubbles, bubbles.nodes
        names = {side for pair in system.problem.pairs.values() for side in (pair.slave, pair.master) if side}
        self._left_out = LeftOut(system) if system.mesh.bulging else None
        self._finer = FinerLoads.of(system)
        self._sides = {name: gather_surface(system.mesh, bubbles.space, bubbles.nodes, name) for name in sorted(names)}
        self._known: tuple[System, BubbleRows] | None = None
        self._by_force = BoltsByForce(system)

    def __call__(self, stepper: SubstepSolver, old: State, new: State, problem: SurfaceProblem) -> State | None:
        """The state with bubbles after a substep from `old` to `new`; None: it was not found; collective.

        The substep itself is solved, whatever fails here.

        Args:
            stepper: with the contact rows of the substep.
            old: whose `refined` is the state with bubbles; None in the initial state, where it is the same.
            new: the solved state.
            problem: that was solved.
        """
        with stepper.system.counters.clock.phase("error", "mesh"):
            try:
                return self._followed(stepper, old, new, problem)
            except (SolverError, np.linalg.LinAlgError) as error:
                log.warning("t = %g: the error of the mesh is unknown from here on: %s", new.time, error)
                return None

    def displacement_at(self, state: State, probes: Mapping[str, tuple[int, Array] | None]) -> dict[Quantity, Value]:
        """Displacement (d,) [m] of a state with bubbles at probes, see `Bubbles.displacement_at`; collective."""
        assert state.surplus is not None
        found = self._bubbles.displacement_at(state.u, state.surplus, probes)
        return {Quantity("probes", name, "displacement"): value for name, value in found.items()}

    def in_cells(self, state: State, places: Mapping[str, tuple[int, Array] | None]) -> dict[str, InCell]:
        """The same in the cells that the points are in, see `Bubbles.in_cells`; collective."""
        assert state.surplus is not None
        return self._bubbles.in_cells(state.u, state.surplus, places)

    def whole(self, state: State) -> tuple[Array, Ints]:
        """Displacement of a state with bubbles at all nodes, and those of cells, see `Bubbles.whole`; collective."""
        assert state.surplus is not None
        return self._bubbles.whole(state.u, state.surplus)

    def vector(self) -> Vec:
        """No bubbles."""
        return self._bubbles.zero()

    def _followed(self, stepper: SubstepSolver, old: State, new: State, problem: SurfaceProblem) -> State | None:
        before = old.refined or (None if old.p.any() or old.w.any() else old)
        if before is None:
            return None  # an earlier substep was not followed
        rows = self._rows(stepper.system)
        if before.rows is not stepper.system.contacts:
            before = carried_over(before, stepper.system)
            if before.surplus is not None:
                before = replace(before, w=before.w + rows.N @ rows.read(before.surplus))
        chain, system, surface = stepper.chain, stepper.system, stepper.surface
        solve = chain.beside(system, surface, new, 0.1)  # an iterative method makes the residual so much smaller
        if solve is None:
            return None
        bolts = FollowedBolts(self._by_force, self._bubbles, before, old, new)
        friction = rows.friction(stepper.cone, old, new)
        finer = None if self._finer is None else self._finer.added(new.time)
        touched = problem.gap - (old.w - stepper.cone.give(old.p))
        worn = worn_depth(stepper.cone, before.memory) - worn_depth(stepper.cone, old.memory)
        step = _Substep(
            stepper, self._bubbles, rows, self._left_out, before, new, problem, bolts, friction, finer, touched, worn
        )
        with surface.loosely(1e-2):  # in the energy norm, a displacement that an iterative volume solve recovers
            last = self._improved(step, solve)
            if last is None:
                return None
            return step.state(last)

    def _improved(self, step: _Substep, solve: Solve) -> Answer | None:
        """Bubbles, and the answer to them; collective.

        They are found around the solved step, with its slip history; the last answer is with that of the bubbles. Where
        volume solves are iterative, bodies and contact answer to the last bubbles alone.
        """
        x, exact = self._bubbles.zero(), step.stepper.surface.exact
        found: Answer | None = step.solved()
        if exact and (step.rows.closer.any() or step.left_out or step.finer is not None):
            found = step.answer(x, step.new.p, solve, same_history=True)
        if found is None:
            return None
        r, motions, changes, relaxed = step.residual(found), list[Vec](), list[Vec](), list[Vec]()
        z = self._bubbles.relaxed(r)
        first = left = self._size(r, z)
        while not self._done(len(motions), left / first if first else 0.0):
            moved = self._bubbles.displacement(z)
            if exact:
                tried = step.answer(x + moved, found.solution.p, solve, same_history=True)
                if tried is None:
                    return None
                changes.append(step.residual(tried) - r)
            else:
                changes.append(step.own_change(moved))
            motions.append(moved)
            relaxed.append(self._bubbles.relaxed(changes[-1]))
            factors = _least_squares(changes, relaxed, r)
            x, r, z = x.copy(), r.copy(), z.copy()
            for factor, *each in zip(factors, motions, changes, relaxed, strict=True):
                for sum_of, one in zip((x, r, z), each, strict=True):
                    sum_of.axpy(factor, one)
            left = self._size(r, z)
        if left > SLOW * first:
            log.warning("t = %g: the error of the mesh is not found: its cells are too flat", step.new.time)
            return None
        return step.answer(x, found.solution.p, solve)

    def _size(self, forces: Vec, relaxed: Vec) -> float:
        """Energy norm [J^(1/2)] of the displacement that is `relaxed` under forces on the free bubbles; collective."""
        return float(np.sqrt(max(forces.dot(relaxed), 0.0)))

    def _done(self, steps: int, left: float) -> bool:
        """Whether Jacobi's iteration ends after so many steps that leave a part of the first residual."""
        return steps >= STEPS and (steps == MOST or left <= SLOW)

    def _rows(self, system: System) -> BubbleRows:
        """The contact rows of the bubbles, for those of the system."""
        if self._known is None or self._known[0] is not system:
            self._known = system, BubbleRows(system, self._bubbles, self._sides)
        return self._known[1]


def _least_squares(changes: list[Vec], relaxed: list[Vec], r: Vec) -> list[float]:
    """Factors c (k,) for which r + sum of c times the changes is least, measured by `_size`; collective."""
    products = np.array([[a.dot(b) for b in relaxed] for a in changes])
    right = np.array([-each.dot(r) for each in relaxed])
    return [float(c) for c in np.linalg.lstsq(products, right, rcond=EXACT)[0]]


@dataclass(frozen=True)
class _Substep:
    """One substep with bubbles."""

    stepper: SubstepSolver
    bubbles: Bubbles
    rows: BubbleRows
    left_out: LeftOut | None
    old: State  # with bubbles, at its start
    new: State  # without bubbles, at its end
    problem: SurfaceProblem  # that was solved without bubbles
    bolts: FollowedBolts
    friction: Mapping[str, tuple[Array, float]]  # between nodes, see `BubbleRows.friction`
    finer: Vec | None  # what loads lack, see `FinerLoads.added` [N]
    touched: Array  # (rows,) motion [m] before points touch in the substep, in tangential rows, see `from_touch`
    worn: Array  # (rows,) depth [m] that has worn off with bubbles, less that without, at its start

    def solved(self) -> Answer:
        """The solved step: what is answered to no bubbles."""
        p, w = self.new.p, self.new.w
        solution = Solution(p=p, w=w, u_c=np.zeros(0), status=Status.CONVERGED, residual=0.0, history=())
        none = self.stepper.system.vector()
        return Answer(self.bubbles.zero(), none, self.problem, solution, self.new.u, self.new.u, self.new.initial)

    def answer(self, x: Vec, p: Array, solve: Solve, same_history: bool = False) -> Answer | None:
        """Solve contact for given bubbles; None: it is not solved; collective.

        Args:
            p: tractions (rows,) [Pa] to start from.
            solve: of contact.
            same_history: whether slip is counted from where the step without bubbles counts it from, and all bolts that
                are tightened to a force have its tension.
        """
        stepper, new, n = self.stepper, self.new, self.stepper.surface.normal_rows
        slip = self.problem.gap if same_history else self.old.w - stepper.cone.give(self.old.p) + self.touched
        worn = 0 * self.worn if same_history else self.worn
        pull, left_out = self.bubbles.pull(x), self._forces_left_out
        more = pull if left_out is None else pull + left_out[1] - left_out[0]
        more = more if self._friction is None else more + self._friction
        more = more if self.finer is None else more - self.finer
        posed = replace(
            self.problem,
            offset=self.problem.offset + self.rows.N @ self.rows.read(x),
            gap=np.concatenate([self.problem.gap[:n] - self.rows.closer[:n] + worn[:n], slip[n:]]),
        )
        balanced = left_out is None and not self.friction and self.finer is None
        self.bolts.begin(trial=same_history)
        while not self.bolts.given_up:
            initial = self.bolts.values
            forces = self._pulled(more, initial)
            load = stepper.surface.with_more(posed.load, forces, balanced=balanced)
            problem = replace(posed, load=load)
            solution = solve(problem, p, ignore)
            if solution.status is not Status.CONVERGED:
                return None
            q = problem.surface.recover(problem.load, solution.p, solution.u_c)
            u, u_strained = displacement(stepper.system, new.time, q, new.u_s)
            if self.bolts.done(u_strained, x):
                return Answer(x, pull, problem, solution, u, u_strained, initial, left_out)
            p = solution.p
        log.info("t = %g: no shortening of bolts was found with bubbles", new.time)
        return None

    @cached_property
    def _forces_left_out(self) -> tuple[Vec, Vec] | None:
        """Loads, and inner forces in the solved step, of what facets leave out of the bodies [N]; collective."""
        if self.left_out is None:
            return None
        return self.left_out.load(self.new.time), self.left_out.inner(self.new.u, self.new.initial)

    @cached_property
    def _friction(self) -> Vec | None:
        """Nodal forces like B^T p of friction between nodes [N]."""
        system, none = self.stepper.system, (0.0, 0.0)
        if not self.friction:
            return None
        return system.interface.spread(
            [np.broadcast_to(self.friction.get(c.name, none)[0], c.points.shape) for c in system.contacts]
        )

    def _pulled(self, pull: Vec, initial: Array) -> Vec:
        """Forces on the free dofs [N] of what pulls at the mesh, and of initial strains that differ from the step's."""
        system = self.stepper.system
        forces, more = self.problem.load.f_q.duplicate(), system.initial.added(-pull, initial - self.new.initial)
        system.T.multTranspose(more, forces)
        return forces

    def residual(self, answer: Answer) -> Vec:
        """Forces that are out of balance at the free bubbles [N]; collective."""
        return self.bubbles.free(self._unbalanced(answer, self.bubbles.inner(answer.u, answer.x)))

    def _unbalanced(self, answer: Answer, inner: Vec) -> Vec:
        """Forces out of balance at all nodes of the next order, those that supports hold included [N]; collective.

        Args:
            inner: forces of the answer [N].
        """
        forces = self.bubbles.load(self.new.time) + self.bubbles.strained(answer.initial) - inner
        self.rows.add(forces, -self._contact(answer.solution.p))
        return forces

    def _left_over(self, answer: Answer, inner: Vec) -> Vec:
        """Inner minus outer forces at all nodes of the next order [N]; collective."""
        found = -self._unbalanced(answer, inner)
        if self._friction is not None:
            found = found + self.bubbles.at_corners(self._friction)
        if answer.left_out is None:
            return found
        outer, resisting = answer.left_out
        return found + self.bubbles.at_corners(resisting - outer)

    def own_change(self, x: Vec) -> Vec:
        """By how much bubbles change the `residual` [N] if neither bodies nor contact answer to them; collective."""
        return self.bubbles.free(-self.bubbles.inner(self.new.u.duplicate(), x))

    def _contact(self, p: Array) -> Array:
        """Contact forces on the bubbles, flat at the contact nodes [N]; those on the bodies are their negative."""
        return np.asarray(self.rows.N.T @ (self.problem.surface.W * p))

    def state(self, answer: Answer) -> State:
        """The state with bubbles at the end; collective."""
        system, old, new, x = self.stepper.system, self.old, self.new, answer.x
        bubbles, p = self.bubbles, answer.solution.p
        before = old.surplus or bubbles.zero()
        pull, change, here = answer.pull, x - before, self.rows.read(x)
        there = self.rows.read(before)
        inner = bubbles.inner(answer.u, x)
        loads = bubbles.load(new.time) + bubbles.load(old.time)
        surplus = Surplus(
            inner=pull if self._friction is None else pull + self._friction,
            relative=self.rows.N @ here,
            motion=dict(zip((c.name for c in system.contacts), self.rows.motion(here - there), strict=True)),
            stored=(answer.u_strained.dot(pull) + x.dot(inner)) / 2,
            external=loads.dot(change) / 2,
            contact=float((self._contact(p) + self._contact(old.p)) @ (here - there) / 2),
            initial_work=bubbles.initial_work(x),
            elongation=bubbles.elongation(x),
            remote=bubbles.remote(x),
            ground=bubbles.ground.exerted(x),
            friction=self.friction,
        )
        load = new.load if self.finer is None else new.load + self.finer
        if answer.left_out is not None:
            outer, resisting = answer.left_out
            stored = surplus.stored + answer.u_strained.dot(resisting) / 2
            load, surplus = load + outer, replace(surplus, inner=surplus.inner + resisting, stored=stored)
        driven = answer.solution.u_c[len(answer.solution.u_c) - len(new.driven) :]
        found = new_state(
            system=system,
            old=old,
            problem=answer.problem,
            u=answer.u,
            u_strained=answer.u_strained,
            u_s=new.u_s,
            load=load,
            p=p,
            driven=driven,
            surplus=surplus,
            initial=answer.initial,
        )
        motion = dict(zip(surplus.motion, self.rows.motion(here), strict=True))
        return replace(
            found,
            surplus=x,
            surplus_motion=motion,
            reactions=bubbles.reactions(self._left_over(answer, inner)),
            peak=max(old.peak, found.energy.stored),
        )
