"""Contact: a surface that may touch, and a row of the plan for each normal law and for friction."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args, get_type_hints

from solvers.effects.effect import Effect, contacts_with
from solvers.laws import FrictionLaw, NormalLaw

if TYPE_CHECKING:
    from solvers.scene.scene import Scene


def because(scene: Scene) -> str | None:
    return ", ".join(f"contacts.{name}" for name in scene.contacts) or None


EFFECTS = (
    Effect(name="contact", because=because),
    *(
        Effect(name=get_args(get_type_hints(law)["law"])[0], because=contacts_with(law, "normal"))
        for law in NormalLaw.kinds
    ),
    Effect(name="friction", because=contacts_with(FrictionLaw, "friction")),
)
