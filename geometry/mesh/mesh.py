"""A gmsh model becomes a distributed mesh whose bodies and sides are found by name."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.curved_facets import Bulging
from stickslip.geometry.errors import GeometryError, InputError, MachineError, SceneError, StickslipError
from stickslip.geometry.memory import available
from stickslip.geometry.mesh.cell_quality import refuse_inverted_cells
from stickslip.geometry.mesh.gmsh_session import gmsh_session, own_interrupt
from stickslip.geometry.mesh.joints import Joints, find_parts, open_seams
from stickslip.geometry.mesh.ranks import from_rank_0
from stickslip.geometry.protocols import Comm, DolfinxMesh, Gmsh, MeshTags
from stickslip.geometry.shape import SKIN, Request, Shape, skins


@dataclass(frozen=True, kw_only=True)
class NamedParts:
    """Names and tags of a mesh's gmsh model, on every rank."""

    bodies: Mapping[str, int]  # name -> tag of cells
    sides: Mapping[str, int]  # name, as body.side -> tag of facets
    node_count: int  # of the gmsh model
    part_count: int  # number of parts, see `find_parts`
    joints: Joints  # nodes that several parts share
    seams: Mapping[str, int]  # see `open_seams`
    bulging: Bulging  # facets of curved surfaces
    edges: Mapping[str, Ints]  # by contact side, see `find_edges`


@dataclass(frozen=True, kw_only=True)
class Mesh(NamedParts):
    """Distributed mesh."""

    shape: Shape  # that it is of
    request: Request  # of the scene; sizes on rank 0 alone
    comm: Comm  # the caller's: dolfinx frees its copy with the mesh, and PETSc's objects on it would be lost
    domain: DolfinxMesh
    cell_tags: MeshTags  # of bodies
    facet_tags: MeshTags  # of sides
    degree: int  # polynomial degree of displacement; of geometry, too, but see `of_order`
    axisymmetric: bool
    parts: Ints  # (local,) part of each node of this rank's cells, in the order of `domain.geometry`, numbered from 0

    @property
    def dim(self) -> int:
        return int(self.domain.geometry.dim)

    @property
    def simplicial(self) -> bool:
        """Whether cells are triangles or tetrahedra."""
        return self.domain.topology.cell_type.name in ("triangle", "tetrahedron")

    @property
    def geometry_degree(self) -> int:
        """Polynomial degree of the geometry."""
        return dx.degree_of(self.domain.topology.cell_type.name, dx.cell_nodes(self.domain).shape[1])

    def of_order(self, degree: int) -> Mesh:
        """The same cells with displacements of another order; collective. Those of curved sides are meshed again.

        Raises:
            GeometryError: that cannot be done.
        """
        shape = self.shape.of_order(degree)
        if self.bulging:
            return build_mesh(shape, self.request, self.comm)
        return replace(self, shape=shape, degree=degree)

    @property
    def quadrature(self) -> int | None:
        """Degree of the quadrature on cells, exact for the stiffness of straight simplices and of parallelepipeds.

        It gives quadrilaterals and hexahedra two points along an edge in order 1, three in order 2; UFL's estimate one
        more, which takes twice the time in 3D. None: the estimate, which is exact for simplices of order 1.
        """
        return None if self.simplicial and self.degree == 1 else 2 * self.degree + self.axisymmetric

    def parts_of(self, numbers: Ints) -> Ints:
        """Connected parts of nodes of this rank's cells with the numbers `Nodes.input` (n,)."""
        total, inputs = self.node_count, np.asarray(self.domain.geometry.input_global_indices, np.int64)
        order = np.argsort(inputs)
        of_mesh = np.where(numbers < total, numbers, numbers // total - 1)
        return np.asarray(self.parts[order[np.searchsorted(inputs, of_mesh, sorter=order)]])

    def facets(self, side: str) -> Ints:
        """Local numbers of the facets of a side that this rank owns."""
        body, name = side.split(".")
        if name == SKIN:
            return self._skin(body)
        owned = self.domain.topology.index_map(self.dim - 1).size_local
        found = self.facet_tags.indices[self.facet_tags.values == self.sides[side]]
        return np.asarray(found[found < owned], np.int64)

    def _skin(self, body: str) -> Ints:
        """Local numbers of the facets that this rank owns and that bound a body alone, but for its periodic sides."""
        inside = [self.facets(side) for pair in self.request.periodic for side in pair]
        found = np.setdiff1d(dx.exterior_facets(self.domain), np.concatenate([np.zeros(0, np.int64), *inside]))
        return found[np.isin(dx.facet_cells(self.domain, found)[:, 0], self.cells_of(body))]

    def cells_of(self, body: str) -> Ints:
        """Local numbers of the cells of a body, ghosts included."""
        found: Ints = self.cell_tags.indices[self.cell_tags.values == self.bodies[body]]
        return found

    def box(self) -> Array:
        """Lower and upper corner of the bounding box (2, d) [m]; collective."""
        return self._box_of(self.domain.geometry.x[:, : self.dim])

    def body_box(self, body: str) -> Array:
        """Lower and upper corner of the bounding box of one body (2, d) [m]; collective."""
        cells = self.cells_of(body)
        inside = np.zeros(len(self.domain.geometry.x), bool)
        inside[dx.cell_nodes(self.domain)[cells]] = True
        return self._box_of(self.domain.geometry.x[inside, : self.dim])

    def _box_of(self, x: Array) -> Array:
        low, high = x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)
        return np.array([np.min(self.comm.allgather(low), axis=0), np.max(self.comm.allgather(high), axis=0)])


def build_mesh(shape: Shape, request: Request, comm: Comm) -> Mesh:
    """Mesh the shape on rank 0 and distribute it over all ranks of `comm`; collective.

    Raises:
        GeometryError: gmsh cannot mesh the shape; on every rank.
        MachineError: memory or a disk is full, or gmsh's process was ended from outside; on every rank.
        KeyboardInterrupt: a signal ended gmsh's process; on every rank.
    """
    with own_interrupt():
        return _build(shape, request, comm)


def _build(shape: Shape, request: Request, comm: Comm) -> Mesh:
    made: tuple[NamedParts, Ints, float] | None = None
    failure: BaseException | None = None
    with gmsh_session() if comm.rank == 0 else nullcontext() as gmsh:
        if gmsh is not None:
            try:
                made = _made(gmsh, shape, request)
            except InputError as error:
                failure = GeometryError(str(error))
            except (StickslipError, KeyboardInterrupt) as error:
                failure = error
            except MemoryError:
                failure = MachineError("too little memory for the mesh; use a larger mesh_size")
            except Exception as error:  # gmsh raises bare Exception, without a text where it is an error of C++
                why = " ".join(str(error).split()) or "it does not say why"
                failure = GeometryError(f"gmsh could not mesh the geometry: {why}")
        failure = comm.bcast(failure)
        if failure is not None:
            raise failure
        domain, cells, facets = dx.model_to_mesh(gmsh.model if gmsh else None, comm, request.dim)
    shares = comm.allgather(domain.topology.index_map(request.dim).size_local)
    if min(shares) == 0:
        raise GeometryError(f"the mesh has {sum(shares)} cells, too few for {comm.size} ranks; use fewer")
    named, of_nodes, unit = made or (None, None, 1.0)
    used = 0 if of_nodes is None else int(np.count_nonzero(of_nodes >= 0))
    named, used, unit = comm.bcast((named, used, unit))
    assert named is not None
    if domain.geometry.index_map().size_global > used:  # dolfinx looks for shared facets
        raise GeometryError(
            f"cells hang together by points or edges only, where {comm.size} ranks would take them apart; use one "
            "rank, or join them by whole facets"
        )
    numbers = np.asarray(domain.geometry.input_global_indices, np.int64)
    domain.geometry.x[:] *= unit
    if shape.degree > 1:
        refuse_inverted_cells(domain, shape.degree)
    return Mesh(
        **vars(named),
        shape=shape,
        request=request,
        comm=comm,
        domain=domain,
        cell_tags=cells,
        facet_tags=facets,
        degree=shape.degree,
        axisymmetric=request.model == "axisymmetric",
        parts=from_rank_0(comm, numbers, of_nodes) if named.part_count > 1 else np.zeros_like(numbers),
    )


def _made(gmsh: Gmsh, shape: Shape, request: Request) -> tuple[NamedParts, Ints, float]:
    """Mesh the shape in the current gmsh model; also the part of each node, and the length of the model's unit [m]."""
    try:
        shape.refuse_too_large(request, available())
    except SceneError as error:
        raise SceneError(f"geometry.{error}") from None
    dim, unit = request.dim, mesh_shape(gmsh, shape, request)
    bodies, (part, joints) = _group_names(gmsh, dim), find_parts(gmsh, dim, unit)
    sides = _group_names(gmsh, dim - 1)
    named, whole = [s for s in request.contact_sides if s in sides], dict[str, list[int]]()
    if len(named) < len(request.contact_sides):
        whole = skins(gmsh, dim, {b: gmsh.model.getEntitiesForPhysicalGroup(dim, tag) for b, tag in bodies.items()})
    of_sides = {side: whole.get(side, list[int]()) for side in request.contact_sides}
    of_sides |= {s: gmsh.model.getEntitiesForPhysicalGroup(dim - 1, sides[s]).tolist() for s in named}
    found = NamedParts(
        bodies=bodies,
        sides=sides,
        node_count=len(part),
        part_count=int(part.max()) + 1,
        joints=joints,
        seams=open_seams(gmsh, dim, part, bodies),
        bulging=shape.bulging(gmsh, dim, unit),
        edges=shape.edges(gmsh, of_sides, dim),
    )
    return found, part, unit


def mesh_shape(gmsh: Gmsh, shape: Shape, request: Request) -> float:
    """Mesh the shape in the current gmsh model with cells of the shape's degree.

    Returns:
        Length of the gmsh model's unit [m].
    """
    unit = shape.put(gmsh, request)
    kinds = gmsh.model.mesh.getElementTypes(request.dim)
    if any(gmsh.model.mesh.getElementProperties(kind)[2] != shape.degree for kind in kinds):
        gmsh.model.mesh.setOrder(shape.degree)
    return unit


def _group_names(gmsh: Gmsh, dim: int) -> dict[str, int]:
    """Tags of the physical groups by name."""
    return {gmsh.model.getPhysicalName(d, tag): int(tag) for d, tag in gmsh.model.getPhysicalGroups(dim)}


def write_msh(shape: Shape, request: Request, path: Path) -> None:
    """Mesh the shape and write it in the scene's unit: into a temporary file beside `path`, which is then renamed.

    Raises:
        MachineError: the file cannot be written.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.msh")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch()
        with own_interrupt(), gmsh_session() as gmsh:
            unit = mesh_shape(gmsh, shape, request)
            gmsh.option.setNumber("Mesh.ScalingFactor", unit)
            gmsh.option.setNumber("Mesh.SaveAll", 0)
            gmsh.write(str(temporary))
        temporary.replace(path)
    except OSError as error:
        raise MachineError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
