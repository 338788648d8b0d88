"""The plan: which effects a scene calls for and why; what is off costs nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from geometry.errors import SceneError
from solvers.constraints import AXES, rigid_fields
from solvers.effects import EFFECTS
from solvers.effects.effect import Effect
from solvers.methods.table import METHODS
from solvers.nouns.scene import Scene

Array = NDArray[np.float64]


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
    _refuse_reversed(scene)
    _refuse_unheld(scene)
    method = method_of(scene)
    if not METHODS[method].floating and _free_motions(scene, with_contacts=False).shape[1]:
        raise SceneError(
            f"solver.method = {method}: needs bodies that their supports hold; this one is held by contact alone, "
            "use condensed-newton"
        )
    return tuple(PlanRow(e.name, bool(e.because(scene)), e.because(scene) or "not in the scene") for e in EFFECTS)


def method_of(scene: Scene) -> str:
    """The method that runs: `auto` is condensed-newton."""
    return "condensed-newton" if scene.solver.method == "auto" else scene.solver.method


def _refuse_reversed(scene: Scene) -> None:
    for name, contact in scene.contacts.items():
        points, outward = scene.geometry.sample(contact.surface, scene.dim)
        if np.any(scene.obstacles[contact.against].normals(points) @ outward >= 0):
            raise SceneError(
                f"obstacles.{contact.against}.normal: must point against {contact.surface} (contacts.{name}), "
                f"whose outward normal is {outward.tolist()}; reverse it"
            )


def _refuse_unheld(scene: Scene) -> None:
    motions = _free_motions(scene, with_contacts=True)
    if not motions.shape[1]:
        return
    names = ["x", "y", "z"][: scene.dim]
    kinds = [f"translation along {a}" for a in names]
    kinds += ["rotation"] if scene.dim == 2 else [f"rotation about {a}" for a in names]
    most = kinds[int(np.argmax(np.linalg.norm(motions, axis=1)))]
    raise SceneError(f"supports: nothing resists the {most} of the body; add a support, a contact or friction")


def _free_motions(scene: Scene, with_contacts: bool) -> Array:
    """Rigid motions (3 or 6, r) that no support, and with contacts no contact or friction, resists at all."""
    dim, size = scene.dim, np.array(scene.geometry.extent(scene.dim))
    centre, scale = size / 2, float(size.max())
    blocks = [np.zeros((1, 3 if dim == 2 else 6))]

    def add(points: Array, directions: Array) -> None:
        blocks.extend(directions @ field for field in rigid_fields(points, centre, scale))

    for support in scene.supports.values():
        if support.boundary is None:
            points, normal = np.array([support.point], float), np.zeros(dim)
        else:
            points, normal = scene.geometry.sample(support.boundary, dim)
        axes = [normal if axis == "normal" else np.eye(dim)[AXES[axis]] for axis in support.displacement]
        add(points, np.array(axes))
    for slave, master in scene.request().periodic:
        here, there = (rigid_fields(scene.geometry.sample(side, dim)[0], centre, scale) for side in (slave, master))
        blocks.extend(here - there)
    for contact in scene.contacts.values() if with_contacts else ():
        points, _ = scene.geometry.sample(contact.surface, dim)
        normals = scene.obstacles[contact.against].normals(points)
        for point, normal in zip(points, normals, strict=True):
            add(point[None], np.eye(dim) if contact.friction and contact.friction.resists() else normal[None])
    return np.asarray(null_space(np.concatenate(blocks), rcond=1e-9))
