"""Contact: surfaces that may touch, and a row of the plan for each normal law and for friction."""

from __future__ import annotations

from typing import get_args, get_type_hints

from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.laws import FrictionLaw, NormalLaw
from stickslip.solvers.scene.scene import Scene


class _Contact(Effect):
    name = "contact"

    def because(self, scene: Scene) -> str | None:
        return ", ".join(f"contacts.{name}" for name in scene.contacts) or None


class _Law(Effect):
    """Active if a contact has a law of the given kind under `key`, which is `normal` or `friction`."""

    def __init__(self, name: str, key: str, kind: type[object]) -> None:
        self.name, self.key, self.kind = name, key, kind  # type: ignore[misc]

    def because(self, scene: Scene) -> str | None:
        of_kind = [name for name, c in scene.contacts.items() if isinstance(getattr(c, self.key), self.kind)]
        return ", ".join(f"contacts.{name}.{self.key}" for name in of_kind) or None


EFFECTS = (
    _Contact(),
    *(_Law(get_args(get_type_hints(law)["law"])[0], "normal", law) for law in NormalLaw.kinds),
    _Law("friction", "friction", FrictionLaw),
)
