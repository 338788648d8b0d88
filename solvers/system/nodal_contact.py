"""A contact with a rigid obstacle at the nodes of its side: the data of `NodalRule`, and forces from its forms."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import CompiledForm, Function, Mat, Sparse, UflForm, Vec
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.fem.contact_forms import NodalRule
from stickslip.solvers.parallel.replicated import Replicated, from_rows
from stickslip.solvers.system.contact_interface import components
from stickslip.solvers.system.system import System

NOTHING: Array = np.zeros(0)


class NodalContact:
    """One contact: its nodal rule with the weights of its rows, and fields that are given at its nodes."""

    def __init__(self, system: System, rows: ContactRows) -> None:
        """Sample the side; collective."""
        self.system, self.rows = system, rows
        self.rule = NodalRule(system.weak, system.problem.pairs[rows.name].slave)
        self.change = change_of_basis(system, rows)
        nodes, self._each = np.unique(rows.surface.nodes, return_inverse=True)
        self._nodes = Replicated(system.vector(), components(nodes, system.mesh.dim))
        self.carry(rows)
        self._sampled = self.at_nodes(self.rule.sampled())
        self.weigh(rows.node_weights)

    def carry(self, rows: ContactRows) -> None:
        """Take the values at an edge from the face that carries the contact there in these rows."""
        order = np.lexsort((-rows.node_weights, rows.surface.nodes))
        first = np.unique(rows.surface.nodes[order], return_index=True)[1]
        self._carriers = components(order[first], self.system.mesh.dim)

    def weigh(self, weights: Array) -> None:
        """Give the nodal rule the weights W_j (n,) [m^(d-1)] of the nodes."""
        share = self.spread(np.repeat(weights, self.system.mesh.dim) / self._sampled)
        dx.fill(self.rule.share, share.array_r)

    def at_nodes(self, form: UflForm) -> Array:
        """Entries (n d,) of a linear form at the nodes of the side; collective."""
        return self.assembled_at_nodes(self.system.weak.compile(form))

    def assembled_at_nodes(self, form: CompiledForm) -> Array:
        """Entries (n d,) of a compiled linear form at the nodes of the side; collective."""
        return self._nodes.read(dx.assemble_vector(form))[components(self._each, self.system.mesh.dim)]

    def spread(self, values: Array) -> Vec:
        """Vector over all displacements with values (n d,) at the nodes of the side, zero elsewhere."""
        vector = self.system.vector()
        self._nodes.write(vector, values[self._carriers])
        return vector

    def coefficients(self, u: Vec) -> Vec:
        """Coefficients of phi~ on the side of a displacement u over all dofs [m]."""
        return self.change * u if self.change else u.copy()

    def on_displacements(self, forces: Vec) -> Vec:
        """Forces over all displacements [N] of forces dual to the coefficients of phi~."""
        if not self.change:
            return forces
        found = forces.duplicate()
        self.change.multTranspose(forces, found)
        return found


def traction_fields(c: ContactRows) -> tuple[Sparse, Sparse]:
    """Which traction field each multiplier of a contact stands for: vectors at the slave's nodes, flattened (n d).

    A node that carries no multiplier has a share of those of its neighbours.

    Returns:
        Fields of unit pressures p_n (m_n, n d), without entries where the law gives p_n by the displacement, and of
        unit tangential multipliers (m_t (d-1), n d).
    """
    n, d = c.surface.points.shape
    normal = sparse.coo_matrix((len(c.W_n), n * d))
    if not c.normal.at_quadrature:
        per_weight = np.divide(1.0, c.node_weights, where=c.node_weights > 0, out=np.zeros(n))
        normal = _vectors((c.psi.T @ sparse.diags(per_weight)).tocoo(), c.normals[:, None])
    return normal.tocsr(), _vectors(c.share_t.tocoo(), c.tangents * c.free[:, :, None]).tocsr()


def _vectors(share: Sparse, directions: Array) -> Sparse:
    """Matrix (m k, n d) of shares (m, n), COO, along k directions (m, k, d) of each row."""
    (m, k, d), n = directions.shape, share.shape[1]
    values = share.data[:, None, None] * directions[share.row]
    i = share.row[:, None, None] * k + np.arange(k)[:, None]
    j = share.col[:, None, None] * d + np.arange(d)
    i, j = np.broadcast_to(i, values.shape), np.broadcast_to(j, values.shape)
    return sparse.coo_matrix((values.ravel(), (i.ravel(), j.ravel())), shape=(m * k, n * d))


def change_of_basis(system: System, rows: ContactRows) -> Mat | None:
    """Matrix (all, all) from displacements to coefficients of phi~ on a contact surface; None if it is the identity."""
    surface, dim, K = rows.surface, system.mesh.dim, system.T
    once = np.zeros(len(surface.nodes))
    once[np.unique(surface.nodes, return_index=True)[1]] = 1.0  # faces that meet at an edge have the same there
    change = sparse.coo_matrix(sparse.diags(once) @ (surface.transform - sparse.identity(len(surface.nodes))))
    change.eliminate_zeros()
    if not change.nnz:
        return None
    low, high = K.getOwnershipRange()
    block = sparse.kron(change, sparse.identity(dim)).tocoo()
    at = components(rows.surface.nodes, dim)
    i, j = at[block.row], at[block.col]
    own = (i >= low) & (i < high)
    shape = (high - low, K.size[0])
    local = sparse.coo_matrix((block.data[own], (i[own] - low, j[own])), shape=shape)
    diagonal = sparse.eye(*shape, k=low)
    return from_rows((local + diagonal).tocsr(), (K.sizes[0], K.sizes[0]), K.comm)


def relative_to_obstacle(system: System, pair: str, u: Vec, time: float, driven: Array = NOTHING) -> Vec:
    """Displacement u less the motion of a pair's obstacle [m], evaluated at the nodes of the body.

    Args:
        pair: name of the contact.
        u: over all displacements [m].
        time: [s].
        driven: motions (o,) of the obstacles that forces drive [m].
    """
    points = system.nodes.points[: system.nodes.owned]
    relative = u.copy()
    relative.array[:] -= system.obstacles.motion(pair, points, time, driven).ravel()
    return relative


class FormOfPart:
    """A form of the field u = P q + shift, its derivative by the field, and both on the free displacements q."""

    def __init__(self, field: Function, P: Mat, shift: Vec, work: CompiledForm, tangent: CompiledForm) -> None:
        """
        Args:
            field: that the forms contain.
            P: (all, free).
            shift: over all displacements [m], set for each step.
            work: linear form: virtual work of the contact forces.
            tangent: its derivative by the field.
        """
        self.field, self.P, self.shift, self.work, self.tangent = field, P, shift, work, tangent

    def at(self, q: Vec) -> None:
        """Set the field of free displacements q [m]."""
        dx.fill(self.field, (self.P * q + self.shift).array_r)

    def add_forces(self, total: Vec) -> None:
        """Add the forces [N] over the free displacements at the field as it is."""
        self.P.multTransposeAdd(dx.assemble_vector(self.work), total, total)

    def add_tangent(self, J: Mat) -> None:
        """J += d forces / d q."""
        J.axpy(1.0, dx.assemble_matrix(self.tangent).PtAP(self.P), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
