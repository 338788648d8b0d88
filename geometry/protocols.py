"""Objects of the libraries that come without types, by name; of a communicator, the part that this program uses."""

from __future__ import annotations

from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from stickslip.geometry.arrays import AnyArray, Ints

T = TypeVar("T")
Int32s = NDArray[np.int32]  # numbers as PETSc, dolfinx and scipy store them


class Comm(Protocol):
    """mpi4py communicator; every call is collective. `op` is an operation such as MPI.MAX, by default the sum."""

    rank: int
    size: int

    def bcast(self, value: object, root: int = 0) -> Any: ...
    def allgather(self, value: T) -> list[T]: ...
    def allreduce(self, value: T, op: Any = ...) -> T: ...
    def Allgatherv(self, own: AnyArray, every: tuple[AnyArray, Ints]) -> None: ...
    def Bcast(self, values: AnyArray, root: int = 0) -> None: ...
    def Gatherv(self, own: AnyArray, every: tuple[AnyArray, Ints]) -> None: ...
    def Scatterv(self, every: tuple[AnyArray, Ints], own: AnyArray) -> None: ...
    def Send(self, values: AnyArray, to: int, tag: int = ...) -> None: ...
    def Recv(self, values: AnyArray, source: int, tag: int = ...) -> None: ...
    def Split_type(self, kind: int) -> Comm: ...
    def Free(self) -> None: ...


# Names for signatures: what these are made of and asked, the manuals of the libraries say.
Vec = Any  # distributed PETSc vector; `array` is this rank's part, `array_r` the same for reading only
Mat = Any  # distributed PETSc matrix, or the factor of one; each rank owns some of the rows
PC = Any  # PETSc preconditioner
KSP = Any  # PETSc linear solver
Sparse = Any  # scipy sparse matrix
UflExpr = Any  # UFL expression: a field (scalar, vector or tensor) as a formula
UflForm = Any  # UFL form: a sum of integrals, linear in each of its test and trial functions
Measure = Any  # UFL measure: an integrand times a measure is a form
Constant = Any  # dolfinx constant: a number in a form that may change without compiling it again; `value`
Function = Any  # dolfinx finite element function, a UFL expression too; `x.array` has own coefficients, then ghosts
FunctionSpace = Any  # dolfinx space of functions; of its table of dofs see `dolfinx_versions.cell_dofs`
CompiledForm = Any  # form that ffcx has compiled and dolfinx can assemble
DolfinxMesh = Any  # distributed dolfinx mesh
MeshTags = Any  # tags of the cells or facets `indices` of this rank, which increase
Gmsh = Any  # the gmsh module, initialised; its calls act on the current model
DataFrame = Any  # of pandas, which need not be installed
