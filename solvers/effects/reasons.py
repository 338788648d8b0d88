"""Why an effect is on: the contacts that name its law."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from solvers.nouns.scene import Scene


def contacts_with(law: type[Any], key: str) -> Callable[[Scene], str | None]:
    """The reason function of a law: the keys `contacts.NAME.key` whose value is of that kind."""

    def because(scene: Scene) -> str | None:
        named = [f"contacts.{name}.{key}" for name, c in scene.contacts.items() if isinstance(getattr(c, key), law)]
        return ", ".join(named) or None

    return because
