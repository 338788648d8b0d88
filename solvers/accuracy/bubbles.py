"""The next order on the same mesh: displacements that vanish at the corners of cells, and the forces that they cause.

The space of order 2 is the space of order 1 plus bubbles: the basis functions of the nodes between those of the mesh.
Only vectors are assembled, no matrix.

`FinerLoads` holds what the quadrature of the run leaves out of loads that are expressions of place: features narrower
than a facet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CHUNK, Array, Ints, inverse_and_determinant, inverses
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.protocols import Function, Sparse, UflForm, Vec
from stickslip.solvers.effects import active
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.fem.springs import GroundSprings
from stickslip.solvers.fem.supports import find_constraints
from stickslip.solvers.parallel.released import return_memory
from stickslip.solvers.results.recovered_stress import InCell
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.system.applied_loads import AppliedLoads
from stickslip.solvers.system.system import System, applied_loads

# degree of the quadrature by dimension: along an edge 10 points and 6, where the run has 4 at order 1
DENSE = {2: 18, 3: 10}


def beyond(mesh: Mesh) -> int:
    """That degree beyond twice the order."""
    return DENSE[mesh.dim] - 2 * mesh.degree


@dataclass(frozen=True)
class FinerLoads:
    """The loads of a system with denser quadrature."""

    system: System
    loads: AppliedLoads

    @classmethod
    def of(cls, system: System) -> FinerLoads | None:
        """Compile the forms; None: no load is an expression of place; collective."""
        places = system.problem.timeline.expressions.items()
        if not any(place.table != "supports" and found.names & {*"xyz"} for place, found in places):
            return None
        weak = WeakForms(system.problem, system.mesh, system.space, system.counters, smooth=beyond(system.mesh))
        return cls(system, applied_loads(system.problem, weak, system.constraints, system.vector()))

    def added(self, time: float) -> Vec:
        """Forces [N] that the loads of the run lack at a time [s]; collective."""
        total = self.system.vector()
        self.loads.add_to(total, self.system.course, time)
        return total - self.system.load(time)


class Bubbles:
    """The bubbles x of a system of order 1, as displacements of all nodes of order 2, zero at the corners of cells.

    Vectors of displacements and forces run over all dofs of that order, those called `free` over the free ones.
    """

    def __init__(self, system: System) -> None:
        """Compile the forms, and find which bubbles supports hold; collective."""
        problem, mesh = system.problem, system.mesh
        self.system = system
        self.space = dx.vector_space(mesh.domain, 2)
        self.nodes = Nodes.of(mesh, self.space)
        exact = _quadrature(mesh)
        weak = WeakForms(problem, mesh, self.space, system.counters, exact, beyond(mesh))
        coarse = WeakForms(problem, mesh, system.space, system.counters, exact)
        self.constraints = find_constraints(problem, mesh, self.space, self.nodes)
        self._T = self.constraints.transformation()
        self._whole, self._alone = dx.fem.Function(self.space), dx.fem.Function(self.space)
        self._linear = dx.fem.Function(system.space)
        self._inner = [weak.compile(form) for form in inner_forces(problem, weak, self._whole)]
        self._pull = [coarse.compile(form) for form in inner_forces(problem, coarse, self._alone)]
        self._loads = applied_loads(problem, weak, self.constraints, self.zero())
        self.ground = GroundSprings.of(weak)
        links = self.constraints.links
        drawn = [None if s.shrunk is None else coarse.shrinking(s) for s in system.initial.strains]  # as the system's
        forms = map(weak.initial_load, system.initial.strains, drawn)
        self.initial = [dx.assemble_vector(weak.compile(form)) for form in forms]
        self.initial += [links.forces(self.zero(), links.stiffness * rest.elongation) for rest in links.rests]
        self._corners = len(dx.reference_nodes(mesh.domain.topology.cell_type.name, 1))
        self._between = np.ones(len(self.nodes.number), bool)
        self._between[dx.cell_dofs(self.space)[:, : self._corners]] = False

    def zero(self) -> Vec:
        """No displacement."""
        return self._T.createVecLeft()

    def free(self, forces: Vec) -> Vec:
        """Forces on the free bubbles."""
        found = self._T.createVecRight()
        self._T.multTranspose(forces, found)
        found.array.reshape(-1, self.system.mesh.dim)[~self._between[: self.nodes.owned]] = 0.0
        return found

    def displacement(self, free: Vec) -> Vec:
        """Displacement of all nodes from that of the free bubbles."""
        return self._T * free

    def load(self, time: float) -> Vec:
        """External forces at a time [s], without those of initial strains [N]."""
        total = self.zero()
        self._loads.add_to(total, self.system.course, time)
        return total

    def strained(self, values: Array) -> Vec:
        """Forces of initial strains of values (k,) [N]."""
        total = self.zero()
        for value, vector in zip(values, self.initial, strict=True):
            total.axpy(value, vector)
        return total

    def initial_work(self, x: Vec) -> Array:
        """Contribution of bubbles to `InitialStrains.stress_work` (k,) [J]; collective."""
        return np.array([force.dot(x) for force in self.initial])

    def inner(self, u: Vec, x: Vec) -> Vec:
        """Inner forces a(u + x, .) [N] of a displacement u of the mesh and bubbles x; collective.

        It destroys what Python has released: vectors of the next order are up to eight times as long as others.
        """
        return_memory(self.system.mesh.comm)
        self._add_up(u, x)
        elongation = self.system.constraints.links.elongation(u) + self.elongation(x)
        return self.constraints.links.added(dx.assemble_vector(*self._inner), elongation)

    def displacement_at(self, u: Vec, x: Vec, places: Mapping[str, tuple[int, Array] | None]) -> dict[str, Array]:
        """u + x (d,) [m] at points, by name, on every rank; collective.

        Args:
            places: cell, and basis (k,) of the mesh at the point, on the rank that owns it; None elsewhere.
        """
        mesh, own = self.system.mesh, dict[str, Array]()
        shape, degree = mesh.domain.topology.cell_type.name, 2
        for name, point in self.in_cells(u, x, places).items():
            own[name] = dx.reference_basis(shape, degree, point.local[None])[0][0] @ point.displacement
        return {name: value for offers in mesh.comm.allgather(own) for name, value in offers.items()}

    def in_cells(self, u: Vec, x: Vec, places: Mapping[str, tuple[int, Array] | None]) -> dict[str, InCell]:
        """u + x [m] in the cells of this rank that points are in, by name; collective.

        Arguments as in `displacement_at`.
        """
        self._add_up(u, x)
        mesh, dofs = self.system.mesh, dx.cell_dofs(self.space)
        nodes = dx.reference_nodes(mesh.domain.topology.cell_type.name, mesh.degree)
        values = self._whole.x.array.reshape(-1, mesh.dim)
        own = {name: place for name, place in places.items() if place is not None}
        return {name: InCell(cell, basis @ nodes, values[dofs[cell]]) for name, (cell, basis) in own.items()}

    def whole(self, u: Vec, x: Vec) -> tuple[Array, Ints]:
        """u + x (nodes, d) [m] of this rank, and the nodes (own cells, k) of its cells; collective."""
        self._add_up(u, x)
        return self._whole.x.array.reshape(-1, self.system.mesh.dim), dx.cell_dofs(self.space)

    def _add_up(self, u: Vec, x: Vec) -> None:
        """Set `_whole` to u + x, ghosts included; collective."""
        dx.fill(self._linear, u.array_r)
        self._whole.interpolate(self._linear)
        dx.fill(self._whole, self._whole.x.array[: len(x.array_r)] + x.array_r)

    def reactions(self, forces: Vec) -> dict[str, tuple[Array, Array]]:
        """Force (d,) [N] and moment about the origin [N m] that each support exerts on a mesh of order 1; collective.

        Where two supports meet, a node of order 2 has a smaller share of what the other one carries than of order 1.

        Args:
            forces: inner minus outer forces at all nodes. What is left at free bubbles is that of the nodes of the
                mesh: so supports together are in balance with loads and contacts.
        """
        free = self.free(forces)
        free.array[:] /= self._copies
        left = self.displacement(free)
        held = forces - left + self._at_corners(left)
        return self.constraints.reactions(held.array_r.reshape(-1, self.system.mesh.dim))

    def _at_corners(self, forces: Vec) -> Vec:
        """Forces on bubbles of order 2, at the nodes of the mesh between which they are; collective."""
        own, d = forces.array_r, self.system.mesh.dim
        total, found = dx.fem.Function(self.space), self.zero()
        total.x.array[:] = (self._shares.T @ own.reshape(-1, d)).ravel()
        dx.add_to_owners(total)
        found.array[:] = total.x.array[: len(found.array)]
        return found

    def at_corners(self, forces: Vec) -> Vec:
        """Forces on the nodes of a mesh of order 1, as those at the corners of cells; collective."""
        dx.fill(self._linear, forces.array_r)
        total, found, d = dx.fem.Function(self.space), self.zero(), self.system.mesh.dim
        corners, nodes = dx.cell_dofs(self.space)[:, : self._corners], dx.cell_dofs(self.system.space)
        total.x.array.reshape(-1, d)[corners] = self._linear.x.array.reshape(-1, d)[nodes]
        found.array[:] = total.x.array[: len(found.array)]
        return found

    def pull(self, x: Vec) -> Vec:
        """Inner forces a(x, .) [N] of bubbles on the dofs of the mesh; releases as `inner`; collective."""
        return_memory(self.system.mesh.comm)
        dx.fill(self._alone, x.array_r)
        return self.system.constraints.links.added(dx.assemble_vector(*self._pull), self.elongation(x))

    def remote(self, x: Vec) -> Array:
        """Contribution of bubbles to the motion of remote points (components,) [m, rad]; collective."""
        return self.constraints.remote.motion(x)

    def elongation(self, x: Vec) -> Array:
        """Contribution of bubbles to the elongation of links (r,) [m]; collective."""
        return self.constraints.links.elongation(x)

    def relaxed(self, forces: Vec) -> Vec:
        """Displacement of the free bubbles under forces on them, each node by itself: block Jacobi."""
        found, d = forces.duplicate(), self.system.mesh.dim
        found.array[:] = np.einsum("nij,nj->ni", self._flexibility, forces.array_r.reshape(-1, d)).ravel()
        return found

    @cached_property
    def _copies(self) -> Array:
        """Number of nodes that move with each free dof: two where sides are periodic; at least one."""
        ones = self._T.createVecRight()
        ones.array[:] = 1.0
        copies = self._T.createVecRight()
        self._T.multTranspose(self._T * ones, copies)
        return np.asarray(np.maximum(copies.array_r, 1.0))

    @cached_property
    def _shares(self) -> Sparse:
        """Weights of each own node (rows) on the nodes of the mesh (columns, ghosts too) that it is between."""
        corners, dofs, own = self._corners, dx.cell_dofs(self.space), self.nodes.owned
        shape = self.system.mesh.domain.topology.cell_type.name
        basis = dx.reference_basis(shape, 1, dx.reference_nodes(shape, 2))[0]
        ends, share = np.zeros((len(self.nodes.number), corners), np.int32), np.zeros((own, corners))
        for node in range(corners, len(basis)):
            at = dofs[:, node]
            ends[at], share[at[at < own]] = dofs[:, :corners], basis[node]
        start = np.arange(0, corners * own + 1, corners)
        return sparse.csr_matrix((share.ravel(), ends[:own].ravel(), start), shape=(own, len(self.nodes.number)))

    @cached_property
    def _flexibility(self) -> Array:
        """Inverse of the stiffness of each own node in its free directions (n, d, d) [m/N], zero in others."""
        found, axes = self._stiffness(), np.arange(self.system.mesh.dim)
        for start in range(0, len(found), CHUNK):
            some = slice(start, min(start + CHUNK, len(found)))
            bases = self.constraints.bases(self.nodes.number[some])[0]
            inside = np.swapaxes(bases, 1, 2) @ found[some] @ bases
            inside[~self._between[some]] = 0.0
            held = inside[:, axes, axes] <= 0  # their rows and columns are zero, too
            inside[:, axes, axes] += held
            inverse = inverses(inside)
            inverse[:, axes, axes] -= held
            found[some] = inverse
        return found

    def _stiffness(self) -> Array:
        """Diagonal blocks (n, d, d) [N/m] of the stiffness at the own nodes; exact on straight simplices.

        Elsewhere the cell's Jacobian and radius are taken at its middle; Jacobi's iteration needs no more.
        """
        system, mesh = self.system, self.system.mesh
        shape, d = mesh.domain.topology.cell_type.name, mesh.dim
        points, weights = dx.reference_rule(shape, 2 * (2))
        basis, slope = dx.reference_basis(shape, 2, points)
        products = np.einsum("aqn,bqn,q->abn", slope, slope, weights).reshape(d**2, -1)
        squares = np.einsum("qn,qn,q->n", basis, basis, weights)
        x = mesh.domain.geometry.x[:, :d][dx.cell_nodes(mesh.domain)]
        middle, gradient = dx.reference_basis(shape, mesh.degree, dx.midpoint(mesh.domain))
        jacobian = np.einsum("an,cni->cia", gradient[:, 0], x)
        found, determinant = inverse_and_determinant(np.moveaxis(jacobian, 0, -1))
        inverse, volume = np.moveaxis(found, -1, 0), np.abs(determinant)
        radius = x[:, :, 0] @ middle[0]
        if mesh.axisymmetric:
            volume = volume * 2 * np.pi * radius
        owned = mesh.domain.topology.index_map(d).size_local
        lame = np.zeros((len(x), 2))
        for name in system.problem.isotropic:
            lame[mesh.cells_of(name)] = system.weak.lame(name)
        orthotropic = [
            (members[members < owned], material.tensor_in(system.problem.model == "plane stress"))
            for members, material in ((mesh.cells_of(b), m) for b, m in system.problem.orthotropic.items())
        ]
        lame[owned:] = 0.0  # ghosts belong to others
        dofs = dx.cell_dofs(self.space)
        between = [n for n in range(dofs.shape[1]) if self._between[dofs[:, n]].any()]
        at, blocks = dofs[:, between].ravel(), np.zeros((self.nodes.owned, d, d))

        def slopes(i: int, j: int) -> Array:
            """Products (c, d^2) of the reference slopes that the global slopes i and j have."""
            return np.asarray((inverse[:, :, i, None] * inverse[:, None, :, j]).reshape(-1, d**2) * volume[:, None])

        for i in range(d):
            row = dx.fem.Function(self.space)
            for j in range(d):
                by_slope = lame[:, :1] * slopes(i, j) + lame[:, 1:] * slopes(j, i)
                if i == j:
                    by_slope += lame[:, 1:] * sum(slopes(k, k) for k in range(d))
                for members, C in orthotropic:
                    by_slope[members] = sum(C[i, k, j, m] * slopes(k, m)[members] for k in range(d) for m in range(d))
                block = by_slope @ products[:, between]
                if mesh.axisymmetric and i == j == 0:
                    hoop = lame[:, 0] + 2 * lame[:, 1]
                    for members, C in orthotropic:
                        hoop[members] = C[2, 2, 2, 2]
                    block += (hoop * volume / radius**2)[:, None] * squares[between]
                row.x.array[j::d] = np.bincount(at, block.ravel(), len(self.nodes.number))
            dx.add_to_owners(row)
            blocks[:, i] = row.x.array.reshape(-1, d)[: self.nodes.owned]
        return blocks


def _quadrature(mesh: Mesh) -> int | None:
    """Degree of the quadrature on cells, exact on straight ones; None: as UFL estimates it."""
    if mesh.simplicial:
        return None if mesh.axisymmetric else 2
    return 4 + mesh.axisymmetric


def inner_forces(problem: Problem, weak: WeakForms, u: Function) -> list[UflForm]:
    """a(u, v) of the bodies, and the stiffness of effects, as forms of their own."""
    stiffness = [form for effect in active(problem) for form in effect.stiffness(problem, weak, u)]
    return [weak.elasticity(u), *stiffness]
