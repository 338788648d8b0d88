"""Mean dilatation: nearly incompressible bodies do not lock; see `stickslip.solvers.fem.mean_dilatation`."""

from __future__ import annotations

from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.scene.scene import Scene


class MeanDilatationEffect(Effect):
    """Part of the bodies' own stiffness; here is its row of the plan."""

    name = "mean_dilatation"

    def adds(self, scene: Scene) -> str:
        more = 6 if scene.dim == 2 else 15
        return f"nodes two cells apart are coupled: up to {more} times the entries of the stiffness"

    def because(self, scene: Scene) -> str | None:
        if scene.model == "plane stress":
            return None
        bodies = scene.bodies.items()
        found = [f"bodies.{name}.nu = {body.near_incompressible:g}" for name, body in bodies if body.averages]
        return ", ".join(found) or None


EFFECT = MeanDilatationEffect()
