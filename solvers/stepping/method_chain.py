"""The methods that a step is tried with, one after the other, and the bodies in the form that each needs."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass

import numpy as np

from stickslip.solvers.interface.coarse_mesh import CoarseMesh
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.interface.matrix_free import IterativeVolume, MatrixFreeSurface
from stickslip.solvers.interface.prepare import Volume, condensed_dofs, prepare_volume
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.iteration import Solution, Status
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.methods.method import Ready, Setup, Solve
from stickslip.solvers.methods.surface_uzawa import LearningIteration
from stickslip.solvers.methods.tangent_cg import OnTangent
from stickslip.solvers.metrics import SurfaceMetric, surface_metric
from stickslip.solvers.newton.surface_model import Flexibility
from stickslip.solvers.parallel.serialise import Plain
from stickslip.solvers.stepping.choice import Choice, Stage, choose, fits
from stickslip.solvers.stepping.history import History
from stickslip.solvers.stepping.state import State
from stickslip.solvers.system.system import System

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Switch:
    """A switch to the next method of the chain."""

    time: float  # at the end of the step that was not solved [s]; 0: the method before could not be prepared
    iteration: int  # number of iterations of the method before
    before: str
    after: str
    because: str  # status of the method before, in words


@dataclass(frozen=True)
class Reached:
    """Position of a run in its chain of methods."""

    choice: Choice
    at: int  # index in `choice.stages` that each substep begins with
    switches: tuple[Switch, ...]
    whole: bool = False  # whether the bodies are condensed on all contact dofs, whatever the method needs
    unsettled: tuple[float, ...] = ()  # see `MethodChain`


class MethodChain:
    """Position of a run in its chain of methods.

    A switch to another method with the same form of the bodies lasts for one substep: the next one begins with the
    first method of that form again. A switch to another form is permanent: the bodies are prepared in one form.

    Attributes:
        repeats: whether steps are solved to estimate an error alone, see `repeating`.
        history: iterations of the present step.
        cut_first: whether a substep that fails is cut before another method is tried, see `begin`.
        unsettled: times [s] at which the pairs of sliding contacts still changed when the searches ran out.
    """

    def __init__(self, system: System, reached: Reached | None = None, factor: FactorisedVolume | None = None) -> None:
        """Prepare the bodies for the first method, and a coarse mesh if the method uses one; collective.

        Args:
            reached: position of an earlier run to continue from; None: choose by size and free memory.
            factor: of the bodies, if it is known.
        """
        reached = reached or Reached(choose(system), 0, ())
        self.choice, self.at, self.switches = reached.choice, reached.at, list(reached.switches)
        self._whole, self.unsettled = reached.whole, list(reached.unsettled)
        known = factor if self.stage.surface == "condensed" and factor and self._suits(system, factor) else None
        self.volume = known or self._prepared(system)
        self.coarse = CoarseMesh.beside(system) if self.choice.coarse else None
        self.coarse_counters = self.coarse.counters if self.coarse else None  # they outlive it: see `release`
        self._ready: dict[Stage, Ready] = {}
        self._learnt: dict[str, dict[str, Plain]] = {}  # of methods that are not prepared yet, see `restore`
        self._unable: set[Stage] = set()  # that cannot be prepared
        self._metric: SurfaceMetric | None = None  # for methods that have none
        self.repeats = False
        self.history = History()
        self.cut_first = False

    @property
    def stage(self) -> Stage:
        """The method in use, with its form of the bodies."""
        return self.choice.stages[self.at]

    @property
    def first(self) -> int:
        """Index of the first method with the present form of the bodies, of those that can be prepared."""
        stages = enumerate(self.choice.stages)
        return next(k for k, each in stages if each.surface == self.stage.surface and each not in self._unable)

    @property
    def reached(self) -> Reached:
        """The position, to continue from later."""
        return Reached(self.choice, self.first, tuple(self.switches), self._whole, tuple(self.unsettled))

    def begin(self, cut_first: bool = False) -> None:
        """Begin a substep: with the first method that has the present form of the bodies.

        Args:
            cut_first: whether a shorter substep can follow one that fails: on the condensed form it then does so before
                another method is tried. Newton's chain is long: that helps it more.
        """
        self.at, self.cut_first = self.first, cut_first

    def release(self) -> None:
        """Free what the methods hold, and multigrid of the bodies; no step can be solved after that; collective."""
        for ready in self._ready.values():
            ready.release()
        self._ready.clear()
        self.coarse = None
        self.volume.release()

    def advance(self, system: System, time: float, solution: Solution) -> bool:
        """Switch to the next method of the chain; collective.

        Args:
            time: end of the step that was not solved [s].
            solution: what the current method has returned.

        Returns:
            Whether it was switched; not if the chain ends, or memory does not suffice for the next form of the bodies.
        """
        before, later = self.stage, self._later(other_form=solution.status is Status.SLOW)
        if self.repeats:
            later = [k for k in later if self.choice.stages[k].surface == before.surface]
        return bool(later) and self._go_on(system, later[0], time, solution.iterations, solution.status.value)

    def leave(self, system: System, why: str) -> bool:
        """Switch from a method that cannot be prepared, for good; collective.

        Args:
            why: it cannot, in a line.

        Returns:
            As `advance`.
        """
        later = self._later(other_form=False)
        self._ready.pop(self.stage, None)
        if not later or (self.repeats and self.choice.stages[later[0]].surface != self.stage.surface):
            return False
        self._unable.add(self.stage)
        return self._go_on(system, later[0], 0.0, 0, why)

    def _go_on(self, system: System, place: int, time: float, iterations: int, because: str) -> bool:
        """Switch to the stage at a place of the chain, and say why; see `advance`."""
        before, after = self.stage, self.choice.stages[place]
        if after.surface != before.surface:
            for ready in self._ready.values():  # another form may take its memory
                ready.release()
            if not fits(system, after.surface):
                log.warning("t = %g: %s: %s; no memory for %s", time, before, because, after)
                return False
        self.at = place
        switch = Switch(time, iterations, str(before), str(self.stage), because)
        self.switches.append(switch)
        log.warning("t = %g: %s: %s; goes on with %s", time, switch.before, switch.because, switch.after)
        known = self.stage.surface == before.surface
        self._whole = self._whole or (known and not METHODS[self.stage.method].ROWS_ALONE)
        if not known or not self._suits(system, self.volume):
            self._ready = {stage: ready for stage, ready in self._ready.items() if stage.surface == after.surface}
            self.volume.release()
            self.volume = self._prepared(system)
        return True

    def _prepared(self, system: System) -> Volume:
        """The bodies as the present method needs them; collective."""
        return prepare_volume(system, self.stage.surface, self._pressed)

    def widen(self, system: System) -> None:
        """Take contact dofs up that bodies which came near add; nothing is factorised; collective."""
        if isinstance(self.volume, FactorisedVolume):
            self.volume = self.volume.widened(condensed_dofs(system, self._pressed))
        else:
            assert isinstance(self.volume, IterativeVolume)  # methods of other forms take one contact a side
            self.volume = self.volume.widened(system)
        for ready in self._ready.values():  # of the dofs before
            ready.release()
        self._ready.clear()
        self._metric = None

    def _suits(self, system: System, volume: Volume) -> bool:
        """Whether bodies in the form of the present method are condensed on what it needs."""
        dofs = condensed_dofs(system, self._pressed)
        return not isinstance(volume, FactorisedVolume) or np.array_equal(volume.contact.rows, dofs)

    @property
    def _pressed(self) -> bool:
        return METHODS[self.stage.method].ROWS_ALONE and not self._whole

    @contextmanager
    def repeating(self, system: System) -> Iterator[None]:
        """Context for steps that are solved to estimate an error alone.

        The bodies keep their form, whatever fails; no step is cut; nothing is computed beside the solution. Position,
        switches and counters of work are afterwards what they were before: only `error_solves` has grown.
        """
        before = self.at, list(self.switches), list(self.unsettled)
        with system.counters.for_error(), self.coarse.counters.for_error() if self.coarse else nullcontext():
            self.repeats = True
            try:
                yield
            finally:
                self.repeats = False
                self.at, self.switches, self.unsettled = before

    @property
    def exact_laws(self) -> bool:
        """Whether all methods converge to the contact laws themselves."""
        return all(METHODS[stage.method].EXACT_LAWS for stage in self.choice.stages)

    @property
    def exhausted(self) -> bool:
        """Whether the method in use is the last one of the chain."""
        return not self._later(other_form=False)

    def _later(self, other_form: bool) -> list[int]:
        """Indices of the stages after the present one; of those with another form of the bodies only, if asked for."""
        places, form = range(self.at + 1, len(self.choice.stages)), self.stage.surface
        return [k for k in places if not other_form or self.choice.stages[k].surface != form]

    def method(self, system: System, surface: DelassusOperator) -> Callable[[State], Solve]:
        """A function from a state to the solver of the next step; the method keeps what it has learnt of the bodies.

        Raises:
            SolverError: it cannot be prepared; see `leave`.
        """
        self._ready[self.stage] = ready = self._readied(system, surface)
        return ready.after

    def _readied(self, system: System, surface: DelassusOperator) -> Ready:
        """The method in use, prepared for these bodies and rows; collective."""
        setup = Setup(
            system=system,
            surface=surface,
            coarse=self.coarse,
            safety=4.0 if self.stage.safe else 1.0,  # see `Setup`
            hurried=any(fits(system, self.choice.stages[k].surface) for k in self._later(other_form=True)),
        )
        before = self._ready.get(self.stage)
        if before is not None:
            return before.renewed(setup)
        ready = METHODS[self.stage.method].of(system.problem.solver).build(setup)
        if (known := self._learnt.pop(str(self.stage), None)) is not None:
            ready.restore(known, surface)
        return ready

    def beside(self, system: System, surface: DelassusOperator, state: State, drop: float) -> Solve | None:
        """A solver of problems near a solved one, with the exact contact laws, that changes nothing for later steps.

        Args:
            system, surface: the bodies.
            state: the solution of that one.
            drop: factor by which an iterative one makes the residual smaller.

        Returns:
            None: there is none for this form of the bodies.
        """
        if isinstance(surface, CondensedSurface):
            return CondensedNewton()
        if not isinstance(surface, MatrixFreeSurface):
            return None
        ready = self._ready[self.stage]
        if isinstance(ready, OnTangent):
            # of the error that is allowed: of a method whose displacement is not improved afterwards
            return ready.apart(state.u, 0.1 * drop)
        if not isinstance(ready, LearningIteration):
            ready = LearningIteration(metric=self._any_metric(system))
        return ready.apart(drop)

    def _any_metric(self, system: System) -> SurfaceMetric:
        """A metric for methods that have none."""
        if self._metric is None:
            self._metric = surface_metric(system)
        return self._metric

    def flexibility(self, system: System, surface: DelassusOperator) -> Flexibility:
        """An approximate Delassus operator of bodies that are not condensed: the method's own, or the metric."""
        known = self._ready[self.stage].flexibility(surface)
        if known is None:
            known = LearningIteration(metric=self._any_metric(system)).flexibility(surface)
        return known

    def snapshot(self) -> dict[str, Plain]:
        """Return what the methods with the present form of the bodies have learnt, by stage; see `restore`."""
        form = self.stage.surface
        known = {str(stage): ready.snapshot() for stage, ready in self._ready.items() if stage.surface == form}
        return self._learnt | known

    def restore(self, snapshot: dict[str, Plain], surface: DelassusOperator) -> None:
        """Take over what a `snapshot` holds, made with the same bodies; a method takes it when it is prepared."""
        self._learnt = dict(snapshot)
        for stage, ready in self._ready.items():
            if (known := self._learnt.pop(str(stage), None)) is not None:
                ready.restore(known, surface)
