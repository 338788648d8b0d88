"""From the assembled system to the Delassus operator, condensed or matrix-free: rows, weights and rigid modes.

Each motion by which a force drives an obstacle is one more contact dof, without stiffness: contact alone holds it, as
it holds a floating body.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import Literal, cast, overload

import numpy as np
from scipy import sparse
from scipy.linalg import block_diag

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.protocols import Mat, Sparse, Vec
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.flexibility import DelassusOperator, Load, T
from stickslip.solvers.interface.matrix_free import IterativeVolume, MatrixFreeSurface
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.linear.multigrid import multigrid
from stickslip.solvers.linear.petsc_solver import InnerSolver, PetscOptions
from stickslip.solvers.parallel.replicated import Replicated, on_all_ranks
from stickslip.solvers.parallel.serialise import Plain
from stickslip.solvers.system.floating_modes import FloatingMotions, near_nullspace
from stickslip.solvers.system.system import System

PREFIX = "block_fieldsplit_u_"  # of PETSc's options: that of the split u of the block system


class SparseVolume:
    """The bodies as the sparse matrix K_B, uncondensed, and its inner solver: a part of block systems.

    Nothing is factorised before the first solve, so that a method can first say how its inner solves are done. A
    floating body lies on springs at its contact dofs, for the scales of a step only.
    """

    def __init__(self, system: System) -> None:
        """Take K_B over; collective."""
        self.counters, self.K = system.counters, system.K_B
        self.contact = Replicated(self.K.createVecRight(), system.interface.dofs)
        self.floating = FloatingMotions(system, self.contact, system.interface.rigid_modes)
        self.iterative = False  # inner solves by conjugate gradients with multigrid; set before the first solve
        self.options: PetscOptions | None = None  # of the user; likewise
        self._multigrid = partial(
            multigrid, nodal=system.mesh.simplicial, motions=partial(near_nullspace, system), prefix=PREFIX
        )

    @cached_property
    def solver(self) -> InnerSolver:
        """Of K_B, or of floating bodies on springs; set up at the first access."""
        return self.inner_solver(self._held)

    def inner_solver(self, V: Mat) -> InnerSolver:
        """Of K_B, or of a matrix of its kind; collective."""
        cycles = self._multigrid if self.iterative else None
        return InnerSolver(V, PREFIX, self.counters, multigrid=cycles, options=self.options)

    @cached_property
    def _held(self) -> Mat:
        if not self.floating.R.shape[1]:
            return self.K
        springs, held = self.K.createVecRight(), self.K.copy()
        springs.array[self.contact.local] = self.K.getDiagonal().array[self.contact.local]
        held.setDiagonal(held.getDiagonal() + springs)
        return held

    def release(self) -> None:
        """Nothing to free before the end: PETSc's objects go with this one."""

    def snapshot(self) -> None:
        """Nothing is learnt from solve to solve; see `restore`."""

    def restore(self, snapshot: None) -> None:
        """Nothing to take up."""


class SparseSurface(DelassusOperator):
    """The Delassus operator by solves with K_B; `q` is the displacement that the last solve left."""

    def __init__(self, volume: SparseVolume, *, N: Sparse, W: Array, R: Array, normal_rows: int, driven: int = 0):
        """See `DelassusOperator`."""
        super().__init__(N=N, W=W, R=R, normal_rows=normal_rows, driven=driven, counters=volume.counters)
        self.volume = volume
        self.rho = 1.0
        self.q: Vec = volume.K.createVecRight()

    @property
    def exact(self) -> bool:  # type: ignore[override]
        return not self.volume.iterative

    def load(self, f_q: Vec, driving: Array, error: float = 0.0) -> Load:
        resultant = np.concatenate([self.volume.floating.resultant(f_q.array_r), driving])
        free = f_q.duplicate()
        self.volume.solver.solve(f_q, free)
        return Load(
            f_q=f_q, driving=driving, f_c=self.R @ resultant, resultant=resultant, free=self.volume.contact.read(free)
        )

    def displacement(self, force: Array, error: float = 0.0) -> Array:
        f = self.q.duplicate()
        self.volume.contact.write(f, force)
        found = f.duplicate()
        self.volume.solver.solve(f, found)
        return self.volume.contact.read(found)

    def under(self, load: Load, p: Array, error: float = 0.0) -> Array:
        f = load.f_q.duplicate()
        self.volume.contact.write(f, -self.forces(p))
        self.volume.solver.solve(f + load.f_q, self.q)
        return self.volume.contact.read(self.q)

    def recover(self, load: Load, p: Array, u_c: Array) -> Vec:
        """The displacement of the last solve: the method has made it as exact as its inner solver can, and says so."""
        return self.q.copy()

    def agreed(self, value: T) -> T:
        """The value of rank 0: solves are collective, so if ranks stopped at different iterations they would hang."""
        return on_all_ranks(self.volume.K.comm.tompi4py(), value)

    def adopt(self, other: DelassusOperator) -> None:
        assert isinstance(other, SparseSurface)
        self.q = other.q

    def snapshot(self) -> dict[str, Plain]:
        return {}

    def restore(self, snapshot: dict[str, Plain]) -> None:
        """Nothing to take up: each step starts from the state alone."""


Form = Literal["condensed", "matrix-free", "sparse"]  # of the bodies
Volume = FactorisedVolume | IterativeVolume | SparseVolume
SURFACES: Mapping[type, Callable[..., DelassusOperator]] = {
    FactorisedVolume: CondensedSurface,
    IterativeVolume: MatrixFreeSurface,
    SparseVolume: SparseSurface,
}


def prepare_volume(system: System, form: Form, pressed: bool = False) -> Volume:
    """The bodies prepared for volume solves: factorised ("condensed"), iterative ("matrix-free"), or as they are.

    Args:
        pressed: whether they are condensed on the contact dofs that rows touch alone.
    """
    if form == "sparse":
        return SparseVolume(system)
    if form == "matrix-free":
        return IterativeVolume(system)
    dofs = condensed_dofs(system, pressed)
    several, plane = system.mesh.part_count > 1, system.mesh.dim == 2
    K = system.assembled()
    return FactorisedVolume(K.product, dofs, system.counters, several=several, low_rank=plane, mixed=K.mixed())


def condensed_dofs(system: System, pressed: bool) -> Ints:
    """Free displacements (c,) that the bodies are condensed on, see `prepare_volume`."""
    return system.interface.pressed if pressed else system.interface.dofs


@overload
def prepare_surface(system: System, volume: FactorisedVolume) -> CondensedSurface: ...
@overload
def prepare_surface(system: System, volume: IterativeVolume) -> MatrixFreeSurface: ...
@overload
def prepare_surface(system: System, volume: SparseVolume) -> SparseSurface: ...
@overload
def prepare_surface(system: System, volume: Volume) -> DelassusOperator: ...
def prepare_surface(system: System, volume: Volume) -> DelassusOperator:
    """The Delassus operator of all contacts stacked: normal rows first, then tangential rows."""
    contacts, c = system.contacts, len(volume.contact.rows)
    known = np.isin(system.interface.dofs, volume.contact.rows)
    traces = [system.interface.trace(rows)[:, known] for rows in contacts]
    normal = [rows.N_n @ trace for rows, trace in zip(contacts, traces, strict=True)]
    tangential = [rows.N_t @ trace for rows, trace in zip(contacts, traces, strict=True)]
    count = len(system.obstacles.driven)
    pull = [_driven_columns(system, rows, rows.N_n) for rows in contacts]
    pull += [_driven_columns(system, rows, rows.N_t) for rows in contacts]
    weights = [rows.W_n for rows in contacts] + [np.repeat(rows.W_t, rows.free.shape[1]) for rows in contacts]
    return SURFACES[type(volume)](
        volume,
        N=sparse.hstack(
            [
                sparse.vstack([sparse.csr_matrix((0, c)), *normal, *tangential]),
                np.concatenate([np.zeros((0, count)), *pull]),
            ],
            format="csr",
        ),
        W=np.concatenate([np.zeros(0), *weights]),
        R=block_diag(system.interface.rigid_modes[known], np.eye(count)),
        driven=count,
        normal_rows=sum(block.shape[0] for block in normal),
    )


def condensed(bodies: DelassusOperator) -> CondensedSurface:
    """The bodies of a method that works with the condensed form alone: the choice of stages has seen to their form."""
    return cast(CondensedSurface, bodies)


def matrix_free(bodies: DelassusOperator) -> MatrixFreeSurface:
    """The bodies of a method that solves them iteratively: the choice of stages has seen to their form."""
    return cast(MatrixFreeSurface, bodies)


def uncondensed(bodies: DelassusOperator) -> SparseSurface:
    """The bodies of a method that assembles the block system: the choice of stages has seen to their form."""
    return cast(SparseSurface, bodies)


def _driven_columns(system: System, rows: ContactRows, N: Sparse) -> Array:
    """Relative displacement (rows, o) that unit motions of the driven obstacles cause."""
    obstacles = system.obstacles
    columns = np.zeros((N.shape[0], len(obstacles.driven)))
    for column, moved in obstacles.unit_motions(rows.name, len(rows.surface.points)).items():
        columns[:, column] = -(N @ moved)
    return columns


def elastic_stiffness(system: System) -> tuple[Array, Array]:
    """Stiffness of the bodies behind each row (rows,) [Pa/m]: E / depth, and E / extent; two bodies are in series."""
    deep, long = (
        _series(system, lambda size, spread: float(spread @ size)),
        _series(system, lambda size, _: float(size.max())),
    )
    return deep, long


def _series(system: System, length: Callable[[Array, Array], float]) -> Array:
    """E / length by row (rows,) [Pa/m]; the length [m] follows from a body's box and the mean normal, (d,) both."""
    scale = []
    for c in system.contacts:
        normals = c.frames[:, 0]
        spread, give = np.abs(normals).mean(axis=0), 0.0
        for body in system.problem.pairs[c.name].bodies:
            low, high = system.mesh.body_box(body)
            give += length(high - low, spread) / system.problem.bodies[body].modulus_along(normals)
        scale.append(1 / give)
    parts = [np.full(len(c.W_n), s) for c, s in zip(system.contacts, scale, strict=True)]
    parts += [np.full(c.free.size, s) for c, s in zip(system.contacts, scale, strict=True)]
    return np.concatenate([np.zeros(0), *parts])
