"""The plan: which effects a scene calls for and why; what is off costs nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from geometry.errors import SceneError
from solvers.constraints import AXES, rigid_fields, rigid_names
from solvers.effects import EFFECTS
from solvers.effects.effect import Effect
from solvers.methods.table import METHODS
from solvers.nouns.scene import Scene

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
    method = method_of(scene)
    _refuse_laws(scene, method)
    if not METHODS[method].floating:
        if _free_motions(scene, with_contacts=False)[0].shape[1]:
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


def method_of(scene: Scene) -> str:
    """The method that runs: `auto` is condensed-newton."""
    return "condensed-newton" if scene.solver.method == "auto" else scene.solver.method


def _refuse_laws(scene: Scene, method: str) -> None:
    """Laws that the method does not know."""
    table = METHODS[method]
    for name, contact in scene.contacts.items():
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
        points, outward = scene.geometry.sample(contact.surface, scene.dim)
        facing = np.einsum("kd,kd->k", scene.obstacles[contact.against].normals(points), outward)
        if np.all(facing > -FACING):
            raise SceneError(
                f"obstacles.{contact.against}: its normal must point against {contact.surface} (contacts.{name}), and "
                f"does so nowhere; the side's outward normal is {np.round(outward[0], 6).tolist()}, reverse it"
            )


def _refuse_unheld(scene: Scene) -> None:
    motions, kinds = _free_motions(scene, with_contacts=True)
    if motions.shape[1]:
        most = kinds[int(np.argmax(np.linalg.norm(motions, axis=1)))]
        raise SceneError(f"supports: nothing resists the {most}; add a support, a contact or friction")


def _free_motions(scene: Scene, with_contacts: bool) -> tuple[Array, list[str]]:
    """Rigid motions (k, r) that no support, and with contacts no contact or friction, resists at all; their k names.

    Motions are those of the body, then one for each axis along which a force moves an obstacle.
    """
    dim, box = scene.dim, scene.geometry.box(scene.dim)
    centre, scale = box.mean(axis=0), float(np.ptp(box, axis=0).max())
    driven = [(name, axis) for name, obstacle in scene.obstacles.items() for axis in obstacle.driven()]
    if not with_contacts:
        driven = []
    kinds = [f"{kind} of the body" for kind in rigid_names(dim, scene.axisymmetric)]
    own = len(kinds)
    kinds += [f"motion of obstacles.{name} along {axis}, which a force moves" for name, axis in driven]
    blocks = [np.zeros((1, len(kinds)))]

    def fields(points: Array) -> Array:
        of_body = rigid_fields(points, centre, scale, scene.axisymmetric)
        return np.concatenate([of_body, np.zeros((len(points), dim, len(driven)))], axis=2)

    for support in scene.supports.values():
        if support.boundary is None:
            points, normals = np.array([support.point], float), np.zeros((1, dim))
        else:
            points, normals = scene.geometry.sample(support.boundary, dim)
        for axis in support.displacement:
            directions = normals if axis == "normal" else np.tile(np.eye(dim)[AXES[axis]], (len(points), 1))
            blocks.append(np.einsum("kd,kdj->kj", directions, fields(points)))
    for slave, master in scene.request().periodic:
        here, there = (fields(scene.geometry.sample(side, dim)[0]) for side in (slave, master))
        blocks.extend(here - there)
    for contact in scene.contacts.values() if with_contacts else ():
        points, _ = scene.geometry.sample(contact.surface, dim)
        relative = fields(points)
        for column, (name, axis) in enumerate(driven):
            if name == contact.against:
                relative[:, AXES[axis], own + column] -= 1.0
        if contact.tangential and contact.tangential.resists():
            blocks.extend(relative)
        else:
            normals = scene.obstacles[contact.against].normals(points)
            blocks.append(np.einsum("kd,kdj->kj", normals, relative))
    return np.asarray(null_space(np.concatenate(blocks), rcond=1e-9)), kinds
