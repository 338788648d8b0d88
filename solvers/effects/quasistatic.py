"""Quasi-static history: more than one step; each starts from the state of the one before."""

from __future__ import annotations

from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.scene.scene import Scene


class _Quasistatic(Effect):
    name = "quasistatic"

    def adds(self, scene: Scene) -> str:
        return "steps with the bodies prepared once"

    def because(self, scene: Scene) -> str | None:
        times = scene.requested_times()
        return f"steps: {len(times)} times are requested" if len(times) > 1 else None


EFFECT = _Quasistatic()
