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
from solvers.rigid_motions import rigid_fields, rigid_names

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

    @cached_property
    def free_total(self) -> int:
        return int(self.dim * self.nodes.total - len(self.eliminated()))

    def transformation(self, comm: Any) -> Any:
        """T as a PETSc matrix, (d n, d n)."""
        d, low, high = self.dim, self.nodes.offset, self.nodes.offset + self.nodes.owned
        numbers = np.arange(low, high)
        start = self.free_start(numbers)
        columns = (start[:, None] + np.arange(d)).ravel()
        rows, values = np.arange(d * low, d * high), np.ones(d * len(numbers))
        special = np.array([n for n in {*self.rows, *self.root} if low <= n < high], np.int64)
        plain = ~np.isin(np.repeat(numbers, d), special)
        parts = [(rows[plain], columns[plain], values[plain])]
        for node in special:
            basis, first = self.basis(int(node)), int(self.free_start(np.array([node]))[0])
            i, j = np.nonzero(basis)
            parts.append((d * node + i, first + j, basis[i, j]))
        i, j, v = (np.concatenate(part) for part in zip(*parts, strict=True))
        size = (d * len(numbers), d * self.nodes.total)
        matrix = PETSc.Mat().createAIJ((size, size), bsize=d, nnz=(d, d), comm=comm)
        order = np.lexsort((j, i))
        i, j, v = i[order], j[order], v[order]
        pointer = np.searchsorted(i - d * low, np.arange(d * len(numbers) + 1)).astype(PETSc.IntType)
        matrix.setValuesCSR(pointer, j.astype(PETSc.IntType), v)
        matrix.assemble()
        return matrix

    @cached_property
    def prescribed_nodes(self) -> Ints:
        """Global numbers of all nodes with a prescribed component, followers of prescribed roots included."""
        return np.array(sorted({*self.rows, *(s for s, r in self.root.items() if r in self.rows)}), np.int64)

    def prescribed(self, time: float) -> Array:
        """u_s (k, d) [m] at `prescribed_nodes`.

        Raises:
            SceneError: two supports ask different things of one node.
        """
        values = {}
        amplitudes: dict[int, float] = {}
        for node, rows in self.rows.items():
            matrix = np.array([row.direction for row in rows])
            wanted = np.array(
                [amplitudes.setdefault(id(r.amplitude), value_at(r.amplitude, time, self.end)) for r in rows]
            )
            found = np.linalg.lstsq(matrix, wanted, rcond=None)[0] if len(rows) > 1 else matrix[0] * wanted[0]
            if np.any(np.abs(matrix @ found - wanted) > 1e-9 * np.abs(wanted).max(initial=0)):
                names = sorted({row.support if row.support == AXIS else f"supports.{row.support}" for row in rows})
                point = ", ".join(f"{x:.6g}" for x in self.points[node])
                raise SceneError(f"{' and '.join(names)}: contradict each other at the point ({point}) at t = {time:g}")
            values[node] = found
        stacked = [values[self.root.get(int(n), int(n))] for n in self.prescribed_nodes]
        return np.array(stacked).reshape(-1, self.dim)

    def reactions(self, forces: Array) -> dict[str, tuple[Array, Array]]:
        """Share nodal forces (k, d) at `prescribed_nodes` among supports: force (d,) and moment about the origin.

        A force is split along the prescribed directions; supports that overlap share it in the least-squares sense.
        """
        at: dict[int, Array] = {}
        for node, force in zip(self.prescribed_nodes, forces, strict=True):
            root = self.root.get(int(node), int(node))
            at[root] = at.get(root, np.zeros(self.dim)) + force
        moments = 1 if self.dim == 2 else 3
        total: dict[str, tuple[Array, Array]] = {}
        for node, rows in self.rows.items():
            matrix = np.array([row.direction for row in rows])
            share = np.linalg.lstsq(matrix.T, at[node], rcond=None)[0]
            for row, size in zip(rows, share, strict=True):
                if row.support == AXIS:
                    continue
                force, moment = total.setdefault(row.support, (np.zeros(self.dim), np.zeros(moments)))
                force += size * row.direction
                moment += np.atleast_1d(np.cross(self.points[node], size * row.direction))
        if self.axisymmetric:  # over the full circle the radial parts balance
            return {name: (force * [0, 1], 0 * moment) for name, (force, moment) in total.items()}
        return total

    def rigid_motions(self, low: Array, high: Array) -> Array:
        """Coefficients (parts k, r) of the rigid motions that nothing prescribed resists; see `rigid_fields`."""
        centre, size = (low + high) / 2, float(np.max(high - low))
        count = len(rigid_names(self.dim, self.axisymmetric))
        blocks = [np.zeros((1, self.parts * count))]

        def field(node: int) -> Array:
            own = self.part[node] * count + np.arange(count)
            of_all = np.zeros((self.dim, self.parts * count))
            of_all[:, own] = rigid_fields(self.points[node][None], centre, size, self.axisymmetric)[0]
            return of_all

        for node, rows in self.rows.items():
            blocks.append(np.array([row.direction for row in rows]) @ field(node))
        for slave, master in self.root.items():
            blocks.append(field(slave) - field(master))
        small = np.linalg.qr(np.concatenate(blocks), mode="r")  # the same null space, without a square of all nodes
        return np.asarray(null_space(small, rcond=1e-9))


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
