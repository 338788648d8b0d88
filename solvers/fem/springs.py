"""Springs: links between places, and what springs per area between sides and the ground exert on the bodies.

The stress of the latter is linear and symmetric, so a component of the force or moment is the work of it on a rigid
motion, which is in every finite element space: one row of forces a component, assembled once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CLOSE, Array, Ints
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.protocols import Comm, FunctionSpace, Mat, Sparse, Vec
from stickslip.geometry.surfaces.surface import gather_surface
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.fem.rigid_fields import parts_of_motion, rigid_names
from stickslip.solvers.parallel.replicated import from_rows
from stickslip.solvers.scene.loads import End, Link
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.timeline import Drive, Place

MOST = 3000  # nodes of a side that a spring couples with each other: its part of K is dense


@dataclass(frozen=True, kw_only=True)
class Rest:
    """Elongation at which links pull nothing: (r,) at value 1 of its drive [m]."""

    drive: Drive
    elongation: Array
    tension: Place | None = None  # [N] given, of a single spring: the value is then found
    held_from: float = np.inf  # [s], from there on it is kept
    slack: bool = False  # of a single spring that acts in one way: the value is found, at least -gap
    gap: float = 0.0  # [m] before that spring acts


@dataclass(frozen=True)
class Spot:
    """Nodes (n,) whose weighted sum is a displacement: that of a vertex, or the mean over a side."""

    nodes: Ints  # global numbers
    points: Array  # (n, d) [m]
    part: Ints  # of the mesh
    weights: Array  # their sum is 1


@dataclass(frozen=True)
class Links:
    """All linear springs between places, r of them; the same on every rank."""

    names: tuple[tuple[str, str], ...]  # (r,) table and name of the scene
    rests: tuple[Rest, ...]
    directions: Array  # (r, d)
    stiffness: Array  # (r,) [N/m]
    rows: Sparse  # (r, d nodes): elongation = rows @ displacement, the motion of the ground left out
    points: Array  # (w, d) [m] of the weighted nodes, and for each of them:
    weights: Array  # (w, d) weight in the elongation, by direction
    part: Ints  # (w,) of the mesh
    of: Ints  # (w,) the row

    def __bool__(self) -> bool:
        return len(self.stiffness) > 0

    def elongation(self, u: Vec) -> Array:
        """Elongation (r,) [m] in a displacement, the motion of the ground left out; collective."""
        if not self:
            return np.zeros(0)
        low, high = u.getOwnershipRange()
        return np.asarray(u.comm.tompi4py().allreduce(self.rows[:, low:high] @ u.array_r))

    def forces(self, like: Vec, tension: Array) -> Vec:
        """Inner forces [N] of springs under tension (r,) [N]; like: a vector over all displacements."""
        found = like.duplicate()
        low, high = found.getOwnershipRange()
        found.array[:] = self.rows[:, low:high].T @ tension
        return found

    def added(self, forces: Vec, elongation: Array) -> Vec:
        """Inner forces [N] plus those of springs with an elongation (r,) [m]; `forces` itself without springs."""
        return forces if not self else forces + self.forces(forces, self.stiffness * elongation)

    def inner(self, u: Vec, of_bodies: Vec) -> Vec:
        """Inner forces [N] of the bodies and of the springs, in a displacement u [m]; collective."""
        return self.added(of_bodies, self.elongation(u))

    def matrix(self, like: Mat) -> Mat:
        """Stiffness of the springs, a PETSc matrix of the layout of `like` [N/m]; collective."""
        low, high = like.getOwnershipRange()
        own = (self.rows[:, low:high].T @ sparse.diags(self.stiffness) @ self.rows).tocsr()
        own.sort_indices()
        return from_rows(own, like.getSizes(), like.comm, self.directions.shape[1])

    @property
    def at_rest(self) -> Array:
        """Elongations (rests, r) [m] of `rests`."""
        return np.array([rest.elongation for rest in self.rests]).reshape(len(self.rests), len(self.stiffness))

    def resultants(self, tension: Array) -> dict[tuple[str, str], Array]:
        """Force (d,) [N] of each link on the body at its end `at`, by table and name; tension: (r,) [N]."""
        found = {name: np.zeros(self.directions.shape[1]) for name in self.names}
        for name, direction, pull in zip(self.names, self.directions, tension, strict=True):
            found[name] -= pull * direction
        return found

    @cached_property
    def parts(self) -> list[int]:
        """Parts of the mesh that they touch."""
        return sorted(set(self.part.tolist()))


def find_links(problem: Problem, mesh: Mesh, space: FunctionSpace, nodes: Nodes) -> Links:
    """The links of a problem on its mesh; collective.

    Raises:
        SceneError: no mesh vertex lies at an end, or a side has too many nodes.
    """
    d, known = mesh.dim, dict[End, Spot]()
    rows = [(link, k) for link in problem.links for k in range(len(link.stiffness))]
    of, points, weights, part, dofs = [], [np.zeros((0, d))], [np.zeros((0, d))], [np.zeros(0, np.int64)], []
    for row, (link, k) in enumerate(rows):
        for key, (end, sign) in link.ends.items():
            if end not in known:
                known[end] = _spot(mesh, space, nodes, end, key)
            spot = known[end]
            of.append(np.full(len(spot.nodes), row))
            points.append(spot.points)
            weights.append(sign * spot.weights[:, None] * link.directions[k])
            part.append(spot.part)
            dofs.append(d * spot.nodes[:, None] + np.arange(d))
    size = (len(rows), d * nodes.total)
    matrix = sparse.csr_matrix(size)
    if rows:
        values = np.concatenate(weights)
        at = np.repeat(np.concatenate(of), d), np.concatenate(dofs).ravel()
        matrix = sparse.csr_matrix((values.ravel(), at), shape=size)
        matrix.eliminate_zeros()
    return Links(
        names=tuple((link.table, link.name) for link, _ in rows),
        rests=tuple(_rest(problem, link, place) for link in problem.links for place in link.rests),
        directions=np.array([link.directions[k] for link, k in rows]).reshape(-1, d),
        stiffness=np.array([link.stiffness[k] for link, k in rows]),
        rows=matrix,
        points=np.concatenate(points),
        weights=np.concatenate(weights),
        part=np.concatenate(part),
        of=np.concatenate([np.zeros(0, np.int64), *of]),
    )


def _rest(problem: Problem, link: Link, place: Place) -> Rest:
    """A value in time of one of the links; the others do not follow it."""
    every = [own.rests[place] if own is link else 0.0 * own.stiffness for own in problem.links]
    return Rest(
        drive=place,
        elongation=np.concatenate(every),
        tension=link.tension,
        held_from=link.held_from,
        slack=place == link.slack,
        gap=link.gap,
    )


def _spot(mesh: Mesh, space: FunctionSpace, nodes: Nodes, end: End, key: str) -> Spot:
    if not isinstance(end, str):
        number, x, part = vertex_at(mesh, nodes, np.array(end), key)
        return Spot(number, x, part, np.ones(1))
    side = gather_surface(mesh, space, nodes, end)
    if len(side.nodes) > MOST:
        raise SceneError(
            f"{key} = {end}: has {len(side.nodes)} nodes, at most {MOST}; elastic_support takes any number"
        )
    areas, basis = side.quadrature(2 * side.degree + side.axisymmetric)
    integrals = side.scatter(areas @ basis)
    return Spot(side.nodes, side.points, side.part, integrals / integrals.sum())


def vertex_at(mesh: Mesh, nodes: Nodes, point: Array, key: str) -> tuple[Ints, Array, Ints]:
    """Number, coordinates and part of the mesh vertex at a point (d,) [m], each with one row; collective.

    Raises:
        SceneError: no vertex lies there.
    """
    own = nodes.points[: nodes.owned]
    distance = np.linalg.norm(own - point, axis=1)
    best = int(np.argmin(distance)) if len(own) else -1
    offers = mesh.comm.allgather(
        (distance[best], int(nodes.number[best]), own[best], int(nodes.part[best]))
        if len(own)
        else (np.inf, -1, point, -1)
    )
    nearest, number, x, found = min(offers, key=lambda offer: offer[0])
    low, high = mesh.box()
    if nearest > CLOSE * float(np.max(high - low)):
        at = ", ".join(f"{c:.6g}" for c in x)
        raise SceneError(f"{key} = {point.tolist()}: no mesh vertex there; the nearest is ({at})")
    return np.array([number]), np.array([x]), np.array([found])


@dataclass(frozen=True)
class GroundSprings:
    """All springs to the ground of a problem, each with k components: force [N], and moment about the origin [N m]."""

    keys: tuple[str, ...]
    forces: Sparse  # (keys k, own dofs) by unit translation [N/m] or rotation [N]
    comm: Comm

    @classmethod
    def of(cls, weak: WeakForms) -> GroundSprings:
        """Assemble the rows; collective."""
        rows, dim = list[Sparse](), weak.mesh.dim
        modes = np.eye(len(rigid_names(dim, weak.mesh.axisymmetric)))
        for springs in weak.problem.springs:
            translation, rotation = (weak.constant(part) for part in parts_of_motion(0 * modes[0], dim))
            form = weak.compile(weak.springs(springs, weak.rigid_motion(translation, rotation)))
            for mode in modes:
                translation.value[:], rotation.value[:] = parts_of_motion(mode, dim)
                rows.append(sparse.csr_matrix(dx.assemble_vector(form).array_r))
        forces = sparse.vstack(rows).tocsr() if rows else sparse.csr_matrix((0, 0))
        return cls(tuple(springs.key for springs in weak.problem.springs), forces, weak.mesh.comm)

    def exerted(self, u: Vec) -> Array:
        """All components on the bodies (keys k,) in a displacement [m]; collective."""
        if not self.keys:
            return np.zeros(0)
        return np.asarray(self.comm.allreduce(-(self.forces @ u.array_r)))

    def by_key(self, components: Array, dim: int) -> Mapping[str, tuple[Array, Array]]:
        """Force (d,) [N] and moment (1,) or (3,) [N m] of each; radial forces and moments are 0 over a full circle."""
        each = np.split(components, max(len(self.keys), 1))
        return {key: parts_of_motion(own, dim) for key, own in zip(self.keys, each, strict=False)}
