"""B and C of the block system: from UFL forms on the sides that touch rigid obstacles, by the mortar between bodies.

Rows are those of all multipliers: pressures of rigid normal laws, then tangential tractions, contact by contact in the
order of `AdmissibleSet`. Compliant pressures have no row: they are a function of the displacement, j_n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.protocols import Mat, Sparse, Vec
from stickslip.solvers.contact.admissible_set import AdmissibleSet, ContactBlock
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.parallel.distribute import distributed
from stickslip.solvers.parallel.replicated import Replicated
from stickslip.solvers.system.nodal_contact import NodalContact, traction_fields
from stickslip.solvers.system.system import System


@dataclass(frozen=True)
class Multipliers:
    """The m rows among all that carry multipliers, and a distributed vector of them."""

    rows: Ints  # (m,) numbers among all rows
    at: Replicated  # all entries of a distributed vector of multipliers
    like: Vec

    @staticmethod
    def of(system: System, cone: AdmissibleSet) -> Multipliers:
        """The multipliers of a system's contacts; the rows are shared out evenly among the ranks."""
        rigid = np.ones(cone.size, bool)
        for place in cone.places:
            rigid[place.normal] = not place.rows.normal.at_quadrature
        rows = np.flatnonzero(rigid)
        like = PETSc.Vec().createMPI(len(rows), comm=system.K_B.comm)
        return Multipliers(rows, Replicated(like, np.arange(len(rows))), like)

    def vector(self, p: Array) -> Vec:
        """Tractions p (rows,) [Pa] of all rows as a distributed vector of the multipliers."""
        found = self.like.duplicate()
        self.at.write(found, p[self.rows])
        return found

    def matrix(self, local: Sparse, columns: Vec) -> Mat:
        """Distributed matrix (m, columns) of a sparse one that every rank has whole; `columns` has their layout."""
        return distributed(local, self.like, columns)

    def on_free(self, system: System, rows: Sparse) -> Mat:
        """Distributed matrix (m, free dofs) of a sparse one (m, c) on the contact dofs, which every rank has whole."""
        entries, free = rows.tocoo(), system.T.createVecRight()
        columns = system.interface.dofs[entries.col]
        shape = len(self.rows), free.getSize()
        return self.matrix(sparse.csr_matrix((entries.data, (entries.row, columns)), shape=shape), free)


def assemble_B(system: System, surface: DelassusOperator, cone: AdmissibleSet, multipliers: Multipliers) -> Mat:
    """B (m, free dofs): virtual work of unit tractions [m^(d-1)]; B^T p are forces [N]; collective.

    Against rigid obstacles it is the matrix of `ContactForms`, restricted to the multipliers of the sides; between
    bodies, W N of the contact operator.
    """
    free = system.T.createVecRight()
    total = None
    for place in cone.places:
        if place.rows.master is None:
            part = _by_forms(system, place, multipliers)
        else:
            mine = np.zeros(cone.size, bool)
            mine[place.normal], mine[place.tangential] = True, True
            weighted = (sparse.diags(surface.W * mine) @ surface.N)[multipliers.rows]
            part = multipliers.on_free(system, weighted)
        if total is None:
            total = part
        else:
            total.axpy(1.0, part, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return total or multipliers.matrix(sparse.csr_matrix((len(multipliers.rows), free.getSize())), free)


def _by_forms(system: System, place: ContactBlock, multipliers: Multipliers) -> Mat:
    """B of one contact with a rigid obstacle, by dolfinx: the matrix of b over all displacements, restricted."""
    nodal, weak = NodalContact(system, place.rows), system.weak
    works = dx.assemble_matrix(weak.compile(nodal.forms.friction_work(weak.u, weak.v)))
    on_free = nodal.change.matMult(system.T) if nodal.change else system.T
    dim, nodes = system.mesh.dim, place.rows.surface.nodes
    normal, tangential = (part.tocoo() for part in traction_fields(place.rows))
    rows = np.concatenate([place.normal.start + normal.row, place.tangential.start + tangential.row])
    at = np.concatenate([normal.col, tangential.col])
    values, columns = np.concatenate([normal.data, tangential.data]), nodes[at // dim] * dim + at % dim
    shape = len(multipliers.rows), system.vector().getSize()
    spread = sparse.csr_matrix((values, (np.searchsorted(multipliers.rows, rows), columns)), shape=shape)
    return multipliers.matrix(spread, system.vector()).matMult(works).matMult(on_free)


def assemble_C(system: System, cone: AdmissibleSet, multipliers: Multipliers) -> Mat:
    """C (m, m), diagonal: W / k_T [m^(d+1)/N] on tangential rows with a stiffness before slip, else zero; collective.

    Against rigid obstacles the weights are those that the form of the elastic slip has at the nodes, lumped on the
    nodes that carry multipliers.
    """
    diagonal = np.zeros(cone.size)
    for place in cone.with_friction():
        c = place.rows
        k_T = c.friction.k_T if c.friction is not None else None
        if not k_T:
            continue
        per_node = c.node_weights / k_T
        if c.master is None:
            nodal = NodalContact(system, c)
            form = nodal.forms.elastic_slip(system.weak.v, k_T)
            per_node = nodal.at_nodes(form).reshape(-1, system.mesh.dim)[:, 0]
        diagonal[place.tangential] = np.repeat(c.share_t @ per_node, c.free.shape[1]) * c.free.ravel()
    return multipliers.matrix(sparse.diags(diagonal[multipliers.rows], format="csr"), multipliers.like)
