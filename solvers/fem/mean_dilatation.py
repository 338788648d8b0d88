"""Mean dilatation: nearly incompressible bodies whose volume changes as a mean around each node, so that nothing locks.

The energy λ/2 ∫ (div u)² dx becomes λ/2 sum V_a θ_a², θ_a = ∫ φ_a div u dx / V_a, V_a = ∫ φ_a dx, φ_a the linear basis
functions. That is a displacement-pressure formulation, p = -λ sum θ_a φ_a, whose pressures are eliminated by a lumped
mass: the stiffness stays symmetric positive definite, without further unknowns. With displacements of order 2 it is the
pair of Taylor & Hood. Displacements of order 1 have too few freedoms for a pressure at each corner: nodes at the body's
surface have none, their share goes to the neighbours within; nodes without such a neighbour keep theirs.

Source: Taylor & Hood, Comput. Fluids 1 (1973); Bonet & Burton, Commun. Numer. Meth. Engng 14 (1998), of averages at the
nodes of linear tetrahedra; de Souza Neto et al., Int. J. Numer. Meth. Engng 62 (2005), of averages over patches;
Vanderbei, SIAM J. Optim. 5 (1995), of quasi-definite matrices.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property

import numpy as np
from petsc4py import PETSc

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import EXACT, Array
from stickslip.geometry.dolfinx_versions import ufl
from stickslip.geometry.protocols import Function, FunctionSpace, Mat, Vec
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.fem.terms import InitialStrain


class MeanDilatation:
    """The averages of all bodies that have them; without such bodies it does nothing."""

    def __init__(self, weak: WeakForms) -> None:
        """Assemble the averages; collective."""
        self._weak = weak
        self._bodies = {name: self._averages(name) for name in weak.problem.averaged}

    def __bool__(self) -> bool:
        """Whether any body has them."""
        return bool(self._bodies)

    @cached_property
    def _space(self) -> FunctionSpace:
        return dx.scalar_space(self._weak.mesh.domain)

    def _averages(self, body: str) -> tuple[Mat, Vec, Mat | None]:
        """Of one body: displacement to V_a θ_a, V_a, and the matrix by which surface nodes give away their share."""
        weak, q = self._weak, ufl.TestFunction(self._space)
        change = q * ufl.tr(weak.strain(weak.u)) * weak.volume(body)
        C, V = dx.assemble_matrix(weak.compile(change)), dx.assemble_vector(weak.compile(q * weak.volume(body)))
        if weak.mesh.degree > 1:
            return C, V, None
        share = self._inwards(body, V)
        return share.matMult(C), share * V, share

    def _inwards(self, body: str, V: Vec) -> Mat:
        """(nodes, nodes): shares of the nodes that keep a dilatation in those that have none."""
        weak, q = self._weak, ufl.TestFunction(self._space)
        mass = q * ufl.TrialFunction(self._space) * weak.volume(body)
        near = dx.assemble_matrix(weak.compile(mass))
        outside = dx.assemble_vector(weak.compile(q * weak.skin()))
        within = V.duplicate()
        # of the largest; smaller weights are rounding
        within.array[:] = (V.array_r > 0) & (outside.array_r <= EXACT * outside.max()[1])
        to = near * within  # symmetric: of each node, its weight in the neighbours within
        gone = V.duplicate()
        gone.array[:] = (within.array_r == 0) & (to.array_r > EXACT * to.max()[1])
        scale = V.duplicate()
        scale.array[:] = gone.array_r / np.where(gone.array_r > 0, to.array_r, 1.0)
        near.diagonalScale(within, scale)
        near.axpy(1.0, _diagonal(1.0 - gone.array_r, near), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return near

    def add_to(self, K: Mat) -> Mat:
        """The stiffness K [N/m] of the bodies' shear, with that of their dilatation; collective."""
        form = K.getAttr("form")
        for C, weight in self.terms():
            weighted = C.copy()
            weighted.diagonalScale(weight)
            K.axpy(1.0, C.transposeMatMult(weighted), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        K.setAttr("form", form)
        return K

    def terms(self, T: Mat | None = None) -> Iterator[tuple[Mat, Vec]]:
        """Of each body the matrix C (nodes, dofs) [m²] and the weights λ / V_a [N/m⁵]: its stiffness is C^T λ/V C.

        Args:
            T: see `Constraints`; C is that of the free displacements then.
        """
        for body, (C, V, _) in self._bodies.items():
            weight = V.duplicate()
            weight.array[:] = self._weak.lame(body)[0] * _inverse(V)
            yield C if T is None else C.matMult(T), weight

    def mixed(self, K: Mat, T: Mat) -> Mat:
        """The stiffness T^T (K + dilatation) T, with the pressure at each node as one more unknown; collective.

        [[K, B^T], [B, -D]]: the lower rows are B q = D p with a diagonal D, and without the pressures it is that
        stiffness again. It has few entries: the stiffness couples each node with those around its neighbours.

        Args:
            K: T^T K T of the bodies' shear [N/m]; eliminated entries have only a diagonal.
            T: see `Constraints`.

        Returns:
            Symmetric, quasi-definite [N/m]: pressures are scaled to lengths. Rows of each rank: those of K, then its
            pressures.
        """
        mean = K.getDiagonal().sum() / K.getSize()[0]
        rows: list[list[Mat | None]] = [[K]]
        for C, weight in self.terms(T):
            kept = np.flatnonzero(weight.array_r)
            own = (kept + weight.getOwnershipRange()[0]).astype(PETSc.IntType)
            B = C.createSubMatrix(PETSc.IS().createGeneral(own, comm=K.comm))
            scale = B.createVecLeft()
            scale.array[:] = np.sqrt(mean * weight.array_r[kept])
            B.diagonalScale(scale)
            rows[0].append(B.transpose(PETSc.Mat()))
            rows.append([B, *[None] * (len(rows) - 1), _diagonal(np.full(len(own), -mean), B)])
        for row in rows:
            row += [None] * (len(rows) - len(row))
        return PETSc.Mat().createNest(rows, comm=K.comm).convert("aij")

    def functions(self) -> dict[str, Function]:
        """A field for the dilatation of each body [-], for `fill`."""
        return {body: dx.fem.Function(self._space) for body in self._bodies}

    def fill(self, functions: Mapping[str, Function], u: Vec) -> None:
        """Write sum θ_a φ_a of a displacement of all dofs [m] into the fields, ghosts included; collective."""
        for body, (C, _, _) in self._bodies.items():
            self._fill(functions[body], body, C * u)

    def _fill(self, function: Function, body: str, changes: Vec) -> None:
        """Write sum θ_a φ_a into a field, of V_a θ_a [m³]; collective."""
        _, V, share = self._bodies[body]
        theta = V.duplicate()
        theta.array[:] = changes.array_r * _inverse(V)
        if share is not None:
            spread = V.duplicate()
            share.multTranspose(theta, spread)
            theta = spread
        dx.fill(function, theta.array_r)

    def of_strain(self, initial: InitialStrain) -> Function | None:
        """The same averages of the dilatation of an initial strain at value 1, ghosts included; collective.

        With that at the point instead, the dilatation of the strain would push where the averages do not resist.
        None: it needs none, for it is uniform, or its body has no averages.
        """
        if initial.field is None or initial.body not in self._bodies:
            return None
        weak, share = self._weak, self._bodies[initial.body][2]
        changes = dx.assemble_vector(weak.compile(weak.initial_dilatation(initial, ufl.TestFunction(self._space))))
        found = dx.fem.Function(self._space)
        self._fill(found, initial.body, changes if share is None else share * changes)
        return found

    def at_midpoints(self, u: Vec, functions: Mapping[str, Function]) -> dict[str, Array]:
        """The fields of a displacement [m] at the midpoints of this rank's cells (cells,) [-]; collective."""
        self.fill(functions, u)
        return {body: self.in_cells(field) for body, field in functions.items()}

    def in_cells(self, field: Function) -> Array:
        """A field at the midpoints of this rank's cells (cells,)."""
        return np.asarray(field.x.array[dx.cell_dofs(self._space)].mean(axis=1))


def _diagonal(values: Array, like: Mat) -> Mat:
    """A diagonal matrix (PETSc) from its own entries, with the rows of another one; collective."""
    own = np.arange(*like.getOwnershipRange(), dtype=PETSc.IntType)
    size = like.getSizes()[0]
    found = PETSc.Mat().createAIJ((size, size), nnz=(1, 0), comm=like.comm)
    found.setValuesCSR(np.arange(len(own) + 1, dtype=PETSc.IntType), own, values)
    found.assemble()
    return found


def _inverse(V: Vec) -> Array:
    """1 / V_a (own,), zero at nodes without a dilatation."""
    volume = V.array_r
    return np.asarray(np.divide(1.0, volume, out=np.zeros_like(volume), where=volume > 0))
