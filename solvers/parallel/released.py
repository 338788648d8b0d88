"""Memory of PETSc objects that Python has released.

petsc4py only marks them, because ranks release at different times; PETSc destroys them in a collective call for each
communicator [PETSc manual, PetscGarbageCleanup]. dolfinx gives every mesh a communicator of its own, which is not known
to anybody else: without the calls here no matrix and no factor is ever destroyed.

When a process ends, PETSc makes that call for all ranks together, but only on ranks where something is marked. Ranks
may differ in that: where an array still shows the entries of a vector when Python releases the vector, it is destroyed
with the array, without being marked, and on other ranks it may have been the other way round.
"""

from __future__ import annotations

import atexit
import ctypes
import gc
import weakref
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.protocols import Comm

# glibc's M_MMAP_MAX, M_MMAP_THRESHOLD and M_TRIM_THRESHOLD [bytes]
MALLOC = (-4, 65536), (-3, 32 << 20), (-1, 64 << 20)


@dataclass(frozen=True)
class _Watched:
    mesh: weakref.ref[Mesh]
    comm: PETSc.Comm  # PETSc's own for the mesh, held here until its objects are gone


_watched: list[_Watched] = []  # in the order in which ranks made the meshes
_to_the_end: list[PETSc.Vec] = []  # released after what petsc4py destroys at the end of a process


def watch(mesh: Mesh) -> None:
    """Destroy objects on the communicator of a mesh in later calls of `destroy_released`; collective."""
    if not any(each.mesh() is mesh for each in _watched):
        _watched.append(_Watched(weakref.ref(mesh), PETSc.Comm(mesh.domain.comm).duplicate()))


def destroy_released(comm: Comm) -> None:
    """Destroy what Python has released since the last call, on all meshes of the ranks of `comm`; collective."""
    mine = [each for each in _watched if _same_ranks(each.comm.tompi4py(), comm)]
    users = comm.allreduce(np.array([each.mesh() is not None for each in mine], int))
    gone = [each for each, count in zip(mine, users, strict=True) if not count]
    last = len(gone) > 16  # communicators of meshes, before Python looks for what is left in reference cycles
    if last:
        gc.collect()
    PETSc.garbage_cleanup(PETSc.COMM_SELF)
    PETSc.garbage_cleanup(comm)
    for each in mine:
        PETSc.garbage_cleanup(each.comm)
    for each in gone if last else ():
        _watched.remove(each)
        each.comm.destroy()


def return_memory(comm: Comm) -> None:
    """Destroy what Python has released, and return to the system what is free (glibc); collective.

    SuperLU_DIST, which PETSc loads, forbids mmap and trimming in the whole process: what a matrix or a factor leaves
    would stay with it. Not in each step: the system would clear each page again that the next one takes, a tenth of
    a step in 2D.
    """
    destroy_released(comm)
    libc = ctypes.CDLL(None)
    if hasattr(libc, "malloc_trim"):
        for option, value in MALLOC:
            libc.mallopt(option, value)
        libc.malloc_trim(0)


@atexit.register
def _mark_something() -> None:
    """Have every rank mark an object when the interpreter ends, so that none waits for another in PetscFinalize."""
    _to_the_end.append(PETSc.Vec().create(PETSc.COMM_WORLD))


def _same_ranks(one: Comm, other: Comm) -> bool:
    same = MPI.Comm.Compare(one, other)  # type: ignore[arg-type]
    return same in (MPI.IDENT, MPI.CONGRUENT)
