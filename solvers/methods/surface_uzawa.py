"""Uzawa in the metric of the boundary: each step is a contact problem with an approximate flexibility of the bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count
from typing import ClassVar

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.discrete import LEAST, GivenSurface
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import QUICK, USUAL, Driver, Iterate, OnStep, Solution, Stall, ignore
from stickslip.solvers.methods.method import Applicability, Method, Ready, SameEveryStep, Setup, Solve, Turn
from stickslip.solvers.metrics import Secants, SurfaceMetric, surface_metric
from stickslip.solvers.newton.surface_model import Flexibility, nearest_in_cone
from stickslip.solvers.parallel.serialise import Plain

PATIENCE = 600  # iterations of conjugate gradients in a step, until then; usual are 20 to 75


@dataclass(frozen=True, kw_only=True)
class SurfaceUzawa(Method):
    """p <- argmin over the cone in the metric B F B^T, F an approximation of K_B^-1 on the contact dofs.

    The number of iterations does not depend on the mesh, because F is spectrally equivalent to K_B^-1 on the contact
    dofs. Each iteration solves the bodies once and updates F, so that F reproduces that answer (a secant condition);
    the updates are kept over all load steps.

    Source: Uzawa's method with a variable preconditioner: Bramble, Pasciak & Vassilev, SIAM J. Numer. Anal. 34 (1997).
    """

    NAME: ClassVar = "surface-uzawa"
    WHEN: ClassVar = "few volume solves, as many at every mesh size: bodies too large to condense"
    WORKS_WITH: ClassVar = Applicability(floating=True, worn=True)
    ROW: ClassVar = 2
    TURNS: ClassVar = (Turn("matrix-free", 1), Turn("matrix-free", 2, safe=True), Turn("condensed", 2))
    COARSE_MESH: ClassVar = True

    def build(self, setup: Setup) -> Ready:
        surface, coarse = setup.surface, setup.coarse
        return LearningIteration(
            metric=surface_metric(setup.system),
            smooth=partial(coarse.smooth_responses, setup.system, surface.R, surface.rho) if coarse else None,
            rtol=self.rtol,
            max_it=self.max_it,
            safety=setup.safety,
            hurried=setup.hurried,
        )

    def discrete(self, surface: GivenSurface) -> SameEveryStep:
        """There is no boundary to take a metric from: F begins as the diagonal of the operator, and learns the rest."""
        give, ones = surface.matrix.diagonal(), np.ones(surface.size)
        diagonal = SurfaceMetric(
            L=sparse.csr_matrix(surface.matrix.shape), mass=ones, depth=ones, compliance=np.maximum(give, LEAST)
        )
        return LearningIteration(metric=diagonal, rtol=self.rtol, max_it=self.max_it)


@dataclass(frozen=True, kw_only=True)
class LearningIteration(SameEveryStep):
    """The iteration with the updates of F from earlier solves."""

    metric: SurfaceMetric
    rtol: float = Method.rtol
    max_it: int = Method.max_it
    drop: float = 0.0  # of the first residual: that is enough, too
    safety: float = 1.0  # factor on F: shorter steps; if it is not 1, earlier updates are not used
    hurried: bool = False  # whether another form of the bodies can take over: a slow step is given up earlier
    smooth: Callable[[], tuple[Array, Array]] | None = None  # see `CoarseMesh.smooth_responses`; called once
    learnt: dict[str, Secants] = field(default_factory=dict, repr=False)

    def renewed(self, setup: Setup) -> Ready:
        return self  # F is of the bodies

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        counters = problem.surface.counters
        enough = counters.linear_iterations + PATIENCE
        return Driver(counters, self.rtol, self.max_it, on_step).run(
            self._iterates(problem, p),
            Stall(QUICK if self.hurried else USUAL),
            slow=lambda k, residual: self.hurried and counters.linear_iterations > enough,
        )

    def _iterates(self, problem: SurfaceProblem, p: Array) -> Iterator[Iterate]:
        surface, F, rtol = problem.surface, self._F(problem.surface), self.rtol
        inner = 0.0 if surface.exact or problem.p_ref == 0 else 0.1  # p_ref = 0: no load and no motion
        accuracy = inner
        known = not (p.any() or problem.load.rough)
        u_c = problem.load.free if known else problem.contact_displacement(p, accuracy)
        w, forces = problem.relative_displacement(u_c), surface.forces(p)
        motion = np.zeros_like(u_c)
        balanced = not surface.floating or problem.p_ref == 0
        for k in count():
            residual = problem.natural_residual(p, w) if balanced else np.inf  # until w is the displacement under p
            if k == 0 and balanced:
                rtol = max(rtol, self.drop * residual)
            yield Iterate(k, residual, p, w, u_c + motion, enough=residual + accuracy <= rtol, known=balanced)
            metric = Flexibility(surface=surface, F=F, metric=self.metric)
            found = nearest_in_cone(problem, metric, p, w, max(residual, rtol))
            if found is None:
                return
            p = found.p
            balanced = True
            accuracy = inner * max(rtol, 0.5 * min(residual, 1.0))  # expected on the safe side of an iteration
            u_new, forces_new = problem.contact_displacement(p, accuracy), surface.forces(p)
            F.learn(forces - forces_new, u_new - u_c)
            u_c, forces = u_new, forces_new
            motion = motion + surface.R @ found.b
            w = problem.relative_displacement(u_c + motion)

    def apart(self, drop: float) -> Solve:
        """A solver of similar problems, to a residual smaller by a factor than at its start; what it learns is lost."""
        return replace(self, drop=drop, hurried=False, learnt={name: copy(F) for name, F in self.learnt.items()})

    def snapshot(self) -> dict[str, Plain]:
        return {name: secants.snapshot() for name, secants in self.learnt.items()}

    def restore(self, snapshot: dict[str, Plain], surface: DelassusOperator) -> None:
        for known in snapshot.values():
            self._F(surface).restore(known)

    def flexibility(self, surface: DelassusOperator) -> Flexibility:
        """The approximate Delassus operator, as far as it is known."""
        return Flexibility(surface=surface, F=self._F(surface), metric=self.metric)

    def _F(self, surface: DelassusOperator) -> Secants:
        """F, exact for the forces that move floating bodies rigidly: (K_B + rho R R^T)^-1 R = R / rho."""
        own = surface.size - surface.driven

        def with_driven(guess: Callable[[Array], Array]) -> Secants:
            def whole(force: Array) -> Array:
                return np.concatenate([guess(force[:own]), force[own:] / surface.rho])

            return Secants(whole, surface.R, surface.R / surface.rho, self.metric.comm)

        if self.safety != 1:
            return with_driven(lambda force: np.asarray(self.safety * self.metric(force)))
        if "F" not in self.learnt:
            self.learnt["F"] = with_driven(self._primed())
        return self.learnt["F"]

    def _primed(self) -> Callable[[Array], Array]:
        """The metric, updated with the responses to smooth forces from the coarse mesh."""
        if self.smooth is None:
            return self.metric
        forces, displacements = self.smooth()
        primed = Secants(self.metric, forces[:, :0], displacements[:, :0], self.metric.comm)
        for force, displacement in zip(forces.T, displacements.T, strict=True):
            primed.learn(force, displacement)
        return primed
