"""B and C of the block system, and the nest [[F', B^T], [B, -C]] of its blocks with splits `u` and `lambda` by name.

B and C are assembled from UFL forms on the sides that touch rigid obstacles, by the mortar between bodies. Rows are
those of all multipliers: pressures of rigid normal laws, then tangential tractions, contact by contact in the order of
`AdmissibleSet`. Compliant pressures have no row: they are a function of the displacement, j_n.

Any PETSc fieldsplit applies to the nest from options, as `-pc_type fieldsplit -fieldsplit_u_pc_type gamg`; `-ksp_view`
shows the splits.

Source: Pop (1999), (1.1), (5.3): C = -K_C.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import EXACT, Array, Ints
from stickslip.geometry.protocols import KSP, Mat, Sparse, Vec
from stickslip.solvers.contact.admissible_set import AdmissibleSet, ContactBlock
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.linear.petsc_solver import PetscOptions, direct, mumps_options
from stickslip.solvers.parallel.replicated import Replicated, distributed
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

    Against rigid obstacles it is the matrix of `NodalRule`, restricted to the multipliers of the sides; between
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
    works = dx.assemble_matrix(weak.compile(nodal.rule.friction_work(weak.u, weak.v)))
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
            form = nodal.rule.elastic_slip(system.weak.v, k_T)
            per_node = nodal.at_nodes(form).reshape(-1, system.mesh.dim)[:, 0]
        diagonal[place.tangential] = np.repeat(c.share_t @ per_node, c.free.shape[1]) * c.free.ravel()
    return multipliers.matrix(sparse.diags(diagonal[multipliers.rows], format="csr"), multipliers.like)


PREFIX = "block_"  # of PETSc's options; solver.petsc_options are without it
SPLITS = ("", "fieldsplit_u_", "fieldsplit_lambda_")  # prefixes, after that one, of the nest's solvers


def nested(V: Mat, B_T: Mat, B: Mat, minus_C: Mat) -> Mat:
    """[[V, B^T], [B, -C]] as a MATNEST (PETSc); V: (n, n), B^T: (n, m), B: (m, n), -C: (m, m)."""
    nest = PETSc.Mat().createNest([[V, B_T], [B, minus_C]], comm=V.comm)
    nest.assemble()
    return nest


def solve(nest: Mat, right: tuple[Vec, Vec], found: tuple[Vec, Vec], options: PetscOptions) -> KSP:
    """Solve nest (u, p) = (f, g) by a sparse LU factor, or as PETSc's options with PREFIX say; returns the KSP.

    A preconditioner alone (`pc_type` without `ksp_type`) is used inside flexible GMRES.

    Args:
        nest: its splits are `u` and `lambda`.
        right: f and g.
        found: u and p, the start of an iterative solve, then the solution.
        options: of the user.
    """
    ksp = PETSc.KSP().create(nest.comm)
    ksp.setOptionsPrefix(PREFIX)
    ksp.setOperators(nest)
    ksp.setType("preonly")
    pc = ksp.getPC()
    pc.setType("lu")
    pc.setFactorSolverType("mumps")
    ksp.setTolerances(rtol=EXACT)  # relative residual at which an iterative solve of the nest stops
    splits, _ = nest.getNestISs()
    with options.in_force(mumps_options(PREFIX)):
        ksp.setFromOptions()
        if ksp.getType() == "preonly" and not direct(ksp):
            ksp.setType("fgmres")
        whole = nest if pc.getType() == "fieldsplit" else nest.convert("aij", PETSc.Mat())  # factors need one piece
        ksp.setOperators(whole)
        if pc.getType() == "fieldsplit":
            pc.setFieldSplitIS(("u", splits[0]), ("lambda", splits[1]))
        ksp.setInitialGuessNonzero(not direct(ksp))
        b, x = whole.createVecLeft(), whole.createVecRight()
        for split, given, start in zip(splits, right, found, strict=True):
            _copy(given, b, split)
            _copy(start, x, split)
        ksp.solve(b, x)
    for split, part in zip(splits, found, strict=True):
        solved = x.getSubVector(split)
        solved.copy(part)
        x.restoreSubVector(split, solved)
    return ksp


def backward_error(nest: Mat, right: tuple[Vec, Vec], found: tuple[Vec, Vec]) -> float:
    """Largest |b - A x| / (|A| |x| + |b|) of the two rows of blocks, each in the maximum norm [-]."""
    largest, worst = PETSc.NormType.INFINITY, 0.0
    for row, given in enumerate(right):
        left, scale = given.copy(), given.norm(largest)
        for column, part in enumerate(found):
            block = nest.getNestSubMatrix(row, column)
            left -= block * part
            scale += block.norm(largest) * part.norm(largest)
        worst = max(worst, left.norm(largest) / scale if scale else 0.0)
        if not np.isfinite(worst):
            return float("inf")
    return worst


def _copy(part: Vec, whole: Vec, split: Any) -> None:
    """Copy a vector into its split of a whole one."""
    there = whole.getSubVector(split)
    part.copy(there)
    whole.restoreSubVector(split, there)
