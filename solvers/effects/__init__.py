"""Effects that a scene can switch on, one file each; the registry finds every module that defines an effect.

An effect that is off costs nothing: no memory, assembly, compilation or search.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from typing import TypeVar

from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.record import RECORDS, RecordType
from stickslip.solvers.scene.scene import EffectTable

T = TypeVar("T")

_ORDER = ("contact", "unilateral", "compliance", "bilateral", "friction")  # the others follow by name
_modules = [importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__)]
_found: list[Effect] = [module.EFFECT for module in _modules if hasattr(module, "EFFECT")]
_found += [effect for module in _modules for effect in getattr(module, "EFFECTS", ())]

EFFECTS: tuple[Effect, ...] = tuple(
    sorted(_found, key=lambda e: (_ORDER.index(e.name) if e.name in _ORDER else len(_ORDER), e.name))
)


def active(problem: Problem) -> tuple[Effect, ...]:
    """The effects that a scene has switched on."""
    on = {row.effect for row in problem.plan if row.on}
    return tuple(effect for effect in EFFECTS if effect.name in on)


def records() -> Mapping[str, RecordType]:
    """Records of a step, by table: those of every scene, of effects, and its energy."""
    return _records(EFFECTS)


@cache
def _records(effects: tuple[Effect, ...]) -> Mapping[str, RecordType]:
    of_effects = {effect.name: effect.reports for effect in effects if effect.reports is not None}
    own = {table: record for table, record in RECORDS.items() if table != "energy"}
    return own | of_effects | {"energy": RECORDS["energy"]}


def is_single(table: str) -> bool:
    """Whether a table has one record only, which has no name."""
    return table == "energy" or isinstance(EffectTable.kinds.get(table), type)


def by_name(table: str, told: Mapping[str, T] | None) -> Mapping[str, Mapping[str, T]]:
    """Records of a table by name, that of a single one at "", as result.json has the table.

    >>> by_name("energy", {"stored": 1.0}), by_name("supports", None)
    ({'': {'stored': 1.0}}, {})
    """
    if not told:
        return {}
    return {"": told} if is_single(table) else told  # type: ignore[return-value]
