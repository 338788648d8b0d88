"""Supports, periodic and rigid sides: u = T q + u_s(t), with q the free displacements.

Every rank stores all prescribed nodes (O(N^(2/3)) data), so the numbering of q needs no communication. Each node has d
entries of q, also where displacements are prescribed: multigrid then sees the blocks of elasticity. Entries that are
not free are eliminated: their columns of T are zero. If all supports act along axes, T only selects displacements.
The free motions of a rigid side take the first entries of q of its nodes; the others are eliminated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from petsc4py import PETSc
from scipy import sparse
from scipy.linalg import null_space

from stickslip.geometry.arrays import Array, Bools, Ints, cross
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.protocols import Comm, Mat
from stickslip.solvers.fem.links import Links
from stickslip.solvers.fem.remote_points import RemotePoint, RemotePoints
from stickslip.solvers.scene.timeline import Course, Drive, Place

AXES = {"x": 0, "y": 1, "z": 2}
AXIS = "axis of symmetry"
ROUNDED = 1e-14  # of the largest value of an expression: smaller ones are zero, as sin(pi) is
SMALL = 1e-10  # sine of the angle below which two directions count as parallel


@dataclass(frozen=True)
class Row:
    """One prescribed component: direction . u = value of the drive at time t."""

    direction: Array  # (d,) unit
    drive: Drive
    support: str
    point: Array | None = None  # (d,) where the drive is an expression [m]


@dataclass(frozen=True)
class Alike:
    """The k nodes with the same number r of prescribed components."""

    at: Ints  # (k,) indices in `Constraints.held`
    directions: Array  # (k, r, d)
    inverse: Array  # (k, d, r) pseudo-inverse of the directions
    drives: Ints  # (k, r) index of the drive
    supports: Ints  # (k, r) index of the support


@dataclass(frozen=True)
class Sprung:
    """Directions at nodes in which springs resist motion, m of them."""

    points: Array  # (m, d) [m]
    directions: Array  # (m, d)
    part: Ints  # (m,) part of the mesh


@dataclass(frozen=True)
class Constraints:
    """Which displacements are prescribed, periodic or free; the same on every rank."""

    nodes: Nodes
    dim: int
    course: Course
    rows: Mapping[int, tuple[Row, ...]]  # prescribed components by global node; of a periodic node under its root
    root: Mapping[int, int]  # eliminated periodic node -> the node whose displacement it has
    points: Mapping[int, Array]  # coordinates (d,) [m] of the nodes above
    part: Mapping[int, int]  # part of the mesh that each of them belongs to
    sprung: Sprung
    links: Links
    remote: RemotePoints
    parts: int  # number of parts
    axisymmetric: bool

    @cached_property
    def held(self) -> Ints:
        """Nodes with prescribed components, increasing."""
        return np.array(sorted(self.rows), np.int64)

    @cached_property
    def followers(self) -> Ints:
        """Eliminated periodic nodes, increasing."""
        return np.array(sorted(self.root), np.int64)

    def roots(self, nodes: Ints) -> Ints:
        """The nodes (n,), with each eliminated periodic node replaced by its root."""
        found = np.array(nodes, np.int64)
        follows, at = _places(self.followers, found)
        leaders = np.array([self.root[int(n)] for n in self.followers], np.int64)
        found[follows] = leaders[at]
        return found

    @cached_property
    def _bases(self) -> tuple[Array, Bools]:
        """Free directions of the nodes `held`, see `bases`."""
        known: dict[bytes, tuple[Array, Bools]] = {}
        shape = (len(self.held), self.dim, self.dim)
        columns, free = np.zeros(shape), np.zeros(shape[:2], bool)
        for alike in self.alike:
            for place, matrix in zip(alike.at, alike.directions, strict=True):
                key = matrix.tobytes()
                if key not in known:
                    known[key] = _free_basis(matrix)
                columns[place], free[place] = known[key]
        return columns, free

    def bases(self, nodes: Ints) -> tuple[Array, Bools]:
        """Free directions of nodes (n,); of eliminated periodic nodes those of their roots.

        Returns:
            Directions (n, d, d), one column for each of the node's d entries of q, zero if the entry is eliminated; and
            which entries are free (n, d). Nodes of rigid sides have none.
        """
        columns, free = np.tile(np.eye(self.dim), (len(nodes), 1, 1)), np.ones((len(nodes), self.dim), bool)
        held, at = _places(self.held, self.roots(nodes))
        columns[held], free[held] = self._bases[0][at], self._bases[1][at]
        rigid = np.isin(nodes, self._rigid_nodes)
        columns[rigid], free[rigid] = 0.0, False
        return columns, free

    def eliminated(self) -> Ints:
        """Indices in q of the eliminated entries, increasing."""
        numbers = self.dim * self.held[:, None] + np.arange(self.dim)
        followers = self.dim * self.followers[:, None] + np.arange(self.dim)
        own = self.dim * self._rigid_nodes[:, None] + np.arange(self.dim)
        taken = np.concatenate([np.zeros(0, np.int64), *(self._motions(point) for point in self.remote.rigid)])
        rigid = np.setdiff1d(own.ravel(), taken)
        return np.sort(np.concatenate([numbers[~self._bases[1]], followers.ravel(), rigid]))

    @cached_property
    def selects(self) -> bool:
        """Whether T is diagonal with entries 0 and 1: it only selects displacements."""
        return (
            not self.root
            and not self.remote.rigid
            and bool(np.all(self._bases[0] == self._bases[1][:, None] * np.eye(self.dim)))
        )

    def numbers(self, nodes: Ints) -> Ints:
        """Indices in q (n, d) of the d entries of each node, or of its root; some may be eliminated."""
        return np.asarray(self.dim * self.roots(nodes)[:, None] + np.arange(self.dim))

    @cached_property
    def free_total(self) -> int:
        """Number of free entries of q."""
        return int(self.dim * self.nodes.total - len(self.eliminated()))

    def transformation(self, comm: Comm) -> Mat:
        """T as a PETSc matrix, (d n, d n)."""
        d, low = self.dim, self.nodes.offset
        own = np.arange(low, low + self.nodes.owned)
        bases, numbers = self.bases(own)[0], self.numbers(own)
        node, i, j = np.nonzero(bases)
        row, column, value = [d * node + i], [numbers[node, j]], [bases[node, i, j]]
        for point in self.remote.rigid:
            mine, at = _places(own, point.nodes)
            node, i, j = np.nonzero(point.free[mine])
            row.append(d * at[node] + i)
            column.append(self._motions(point)[j])
            value.append(point.free[mine][node, i, j])
        size = (d * len(own), d * self.nodes.total)
        entries = sparse.csr_matrix((np.concatenate(value), (np.concatenate(row), np.concatenate(column))), shape=size)
        csr = (entries.indptr.astype(PETSc.IntType), entries.indices.astype(PETSc.IntType), entries.data)
        matrix = PETSc.Mat().createAIJ((size, size), bsize=d, csr=csr, comm=comm)
        matrix.assemble()
        found: Mat = matrix
        return found

    @cached_property
    def prescribed_nodes(self) -> Ints:
        """Global numbers of all nodes with a prescribed component, also of periodic nodes whose root has one.

        The nodes of rigid sides follow, see `RemotePoints.rigid`.
        """
        return np.concatenate([self._alone_prescribed, self._rigid_nodes])

    @cached_property
    def _alone_prescribed(self) -> Ints:
        """Those but for the nodes of rigid sides."""
        follow = _places(self.held, self.roots(self.followers))[0]
        return np.sort(np.concatenate([np.setdiff1d(self.held, self.followers), self.followers[follow]]))

    @cached_property
    def _rigid_nodes(self) -> Ints:
        return np.concatenate([np.zeros(0, np.int64), *(point.nodes for point in self.remote.rigid)])

    def _motions(self, point: RemotePoint) -> Ints:
        """Indices in q of the free motions of a rigid side."""
        entries = self.dim * point.nodes[:, None] + np.arange(self.dim)
        return np.asarray(entries.ravel()[: point.free.shape[2]])

    @cached_property
    def _of_prescribed(self) -> Ints:
        """Index in `held` of each of the `prescribed_nodes` that are not of rigid sides."""
        return _places(self.held, self.roots(self._alone_prescribed))[1]

    @cached_property
    def _drives(self) -> dict[Drive, int]:
        """Index of each drive."""
        return {drive: i for i, drive in enumerate(dict.fromkeys(r.drive for n in self.rows.values() for r in n))}

    @cached_property
    def _supports(self) -> dict[str, int]:
        """Index of each support."""
        of_rigid = [row.support for point in self.remote.rigid for row in point.rows]
        names = [r.support for n in self.rows.values() for r in n] + of_rigid
        return {name: i for i, name in enumerate(dict.fromkeys(names))}

    @property
    def apart(self) -> bool:
        """Whether all nodes are held by one support each, and by none that moves with others, on this rank."""
        return not len(self.followers) and all(len({row.support for row in rows}) == 1 for rows in self.rows.values())

    @cached_property
    def alike(self) -> tuple[Alike, ...]:
        """The nodes `held`, grouped by their number of prescribed components."""
        by_count: dict[int, list[int]] = {}
        for place, node in enumerate(self.held.tolist()):
            by_count.setdefault(len(self.rows[node]), []).append(place)
        found = []
        for count, places in by_count.items():
            rows = [row for place in places for row in self.rows[int(self.held[place])]]
            directions = np.array([row.direction for row in rows]).reshape(-1, count, self.dim)
            found.append(
                Alike(
                    at=np.array(places),
                    directions=directions,
                    inverse=np.linalg.pinv(directions, rcond=SMALL) if count > 1 else np.swapaxes(directions, 1, 2),
                    drives=np.array([self._drives[r.drive] for r in rows]).reshape(-1, count),
                    supports=np.array([self._supports[r.support] for r in rows]).reshape(-1, count),
                )
            )
        return tuple(found)

    def wanted(self, time: float) -> list[Array]:
        """Prescribed values (k, r) [m] at a time [s], for each group of `alike`."""
        values = np.array([self.course.value(drive, time) for drive in self._drives])
        found = [values[alike.drives] for alike in self.alike]
        for place, points in self._points.items():
            exact = self.course.timeline.values(place, points, time)
            exact = np.where(np.abs(exact) > ROUNDED * np.abs(exact).max(), exact, 0.0)
            for group, alike in zip(found, self.alike, strict=True):
                at = alike.drives == self._drives[place]
                group[at], exact = exact[: at.sum()], exact[at.sum() :]
        return found

    @cached_property
    def _points(self) -> dict[Place, Array]:
        """Points (n, d) [m] at which each expression prescribes a displacement, in the order of `alike`."""
        ordered = [row for alike in self.alike for place in alike.at for row in self.rows[int(self.held[place])]]
        found: dict[Place, list[Array]] = {}
        for row in ordered:
            if row.point is not None and isinstance(row.drive, Place):
                found.setdefault(row.drive, []).append(row.point)
        return {place: np.array(points) for place, points in found.items()}

    def prescribed(self, time: float) -> Array:
        """u_s (k, d) [m] at `prescribed_nodes` at a time [s].

        Raises:
            SceneError: two supports prescribe different displacements at one node.
        """
        found, wrong = np.zeros((len(self.held), self.dim)), [np.zeros(0, np.int64)]
        for alike, wanted in zip(self.alike, self.wanted(time), strict=True):
            found[alike.at] = np.einsum("kdr,kr->kd", alike.inverse, wanted)
            off = np.abs(np.einsum("krd,kd->kr", alike.directions, found[alike.at]) - wanted)
            wrong.append(alike.at[np.any(off > 1e-9 * np.abs(wanted).max(axis=1, keepdims=True), axis=1)])
        if np.concatenate(wrong).size:
            self._refuse(int(self.held[np.concatenate(wrong).min()]), time)
        rigid = [point.prescribed(self.course, time) for point in self.remote.rigid]
        return np.concatenate([found[self._of_prescribed], *rigid])

    def _refuse(self, node: int, time: float) -> None:
        names = {row.support if row.support == AXIS else f"supports.{row.support}" for row in self.rows[node]}
        point = ", ".join(f"{x:.6g}" for x in self.points[node])
        raise SceneError(f"{' and '.join(sorted(names))}: contradict each other at the point ({point}) at t = {time:g}")

    def reactions(self, forces: Array) -> dict[str, tuple[Array, Array]]:
        """Distribute nodal forces among the supports.

        A force is split along the prescribed directions; supports that overlap share it in the least-squares sense.

        Args:
            forces: (k, d) [N] at `prescribed_nodes`.

        Returns:
            For each support its force (d,) [N] and moment about the origin [N m], (1,) in 2D and (3,) in 3D; for each
            remote point whose motion is prescribed, as `RemotePoint.key`, with the moment about the point.
        """
        at = np.zeros((len(self.held), self.dim))
        np.add.at(at, self._of_prescribed, forces[: len(self._of_prescribed)])
        points = self.points_of(self.held)
        force = np.zeros((len(self._supports), self.dim))
        moment = np.zeros((len(self._supports), 1 if self.dim == 2 else 3))
        for alike in self.alike:
            share = np.einsum("kdr,kd->kr", alike.inverse, at[alike.at])
            pull = share[:, :, None] * alike.directions
            turn = cross(points[alike.at][:, None], pull).reshape(*share.shape, moment.shape[1])
            np.add.at(force, alike.supports, pull)
            np.add.at(moment, alike.supports, turn)
        for point, own in self._on_rigid(forces):
            for row, size in zip(point.rows, point.multipliers(own), strict=True):
                force[self._supports[row.support]] += size * row.pull
                moment[self._supports[row.support]] += size * row.turn
        if self.axisymmetric:  # over the full circle the radial parts balance
            force, moment = force * [0, 1], 0 * moment
        return {name: (force[i], moment[i]) for name, i in self._supports.items() if name != AXIS}

    def _on_rigid(self, forces: Array) -> Iterator[tuple[RemotePoint, Array]]:
        """Each remote point with a rigid side, and the forces (n, d) [N] at its nodes."""
        first = len(self._of_prescribed)
        for point in self.remote.rigid:
            yield point, forces[first : first + len(point.nodes)]
            first += len(point.nodes)

    def points_of(self, nodes: Ints) -> Array:
        """Coordinates (n, d) [m] of nodes that are prescribed, periodic or the root of a periodic node."""
        return np.array([self.points[int(n)] for n in nodes]).reshape(-1, self.dim)


def _free_basis(directions: Array) -> tuple[Array, Bools]:
    """Orthonormal directions (d, d), in columns, normal to the prescribed ones (r, d); and which columns are free (d,).

    Columns that are not free are zero.
    """
    d = directions.shape[1]
    if np.all(np.count_nonzero(directions, axis=1) == 1):
        free = ~directions.any(axis=0)
        return np.diag(free.astype(float)), free
    basis = null_space(directions, rcond=SMALL)
    return np.pad(basis, ((0, 0), (0, d - basis.shape[1]))), np.arange(d) < basis.shape[1]


def _places(among: Ints, nodes: Ints) -> tuple[Bools, Ints]:
    """Which of the nodes (n,) are in the increasing array `among`, and the indices there of those that are."""
    at = np.searchsorted(among, nodes)
    found = np.zeros(len(nodes), bool)
    inside = at < len(among)
    found[inside] = among[at[inside]] == nodes[inside]
    return found, at[found]
