"""The plan: which effects a scene calls for and why; what is off costs nothing."""

from __future__ import annotations

import numpy as np

from geometry.errors import SceneError
from solvers.scene.problem import PlanRow, Problem
from solvers.scene.scene import Scene
from solvers.simulation.applicable import refuse_method
from solvers.simulation.resolve import resolve

FACING = 1e-6  # cosine of the angle below which two surfaces do not face each other
AXIS = 1e-9  # distance from the axis of symmetry that is none, as part of the scene's size
LOCKING = 0.49  # Poisson's ratio beyond which linear elements lock


def make_plan(scene: Scene) -> tuple[PlanRow, ...]:
    """All effects with the scene key that calls for them; see `planned`."""
    return planned(scene).plan


def planned(scene: Scene) -> Problem:
    """The scene, resolved, if it can be solved.

    Raises:
        SceneError: a motion that nothing resists, or a method that cannot do what the scene asks.
    """
    _refuse_on_axis(scene)
    _refuse_reversed(scene)
    problem = resolve(scene)
    if problem.unheld:
        raise SceneError(f"supports: nothing resists the {problem.unheld}; add a support, a contact or friction")
    refuse_method(problem)
    return problem


def warnings(scene: Scene) -> tuple[str, ...]:
    """What can be solved, but answers badly."""
    if scene.geometry.degree > 1 or scene.model == "plane stress":  # there the thickness gives way
        return ()
    return tuple(
        f"bodies.{name}.nu = {material.nu:g}: displacements of order 1 lock when nearly incompressible, too stiff and "
        "with wrong pressures; set geometry.order = 2"
        for name, material in scene.bodies.items()
        if material.nu > LOCKING
    )


def _refuse_on_axis(scene: Scene) -> None:
    """A side on the axis of symmetry has no area: nothing touches it, no force spreads over it."""
    if not scene.axisymmetric:
        return
    small = AXIS * float(np.max(np.ptp(scene.geometry.box(scene.dim), axis=0)))
    sides = {f"contacts.{name}.surface": contact.surface for name, contact in scene.contacts.items()}
    sides |= {f"loads.{name}.boundary": load.boundary for name, load in scene.loads.items()}
    for key, side in sides.items():
        if np.all(scene.geometry.sample(side, scene.dim)[0][:, 0] <= small):
            raise SceneError(f"{key} = {side}: lies on the axis of symmetry and has no area; name another side")


def _refuse_reversed(scene: Scene) -> None:
    for name, contact in scene.contacts.items():
        if contact.against not in scene.obstacles:
            continue
        points, outward = scene.geometry.sample(contact.surface, scene.dim)
        facing = np.einsum("kd,kd->k", scene.obstacles[contact.against].normals(points), outward)
        if np.all(facing > -FACING):
            raise SceneError(
                f"obstacles.{contact.against}: its normal must point against {contact.surface} (contacts.{name}), and "
                f"does so nowhere; the side's outward normal is {np.round(outward[0], 6).tolist()}, reverse it"
            )
