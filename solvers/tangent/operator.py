"""The stiffness in contact coordinates, and multigrid of the bodies with their contact nodes held.

What contact does to them in a step are changes at the slave nodes alone, whose columns are stored. So an iteration
takes one product with K_B and one multigrid cycle, however often contact is looked at; multigrid is set up again only
where other nodes are to be held.

Coarse motions are added to it where hardly a point sticks: the sides of each contact slide on each other as rigid, and
the bodies behind them follow. Multigrid of bodies whose contact nodes are held does not see these motions; for a body
that floats they are its rigid motions.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import CLOSE, Array, Ints, inverses, products
from stickslip.geometry.mesh.ranks import of_all_ranks
from stickslip.geometry.protocols import PC, Mat, Vec
from stickslip.solvers.linear.multigrid import multigrid
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.parallel.released import return_memory
from stickslip.solvers.system.floating_modes import near_nullspace
from stickslip.solvers.system.system import System
from stickslip.solvers.tangent.coordinates import ContactCoordinates


def chebyshev(low: float, high: float, count: int) -> Iterator[tuple[float, float]]:
    """Factors of each sweep: of the last correction, and of the preconditioned residual; their sum is the next one.

    Errors are small over an interval of eigenvalues, without scalar products.

    Args:
        low, high: interval of eigenvalues of the preconditioned operator.
        count: number of sweeps.

    Source: Saad, Iterative Methods for Sparse Linear Systems, 2nd ed. (2003), algorithm 12.1.

    >>> list(chebyshev(1.0, 1.0 + 1e-9, 2))[0]
    (0.0, 0.9999999995)
    """
    middle, half = (high + low) / 2, (high - low) / 2
    rho = half / middle
    yield 0.0, 1 / middle
    for _ in range(count - 1):
        before, rho = rho, 1 / (2 * middle / half - rho)
        yield before * rho, 2 * rho / half


class Columns:
    """Columns of K = T^T K_B T at some nodes, with those of its rows that have entries there.

    Vectors over these nodes are this rank's entries (k,), of all nodes its part (owned,).

    Attributes:
        at: positions (k,) of the nodes' coordinates in this rank's part of a vector, by node.
        near: positions of the entries of K v, of a v that is zero but there, that can be other than zero, by node.
        diagonal: blocks (k / d, d, d) of K.
    """

    def __init__(self, K_B: Mat, T: Mat, at: Ints) -> None:
        """Take them from the stiffness; collective.

        Args:
            K_B: (free, free).
            T: (free, free) the coordinates; those at these nodes move no others.
            at: positions (k,) of these nodes' coordinates.
        """
        self.at, self.dim = at, K_B.block_size
        (low, high), comm = K_B.getOwnershipRange(), K_B.comm
        here = PETSc.IS().createGeneral((at + low).astype(PETSc.IntType), comm=comm)
        every = PETSc.IS().createGeneral(np.arange(low, high, dtype=PETSc.IntType), comm=comm)
        rows = K_B.createSubMatrix(here, every).matMult(T)  # K_B is symmetric: its rows are found sooner than columns
        columns = T.createSubMatrix(here, here).transposeMatMult(rows).transpose(PETSc.Mat())
        nodes = np.unique(np.flatnonzero(np.diff(columns.getValuesCSR()[0])) // self.dim)
        self.near = (nodes[:, None] * self.dim + np.arange(self.dim)).ravel()
        near = PETSc.IS().createGeneral((self.near + low).astype(PETSc.IntType), comm=comm)
        self._columns = columns.createSubMatrix(near, None)
        self._block = columns.createSubMatrix(here, None)
        columns.destroy()
        self.diagonal = self._diagonal()
        self._motion, self._there = self._block.createVecs()
        self._near = self._columns.createVecLeft()

    def product(self, x: Array) -> Array:
        """K v at `near`, of a v that is x (k,) at these nodes, and zero elsewhere."""
        self._motion.array[:] = x
        self._columns.mult(self._motion, self._near)
        return np.array(self._near.array_r)

    def block(self, x: Array) -> Array:
        """The same at these nodes alone (k,)."""
        self._motion.array[:] = x
        self._block.mult(self._motion, self._there)
        return np.array(self._there.array_r)

    def whole(self, x: Array, count: int) -> Array:
        """The vector (count,) that is x (k,) at these nodes, and zero elsewhere."""
        found = np.zeros(count)
        found[self.at] = x
        return found

    def move(self, x: Array, v: Array, K_v: Array) -> None:
        """Add a motion x (k,) of these nodes to v (owned,), and what it does to K v; in place."""
        v[self.at] += x
        K_v[self.near] += self.product(x)

    def largest_eigenvalue(self) -> float:
        """Of these columns' block, times the inverses of the nodes' own blocks: about it, not above it; collective."""
        comm, inverse, value = self._block.comm.tompi4py(), inverses(self.diagonal), 0.0
        x = np.random.default_rng(comm.rank).normal(size=len(self.at))
        for _ in range(10):  # which miss it by less than a tenth in the tests
            y = self.block(x)
            above, below = comm.allreduce(np.array([x @ y, x @ products(self.diagonal, x)]))
            value = above / below if below else 1.0
            x = products(inverse, y) / value
        return float(value)

    def _diagonal(self) -> Array:
        pointer, columns, values = self._block.getValuesCSR()
        low, dim = self._block.getOwnershipRange()[0], self.dim
        row = np.repeat(np.arange(len(pointer) - 1), np.diff(pointer))
        own = (columns - low) // dim == row // dim
        found = np.zeros((len(self.at) // dim, dim, dim))
        found[row[own] // dim, row[own] % dim, (columns[own] - low) % dim] = values[own]
        return found


PREFIX = "tangent_"  # of PETSc's options


class TangentOperator:
    """K = T^T K_B T; vectors are this rank's part (owned,), those at slave nodes its (m d,) entries there.

    Attributes:
        count: number of entries of this rank's part.
        at: positions (m d,) of this rank's entries at slave nodes in its part of a vector.
        slaves: columns of K there.
        around: the same of slave nodes with their neighbours in the same body.
        here: positions (m d,) of the entries at slave nodes among those of `around`.
        highest: what no eigenvalue of their block, times the inverses of the nodes' own blocks, should pass.
        held: which of these entries (m d,) multigrid holds.
        sliding: whether it holds a part of the motions of a node only.
    """

    def __init__(
        self, system: System, coordinates: ContactCoordinates, holding: tuple[ContactCoordinates, Ints] | None = None
    ) -> None:
        """Set up multigrid; collective.

        Args:
            holding: arguments of `hold`; None: all coordinates are held.
        """
        self.dim: int = system.mesh.dim
        self.K_B, self.T, self._inverse = system.K_B, coordinates.T, coordinates.inverse
        self.counters: Counters = system.counters
        self.comm = self.K_B.comm.tompi4py()
        low, high = self.K_B.getOwnershipRange()
        self.count: int = high - low
        self.at = (coordinates.blocks - low).ravel()
        self._slaves = PETSc.IS().createGeneral((self.at + low).astype(PETSc.IntType), comm=self.K_B.comm)
        self._every = PETSc.IS().createGeneral(np.arange(low, high, dtype=PETSc.IntType), comm=self.K_B.comm)
        self.slaves = Columns(self.K_B, self.T, self.at)
        self.around = Columns(self.K_B, self.T, self._with_neighbours())
        self.here = np.searchsorted(self.around.at, self.at)
        self.highest = 1.2 * self.around.largest_eigenvalue()  # what power iteration and contact add in all tests
        self._system = system
        self._in, self._out = self.K_B.createVecRight(), self.K_B.createVecRight()
        self._more = self.K_B.createVecRight()
        self._multigrid = PETSc.PC()  # none yet
        self.hold(*(holding or (coordinates, coordinates.blocks.ravel())))

    def product(self, v: Array) -> Array:
        """K v."""
        self._in.array[:] = v
        self.T.mult(self._in, self._out)
        self.K_B.mult(self._out, self._more)
        self.T.multTranspose(self._more, self._out)
        return np.array(self._out.array_r)

    def hold(self, coordinates: ContactCoordinates, numbers: Ints) -> None:
        """Set up multigrid with these coordinates held, and with all others as they are; collective.

        Args:
            coordinates: of the slave nodes that are held, or a part of their coordinates, alone. They are taken over:
                the signs of their T may change.
            numbers: of the coordinates that are held.
        """
        self.release()  # there is memory for one
        low = self.K_B.getOwnershipRange()[0]
        self.held = np.isin(self.at + low, numbers)
        by_node = self.held.reshape(-1, self.dim)
        every, whole = bool(by_node.all()), bool((by_node.all(axis=1) == by_node.any(axis=1)).all())
        every, whole = (all(each) for each in zip(*self.comm.allgather((every, whole)), strict=True))
        self._plain, self.sliding = every, not whole
        # two bodies that are held in one motion alone would take twice the iterations with whole nodes
        self._nodal = self._system.mesh.simplicial and (whole or coordinates.alone)
        self._change: Mat | None = None if every or (coordinates.alone and whole) else coordinates.T
        if self._change is not None and self.sliding:  # what multigrid compares points the same way
            signs = self.K_B.createVecRight()
            signs.array[:] = 1.0
            signs.array[coordinates.blocks - low] = coordinates.signs
            self._change.diagonalScale(R=signs)
        self._basis = self.T if every and not coordinates.alone else self._change  # of multigrid's matrix
        self._multigrid = self._set_up()

    def release(self) -> None:
        """Free the memory of multigrid; the next cycle sets it up again; collective."""
        if self._multigrid:
            self._multigrid.destroy()
            return_memory(self.comm)  # its matrix

    def _set_up(self) -> PC:
        low = self.K_B.getOwnershipRange()[0]
        held = (self.at[self.held] + low).astype(PETSc.IntType)

        def motions() -> Array:
            found = near_nullspace(self._system)
            found[held - low] = 0.0
            return found

        self.counters.factorisations += 1
        with (
            self.counters.clock.part("tangent"),
            self._without(held) if self._basis is None else self._changed(self._basis, held) as matrix,
        ):
            return multigrid(matrix, self._nodal, motions, PREFIX, changing=True)

    def cycle(self, r: Array) -> Array:
        """A multigrid cycle for K v = r with v = 0 where nodes are held."""
        self._in.array[:] = r
        self._in.array[self.at[self.held]] = 0.0
        self.counters.linear_iterations += 1
        if not self._multigrid:
            self._multigrid = self._set_up()
        if self._plain:
            self._multigrid.apply(self._in, self._out)
        else:  # from these coordinates by way of the displacements
            self._inverse.multTranspose(self._in, self._more)
            if self._change is not None:
                self._change.multTranspose(self._more, self._in)
                self._multigrid.apply(self._in, self._out)
                self._change.mult(self._out, self._more)
            else:
                self._multigrid.apply(self._more, self._out)
                self._more.array[:] = self._out.array_r
            self._inverse.mult(self._more, self._out)
        found = np.array(self._out.array_r)
        found[self.at[self.held]] = 0.0
        return found

    def guess(self, f: Vec) -> Vec:
        """The best multiple of a multigrid cycle for the displacement under forces f over the free displacements."""
        r = self.forces(f)
        z = self.cycle(r)
        z[self.at] = r[self.at] / np.einsum("mii->mi", self.slaves.diagonal).ravel()
        energy = self.dot(z, self.product(z))
        return self.displacement(z * (self.dot(z, r) / energy if energy else 0.0))

    def forces(self, f: Vec) -> Array:
        """Forces T^T f on the coordinates, of forces f over the free displacements [N]."""
        self.T.multTranspose(f, self._out)
        return np.array(self._out.array_r)

    def displacement(self, v: Array, found: Vec | None = None) -> Vec:
        """u = T v over the free displacements [m], in `found` if it is given."""
        self._in.array[:] = v
        u = self._in.duplicate() if found is None else found
        self.T.mult(self._in, u)
        return u

    def coordinates(self, u: Vec) -> Array:
        """v = T^-1 u of free displacements u [m]."""
        self._inverse.mult(u, self._out)
        return np.array(self._out.array_r)

    def coordinates_of(self, u: Array) -> Array:
        """The same of this rank's part (owned,)."""
        self._in.array[:] = u
        return self.coordinates(self._in)

    def dot(self, a: Array, b: Array) -> float:
        """Scalar product over all ranks; collective."""
        return float(self.comm.allreduce(a @ b))

    def _with_neighbours(self) -> Ints:
        """Positions (k,) of the entries at slave nodes, and at those that K_B couples to them and that no slave node
        moves with; collective."""
        movers = self.T.createSubMatrix(self._slaves, self._every).transpose(PETSc.Mat())
        masters = np.flatnonzero(np.diff(movers.getValuesCSR()[0])) // self.dim
        found = np.union1d(np.setdiff1d(self.slaves.near // self.dim, masters), self.at // self.dim)
        return (found[:, None] * self.dim + np.arange(self.dim)).ravel()

    @contextmanager
    def _without(self, held: Ints) -> Iterator[Mat]:
        """K_B without these rows and columns, whose numbers increase; a copy would take the time of some products."""
        K, low, at = self.K_B, self.K_B.getOwnershipRange()[0], PETSc.IS().createGeneral(held, comm=self.K_B.comm)
        rows, columns = K.createSubMatrix(at, self._every), K.createSubMatrix(self._every, at)
        try:
            yield _cleared(K, held)
        finally:
            pointer, column, values = rows.getValuesCSR()
            every = np.searchsorted(held - low, np.arange(len(self._in.array_r) + 1))
            K.setValuesCSR(pointer[every], column, values)
            K.assemble()
            pointer, column, values = columns.getValuesCSR()
            K.setValuesCSR(pointer, of_all_ranks(self.comm, held)[column], values)
            K.assemble()

    @contextmanager
    def _changed(self, T: Mat, held: Ints) -> Iterator[Mat]:
        """T^T K_B T of a change T of the coordinates at slave nodes, without held rows and columns.

        With F = T - 1, which has rows at slave nodes alone, it is K_B + K_B F + (K_B F)^T + F^T K_B F: for two bodies
        a quarter of the time of the triple product, which multiplies all of K_B.
        """
        low = self.K_B.getOwnershipRange()[0]
        F, C = T.createSubMatrix(self._slaves, self._every), self.K_B.createSubMatrix(self._every, self._slaves)
        count = len(self.at)
        csr = (np.arange(count + 1, dtype=PETSc.IntType), (self.at + low).astype(PETSc.IntType), np.ones(count))
        F.axpy(-1.0, PETSc.Mat().createAIJ(F.getSizes(), csr=csr, comm=F.comm))
        change, other = C.matMult(F), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        change.axpy(1.0, change.transpose(PETSc.Mat()), other)
        change.axpy(1.0, F.transposeMatMult(C.createSubMatrix(self._slaves, None).matMult(F)), other)
        matrix = self.K_B.copy()
        matrix.axpy(1.0, change, other)
        try:
            yield _cleared(matrix, held)
        finally:
            matrix.destroy()


def _cleared(K: Mat, held: Ints) -> Mat:
    """K with these rows and columns zero but for the diagonal, in place."""
    K.zeroRowsColumns(held, diag=float(K.getDiagonal().sum() / K.getSize()[0]))
    return K


class CoarseMotions:
    """The k motions D (k, owned), orthonormal at the slave nodes, and K D."""

    def __init__(self, system: System, operator: TangentOperator, pressing: Ints) -> None:
        """Extend the motions of the sides into the bodies; collective.

        Args:
            pressing: numbers of the coordinates that rigid pressures hold.
        """
        self.operator = operator
        self.slides = ~np.isin(operator.at + operator.K_B.getOwnershipRange()[0], pressing)
        found = [self._extended(side) for side in self._sides(system)]
        self.D = np.array([d for d, _ in found])
        self.K_D = np.array([K_d for _, K_d in found])

    def _sides(self, system: System) -> list[Array]:
        """Relative rigid motions (m d,) at this rank's slave nodes, as far as they slide."""
        operator, motions = self.operator, near_nullspace(system)
        low, high = operator.K_B.getOwnershipRange()
        found = []
        for c in system.contacts:
            numbers = np.unique(system.constraints.numbers(c.surface.nodes).ravel())
            own = numbers[(numbers >= low) & (numbers < high)] - low
            of_side = np.zeros_like(motions)
            of_side[own] = motions[own]
            jumps = np.array([operator.coordinates_of(column)[operator.at] * self.slides for column in of_side.T])
            sizes, mixed = np.linalg.eigh(operator.comm.allreduce(jumps @ jumps.T))
            keep = sizes > CLOSE * sizes.max(initial=0.0)  # relative; motions that differ by less are one
            found += list((mixed[:, keep] / np.sqrt(sizes[keep])).T @ jumps)
        return found

    def _extended(self, side: Array) -> tuple[Array, Array]:
        """The motion of a side with that of the bodies behind it, and K times it: a few conjugate gradients."""
        operator = self.operator
        x, K_x, d, K_d = np.zeros((4, operator.count))
        operator.slaves.move(side, x, K_x)
        before = 0.0
        for _ in range(3):  # of conjugate gradients
            z = operator.cycle(-K_x)
            energy = -operator.dot(K_x, z)
            if not energy > 0:
                break
            d = z + (energy / before if before else 0.0) * d
            K_d, before = operator.product(d), energy
            step = energy / operator.dot(d, K_d)
            x, K_x = x + step * d, K_x + step * K_d
        return x, K_x
