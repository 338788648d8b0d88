"""The scene's supports and periodic sides on its mesh, collected from all ranks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from stickslip.geometry.arrays import Array, cross
from stickslip.geometry.errors import GeometryError, SceneError
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.protocols import FunctionSpace
from stickslip.geometry.surfaces.surface import gather_surface
from stickslip.solvers.fem.constraints import AXES, AXIS, Constraints, Row, Sprung
from stickslip.solvers.fem.links import find_links, vertex_at
from stickslip.solvers.fem.remote_points import RemotePoints, RigidRow, find_remote_points
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.timeline import Course, Place


def find_constraints(problem: Problem, mesh: Mesh, space: FunctionSpace, nodes: Nodes) -> Constraints:
    """Collect supports and periodic sides from all ranks; collective.

    Raises:
        SceneError: no mesh vertex lies at the point of a support.
        GeometryError: periodic sides whose meshes do not match, or an axisymmetric model that reaches to x < 0.
    """
    rows: dict[int, list[Row]] = {}
    points: dict[int, Array] = {}
    part: dict[int, int] = {}
    root = _periodic_roots(problem, mesh, space, nodes, points, part)
    for name, support in problem.supports.items():
        if support.boundary is not None:
            side = gather_surface(mesh, space, nodes, support.boundary)
            where, x, of = side.nodes, side.points, mesh.parts_of(side.input)
            normals = side.node_normals() if "normal" in support.displacement else np.zeros_like(x)
            normals[np.abs(normals) < 1e-12] = 0.0
        else:
            where, x, of = vertex_at(mesh, nodes, np.array(support.point), f"supports.{name}.point")
            normals = np.zeros_like(x)
        points |= dict(zip(where.tolist(), x, strict=True))
        part |= dict(zip(where.tolist(), of.tolist(), strict=True))
        for axis in support.displacement:
            directions = normals if axis == "normal" else np.eye(mesh.dim)[[AXES[axis]]]
            drive = Place("supports", name, "displacement", axis)
            if drive in problem.timeline.expressions:
                alike = [Row(directions[i % len(directions)], drive, name, point) for i, point in enumerate(x)]
            else:
                alike = [Row(direction, drive, name) for direction in directions]
            for i, node in enumerate(where.tolist()):
                rows.setdefault(root.get(node, node), []).append(alike[i % len(alike)])
    if mesh.axisymmetric:
        for node, x, its_part in _on_axis(mesh, nodes):
            rows.setdefault(root.get(node, node), []).append(Row(np.array([1.0, 0.0]), 0.0, AXIS))
            points[node], part[node] = x, its_part
    remote = _with_supports(problem, mesh, space, nodes, find_remote_points(problem, mesh, space, nodes), rows, root)
    ordered = {n: tuple(r) for n, r in sorted(rows.items())}
    return Constraints(
        nodes=nodes,
        dim=mesh.dim,
        course=Course(problem.timeline),
        rows=ordered,
        root=root,
        points=points,
        part=part,
        sprung=_sprung(problem, mesh, space, nodes),
        links=find_links(problem, mesh, space, nodes),
        remote=remote,
        parts=mesh.part_count,
        axisymmetric=mesh.axisymmetric,
    )


def _with_supports(
    problem: Problem,
    mesh: Mesh,
    space: FunctionSpace,
    nodes: Nodes,
    remote: RemotePoints,
    rows: dict[int, list[Row]],
    root: dict[int, int],
) -> RemotePoints:
    """The remote points, with the rows of supports at nodes of rigid sides, which are taken out of `rows`; collective.

    Raises:
        SceneError: a rigid side shares nodes with a contact, a periodic or another rigid side.
    """
    taken = {node: "a periodic side" for pair in root.items() for node in pair}
    for side in problem.request.contact_sides if remote.rigid else ():
        taken |= dict.fromkeys(gather_surface(mesh, space, nodes, side).nodes.tolist(), f"{side}, a contact side")
    found = []
    for point in remote.every:
        own = list[RigidRow]()
        each = zip(point.nodes.tolist(), point.points, point.fields, strict=True)
        for node, x, field in each if point.coupling.rigid else ():
            if node in taken:
                raise SceneError(
                    f"{point.coupling.key}.boundary = {point.coupling.boundary}: has nodes in common with "
                    f"{taken[node]}, at ({', '.join(f'{c:.6g}' for c in x)}); set coupling = distributing"
                )
            for row in rows.pop(node, []):
                turn = np.atleast_1d(cross(x, row.direction))
                own.append(RigidRow(row.direction @ field, row.drive, row.support, row.direction, turn, row.point))
            taken[node] = point.coupling.key
        found.append(replace(point, rows=(*point.rows, *own)))
    return replace(remote, every=tuple(found))


def _sprung(problem: Problem, mesh: Mesh, space: FunctionSpace, nodes: Nodes) -> Sprung:
    """What springs to the ground resist, collected from all ranks."""
    points, directions, part = [np.zeros((0, mesh.dim))], [np.zeros((0, mesh.dim))], [np.zeros(0, np.int64)]
    for springs in problem.springs:
        side = gather_surface(mesh, space, nodes, springs.boundary)
        for along in springs.directions(side.node_normals()):
            points.append(side.points)
            directions.append(along)
            part.append(mesh.parts_of(side.input))
    return Sprung(np.concatenate(points), np.concatenate(directions), np.concatenate(part))


def _on_axis(mesh: Mesh, nodes: Nodes) -> list[tuple[int, Array, int]]:
    """Number, coordinates and part of each node on the axis of symmetry, where u_r = 0 always.

    Raises:
        GeometryError: the mesh reaches to x < 0.
    """
    low, high = mesh.box()
    slack = 1e-9 * float(np.max(high - low))
    if low[0] < -slack:
        raise GeometryError(f"geometry: reaches to x = {low[0]:g}; an axisymmetric model lies in x >= 0")
    own = np.flatnonzero(nodes.points[: nodes.owned, 0] <= slack)
    found = mesh.comm.allgather([(int(nodes.number[i]), nodes.points[i], int(nodes.part[i])) for i in own])
    return [pair for part in found for pair in part]


def _periodic_roots(
    problem: Problem, mesh: Mesh, space: FunctionSpace, nodes: Nodes, points: dict[int, Array], part: dict[int, int]
) -> dict[int, int]:
    """Node whose displacement each eliminated periodic node has; fills in `points` and `part`."""
    follows: dict[int, int] = {}
    for slave_side, master_side in problem.request.periodic:
        slave, master = (gather_surface(mesh, space, nodes, side) for side in (slave_side, master_side))
        shift = master.points.mean(axis=0) - slave.points.mean(axis=0)
        distance, match = cKDTree(master.points).query(slave.points + shift)
        size = float(np.ptp(master.points, axis=0).max())
        if len(slave.nodes) != len(master.nodes) or distance.max() > 1e-6 * size:
            raise GeometryError(f"periodic sides {slave_side} and {master_side}: their meshes do not match")
        of, of_other = mesh.parts_of(slave.input), mesh.parts_of(master.input[match])
        part |= dict(zip(slave.nodes.tolist(), of.tolist(), strict=True))
        part |= dict(zip(master.nodes[match].tolist(), of_other.tolist(), strict=True))
        for node, other, x, y in zip(slave.nodes, master.nodes[match], slave.points, master.points[match], strict=True):
            points[int(node)], points[int(other)] = x, y
            own, others = _end_of(follows, int(node)), _end_of(follows, int(other))
            if own != others:  # an edge that two periodic pairs share in 3D appears twice; the second is redundant
                follows[own] = others
    return {node: _end_of(follows, node) for node in follows}


def _end_of(follows: dict[int, int], node: int) -> int:
    """Last node of the chain that begins at a node."""
    while node in follows:
        node = follows[node]
    return node
