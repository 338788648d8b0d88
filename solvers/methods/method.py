"""The contract of a method: its name, the scenes it can solve, its keys of [solver], and its preparation for a run.

A new method is one new file in this folder or in `classical`, with a class that derives from `Method` and has a NAME.
The registry finds it; the keys of [solver], the table in docs, SCENE.md, refusals and the chain of `auto` are read from
its class.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, Protocol, Self, get_args, get_type_hints

from stickslip.geometry.arrays import Array
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Vec
from stickslip.solvers.interface.coarse_mesh import CoarseMesh
from stickslip.solvers.interface.discrete import GivenSurface
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.interface.prepare import Form
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import OnStep, Solution, ignore
from stickslip.solvers.newton.surface_model import Flexibility
from stickslip.solvers.parallel.serialise import Plain
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.settings import Solver
from stickslip.solvers.system.system import System

RIGID = "rigid"  # the operator of a rigid obstacle


@dataclass(frozen=True, kw_only=True)
class Applicability:
    """Scenes and forms of the bodies that a method supports.

    Every method works in every model, with cells of every kind and order, with pairs that are searched again, and on
    any number of ranks.
    """

    floating: bool  # bodies that only contact and friction hold, and obstacles that a force moves
    driven: bool = True  # the latter, if the former
    bedded: bool = False  # floating bodies, if compliant contact alone resists their rigid modes
    normal: tuple[str, ...] | None = None  # names of the supported normal laws; None: all
    friction: tuple[str, ...] | None = None  # names of the supported friction laws; None: all
    k_T: bool = True  # tangential stiffness before slip
    rates: bool = True  # friction by slip rate
    worn: bool = False  # prescribed sliding, and wear
    fields: bool = True  # gap offsets and mu that change over a side or in time
    shared: bool = True  # several contacts of one side
    operators: tuple[str, ...] | None = None  # supported contact operators: RIGID, and those between bodies; None: all
    matrix_free: bool = True  # bodies in matrix-free form: iterative volume solves
    condensed: bool = True  # bodies in condensed form: a dense stiffness of the contact dofs; in neither form: sparse
    contends: bool = True  # whether a cost study that may choose the method tries this one

    def knows(self, what: str, name: str) -> bool:
        """Whether the method supports a law or an operator.

        Args:
            what: `normal`, `friction` or `operators`.
            name: name of the law or of the operator.
        """
        known: tuple[str, ...] | None = getattr(self, what)
        return known is None or name in known


Solve = Callable[[SurfaceProblem, Array, OnStep], Solution]  # from tractions (rows,) [Pa]
Refusal = tuple[str, object, str]  # a key of [solver], its value, and the reason with what to use instead


class Before(Protocol):
    """The part of the last accepted state that a method may read."""

    @property
    def u(self) -> Vec:
        """Displacement over all dofs [m], PETSc."""

    @property
    def motion(self) -> Mapping[str, Array]:
        """Motion (n, d) [m] of each contact's obstacle at the nodes of the contact surface, by contact."""

    @property
    def p(self) -> Array:
        """Tractions (rows,) [Pa]."""

    @property
    def w(self) -> Array:
        """Relative displacement (rows,) [m]."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Data that a method is prepared from."""

    system: System
    surface: DelassusOperator  # in a form that the method works with, see `condensed` and `matrix_free`
    coarse: CoarseMesh | None = None  # an additional coarse mesh, for methods with COARSE_MESH
    safety: float = 1.0  # factor by which a metric overestimates the bodies' flexibility: shorter steps
    hurried: bool = False  # whether another form of the bodies can take over a step that is slow with this one


@dataclass(frozen=True)
class Turn:
    """One place in the chain of methods that `auto` tries one after the other."""

    form: Form  # of the bodies; turns with the condensed form also come after all others, if memory suffices
    place: int  # order among the turns of that form, ascending
    safe: bool = False  # with a metric that overestimates the bodies' flexibility: shorter steps
    dims: tuple[int, ...] = (2, 3)  # dimensions in which the method has this place


class Ready(ABC):
    """A method that is prepared to solve steps, with what earlier steps have taught it about the bodies."""

    @abstractmethod
    def after(self, state: Before) -> Solve:
        """The solver of the step that follows an accepted state."""

    @abstractmethod
    def renewed(self, setup: Setup) -> Ready:
        """The method for the same bodies with other contact rows, gaps and friction; what it knows of the bodies stays.

        It is itself where it reads all of these from the problem of each step.
        """

    def flexibility(self, surface: DelassusOperator) -> Flexibility | None:
        """The approximate Delassus operator that the method has, if it has one."""
        return None

    def snapshot(self) -> dict[str, Plain]:
        """Return what was learnt in earlier steps, as arrays and plain data; see `restore`."""
        return {}

    def restore(self, snapshot: dict[str, Plain], surface: DelassusOperator) -> None:  # noqa: B027  most learn nothing
        """Take over what a `snapshot` holds, made with the same bodies."""

    def release(self) -> None:  # noqa: B027  most hold little
        """Free what takes memory; if another step is solved it is made again; collective."""


class SameEveryStep(Ready):
    """A prepared method that solves every step in the same way; it is itself the solver of a step."""

    def after(self, state: Before) -> Solve:
        return self

    @abstractmethod
    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        """Solve one step.

        Args:
            problem: the contact problem of the step.
            p: tractions (rows,) [Pa] to start from.
            on_step: called after each iteration.
        """


class Keys:
    """A group of keys of [solver]: its fields whose annotation holds a `Key`. Methods that share keys share a group."""

    def __post_init__(self) -> None:
        """Check the values of this group; a subclass calls `super().__post_init__()`, so that all groups are checked.

        Raises:
            SceneError: the key, its value, what is expected.
        """


@dataclass(frozen=True, kw_only=True)
class Method(Keys, ABC):
    """A method with its settings, as [solver] gives them."""

    NAME: ClassVar[str]  # value of solver.method
    WHEN: ClassVar[str]  # text of the table's column `when`
    WORKS_WITH: ClassVar[Applicability]
    ROW: ClassVar[int] = 100  # order in the table, ascending; equal numbers: by name
    TURNS: ClassVar[tuple[Turn, ...]] = ()  # in the chain of `auto`
    EXACT_LAWS: ClassVar[bool] = True  # whether it converges to the contact laws themselves
    ROWS_ALONE: ClassVar[bool] = False  # whether it needs of the bodies only the displacements that rows touch
    COARSE_MESH: ClassVar[bool] = False  # whether it uses an additional coarse mesh

    rtol: float = 1e-8  # on the natural residual
    max_it: int = 10000

    @classmethod
    def of(cls, solver: Solver) -> Self:
        """The method with a scene's settings; keys that the settings do not have keep their defaults.

        Raises:
            SceneError: a value is out of range.
        """
        own = {key: getattr(solver, key) for key in keys_of(cls) if hasattr(solver, key)}
        return cls(rtol=solver.tolerance, max_it=solver.max_iterations, **own)

    def refusals(self, problem: Problem) -> Iterator[Refusal]:
        """Keys whose values this method refuses in this scene, in addition to WORKS_WITH."""
        return iter(())

    @abstractmethod
    def build(self, setup: Setup) -> Ready:
        """Assemble and factorise what it needs in addition to the bodies; collective."""

    def discrete(self, surface: GivenSurface) -> Solve | None:
        """The method for a `DiscreteProblem`, prepared from its operator alone; None: it needs the bodies as well."""
        return None


@dataclass(frozen=True, kw_only=True)
class Stateless(Method, SameEveryStep):
    """A method without preparation and without memory of earlier steps."""

    def build(self, setup: Setup) -> Ready:
        return self

    def renewed(self, setup: Setup) -> Ready:
        return self

    def discrete(self, surface: GivenSurface) -> Solve | None:
        return self if self.WORKS_WITH.condensed else None


@cache
def keys_of(kind: type[Method]) -> Mapping[str, object]:
    """Keys of [solver] that a method adds to those of every method, with their annotations."""
    hints = get_type_hints(kind, include_extras=True)
    return {name: hint for name, hint in hints.items() if any(isinstance(part, Key) for part in get_args(hint))}
