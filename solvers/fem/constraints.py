"""Supports, periodic and rigid sides: u = T q + u_s(t), with q the free displacements.

Each rank knows what is prescribed at its own nodes, and at those of contact, periodic and rigid sides; so the numbering
of q needs no communication. Each node has d entries of q, also where displacements are prescribed: multigrid then sees
the blocks of elasticity. Entries that are not free are eliminated: their columns of T are zero. If all supports act
along axes, T only selects displacements. The free motions of a rigid side take the first entries of q of its nodes; the
others are eliminated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from mpi4py import MPI
from scipy import sparse
from scipy.linalg import null_space

from stickslip.geometry.arrays import LAST_DIGITS, ROUNDING, Array, Bools, Ints, Rows, cross
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.protocols import Comm, Mat
from stickslip.geometry.surfaces.surface import SECTOR
from stickslip.solvers.fem.remote_points import RemotePoint, RemotePoints
from stickslip.solvers.fem.springs import Links
from stickslip.solvers.parallel.replicated import from_rows
from stickslip.solvers.scene.timeline import Course, Drive, Place

AXES = {"x": 0, "y": 1, "z": 2}
AXIS = "axis of symmetry"


@dataclass(frozen=True, kw_only=True)
class Components(Rows):
    """The k prescribed components that a rank knows: direction . u = value of a drive at time t."""

    node: Ints  # (k,) global numbers, increasing; of a periodic node that of its root
    directions: Array  # (k, d) unit
    drive: Ints  # (k,) index in `Constraints.drives`
    support: Ints  # (k,) index in `Constraints.supports`
    points: Array  # (k, d) where an expression has its value [m]


@dataclass(frozen=True)
class Alike:
    """The k nodes with the same number r of prescribed components."""

    at: Ints  # (k,) indices in `Constraints.held`
    rows: Ints  # (k, r) indices of the components
    directions: Array  # (k, r, d)
    inverse: Array  # (k, d, r) pseudo-inverse of the directions
    own: Bools  # (k,) nodes of this rank


@dataclass(frozen=True, kw_only=True)
class Periodic:
    """The f eliminated nodes of periodic sides, and the nodes whose displacement they have; the same on every rank."""

    followers: Ints  # (f,) global numbers, increasing
    roots: Ints  # (f,)
    points: Array  # (f, d) of the followers [m]
    root_points: Array  # (f, d) [m]
    part: Ints  # (f,) of the mesh
    root_part: Ints  # (f,)
    turn: Array  # (f, d, d) by which the displacement of a root is that of its follower: 1, or that of cyclic sides
    fixed: Mapping[int, Array]  # of nodes on the axis of a turn, which follow themselves: directions (r, d) across it
    sectors: Array  # (s, d, d) by which displacements turn from here to each sector, see `of_sectors`: 1 is the first

    @property
    def cyclic(self) -> Bools:
        """Which followers (f,) turn."""
        return np.asarray((self.turn != np.eye(self.turn.shape[1])).any(axis=(1, 2)))


@dataclass(frozen=True)
class Sprung(Rows):
    """Directions at this rank's nodes in which springs resist motion, m of them."""

    points: Array  # (m, d) [m]
    directions: Array  # (m, d)
    part: Ints  # (m,) part of the mesh


@dataclass(frozen=True)
class Constraints:
    """Which displacements are prescribed, periodic or free. To make one is collective."""

    comm: Comm
    nodes: Nodes
    dim: int
    course: Course
    drives: tuple[Drive, ...]
    supports: tuple[str, ...]
    components: Components
    periodic: Periodic
    sprung: Sprung
    links: Links
    remote: RemotePoints
    parts: int  # number of parts
    axisymmetric: bool
    free_total: int = field(init=False)  # number of free entries of q
    selects: bool = field(init=False)  # whether T is diagonal with entries 0 and 1: it only selects displacements

    def __post_init__(self) -> None:
        """Count over all ranks."""
        gone = self.comm.allreduce(len(self.eliminated()))
        object.__setattr__(self, "free_total", int(self.dim * self.nodes.total - gone))
        along_axes = bool(np.all(self._bases[0] == self._bases[1][:, None] * np.eye(self.dim)))
        selects = along_axes and not len(self.followers) and not self.remote.rigid
        object.__setattr__(self, "selects", self.comm.allreduce(selects, op=MPI.LAND))

    @cached_property
    def held(self) -> Ints:
        """Nodes with prescribed components that this rank knows, increasing."""
        return np.unique(self.components.node)

    @property
    def followers(self) -> Ints:
        """Eliminated periodic nodes, increasing."""
        return self.periodic.followers

    def is_own(self, nodes: Ints) -> Bools:
        """Which of the nodes (n,) are of this rank."""
        return np.asarray((nodes >= self.nodes.offset) & (nodes < self.nodes.offset + self.nodes.owned))

    def roots(self, nodes: Ints) -> Ints:
        """The nodes (n,), with each eliminated periodic node replaced by its root."""
        found = np.asarray(nodes, np.int64) % SECTOR
        follows, at = _places(self.followers, found)
        found[follows] = self.periodic.roots[at]
        return found

    @cached_property
    def _bases(self) -> tuple[Array, Bools]:
        """Free directions of the nodes `held`, see `bases`."""
        shape = (len(self.held), self.dim, self.dim)
        columns, free = np.zeros(shape), np.zeros(shape[:2], bool)
        for alike in self.alike:
            flat = alike.directions.reshape(len(alike.at), -1)
            _, first, same = np.unique(flat, axis=0, return_index=True, return_inverse=True)
            bases = [_free_basis(matrix) for matrix in alike.directions[first]]
            columns[alike.at] = np.array([basis for basis, _ in bases])[same.ravel()]
            free[alike.at] = np.array([which for _, which in bases])[same.ravel()]
        return columns, free

    def bases(self, nodes: Ints) -> tuple[Array, Bools]:
        """Free directions of nodes (n,) that this rank knows; of eliminated periodic nodes those of their roots.

        Returns:
            Directions (n, d, d), one column for each of the node's d entries of q, zero if the entry is eliminated; and
            which entries are free (n, d). Nodes of rigid sides have none.
        """
        columns, free = np.tile(np.eye(self.dim), (len(nodes), 1, 1)), np.ones((len(nodes), self.dim), bool)
        held, at = _places(self.held, self.roots(nodes))
        columns[held], free[held] = self._bases[0][at], self._bases[1][at]
        if self.periodic.cyclic.any():
            columns = self.turns(nodes) @ columns
        rigid = np.isin(nodes % SECTOR, self._rigid_nodes)
        columns[rigid], free[rigid] = 0.0, False
        return columns, free

    def turns(self, nodes: Ints) -> Array:
        """By which the displacements of the roots of nodes (n,) turn to theirs (n, d, d)."""
        found = np.array(self.periodic.sectors[nodes // SECTOR])
        follows, at = _places(self.followers, nodes % SECTOR)
        found[follows] = found[follows] @ self.periodic.turn[at]
        return found

    def eliminated(self) -> Ints:
        """Indices in q of this rank's eliminated entries, increasing."""
        numbers = self.dim * self.held[:, None] + np.arange(self.dim)
        followers = self.dim * self.followers[:, None] + np.arange(self.dim)
        own = self.dim * self._rigid_nodes[:, None] + np.arange(self.dim)
        taken = np.concatenate([np.zeros(0, np.int64), *(self._motions(point) for point in self.remote.rigid)])
        rigid = np.setdiff1d(own.ravel(), taken)
        found = np.sort(np.concatenate([numbers[~self._bases[1]], followers.ravel(), rigid]))
        return np.asarray(found[self.is_own(found // self.dim)])

    def numbers(self, nodes: Ints) -> Ints:
        """Indices in q (n, d) of the d entries of each node, or of its root; some may be eliminated."""
        return np.asarray(self.dim * self.roots(nodes)[:, None] + np.arange(self.dim))

    def transformation(self) -> Mat:
        """T as a PETSc matrix, (d n, d n); collective."""
        d, low = self.dim, self.nodes.offset
        own = np.arange(low, low + self.nodes.owned)
        bases, numbers = self.bases(own)[0], self.numbers(own)
        given = bases != 0
        start = np.concatenate([[0], np.cumsum(given.sum(axis=2))])
        columns = np.broadcast_to(numbers[:, None], bases.shape)[given]
        size = (d * len(own), d * self.nodes.total)
        entries = sparse.csr_matrix((bases[given], columns, start), shape=size)
        for point in self.remote.rigid:
            mine, at = _places(own, point.nodes)
            node, i, j = np.nonzero(point.free[mine])
            places = d * at[node] + i, self._motions(point)[j]
            entries = entries + sparse.csr_matrix((point.free[mine][node, i, j], places), shape=size)
        return from_rows(entries, (size, size), self.comm, d)

    @cached_property
    def prescribed_nodes(self) -> Ints:
        """Global numbers of this rank's nodes with a prescribed component, also of periodic ones whose root has one.

        The nodes of rigid sides follow, see `RemotePoints.rigid`.
        """
        rigid = self._rigid_nodes
        return np.concatenate([self._alone_prescribed, rigid[self.is_own(rigid)]])

    @cached_property
    def _alone_prescribed(self) -> Ints:
        """Those but for the nodes of rigid sides."""
        follow = _places(self.held, self.roots(self.followers))[0]
        found = np.sort(np.concatenate([np.setdiff1d(self.held, self.followers), self.followers[follow]]))
        return np.asarray(found[self.is_own(found)])

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

    @property
    def apart(self) -> bool:
        """Whether all nodes are held by one support each, and by none that moves with others, on this rank."""
        return not len(self.followers) and all(
            bool((of == of[:, :1]).all()) for of in (self.components.support[alike.rows] for alike in self.alike)
        )

    @cached_property
    def alike(self) -> tuple[Alike, ...]:
        """The nodes `held`, grouped by their number of prescribed components."""
        _, first, counts = np.unique(self.components.node, return_index=True, return_counts=True)
        found = []
        for count in np.unique(counts):
            at = np.flatnonzero(counts == count)
            rows = first[at, None] + np.arange(count)
            directions = self.components.directions[rows]
            found.append(
                Alike(
                    at=at,
                    rows=rows,
                    directions=directions,
                    # sine of the angle below which two directions count as parallel
                    inverse=np.linalg.pinv(directions, rcond=ROUNDING) if count > 1 else np.swapaxes(directions, 1, 2),
                    own=self.is_own(self.held[at]),
                )
            )
        return tuple(found)

    def wanted(self, time: float) -> list[Array]:
        """Prescribed values (k, r) [m] at a time [s], for each group of `alike`; collective.

        Raises:
            SceneError: an expression has no finite value at a node.
        """
        of, failure = self.components, None
        values = np.array([self.course.value(drive, time) for drive in self.drives], float)[of.drive]
        for index, drive in enumerate(self.drives):
            if not isinstance(drive, Place) or drive not in self.course.timeline.expressions:
                continue
            at = np.flatnonzero(of.drive == index)
            exact = np.zeros(len(at))
            try:
                exact = self.course.timeline.values(drive, of.points[at], time) if len(at) else exact
            except SceneError as error:
                failure = failure or error
            largest = self.comm.allreduce(float(np.abs(exact).max(initial=0.0)), op=MPI.MAX)
            # of the largest value of an expression: smaller ones are zero, as sin(pi) is
            values[at] = np.where(np.abs(exact) > LAST_DIGITS * largest, exact, 0.0)
        self._raise_together(failure)
        return [values[alike.rows] for alike in self.alike]

    def prescribed(self, time: float) -> Array:
        """u_s (k, d) [m] at `prescribed_nodes` at a time [s]; collective.

        Raises:
            SceneError: two supports prescribe different displacements at one node.
        """
        found, wrong = np.zeros((len(self.held), self.dim)), [np.zeros(0, np.int64)]
        for alike, wanted in zip(self.alike, self.wanted(time), strict=True):
            found[alike.at] = np.einsum("kdr,kr->kd", alike.inverse, wanted)
            off = np.abs(np.einsum("krd,kd->kr", alike.directions, found[alike.at]) - wanted)
            wrong.append(alike.at[np.any(off > ROUNDING * np.abs(wanted).max(axis=1, keepdims=True), axis=1)])
        own = self.held[np.concatenate(wrong)]
        first = int(own[self.is_own(own)].min(initial=self.nodes.total))
        least = self.comm.allreduce(first, op=MPI.MIN)
        if least < self.nodes.total:
            self._raise_together(self._contradiction(first, time) if first == least else None)
        rigid = [point.prescribed(self.course, time)[self.is_own(point.nodes)] for point in self.remote.rigid]
        alone = found[self._of_prescribed]
        if self.periodic.cyclic.any():
            alone = np.einsum("kij,kj->ki", self.turns(self._alone_prescribed), alone)
        return np.concatenate([alone, *rigid])

    def _contradiction(self, node: int, time: float) -> SceneError:
        """Contradiction at a node of this rank."""
        of = {self.supports[index] for index in self.components.support[self.components.node == node]}
        names = sorted(name if name == AXIS else f"supports.{name}" for name in of)
        point = ", ".join(f"{x:.6g}" for x in self.nodes.points[node - self.nodes.offset])
        return SceneError(f"{' and '.join(names)}: contradict each other at the point ({point}) at t = {time:g}")

    def _raise_together(self, failure: SceneError | None) -> None:
        """Raise the first failure of any rank on every rank; collective."""
        for each in self.comm.allgather(failure):
            if each is not None:
                raise each

    def reactions(self, forces: Array) -> dict[str, tuple[Array, Array]]:
        """Distribute nodal forces among the supports; collective.

        A force is split along the prescribed directions; supports that overlap share it in the least-squares sense.

        Args:
            forces: (owned, d) [N] at this rank's nodes; those at nodes without a prescribed component are left out.

        Returns:
            For each support its force (d,) [N] and moment about the origin [N m], (1,) in 2D and (3,) in 3D; for each
            remote point whose motion is prescribed, as `RemotePoint.key`, with the moment about the point.
        """
        at, points = np.zeros((len(self.held), self.dim)), self._held_points
        alone = forces[self._alone_prescribed - self.nodes.offset]
        if self.periodic.cyclic.any():
            alone = np.einsum("kji,kj->ki", self.turns(self._alone_prescribed), alone)
        np.add.at(at, self._of_prescribed, alone)
        force = np.zeros((len(self.supports), self.dim))
        moment = np.zeros((len(self.supports), 1 if self.dim == 2 else 3))
        for alike in self.alike:
            share = np.einsum("kdr,kd->kr", alike.inverse, at[alike.at])
            pull = share[:, :, None] * alike.directions
            turn = cross(points[alike.at][:, None], pull).reshape(*share.shape, moment.shape[1])
            np.add.at(force, self.components.support[alike.rows], pull)
            np.add.at(moment, self.components.support[alike.rows], turn)
        for point, own in self._on_rigid(forces):
            for row, size in zip(point.rows, point.multipliers(own), strict=True):
                index = self.supports.index(row.support)
                force[index] += size * row.pull
                moment[index] += size * row.turn
        force, moment = self.comm.allreduce(force), self.comm.allreduce(moment)
        if self.axisymmetric:  # over the full circle the radial parts balance
            force, moment = force * [0, 1], 0 * moment
        return {name: (force[i], moment[i]) for i, name in enumerate(self.supports) if name != AXIS}

    @property
    def _held_points(self) -> Array:
        """Coordinates (k, d) [m] of the nodes `held` that are this rank's, or roots of periodic nodes; else 0."""
        found, own = np.zeros((len(self.held), self.dim)), self.is_own(self.held)
        root, at = _places(self.held, self.periodic.roots)
        found[at] = self.periodic.root_points[root]
        found[own] = self.nodes.points[self.held[own] - self.nodes.offset]
        return found

    def _on_rigid(self, forces: Array) -> Iterator[tuple[RemotePoint, Array]]:
        """Each remote point with a rigid side, and this rank's forces (n, d) [N] at its nodes, zero at those of others.

        Args:
            forces: (owned, d) [N] at this rank's nodes.
        """
        for point in self.remote.rigid:
            found, own = np.zeros(point.points.shape), self.is_own(point.nodes)
            found[own] = forces[point.nodes[own] - self.nodes.offset]
            yield point, found


def _free_basis(directions: Array) -> tuple[Array, Bools]:
    """Orthonormal directions (d, d), in columns, normal to the prescribed ones (r, d); and which columns are free (d,).

    Columns that are not free are zero.
    """
    d = directions.shape[1]
    if np.all(np.count_nonzero(directions, axis=1) == 1):
        free = ~directions.any(axis=0)
        return np.diag(free.astype(float)), free
    basis = null_space(directions, rcond=ROUNDING)
    return np.pad(basis, ((0, 0), (0, d - basis.shape[1]))), np.arange(d) < basis.shape[1]


def _places(among: Ints, nodes: Ints) -> tuple[Bools, Ints]:
    """Which of the nodes (n,) are in the increasing array `among`, and the indices there of those that are."""
    at = np.searchsorted(among, nodes)
    found = np.zeros(len(nodes), bool)
    inside = at < len(among)
    found[inside] = among[at[inside]] == nodes[inside]
    return found, at[found]
