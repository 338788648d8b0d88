"""Factorise K_B without its contact dofs (MUMPS), and form its dense Schur complement on them.

On one rank the Schur complement S = K_cc - K_ci K_ii^-1 K_ic comes out of the MUMPS factorisation itself, for each part
of the bodies that shares no node with the rest by itself; on several ranks K_ii is factorised and a block of right-hand
sides gives S.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from stickslip.geometry.arrays import LAST_DIGITS, Array, Ints
from stickslip.geometry.errors import MachineError, SceneError
from stickslip.geometry.protocols import KSP, Mat, Vec
from stickslip.solvers.linear.block_diagonal import BlockDiagonal, joined
from stickslip.solvers.linear.petsc_solver import call, petsc_library
from stickslip.solvers.parallel.counters import Clock, Counters
from stickslip.solvers.parallel.replicated import Replicated

BLOCK = 128  # right-hand sides solved together
WORKSPACE = (20, 100, 400)  # percent of memory that MUMPS adds to its own estimate, tried one after the other
TOO_LITTLE = {-8, -9}  # INFOG(1): that was not enough
NO_MEMORY = TOO_LITTLE | {-5, -7, -13, -19, -22}
SINGULAR = {-10, -40}  # a pivot is zero, or negative
LOW_RANK = {35: 2, 36: 1}  # blocks of large fronts as products of low rank (BLR), compressed before they update others
# Ordering; the one MUMPS chooses by itself cost 2.7 times the flops on two ranks. Debian builds MUMPS without METIS: it
# takes PORD, but minimum degree where it forms S, in 3D for up to five times the flops. Bodies cut by hand into pieces,
# for a third of these, took as long.
METIS = 5


class FactorisedVolume:
    """K_B (free dofs), factorised; `S` (c, c) [N/m] is its Schur complement on the contact dofs."""

    def __init__(
        self,
        K: Mat,
        contact_dofs: Ints,
        counters: Counters,
        several: bool = False,
        low_rank: bool = False,
        mixed: Mat | None = None,
    ) -> None:
        """
        Args:
            K: K_B [N/m], symmetric, singular only by rigid modes that are not zero on the contact dofs; for products
                alone where there is a mixed one.
            contact_dofs: global numbers (c,), increasing, the same on all ranks.
            counters: counts factorisations and volume solves.
            several: whether parts that share no node may be looked for.
            low_rank: whether MUMPS compresses blocks of its fronts. In 2D that saves three tenths of the time on 1e6
                dofs, nothing on 7e4 and less; in 3D it costs a tenth more.
            mixed: to be factorised in place of K, see `MeanDilatation.mixed`: 59 s become 10 s, 6.7 s become 2.4 s (3D,
                46 875 dofs of order 2, 14 739 of order 1), S is the same to 1e-13.

        Raises:
            MachineError: the factorisation failed.
        """
        self.K = K
        self.counters = counters
        self.contact = Replicated(K.createVecRight(), contact_dofs)
        self.counters.schur_size = len(contact_dofs)
        self._factorised = A = K if mixed is None else mixed
        count, displacements = len(contact_dofs), K.getLocalSize()[0]
        contact = self.contact if mixed is None else Replicated(A.createVecRight(), _renumbered(contact_dofs, K, A))
        self._added = _Added.none(self.contact, K.createVecRight())
        self._number = np.zeros(0, np.int64)  # of the part that each dof is in; one rank's
        if K.comm.size > 1 or not several:
            pressures = A.getSize()[0] - K.getSize()[0]
            self._parts = [_Factor(A, contact, low_rank, counters.clock, pressures=pressures)]
            self.S = BlockDiagonal.whole(self._parts[0].S)
        else:
            self._number = number = _connected(A)
            self._parts = [
                _part(A, np.flatnonzero(number == k), contact.rows, low_rank, counters.clock, displacements)
                for k in range(number.max(initial=-1) + 1)
            ]
            belongs = number[contact.rows]
            self.S = joined(count, [(np.flatnonzero(belongs == k), part.S) for k, part in enumerate(self._parts)])
        self.counters.factorisations += 1

    def widened(self, dofs: Ints) -> FactorisedVolume:
        """The same bodies condensed on further dofs too, by the same factor: a volume solve each; collective.

        With the columns X = K_ii^-1 E of new dofs n, A = (E^T X)^-1 is the stiffness of these with the old ones held,
        and P = X^T K_ic what they move when the old ones do: S' = [[S + P^T A P, P^T A], [A P, A]].

        Args:
            dofs: global numbers; those that are contact dofs already cost nothing.
        """
        before, other = self._added, copy(self)
        new = np.setdiff1d(dofs, self.contact.rows)
        if not len(new):
            return self
        rows = np.concatenate([before.dofs.rows, new])
        known, like = len(before.dofs.rows), self.K.createVecRight()
        every, own = Replicated(like, rows), before.old
        F, P = np.zeros((len(rows), len(rows))), np.zeros((len(rows), len(own.rows)))
        F[:known, :known], P[:known] = before.F, before.P
        for k in range(known, len(rows)):
            unit = like.duplicate()
            every.write(unit, np.eye(1, len(rows), k)[0])
            moved = self._by_first_factor(unit)
            F[:, k], P[k] = every.read(moved), own.read(self.K * moved)
            F[k, :known] = F[:known, k]
        F = (F + F.T) / 2
        self.counters.added_dofs += len(new)
        number = self._number[rows] if len(self._number) else np.zeros(len(rows), np.int64)
        of_old = self._number[own.rows] if len(self._number) else np.zeros(len(own.rows), np.int64)
        A, blocks = np.zeros_like(F), list[tuple[Ints, Array]]()
        order = np.argsort(np.concatenate([own.rows, rows]))
        place = np.argsort(order)
        for k, part in enumerate(self._parts):
            n, c = np.flatnonzero(number == k), np.flatnonzero(of_old == k)
            if len(n):
                A[np.ix_(n, n)] = np.linalg.inv(F[np.ix_(n, n)])
            stiff, moves = (A[np.ix_(n, n)] + A[np.ix_(n, n)].T) / 2, P[np.ix_(n, c)]
            held = stiff @ moves
            whole, at = (
                np.block([[part.S + moves.T @ held, held.T], [held, stiff]]),
                place[np.concatenate([c, len(own.rows) + n])],
            )
            by = np.argsort(at)
            blocks.append((at[by], whole[np.ix_(by, by)]))
        other._added = _Added(old=own, dofs=every, F=F, P=P, A=(A + A.T) / 2)
        other.contact = Replicated(like, np.concatenate([own.rows, rows])[order])
        other.S = joined(len(order), blocks)
        self.counters.schur_size = len(order)
        return other

    def counting(self, counters: Counters) -> FactorisedVolume:
        """The same factor for another system, whose counters count its solves; it was factorised before."""
        other = copy(self)
        other.counters = counters
        counters.schur_size = len(self.contact.rows)
        return other

    def condense(self, f: Vec) -> Array:
        """Condense forces [N] onto the contact dofs: f_c - K_ci K_ii^-1 f_i (c,); one volume solve; collective."""
        return self.condensed([f])[0]

    def condensed(self, forces: Sequence[Vec]) -> list[Array]:
        """The same of several forces, in one volume solve for all; collective."""
        if not len(self.contact.rows):
            return [np.zeros(0) for _ in forces]
        pairs = zip(forces, self._interiors(forces), strict=True)
        return [np.asarray(self.contact.read(f) - self.contact.read(self.K * q)) for f, q in pairs]

    def expand(self, f: Vec, q_c: Array) -> Vec:
        """Displacement [m] of all free dofs from that of the contact dofs q_c (c,): K_ii q_i = f_i - K_ic q_c.

        One volume solve; collective.
        """
        return self.expanded([(f, q_c)])[0]

    def expanded(self, given: Sequence[tuple[Vec, Array]]) -> list[Vec]:
        """The same of several forces and displacements, in one volume solve for all; collective."""
        found = [f.duplicate() for f, _ in given]
        for q, (_, q_c) in zip(found, given, strict=True):
            self.contact.write(q, q_c)
        inside = self._interiors([f - self.K * q for q, (f, _) in zip(found, given, strict=True)])
        return [q + more for q, more in zip(found, inside, strict=True)]

    def release(self) -> None:
        """Nothing to free before the end: PETSc's objects go with this one."""

    def snapshot(self) -> None:
        """A factor learns nothing from solve to solve; see `restore`."""

    def restore(self, snapshot: None) -> None:
        """Nothing to take up."""

    def _interiors(self, forces: Sequence[Vec]) -> list[Vec]:
        """`_interior` of each; solved together they take a seventh of the time."""
        mixed = self._factorised is not self.K
        if len(forces) < 2 or mixed or self.K.comm.size > 1 or len(self._added.dofs.rows):
            return [self._interior(f) for f in forces]
        given, found = np.column_stack([f.array_r for f in forces]), [f.duplicate() for f in forces]
        for part in self._parts:
            given[part.rows] = part.interiors(given[part.rows])
        for q, column in zip(found, given.T, strict=True):
            q.array[:] = column
        self.counters.volume_solves += len(forces)
        return found

    def _interior(self, f: Vec) -> Vec:
        """K_ii^-1 f_i, zero at the contact dofs; those that were added are held by forces on them."""
        q, added = self._by_first_factor(f), self._added.dofs
        if len(added.rows):
            holding = f.duplicate()
            added.write(holding, -self._added.A @ added.read(q))
            q += self._by_first_factor(holding)
            added.write(q, np.zeros(len(added.rows)))
        return q

    def _by_first_factor(self, f: Vec) -> Vec:
        """The same with the contact dofs alone that there were when the bodies were factorised."""
        q = self._by_factor(f)
        if self._factorised is not self.K:  # of 1 - 2 nu = 1e-5 three digits more
            q += self._by_factor(f - self.K * q)
        self.counters.volume_solves += 1
        return q

    def _by_factor(self, f: Vec) -> Vec:
        q, own = f.duplicate(), f.getLocalSize()
        given = np.zeros(self._factorised.getLocalSize()[0])  # nothing acts on pressures
        given[:own], found = f.array_r, np.zeros_like(given)
        for part in self._parts:
            found[part.rows] = part.interior(given[part.rows])
        q.array[:] = found[:own]
        return q


@dataclass(frozen=True, kw_only=True)
class _Added:
    """Contact dofs that were added to those of the factorisation, see `FactorisedVolume.widened`."""

    old: Replicated  # those of the factorisation
    dofs: Replicated  # the added ones (n,)
    F: Array  # (n, n) flexibility of these with the old ones held [m/N]
    P: Array  # (n, c) minus their motion by that of the old ones
    A: Array  # (n, n) inverse of F

    @staticmethod
    def none(old: Replicated, like: Vec) -> _Added:
        none = np.zeros((0, 0))
        return _Added(
            old=old, dofs=Replicated(like, np.zeros(0, np.int64)), F=none, P=np.zeros((0, len(old.rows))), A=none
        )


def _connected(K: Mat) -> Ints:
    """Number (dofs,) of the part that each dof of K is in; parts share no entry, prescribed dofs are in the largest."""
    first, columns, values = K.getValuesCSR()
    graph = sparse.csr_matrix((values != 0, columns, first), shape=K.size)
    graph.eliminate_zeros()  # rows of prescribed nodes hold some
    number = connected_components(graph, directed=False)[1]
    sizes = np.bincount(number)
    _, part = np.unique(np.where(sizes[number] > 1, number, np.argmax(sizes)), return_inverse=True)
    return np.asarray(part)


def _renumbered(dofs: Ints, K: Mat, mixed: Mat) -> Ints:
    """Numbers (c,) in the mixed matrix of dofs of K: pressures of earlier ranks come before them."""
    begins = np.array(K.getOwnershipRanges())
    rank = np.searchsorted(begins, dofs, side="right") - 1
    return np.asarray(dofs + (np.array(mixed.getOwnershipRanges()) - begins)[rank])


def _part(K: Mat, rows: Ints, contact_dofs: Ints, low_rank: bool, clock: Clock, displacements: int) -> _Factor:
    """The factor of the rows and columns `rows` (n,) of K, on one rank; from `displacements` on they are pressures."""
    index = PETSc.IS().createGeneral(rows.astype(PETSc.IntType), comm=K.comm)
    own = K.createSubMatrix(index, index)
    at = np.searchsorted(rows, np.intersect1d(rows, contact_dofs))
    pressures = int(np.count_nonzero(rows >= displacements))
    return _Factor(own, Replicated(own.createVecRight(), at), low_rank, clock, rows, pressures)


class _Factor:
    """Bodies without their contact dofs, factorised, and their Schur complement `S` (c, c) [N/m] on these."""

    S: Array
    _unit = 1.0  # [N/m] of the factorised matrix, a power of two

    def __init__(
        self,
        K: Mat,
        contact: Replicated,
        low_rank: bool,
        clock: Clock,
        rows: Ints | slice = slice(None),
        pressures: int = 0,
    ) -> None:
        """
        Args:
            K: stiffness of these bodies alone, perhaps mixed.
            contact: of its contact dofs.
            low_rank: see `FactorisedVolume`.
            clock: of the run.
            rows: this rank's dofs that they are, of all.
            pressures: number of unknowns that are pressures, on all ranks.

        Raises:
            MachineError: the factorisation failed.
        """
        self.K, self.contact, self.low_rank, self.rows, self.pressures = K, contact, low_rank, rows, pressures
        self._clock = clock
        self._in, self._out = K.createVecs()
        if K.comm.size == 1 and len(contact.rows) < K.size[0]:  # MUMPS refuses a Schur block without an interior
            self._factor_with_schur(contact.rows)
        else:
            self._factor_interior(contact.rows)

    def interior(self, f: Array) -> Array:
        """K_ii^-1 f_i of this rank's forces f (owned,), zero at the contact dofs; collective."""
        self._in.array[:] = f
        self._in.array[self.contact.local] = 0.0
        self._ksp.solve(self._in, self._out)
        self._out.scale(1 / self._unit)
        self._check()
        self._out.array[self.contact.local] = 0.0
        return np.array(self._out.array_r)

    def interiors(self, forces: Array) -> Array:
        """The same of several forces (n, k), on one rank."""
        given = np.asfortranarray(forces)
        given[self.contact.local] = 0.0
        right = PETSc.Mat().createDense(given.shape, array=given, comm=self.K.comm)
        found = right.duplicate()
        self._ksp.getPC().getFactorMatrix().matSolve(right, found)
        self._check()
        moved = found.getDenseArray() / self._unit
        moved[self.contact.local] = 0.0
        right.destroy()
        found.destroy()
        return np.asarray(moved)

    def _solver(self, K: Mat) -> KSP:
        K.setOption(PETSc.Mat.Option.SYMMETRIC if self.pressures else PETSc.Mat.Option.SPD, True)
        ksp = PETSc.KSP().create(K.comm)
        ksp.setOptionsPrefix("volume_")
        ksp.setOperators(K)
        ksp.setType("preonly")
        pc = ksp.getPC()
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        pc.getFactorMatrix().setMumpsIcntl(7, METIS)
        if self.pressures:
            pc.getFactorMatrix().setMumpsIcntl(13, 1)  # no ScaLAPACK, which does not count negative pivots
        return ksp

    def _factorise(self, K: Mat, schur: Ints) -> Mat:
        """MUMPS' factor of K, with a Schur complement on the numbers `schur` (c,) if there are any."""
        for percent in WORKSPACE:
            self._ksp = self._solver(K)
            factor = self._ksp.getPC().getFactorMatrix()
            factor.setMumpsIcntl(14, percent)
            if self.low_rank:
                for number, value in LOW_RANK.items():
                    factor.setMumpsIcntl(number, value)
                # CNTL(7), relative to the front: so S and solutions differ from those of full blocks by rounding
                factor.setMumpsCntl(7, LAST_DIGITS)
            if len(schur):
                index = PETSc.IS().createGeneral(np.asarray(schur, PETSc.IntType), comm=PETSc.COMM_SELF)
                call(petsc_library().MatFactorSetSchurIS, factor.handle, index.handle)
            try:
                self._ksp.setUp()
            except PETSc.Error as error:
                raise MachineError(f"the factorisation of the bodies failed: PETSc error {error.ierr}") from None
            if factor.getMumpsInfog(1) not in TOO_LITTLE:
                break
        self._check()
        return factor

    def _check(self) -> None:
        factor = self._ksp.getPC().getFactorMatrix()
        info = factor.getMumpsInfog(1)
        # of a mixed matrix each pressure, and nothing else, has a negative pivot
        # INFOG(12): number of negative pivots
        if info in SINGULAR or (info >= 0 and self.pressures and factor.getMumpsInfog(12) != self.pressures):
            raise SceneError(
                "the stiffness of the bodies is singular: part of a body moves without being strained; check for cells "
                "that hang together at a point or along an edge only, and for E that differ by many orders"
            )
        if info in NO_MEMORY:
            raise MachineError(f"too little memory to factorise the bodies (MUMPS: {info}); use a larger mesh_size")
        if info < 0:
            raise MachineError(f"the factorisation of the bodies failed (MUMPS: {info}); try another solver.surface")

    def _factor_with_schur(self, contact_dofs: Ints) -> None:
        largest = self.K.norm(PETSc.NormType.INFINITY)
        self._unit = 2.0 ** np.floor(np.log2(largest)) if largest > 0 else 1.0
        self.K.scale(1 / self._unit)  # MUMPS' Schur complement is wrong where all entries are smaller than 1e-15
        try:
            factor = self._factorise(self.K, contact_dofs)
            self._ksp.getPC().setReusePreconditioner(True)
        finally:
            self.K.scale(self._unit)  # exact: a power of two
        if not len(contact_dofs):
            self.S = np.zeros((0, 0))
            return
        self.S = self._unit * _schur_complement(petsc_library(), factor, len(contact_dofs))
        factor.setMumpsIcntl(26, 0)  # from here on, solve with the interior block alone

    def _factor_interior(self, contact_dofs: Ints) -> None:
        self._unit = 1.0
        own = self.contact.rows[self.contact.mine]
        rows = PETSc.IS().createGeneral(own, comm=self.K.comm)
        interior = self.K.copy()
        interior.zeroRowsColumns(rows, diag=1.0)
        factor = self._factorise(interior, contact_dofs[:0])
        count = len(contact_dofs)
        self.S = np.zeros((count, count))
        low, high = self.K.getOwnershipRange()
        every = PETSc.IS().createStride(high - low, first=low, step=1, comm=self.K.comm)
        for first in self._clock.counted(range(0, count, BLOCK)):
            block = np.arange(first, min(first + BLOCK, count))
            mine = block[(self.contact.rows[block] >= low) & (self.contact.rows[block] < high)]
            columns = PETSc.IS().createGeneral(self.contact.rows[mine], comm=self.K.comm)
            K_ic = self.K.createSubMatrix(every, columns).convert("dense")
            direct = K_ic.getDenseArray()[self.contact.local].copy()  # my rows of K_cc
            K_ic.getDenseArray()[self.contact.local] = 0.0
            K_ic.assemble()
            X = K_ic.duplicate()
            factor.matSolve(K_ic, X)
            product = self.K.matMult(X)  # has a name, because its array does not keep it alive
            self.S[np.ix_(self.contact.mine, block)] = direct - product.getDenseArray()[self.contact.local]
            for matrix in (K_ic, X, product):
                matrix.destroy()
        self.S = self.K.comm.tompi4py().allreduce(self.S)
        self.S = (self.S + self.S.T) / 2


def _schur_complement(petsc: ctypes.CDLL, factor: Mat, count: int) -> Array:
    """The Schur complement (c, c) that MUMPS formed with its factor, c = `count`."""
    matrix, status = ctypes.c_void_p(), ctypes.c_int()
    data = ctypes.POINTER(ctypes.c_double)()
    code = petsc.MatFactorCreateSchurComplement(
        ctypes.c_void_p(factor.handle), ctypes.byref(matrix), ctypes.byref(status)
    )
    code = code or petsc.MatDenseGetArray(matrix, ctypes.byref(data))
    if code:
        raise MachineError(f"PETSc error {code} while the Schur complement was read")
    S = np.ctypeslib.as_array(data, (count * count,)).reshape(count, count).T.copy()
    petsc.MatDenseRestoreArray(matrix, ctypes.byref(data))
    petsc.MatDestroy(ctypes.byref(matrix))
    if not np.triu(S, 1).any():  # symmetric storage: only one triangle is filled
        return np.asarray(S + np.tril(S, -1).T)
    if not np.tril(S, -1).any():
        return np.asarray(S + np.triu(S, 1).T)
    return S
