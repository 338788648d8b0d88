"""Sliding: contact pairs, normals and gaps are searched again on the deformed surfaces."""

from __future__ import annotations

from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.scene.scene import Scene


class _Sliding(Effect):
    name = "sliding"

    def adds(self, scene: Scene) -> str:
        return "search and integrals again in each step"

    def because(self, scene: Scene) -> str | None:
        return ", ".join(f"contacts.{name}.sliding" for name, c in scene.contacts.items() if c.sliding) or None


EFFECT = _Sliding()
