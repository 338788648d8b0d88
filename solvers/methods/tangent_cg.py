"""Tangent conjugate gradients: the bodies move while contact is decided, for the price of about two linear solves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import ClassVar

import numpy as np
from mpi4py import MPI

from stickslip.geometry.arrays import CLOSE, EXACT, SLIGHT, Array, Bools, Ints, products
from stickslip.geometry.mesh.ranks import of_all_ranks
from stickslip.geometry.protocols import Vec
from stickslip.solvers.interface.flexibility import DelassusOperator, Load
from stickslip.solvers.interface.prepare import matrix_free
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import MemoisedMap
from stickslip.solvers.iteration import USUAL, Correction, Driver, Iterate, OnStep, Solution, Stall, Status, ignore
from stickslip.solvers.methods.method import Applicability, Before, Method, Ready, Setup, Solve, Turn
from stickslip.solvers.parallel.serialise import Own, Plain
from stickslip.solvers.tangent.coordinates import ContactCoordinates
from stickslip.solvers.tangent.laws import CompliantFaces, ContactPoints, Tangent
from stickslip.solvers.tangent.operator import CoarseMotions, TangentOperator, chebyshev

SMOOTHING = 6  # at the contact, before and after a multigrid cycle: with four, points that slip take up to a sixth more
PATIENCE = 150  # iterations of a step, if another form of the bodies can take over
UNKNOWN = 0.75  # contraction that is counted on before one is seen
SLOW = 0.55  # contraction at which, for the second time, multigrid may be adapted to the state of contact
GROWN = 0.4  # of the slave nodes, and of those that touch; with fewer changes multigrid stays
MARGIN = 2.9  # of the error that is stated: over all ready scenes it is 1.2 to 15 times the true one then, most often 5


@dataclass(frozen=True, kw_only=True)
class TangentCG(Method):
    """Conjugate gradients on the tangent problem of the present state of contact, which each iteration decides anew.

    An iteration: (1) each contact point moves to the solution of its own laws, the others at rest; (2) the laws are
    linearised there: stuck motions are held, slip turns on a spring and grows with the pressure; (3) one multigrid
    cycle of the bodies with their contact nodes held, between sweeps over the contact nodes and their neighbours,
    gives a direction; (4) the step is the best in the span of it and of earlier corrections, which makes conjugate
    gradients while contact does not change (in the first iteration: of the motion of the time step before, most of this
    one under loads that grow); (5) it is projected, and halved, ten times at the most, until the energy with frozen
    friction bounds does not grow.

    What stops it is the natural residual, and the error in the energy norm, (r . z)^(1/2), r the tangent residual and z
    the direction, relative to the displacement.

    Where points touch that close within the step is found again once the error is a small part of its last change.

    Source: truncated multigrid: Kornhuber, Numer. Math. 69 (1994); Gräser & Kornhuber, J. Comput. Math. 27 (2009).
    """

    NAME: ClassVar = "tangent-cg"
    WHEN: ClassVar = (
        "large bodies in 3D, where `auto` takes it first: contact is decided while the bodies are solved; two steps "
        "for one to three linear solves"
    )
    WORKS_WITH: ClassVar = Applicability(floating=True, driven=False, rates=False, condensed=False)
    ROW: ClassVar = 2
    TURNS: ClassVar = (Turn("matrix-free", 0, dims=(3,)),)

    def build(self, setup: Setup) -> Ready:
        return OnTangent(self, setup)


class OnTangent(Ready):
    """The iteration with its operator.

    Attributes:
        held: numbers of the coordinates that multigrid holds; None: of all slave nodes.
        coarse: motions that are added to the iteration, made when they are needed.
        moved: free displacements (owned,) of about the last step: under loads that grow they are most of the next.
        latest: load and solution (owned,) of the last one: with other laws or gaps the next is near, if the load stays.
        scale: from forces to about the displacement (c,) under them, by a multigrid cycle; the surface has it too.
    """

    held: Ints | None
    coarse: CoarseMotions | None
    moved: Array | None
    latest: tuple[Load, Array] | None
    scale: MemoisedMap

    def __init__(self, method: TangentCG, setup: Setup, before: OnTangent | None = None) -> None:
        """Set up the coordinates and multigrid; collective.

        Args:
            before: the same bodies with other contact rows.
        """
        self.method, self.system, self.surface, self.hurried = method, setup.system, setup.surface, setup.hurried
        self.coordinates = ContactCoordinates.of(setup.system, setup.surface)
        self.held = before.held_here(self.coordinates) if before else None
        holding = None if self.held is None else self._holding(self.held)
        self.operator = TangentOperator(setup.system, self.coordinates, holding)
        surface = matrix_free(setup.surface)
        guess, read = self.operator.guess, surface.volume.contact.read
        self.scale = MemoisedMap(
            lambda f: read(guess(f)), len(surface.volume.contact.rows), before.scale if before else None
        )
        surface.guess = self.scale  # which does not know the surface: in a circle both would outlive their user
        self.moved, self.latest, self.coarse = before.moved if before else None, None, None
        if before is not None and before.coarse is not None:
            self.make_coarse()

    def snapshot(self) -> dict[str, Plain]:
        """Return what multigrid holds, whether there are coarse motions, the last step, and loads; see `restore`."""
        moved, coarse = None if self.moved is None else Own(self.moved), self.coarse is not None
        return {"held": self.held, "coarse": coarse, "moved": moved, "loads": self.scale.snapshot()}

    def restore(self, snapshot: dict[str, Plain], surface: DelassusOperator) -> None:
        if snapshot["held"] is not None:
            self.hold(snapshot["held"])
        if snapshot["coarse"]:
            counted = self.operator.counters.linear_iterations  # when they were first made
            self.make_coarse()
            self.operator.counters.linear_iterations = counted
        self.moved = snapshot["moved"]
        self.scale.restore(snapshot["loads"], self.operator.K_B.createVecRight())

    def release(self) -> None:
        self.operator.release()

    def renewed(self, setup: Setup) -> Ready:
        self.release()
        return OnTangent(self.method, setup, self)

    def after(self, state: Before) -> Solve:
        return partial(self.step, state.u)

    def step(self, u: Vec, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        """Solve one step from displacement u [m] of all dofs; see `SameEveryStep`; collective."""
        operator, iteration = self.operator, Iteration(self, problem, u)
        start = iteration.v.copy()
        if self.latest is not None and self.latest[0] is problem.load:
            iteration.go_to(self.latest[1])
        elif self.moved is not None:
            again = operator.coordinates_of(self.moved)
            iteration.earlier = [(again, operator.product(again))]
        solution = iteration.solve(on_step)
        if solution.status is Status.CONVERGED:
            self.moved = operator.displacement(iteration.v - start).array_r.copy()
            self.latest = problem.load, iteration.v
        return solution

    def apart(self, u: Vec, drop: float) -> Solve:
        """A solver of problems near that of a displacement u [m] of all dofs, which changes nothing for later steps.

        Args:
            u: under the same supports.
            drop: factor by which the error becomes smaller.
        """

        def solve(problem: SurfaceProblem, _: Array, on_step: OnStep) -> Solution:
            return Iteration(self, problem, u, drop).solve(on_step)

        return solve

    def hold(self, numbers: Ints) -> None:
        """Set up multigrid with these coordinates held; collective."""
        self.operator.hold(*self._holding(numbers))
        self.coarse, self.held = None, numbers

    def _holding(self, numbers: Ints) -> tuple[ContactCoordinates, Ints]:
        """Arguments of `TangentOperator.hold`; collective."""
        return ContactCoordinates.of(self.system, self.surface, numbers), numbers

    def resists(self, nodes: Bools) -> bool:
        """Whether bodies that float can no longer move once these slave nodes (m,) are held; collective."""
        if not self.surface.floating:
            return True
        operator, surface, jumps = self.operator, matrix_free(self.surface), list[Array]()
        for column in surface.R.T:
            motion = operator.K_B.createVecRight()
            surface.volume.contact.write(motion, column)
            jumps.append(operator.coordinates(motion)[operator.at] * nodes.repeat(operator.dim))
        sizes = np.linalg.eigvalsh(operator.comm.allreduce(np.array(jumps) @ np.array(jumps).T))
        # squared jumps of the rigid motion that nodes resist least, relative to that they resist most
        return bool(sizes[0] > CLOSE * sizes[-1])

    def held_here(self, coordinates: ContactCoordinates) -> Ints | None:
        """As `held`, of the same nodes with the contact rows of other coordinates; collective."""
        if self.held is None:
            return None
        dim, slaves = self.system.mesh.dim, of_all_ranks(self.system.mesh.comm, coordinates.blocks.ravel())
        held = slaves[np.isin(slaves // dim, self.held // dim)]
        return np.intersect1d(held, coordinates.normal) if self.operator.sliding else held

    def make_coarse(self) -> None:
        """Add coarse motions to all later iterations; collective."""
        pressing = self.coordinates.at[: self.surface.normal_rows]
        self.coarse = CoarseMotions(self.system, self.operator, pressing)


class Iteration:
    """The iteration on one step: coordinates v, and forces g = f - K v that bodies leave to contact."""

    def __init__(self, ready: OnTangent, problem: SurfaceProblem, u: Vec, drop: float = 0.0) -> None:
        """
        Args:
            u: displacement of all dofs to start from [m].
            drop: share of the first error and residual that is small enough, too; multigrid then stays as it is.
        """
        self.ready, self.operator, self.drop = ready, ready.operator, drop
        self._pose(problem)
        system, time = ready.system, problem.cone.time
        self.v = self.operator.coordinates(system.free_part(u, time))
        self.f = self.operator.forces(problem.load.f_q)
        self.g = self.f - self.operator.product(self.v)
        self.pressed = self.faces.pressed(self.v)
        self.q: Vec = system.T.createVecRight()
        self.earlier: list[tuple[Array, Array]] = []  # corrections that the next can take up again, and K times them
        self.free: Bools | None = None  # of the last tangent
        self.left = np.zeros_like(self.v), np.zeros_like(self.v)  # about the motion that is left, and K times it
        self.expected = np.inf  # energy norm [J^(1/2)] of that motion
        self.reached: tuple[Array, Tangent]  # trial tractions (rows,) [Pa] of the present state, and its tangent
        self.pull, self.stored = self.f, 0.0  # f + 2 T^T K u_s [N] and u_s . K u_s [J] of the motion u_s of supports
        if system.rigid_motion(time) is None:
            u_s = system.prescribed(time)
            forces, free = system.K * u_s, system.T.createVecRight()
            system.T.multTranspose(forces, free)
            self.pull, self.stored = self.f + 2 * self.operator.forces(free), float(forces.dot(u_s))
        # of the displacement at the start: smaller ones are measured against it, for a full release leaves none
        self.least = SLIGHT * self._size()

    def go_to(self, v: Array) -> None:
        """Start from other coordinates v (owned,) [m]; collective."""
        self.v, self.g = v.copy(), self.f - self.operator.product(v)
        self.pressed = self.faces.pressed(self.v)

    def _pose(self, problem: SurfaceProblem) -> None:
        """Take the laws and gaps of a problem; collective."""
        self.problem = problem
        self.faces = CompliantFaces(self.operator, self.ready.coordinates, problem)
        self.points = ContactPoints(self.operator, self.ready.coordinates, problem, self.faces)

    def _follow_touch(self, tangent: Tangent) -> float:
        """Count slip from where points touch now; the change, relative to all motion, 0: they stay; collective."""
        problem = self.problem
        assert problem.touch is not None
        gap = problem.touch(*self._tractions(tangent), problem.gap)
        if gap is problem.gap:
            return 0.0
        self._pose(replace(problem, gap=gap))
        return float(np.abs(gap - problem.gap).max()) / problem.u_ref

    def solve(self, on_step: OnStep) -> Solution:
        """Iterate until the error that is expected is small enough; collective."""
        driver = Driver(self.operator.counters, 0.0, self.ready.method.max_it, on_step)
        found = driver.run(self._iterates(), Stall(USUAL), slow=lambda k, error: self.ready.hurried and k == PATIENCE)
        return self._solution(found)

    def _iterates(self) -> Iterator[Iterate]:
        """Yield relative errors in the energy norm, as they are estimated, and at the end the natural residual."""
        operator, rtol, natural = self.operator, self.ready.method.rtol, self.ready.method.rtol
        expected, slow, touch = np.inf, 0, 1.0 if self.problem.touch else 0.0
        first = 1 if self.earlier else 0  # residual that counts: a good guess is no contraction
        residuals: list[float] = []
        for k in count():
            trial = self._relax()
            self.reached = trial, (tangent := self._tangent(trial))
            r = self._residual(tangent)
            if k == 0 and self.drop:
                natural = max(natural, self.drop * self._natural(tangent))
            size = max(self._size(), self.least)
            self.expected = expected * size
            if touch and expected <= max(rtol, SLIGHT * touch):
                touch = min(touch, self._follow_touch(tangent))
                trial = self._relax()
                self.reached = trial, (tangent := self._tangent(trial))
                r, expected, residuals = self._residual(tangent), np.inf, residuals[-1:]
            if expected <= rtol and (residual := self._natural(tangent)) <= natural:
                yield Iterate(k, residual, enough=True)
            z, K_z = self._direction(tangent, r)
            error = float(np.sqrt(abs(operator.dot(r, z))))
            scale = max(size, error)
            residuals.append(error / scale if scale else error)  # which is zero then, or no number
            rtol = max(rtol, self.drop * residuals[0]) if k == 0 else rtol
            yield Iterate(k, residuals[-1])
            # errors that fall unevenly say little by the last one alone
            latest, mean = _contractions(residuals[first:][-6:])
            # limits of the contraction that is counted on
            contraction = float(np.clip(max(latest, mean), 0.2, 0.9))
            slow += latest > SLOW and len(residuals) > 1 + first and not self.drop
            if slow == 2:
                self._adapt(tangent)
            slow %= 2
            moved, K_moved = self._advance(tangent, r, z, K_z)
            self.left = contraction * moved, contraction * K_moved
            step = float(np.sqrt(max(operator.dot(moved, r), 0.0))) / scale
            expected = contraction / (1 - contraction) * max(residuals[-1], step)

    def _adapt(self, tangent: Tangent) -> None:
        """Hold in multigrid the nodes that are in contact now, if they are others than before; collective.

        Where hardly a point sticks, their normal motions alone are held; or coarse motions are added if bodies float,
        whose rigid motions multigrid would not resist then. Nodes that would leave a body free are not held alone.
        """
        operator, ready, sticking = self.operator, self.ready, self.points.sticking(tangent)
        if ready.surface.floating and ready.coarse is None and sticking < 0.25:  # share of the closed area
            return ready.make_coarse()
        # sticking shares of the closed area below which, and up to which, multigrid lets it slide
        sliding = not ready.surface.floating and sticking < (0.3 if operator.sliding else 0.05)
        touch = self.points.truncated(tangent, np.ones(len(operator.at))) == 0
        touch = (touch | (self.pressed.diagonal[operator.at] > 0)).reshape(-1, operator.dim).any(axis=1)
        was = operator.held.reshape(-1, operator.dim).any(axis=1)
        sums = np.array([(touch != was).sum(), len(was), touch.sum(), was.sum()])
        changed, count, now, before = operator.comm.allreduce(sums)
        # of the slave nodes, and of those that touch; with fewer changes multigrid stays
        others = sliding != operator.sliding or changed > min(0.1 * count, GROWN * max(now, before))
        if others and ready.resists(touch):
            held = operator.at[touch.repeat(operator.dim)] + operator.K_B.getOwnershipRange()[0]
            held = of_all_ranks(operator.comm, held)
            ready.hold(np.intersect1d(held, ready.coordinates.normal) if sliding else held)
        return None

    def _forces(self) -> Array:
        """Forces (m d,) [N] at slave nodes that bodies and compliant faces leave to the points."""
        at = self.operator.at
        return np.asarray(self.g[at] - self.pressed.force[at])

    def _relax(self) -> Array:
        """Sweeps over the contact points; the trial tractions (rows,) [Pa] of the last one."""
        for _ in range(2):
            change, trial = self.points.relax(self.v[self.operator.at], self._forces(), self.pressed)
            self.v[self.operator.at] += change
            self.g[self.operator.slaves.near] -= self.operator.slaves.product(change)
            self.pressed = self.faces.pressed(self.v)
        return trial

    def _move(self, moved: Array, K_moved: Array) -> None:
        self.v += moved
        self.g -= K_moved
        self.pressed = self.faces.pressed(self.v)

    def _tangent(self, trial: Array) -> Tangent:
        return self.points.tangent(self.v[self.operator.at], self._forces(), trial, self.pressed)

    def _residual(self, tangent: Tangent) -> Array:
        r = self.g - self.pressed.force
        r[self.operator.at] = self.points.residual(tangent, r[self.operator.at])
        return r

    def _answer(self, tangent: Tangent, d: Array, K_d: Array) -> Array:
        """The tangent operator on a motion d (owned,), given K d."""
        at, closing = self.operator.at, tangent.pressed.stiffness * self.faces.motion(d)
        found = K_d + self.faces.forces(closing) if self.faces.places else K_d.copy()
        found[at] = self.points.apply(tangent, found[at], d[at], closing / self.problem.surface.W)
        return found

    def _smooth(self, tangent: Tangent, inverse: Array, r: Array, z: Array, K_z: Array, motion: Array) -> Array:
        """A motion (k,) of the nodes around after sweeps over them, the others at rest: Chebyshev's on their blocks.

        Args:
            inverse: see `ContactPoints.inverse_blocks`.
            r, z, K_z: at these nodes (k,): the residual, the motion, and K times the motion of all nodes.
            motion: of compliant faces (rows,) by the motion of all nodes.
        """
        around, here, highest = self.operator.around, self.operator.here, self.operator.highest
        faces, W, more = self.faces, self.problem.surface.W, np.zeros_like(z)
        for k, (again, share) in enumerate(chebyshev(highest / 20, highest, SMOOTHING), 1):
            closing = tangent.pressed.stiffness * motion
            forces = K_z + faces.forces(closing)[around.at] if faces.places else K_z
            left = r - forces
            left[here] = r[here] - self.points.apply(tangent, forces[here], z[here], closing / W)
            more = again * more + share * products(inverse, left)
            z = z + more
            if k < SMOOTHING:
                K_z = K_z + around.block(more)
                motion = motion + faces.motion(around.whole(more, len(self.v))) if faces.places else motion
        return z

    def _direction(self, tangent: Tangent, r: Array) -> tuple[Array, Array]:
        """An approximate solution of the tangent problem, and K times it: multigrid between sweeps at the contact."""
        operator, at, around = self.operator, self.operator.at, self.operator.around
        smooth = partial(self._smooth, tangent, self.points.inverse_blocks(tangent), r[around.at])
        (z, K_z), none = np.zeros((2, len(r))), np.zeros(len(around.at))
        around.move(smooth(none, none, np.zeros(len(self.problem.gap))), z, K_z)
        left = r - self._answer(tangent, z, K_z)
        left[at] = self.points.truncated(tangent, left[at])
        e = operator.cycle(left)
        e[at] = self.points.truncated(tangent, e[at])
        z += e
        K_z += operator.product(e)
        z_a = z[around.at]
        around.move(smooth(z_a, K_z[around.at], self.faces.motion(z)) - z_a, z, K_z)
        return z, K_z

    def _advance(self, tangent: Tangent, r: Array, z: Array, K_z: Array) -> tuple[Array, Array]:
        """Take the best step in the span of z, of earlier corrections, and of coarse motions; returns it, and K it.

        The earlier ones are the last, and that of the iteration in which contact changed: it is none of conjugate
        gradients, and without it all later ones would be conjugate to the one before only (Beale, in Numerical Methods
        for Nonlinear Optimization, 1972): two cubes of tetrahedra would take 49 iterations in place of 34.
        """
        D, K_D = [z], [K_z]
        changed = self._changed(tangent)
        for earlier in self.earlier[-1:] if changed else self.earlier:
            self._add(tangent, *earlier, D, K_D)
        fine = len(D)
        if self.ready.coarse is not None:
            for d, K_d in zip(self.ready.coarse.D, self.ready.coarse.K_D, strict=True):
                self._add(tangent, d, K_d, D, K_D)
        answers = [self._answer(tangent, *x) for x in zip(D, K_D, strict=True)]
        for size in (len(D), fine)[: 1 + (fine < len(D))]:
            share = self._galerkin(D[:size], answers[:size], r)
            c, K_c = (sum(a * x for a, x in zip(share, every, strict=False)) for every in (D, K_D))
            moved, K_moved, lower = self._tried(tangent, c, K_c, 1.0)
            if lower:
                break
        step, kept = 1.0, [] if changed else self.earlier[:1]
        self.earlier = [*kept, (c, K_c)] if lower else []
        while not lower and step > SLIGHT:  # step that is halved no more
            step /= 2
            moved, K_moved, lower = self._tried(tangent, c, K_c, step)
        self._move(moved, K_moved)
        return moved, K_moved

    def _changed(self, tangent: Tangent) -> bool:
        """Whether other motions are held than in the iteration before; collective."""
        before, self.free = self.free, tangent.free
        return bool(self.operator.comm.allreduce(before is None or bool((before != tangent.free).any()), op=MPI.LOR))

    def _add(self, tangent: Tangent, d: Array, K_d: Array, D: list[Array], K_D: list[Array]) -> None:
        """Add a direction (owned,), without what is held, to those of a step."""
        at = self.operator.at
        D.append(d.copy())
        K_D.append(K_d.copy())
        self.operator.slaves.move(self.points.truncated(tangent, d[at]) - d[at], D[-1], K_D[-1])

    def _tried(self, tangent: Tangent, c: Array, K_c: Array, step: float) -> tuple[Array, Array, bool]:
        """The admissible motion next to a step along c, K times it, and whether the energy does not grow."""
        operator, v = self.operator, self.v[self.operator.at]
        beside = self.points.project(tangent, v, v + step * c[operator.at]) - v - step * c[operator.at]
        moved, K_moved = step * c, step * K_c
        operator.slaves.move(beside, moved, K_moved)
        # of the energy: a growth that counts as none
        allowed = EXACT * abs(operator.dot(self.v, self.f) + operator.dot(self.v, self.g)) / 2
        return moved, K_moved, self._growth(tangent, moved, K_moved) <= allowed

    def _galerkin(self, D: list[Array], AD: list[Array], r: Array) -> Array:
        """Shares (k,) of the k directions D (owned,) in the solution of A x = r in their span; collective."""
        found = self.operator.comm.allreduce(np.array([[d @ x for x in (*AD, r)] for d in D]))
        G, rhs = found[:, :-1], found[:, -1]
        scale = 1 / np.sqrt(np.where(np.diag(G) > 0, np.diag(G), 1.0))
        return np.asarray(scale * np.linalg.lstsq(G * scale[:, None] * scale, rhs * scale, rcond=EXACT)[0])

    def _growth(self, tangent: Tangent, moved: Array, K_moved: Array) -> float:
        """Growth of the energy [J] by a motion, friction bounds frozen; collective."""
        v = self.v[self.operator.at]
        friction = self.points.friction_work(tangent, v, v + moved[self.operator.at])
        bodies = float(moved @ K_moved / 2 - moved @ self.g)
        faces = self.faces.growth(self.pressed, self.v, moved)
        comm = self.operator.comm
        return float(comm.allreduce(bodies + friction + (faces if comm.rank == 0 else 0.0)))  # every rank has the faces

    def _size(self) -> float:
        """Energy norm of the displacement [J^(1/2)]."""
        energy = self.operator.dot(self.v, self.pull) - self.operator.dot(self.v, self.g) + self.stored
        return float(np.sqrt(max(energy, 0.0)))

    def _tractions(self, tangent: Tangent) -> tuple[Array, Array]:
        """Tractions and relative displacement (rows,); leaves the displacement of all free dofs in `q`."""
        self.operator.displacement(self.v, self.q)
        w = self.problem.relative_displacement(matrix_free(self.problem.surface).volume.contact.read(self.q))
        return self.points.gathered(tangent.p), w

    def _natural(self, tangent: Tangent) -> float:
        """The natural residual, or the imbalance of bodies that float if that is larger; collective."""
        p, w = self._tractions(tangent)
        return self.problem.surface.agreed(max(self.problem.natural_residual(p, w), self.problem.imbalance(p)))

    def _solution(self, found: Solution) -> Solution:
        """The solution at the present state, with the status and the history that were found."""
        problem, surface, (trial, tangent) = self.problem, matrix_free(self.problem.surface), self.reached
        p, w = self._tractions(tangent)
        p = problem.project(p + problem.weight * (w - problem.gap), problem.weight)
        if found.status is not Status.NOT_FINITE:
            surface.found(p, self.q.copy())
        u_c = surface.volume.contact.read(self.q)
        self._move(*self.left)
        after, w_after = self._tractions(self._tangent(trial))
        expected = self.expected if np.isfinite(self.expected) else 0.0
        own = Correction(p=MARGIN * (after - p), w=MARGIN * (w_after - w), size=MARGIN * expected)

        kept = self.points.gathered(((tangent.spring > 0) | ~tangent.free).astype(float)) > 0
        kept[: surface.normal_rows] = False

        def correct(before: Correction) -> Correction:
            """Errors of earlier steps live on in where points stick; those of several steps are independent."""
            known, w_kept = float(np.linalg.norm(before.w[surface.normal_rows :])), np.where(kept, before.w, 0.0)
            share = float(np.linalg.norm(w_kept)) / known if known else 0.0
            size = float(np.hypot(own.size, share * before.size))
            return Correction(own.p + share * before.p, own.w + w_kept, size)

        return replace(found, p=p, w=w, u_c=u_c, correct=correct, gap=problem.gap if problem.touch else None)


def _contractions(residuals: list[float]) -> tuple[float, float]:
    """That of the last iteration, and the mean one of all; of less than two residuals what is counted on.

    >>> _contractions([8.0, 4.0, 1.0])
    (0.25, 0.3535533905932738)
    """
    if len(residuals) < 2 or min(residuals) == 0:
        return UNKNOWN, UNKNOWN
    *earlier, last = residuals
    return last / earlier[-1], float((last / earlier[0]) ** (1 / len(earlier)))
