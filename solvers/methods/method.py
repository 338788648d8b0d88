"""What a method is: its name, what it works with, its keys of [solver], and how it is made ready for a run.

A new method is one new file here with a class that derives from `Method` and has a NAME. The registry finds it; the
keys of [solver], README's table, SCENE.md, what is refused and the chain of `auto` are read from its class.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Protocol, Self, get_args, get_type_hints

from geometry.arrays import Array
from geometry.keys import Key
from geometry.protocols import Vec
from solvers.interface.coarse_mesh import CoarseMesh
from solvers.interface.flexibility import DelassusOperator
from solvers.interface.prepare import Form
from solvers.interface.problem import SurfaceProblem
from solvers.methods.applicability import Applicability
from solvers.newton.solution import OnStep, Solution, ignore
from solvers.parallel.serialise import Plain
from solvers.scene.problem import Problem
from solvers.scene.settings import Solver
from solvers.system.system import System

Solve = Callable[[SurfaceProblem, Array, OnStep], Solution]  # from the tractions (rows,) [Pa] of the last step
Refusal = tuple[str, object, str]  # a key of [solver], its value, and why not with what to use instead


class Before(Protocol):
    """What a method may ask of the state that a step starts from."""

    @property
    def u(self) -> Vec:
        """Displacement over all dofs [m], PETSc."""

    @property
    def motion(self) -> Mapping[str, Array]:
        """Motion of each contact's obstacle (n, d) [m], at the surface's nodes."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What a method is made ready with."""

    system: System
    surface: DelassusOperator  # in a form that the method works with, see `condensed` and `matrix_free`
    coarse: CoarseMesh | None = None  # beside, for methods with COARSE_MESH
    safety: float = 1.0  # by how much a metric shall overestimate what the bodies give: shorter steps


@dataclass(frozen=True)
class Turn:
    """One place in the chain of methods that `auto` tries one after the other."""

    form: Form  # of the bodies; those of the condensed form also follow all others, where memory has room
    place: int  # among the turns of that form, ascending
    safe: bool = False  # with a metric that errs to the side of short steps


class Ready(ABC):
    """A method that is ready to solve steps, with what it has learnt of the bodies."""

    @abstractmethod
    def after(self, state: Before) -> Solve:
        """The solver of the step that follows an accepted state."""

    def renewed(self, setup: Setup) -> Ready:
        """For the same bodies with other contact rows; what belongs to the bodies stays."""
        return self

    def snapshot(self) -> dict[str, Plain]:
        """What earlier steps have taught, as arrays and plain data; see `restore`."""
        return {}

    def restore(self, snapshot: dict[str, Plain], surface: DelassusOperator) -> None:  # noqa: B027  most learn nothing
        """Know what a `snapshot` of the same bodies holds."""


class SameEveryStep(Ready):
    """One that solves every step the same way: it is the callable itself."""

    def after(self, state: Before) -> Solve:
        return self

    @abstractmethod
    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        """From p (rows,) [Pa], the tractions of the last accepted step."""


class Keys:
    """A group of keys of [solver]: its fields whose annotation holds a `Key`. Methods that share keys share a group."""

    def __post_init__(self) -> None:
        """Each group refuses its own values, and hands on to the next group.

        Raises:
            SceneError: the key, its value, what is expected.
        """


@dataclass(frozen=True, kw_only=True)
class Method(Keys, ABC):
    """A method as a scene asks for it."""

    NAME: ClassVar[str]  # solver.method
    WHEN: ClassVar[str]  # README's column `when`
    WORKS_WITH: ClassVar[Applicability]
    ROW: ClassVar[int] = 100  # in README's table, ascending; the same number: by name
    TURNS: ClassVar[tuple[Turn, ...]] = ()  # in the chain of `auto`
    COARSE_MESH: ClassVar[bool] = False  # whether a coarse mesh beside the scene's helps it

    rtol: float = 1e-8  # on the natural residual, relative to p_ref
    max_it: int = 10000

    @classmethod
    def of(cls, solver: Solver) -> Self:
        """The method with a scene's settings; keys that these do not have keep their defaults."""
        own = {key: getattr(solver, key) for key in keys_of(cls) if hasattr(solver, key)}
        return cls(rtol=solver.tolerance, max_it=solver.max_iterations, **own)

    def refusals(self, problem: Problem) -> Iterator[Refusal]:
        """What it cannot do in this scene besides what WORKS_WITH says."""
        return iter(())

    @abstractmethod
    def build(self, setup: Setup) -> Ready:
        """Assemble and factorise what it needs besides the bodies; collective."""


@dataclass(frozen=True, kw_only=True)
class Stateless(Method, SameEveryStep):
    """A method that prepares nothing and remembers nothing."""

    def build(self, setup: Setup) -> Ready:
        return self


@cache
def keys_of(kind: type[Method]) -> Mapping[str, Any]:
    """A method's keys of [solver] besides those of every method, with their annotations."""
    hints = get_type_hints(kind, include_extras=True)
    return {name: hint for name, hint in hints.items() if any(isinstance(part, Key) for part in get_args(hint))}
