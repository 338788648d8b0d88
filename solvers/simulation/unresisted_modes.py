"""Rigid modes that nothing resists: null spaces of supports, and of supports with contact and friction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import null_space

from stickslip.geometry.arrays import ROUNDING, Array
from stickslip.solvers.contact.rigid_obstacle import seen_from
from stickslip.solvers.fem.constraints import AXES
from stickslip.solvers.fem.rigid_fields import rigid_fields, rigid_names
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.scene.loads import Coupling, End, Support
from stickslip.solvers.scene.scene import Scene


@dataclass(frozen=True, kw_only=True)
class UnresistedModes:
    """Rigid modes of a scene that nothing resists.

    Coefficients run over the k rigid motions of all bodies, body by body, see `rigid_fields`.
    """

    rigid_modes: Array  # (k, r) orthonormal basis of the modes that no support or spring resists
    bedded: bool  # supports and compliant pressures together resist all modes of the bodies
    unheld: str  # a mode, in words, that no support, contact or friction resists either; empty if there is none


def unresisted_modes(scene: Scene) -> UnresistedModes:
    """Find the rigid modes that nothing resists, from sample points of the sides; nothing is meshed.

    Obstacles that forces drive move too: contact resists only motion relative to them.

    Raises:
        SceneError, GeometryError: the geometry does not have a side that the scene names.
    """
    motions = RigidMotions(scene)
    blocks = [np.zeros((1, len(motions.kinds)))]
    for support in scene.supports.values():
        blocks += _supported(scene, support, motions)
    for springs in scene.springs():
        points, normals = scene.geometry.sample(springs.boundary, scene.dim)
        fields = motions.fields(springs.boundary.split(".")[0], points)
        blocks += [np.einsum("kd,kdj->kj", along, fields) for along in springs.directions(normals)]
    for link in scene.links():
        moved = np.sum([sign * _mean(scene, end, motions) for end, sign in link.ends.values()], axis=0)
        blocks.append(link.directions @ moved)
    for coupling in scene.couplings():
        blocks += _held(scene, coupling, motions)
    for slave, master in scene.request().periodic:
        here, there = (
            motions.fields(side.split(".")[0], scene.geometry.sample(side, scene.dim)[0]) for side in (slave, master)
        )
        blocks.extend(here - there)
    supported = np.concatenate(blocks)[:, : len(motions.bodies) * motions.each]
    beds = [c for c in scene.contacts.values() if c.normal.at_quadrature]
    bedding = blocks + [
        block for contact in beds for block in _touching(scene, replace(contact, friction=None), motions)
    ]
    for contact in scene.contacts.values():
        blocks += _touching(scene, contact, motions)
    # singular values below this, relative to the largest, count as zero
    left = np.asarray(null_space(np.concatenate(blocks), rcond=ROUNDING))
    most = int(np.argmax(np.linalg.norm(left, axis=1))) if left.shape[1] else -1
    return UnresistedModes(
        rigid_modes=np.asarray(null_space(supported, rcond=ROUNDING)),
        bedded=not null_space(np.concatenate(bedding)[:, : len(motions.bodies) * motions.each], rcond=ROUNDING).size,
        unheld=motions.kinds[most] if most >= 0 else "",
    )


class RigidMotions:
    """The k rigid motions of a scene: those of its bodies, and those of the obstacles that forces drive.

    Attributes:
        kinds: each motion in words (k,).
        each: number of motions of one body.
    """

    def __init__(self, scene: Scene) -> None:
        """List the motions."""
        self.scene, self.box = scene, scene.geometry.box(scene.dim)
        names = rigid_names(scene.dim, scene.axisymmetric)
        self.bodies = list(scene.bodies)
        self.driven = [(name, axis) for name, obstacle in scene.obstacles.items() for axis in obstacle.driven()]
        several = len(self.bodies) > 1
        self.kinds = [
            f"{kind} of {f'bodies.{body}' if several else 'the body'}" for body in self.bodies for kind in names
        ]
        self.kinds += [f"motion of obstacles.{name} along {axis}, which a force moves" for name, axis in self.driven]
        self.each = len(names)

    def fields(self, body: str, points: Array) -> Array:
        """Displacement (m, d, k) of a body's points (m, d) [m] in each motion of size 1."""
        centre, scale = self.box.mean(axis=0), float(np.ptp(self.box, axis=0).max())
        found = np.zeros((*points.shape, len(self.kinds)))
        first = self.bodies.index(body) * self.each
        found[:, :, first : first + self.each] = rigid_fields(points, centre, scale, self.scene.axisymmetric)
        return found

    def of_obstacle(self, name: str, points: Array) -> Array:
        """Displacement (m, d, k) of an obstacle at points (m, d) [m] in each motion of size 1."""
        found = np.zeros((*points.shape, len(self.kinds)))
        for column, (driven, axis) in enumerate(self.driven, start=len(self.bodies) * self.each):
            found[:, AXES[axis], column] = driven == name
        return found


def _supported(scene: Scene, support: Support, motions: RigidMotions) -> list[Array]:
    """Rows (m, k): displacement in the directions that a support prescribes, one block for each direction."""
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


def _mean(scene: Scene, end: End, motions: RigidMotions) -> Array:
    """Displacement (d, k) of an end of a link in each motion of size 1; of a side the mean."""
    if isinstance(end, str):
        return np.asarray(motions.fields(end.split(".")[0], scene.geometry.sample(end, scene.dim)[0]).mean(axis=0))
    point = np.array([end], float)
    return np.asarray(motions.fields(_nearest_body(scene, point), point)[0])


def _held(scene: Scene, coupling: Coupling, motions: RigidMotions) -> list[Array]:
    """Rows (1, k): prescribed motion of a remote point; a rigid body has it in all of its points."""
    about, extent = np.array(coupling.point), float(np.ptp(motions.box, axis=0).max())
    points = np.concatenate([about[None], about + extent * np.eye(scene.dim)])
    of_point = rigid_fields(points, about, extent, scene.axisymmetric)
    moved = motions.fields(coupling.boundary.split(".")[0], points)
    found = np.linalg.pinv(of_point.reshape(-1, of_point.shape[2])) @ moved.reshape(-1, moved.shape[2])
    return [found[component : component + 1] for component in coupling.prescribed]


def _touching(scene: Scene, contact: Contact, motions: RigidMotions) -> list[Array]:
    """Rows (m, k): relative displacement that a contact resists; its normal part alone if it has no friction."""
    points, outward = scene.geometry.sample(contact.surface, scene.dim)
    relative = motions.fields(contact.surface.split(".")[0], points)
    if contact.against in scene.obstacles:
        relative -= motions.of_obstacle(contact.against, points)
        normals = seen_from(scene.obstacles[contact.against], points)[1]
    else:
        relative -= motions.fields(contact.against.split(".")[0], points)
        normals = outward
    if contact.tangential and contact.tangential.resists() and not is_faint(scene, contact):
        return list(relative)
    return [np.einsum("kd,kdj->kj", normals, relative)]


def is_faint(scene: Scene, contact: Contact) -> bool:
    """Whether the tangential springs of a contact are too soft to hold a body, beside the softest body's stiffness."""
    k_T = contact.tangential.k_T if contact.tangential else None
    return k_T is not None and k_T < least_springs(scene)


def least_springs(scene: Scene) -> float:
    """Stiffness [Pa/m] of the softest springs that can hold a body."""
    softest = min(material.least_modulus for material in scene.bodies.values())
    # of E / extent: a body held by softer tangential springs slides until rounding takes its stresses
    return ROUNDING * softest / float(np.ptp(scene.geometry.box(scene.dim), axis=0).max())


def _nearest_body(scene: Scene, point: Array) -> str:
    """The body with the side nearest to the point (1, d) [m]: an estimate from sample points, without a mesh."""
    distances = {
        side.split(".")[0]: np.linalg.norm(scene.geometry.sample(side, scene.dim)[0] - point, axis=1).min()
        for side in reversed(scene.sides())
    }
    return min(distances, key=lambda body: distances[body]) if len(scene.bodies) > 1 else next(iter(scene.bodies))
