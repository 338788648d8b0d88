"""Calls of dolfinx that differ between its versions (0.5.2 of Debian 12, 0.9 of Debian 13, 0.11), and of basix.

Other files import this one instead of dolfinx, and before anything else that loads a shared library.
"""

# ruff: noqa: E402  what PETSc and dolfinx find when they are imported is prepared before
from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial, reduce
from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from stickslip.geometry.bisection import bisection, sets_beside
from stickslip.geometry.form_cache import TURN, find_cache, once, patient

CACHE, CACHE_NOTE = find_cache()  # the note is empty where all is as usual
try:
    Path.home()
except RuntimeError:  # a user without name or home, as in containers; dolfinx asks for one
    os.environ["HOME"] = str(CACHE)

_flags, _words = sys.getdlopenflags(), sys.argv
sys.argv = _words[:1]  # dolfinx takes words of the command line for its own, and refuses some characters

# ufl and ffcx of Debian 12 ask pkg_resources for their versions: its import takes .1 s, and new setuptools have none
_versions = ModuleType("pkg_resources")
_versions.get_distribution = distribution  # type: ignore[attr-defined]
_known = sys.modules.setdefault("pkg_resources", _versions)

if find_spec("dolfinx_solver"):  # PyPI's wheel of dolfinx: MPI is loaded first, and a second PETSc is refused
    import dolfinx_solver  # noqa: F401
import basix
import dolfinx
import dolfinx.fem.petsc
import dolfinx.jit
import ffcx
import numpy as np
import ufl
from dolfinx import cpp, fem, mesh

from stickslip.geometry.arrays import LAST_DIGITS, ROUNDING, Array, Ints
from stickslip.geometry.protocols import (
    Comm,
    CompiledForm,
    DolfinxMesh,
    Function,
    FunctionSpace,
    Mat,
    MeshTags,
    UflExpr,
    UflForm,
    Vec,
)

if _known is _versions:
    del sys.modules["pkg_resources"]
sys.argv = _words
sys.setdlopenflags(_flags)  # 0.5.2 leaves RTLD_GLOBAL on for every later import


DOLFINX: str = dolfinx.__version__
VERSION = tuple(int(part) for part in DOLFINX.split(".")[:2])
OLD = VERSION < (0, 6)
_DEFAULTS = getattr(dolfinx.jit, f"DOLFINX_DEFAULT_JIT_{'PARAMETERS' if OLD else 'OPTIONS'}")
_DEFAULTS |= {"cache_dir": (CACHE, ""), "timeout": (TURN, "")}
for _settings in (dolfinx.jit, ffcx.parameters if OLD else ffcx.options):  # whatever lies in the working folder
    setattr(_settings, f"_load_{'parameters' if OLD else 'options'}", lambda: ({}, {}))
dolfinx.jit.ffcx_jit = once(patient(dolfinx.jit.ffcx_jit, CACHE))


def with_compiled_coordinate_element(domain: Any) -> Any:
    """The mesh itself, with the coordinate element that ffcx 0.5.2 puts in its place when it compiles the first form.

    Without this, forms compiled later have other cache keys, and every run compiles one form again.
    """
    if OLD:
        ufl_domain = domain.ufl_domain()
        element = ufl_domain.ufl_coordinate_element()
        if element._sub_element._variant is None:
            scalar = ufl.FiniteElement(
                element.family(), element.cell(), element.degree(), element.quadrature_scheme(), variant="equispaced"
            )
            ufl_domain._ufl_coordinate_element = ufl.VectorElement(scalar, dim=len(element.sub_elements()))
    return domain


def model_to_mesh(model: Any, comm: Comm, dim: int) -> tuple[DolfinxMesh, MeshTags, MeshTags]:
    """Distribute a gmsh model, given on rank 0 (None elsewhere): mesh, cell tags and facet tags; collective."""
    partitioner = _partitioner(model) if comm.size > 1 else None
    if VERSION >= (0, 10):
        from dolfinx.io import gmsh as gmsh_io

        data = gmsh_io.model_to_mesh(model, comm, 0, gdim=dim, partitioner=partitioner)
        return data.mesh, data.cell_tags, data.facet_tags
    from dolfinx.io import gmshio

    if not OLD:
        domain, cells, facets = gmshio.model_to_mesh(model, comm, 0, gdim=dim, partitioner=partitioner)
        return domain, cells, facets
    create = gmshio.create_mesh
    if partitioner is not None:
        gmshio.create_mesh = partial(create, partitioner=partitioner)
    try:
        domain, cells, facets = gmshio.model_to_mesh(model, comm, 0, gdim=dim)
    finally:
        gmshio.create_mesh = create
    return with_compiled_coordinate_element(domain), cells, facets


def _partitioner(model: Any) -> Callable[..., Any]:
    """Partition the cells for dolfinx, on every rank: all are on rank 0 yet, and go by `bisection`.

    SCOTCH, which dolfinx would ask, takes ten times as long: it needs the graph of all cells.
    """

    def destinations(_comm: Comm, ranks: int, kind: Any, cells: Any, *_: Any) -> Any:
        if model is None:
            return cpp.graph.AdjacencyList_int32(np.empty(0, np.int32), np.zeros(1, np.int32))
        corners = _rows(cells) if hasattr(cells, "links") else cells[0].reshape(-1, cpp.mesh.cell_num_vertices(kind[0]))
        tags, points, _ = model.mesh.getNodes()  # numbered from 1 without gaps
        x = np.empty((len(tags), 3))
        x[np.asarray(tags, np.int64) - 1] = points.reshape(-1, 3)
        rank = bisection(x[corners].mean(axis=1), ranks)
        cell, to = np.arange(len(rank)), rank
        if OLD:  # finds the nodes that ranks share from ghosts: the rank of each cell, then those that get a copy
            copied, beside = sets_beside(corners, rank, kind)
            cell, to = np.concatenate([cell, copied]), np.concatenate([rank, beside])
        first = np.cumsum(np.bincount(cell))
        to = to[np.argsort(cell, kind="stable")]
        return cpp.graph.AdjacencyList_int32(to.astype(np.int32), np.append(0, first).astype(np.int32))

    return destinations


def _space(domain: DolfinxMesh, family: str, degree: int, shape: tuple[int, ...] = ()) -> FunctionSpace:
    """Space of numbers, or of vectors with as many components as the mesh has dimensions."""
    if hasattr(fem, "functionspace"):
        return fem.functionspace(domain, (family, degree, shape) if shape else (family, degree))
    make = fem.VectorFunctionSpace if shape else fem.FunctionSpace
    return make(with_compiled_coordinate_element(domain), (family, degree))


def vector_space(domain: DolfinxMesh, degree: int) -> FunctionSpace:
    """Continuous Lagrange space of vectors with as many components as the mesh has dimensions."""
    return _space(domain, "Lagrange", degree, (domain.geometry.dim,))


def scalar_space(domain: DolfinxMesh) -> FunctionSpace:
    """Continuous Lagrange space of numbers of degree 1: one at each corner of the cells."""
    return _space(domain, "Lagrange", 1)


def cell_function(domain: DolfinxMesh, values: Array) -> Function:
    """One value in each cell: `values` (cells,) of this rank, ghosts included."""
    space = _space(domain, "DG", 0)
    found = fem.Function(space)
    found.x.array[cell_dofs(space)[:, 0]] = values
    return found


def cells_of_points(count: int) -> FunctionSpace:
    """Space with one value a cell, on a mesh of this rank alone with `count` >= 1 cells, one for each of some points.

    UFL writes pointwise functions on it: see `CellExpression`.
    """
    from mpi4py import MPI

    return _space(mesh.create_interval(MPI.COMM_SELF, count, [0.0, float(count)]), "DG", 0)


def fill(function: Function, values: Array) -> None:
    """Set the coefficients of a function that this rank owns, in blocks, and its ghosts; collective."""
    function.x.array[: len(values)] = values
    function.x.scatter_forward()


def add_to_owners(function: Function) -> None:
    """Add the coefficients of ghosts to those of their owners; collective."""
    la = dolfinx.la
    function.x.scatter_reverse(la.ScatterMode.add if OLD else la.InsertMode.add)


def sums_on_owners(space: FunctionSpace, values: Array) -> Array:
    """Values (k, d) at local nodes, those of ghosts added to those of their owners (owned, d); collective."""
    function = fem.Function(space)
    function.x.array[:] = values.ravel()
    add_to_owners(function)
    count = space.dofmap.index_map.size_local
    return np.asarray(function.x.array.reshape(values.shape)[:count])


def sums_at_nodes(space: FunctionSpace, values: Array) -> Array:
    """Values (k, nodes) at local nodes, those of all ranks added, ghosts included (k, nodes); collective."""
    function = fem.Function(space)
    found, by_node = np.empty_like(values), function.x.array.reshape(values.shape[1], -1)
    for start in range(0, len(values), by_node.shape[1]):
        some = values[start : start + by_node.shape[1]]
        by_node[:, : len(some)] = some.T
        add_to_owners(function)
        function.x.scatter_forward()
        found[start : start + len(some)] = by_node[:, : len(some)].T
    return found


def _rows(table: Any) -> Ints:
    return np.asarray(table.array.reshape(-1, table.links(0).size) if hasattr(table, "links") else table)


def cell_dofs(space: FunctionSpace) -> Ints:
    """Local block numbers (cells, k) of each cell's k nodes; a block holds the components at a node."""
    return _rows(space.dofmap.list)


def cell_nodes(domain: DolfinxMesh) -> Ints:
    """Rows (cells, k) of `domain.geometry.x`: each cell's k geometry nodes."""
    return _rows(domain.geometry.dofmaps[0] if VERSION >= (0, 11) else domain.geometry.dofmap)


def degree(space: FunctionSpace) -> int:
    """Polynomial degree of a Lagrange space: 1, 2 or 3."""
    return degree_of(space.mesh.topology.cell_type.name, cell_dofs(space).shape[1])


def degree_of(shape: str, nodes: int) -> int:
    """Polynomial degree of a Lagrange cell with so many nodes: 1, 2 or 3."""
    return next(k for k in (1, 2, 3) if len(reference_nodes(shape, k)) == nodes)


def facet_dofs(space: FunctionSpace, local_facet: int) -> Ints:
    """Cell-local numbers of the dofs on a facet of the reference cell, with those on its boundary."""
    dim = space.mesh.topology.dim
    return np.asarray(space.dofmap.dof_layout.entity_closure_dofs(dim - 1, local_facet))


def exterior_facets(domain: DolfinxMesh) -> Ints:
    """Facets (f,) that this rank owns and that bound one cell."""
    dim = domain.topology.dim
    domain.topology.create_connectivity(dim - 1, dim)
    return np.asarray(mesh.exterior_facet_indices(domain.topology), np.int64)


def facet_cells(domain: DolfinxMesh, facets: Ints) -> Ints:
    """Rows (f, 2) of cell and local facet, of exterior facets (f,)."""
    dim = domain.topology.dim
    domain.topology.create_connectivity(dim - 1, dim)
    domain.topology.create_connectivity(dim, dim - 1)
    to_cell, to_facet = domain.topology.connectivity(dim - 1, dim), domain.topology.connectivity(dim, dim - 1)
    cells = np.asarray(to_cell.array, np.int64)[np.asarray(to_cell.offsets)[facets]]
    around = np.asarray(to_facet.array).reshape(to_facet.num_nodes, -1)[cells]
    return np.stack([cells, np.argmax(around == np.reshape(facets, (-1, 1)), axis=1)], axis=1)


def renumbered(domain: DolfinxMesh, tags: MeshTags, numbers: Sequence[int]) -> MeshTags:
    """The tags of these numbers alone, as 1, 2, ... in their order."""
    order = np.argsort(numbers)
    known = np.asarray(numbers)[order]
    place = np.minimum(np.searchsorted(known, tags.values), len(known) - 1)
    mine = known[place] == tags.values
    return mesh.meshtags(domain, tags.dim, tags.indices[mine], (order[place[mine]] + 1).astype(np.int32))


def compile_form(form: UflForm) -> CompiledForm:
    """Compile a form, or load it from the cache; collective.

    Waits up to 600 s while another process compiles the same form.

    Raises:
        MachineError: there is no compiler, or no room on the disk.
    """
    return fem.form(form)


def assemble_matrix(form: CompiledForm) -> Mat:
    """PETSc matrix of a compiled bilinear form, without boundary conditions; collective."""
    matrix = fem.petsc.assemble_matrix(form)
    matrix.assemble()
    matrix.setAttr("form", form)  # keeps the mesh: PETSc 3.22 makes the vectors of a matrix on the mesh's communicator
    return matrix


def assemble_vector(form: CompiledForm, *more: CompiledForm) -> Vec:
    """PETSc vector of the sum of compiled linear forms, ghost values added to those of their owners; collective.

    It is on the communicator of the mesh, not on the one that dolfinx makes for each space.
    """
    from petsc4py import PETSc

    ghosted = fem.petsc.assemble_vector(form)
    for other in more:
        fem.petsc.assemble_vector(ghosted, other)
    ghosted.ghostUpdate(addv=PETSc.InsertMode.ADD_VALUES, mode=PETSc.ScatterMode.REVERSE)
    vector = PETSc.Vec().createMPI(ghosted.getSizes(), bsize=ghosted.block_size, comm=form.mesh.comm)
    vector.array[:] = ghosted.array_r
    ghosted.destroy()
    return vector


class CellExpression:
    """A UFL expression, compiled to be evaluated at reference `points` (q, d) of cells."""

    def __init__(self, expression: UflExpr, points: Array, domain: DolfinxMesh) -> None:
        self._domain = domain
        self._shape = (len(points), int(np.prod(expression.ufl_shape, initial=1)))
        self._compiled = fem.Expression(expression, points)

    def __call__(self, cells: Ints) -> Array:
        """Values (c, q, components) on cells (c,)."""
        numbers = np.asarray(cells, np.int32)
        values = self._compiled.eval(numbers) if OLD else self._compiled.eval(self._domain, numbers)
        return np.asarray(values).reshape(len(cells), *self._shape)


def find_cell(domain: DolfinxMesh, point: Array, size: float) -> tuple[int, Array] | None:
    """Find the owned cell that contains a point.

    Args:
        point: (d,) [m].
        size: of the whole mesh [m].

    Returns:
        Local number of the cell and values of its basis at the point (k,); None if this rank owns no such cell. Of
        several cells it is the first one of the gmsh model, so that the result does not depend on the ranks.
    """
    topology, dim = domain.topology, domain.topology.dim
    cells, nodes = cell_nodes(domain)[: topology.index_map(dim).size_local], domain.geometry.x[:, :dim]
    found = cells_at(topology.cell_type.name, nodes, cells, point, size)
    return min(found, key=lambda entry: int(topology.original_cell_index[entry[0]]), default=None)


def cells_at(shape: str, nodes: Array, cells: Ints, point: Array, size: float) -> Iterator[tuple[int, Array]]:
    """Cells that contain a point, in their order, each with the values of its basis there (k,).

    Args:
        shape: of the cells.
        nodes: (n, d) [m].
        cells: (c, k) rows of `nodes`, in dolfinx's order of a cell's nodes.
        point: (d,) [m]; it may miss a cell by rounding.
        size: of the whole mesh [m].
    """
    degree, slack = degree_of(shape, cells.shape[1]), ROUNDING * size
    low, high = (reduce(extreme, (nodes[column] for column in cells.T)) for extreme in (np.minimum, np.maximum))
    reach = slack + (0.1 * (high - low) if degree > 1 else 0.0)  # curved edges bulge out of the box of their nodes
    for cell in np.flatnonzero(np.all((low - reach <= point) & (high + reach >= point), axis=1)):
        x = nodes[cells[cell]]
        local = _pull_back(shape, degree, x, point)
        basis = reference_basis(shape, degree, local[None])[0][0]
        corners = reference_basis(shape, 1, local[None])[0][0]
        if np.linalg.norm(basis @ x - point) <= slack and corners.min() >= -ROUNDING:
            yield int(cell), basis


def _pull_back(shape: str, degree: int, nodes: Array, point: Array) -> Array:
    """Reference coordinates (d,) of a point by Newton's method; one step is exact on straight simplices."""
    local = np.full(len(point), 1 / 3)
    for _ in range(30):
        basis, gradient = reference_basis(shape, degree, local[None])
        try:
            step = np.linalg.solve((gradient[:, 0] @ nodes).T, point - basis[0] @ nodes)
        except np.linalg.LinAlgError:  # a point far outside a curved cell
            break
        local = local + step
        if np.linalg.norm(step) < LAST_DIGITS:
            break
    return local


def borders(shape: str) -> Ints:
    """Corners (m, k) of the m lines around a reference facet, in 2D each end by itself; in dolfinx's order."""
    return np.array(basix.topology(getattr(basix.CellType, shape))[-2])


def reference_rule(shape: str, degree: int) -> tuple[Array, Array]:
    """Quadrature points (q, k) and weights (q,) of a reference interval, triangle or quadrilateral."""
    points, weights = basix.make_quadrature(getattr(basix.CellType, shape), degree)
    return np.asarray(points), np.asarray(weights)


def reference_basis(shape: str, degree: int, points: Array) -> tuple[Array, Array]:
    """Lagrange basis (q, n) and its gradient (k, q, n) at points (q, k) of a reference cell, in dolfinx's order."""
    some = points if len(points) else np.zeros((1, points.shape[1]))  # basix aborts without a point
    table = np.asarray(_element(shape, degree).tabulate(1, some))[:, : len(points), :, 0]
    return table[0], table[1:]


def reference_nodes(shape: str, degree: int) -> Array:
    """Nodes (n, k) of a reference cell, in dolfinx's order."""
    return np.asarray(_element(shape, degree).points)


@cache
def _element(shape: str, degree: int) -> Any:
    variant = basix.LagrangeVariant.gll_warped
    return basix.create_element(basix.ElementFamily.P, getattr(basix.CellType, shape), degree, variant)


def midpoint(domain: DolfinxMesh) -> Array:
    """Midpoint (1, d) of the reference cell of the mesh."""
    shape = domain.topology.cell_type
    corners = np.asarray(basix.geometry(getattr(basix.CellType, shape.name)))
    return np.asarray(corners.mean(axis=0, keepdims=True))


__all__ = ["cpp", "fem", "mesh", "ufl"]
