"""Several bodies: contact between deformable surfaces, where a search finds the opposite points."""

from __future__ import annotations

from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.scene.scene import Scene


class _Multibody(Effect):
    name = "multibody"

    def adds(self, scene: Scene) -> str:
        return "a search of opposite points, and integrals over both sides"

    def because(self, scene: Scene) -> str | None:
        pairs = [f"contacts.{name}.against" for name, c in scene.contacts.items() if c.against not in scene.obstacles]
        return ", ".join(pairs) or None


EFFECT = _Multibody()
