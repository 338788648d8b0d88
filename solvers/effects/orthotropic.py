"""Orthotropic bodies: a stiffness of their own along axes; see `stickslip.solvers.scene.material`."""

from __future__ import annotations

from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.scene.material import Orthotropic
from stickslip.solvers.scene.scene import Scene


class OrthotropicEffect(Effect):
    """Part of the bodies' own stiffness; here is its row of the plan."""

    name = "orthotropic"

    def adds(self, scene: Scene) -> str:
        return "another form of these bodies' stiffness, with as many entries; no unknowns"

    def because(self, scene: Scene) -> str | None:
        found = [f"bodies.{name}.E_1" for name, body in scene.bodies.items() if isinstance(body, Orthotropic)]
        return ", ".join(found) or None


EFFECT = OrthotropicEffect()
