"""From the assembled system to the Delassus operator, condensed or matrix-free: rows, weights and rigid modes.

Each motion by which a force drives an obstacle is one more contact dof, without stiffness: contact alone holds it, as
it holds a floating body.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal, cast, overload

import numpy as np
from scipy import sparse
from scipy.linalg import block_diag

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.interface.matrix_free import IterativeVolume, MatrixFreeSurface
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.interface.sparse import SparseSurface, SparseVolume
from stickslip.solvers.system.system import System

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
