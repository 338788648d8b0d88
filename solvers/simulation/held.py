"""Which rigid motions of the bodies nothing resists: no support, no contact, no friction."""

from __future__ import annotations

import numpy as np
from scipy.linalg import null_space

from geometry.arrays import Array
from solvers.fem.constraints import AXES
from solvers.fem.rigid_modes import rigid_fields, rigid_names
from solvers.scene.contact import Contact
from solvers.scene.loads import Support
from solvers.scene.scene import Scene


def free_motions(scene: Scene, with_contacts: bool) -> tuple[Array, list[str]]:
    """Rigid motions (k, r) that no support, and with contacts no contact or friction, resists at all; their k names.

    Motions are those of each body, then one for each axis along which a force moves an obstacle.
    """
    motions = Motions(scene, with_obstacles=with_contacts)
    blocks = [np.zeros((1, len(motions.kinds)))]
    for support in scene.supports.values():
        blocks += _supported(scene, support, motions)
    for slave, master in scene.request().periodic:
        here, there = (
            motions.fields(side.split(".")[0], scene.geometry.sample(side, scene.dim)[0]) for side in (slave, master)
        )
        blocks.extend(here - there)
    for contact in scene.contacts.values() if with_contacts else ():
        blocks += _touching(scene, contact, motions)
    return np.asarray(null_space(np.concatenate(blocks), rcond=1e-9)), motions.kinds


class Motions:
    """The rigid motions of a scene, and the displacement that each makes at a point."""

    def __init__(self, scene: Scene, with_obstacles: bool) -> None:
        self.scene, self.box = scene, scene.geometry.box(scene.dim)
        names = rigid_names(scene.dim, scene.axisymmetric)
        self.bodies = list(scene.bodies)
        obstacles = scene.obstacles.items() if with_obstacles else ()
        self.driven = [(name, axis) for name, obstacle in obstacles for axis in obstacle.driven()]
        several = len(self.bodies) > 1
        self.kinds = [
            f"{kind} of {f'bodies.{body}' if several else 'the body'}" for body in self.bodies for kind in names
        ]
        self.kinds += [f"motion of obstacles.{name} along {axis}, which a force moves" for name, axis in self.driven]
        self.each = len(names)

    def fields(self, body: str, points: Array) -> Array:
        """Displacement (m, d, k) of a body's points."""
        centre, scale = self.box.mean(axis=0), float(np.ptp(self.box, axis=0).max())
        found = np.zeros((*points.shape, len(self.kinds)))
        first = self.bodies.index(body) * self.each
        found[:, :, first : first + self.each] = rigid_fields(points, centre, scale, self.scene.axisymmetric)
        return found

    def of_obstacle(self, name: str, points: Array) -> Array:
        """Displacement (m, d, k) of an obstacle that forces drive."""
        found = np.zeros((*points.shape, len(self.kinds)))
        for column, (driven, axis) in enumerate(self.driven, start=len(self.bodies) * self.each):
            found[:, AXES[axis], column] = driven == name
        return found


def _supported(scene: Scene, support: Support, motions: Motions) -> list[Array]:
    dim = scene.dim
    if support.boundary is None:
        points, normals = np.array([support.point], float), np.zeros((1, dim))
        body = _nearest_body(scene, points)
    else:
        points, normals = scene.geometry.sample(support.boundary, dim)
        body = support.boundary.split(".")[0]
    fields = motions.fields(body, points)
    blocks = []
    for axis in support.displacement:
        directions = normals if axis == "normal" else np.tile(np.eye(dim)[AXES[axis]], (len(points), 1))
        blocks.append(np.einsum("kd,kdj->kj", directions, fields))
    return blocks


def _touching(scene: Scene, contact: Contact, motions: Motions) -> list[Array]:
    points, outward = scene.geometry.sample(contact.surface, scene.dim)
    relative = motions.fields(contact.surface.split(".")[0], points)
    if contact.against in scene.obstacles:
        relative -= motions.of_obstacle(contact.against, points)
        normals = scene.obstacles[contact.against].normals(points)
    else:
        relative -= motions.fields(contact.against.split(".")[0], points)
        normals = outward
    if contact.tangential and contact.tangential.resists():
        return list(relative)
    return [np.einsum("kd,kdj->kj", normals, relative)]


def _nearest_body(scene: Scene, point: Array) -> str:
    """The body with a side nearest to the point; the mesh will say it exactly."""
    distances = {
        side.split(".")[0]: np.linalg.norm(scene.geometry.sample(side, scene.dim)[0] - point, axis=1).min()
        for side in reversed(scene.sides())
    }
    return min(distances, key=lambda body: distances[body]) if len(scene.bodies) > 1 else next(iter(scene.bodies))
