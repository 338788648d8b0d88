"""What every effect tells: its name, the scene key that calls for it, and what it adds."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from solvers.fem.forms import LoadForm, WeakForms
    from solvers.scene.scene import Scene


def contacts_with(law: type[Any], key: str) -> Callable[[Scene], str | None]:
    """The reason function of a law: the keys `contacts.NAME.key` whose value is of that kind."""

    def because(scene: Scene) -> str | None:
        named = [f"contacts.{name}.{key}" for name, c in scene.contacts.items() if isinstance(getattr(c, key), law)]
        return ", ".join(named) or None

    return because


def no_loads(scene: Scene, weak: WeakForms) -> Iterable[LoadForm]:
    """An effect that pushes nothing."""
    return ()


def no_pairs(scene: Scene) -> Iterable[tuple[str, str]]:
    """An effect that ties no sides together."""
    return ()


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One row of the plan."""

    name: str
    because: Callable[[Scene], str | None]  # the scene key that switches it on, None when off
    section: Any = None  # type of the scene's own table [name], if it has one
    check: Callable[[Scene], None] = lambda scene: None  # refuses that table's mistakes
    loads: Callable[[Scene, WeakForms], Iterable[LoadForm]] = no_loads
    periodic: Callable[[Scene], Iterable[tuple[str, str]]] = no_pairs  # (slave side, master side)
