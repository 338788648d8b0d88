"""The scene on its mesh: K_B, loads, constraints and contact rows, assembled once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from geometry import dolfinx_versions as dx
from geometry.amplitude import Amplitude, value_at
from geometry.errors import SceneError
from geometry.mesh import Mesh
from geometry.nodes import Nodes
from geometry.surface import gather_surface
from solvers.constraints import Constraints, find_constraints, rigid_fields
from solvers.counters import Counters
from solvers.forms import WeakForms
from solvers.nouns.scene import Scene
from solvers.operators.rigid import build_rows
from solvers.operators.rows import ContactRows
from solvers.plan import active_effects
from solvers.replicated import Replicated

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


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
    K: Any  # all displacements, PETSc [N/m]
    T: Any  # (all, free)
    load_terms: tuple[tuple[Amplitude, Any], ...]  # amplitude, PETSc vector at amplitude 1 [N]

    @cached_property
    def K_B(self) -> Any:
        """Stiffness of the free displacements, T^T K T."""
        return self.K.PtAP(self.T)

    def load(self, time: float) -> Any:
        """External forces without reactions, over all displacements [N]."""
        total = self.K.createVecLeft()
        for amplitude, vector in self.load_terms:
            total.axpy(value_at(amplitude, time, self.scene.steps.end), vector)
        return total

    def prescribed(self, time: float) -> Any:
        """u_s(t) over all displacements [m]."""
        total = self.K.createVecRight()
        self._prescribed.write(total, self.constraints.prescribed(time).ravel())
        return total

    def obstacle_motion(self, time: float) -> dict[str, Array]:
        """Prescribed motion (d,) [m] of each contact's obstacle."""
        return {c.name: c.obstacle.displacement_at(time, self.scene.steps.end, self.mesh.dim) for c in self.contacts}

    def contact_displacement(self, u: Any) -> list[Array]:
        """Displacement (n, d) [m] of each contact surface's nodes, on every rank."""
        values = self._surface.read(u).reshape(-1, self.mesh.dim)
        ends = np.cumsum([0, *(len(c.surface.nodes) for c in self.contacts)])
        return [values[i:j] for i, j in pairwise(ends)]

    def contact_forces(self, p_n: list[Array], t: list[Array]) -> Any:
        """B^T p over all displacements [N]."""
        total = self.K.createVecRight()
        for c, pressure, tangential in zip(self.contacts, p_n, t, strict=True):
            scatter = Replicated(total, _components(c.surface.nodes, self.mesh.dim))
            scatter.add(total, c.nodal_forces(pressure, tangential).ravel())
        return total

    def reactions(self, u: Any, load: Any, contact: Any) -> dict[str, tuple[Array, Array]]:
        """Force (d,) [N] and moment about the origin [N m] that each support exerts."""
        residual = self.K * u
        residual -= load
        residual += contact
        return self.constraints.reactions(self._prescribed.read(residual).reshape(-1, self.mesh.dim))

    @cached_property
    def contact_dofs(self) -> Ints:
        """Free numbers (c,) that the contact rows touch, increasing; the same on every rank."""
        found: list[Ints] = [np.zeros(0, np.int64)]
        for c in self.contacts:
            starts = self.constraints.free_start(c.surface.nodes)
            sizes = np.array([self.constraints.basis(int(n)).shape[1] for n in c.surface.nodes])
            found += [np.arange(s, s + k) for s, k in zip(starts, sizes, strict=True)]
        return np.unique(np.concatenate(found)).astype(np.int64)

    def trace(self, c: ContactRows) -> Any:
        """Contact dofs (c,) to the displacement of a surface's nodes (n d,), sparse."""
        d, rows, columns, values = self.mesh.dim, [], [], []
        starts = self.constraints.free_start(c.surface.nodes)
        for j, (node, start) in enumerate(zip(c.surface.nodes, starts, strict=True)):
            basis = self.constraints.basis(int(node))
            a, b = np.nonzero(basis)
            rows.append(d * j + a)
            columns.append(np.searchsorted(self.contact_dofs, start + b))
            values.append(basis[a, b])
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return sparse.csr_matrix(entries, shape=(d * len(c.surface.nodes), len(self.contact_dofs)))

    def rigid_modes(self) -> Array:
        """Rigid motions that no support resists, on the contact dofs (c, r), orthonormal."""
        low, high = self.mesh.box()
        motions = self.constraints.rigid_motions(low, high)
        values = np.zeros((len(self.contact_dofs), motions.shape[1]))
        if motions.shape[1]:
            for c in self.contacts:
                fields = rigid_fields(c.surface.points, (low + high) / 2, float(np.max(high - low))) @ motions
                starts = self.constraints.free_start(c.surface.nodes)
                for node, start, field in zip(c.surface.nodes, starts, fields, strict=True):
                    basis = self.constraints.basis(int(node))
                    at = np.searchsorted(self.contact_dofs, start)
                    values[at : at + basis.shape[1]] = basis.T @ field
        return np.asarray(np.linalg.qr(values)[0])

    @cached_property
    def extent(self) -> float:
        """L, the largest side of the bodies' bounding box [m]."""
        low, high = self.mesh.box()
        return float(np.max(high - low))

    @cached_property
    def _prescribed(self) -> Replicated:
        nodes = self.constraints.prescribed_nodes
        return Replicated(self.K.createVecRight(), _components(nodes, self.mesh.dim))

    @cached_property
    def _surface(self) -> Replicated:
        nodes = np.concatenate([np.zeros(0, np.int64), *(c.surface.nodes for c in self.contacts)])
        return Replicated(self.K.createVecRight(), _components(nodes, self.mesh.dim))


def _components(nodes: Ints, dim: int) -> Ints:
    return (nodes[:, None] * dim + np.arange(dim)).ravel()


def contact_rows(
    scene: Scene, mesh: Mesh, space: Any, nodes: Nodes, constraints: Constraints
) -> tuple[ContactRows, ...]:
    """Rows of all contacts of the scene, their surfaces gathered on every rank; collective."""
    contacts = {
        name: (contact, scene.obstacles[contact.against], gather_surface(mesh, space, nodes, contact.surface))
        for name, contact in scene.contacts.items()
    }
    return tuple(build_rows(contacts, constraints, order=1))


def assemble(scene: Scene, mesh: Mesh, counters: Counters) -> System:
    """Build the system; collective."""
    space = dx.vector_space(mesh.domain, 1)
    nodes = Nodes.of(space)
    weak = WeakForms(scene, mesh, space, counters)
    constraints = find_constraints(scene, mesh, space, nodes)
    if constraints.free_total == 0:
        raise SceneError("supports: prescribe every displacement of the mesh; nothing is left to solve")
    for time in scene.requested_times():
        constraints.prescribed(time)  # contradictions between supports show here, before any solve
    loads = weak.loads() + [form for effect in active_effects(scene) for form in effect.loads(scene, weak)]
    return System(
        scene=scene,
        mesh=mesh,
        space=space,
        nodes=nodes,
        weak=weak,
        counters=counters,
        constraints=constraints,
        contacts=contact_rows(scene, mesh, space, nodes, constraints),
        K=dx.assemble_matrix(weak.compile(weak.elasticity())),
        T=constraints.transformation(mesh.comm),
        load_terms=tuple((amplitude, dx.assemble_vector(weak.compile(form))) for amplitude, form in loads),
    )
