"""The state of equilibrium at one time: everything the next step needs of the past."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from stickslip.geometry.arrays import EXACT, ROUNDING, Array
from stickslip.geometry.protocols import Vec
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.iteration import Correction
from stickslip.solvers.laws.wear import REPEAT
from stickslip.solvers.scene.record import Batch, Energy, Event

HALVINGS = 8  # a step is cut down to 1/256 before it is given up
ENOUGH = 3  # easy substeps in a row after which the size doubles: if every second one is hard, a larger one would fail


@dataclass(frozen=True)
class StepControl:
    """Step size control: the size of the next substep, learnt from those before; carried over between steps.

    A substep that fails halves the size; `ENOUGH` easy ones in a row double it.

    >>> StepControl().next_size(2.0, smallest=0.1), StepControl(size=0.5).next_size(2.0, smallest=0.1)
    (2.0, 0.5)
    """

    size: float = np.inf  # largest substep to try [s]; inf: whole steps
    easy: float = 0  # number of substeps of that size that were easy, in a row; of a clock: that stability held back

    def next_size(self, remaining: float, smallest: float) -> float:
        """Size of the next substep [s].

        Args:
            remaining: time up to the end of the step [s]; it is divided so that no tiny rest is left.
            smallest: lower bound of the size [s].
        """
        size = max(self.size, smallest)
        if remaining <= size * (1 + ROUNDING):  # relative; sizes that differ by less are equal
            return remaining
        return size if remaining > 2 * size * (1 - ROUNDING) else remaining / 2

    def after_failure(self, tried: float, smallest: float) -> StepControl:
        """The control after a substep of size `tried` [s] failed: half of it, not below `smallest` [s]."""
        return StepControl(size=max(tried / 2, smallest))

    def after_success(self, tried: float, step: float, easy: bool) -> StepControl:
        """The control after a substep was accepted.

        Args:
            tried: its size [s].
            step: size of the whole step [s].
            easy: whether it took few iterations.
        """
        if np.isinf(self.size) or (easy and tried <= self.size / 2):  # one so short shows nothing
            return self
        if not easy:
            return StepControl(size=self.size)
        if self.easy + 1 < ENOUGH:
            return StepControl(size=self.size, easy=self.easy + 1)
        return StepControl(size=2 * self.size) if 2 * self.size < step * (1 - ROUNDING) else StepControl()


@dataclass(frozen=True)
class Previous:
    """The accepted substep before a state: the next one starts from tractions extrapolated through both."""

    time: float  # [s]
    p: Array  # (rows,) tractions [Pa], in the same contact rows as the state's own


@dataclass(frozen=True, kw_only=True)
class State:
    """An equilibrium: everything the next step needs of the past.

    PETSc vectors run over all displacement dofs, eliminated ones too. Arrays over rows are flat: normal rows of all
    contacts, then tangential rows in local frames. n_all counts the nodes of both sides of a contact.
    """

    time: float  # [s]
    u: Vec  # displacement [m]
    u_s: Vec  # its prescribed part [m]
    load: Vec  # external forces, without reactions and initial strains [N]
    initial: Array  # (k,) values of the initial strains; the unit is that of each one's key
    initial_work: Array  # (k,) see `InitialStrains.stress_work` [J]
    elongation: Array  # (r,) of each of `Links`, the motion of the ground left out [m]
    remote: Array  # (components,) motion of remote points [m, rad]
    residual: Vec  # K u - load - forces of initial strains + B^T p [N]: what supports and periodic sides carry
    p: Array  # (rows,) tractions [Pa], pressure positive
    w: Array  # (rows,) relative displacement [m]
    motion: Mapping[str, Array]  # (n_all, d) displacement of each contact's obstacle [m]; 0 in the initial state
    driven: Array  # (o,) displacement of the obstacles that forces drive, by `Problem.driven` [m]
    slip: Mapping[str, Array]  # (n, d) slip since t = 0 at the slave nodes of each contact [m]
    memory: Mapping[str, Array]  # (m_t,) what laws that remember slip do of each point, see `FrictionLaw.memory`
    forces: Mapping[str, Array]  # (n_all, d) nodal forces B^T p of each contact [N], by the rows that they come from
    rows: tuple[ContactRows, ...]  # contact rows that p and w refer to
    searched: Mapping[str, Array]  # (n_all, d) relative motion that the pairs of sliding contacts were searched at [m]
    energy: Energy  # [J]
    previous: Previous | None = None  # None: the initial state, or one whose trend tells nothing of the next step
    guess: State | None = None  # near that at the end of the next substep, in the same contact rows; None: not known
    jumped: bool = False  # whether the next substep is known to jump, to the solution next to `guess`
    control: StepControl = StepControl()
    correction: Correction | None = None  # exact solution of the same steps minus this one; None: zero
    law_error: float = 0.0  # error of the method's approximate contact laws, summed since t = 0 [J^(1/2)]
    surplus: Vec | None = (
        None  # displacement added to u, in the space of the next order [m]; of a state with bubbles only
    )
    surplus_motion: Mapping[str, Array] | None = None  # (n, d) relative motion by it at the nodes of each contact [m]
    reactions: Mapping[str, tuple[Array, Array]] | None = None  # of each support with bubbles: force [N], moment [N m]
    ground: Array = field(default_factory=lambda: np.zeros(0))  # that springs to it exert, see `GroundSprings` [N, N m]
    refined: State | None = None  # the same history with bubbles, see `solvers/accuracy`; None: it is not followed
    neighbours: tuple[State, ...] = ()  # with other numbers in the scene, see `sensitivity`; empty: nobody asks
    events: tuple[Event, ...] = ()  # that ended in the step to this state, see `stepping/clock`
    running: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)  # by contact, how its event began
    batches: tuple[Batch, ...] = ()  # of load cycles in the step to this state, see `stepping/cycles`
    peak: float = 0.0  # largest stored energy since t = 0 [J]; errors are relative to it, also once all is unloaded

    def again(self, time: float, cycles: float) -> State:
        """This state at another time [s], at which loads are the same; steps from it stand for so many load cycles."""
        memory = {key: value for key, value in self.memory.items() if key != REPEAT}
        return replace(
            self,
            time=time,
            memory=memory if cycles == 1 else memory | {REPEAT: np.array(cycles)},
            previous=None,
            refined=self.refined and self.refined.again(time, cycles),
            neighbours=tuple(each.again(time, cycles) for each in self.neighbours),
        )

    def ahead(self, time: float, turns: Iterable[float]) -> Array:
        """Tractions (rows,) [Pa] extrapolated to a later time [s]; the state's own if a load or motion turns here.

        Args:
            turns: times [s] at which one does.
        """
        if self.guess is not None:
            return self.guess.p
        if self.previous is None:
            return self.p
        far = (time - self.time) / (self.time - self.previous.time)
        # times the last substep; an extrapolation farther ahead would amplify what its iteration left
        if far > 100.0 or self.turned(turns):
            return self.p
        return self.p + far * (self.p - self.previous.p)

    def turned(self, turns: Iterable[float]) -> bool:
        """Whether a load or motion turns here; `turns`: times [s] at which one does."""
        # relative; times that differ by less are equal
        return any(abs(turn - self.time) <= EXACT * self.time for turn in turns)
