"""Points coupled to sides: their motion as rows of weights of nodes, and sides that move as rigid bodies.

The motion z of a point has k components: translations [m] and rotations [rad]. The rows A of its side, z = A u, are
the mean displacement and the mean rotation of the side, exact for rigid motions; a force and moment f spread over the
side as A^T f, a traction linear in place. The nodes of a rigid side have u = Phi z; what is prescribed of z are rows
D z = b, so that z = Z y + z_s(t) with Z the null space of D; entries y of q replace those of the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy import sparse
from scipy.linalg import null_space

from stickslip.geometry.arrays import ROUNDING, Array, Ints
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.protocols import FunctionSpace, Sparse, Vec
from stickslip.geometry.surfaces.surface import Surface, gather_surface
from stickslip.solvers.fem.rigid_fields import parts_of_motion, rigid_fields
from stickslip.solvers.scene.loads import Coupling
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.timeline import Course, Drive, Place


@dataclass(frozen=True)
class RigidRow:
    """One prescribed component of a rigid side: direction . z = value of the drive at time t."""

    direction: Array  # (k,)
    drive: Drive
    support: str  # whose reaction it is, or `RemotePoint.key`
    pull: Array  # (d,) force at a multiplier of 1
    turn: Array  # (1,) or (3,) its moment about the origin, or about the point if it is the remote point's own [m]
    point: Array | None = None  # (d,) where the drive is an expression [m]


@dataclass(frozen=True, kw_only=True)
class RemotePoint:
    """A coupling on its mesh; the same on every rank."""

    coupling: Coupling
    nodes: Ints  # (n,) of the side, global numbers; corners of cells first
    points: Array  # (n, d) [m]
    part: Ints  # (n,) of the mesh
    fields: Array  # Phi (n, d, k)
    weights: Array  # A (k, n, d)
    rows: tuple[RigidRow, ...] = ()  # of a rigid side, those of supports at its nodes too

    @cached_property
    def _scale(self) -> Array:
        """(k,) units in which the components of z are of equal size, for singular values."""
        return np.asarray(np.linalg.norm(self.fields, axis=(0, 1)) / np.sqrt(len(self.nodes)))

    @cached_property
    def _rows(self) -> Array:
        """D (r, k), of z in its units."""
        return np.array([row.direction for row in self.rows]).reshape(-1, self.fields.shape[2])

    @cached_property
    def _sizes(self) -> Array:
        """(r,) of the rows of D, which have units of their own too: that of a rotation is 1 / length."""
        sizes = np.linalg.norm(self._rows / self._scale, axis=1)
        return np.where(sizes > 0, sizes, 1.0)  # around an axis no motion of the side is radial

    @cached_property
    def _directions(self) -> Array:
        return self._rows / self._scale / self._sizes[:, None]

    @cached_property
    def free(self) -> Array:
        """Displacement (n, d, f) of the nodes by each free motion y; they are orthonormal."""
        none, (n, d, k) = np.zeros((1, self.fields.shape[2])), self.fields.shape
        # singular values below this, relative to the largest, count as zero
        basis: Array = null_space(np.concatenate([none, self._directions]), rcond=ROUNDING)
        moved = (self.fields / self._scale).reshape(n * d, k) @ basis
        return np.asarray(np.linalg.qr(moved)[0].reshape(n, d, basis.shape[1]))

    def wanted(self, course: Course, time: float) -> Array:
        """b (r,) [m] at a time [s], as of motions of the side: rotations times its size."""

        def value(row: RigidRow) -> float:
            if row.point is None:
                return course.value(row.drive, time)
            assert isinstance(row.drive, Place)
            return float(course.timeline.values(row.drive, row.point[None], time)[0])

        return np.array([value(row) for row in self.rows], float) / self._sizes

    def prescribed(self, course: Course, time: float) -> Array:
        """Displacement (n, d) [m] of the nodes by z_s at a time [s].

        Raises:
            SceneError: what is prescribed contradicts itself.
        """
        wanted = self.wanted(course, time)
        z = np.linalg.pinv(self._directions, rcond=ROUNDING) @ wanted if self.rows else np.zeros(len(self._scale))
        if np.any(np.abs(self._directions @ z - wanted) > ROUNDING * np.abs(wanted).max(initial=0.0)):
            key = self.coupling.key
            also = ", ".join(sorted({f"supports.{row.support}" for row in self.rows} - {f"supports.{key}"}))
            raise SceneError(f"{key}: {also} cannot hold on its side, which is rigid, at t = {time:g}")
        return np.asarray(self.fields @ (z / self._scale))

    def multipliers(self, forces: Array) -> Array:
        """Force (r,) of each row, from the forces out of balance (n, d) [N] at the nodes."""
        pulled = np.einsum("nd,ndk->k", forces, self.fields) / self._scale
        return np.linalg.pinv(self._directions.T, rcond=ROUNDING) @ pulled / self._sizes if self.rows else np.zeros(0)

    def motion_of(self, modes: Array) -> Array:
        """D z (r, c) of displacement fields (n, d, c) of the nodes that are rigid; see `wanted`."""
        return np.asarray(self._rows / self._sizes[:, None] @ np.tensordot(self.weights, modes, 2))

    def left(self, modes: Array) -> Array:
        """(n d, c) what a rigid side lets not move of displacement fields (n, d, c) of its nodes."""
        return (modes - self.fields @ np.tensordot(self.weights, modes, 2)).reshape(-1, modes.shape[2])


@dataclass(frozen=True)
class RemotePoints:
    """All couplings of a problem on its mesh."""

    every: tuple[RemotePoint, ...]
    size: int  # number of all displacement dofs

    @property
    def rigid(self) -> tuple[RemotePoint, ...]:
        """Those with a rigid side."""
        return tuple(point for point in self.every if point.coupling.rigid)

    @cached_property
    def rows(self) -> Sparse:
        """(components, size): z of all points = rows @ displacement."""
        blocks = []
        for point in self.every:
            k, n, d = point.weights.shape
            dofs = np.tile((d * point.nodes[:, None] + np.arange(d)).ravel(), k)
            at = np.repeat(np.arange(k), n * d), dofs
            blocks.append(sparse.csr_matrix((point.weights.ravel(), at), shape=(k, self.size)))
        return sparse.vstack([sparse.csr_matrix((0, self.size)), *blocks]).tocsr()

    @cached_property
    def split(self) -> list[slice]:
        """Split the rows by the components of each point."""
        ends = np.cumsum([0, *(len(point.weights) for point in self.every)])
        return [slice(*pair) for pair in pairwise(ends.tolist())]

    def motion(self, u: Vec) -> Array:
        """z (components,) [m, rad] of all points in a displacement; collective."""
        if not self.every:
            return np.zeros(0)
        low, high = u.getOwnershipRange()
        return np.asarray(u.comm.tompi4py().allreduce(self.rows[:, low:high] @ u.array_r))

    def loads(self, like: Vec) -> list[tuple[Drive, Vec]]:
        """Nodal forces of a unit force or moment, each with its value in time."""
        found: list[tuple[Drive, Vec]] = []
        low, high = like.getOwnershipRange()
        for point, own in zip(self.every, self.split, strict=True):
            for component, place in point.coupling.loads.items():
                vector = like.duplicate()
                vector.array[:] = self.rows[own.start + component, low:high].toarray().ravel()
                found.append((place, vector))
        return found


def find_remote_points(problem: Problem, mesh: Mesh, space: FunctionSpace, nodes: Nodes) -> RemotePoints:
    """The remote points of a problem on its mesh, those of rigid sides without the rows of supports; collective."""
    found = []
    for coupling in problem.couplings:
        side, about = gather_surface(mesh, space, nodes, coupling.boundary), np.array(coupling.point)
        fields = rigid_fields(side.points, about, 1.0, mesh.axisymmetric)
        rows = list[RigidRow]()
        for component, drive in coupling.prescribed.items():
            unit = np.eye(fields.shape[2])[component]
            rows.append(RigidRow(unit, drive, coupling.key, *parts_of_motion(unit, mesh.dim)))
        found.append(
            RemotePoint(
                coupling=coupling,
                nodes=side.nodes,
                points=side.points,
                part=side.part,
                fields=fields,
                weights=mean_motion(side, about),
                rows=tuple(rows),
            )
        )
    return RemotePoints(tuple(found), mesh.dim * nodes.total)


def mean_motion(side: Surface, about: Array) -> Array:
    """Weights A (k, n, d) of a side's nodes: of all rigid motions A u is the nearest to u, in the mean square."""
    areas, basis = side.quadrature(2 * side.degree + 2)
    x = np.einsum("qi,fid->fqd", basis, side.points[side.facets])
    centre = np.einsum("fq,fqd->d", areas, x) / areas.sum()
    flat = rigid_fields(x.reshape(-1, side.dim), centre, 1.0, side.axisymmetric)
    fields = flat.reshape(*areas.shape, *flat.shape[1:])
    gram = np.einsum("fq,fqdk,fqdl->kl", areas, fields, fields)
    weights = np.einsum("fq,fqdk,qi->kdfi", areas, fields, basis)
    nodal = np.array([[side.scatter(values) for values in row] for row in weights])  # (k, d, n)
    mean = np.tensordot(np.linalg.inv(gram), nodal, 1)
    at_point = np.eye(len(gram))  # from the motion about the centre to that about the point
    if not side.axisymmetric:
        at_point[: side.dim] = rigid_fields(about[None], centre, 1.0, False)[0]
    return np.asarray(np.tensordot(at_point, mean, 1).swapaxes(1, 2))
