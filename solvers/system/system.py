"""The scene on its mesh: K_B, loads, constraints and contact rows, assembled once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from geometry import dolfinx_versions as dx
from geometry.amplitude import value_at
from geometry.arrays import Array, Ints
from geometry.errors import SceneError
from geometry.mesh.mesh import Mesh
from geometry.mesh.nodes import Nodes
from geometry.surfaces.surface import Surface, gather_surface
from solvers.contact.build import build_rows
from solvers.contact.operators import OPERATORS
from solvers.contact.rigid_obstacle import rigid_coupling
from solvers.contact.rows import ContactRows
from solvers.effects import EFFECTS
from solvers.fem.constraints import AXES, Constraints
from solvers.fem.forms import WeakForms
from solvers.fem.rigid_modes import Lifting
from solvers.fem.supports import find_constraints
from solvers.parallel.counters import Counters
from solvers.parallel.replicated import Replicated
from solvers.scene.contact import Contact
from solvers.scene.course import Course, Drive
from solvers.scene.scene import Scene


def free_stiffness(K: Any, T: Any, constraints: Constraints) -> Any:
    """T^T K T (PETSc), and at eliminated numbers the mean stiffness of the free ones alone."""
    low, high = T.getOwnershipRange()
    gone = constraints.eliminated()
    own = gone[(gone >= low) & (gone < high)].astype(PETSc.IntType)
    if constraints.selects:  # no product, which takes as much memory again
        stiffness, free = K.copy(), K.getDiagonal()
        free.array[own - low] = 0.0
        stiffness.zeroRowsColumns(own, diag=free.sum() / constraints.free_total)
        return stiffness
    stiffness = K.PtAP(T)
    mean = stiffness.getDiagonal().sum() / constraints.free_total
    diagonal = PETSc.Mat().createAIJ(stiffness.getSizes(), bsize=constraints.dim, nnz=(1, 0), comm=stiffness.comm)
    pointer = np.searchsorted(own, np.arange(low, high + 1)).astype(PETSc.IntType)
    diagonal.setValuesCSR(pointer, own, np.full(len(own), mean))
    diagonal.assemble()
    stiffness.axpy(1.0, diagonal, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return stiffness


REACH = 0.2  # of the sides' extent: as far as contact is looked for where the scene does not say
SLACK = 1 + 1e-6  # a gap may be as wide as the reach to rounding


@dataclass(frozen=True)
class System:
    """Everything that does not depend on the tractions."""

    scene: Scene
    mesh: Mesh
    space: Any
    nodes: Nodes
    weak: WeakForms
    counters: Counters
    constraints: Constraints
    contacts: tuple[ContactRows, ...]
    assembled: Callable[[], Any]  # makes K once
    T: Any  # (all, all), columns of eliminated numbers are zero
    load_terms: tuple[tuple[Drive, Any], ...]  # what drives it, PETSc vector at value 1 [N]

    @property
    def course(self) -> Course:
        """What drives the scene in time."""
        return self.constraints.course

    @property
    def K(self) -> Any:
        """Stiffness of all displacements, PETSc [N/m]; assembled when it is first asked for."""
        return self.assembled()

    @cached_property
    def K_B(self) -> Any:
        """Stiffness of the free displacements, T^T K T, and their mean stiffness alone at eliminated numbers."""
        return free_stiffness(self.K, self.T, self.constraints)

    def vector(self) -> Any:
        """A PETSc vector of zeros over all displacements."""
        return self.T.createVecLeft()

    def load(self, time: float) -> Any:
        """External forces without reactions, over all displacements [N]."""
        total = self.vector()
        for drive, vector in self.load_terms:
            total.axpy(self.course.value(drive, time), vector)
        return total

    def prescribed(self, time: float) -> Any:
        """u_s(t) over all displacements [m]: a rigid motion where that is all that is prescribed, else 0 elsewhere."""
        total, motion = self.vector(), self.lifting.followed(time)
        if motion is None:
            self._prescribed.write(total, self.constraints.prescribed(time).ravel())
        else:
            nodes, own = self.nodes, slice(self.nodes.owned)
            total.array[:] = self.lifting.displacement(motion, nodes.points[own], nodes.part[own]).ravel()
        return total

    def pull(self, time: float, load: Any, u_s: Any) -> Any:
        """T^T (load - K u_s) over the free numbers [N]; of a rigid motion u_s not even rounding is left."""
        found = self.T.createVecRight()
        resisted = self.lifting.followed(time) is None
        self.T.multTranspose(load - self.K * u_s if resisted else load, found)
        return found

    @cached_property
    def lifting(self) -> Lifting:
        return Lifting(self.constraints, *self.mesh.box())

    @cached_property
    def driven(self) -> tuple[tuple[str, int], ...]:
        """Obstacle and axis of each obstacle motion (o,) that a force drives: an unknown."""
        return tuple((name, AXES[axis]) for name, obs in self.scene.obstacles.items() for axis in obs.driven())

    def driving_force(self, time: float) -> Array:
        """Forces (o,) on the driven obstacles [N]."""
        scene = self.course.scene
        end, obstacles = scene.steps.end, scene.obstacles
        found = [value_at(obstacles[name].force["xyz"[axis]], time, end) for name, axis in self.driven]  # type: ignore[index]
        return np.array(found, float)

    def motion_of(self, contact: Contact, points: Array, time: float, driven: Array) -> Array:
        """Motion (m, d) [m] of a contact's obstacle as seen from `points`; `driven` (o,) are the unknown ones."""
        obstacle = self.course.scene.obstacles[contact.against]
        motion = obstacle.motion(points, time, self.scene.steps.end, tied=contact.normal.ties)
        for (name, axis), size in zip(self.driven, driven, strict=True):
            if name == contact.against:
                motion[:, axis] += size
        return motion

    def obstacle_motion(self, time: float, driven: Array) -> dict[str, Array]:
        """Motion (n_all, d) [m] of each contact's obstacle at the nodes of its surface; 0 between bodies."""
        contacts = self.scene.contacts
        return {
            c.name: np.zeros(c.points.shape) if c.master else self.motion_of(contacts[c.name], c.points, time, driven)
            for c in self.contacts
        }

    def contact_displacement(self, u: Any) -> list[Array]:
        """Displacement (n_all, d) [m] of each contact's nodes, on every rank."""
        values = self._surface.read(u).reshape(-1, self.mesh.dim)
        ends = np.cumsum([0, *(len(c.nodes) for c in self.contacts)])
        return [values[i:j] for i, j in pairwise(ends)]

    def contact_forces(self, p_n: list[Array], t: list[Array]) -> Any:
        """B^T p over all displacements [N]."""
        total, parts = self.vector(), zip(self.contacts, p_n, t, strict=True)
        self._surface.add(total, np.concatenate([np.zeros(0), *(c.nodal_forces(*p).ravel() for c, *p in parts)]))
        return total

    def contact_force(self, c: ContactRows, p_n: Array, t: Array) -> Any:
        """B^T p of one contact over all displacements [N]."""
        total = self.vector()
        scatter = Replicated(total, _components(c.nodes, self.mesh.dim))
        scatter.add(total, c.nodal_forces(p_n, t).ravel())
        return total

    def searched(self, moved: Mapping[str, Array]) -> System:
        """The same system with the pairs of sliding contacts found where `moved` (n_all, d) [m] has brought them."""
        known = {c.name: c for c in self.contacts}
        sides = {self.scene.contacts[c.name].surface: c.surface for c in self.contacts}
        sides |= {self.scene.contacts[c.name].against: c.master for c in self.contacts if c.master}
        rows = couple(self.scene, sides, self.constraints, moved)
        self.counters.searches += sum(1 for c in rows if c.master)
        fresh = tuple(c if c.name in moved else known[c.name] for c in rows)
        return replace(
            self, contacts=tuple(replace(c, surface=known[c.name].surface, master=known[c.name].master) for c in fresh)
        )

    def resultant_on_driven(self, c: ContactRows, force: Any) -> Array:
        """What B^T p of a contact does to the driven obstacles (o,) [N]; collective."""
        by_axis = self.mesh.comm.allreduce(force.array.reshape(-1, self.mesh.dim).sum(axis=0))
        against = self.scene.contacts[c.name].against
        return np.array([by_axis[axis] * (name == against) for name, axis in self.driven], float)

    def reactions(self, residual: Any) -> dict[str, tuple[Array, Array]]:
        """Force (d,) [N] and moment about the origin [N m] that each support exerts; residual: see `State` [N]."""
        return self.constraints.reactions(self._prescribed.read(residual).reshape(-1, self.mesh.dim))

    @cached_property
    def contact_dofs(self) -> Ints:
        """Free numbers (c,) that the contact rows touch, increasing; the same on every rank."""
        found: list[Ints] = [np.zeros(0, np.int64)]
        found += [self.constraints.numbers(c.nodes)[self.constraints.bases(c.nodes)[1]] for c in self.contacts]
        return np.unique(np.concatenate(found))

    def trace(self, c: ContactRows) -> Any:
        """Contact dofs (c,) to the displacement of a contact's nodes (n_all d,), sparse."""
        bases, numbers = self.constraints.bases(c.nodes)[0], self.constraints.numbers(c.nodes)
        node, i, j = np.nonzero(bases)
        columns = np.searchsorted(self.contact_dofs, numbers[node, j])
        shape = (self.mesh.dim * len(c.nodes), len(self.contact_dofs))
        return sparse.csr_matrix((bases[node, i, j], (self.mesh.dim * node + i, columns)), shape=shape)

    def rigid_modes(self) -> Array:
        """Rigid motions that no support resists, on the contact dofs (c, r), orthonormal."""
        motions, count = self.lifting.unresisted, self.mesh.part_count
        of_part = motions.reshape(count, len(motions) // count, motions.shape[1])
        values = np.zeros((len(self.contact_dofs), motions.shape[1]))
        for c in self.contacts if motions.shape[1] else ():
            fields = self.lifting.fields(c.points) @ of_part[self.mesh.parts[c.input]]
            bases, free = self.constraints.bases(c.nodes)
            at = np.searchsorted(self.contact_dofs, self.constraints.numbers(c.nodes)[free])
            values[at] = (np.swapaxes(bases, 1, 2) @ fields)[free]
        if motions.shape[1] and np.linalg.matrix_rank(values) < motions.shape[1]:
            raise SceneError("supports: a part of the mesh that no contact touches can move as a whole; hold it")
        return np.asarray(np.linalg.qr(values)[0])

    @cached_property
    def extent(self) -> float:
        """L, the largest side of the bodies' bounding box [m]."""
        low, high = self.mesh.box()
        return float(np.max(high - low))

    @cached_property
    def _prescribed(self) -> Replicated:
        nodes = self.constraints.prescribed_nodes
        return Replicated(self.vector(), _components(nodes, self.mesh.dim))

    @cached_property
    def _surface(self) -> Replicated:
        nodes = np.concatenate([np.zeros(0, np.int64), *(c.nodes for c in self.contacts)])
        return Replicated(self.vector(), _components(nodes, self.mesh.dim))


def _components(nodes: Ints, dim: int) -> Ints:
    return (nodes[:, None] * dim + np.arange(dim)).ravel()


def contact_rows(
    scene: Scene, mesh: Mesh, space: Any, nodes: Nodes, constraints: Constraints
) -> tuple[ContactRows, ...]:
    """Rows of all contacts of the scene, their surfaces gathered on every rank; collective."""
    sides = {s: gather_surface(mesh, space, nodes, s) for s in scene.request().contact_sides}
    return couple(scene, sides, constraints, {})


def couple(
    scene: Scene, sides: Mapping[str, Surface], constraints: Constraints, moved: Mapping[str, Array]
) -> tuple[ContactRows, ...]:
    """Rows of all contacts where the surfaces are; `moved` (n_all, d) by contact, relative to a rigid obstacle [m]."""
    couplings = {}
    for name, contact in scene.contacts.items():
        slave, master = sides[contact.surface], sides.get(contact.against)
        if name in moved:
            own, other = np.split(moved[name], [len(slave.nodes)])
            slave = replace(slave, points=slave.points + own)
            master = master and replace(master, points=master.points + other)
        if master is None:
            couplings[name] = contact, rigid_coupling(slave, scene.obstacles[contact.against])
            continue
        # of the start, and the same for a scene that is turned as a whole
        far = contact.search_distance or REACH * _spread(sides[contact.surface], sides[contact.against])
        couplings[name] = contact, OPERATORS[contact.operator or "mortar"](slave, master, far * SLACK)
        if not np.any(couplings[name][1].weights > 0):
            raise SceneError(
                f"contacts.{name}: nothing of {contact.surface} faces {contact.against} within {far:g} m; set "
                "search_distance, or exchange the sides"
            )
    return tuple(build_rows(couplings, constraints, moved))


def _spread(*sides: Surface) -> float:
    """Diameter of the sphere about the middle of the sides' nodes [m]."""
    points = np.concatenate([side.points for side in sides])
    return 2 * float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())


def displacement_space(mesh: Mesh) -> Any:
    """Lagrange vectors of the mesh's own degree."""
    return dx.vector_space(mesh.domain, mesh.degree)


def assemble(scene: Scene, mesh: Mesh, counters: Counters) -> System:
    """Build the system; collective."""
    space = displacement_space(mesh)
    nodes = Nodes.of(mesh, space)
    weak = WeakForms(scene, mesh, space, counters)
    constraints = find_constraints(scene, mesh, space, nodes)
    if constraints.free_total == 0:
        raise SceneError("supports: prescribe every displacement of the mesh; nothing is left to solve")
    for time in scene.requested_times():
        constraints.prescribed(time)  # contradictions between supports show here, before any solve
    loads = weak.loads() + [form for effect in EFFECTS if effect.because(scene) for form in effect.loads(scene, weak)]
    contacts = contact_rows(scene, mesh, space, nodes, constraints)
    counters.searches += sum(1 for c in contacts if c.master)
    return System(
        scene=scene,
        mesh=mesh,
        space=space,
        nodes=nodes,
        weak=weak,
        counters=counters,
        constraints=constraints,
        contacts=contacts,
        assembled=cache(lambda: dx.assemble_matrix(weak.compile(weak.elasticity()))),
        T=constraints.transformation(mesh.comm),
        load_terms=tuple((drive, dx.assemble_vector(weak.compile(form))) for drive, form in loads),
    )
