"""Perturbed Lagrangian: Newton-Raphson with contact elements, which stick or slide through stiff springs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import CLOSE, LAST_DIGITS, Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.solvers.classical.contact_element import STICK, Answer, ContactElements, held_from, penalties
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Correction, Driver, Iterate, OnStep, Solution, Status, ignore
from stickslip.solvers.methods.method import Applicability, Before, Method, Ready, Setup, Solve
from stickslip.solvers.newton.condensed_system import saddle_point
from stickslip.solvers.newton.correction import ENOUGH, MARGIN, elastic_norm, exact_problem
from stickslip.solvers.system.system import System

FACTOR = 10.0  # from one level of ω to the next
DETOURS = 8  # largest number of additional levels, inserted where Newton's method stalls
NEWTON_STEPS = 20  # at one level; about six are enough if the level before is a good start


@dataclass(frozen=True, kw_only=True)
class PerturbedLagrangian(Method):
    """K (ΔU, ΔΣ) = -R with K = K_B + Σ_s K_C^s, R = R_B + Σ_s R_C^s, and a line search on |R|.

    Continuation in ω: springs are first as soft as the bodies, E / depth, then stiffer by factors of 10 up to the final
    ω. Each level starts from the extrapolation of the two levels before, because the solution is smooth in 1/ω except
    where a status changes. With the final ω at once, the status of the elements cycles in Newton's iteration. Floating
    bodies start with every element bonded. K_B is condensed to the contact dofs; ΔΣ is eliminated element by element,
    because -1/ω is never zero.

    With `augment` the springs of all rows then start again from the tractions found, until the natural residual of the
    laws themselves is below the tolerance: two or three Newton steps.

    The residuals of the history are natural residuals without the extension of the springs; the residual of the
    solution includes it. The error that the springs cause is reported: (u_ω, p_ω) solves the exact contact laws with
    gaps changed by Δp_ω / ω, Δp_ω being the difference from what the springs started from. With fixed friction bounds
    its error is therefore, by monotonicity, at most the energy norm of the displacement v of least energy with
    N v = Δp_ω / ω: first order in 1/ω. With Coulomb's law, whose bounds change too, this is an estimate.

    Source: Pop (1999), (4.3)-(4.5), section 4; Wriggers & Simo, Comm. Appl. Numer. Methods 1 (1985).
    """

    NAME: ClassVar = "perturbed-lagrangian"
    WHEN: ClassVar = (
        "stiff springs in contact elements, Newton's method; `augment = false` as published: it then states its error, "
        "which falls like 1/`omega_factor`: 6e-5 to 3e-4 in the energy norm on the ready scenes tried"
    )
    EXACT_LAWS: ClassVar = False
    WORKS_WITH: ClassVar = Applicability(
        floating=True, normal=("unilateral", "bilateral", "tied"), rates=False, matrix_free=False, contends=False
    )
    ROW: ClassVar = 8

    omega_factor: Annotated[
        float, Key("-", "perturbed-lagrangian: its penalties, in units of E / h of the facets that touch")
    ] = 1000.0

    augment: Annotated[
        bool, Key("-", "perturbed-lagrangian: start its springs again until the laws hold; false: as published")
    ] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.omega_factor > 0, "omega_factor", self.omega_factor, "must be positive, for example 1000")

    def build(self, setup: Setup) -> Ready:
        return OnSprings(self, self.penalties(setup.system))

    def penalties(self, system: System) -> Array:
        """Penalties per area (rows,) [Pa/m], see `contact_element.penalties`."""
        return penalties(system, self.omega_factor)


@dataclass(frozen=True)
class OnSprings(Ready):
    """The iteration with the contact elements of a system."""

    method: PerturbedLagrangian
    omega: Array  # penalties per area (rows,) [Pa/m]

    def renewed(self, setup: Setup) -> Ready:
        """Build again: the springs depend on the contact rows."""
        return self.method.build(setup)

    def after(self, state: Before) -> Solve:
        return lambda problem, p, on_step: self._solve(problem, state.p, on_step)

    def _solve(self, problem: SurfaceProblem, p: Array, on_step: OnStep) -> Solution:
        """Solve one step from tractions p (rows,) [Pa] at its beginning, which springs keep."""
        u_c = np.zeros(problem.surface.size) if problem.surface.floating else problem.contact_displacement(p)
        if problem.p_ref == 0 or not len(p):  # no load and no motion, or no contact rows
            w = problem.relative_displacement(u_c)
            return Solution(p, w, u_c, Status.CONVERGED, 0.0, ())
        start, held = (u_c, problem.surface.W * p), held_from(problem, p)
        newton = Newton(problem, self.method.max_it, on_step, *start)
        status = self._harden(newton, held, self.method.rtol)
        since, omega = p, self.omega  # what the springs kept from the last step is no error of this one
        if status is Status.CONVERGED and self.method.augment:
            status, since, omega = self._augment(newton, since)

        def correct(before: Correction) -> Correction:
            """Newton's method goes on at the final ω; if it stalls, all levels are solved to the smaller tolerance."""
            exact, own = exact_problem(problem, before), held_from(problem, p + before.p)
            rtol = max(ENOUGH * newton.driver.history[-1].residual, LAST_DIGITS)
            further = Newton(exact, NEWTON_STEPS, ignore, newton.u_c, newton.Sigma)
            ended = further.solve(self.omega, own, rtol)
            if ended is not Status.CONVERGED:
                further = Newton(exact, self.method.max_it, ignore, *start)
                ended = self._harden(further, own, rtol)
            moved, force = further.u_c - newton.u_c, further.Sigma - newton.Sigma
            size = MARGIN * elastic_norm(problem, moved) if ended is Status.CONVERGED else np.nan
            return Correction(force / problem.surface.W, problem.surface.N @ moved, size)

        return Solution(
            newton.p,
            newton.w,
            newton.u_c,
            status,
            newton.defect,
            tuple(newton.driver.history),
            law_error=least_energy(problem, (newton.p - since) / omega),
            correct=None if self.method.augment else correct,  # with it the laws themselves hold
        )

    def _harden(self, newton: Newton, held: Array, rtol: float) -> Status:
        """Solve level by level up to the final ω.

        Args:
            newton: state of the iteration, at the start of the step.
            held: tractions (rows,) [Pa] that the springs start from.
            rtol: tolerance on the natural residual at the final ω.
        """
        problem = newton.problem
        path, detours = list(self._path(problem)), DETOURS
        if problem.surface.floating:
            newton.bond(self._softened(path[0], problem), held)
        while path:
            h = path[0]
            # residual of a softer level at which its status of all elements is a good start for the next level
            status = newton.follow(h, self._softened(h, problem), held, rtol if h == 0 else max(rtol, 1e-8))
            if status is Status.STALLED and newton.reached and detours:
                detours -= 1
                before = newton.reached[-1][0]
                path.insert(0, np.sqrt(before * h) if h else before / FACTOR)
                continue
            if status is not Status.CONVERGED:
                break
            path.pop(0)
        return status

    def _augment(self, newton: Newton, held: Array) -> tuple[Status, Array, Array]:
        """Start the springs again from the tractions found, until these obey the laws themselves.

        Each time the defect falls by about `omega_factor`: the method of multipliers. Where Newton's method stalls,
        softer springs do, in more turns.

        Returns:
            The status, the tractions (rows,) [Pa] that the springs started from at last, and their penalties.
        """
        omega, softer, before = self.omega, 3, np.inf  # times that the springs are made softer where they start again
        while newton.defect > self.method.rtol:
            if newton.defect > 0.9 * before:  # it falls by too little
                return Status.STALLED, held, omega
            before, held, at = newton.defect, newton.p, (newton.u_c, newton.Sigma)
            status = newton.solve(omega, held, self.method.rtol)
            if status is Status.STALLED and softer:
                omega, softer, before, (newton.u_c, newton.Sigma) = omega / FACTOR, softer - 1, np.inf, at
            elif status is not Status.CONVERGED:
                return status, held, omega
        return Status.CONVERGED, held, omega

    def _path(self, problem: SurfaceProblem) -> Array:
        """Levels: flexibilities h (levels,) added to 1/ω, relative to 1/gamma of the bodies; decreasing to 0."""
        steps = np.ceil(np.log(np.max(self.omega / problem.gamma)) / np.log(FACTOR))
        return np.append(FACTOR ** -np.arange(max(steps, 0.0) + 1), 0.0)

    def _softened(self, h: float, problem: SurfaceProblem) -> Array:
        """Penalties (rows,) [Pa/m] at level h."""
        return np.asarray(1 / (1 / self.omega + h / problem.gamma))


class Newton:
    """State of the iteration, and its history over all levels."""

    def __init__(self, problem: SurfaceProblem, max_it: int, on_step: OnStep, u_c: Array, Sigma: Array) -> None:
        """Start in equilibrium.

        Args:
            max_it: largest number of iterations over all levels.
            on_step: called after each iteration.
            u_c: displacement (c,) [m] of the contact dofs.
            Sigma: forces (rows,) [N] in equilibrium with it.
        """
        self.problem, self.u_c, self.Sigma = problem, u_c, Sigma
        self.driver = Driver(problem.surface.counters, 0.0, max_it, on_step)
        self.reached: list[tuple[float, Array, Array]] = []  # solved levels: h, displacement, forces
        self.iteration = 0

    @property
    def p(self) -> Array:
        """Tractions (rows,) [Pa]."""
        return self.Sigma / self.problem.surface.W

    @property
    def w(self) -> Array:
        """Relative displacement (rows,) [m]."""
        return self.problem.relative_displacement(self.u_c)

    @property
    def defect(self) -> float:
        """Natural residual of the laws themselves, without springs [-]."""
        return self.problem.natural_residual(self.p, self.w)

    def bond(self, omega: Array, held: Array) -> None:
        """Solve with every element closed and sticking, so that contact holds a floating body.

        Args:
            omega: penalties per area (rows,) [Pa/m].
            held: tractions (rows,) [Pa] that the springs start from.
        """
        elements = ContactElements.of(self.problem, omega, held)
        G = elements.gaps(self.u_c)
        stuck = Answer(elements.omega * G, sparse.diags(elements.omega).tocsr(), np.full(len(G), STICK))
        Delta_U, Delta_Sigma = newton_step(elements, stuck, self.u_c, self.Sigma)
        self.u_c, self.Sigma = self.u_c + Delta_U, self.Sigma + Delta_Sigma
        self.iteration += 1

    def follow(self, h: float, omega: Array, held: Array, rtol: float) -> Status:
        """Solve at level h, from the extrapolation of the last two solved levels.

        Args:
            h: flexibility added to 1/ω, see `_path`.
            omega: penalties per area (rows,) [Pa/m] at that level.
            held: tractions (rows,) [Pa] that the springs start from.
            rtol: tolerance on the natural residual.
        """
        if self.reached:
            _, self.u_c, self.Sigma = self.reached[-1]
        if len(self.reached) > 1:
            (h_0, *x_0), (h_1, *x_1) = self.reached[-2:]
            part = (h - h_1) / (h_1 - h_0)
            self.u_c, self.Sigma = (new + part * (new - old) for old, new in zip(x_0, x_1, strict=True))
        status = self.solve(omega, held, rtol)
        if status is Status.CONVERGED:
            self.reached.append((h, self.u_c, self.Sigma))
        return status

    def solve(self, omega: Array, held: Array, rtol: float) -> Status:
        """Iterate from the current state to the solution with penalties omega (rows,) [Pa/m]; see `follow`."""
        return self.driver.run(self._iterates(omega, held, rtol), otherwise=Status.STALLED).status

    def _iterates(self, omega: Array, held: Array, rtol: float) -> Iterator[Iterate]:
        problem, elements = self.problem, ContactElements.of(self.problem, omega, held)
        for k in range(NEWTON_STEPS + 1):
            self.iteration += k > 0  # the first measure of a level is no iteration: it belongs to the start
            springs = (self.p - held) / omega
            residual = problem.natural_residual(self.p, self.w - springs)
            # with stiff springs, forces converge before the displacement does
            enough = residual <= rtol and k > 0 and self._balanced(elements)
            yield Iterate(self.iteration, residual, enough=enough)
            self._advance(elements)

    def _balanced(self, elements: ContactElements) -> bool:
        """Whether R_U is zero, as the natural residual assumes; a nearly singular solve may leave a force."""
        R_U, _ = residual(elements, elements.answer(elements.gaps(self.u_c)), self.u_c, self.Sigma)
        # largest unbalanced force of a solved level, relative to the force of p_ref
        return bool(np.abs(R_U).sum() <= CLOSE * self.problem.p_ref * self.problem.surface.W.sum())

    def _advance(self, elements: ContactElements) -> None:
        """One Newton step, halved until |R| decreases; if it never does, the length with the smallest |R|."""
        answer = elements.answer(elements.gaps(self.u_c))
        before = self._size(elements, self.u_c, self.Sigma)
        Delta_U, Delta_Sigma = newton_step(elements, answer, self.u_c, self.Sigma)
        best = np.inf
        for part in 0.5 ** np.arange(7):  # shorter steps bring no progress
            u_c, Sigma = self.u_c + part * Delta_U, self.Sigma + part * Delta_Sigma
            size = self._size(elements, u_c, Sigma)
            if size < best:
                best, found = size, (u_c, Sigma)
            if best <= (1 - 1e-4 * part) * before:  # Armijo
                break
        if np.isfinite(best):
            self.u_c, self.Sigma = found

    def _size(self, elements: ContactElements, u_c: Array, Sigma: Array) -> float:
        """|R| [-]: the part R_U relative to p_ref, and the part R_Σ relative to u_ref."""
        problem = self.problem
        R_U, R_Sigma = residual(elements, elements.answer(elements.gaps(u_c)), u_c, Sigma)
        force = problem.p_ref * np.linalg.norm(problem.surface.W)
        return float(np.hypot(np.linalg.norm(R_U) / force, np.linalg.norm(R_Sigma) / problem.u_ref))


def residual(elements: ContactElements, answer: Answer, u_c: Array, Sigma: Array) -> tuple[Array, Array]:
    """R = R_B + Σ_s R_C^s: R_U at the contact dofs (c,) [N], and R_Σ of the equations of the forces (rows,) [m]."""
    R_C, R_Sigma = elements.residual(Sigma, answer)
    return condensed(elements.problem.surface).S @ u_c - elements.problem.load.f_c + R_C, R_Sigma


def newton_step(elements: ContactElements, answer: Answer, u_c: Array, Sigma: Array) -> tuple[Array, Array]:
    """ΔU (c,) [m] and ΔΣ (rows,) [N] with K (ΔU, ΔΣ) = -R.

    ( K_B       N^T  ) ( ΔU )     ( R_U )
    ( Σ*'N/ω   -1/ω  ) ( ΔΣ ) = - ( R_Σ )

    The unknowns are y = Σ*'N ΔU of the elements that bear, and the rigid motions b of floating bodies.
    """
    surface = condensed(elements.problem.surface)
    R_U, R_Sigma = residual(elements, answer, u_c, Sigma)
    to_dofs, to_forces, K_C = elements.tangent(answer)
    give = -1 / K_C.diagonal()  # ω
    follows = sparse.diags(give).tocsr() @ to_forces  # ΔΣ = ω (R_Σ + Σ*'N/ω ΔU)
    rows, R, right = np.flatnonzero(np.diff(answer.slope.indptr)), surface.R, -R_U - to_dofs @ (give * R_Sigma)
    F, C, u_0 = follows[rows], to_dofs.tocsc()[:, rows], surface.flexibility @ right
    K = np.eye(len(rows)) + surface.coupling(answer.slope[rows], sparse.eye(len(give), format="csc")[:, rows])
    hold = LAST_DIGITS * surface.rho * np.eye(R.shape[1])  # of what no element holds: a long step, to be shortened
    y, b = saddle_point(K, -(F @ R), R.T @ C, hold, F @ u_0, R.T @ right)
    Delta_U = u_0 - surface.flexibility @ (C @ y) + R @ b
    return Delta_U, give * R_Sigma + follows @ Delta_U


def least_energy(problem: SurfaceProblem, w: Array) -> float:
    """Energy norm [J^(1/2)] of the displacement of least energy whose relative displacement is w (rows,) [m].

    For floating bodies the energy of the augmentation is included in the minimum, so the result is somewhat larger.
    """
    surface, carrying = condensed(problem.surface), problem.cone.carrying
    N = surface.N[carrying]
    force = np.linalg.solve(surface.flexibility.between(N, N.T.tocsr()), w[carrying])
    v = surface.flexibility @ (N.T @ force)
    return float(np.sqrt(max(float(v @ (surface.S @ v)), 0.0)))
