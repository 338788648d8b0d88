"""Several bodies: contact between deformable surfaces, whose pairs must be searched."""

from __future__ import annotations

from typing import TYPE_CHECKING

from solvers.effects.effect import Effect

if TYPE_CHECKING:
    from solvers.scene.scene import Scene


def because(scene: Scene) -> str | None:
    pairs = [f"contacts.{name}.against" for name, c in scene.contacts.items() if c.against not in scene.obstacles]
    return ", ".join(pairs) or None


EFFECT = Effect(name="multibody", because=because)
