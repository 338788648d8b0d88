"""From a scene to the frozen `Problem` that all rooms below the simulation read, in two steps."""

from __future__ import annotations

from stickslip.solvers.effects import EFFECTS
from stickslip.solvers.scene.problem import Pair, PlanRow, Problem, Setup
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.unresisted_modes import unresisted_modes


def resolve(scene: Scene) -> Problem:
    """Find sides, contact pairs, values in time, active effects and rigid modes of a scene; nothing is meshed.

    Args:
        scene: valid; whether it can be solved is not checked here, see `planned`.

    Raises:
        SceneError, GeometryError: the geometry does not have what the scene asks for.
    """
    return with_rigid_modes(set_up(scene))


def set_up(scene: Scene) -> Setup:
    """The first step of `resolve`: all but rigid modes."""
    plan, pairs = plan_rows(scene), {}
    for name, contact in scene.contacts.items():
        slave, master = scene.slave_and_master(name)
        obstacle = contact.against if master is None else None
        pairs[name] = Pair(name=name, contact=contact, slave=slave, master=master, obstacle=obstacle)
    return Setup(
        model=scene.model,
        shape=scene.geometry,
        request=scene.request(),
        bodies=scene.bodies,
        obstacles=scene.obstacles,
        pairs=pairs,
        supports=scene.supports,
        loads=scene.loads,
        springs=scene.ground_springs(),
        links=scene.links(),
        couplings=scene.couplings(),
        probes=scene.probes,
        tables={row.effect: scene.sections[row.effect] for row in plan if row.on and row.effect in scene.sections},
        plan=plan,
        timeline=scene.timeline(),
        solver=scene.solver,
        labels=scene.labels,
    )


def with_rigid_modes(setup: Setup) -> Problem:
    """The second step of `resolve`."""
    return Problem(**vars(setup), **vars(unresisted_modes(setup)))


def plan_rows(scene: Scene) -> tuple[PlanRow, ...]:
    """One row for each known effect: whether it is on, the scene key that switches it on, what it adds."""
    because = [(effect, effect.because(scene)) for effect in EFFECTS]
    return tuple(
        PlanRow(effect=effect.name, on=True, because=key, adds=effect.adds(scene))
        if key
        else PlanRow(effect=effect.name, on=False, because="not in the scene")
        for effect, key in because
    )
