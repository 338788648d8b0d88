"""The contract of an effect: when it is active, its own table of the scene, what it adds to the problem, and reports.

Of an effect that is off only `because` is called. An effect that is on adds what it overrides; the rest costs nothing.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar, get_args

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import UflExpr, UflForm
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.fem.terms import InitialStrain, LoadTerm
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.record import Record, RecordType
from stickslip.solvers.scene.scene import EffectTable, Scene
from stickslip.solvers.scene.timeline import Place, Timeline

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Equilibrium:
    """A state of equilibrium as effects read it, the same on every rank; keys are the scene's, as springs.rope."""

    problem: Problem
    value: Callable[[Place], float]  # of a value in time, in the unit of its key; also of those that a step finds
    links: Mapping[str, Array]  # force (d,) of each link on the body at its first end [N]
    couplings: Mapping[str, Array]  # motion (k,) of each coupled point, numbered as `rigid_fields` [m, rad]
    # force (d,) [N] and moment [N m] of springs to the ground, about the origin, and of points that are held
    reactions: Mapping[str, tuple[Array, Array]]
    strains: Mapping[Place, tuple[float, float]]  # of initial strains: value, and work of the stress on value 1 [J]


def named(table: str, found: Mapping[str, T]) -> dict[str, T]:
    """Those of one table, by name.

    >>> named("springs", {"springs.rope": 1.0, "bolts.rope": 2.0})
    {'rope': 1.0}
    """
    return {key.partition(".")[2]: value for key, value in found.items() if key.partition(".")[0] == table}


class Effect(ABC):
    """`solvers/effects/__init__.py` finds the instance `EFFECT` of a file, or several in its `EFFECTS`.

    Values in time belong to the table, see `EffectTable.amplitudes`: steps end exactly at their times, and steps.csv
    lists them. Checks of the table that need the rest of the scene belong to `EffectTable.check`.
    """

    name: ClassVar[str]  # row of the plan, and name of the scene's table if the effect has one
    table: ClassVar[Any] = None  # type of that table: an `EffectTable`, or a Mapping of them by name
    example: ClassVar[Mapping[str, Any]] = {}  # tables of a block that call for it, to measure what it costs

    def __init_subclass__(cls, **kwargs: object) -> None:
        super().__init_subclass__(**kwargs)
        if cls.table is not None:
            EffectTable.kinds[cls.name] = cls.table

    def because(self, scene: Scene) -> str | None:
        """The scene key that switches the effect on; None: it is off. An effect with a table is on with its table."""
        named = [name for section, name in scene.effect_tables() if section == self.name]
        return ", ".join(f"{self.name}.{name}" if name else self.name for name in named) or None

    def adds(self, scene: Scene) -> str:
        """Addition of the effect to the problem of a scene that calls for it, and its cost, for the plan."""
        kind, plain = type(self), Effect
        overridden = {
            "a load": kind.loads is not plain.loads,
            "an initial strain, which is a load and a part of the stress": (
                kind.initial_strains is not plain.initial_strains
            ),
            "entries of the stiffness": self.stiffens,
        }
        return ", ".join(words for words, so in overridden.items() if so)

    def loads(self, problem: Problem, weak: WeakForms) -> Iterable[LoadTerm]:
        """Loads on the bodies; they enter the equilibrium, the external work and the audit."""
        return ()

    def initial_strains(self, problem: Problem) -> Iterable[InitialStrain]:
        """Strains that cause no stress; they enter the equilibrium, stress, stored energy and the audit."""
        return ()

    def stiffness(self, problem: Problem, weak: WeakForms, u: UflExpr) -> Iterable[UflForm]:
        """Forms, linear in u and in `weak.v`, symmetric and positive, that are added to a(u, v).

        They enter the stiffness matrix, the stored energy and the audit's inner forces. They do not count as supports,
        unless they are those of `EffectTable.springs`: a scene with a body that no support holds is refused. UFL is
        `stickslip.geometry.dolfinx_versions.ufl`.

        Args:
            u: trial function, or a displacement Function [m].
        """
        return ()

    @property
    def stiffens(self) -> bool:
        """Whether the effect adds stiffness: a rigid motion of the bodies is then no longer free of force."""
        return type(self).stiffness is not Effect.stiffness

    def other_stiffness(self, problem: Problem) -> bool:
        """Whether it adds stiffness that is not that of springs, so that it is not known which motions it resists."""
        return self.stiffens and not any(springs.key.split(".")[0] == self.name for springs in problem.springs)

    @property
    def acts(self) -> bool:
        """Whether the effect can move bodies: it adds loads or initial strains."""
        return type(self).loads is not Effect.loads or type(self).initial_strains is not Effect.initial_strains

    @property
    def reports(self) -> RecordType | None:
        """What a step reports of each of its tables: a class whose fields are annotated with a `Number`; None: nothing.

        Goals, result.json, steps.csv, errors and comparisons follow from it; it is declared as `EffectTable.reports`.
        """
        return getattr(next(iter(get_args(self.table)[1:]), self.table), "reports", None)

    def read(self, reached: Equilibrium) -> Mapping[str, Record]:
        """A record for each of its tables by name ("" if there is only one), where it `reports`."""
        return {}

    def columns(self, problem: Problem, timeline: Timeline, time: float) -> Mapping[str, float]:
        """Numbers for steps.csv at a reported time [s], by name; the table's values in time are listed without this."""
        return {}
