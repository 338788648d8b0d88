"""Contact forces of the smoothed laws on the free displacements, and their tangent, assembled from UFL forms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from geometry import dolfinx_versions as dx
from geometry.amplitude import value_at
from geometry.arrays import Array
from geometry.protocols import CompiledForm, Function, Mat, Vec
from solvers.contact.rows import ContactRows
from solvers.fem.smoothed_laws import SmoothedContact, Widths
from solvers.laws.friction import Tresca
from solvers.parallel.replicated import Replicated
from solvers.system.contact_interface import components
from solvers.system.system import System


@dataclass(frozen=True)
class Part:
    """One form, of the field P q + shift."""

    field: Function
    P: Mat  # (all, free)
    shift: Vec  # over all displacements [m], set for each step
    work: CompiledForm  # linear form: virtual work of the contact forces
    tangent: CompiledForm  # its derivative by the field


class SmoothedForces:
    """Contact forces B^T p of all contacts as a function of the free displacements q, u = T q + u_s."""

    def __init__(self, system: System) -> None:
        """Compile the forms; collective."""
        self.system = system
        self.widths = Widths.of(system.weak)
        self.contacts = [Nodal(system, rows, self.widths) for rows in system.contacts]
        self.parts = [part for contact in self.contacts for part in contact.parts()]

    def begin(self, u: Vec, motion: Mapping[str, Array], time: float) -> None:
        """Start a step.

        Args:
            u: displacement [m] at the last accepted step, over all displacements.
            motion: motion (n, d) [m] of each contact's obstacle at that step, by contact.
            time: end of the step [s].
        """
        u_s = self.system.prescribed(time)
        for contact in self.contacts:
            contact.begin(u, motion[contact.rows.name], u_s, time)

    def update(self, q: Vec) -> None:
        """Set the field of every form to P q + shift."""
        for part in self.parts:
            _fill(part.field, part.P * q + part.shift)

    def forces(self, q: Vec) -> Vec:
        """B^T p [N] over the free displacements."""
        self.update(q)
        total = q.duplicate()
        for part in self.parts:
            part.P.multTransposeAdd(dx.assemble_vector(part.work), total, total)
        return total

    def add_tangent(self, q: Vec, J: Mat) -> None:
        """J += d forces / d q; contact only couples displacements of the same cell, so the pattern of J suffices."""
        self.update(q)
        for part in self.parts:
            J.axpy(1.0, dx.assemble_matrix(part.tangent).PtAP(part.P), PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)


class Nodal:
    """One contact: its forms, and their data at the nodes of its surface."""

    def __init__(self, system: System, rows: ContactRows, widths: Widths) -> None:
        contact, weak = system.problem.pairs[rows.name].contact, system.weak
        self.system, self.rows, self.contact = system, rows, contact
        self.bound = weak.constant(0.0)
        self.forms = SmoothedContact(weak, contact, widths, self.bound)
        self.S = _transformation(system, rows)  # displacements to coefficients of phi~
        self.P = self.S.matMult(system.T) if self.S else system.T
        self.nodes = Replicated(system.vector(), components(rows.surface.nodes, system.mesh.dim))
        sampled = self.nodes.read(dx.assemble_vector(weak.compile(self.forms.sampled())))
        _fill(self.forms.share, self._spread(np.repeat(rows.node_weights, system.mesh.dim) / sampled))
        _fill(self.forms.normal, self._spread(rows.frames[:, 0].ravel()))
        self.relative_shift, self.motion_shift = system.vector(), system.vector()

    def parts(self) -> list[Part]:
        """The forms, compiled."""
        compile_, found = self.system.weak.compile, []
        for field, work, tangent in self.forms.works():
            nodal = field is self.forms.motion
            P, shift = (self.P, self.motion_shift) if nodal else (self.system.T, self.relative_shift)
            found.append(Part(field, P, shift, compile_(work), compile_(tangent)))
        return found

    def begin(self, u: Vec, motion: Array, u_s: Vec, time: float) -> None:
        """Set the data of a step.

        Args:
            u: displacement [m] at the last accepted step, over all displacements.
            motion: motion (n, d) [m] of the obstacle at that step.
            u_s: prescribed displacement [m] at `time`, over all displacements.
            time: end of the step [s].
        """
        end, law = self.system.problem.timeline.end, self.rows.friction
        if isinstance(law, Tresca):
            self.bound.value = value_at(law.bound, time, end)
        _fill(self.forms.before, self._motion(u - self._spread(motion.ravel())))
        relative = self._relative(u_s, time)
        relative.copy(self.relative_shift)
        self._motion(relative).copy(self.motion_shift)

    def _relative(self, u: Vec, time: float) -> Vec:
        """u less the obstacle's motion at `time` [s], evaluated at the nodes of the body."""
        system = self.system
        points, nothing = system.nodes.points[: system.nodes.owned], np.zeros(0)
        moved = system.obstacles.motion(self.rows.name, points, time, nothing)
        relative = u.copy()
        relative.array[:] -= moved.ravel()
        return relative

    def _motion(self, relative: Vec) -> Vec:
        """Relative displacement [m] in the basis phi~, less g n."""
        motion = self.S * relative if self.S else relative.copy()
        motion.axpy(-1.0, self._spread((self.rows.node_gap[:, None] * self.rows.frames[:, 0]).ravel()))
        return motion

    def _spread(self, values: Array) -> Vec:
        """Vector over all displacements with values (n d,) at the nodes of the surface, zero elsewhere."""
        vector = self.system.vector()
        self.nodes.write(vector, values)
        return vector


def _transformation(system: System, rows: ContactRows) -> Mat | None:
    """Matrix (all, all) from displacements to coefficients of phi~ on a contact surface; None if it is the identity."""
    surface, dim, K = rows.surface, system.mesh.dim, system.K
    change = sparse.coo_matrix(surface.transform - sparse.identity(len(surface.nodes)))
    change.eliminate_zeros()
    if not change.nnz:
        return None
    low, high = K.getOwnershipRange()
    block = sparse.kron(change, sparse.identity(dim)).tocoo()
    at = components(rows.surface.nodes, dim)
    i, j = at[block.row], at[block.col]
    own = (i >= low) & (i < high)
    shape = (high - low, K.size[1])
    local = sparse.coo_matrix((block.data[own], (i[own] - low, j[own])), shape=shape)
    diagonal = sparse.eye(*shape, k=low)
    csr = (local + diagonal).tocsr()
    matrix = PETSc.Mat().createAIJ((K.sizes[0], K.sizes[1]), csr=(csr.indptr, csr.indices, csr.data), comm=K.comm)
    matrix.assemble()
    found: Mat | None = matrix
    return found


def _fill(function: Function, vector: Vec) -> None:
    """Copy a vector into a function, ghosts included."""
    dx.petsc_vector(function).array[:] = vector.array
    function.x.scatter_forward()
