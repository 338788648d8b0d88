"""Quasi-static history: more than one step, each starting from the slip of the one before."""

from __future__ import annotations

from typing import TYPE_CHECKING

from solvers.effects.effect import Effect

if TYPE_CHECKING:
    from solvers.scene.scene import Scene


def because(scene: Scene) -> str | None:
    times = scene.requested_times()
    return f"steps: {len(times)} times are requested" if len(times) > 1 else None


EFFECT = Effect(name="quasistatic", because=because)
