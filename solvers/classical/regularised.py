"""Regularised: friction smoothed in UFL and rigid contact by penalty, Newton (SNES) on the whole volume.

What a FEniCSx user would write today, with three additions: the scales of the scene set the width of the smoothing,
continuation from coarse to fine levels leads to it, and the error of the smoothing is reported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from petsc4py import PETSc
from scipy import sparse
from scipy.sparse.linalg import splu

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.amplitude import value_at
from stickslip.geometry.arrays import CLOSE, Array
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Mat, Vec
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.fem.contact_forms import SmoothedContact, Widths
from stickslip.solvers.interface.factorised import METIS
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Correction, OnStep, Solution, Status, Step, ignore
from stickslip.solvers.laws.friction import Tresca
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.methods.method import RIGID, Applicability, Before, Method, Ready, Setup, Solve
from stickslip.solvers.newton.correction import ENOUGH, MARGIN
from stickslip.solvers.parallel.replicated import Replicated
from stickslip.solvers.system.nodal_contact import FormOfPart, NodalContact, relative_to_obstacle
from stickslip.solvers.system.system import System


class SmoothedForces:
    """Contact forces B^T p of all contacts as a function of the free displacements q, u = T q + u_s."""

    def __init__(self, system: System) -> None:
        """Compile the forms; collective."""
        self.system = system
        self.widths = Widths.of(system.weak)
        self.contacts = [Nodal(system, rows, self.widths) for rows in system.contacts]
        self.parts = [part for contact in self.contacts for part in contact.parts()]

    def begin(self, u: Vec, motion: Mapping[str, Array], cone: AdmissibleSet, touched: Array) -> None:
        """Start a step.

        Args:
            u: displacement [m] at the last accepted step, over all displacements.
            motion: motion (n, d) [m] of each contact's obstacle at that step, by contact.
            cone: of the step.
            touched: relative motion (rows,) [m] from there to where slip is counted from, in tangential rows.
        """
        u_s = self.system.prescribed(cone.time)
        for contact, place in zip(self.contacts, cone.places, strict=True):
            further = contact.rows.node_traction(touched[place.tangential].reshape(-1, place.components))
            contact.begin(u, motion[contact.rows.name], further, u_s, cone.time)

    def forces(self, q: Vec) -> Vec:
        """B^T p [N] over the free displacements."""
        total = q.duplicate()
        for part in self.parts:
            part.at(q)
            part.add_forces(total)
        return total

    def add_tangent(self, q: Vec, J: Mat) -> None:
        """J += d forces / d q."""
        for part in self.parts:
            part.at(q)
            part.add_tangent(J)


class Nodal:
    """One contact: its forms, and their data at the nodes of its surface."""

    def __init__(self, system: System, rows: ContactRows, widths: Widths) -> None:
        contact, weak = system.problem.pairs[rows.name].contact, system.weak
        self.system, self.rows = system, rows
        self.bound = weak.constant(0.0)
        self.nodal = NodalContact(system, rows)
        self.forms = SmoothedContact(weak, self.nodal.rule, contact, widths, self.bound)
        self.P = self.nodal.change.matMult(system.T) if self.nodal.change else system.T
        dx.fill(self.forms.normal, self.nodal.spread(rows.frames[:, 0].ravel()).array_r)
        self.relative_shift, self.motion_shift = system.vector(), system.vector()

    def parts(self) -> list[FormOfPart]:
        """The forms, compiled."""
        compile_, found = self.system.weak.compile, []
        for field, work, tangent in self.forms.works():
            nodal = field is self.forms.motion
            P, shift = (self.P, self.motion_shift) if nodal else (self.system.T, self.relative_shift)
            found.append(FormOfPart(field, P, shift, compile_(work), compile_(tangent)))
        return found

    def begin(self, u: Vec, motion: Array, touched: Array, u_s: Vec, time: float) -> None:
        """Set the data of a step.

        Args:
            u: displacement [m] at the last accepted step, over all displacements.
            motion: motion (n, d) [m] of the obstacle at that step.
            touched: relative motion (n, d) [m] of the nodes from there to where slip is counted from.
            u_s: prescribed displacement [m] at `time`, over all displacements.
            time: end of the step [s].
        """
        end, law = self.system.problem.timeline.end, self.rows.friction
        if isinstance(law, Tresca):
            self.bound.value = value_at(law.bound, time, end)
        before = self._motion(u - self.nodal.spread(motion.ravel())) + self.nodal.spread(touched.ravel())
        dx.fill(self.forms.before, before.array_r)
        relative = relative_to_obstacle(self.system, self.rows.name, u_s, time)
        relative.copy(self.relative_shift)
        self._motion(relative).copy(self.motion_shift)

    def _motion(self, relative: Vec) -> Vec:
        """Relative displacement [m] in the basis phi~, less g n."""
        motion = self.nodal.coefficients(relative)
        motion.axpy(-1.0, self.nodal.spread((self.rows.node_gap[:, None] * self.rows.frames[:, 0]).ravel()))
        return motion


FACTOR = 10**0.5  # from level to level; with 10, Newton's method becomes slow
PENETRATION = 4 * float(np.finfo(float).eps)  # rounding of a penetration, relative to u_ref
NEWTON_STEPS = 50  # at one level; about six are enough if the levels before are a good start
SLIPPING = 10  # a point that has moved by more than this many eps counts as slipping


def levels(smoothing: float) -> tuple[float, ...]:
    """Levels of smoothing, relative to u_ref and p_ref; at least two: their difference gives the error estimate.

    >>> [round(level, 3) for level in levels(0.1)]
    [1.0, 0.316, 0.1]
    """
    # tolerance on the number of levels, so that rounding adds no level
    count = max(int(np.ceil(-np.log(smoothing) / np.log(FACTOR) - CLOSE)), 1)
    return tuple(smoothing * FACTOR**k for k in range(count, -1, -1))


@dataclass(frozen=True, kw_only=True)
class Regularised(Method):
    """t = s Du_T / sqrt(|Du_T|² + eps²), and p_n = (u_n - g)_+ / delta where the normal law is rigid.

    eps = level u_ref, delta = level u_ref / p_ref; the level decreases from about 1 to `smoothing` by factors of
    sqrt(10), and each level starts from the ones before. The laws hold at the nodes, with the weights of the other
    methods' multipliers: as the level decreases, the answer tends to theirs. Two differences vanish only with the mesh
    size: at a compliant contact the friction bound follows the pressure at the node, not its average around the node;
    and the contact force at a node with prescribed motion is not distributed to its neighbours.

    The reported error is an estimate in the energy norm. It is an upper bound if the error e decreases at least like
    the square root of the level: then e_L <= |u_(L-1) - u_L| / (10^(1/4) - 1). For Tresca's law, smoothing alone gives
    e <= (2 eps ∫ s ds)^(1/2); if few points are close to slip, e is proportional to the level.
    A sticking point creeps by about eps in each step, and the next step starts from there: the errors of the steps
    are added up.
    """

    NAME: ClassVar = "regularised"
    WHEN: ClassVar = (
        "the baseline, what one would write in UFL: penalty, smoothed friction, SNES on the whole volume; states "
        "its error, which falls like `smoothing`"
    )
    EXACT_LAWS: ClassVar = False
    WORKS_WITH: ClassVar = Applicability(
        shared=False,
        floating=False,
        normal=("unilateral", "bilateral", "compliance"),
        friction=("coulomb", "tresca"),
        k_T=False,
        fields=False,
        operators=(RIGID,),
    )
    ROW: ClassVar = 7

    smoothing: Annotated[
        float,
        Key("-", "regularised: slip and penetration that its laws are rounded off by, in units of u_ref of a step"),
    ] = 1e-4

    def __post_init__(self) -> None:
        super().__post_init__()
        require(0 < self.smoothing <= 1, "smoothing", self.smoothing, "must be above 0 and at most 1, for example 1e-4")

    def build(self, setup: Setup) -> Ready:
        for c in setup.system.contacts:
            if c.of_points is not None:
                why = "regularised has laws stiffer than cells on flat sides alone; lower c_n, or use condensed-newton"
                raise SceneError(f"contacts.{c.name}.normal.law = compliance: {why}")
        return OnVolume(self, setup.system, setup.surface)


class OnVolume(Ready):
    """The compiled smoothed laws of a system."""

    def __init__(self, method: Regularised, system: System, surface: DelassusOperator) -> None:
        """Compile the forms; collective."""
        self.method, self.system = method, system
        self.contact_dofs = Replicated(system.K_B.createVecRight(), system.interface.dofs)
        self.contact = SmoothedForces(system)
        self.rows = _Recovery(system, surface)
        self.rtol, self.max_it = method.rtol, method.max_it
        self.levels = levels(method.smoothing)

    def renewed(self, setup: Setup) -> Ready:
        """Build again: the forms hold gaps and coefficients of friction."""
        return self.method.build(setup)

    def after(self, state: Before) -> Solve:
        return NextStep(self, state)


@dataclass(frozen=True)
class NextStep:
    """Solver of one step on the whole volume."""

    method: OnVolume
    before: Before  # the last accepted step

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        """Solve one step.

        The status is that of SNES at the last level. `residual` is the natural residual; smoothing keeps it above zero.
        The residuals of the history are those of SNES: |R|_2 relative to the nodal forces of a uniform pressure p_ref.

        Args:
            problem: the contact problem of the step.
            p: tractions (rows,) [Pa], not used but where nothing is loaded.
            on_step: called after each iteration.
        """
        if problem.p_ref == 0 or not len(p):  # no load and no motion, or no contact rows
            u_c = problem.contact_displacement(p)
            w = problem.relative_displacement(u_c)
            return Solution(p, w, u_c, Status.CONVERGED, 0.0, ())
        method, u = self.method, self.before.u
        self.begin(problem)
        newton = VolumeNewton(method, problem, on_step)
        found, status = [method.system.free_part(u, problem.cone.time)], Status.CONVERGED
        for level in method.levels:
            method.contact.widths.set(level, problem.u_ref, problem.p_ref)
            found.append(_predicted(found))
            status = newton.solve(found[-1], level)
            if status is not Status.CONVERGED:
                break
        q, step = found[-1], found[-1] - found[-2]
        apart = float(np.sqrt(max((method.system.K_B * step).dot(step), 0.0)))
        left = newton.left(q, level) if status is Status.CONVERGED else np.nan

        def correct(before: Correction) -> Correction:  # errors of all steps are added, as those of the laws are
            return replace(Correction.none(len(p)), size=before.size + left)

        newton.snes.destroy()  # breaks the reference cycle with its callbacks
        u_c = method.contact_dofs.read(q)
        w = problem.relative_displacement(u_c)
        read, given = method.contact_dofs.read, newton.f - method.system.K_B * q
        p = method.rows.tractions(w - problem.gap, asked=read(method.contact.forces(q)), given=read(given))
        residual = problem.natural_residual(p, w)
        history = tuple(newton.history)
        law_error, slack = apart / (np.sqrt(FACTOR) - 1), 1 - SLIPPING / np.hypot(SLIPPING, 1)
        return Solution(
            p, w, u_c, status, residual, history, law_error=float(law_error), correct=correct, slack=float(slack)
        )

    def begin(self, problem: SurfaceProblem) -> None:
        """Set the data of the forms."""
        before = self.before
        self.method.contact.begin(before.u, before.motion, problem.cone, problem.gap - before.w)


def _predicted(found: list[Vec]) -> Vec:
    """Start of the next level, extrapolated: penetration and the creep of sticking points are linear in the level."""
    if len(found) < 3:
        return found[-1].copy()
    return found[-1] + (found[-1] - found[-2]) / FACTOR


class VolumeNewton:
    """Newton with line search for K_B q + contact(q) = f; one LU factorisation in each iteration."""

    def __init__(self, method: OnVolume, problem: SurfaceProblem, on_step: OnStep) -> None:
        system = method.system
        self.method, self.problem, self.on_step = method, problem, on_step
        self.history: list[Step] = []
        self.iteration, self.solved = 0, False
        weights = np.concatenate([c.node_weights for c in system.contacts])
        self.scale = problem.p_ref * float(np.linalg.norm(weights))
        time = problem.cone.time
        self.f = system.pull(time, system.load(time), system.prescribed(time))
        self.snes = self._snes(system.K_B)

    def solve(self, q: Vec, level: float) -> Status:
        """Overwrite q with the solution at a level, to the tolerance or to the rounding of penetrations."""
        allowed = self.method.max_it - self.iteration
        atol = max(self.method.rtol, PENETRATION / level) * self.scale
        self.snes.setTolerances(rtol=0.0, atol=atol, stol=0.0, max_it=min(allowed, NEWTON_STEPS))
        self._solve(q)
        if self.snes.getConvergedReason() > 0:
            return Status.CONVERGED
        if not np.isfinite(self.snes.getFunctionNorm()):
            return Status.NOT_FINITE
        return Status.MAX_IT if self.iteration >= self.method.max_it else Status.STALLED

    def left(self, q: Vec, level: float) -> float:
        """Energy norm [J^(1/2)] between q [m] and the solution at its level, to which Newton's method goes on."""
        system, self.solved = self.method.system, True
        exact = q.copy()
        atol = max(ENOUGH * self.history[-1].residual, PENETRATION / level) * self.scale
        self.snes.setTolerances(rtol=0.0, atol=atol, stol=0.0, max_it=5)  # to measure what was left
        self.snes.setForceIteration(True)
        with system.counters.for_error():
            self._solve(exact)
        moved = exact - q
        return MARGIN * float(np.sqrt(max((system.K_B * moved).dot(moved), 0.0)))

    def _solve(self, q: Vec) -> None:
        """Newton's method from q [m], in place."""
        try:
            self.snes.solve(None, q)
        except PETSc.Error as error:  # newer petsc4py wraps what a callback raises, Ctrl-C too
            raise error.__cause__ or error from None

    def _snes(self, K: Any) -> Any:
        snes = PETSc.SNES().create(K.comm)
        snes.setOptionsPrefix("regularised_")
        snes.setType("newtonls")
        snes.setFunction(self._residual, K.createVecRight())
        snes.setJacobian(self._jacobian, K.duplicate(copy=True))
        snes.setMonitor(self._record)
        ksp = snes.getKSP()
        ksp.setType("preonly")
        pc = ksp.getPC()
        pc.setType("lu")
        pc.setFactorSolverType("mumps")
        PETSc.Options()["regularised_mat_mumps_icntl_7"] = METIS
        snes.setFromOptions()
        return snes

    def _residual(self, snes: Any, q: Any, R: Any) -> None:
        self.method.system.K_B.mult(q, R)
        R -= self.f
        R += self.method.contact.forces(q)

    def _jacobian(self, snes: Any, q: Any, J: Any, preconditioner: Any) -> None:
        self.method.system.K_B.copy(J, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)  # J has those of contact, too
        self.method.contact.add_tangent(q, J)
        self.method.system.counters.factorisations += 1
        self.method.system.counters.volume_solves += 1

    def _record(self, snes: Any, iteration: int, norm: float) -> None:
        if self.solved:
            return
        self.iteration += iteration > 0
        step = Step(self.iteration, norm / self.scale, self.problem.volume_solves)
        if iteration == 0 and self.history:  # where a level begins is where the one before ended
            self.history[-1] = step
            return
        self.history.append(step)
        self.on_step(step)


class _Recovery:
    """Recovers tractions p from forces B^T p on the contact dofs."""

    def __init__(self, system: System, surface: DelassusOperator) -> None:
        self.surface = surface
        self.compliant: list[tuple[slice, Compliance]] = []
        start = 0
        for c in system.contacts:
            rows = slice(start, start := start + len(c.W_n))
            if isinstance(c.normal, Compliance):
                self.compliant.append((rows, c.normal))
        self.nodal = np.ones(len(surface.W), bool)
        for rows, _ in self.compliant:
            self.nodal[rows] = False
        self.N = surface.N[self.nodal]
        gram = self.N @ self.N.T
        empty = gram.diagonal() == 0  # directions in which a support prescribes the node
        self.gram = splu((gram + sparse.diags(empty.astype(float))).tocsc()) if self.nodal.any() else None

    def tractions(self, r: Array, asked: Array, given: Array) -> Array:
        """Tractions p (rows,) [Pa] whose N^T W p is the contact force on the bodies.

        Compliant pressures follow from their law at w - gap, all others from the force.

        Args:
            r: w - gap (rows,) [m].
            asked: force (c,) [N] from the laws: exactly 0 at open points, elsewhere with the rounding of penetrations.
            given: force (c,) [N] from the equilibrium of the bodies: the same with less rounding.
        """
        p = np.zeros_like(r)
        for rows, law in self.compliant:
            p[rows] = law.pressure(r[rows])
        if self.gram is not None:
            compliant, W = self.surface.forces(p), self.surface.W[self.nodal]
            found, touching = self.gram.solve(self.N @ (given - compliant)) / W, self.N @ (asked - compliant) != 0
            p[self.nodal] = np.where(touching, found, 0.0)
        return p
