"""Supports and periodic sides: u = T q + u_s(t), with q the free displacements.

All that is prescribed is known on every rank (O(N^(2/3)) data), so the free numbers need no communication. A node has
d numbers whatever is prescribed there, its free ones first: multigrid then sees the blocks of elasticity. Numbers that
are not free are the eliminated ones: zero columns of T.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.linalg import null_space
from scipy.spatial import cKDTree

from geometry.amplitude import Amplitude, value_at
from geometry.errors import GeometryError, SceneError
from geometry.mesh import Mesh
from geometry.nodes import Nodes
from geometry.surface import gather_surface
from solvers.nouns.scene import Scene

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
AXES = {"x": 0, "y": 1, "z": 2}
AXIS = "axis of symmetry"


@dataclass(frozen=True)
class Row:
    """One prescribed component: direction . u = amplitude(t)."""

    direction: Array  # (d,) unit
    amplitude: Amplitude
    support: str


@dataclass(frozen=True)
class Alike:
    """Nodes that the same supports prescribe in the same directions."""

    index: Ints  # (n,) where they stand in `Constraints.rows`
    part: Ints  # (n,) of the mesh
    points: Array  # (n, d) [m]
    rows: tuple[Row, ...]  # of each
    matrix: Array  # (r, d) their directions
    inverse: Array  # (d, r) its pseudo-inverse


@dataclass(frozen=True)
class Constraints:
    """Which displacements are free."""

    nodes: Nodes
    dim: int
    end: float  # time at which bare numbers are reached
    rows: Mapping[int, tuple[Row, ...]]  # by global node; for periodic nodes by their root
    root: Mapping[int, int]  # eliminated periodic node -> the node that it follows
    points: Mapping[int, Array]  # coordinates of the nodes named above
    part: Mapping[int, int]  # the connected parts of the mesh that they belong to
    parts: int  # how many there are
    axisymmetric: bool

    @cached_property
    def free_basis(self) -> dict[int, Array]:
        """Free directions (d, r) of the prescribed nodes; all others are free."""
        known: dict[bytes, Array] = {}
        found = {}
        for node, rows in self.rows.items():
            matrix = np.array([row.direction for row in rows])
            key = matrix.tobytes()
            if key not in known:
                aligned = np.all(np.count_nonzero(matrix, axis=1) == 1)
                known[key] = np.eye(self.dim)[:, ~matrix.any(axis=0)] if aligned else null_space(matrix, rcond=1e-10)
            found[node] = known[key]
        return found

    def basis(self, node: int) -> Array:
        """Free directions (d, r) of a node, those of its root if it is periodic."""
        return self.free_basis.get(self.root.get(node, node), np.eye(self.dim))

    def eliminated(self) -> Ints:
        """Numbers, of all nodes, that are not free; increasing."""
        gone = [self.dim * n + np.arange(b.shape[1], self.dim) for n, b in self.free_basis.items()]
        gone += [self.dim * n + np.arange(self.dim) for n in self.root]
        return np.sort(np.concatenate([np.zeros(0, np.int64), *gone]))

    def free_start(self, nodes: Ints) -> Ints:
        """Number of the first free displacement of each node (of its root if periodic)."""
        if self.root:
            nodes = np.array([self.root.get(int(n), int(n)) for n in np.atleast_1d(nodes)], np.int64)
        return np.asarray(self.dim * nodes)

    def entries(self, nodes: Ints) -> tuple[Ints, Ints, Array]:
        """T at the displacements of these nodes (m, d), flattened: row, free number and value of each entry."""
        d, start = self.dim, self.free_start(nodes)
        special = np.isin(nodes, np.array([*self.rows, *self.root], np.int64))
        plain = np.flatnonzero(~special)
        every = np.arange(d)
        parts = [((d * plain[:, None] + every).ravel(), (start[plain, None] + every).ravel(), np.ones(d * len(plain)))]
        for k in np.flatnonzero(special):
            basis = self.basis(int(nodes[k]))
            a, b = np.nonzero(basis)
            parts.append((d * k + a, start[k] + b, basis[a, b]))
        i, j, v = (np.concatenate(part) for part in zip(*parts, strict=True))
        return i, j, v

    @cached_property
    def free_total(self) -> int:
        return int(self.dim * self.nodes.total - len(self.eliminated()))

    def transformation(self, comm: Any) -> Any:
        """T as a PETSc matrix, (d n, d n)."""
        d, numbers = self.dim, self.nodes.offset + np.arange(self.nodes.owned)
        size = (d * len(numbers), d * self.nodes.total)
        i, j, v = self.entries(numbers)
        matrix = PETSc.Mat().createAIJ((size, size), bsize=d, nnz=(d, d), comm=comm)
        order = np.lexsort((j, i))
        i, j, v = i[order], j[order], v[order]
        pointer = np.searchsorted(i, np.arange(size[0] + 1)).astype(PETSc.IntType)
        matrix.setValuesCSR(pointer, j.astype(PETSc.IntType), v)
        matrix.assemble()
        return matrix

    @cached_property
    def alike(self) -> tuple[Alike, ...]:
        """All of `rows`, the equal ones together."""
        groups: dict[tuple[object, ...], list[int]] = {}
        nodes, every = list(self.rows), list(self.rows.values())
        for i, rows in enumerate(every):
            key = tuple((row.direction.tobytes(), row.support, id(row.amplitude)) for row in rows)
            groups.setdefault(key, []).append(i)
        found = []
        for index in groups.values():
            rows = every[index[0]]
            matrix = np.array([row.direction for row in rows])
            inverse = matrix.T if len(rows) == 1 else np.linalg.pinv(matrix, rcond=1e-10)
            part, points = (np.array([of[nodes[i]] for i in index]) for of in (self.part, self.points))
            found.append(Alike(np.array(index), part, points, rows, matrix, inverse))
        return tuple(found)

    @cached_property
    def _row_of_prescribed(self) -> Ints:
        """(k,) where each of `prescribed_nodes`, or the node that it follows, stands in `rows`."""
        where = {node: i for i, node in enumerate(self.rows)}
        return np.array([where[self.root.get(int(n), int(n))] for n in self.prescribed_nodes], np.int64)

    @cached_property
    def prescribed_nodes(self) -> Ints:
        """Global numbers of all nodes with a prescribed component, followers of prescribed roots included."""
        return np.array(sorted({*self.rows, *(s for s, r in self.root.items() if r in self.rows)}), np.int64)

    def wanted(self, time: float) -> list[Array]:
        """What each row (r,) of `alike` prescribes [m]."""
        known = {id(r.amplitude): r.amplitude for same in self.alike for r in same.rows}
        values = {key: value_at(amplitude, time, self.end) for key, amplitude in known.items()}
        return [np.array([values[id(r.amplitude)] for r in same.rows]) for same in self.alike]

    def prescribed(self, time: float) -> Array:
        """u_s (k, d) [m] at `prescribed_nodes`.

        Raises:
            SceneError: two supports ask different things of one node.
        """
        values = np.zeros((len(self.rows), self.dim))
        for same, wanted in zip(self.alike, self.wanted(time), strict=True):
            found = same.inverse @ wanted
            if np.any(np.abs(same.matrix @ found - wanted) > 1e-9 * np.abs(wanted).max(initial=0)):
                names = sorted({r.support if r.support == AXIS else f"supports.{r.support}" for r in same.rows})
                point = ", ".join(f"{x:.6g}" for x in same.points[0])
                raise SceneError(f"{' and '.join(names)}: contradict each other at the point ({point}) at t = {time:g}")
            values[same.index] = found
        return values[self._row_of_prescribed]

    def reactions(self, forces: Array) -> dict[str, tuple[Array, Array]]:
        """Share nodal forces (k, d) at `prescribed_nodes` among supports: force (d,) and moment about the origin.

        A force is split along the prescribed directions; supports that overlap share it in the least-squares sense.
        """
        at = np.zeros((len(self.rows), self.dim))
        np.add.at(at, self._row_of_prescribed, forces)
        moments = 1 if self.dim == 2 else 3
        total: dict[str, tuple[Array, Array]] = {}
        for same in self.alike:
            shares = at[same.index] @ same.inverse  # (n, r)
            for row, sizes in zip(same.rows, shares.T, strict=True):
                if row.support == AXIS:
                    continue
                force, moment = total.setdefault(row.support, (np.zeros(self.dim), np.zeros(moments)))
                pushed = sizes[:, None] * row.direction
                force += pushed.sum(axis=0)
                moment += np.cross(same.points, pushed).reshape(-1, moments).sum(axis=0)
        if self.axisymmetric:  # over the full circle the radial parts balance
            return {name: (force * [0, 1], 0 * moment) for name, (force, moment) in total.items()}
        return total


def find_constraints(scene: Scene, mesh: Mesh, space: Any, nodes: Nodes) -> Constraints:
    """Collect supports and periodic sides from all ranks."""
    rows: dict[int, list[Row]] = {}
    points: dict[int, Array] = {}
    part: dict[int, int] = {}
    root = _periodic_roots(scene, mesh, space, nodes, points, part)
    for name, support in scene.supports.items():
        if support.boundary is not None:
            side = gather_surface(mesh, space, nodes, support.boundary)
            where, x, of = side.nodes, side.points, mesh.parts[side.input]
            normals = side.node_normals() if "normal" in support.displacement else np.zeros_like(x)
        else:
            where, x, of = _vertex_at(mesh, nodes, np.array(support.point), f"supports.{name}.point")
            normals = np.zeros_like(x)
        for axis, amplitude in support.displacement.items():
            for i, node in enumerate(where):
                direction = normals[i] if axis == "normal" else np.eye(mesh.dim)[AXES[axis]]
                direction = np.where(np.abs(direction) < 1e-12, 0.0, direction)
                rows.setdefault(root.get(int(node), int(node)), []).append(Row(direction, amplitude, name))
                points[int(node)], part[int(node)] = x[i], int(of[i])
    if mesh.axisymmetric:
        for node, x, its_part in _on_axis(mesh, nodes):
            rows.setdefault(root.get(node, node), []).append(Row(np.array([1.0, 0.0]), 0.0, AXIS))
            points[node], part[node] = x, its_part
    ordered = {n: tuple(r) for n, r in sorted(rows.items())}
    return Constraints(
        nodes, mesh.dim, scene.steps.end, ordered, root, points, part, mesh.part_count, mesh.axisymmetric
    )


def _on_axis(mesh: Mesh, nodes: Nodes) -> list[tuple[int, Array, int]]:
    """Nodes on the axis of symmetry: u_r = 0 there, whatever the scene says."""
    low, high = mesh.box()
    slack = 1e-9 * float(np.max(high - low))
    if low[0] < -slack:
        raise GeometryError(f"geometry: reaches to x = {low[0]:g}; an axisymmetric model lies in x >= 0")
    own = np.flatnonzero(nodes.points[: nodes.owned, 0] <= slack)
    found = mesh.comm.allgather([(int(nodes.number[i]), nodes.points[i], int(nodes.part[i])) for i in own])
    return [pair for part in found for pair in part]


def _vertex_at(mesh: Mesh, nodes: Nodes, point: Array, key: str) -> tuple[Ints, Array, Ints]:
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
    if nearest > 1e-6 * float(np.max(high - low)):
        at = ", ".join(f"{c:.6g}" for c in x)
        raise SceneError(f"{key} = {point.tolist()}: no mesh vertex there; the nearest is ({at})")
    return np.array([number]), np.array([x]), np.array([found])


def _periodic_roots(
    scene: Scene, mesh: Mesh, space: Any, nodes: Nodes, points: dict[int, Array], part: dict[int, int]
) -> dict[int, int]:
    follows: dict[int, int] = {}
    for slave_side, master_side in scene.request().periodic:
        slave, master = (gather_surface(mesh, space, nodes, side) for side in (slave_side, master_side))
        shift = master.points.mean(axis=0) - slave.points.mean(axis=0)
        distance, match = cKDTree(master.points).query(slave.points + shift)
        size = float(np.ptp(master.points, axis=0).max())
        if len(slave.nodes) != len(master.nodes) or distance.max() > 1e-6 * size:
            raise GeometryError(f"periodic sides {slave_side} and {master_side}: their meshes do not match")
        of, of_other = mesh.parts[slave.input], mesh.parts[master.input[match]]
        part |= dict(zip(slave.nodes.tolist(), of.tolist(), strict=True))
        part |= dict(zip(master.nodes[match].tolist(), of_other.tolist(), strict=True))
        for node, other, x, y in zip(slave.nodes, master.nodes[match], slave.points, master.points[match], strict=True):
            points[int(node)], points[int(other)] = x, y
            own, others = _end_of(follows, int(node)), _end_of(follows, int(other))
            if own != others:  # an edge of two periodic pairs in 3D is met twice: the second time says nothing new
                follows[own] = others
    return {node: _end_of(follows, node) for node in follows}


def _end_of(follows: dict[int, int], node: int) -> int:
    while node in follows:
        node = follows[node]
    return node
