"""The scene's supports and periodic sides on its mesh: each rank finds those of its own nodes."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np
from scipy.linalg import orth
from scipy.spatial import cKDTree

from stickslip.geometry.arrays import CLOSE, EXACT, ROUNDING, Array, Bools, Ints, cross
from stickslip.geometry.errors import GeometryError, SceneError
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.mesh.ranks import of_all_ranks
from stickslip.geometry.protocols import FunctionSpace
from stickslip.geometry.surfaces.surface import gather_surface, own_nodes
from stickslip.solvers.fem.constraints import AXES, AXIS, Components, Constraints, Periodic, Sprung
from stickslip.solvers.fem.remote_points import RemotePoints, RigidRow, find_remote_points
from stickslip.solvers.fem.springs import find_links, vertex_at
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.timeline import Course, Drive, Place


def find_constraints(problem: Problem, mesh: Mesh, space: FunctionSpace, nodes: Nodes) -> Constraints:
    """Find supports and periodic sides on all ranks; collective.

    Raises:
        SceneError: no mesh vertex lies at the point of a support.
        GeometryError: periodic sides whose meshes do not match, or an axisymmetric model that reaches to x < 0.
    """
    periodic = _periodic(problem, mesh, space, nodes)
    axes = [(name, axis) for name, support in problem.supports.items() for axis in support.displacement]
    drives = [Place("supports", name, "displacement", axis) for name, axis in axes]
    axial = [AXIS] if mesh.axisymmetric or periodic.fixed else []
    values: list[Drive] = [*drives, *(0.0 for _ in axial)]
    names = list(dict.fromkeys([*(name for name, _ in axes), *axial]))
    found = _own_components(problem, mesh, space, nodes, periodic, drives, names)
    shared = np.zeros(nodes.owned, bool)
    rigid = [coupling.boundary for coupling in problem.couplings if coupling.rigid]
    of_periodic = chain.from_iterable(problem.request.periodic)
    for side in dict.fromkeys([*problem.request.contact_sides, *of_periodic, *rigid]):
        shared[own_nodes(mesh, space, nodes, side).local] = True
    found = _with_shared(mesh, nodes, found, shared, periodic)
    points = find_remote_points(problem, mesh, space, nodes)
    remote, found = _with_supports(problem, mesh, space, nodes, points, found, periodic, values, names)
    of_rigid = [row.support for point in remote.rigid for row in point.rows]
    return Constraints(
        comm=mesh.comm,
        nodes=nodes,
        dim=mesh.dim,
        course=Course(problem.timeline),
        drives=tuple(values),
        supports=tuple(dict.fromkeys([*names, *of_rigid])),
        components=found,
        periodic=periodic,
        sprung=_sprung(problem, mesh, space, nodes),
        links=find_links(problem, mesh, space, nodes),
        remote=remote,
        parts=mesh.part_count,
        axisymmetric=mesh.axisymmetric,
    )


def _own_components(
    problem: Problem,
    mesh: Mesh,
    space: FunctionSpace,
    nodes: Nodes,
    periodic: Periodic,
    drives: list[Place],
    names: list[str],
) -> Components:
    """Prescribed displacements at this rank's nodes, support by support; collective."""
    found = [_components(nodes, np.zeros(0, np.int64), np.zeros((0, mesh.dim)), 0, 0)]
    for name, support in problem.supports.items():
        if support.boundary is not None:
            side = own_nodes(mesh, space, nodes, support.boundary)
            local, normals = side.local, side.normals
            normals[np.abs(normals) < EXACT] = 0.0
        else:
            number, _, _ = vertex_at(mesh, nodes, np.array(support.point), f"supports.{name}.point")
            local = number[(number >= nodes.offset) & (number < nodes.offset + nodes.owned)] - nodes.offset
            normals = np.zeros((len(local), mesh.dim))
        for axis in support.displacement:
            along = normals if axis == "normal" else np.tile(np.eye(mesh.dim)[AXES[axis]], (len(local), 1))
            drive = drives.index(Place("supports", name, "displacement", axis))
            found.append(_components(nodes, local, along, drive, names.index(name)))
    if mesh.axisymmetric:
        local = _on_axis(mesh, nodes)
        radial = np.tile([1.0, 0.0], (len(local), 1))
        found.append(_components(nodes, local, radial, len(drives), names.index(AXIS)))
    for node, across in periodic.fixed.items():
        if nodes.offset <= node < nodes.offset + nodes.owned:
            local = np.full(len(across), node - nodes.offset)
            found.append(_components(nodes, local, across, len(drives), names.index(AXIS)))
    return Components.joined(found)


def _components(nodes: Nodes, local: Ints, directions: Array, drive: int, support: int) -> Components:
    """One component at each of the local nodes (k,) that this rank owns."""
    return Components(
        node=nodes.number[local],
        directions=directions,
        drive=np.full(len(local), drive),
        support=np.full(len(local), support),
        points=nodes.points[local],
    )


def _with_shared(mesh: Mesh, nodes: Nodes, own: Components, shared: Bools, periodic: Periodic) -> Components:
    """Those of this rank's nodes, and of all ranks' shared nodes (owned,), by root node; collective."""
    known = shared[own.node - nodes.offset]
    found = Components.joined([own.at(~known), own.at(known).each(partial(of_all_ranks, mesh.comm))])
    at = np.searchsorted(periodic.followers, found.node)
    follows = np.isin(found.node, periodic.followers)
    roots, directions = found.node.copy(), found.directions.copy()
    roots[follows] = periodic.roots[at[follows]]
    directions[follows] = np.einsum("kij,ki->kj", periodic.turn[at[follows]], directions[follows])
    order = np.lexsort((found.drive, roots))  # supports in the order of the scene at each node
    return replace(found, node=roots, directions=directions).at(order)


def _with_supports(
    problem: Problem,
    mesh: Mesh,
    space: FunctionSpace,
    nodes: Nodes,
    remote: RemotePoints,
    components: Components,
    periodic: Periodic,
    drives: list[Drive],
    names: list[str],
) -> tuple[RemotePoints, Components]:
    """The remote points with the components of supports at nodes of rigid sides, and all other components; collective.

    Raises:
        SceneError: a rigid side shares nodes with a contact, a periodic or another rigid side.
    """
    taken = dict.fromkeys([*periodic.followers.tolist(), *periodic.roots.tolist()], "a periodic side")
    for side in problem.request.contact_sides if remote.rigid else ():
        taken |= dict.fromkeys(gather_surface(mesh, space, nodes, side).nodes.tolist(), f"{side}, a contact side")
    found, left = [], np.ones(len(components.node), bool)
    for point in remote.every:
        own = list[RigidRow]()
        each = zip(point.nodes.tolist(), point.points, point.fields, strict=True)
        for node, x, field in each if point.coupling.rigid else ():
            if node in taken:
                raise SceneError(
                    f"{point.coupling.key}.boundary = {point.coupling.boundary}: has nodes in common with "
                    f"{taken[node]}, at ({', '.join(f'{c:.6g}' for c in x)}); set coupling = distributing"
                )
            for k in range(*np.searchsorted(components.node, (node, node + 1)).tolist()):
                drive, direction, left[k] = drives[components.drive[k]], components.directions[k], False
                turn = np.atleast_1d(cross(x, direction))
                at = components.points[k] if drive in problem.timeline.expressions else None
                support = names[components.support[k]]
                own.append(RigidRow(direction @ field, drive, support, direction, turn, at))
            taken[node] = point.coupling.key
        found.append(replace(point, rows=(*point.rows, *own)))
    return replace(remote, every=tuple(found)), components.at(left)


def _sprung(problem: Problem, mesh: Mesh, space: FunctionSpace, nodes: Nodes) -> Sprung:
    """Motions of this rank's nodes that springs to the ground resist; collective."""
    nothing = np.zeros((0, mesh.dim))
    found = [Sprung(nothing, nothing, np.zeros(0, np.int64))]
    for springs in problem.springs:
        side = own_nodes(mesh, space, nodes, springs.boundary)
        at = nodes.points[side.local], nodes.part[side.local]
        found += [Sprung(at[0], along, at[1]) for along in springs.directions(side.normals)]
    return Sprung.joined(found)


def _on_axis(mesh: Mesh, nodes: Nodes) -> Ints:
    """Local numbers of this rank's nodes on the axis of symmetry, where u_r = 0 always; collective.

    Raises:
        GeometryError: the mesh reaches to x < 0.
    """
    low, high = mesh.box()
    slack = ROUNDING * float(np.max(high - low))
    if low[0] < -slack:
        raise GeometryError(f"geometry: reaches to x = {low[0]:g}; an axisymmetric model lies in x >= 0")
    return np.flatnonzero(nodes.points[: nodes.owned, 0] <= slack)


def _periodic(problem: Problem, mesh: Mesh, space: FunctionSpace, nodes: Nodes) -> Periodic:
    """The nodes that each eliminated periodic node follows; collective."""
    follows: dict[int, tuple[int, Array]] = {}
    known: dict[int, tuple[Array, int]] = {}  # coordinates and part of both sides' nodes
    fixed: dict[int, Array] = {}
    for slave_side, master_side in problem.request.periodic:
        slave, master = (gather_surface(mesh, space, nodes, side) for side in (slave_side, master_side))
        turn, matrix = problem.request.turns.get(slave_side), np.eye(mesh.dim)
        if turn is None:
            shift = master.points.mean(axis=0) - slave.points.mean(axis=0)
            distance, match = cKDTree(master.points).query(slave.points + shift)
        else:
            matrix, (distance, match) = turn.matrix(mesh.dim), cKDTree(turn.moved(master.points)).query(slave.points)
        size = float(np.ptp(master.points, axis=0).max())
        if len(slave.nodes) != len(master.nodes) or distance.max() > CLOSE * size:
            raise GeometryError(f"periodic sides {slave_side} and {master_side}: their meshes do not match")
        for side in (slave, master):
            known |= zip(side.nodes.tolist(), zip(side.points, side.part.tolist(), strict=True), strict=True)
        for node, other in zip(slave.nodes.tolist(), master.nodes[match].tolist(), strict=True):
            (own, first), (others, second) = _end_of(follows, node, mesh.dim), _end_of(follows, other, mesh.dim)
            if node == other and turn is not None:
                fixed[node] = orth((matrix - np.eye(mesh.dim)).T).T
            if own != others:  # an edge that two periodic pairs share in 3D appears twice; the second is redundant
                follows[own] = others, first.T @ matrix @ second
    followers = sorted(follows)
    ends = [_end_of(follows, node, mesh.dim) for node in followers]
    roots = [root for root, _ in ends]
    return Periodic(
        followers=np.array(followers, np.int64),
        roots=np.array(roots, np.int64),
        points=np.array([known[node][0] for node in followers]).reshape(-1, mesh.dim),
        root_points=np.array([known[node][0] for node in roots]).reshape(-1, mesh.dim),
        part=np.array([known[node][1] for node in followers], np.int64),
        root_part=np.array([known[node][1] for node in roots], np.int64),
        turn=np.array([turn for _, turn in ends]).reshape(-1, mesh.dim, mesh.dim),
        fixed=fixed,
        sectors=problem.request.turned,
    )


def _end_of(follows: dict[int, tuple[int, Array]], node: int, dim: int) -> tuple[int, Array]:
    """Last node of the chain that begins at a node, and by which the displacement there turns on the way back."""
    turn = np.eye(dim)
    while node in follows:
        node, next_turn = follows[node]
        turn = turn @ next_turn
    return node, turn
