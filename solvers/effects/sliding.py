"""Sliding: pairs, normals and gaps are found anew where the motion has brought the surfaces."""

from __future__ import annotations

from typing import TYPE_CHECKING

from solvers.effects.effect import Effect

if TYPE_CHECKING:
    from solvers.scene.scene import Scene


def because(scene: Scene) -> str | None:
    return ", ".join(f"contacts.{name}.sliding" for name, c in scene.contacts.items() if c.sliding) or None


EFFECT = Effect(name="sliding", because=because)
