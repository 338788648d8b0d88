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
from geometry.arrays import Array, Ints
from geometry.errors import SceneError
from geometry.mesh.mesh import Mesh
from geometry.mesh.nodes import Nodes
from geometry.surfaces.surface import gather_surface
from solvers.contact.pairing import pair_up
from solvers.contact.rows import ContactRows
from solvers.effects import active
from solvers.fem.constraints import Constraints
from solvers.fem.forms import WeakForms
from solvers.fem.rigid_modes import RigidModes
from solvers.fem.supports import find_constraints
from solvers.parallel.counters import Counters
from solvers.parallel.replicated import Replicated
from solvers.scene.problem import Problem
from solvers.scene.timeline import Course, Drive
from solvers.system.initial_strain import InitialStrains
from solvers.system.obstacles import Obstacles


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


@dataclass(frozen=True)
class System:
    """Everything that does not depend on the tractions."""

    problem: Problem
    mesh: Mesh
    space: Any
    nodes: Nodes
    weak: WeakForms
    counters: Counters
    constraints: Constraints
    contacts: tuple[ContactRows, ...]
    assembled: Callable[[], Any]  # makes K once
    T: Any  # (all, all), columns of eliminated numbers are zero
    load_terms: tuple[tuple[Drive, Any], ...]  # value in time, PETSc vector at value 1 [N]
    initial: InitialStrains

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
        """External forces without reactions and initial strains, over all displacements [N]."""
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
        """T^T (load + that of initial strains - K u_s) over the free numbers [N].

        A rigid motion u_s leaves no force, not even rounding.
        """
        found = self.T.createVecRight()
        total = self.initial.added(load, self.initial.values(self.course, time))
        resisted = self.lifting.followed(time) is None
        self.T.multTranspose(total - self.K * u_s if resisted else total, found)
        return found

    @cached_property
    def lifting(self) -> RigidModes:
        return RigidModes(self.constraints, *self.mesh.box())

    @cached_property
    def obstacles(self) -> Obstacles:
        """How the rigid obstacles move."""
        return Obstacles(self.problem, self.course)

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
        sides = {pair.slave: known[name].surface for name, pair in self.problem.pairs.items()}
        masters = {pair.master: known[name].master for name, pair in self.problem.pairs.items()}
        sides |= {name: side for name, side in masters.items() if name is not None and side is not None}
        rows = pair_up(self.problem, sides, self.constraints, moved)
        self.counters.searches += sum(1 for c in rows if c.master)
        fresh = tuple(c if c.name in moved else known[c.name] for c in rows)
        return replace(
            self, contacts=tuple(replace(c, surface=known[c.name].surface, master=known[c.name].master) for c in fresh)
        )

    def resultant_on_driven(self, c: ContactRows, force: Any) -> Array:
        """What B^T p of a contact does to the driven obstacles (o,) [N]; collective."""
        by_axis = self.mesh.comm.allreduce(force.array.reshape(-1, self.mesh.dim).sum(axis=0))
        return self.obstacles.resultants(c.name, by_axis)

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

    @cached_property
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
    problem: Problem, mesh: Mesh, space: Any, nodes: Nodes, constraints: Constraints
) -> tuple[ContactRows, ...]:
    """Rows of all contacts of the problem, their surfaces gathered on every rank; collective."""
    sides = {s: gather_surface(mesh, space, nodes, s) for s in problem.request.contact_sides}
    return pair_up(problem, sides, constraints, {})


def displacement_space(mesh: Mesh) -> Any:
    """Lagrange vectors of the mesh's own degree."""
    return dx.vector_space(mesh.domain, mesh.degree)


def inner_forces(problem: Problem, weak: WeakForms, u: Any = None) -> Any:
    """a(u, v) of the bodies and of effects that stiffen them; linear form of a displacement Function u, if given."""
    form = weak.elasticity(u)
    for effect in active(problem):
        form = sum(effect.stiffness(problem, weak, weak.u if u is None else u), start=form)
    return form


def _initial_strains(problem: Problem, weak: WeakForms) -> InitialStrains:
    """Assemble what effects strain the bodies by; collective."""
    strains = tuple(strain for effect in active(problem) for strain in effect.initial_strains(problem))
    coupling = np.zeros((len(strains), len(strains)))
    for i, one in enumerate(strains):
        for j, other in enumerate(strains):
            if one.body == other.body:
                coupling[i, j] = weak.size(one.body) * np.sum(one.strain * weak.initial_stress(other))
    return InitialStrains(
        strains=strains,
        forces=tuple(dx.assemble_vector(weak.compile(weak.initial_load(strain))) for strain in strains),
        coupling=coupling,
    )


def assemble(problem: Problem, mesh: Mesh, counters: Counters) -> System:
    """Build the system; collective.

    Raises:
        SceneError: supports prescribe everything, or contradict each other.
    """
    space = displacement_space(mesh)
    nodes = Nodes.of(mesh, space)
    weak = WeakForms(problem, mesh, space, counters)
    constraints = find_constraints(problem, mesh, space, nodes)
    if constraints.free_total == 0:
        raise SceneError("supports: prescribe every displacement of the mesh; nothing is left to solve")
    for time in problem.timeline.times:
        constraints.prescribed(time)  # contradictions between supports show here, before any solve
    loads = weak.loads() + [term for effect in active(problem) for term in effect.loads(problem, weak)]
    contacts = contact_rows(problem, mesh, space, nodes, constraints)
    counters.searches += sum(1 for c in contacts if c.master)
    return System(
        problem=problem,
        mesh=mesh,
        space=space,
        nodes=nodes,
        weak=weak,
        counters=counters,
        constraints=constraints,
        contacts=contacts,
        assembled=cache(lambda: dx.assemble_matrix(weak.compile(inner_forces(problem, weak)))),
        T=constraints.transformation(mesh.comm),
        load_terms=tuple((term.drive, dx.assemble_vector(weak.compile(term.form))) for term in loads),
        initial=_initial_strains(problem, weak),
    )
