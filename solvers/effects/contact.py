"""Contact: a surface that may touch."""

from __future__ import annotations

from typing import TYPE_CHECKING

from solvers.effects.effect import Effect

if TYPE_CHECKING:
    from solvers.nouns.scene import Scene


def because(scene: Scene) -> str | None:
    return ", ".join(f"contacts.{name}" for name in scene.contacts) or None


EFFECT = Effect(name="contact", because=because)
