"""The plan: which effects a scene calls for and why; what is off costs nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geometry.errors import SceneError
from solvers.effects import EFFECTS
from solvers.effects.effect import Effect
from solvers.held import free_motions
from solvers.methods.table import METHODS
from solvers.nouns.scene import Scene
from solvers.nouns.stepping import Solver

Array = NDArray[np.float64]
FACING = 1e-6  # cosine of the angle below which two surfaces do not face each other
AXIS = 1e-9  # distance from the axis of symmetry that is none, as part of the scene's size
LOCKING = 0.49  # Poisson's ratio beyond which linear elements lock


@dataclass(frozen=True)
class PlanRow:
    """One line of `stickslip plan`."""

    effect: str
    on: bool
    because: str


def active_effects(scene: Scene) -> tuple[Effect, ...]:
    """Effects that the scene switches on."""
    return tuple(effect for effect in EFFECTS if effect.because(scene))


def make_plan(scene: Scene) -> tuple[PlanRow, ...]:
    """All effects with the scene key that calls for them.

    Raises:
        SceneError: a motion that nothing resists, or a method that cannot do what the scene asks.
    """
    _refuse_on_axis(scene)
    _refuse_reversed(scene)
    _refuse_unheld(scene)
    method = scene.solver.method
    _refuse_keys(scene, method)
    _refuse_laws(scene, method)
    if not METHODS[method].floating:
        if free_motions(scene, with_contacts=False)[0].shape[1]:
            raise SceneError(
                f"solver.method = {method}: needs bodies that their supports hold; this one is held by contact alone, "
                "use condensed-newton"
            )
        for name, obstacle in scene.obstacles.items():
            if obstacle.driven():
                raise SceneError(
                    f"solver.method = {method}: cannot move obstacles.{name} by a force; use condensed-newton"
                )
    return tuple(PlanRow(e.name, bool(e.because(scene)), e.because(scene) or "not in the scene") for e in EFFECTS)


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


def _refuse_keys(scene: Scene, method: str) -> None:
    """Keys that would change nothing."""
    for key in dict.fromkeys(key for other in METHODS.values() for key in other.keys):
        value = getattr(scene.solver, key)
        if key not in METHODS[method].keys and value != getattr(Solver(), key):
            knowing = [name for name, other in METHODS.items() if key in other.keys]
            raise SceneError(
                f"solver.{key} = {value}: solver.method = {method} does not know it; use {' or '.join(knowing)}"
            )


def _refuse_laws(scene: Scene, method: str) -> None:
    """Laws that the method does not know."""
    table = METHODS[method]
    if scene.solver.surface == "matrix-free" and not table.matrix_free:
        raise SceneError(
            f"solver.surface = matrix-free: solver.method = {method} needs the condensed form of the bodies; use "
            "surface-uzawa"
        )
    if scene.solver.surface == "condensed" and not table.condensed:
        raise SceneError(
            f"solver.surface = condensed: solver.method = {method} solves the bodies iteratively; use uzawa"
        )
    for name, contact in scene.contacts.items():
        if contact.sliding and not table.multibody:
            raise SceneError(
                f"contacts.{name}.sliding = true: solver.method = {method} finds contact where the bodies are at the "
                "start; use condensed-newton"
            )
        if contact.against not in scene.obstacles and not table.multibody:
            raise SceneError(
                f"contacts.{name}.against = {contact.against}: solver.method = {method} knows rigid obstacles alone; "
                "use condensed-newton"
            )
        if contact.friction is not None and contact.friction.k_T is not None and not table.k_T:
            raise SceneError(
                f"contacts.{name}.friction.k_T = {contact.friction.k_T}: solver.method = {method} knows no tangential "
                "stiffness; use condensed-newton"
            )
        for key, law, known in (
            ("normal", contact.normal, table.normal),
            ("friction", contact.friction, table.friction),
        ):
            chosen = getattr(law, "law", None)  # absent: no friction
            if chosen is not None and known is not None and chosen not in known:
                raise SceneError(
                    f"contacts.{name}.{key}.law = {chosen}: solver.method = {method} works with {', '.join(known)}; "
                    "use condensed-newton"
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


def _refuse_unheld(scene: Scene) -> None:
    motions, kinds = free_motions(scene, with_contacts=True)
    if motions.shape[1]:
        most = kinds[int(np.argmax(np.linalg.norm(motions, axis=1)))]
        raise SceneError(f"supports: nothing resists the {most}; add a support, a contact or friction")
