"""From a scene to the frozen `Problem` that all rooms below the simulation read, in two steps.

First sides, contact pairs and springs are set up; then the rigid modes that nothing of these resists are found: null
spaces of supports, and of supports with contact and friction. Before there is a mesh they are those of whole bodies,
which hold each other where they share nodes. A body's cells need not hang together: then parts of the mesh can move by
themselves, which no scene shows.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import chain

import numpy as np
from scipy.linalg import null_space

from stickslip.geometry.arrays import ROUNDING, Array
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.joints import is_rigid
from stickslip.solvers.contact.coupling import seen_from
from stickslip.solvers.effects import EFFECTS, active
from stickslip.solvers.fem.constraints import AXES
from stickslip.solvers.fem.rigid_fields import rigid_fields, rigid_names
from stickslip.solvers.method_registry import method_of
from stickslip.solvers.scene.contact import REACH, table_of
from stickslip.solvers.scene.loads import Coupling, End, Support
from stickslip.solvers.scene.problem import Pair, PlanRow, Problem, Setup
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.system.contact_interface import UNTOUCHED, loose_part
from stickslip.solvers.system.system import System


def resolve(scene: Scene) -> Problem:
    """Find sides, contact pairs, values in time, active effects and rigid modes of a scene; nothing is meshed.

    Args:
        scene: valid; whether it can be solved is not checked here, see `planned`.

    Raises:
        SceneError, GeometryError: the geometry does not have what the scene asks for.
    """
    return with_rigid_modes(set_up(scene))


def set_up(scene: Scene) -> Setup:
    """The first step of `resolve`: all but rigid modes."""
    plan, request, pairs = plan_rows(scene), scene.request(), {}
    for name, contact in scene.pairs.items():
        slave, master = scene.slave_and_master(name)
        obstacle = str(contact.against) if master is None else None
        found = scene.contacts[table_of(name)].between is not None
        pairs[name] = Pair(
            name=name,
            contact=contact,
            slave=slave,
            master=master,
            obstacle=obstacle,
            found=found,
            cyclic=bool(request.turns),
        )
    return Setup(
        model=scene.model,
        shape=scene.geometry,
        request=request,
        bodies=scene.bodies,
        obstacles=scene.obstacles,
        pairs=pairs,
        supports=scene.supports,
        loads=scene.loads,
        springs=scene.ground_springs(),
        links=scene.links(),
        couplings=scene.couplings(),
        probes=scene.probes,
        tables={row.effect: scene.sections[row.effect] for row in plan if row.on and row.effect in scene.sections},
        plan=plan,
        timeline=scene.timeline(),
        solver=scene.solver,
        labels=scene.labels,
        sums=scene.sums,
    )


def plan_rows(scene: Scene) -> tuple[PlanRow, ...]:
    """One row for each known effect: whether it is on, the scene key that switches it on, what it adds."""
    because = [(effect, effect.because(scene)) for effect in EFFECTS]
    return tuple(
        PlanRow(effect=effect.name, on=True, because=key, adds=effect.adds(scene))
        if key
        else PlanRow(effect=effect.name, on=False, because="not in the scene")
        for effect, key in because
    )


def with_rigid_modes(setup: Setup) -> Problem:
    """The second step of `resolve`: find the rigid modes that nothing resists, from sample points of the sides.

    Their coefficients run over the k rigid motions of all bodies, body by body, see `rigid_fields`. Obstacles that
    forces drive move too: contact resists only motion relative to them.

    Raises:
        SceneError, GeometryError: the geometry does not have a side that the scene names.
    """
    motions = RigidMotions(setup)
    blocks = [np.zeros((1, len(motions.kinds)))]
    for support in setup.supports.values():
        blocks += _supported(setup, support, motions)
    for springs in setup.springs:
        points, normals = setup.sample(springs.boundary)
        fields = motions.fields(springs.boundary.split(".")[0], points)
        blocks += [np.einsum("kd,kdj->kj", along, fields) for along in springs.directions(normals)]
    for link in setup.links:
        moved = np.sum([sign * _mean(setup, end, motions) for end, sign in link.ends.values()], axis=0)
        blocks.append(link.directions @ moved)
    for coupling in setup.couplings:
        blocks += _held(setup, coupling, motions)
    for slave, master in setup.request.periodic:
        points, turn = setup.sample(master)[0], setup.request.turns.get(slave)
        there = motions.fields(master.split(".")[0], points)
        if turn is None:
            blocks.extend(motions.fields(slave.split(".")[0], setup.sample(slave)[0]) - there)
        else:
            blocks.extend(motions.fields(slave.split(".")[0], turn.moved(points)) - turn.matrix(setup.dim) @ there)
    for (one, other), points in setup.shape.shared(setup.dim).items():
        blocks.extend(motions.fields(one, points) - motions.fields(other, points))
    supported = np.concatenate(blocks)[:, : len(motions.bodies) * motions.each]
    pairs, bedding = setup.pairs.values() if unresisted(np.concatenate(blocks)).size else (), [*blocks]
    for pair in pairs:
        if pair.contact.normal.at_quadrature:
            normal = replace(pair, contact=replace(pair.contact, friction=None, wear=None))
            bedding.append(_reduced(np.concatenate(_touching(setup, normal, motions))))
        blocks.append(_reduced(np.concatenate(_touching(setup, pair, motions))))
    left = unresisted(np.concatenate(blocks))
    most = int(np.argmax(np.linalg.norm(left, axis=1))) if left.shape[1] else -1
    return Problem(
        **vars(setup),
        rigid_modes=unresisted(supported),
        bedded=not unresisted(np.concatenate(bedding)[:, : len(motions.bodies) * motions.each]).size,
        unheld=motions.kinds[most] if most >= 0 else "",
    )


def unresisted(rows: Array) -> Array:
    """Motions (k, f), orthonormal, that are zero in all rows (m, k)."""
    return np.asarray(null_space(np.linalg.qr(rows, mode="r"), rcond=ROUNDING))


def _reduced(rows: Array) -> Array:
    """As few rows as the motions that rows (m, k) see, with the same products of motions."""
    seen = np.flatnonzero(rows.any(axis=0))
    few = np.linalg.qr(rows[:, seen], mode="r")
    found = np.zeros((len(few), rows.shape[1]))
    found[:, seen] = few
    return found


class RigidMotions:
    """The k rigid motions of a scene: those of its bodies, and those of the obstacles that forces drive.

    Attributes:
        kinds: each motion in words (k,).
        each: number of motions of one body.
    """

    def __init__(self, setup: Setup) -> None:
        """List the motions."""
        self.setup, self.box = setup, setup.shape.box(setup.dim)
        names = rigid_names(setup.dim, setup.axisymmetric)
        self.bodies = list(setup.bodies)
        self.driven = [(name, axis) for name, obstacle in setup.obstacles.items() for axis in obstacle.driven()]
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
        found[:, :, first : first + self.each] = rigid_fields(points, centre, scale, self.setup.axisymmetric)
        return found

    def of_obstacle(self, name: str, points: Array) -> Array:
        """Displacement (m, d, k) of an obstacle at points (m, d) [m] in each motion of size 1."""
        found = np.zeros((*points.shape, len(self.kinds)))
        for column, (driven, axis) in enumerate(self.driven, start=len(self.bodies) * self.each):
            found[:, AXES[axis], column] = driven == name
        return found


def _supported(setup: Setup, support: Support, motions: RigidMotions) -> list[Array]:
    """Rows (m, k): displacement in the directions that a support prescribes, one block for each direction."""
    dim = setup.dim
    if support.boundary is None:
        points, normals = np.array([support.point], float), np.zeros((1, dim))
        body = _nearest_body(setup, points)
    else:
        points, normals = setup.sample(support.boundary)
        body = support.boundary.split(".")[0]
    fields = motions.fields(body, points)
    blocks = []
    for axis in support.displacement:
        directions = normals if axis == "normal" else np.tile(np.eye(dim)[AXES[axis]], (len(points), 1))
        blocks.append(np.einsum("kd,kdj->kj", directions, fields))
    return blocks


def _mean(setup: Setup, end: End, motions: RigidMotions) -> Array:
    """Displacement (d, k) of an end of a link in each motion of size 1; of a side the mean."""
    if isinstance(end, str):
        return np.asarray(motions.fields(end.split(".")[0], setup.sample(end)[0]).mean(axis=0))
    point = np.array([end], float)
    return np.asarray(motions.fields(_nearest_body(setup, point), point)[0])


def _held(setup: Setup, coupling: Coupling, motions: RigidMotions) -> list[Array]:
    """Rows (1, k): prescribed motion of a remote point; a rigid body has it in all of its points."""
    about, extent = np.array(coupling.point), float(np.ptp(motions.box, axis=0).max())
    points = np.concatenate([about[None], about + extent * np.eye(setup.dim)])
    of_point = rigid_fields(points, about, extent, setup.axisymmetric)
    moved = motions.fields(coupling.boundary.split(".")[0], points)
    found = np.linalg.pinv(of_point.reshape(-1, of_point.shape[2])) @ moved.reshape(-1, moved.shape[2])
    return [found[component : component + 1] for component in coupling.prescribed]


def _touching(setup: Setup, pair: Pair, motions: RigidMotions) -> list[Array]:
    """Rows (m, k): relative displacement that a contact resists; its normal part alone if it has no friction."""
    contact = pair.contact
    rubs = bool(contact.tangential and contact.tangential.resists() and not is_faint(setup, pair))
    if rubs or pair.obstacle is not None or contact.sliding:
        points, normals = setup.sample(contact.surface)
    else:
        reach = contact.search_distance or REACH * setup.extent
        points, normals = setup.shape.meeting(contact.surface, str(contact.against), reach, setup.dim)
    relative = motions.fields(contact.surface.split(".")[0], points)
    if pair.obstacle is not None:
        relative -= motions.of_obstacle(pair.obstacle, points)
        normals = seen_from(setup.obstacles[pair.obstacle], points)[1]
    else:
        relative -= motions.fields(str(contact.against).split(".")[0], points)
    if rubs:
        return list(relative)
    return [np.einsum("kd,kdj->kj", normals, relative)]


def is_faint(setup: Setup, pair: Pair) -> bool:
    """Whether the tangential springs of a contact are too soft to hold a body, beside the softest body's stiffness."""
    k_T = pair.contact.tangential.k_T if pair.contact.tangential else None
    return k_T is not None and k_T < least_springs(setup)


def least_springs(setup: Setup) -> float:
    """Stiffness [Pa/m] of the softest springs that can hold a body."""
    # of E / extent: a body held by softer tangential springs slides until rounding takes its stresses
    return ROUNDING * setup.softest / setup.extent


def _nearest_body(setup: Setup, point: Array) -> str:
    """The body with the side nearest to the point (1, d) [m]: an estimate from sample points, without a mesh."""
    sides = [f"{body}.{side}" for body, named in setup.shape.bodies(setup.dim).items() for side in named]
    nearest = min(reversed(sides), key=lambda side: np.linalg.norm(setup.sample(side)[0] - point, axis=1).min())
    return nearest.split(".")[0]


def refuse_loose_parts(system: System) -> None:
    """Check that contact holds what supports do not, and that the method can solve that; collective.

    The scene's own bodies are checked before the mesh, see `planned`.

    Raises:
        SceneError: nothing resists a motion, or the method needs bodies that their supports hold.
    """
    _refuse_dangling(system)
    interface, problem = system.interface, system.problem
    modes = interface.rigid_modes
    if modes.shape[1] <= problem.rigid_modes.shape[1]:
        return
    resisted = [np.zeros((0, modes.shape[1]))]
    for rows in system.contacts:
        tangential = problem.pairs[rows.name].contact.tangential
        moved = interface.trace(rows) @ modes
        resisted += [N @ moved for N in (rows.N_n, rows.N_t)[: 1 + bool(tangential and tangential.resists())]]
    interface.refuse_loose(np.concatenate(resisted), "that contact does not resist ")
    method = method_of(problem.solver)
    if not method.WORKS_WITH.floating:
        raise SceneError(
            f"solver.method = {problem.solver.method}: needs bodies that their supports hold in all parts of the mesh; "
            "contact alone holds one; use condensed-newton"
        )
    for effect in active(problem):
        if effect.other_stiffness(problem):
            raise SceneError(f"{effect.name}: needs bodies that their supports hold in all parts; add a support")


def _refuse_dangling(system: System) -> None:
    """Refuse a part that nothing touches and that can turn even if the rest stands still.

    It needs no list of all motions, which would be long for a mesh that falls into thousands of parts.
    """
    mesh, joints = system.mesh, system.mesh.joints
    of = system.constraints
    own, periodic = of.held[of.is_own(of.held)] - of.nodes.offset, of.periodic
    held = np.unique(np.concatenate([of.nodes.part[own], of.sprung.part])).tolist()
    touched = {*chain.from_iterable(mesh.comm.allgather(held)), *of.links.parts}
    touched.update(np.unique([*periodic.part, *periodic.root_part]).tolist())
    touched.update(*(point.part.tolist() for point in of.remote.rigid if point.rows))
    touched.update(*(np.unique(rows.part).tolist() for rows in system.contacts))
    for part in range(mesh.part_count) if mesh.part_count > 1 else ():
        points = joints.points[(joints.parts == part).any(axis=1)]
        held = len(points) > 0 if mesh.axisymmetric else is_rigid(points)
        if part not in touched and not held:
            raise loose_part(UNTOUCHED, points[0] if len(points) else None)
