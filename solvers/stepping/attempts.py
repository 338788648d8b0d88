"""The methods that a step is tried with, one after the other, and the bodies in the form that each needs."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from geometry.arrays import Array
from solvers.interface.coarse_mesh import CoarseMesh
from solvers.interface.flexibility import DelassusOperator
from solvers.interface.matrix_free import IterativeVolume
from solvers.interface.prepare import prepare_volume
from solvers.interface.problem import SurfaceProblem
from solvers.interface.schur_complement import CondensedSurface
from solvers.methods.condensed_newton import CondensedNewton
from solvers.methods.contact_element import penalties
from solvers.methods.gram_uzawa import GramUzawa
from solvers.methods.inexact_uzawa import InexactUzawa
from solvers.methods.inner_tolerance import InnerTolerance
from solvers.methods.nonlinear_uzawa import NonlinearUzawa
from solvers.methods.perturbed_lagrangian import PerturbedLagrangian
from solvers.methods.regularised import Regularised
from solvers.methods.surface_uzawa import SurfaceUzawa
from solvers.methods.uzawa import Uzawa
from solvers.metrics.gram import GramMetric
from solvers.metrics.surface_metric import surface_metric
from solvers.newton.solution import OnStep, Solution
from solvers.scene.settings import Solver
from solvers.stepping.choice import Choice, Stage, choose, fits
from solvers.stepping.state import State
from solvers.system.system import System

Method = Callable[[SurfaceProblem, Array, OnStep], Solution]
SAFE = 4.0  # how much a safe metric gives way more than bodies do
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Switch:
    """The run went on with another method."""

    time: float  # that the step in question leads to
    iteration: int  # after which
    before: str
    after: str
    because: str


@dataclass(frozen=True)
class Reached:
    """How far down its chain of methods a run has come."""

    choice: Choice
    at: int
    switches: tuple[Switch, ...]


class Attempts:
    """Where a run stands in its chain of methods. A switch holds: what failed would fail again."""

    def __init__(self, system: System, reached: Reached | None = None) -> None:
        """Prepare the bodies for the first method, and a coarse mesh if it is worth its while; collective.

        Args:
            reached: where to go on, whatever would be chosen with the memory that is free now.
        """
        reached = reached or Reached(choose(system), 0, ())
        self.choice, self.at, self.switches = reached.choice, reached.at, list(reached.switches)
        self.volume = prepare_volume(system, self.stage.surface)
        self.coarse = CoarseMesh.beside(system) if self.choice.coarse else None
        self._methods: dict[Stage, Callable[[State], Method]] = {}
        self.learning: dict[Stage, SurfaceUzawa] = {}  # methods that are better for what earlier steps taught them

    @property
    def stage(self) -> Stage:
        return self.choice.stages[self.at]

    @property
    def reached(self) -> Reached:
        return Reached(self.choice, self.at, tuple(self.switches))

    def advance(self, system: System, time: float, solution: Solution) -> bool:
        """Go on to the next method, if there is one that memory has room for; collective."""
        if self.at + 1 == len(self.choice.stages):
            return False
        before, after = self.stage, self.choice.stages[self.at + 1]
        if after.surface != before.surface and not fits(system, after.surface):
            log.warning("t = %g: %s: %s; no memory for %s", time, before, solution.status.value, after)
            return False
        self.at += 1
        switch = Switch(time, solution.iterations, str(before), str(self.stage), solution.status.value)
        self.switches.append(switch)
        log.warning("t = %g: %s: %s; goes on with %s", time, switch.before, switch.because, switch.after)
        if self.stage.surface != before.surface:
            if isinstance(self.volume, IterativeVolume):
                self.volume.release()
            self.volume = prepare_volume(system, self.stage.surface)
        return True

    def method(self, system: System, surface: DelassusOperator) -> Callable[[State], Method]:
        """The method for the step that follows a state. What it has learnt of the bodies, it keeps."""
        if self.stage.method == "perturbed-lagrangian":  # its springs belong to the rows, not to the bodies
            return self._make(system, surface)
        if self.stage not in self._methods:
            self._methods[self.stage] = self._make(system, surface)
        return self._methods[self.stage]

    def _make(self, system: System, surface: DelassusOperator) -> Callable[[State], Method]:
        solver = system.problem.solver
        if self.stage.method == "regularised":
            assert isinstance(surface, CondensedSurface)
            regularised = Regularised(system, self.volume, surface)
            return lambda state: regularised.after(state.u, state.motion)
        if self.stage.method == "surface-uzawa":
            learning = SurfaceUzawa(
                metric=surface_metric(system),
                smooth=self.coarse.smooth_responses(system, surface.R, surface.rho) if self.coarse else None,
                rtol=solver.tolerance,
                max_it=solver.max_iterations,
                safety=SAFE if self.stage.safe else 1.0,
            )
            self.learning[self.stage] = learning
            return lambda state: learning
        if self.stage.method == "gram-uzawa":
            metric = GramMetric(system, solver.gram)
            gram = GramUzawa(metric, relaxation=solver.relaxation, rtol=solver.tolerance, max_it=solver.max_iterations)
            return lambda state: gram
        if self.stage.method == "perturbed-lagrangian":
            springs = PerturbedLagrangian(omega=penalties(system), rtol=solver.tolerance, max_it=solver.max_iterations)
            return lambda state: springs
        method = self._stateless(solver)
        return lambda state: method

    def _stateless(self, solver: Solver) -> Method:
        """Methods that remember nothing."""
        stop: Any = {"rtol": solver.tolerance, "max_it": solver.max_iterations}
        if self.stage.method == "condensed-newton":
            return CondensedNewton(**stop)
        steps: Any = {"relaxation": solver.relaxation, "friction_update": solver.friction_update}
        inner = InnerTolerance(rule=solver.inner_rule, share=solver.inner_tolerance)
        if self.stage.method == "nonlinear-uzawa":
            return NonlinearUzawa(inner=inner, outer_metric=solver.outer_metric, **steps, **stop)
        if self.stage.method == "inexact-uzawa":
            assert isinstance(self.volume, IterativeVolume)
            self.volume.remember(1)  # conjugate gradients as published: of earlier solves, their answer alone
            return InexactUzawa(inner=inner, alpha=solver.alpha, **steps, **stop)
        return Uzawa(alpha=solver.alpha, **steps, **stop)
