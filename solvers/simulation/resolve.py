"""A scene is resolved once, into the problem that everything below works on."""

from __future__ import annotations

from solvers.effects import EFFECTS
from solvers.scene.problem import Pair, PlanRow, Problem
from solvers.scene.scene import Scene
from solvers.simulation.held import what_holds


def resolve(scene: Scene) -> Problem:
    """Sides, pairs, timeline, active effects, rigid modes and scales of a scene; nothing is meshed.

    Raises:
        SceneError, GeometryError: the geometry does not have what the scene asks for.
    """
    held, plan = what_holds(scene), plan_rows(scene)
    pairs = {}
    for name, contact in scene.contacts.items():
        rigid = contact.against in scene.obstacles
        pairs[name] = Pair(
            name=name,
            contact=contact,
            slave=contact.surface,
            master=None if rigid else contact.against,
            obstacle=contact.against if rigid else None,
        )
    return Problem(
        model=scene.model,
        shape=scene.geometry,
        request=scene.request(),
        bodies=scene.bodies,
        obstacles=scene.obstacles,
        pairs=pairs,
        supports=scene.supports,
        loads=scene.loads,
        probes=scene.probes,
        tables={row.effect: scene.sections[row.effect] for row in plan if row.on and row.effect in scene.sections},
        plan=plan,
        timeline=scene.timeline(),
        rigid_modes=held.rigid_modes,
        unheld=held.unheld,
        solver=scene.solver,
    )


def plan_rows(scene: Scene) -> tuple[PlanRow, ...]:
    """Every effect, whether it is active, and the scene key that calls for it."""
    because = [(effect.name, effect.because(scene)) for effect in EFFECTS]
    return tuple(PlanRow(effect=name, on=bool(key), because=key or "not in the scene") for name, key in because)
