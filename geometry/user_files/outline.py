"""Outline of a user's file, found before its volumes are meshed: names, bounding box, sample points of the sides."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.user_files.parts import FACET_WORD, Parts, nodes_at
from stickslip.geometry.user_files.raw_mesh import CORNERS, TYPES, RawMesh, read_raw_mesh

COARSE = 8  # cells along the box's diagonal, for sampling and drawing
ROUND = 16  # cells on a full circle
FLAT_SIDE = 1e-6  # a side is flat if the components of its unit normals differ by less
STEP = 1e-3  # distance of a test point from a facet, relative to the facet's size
RAY = np.array([0.5377, 0.7217, 0.4359])  # direction that is unlikely to meet an edge
TILT = np.array([0.0131, 0.0073, 0.0037])  # decides between equal extremes, alike on opposite sides


@dataclass(frozen=True)
class Facets:
    """Facets of a gmsh entity (a face in 3D, an edge in 2D)."""

    number: int  # gmsh's tag
    name: str
    corners: Array  # (f, k, 3) [m]
    exact: float | None  # area or length [m^2 or m], if the CAD kernel gives it

    @property
    def size(self) -> float:
        """Area in 3D [m^2], length in 2D [m]."""
        return self.exact or float(np.linalg.norm(self.normals(), axis=1).sum())

    @property
    def box(self) -> Array:
        """Lower and upper corner of the bounding box (2, 3) [m]."""
        flat = self.corners.reshape(-1, 3)
        return np.array([flat.min(axis=0), flat.max(axis=0)])

    @property
    def centre(self) -> Array:
        """Centre of gravity (3,) [m]."""
        weights = np.linalg.norm(self.normals(), axis=1)
        return np.asarray(weights @ self.corners.mean(axis=1) / weights.sum())

    def normals(self) -> Array:
        """Normals (f, 3), see `normals_of`."""
        return normals_of(self.corners)


def normals_of(c: Array) -> Array:
    """Normals (f, 3) of facets with corners (f, k, 3), as long as their area; of edges in the plane z = 0."""
    if c.shape[1] == 2:
        along = c[:, 1] - c[:, 0]
        return np.stack([along[:, 1], -along[:, 0], 0 * along[:, 2]], axis=1)
    if c.shape[1] == 3:
        return np.asarray(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]) / 2)
    return np.asarray(np.cross(c[:, 2] - c[:, 0], c[:, 3] - c[:, 1]) / 2)


@dataclass(frozen=True)
class Outline:
    """Names, box and sample points of a geometry; lengths in metres."""

    bodies: dict[str, tuple[str, ...]]  # body -> its sides
    box: Array  # (2, 3)
    volume: float  # [m^3], of a plane model area [m^2]; that of the box if the model does not say it
    entities: tuple[Facets, ...]
    samples: dict[str, tuple[Array, Array]]  # body.side -> points (k, 3), unit outward normals (k, 3)
    side_of: dict[int, str]  # tag of an entity -> its body.side


def read_outline(gmsh: Gmsh, dim: int, parts: Parts, unit: float) -> Outline:
    """Outline of the current gmsh model, whose facets are meshed coarsely if it has no mesh.

    Raises:
        GeometryError: the model has no boundary, or its mesh cannot be used.
    """
    meshed = len(gmsh.model.mesh.getElementTypes(dim)) > 0
    raw = read_raw_mesh(gmsh, dim, parts) if meshed else None
    if raw is None:
        _mesh_facets(gmsh, dim)
    entities = [
        Facets(
            int(tag),
            gmsh.model.getEntityName(dim - 1, tag),
            unit * _corners(gmsh, dim - 1, tag),
            _exact_size(gmsh, dim - 1, tag, unit),
        )
        for _, tag in gmsh.model.getEntities(dim - 1)
    ]
    of = {facets.number: facets for facets in entities if len(facets.corners)}
    samples = {}
    for side in parts.sides:
        if raw is not None:
            samples[side] = _sample(*_outward_of_mesh(raw, side, unit))
        else:
            samples[side] = _sample(*_outward_of_cad(gmsh, dim, side, parts, of))
    if raw is not None:
        corners = unit * raw.points
    elif of:
        corners = np.concatenate([facets.corners.reshape(-1, 3) for facets in of.values()])
    else:
        raise GeometryError("has no boundary")
    sides = {body: tuple(s.split(".")[1] for s in parts.sides if s.split(".")[0] == body) for body in parts.bodies}
    box = np.array([corners.min(axis=0), corners.max(axis=0)])
    side_of = {tag: side for side, tags in parts.sides.items() for tag in tags}
    exact = [_exact_size(gmsh, dim, tag, unit) for _, tag in gmsh.model.getEntities(dim)]
    volume = sum(size or np.inf for size in exact)
    volume = min(volume, float(np.prod(np.ptp(box, axis=0)[:dim])))
    return Outline(sides, box, volume, tuple(of.values()), samples, side_of)


def _outward_of_mesh(raw: RawMesh, side: str, unit: float) -> tuple[Array, Array]:
    """Corners (f, k, 3) and outward normals (f, 3) of a side's facets: they point away from the cells behind them."""
    rows, cells = raw.facets[side], raw.cells[side.split(".")[0]]
    corners = unit * raw.points[rows[:, : CORNERS[TYPES[raw.kind]]]]
    normals = normals_of(corners)
    behind = unit * raw.points[cells[raw.behind(side)]].mean(axis=1)
    away = np.einsum("fd,fd->f", corners.mean(axis=1) - behind, normals)
    return corners, normals * np.sign(away)[:, None]


def _outward_of_cad(gmsh: Gmsh, dim: int, side: str, parts: Parts, of: dict[int, Facets]) -> tuple[Array, Array]:
    """Corners and outward normals as above, without a volume mesh.

    A normal of an entity points outward if a small step along it from the largest facet leads out of the body's closed
    boundary.
    """
    body = side.split(".")[0]
    entities = [(dim, tag) for tag in parts.bodies[body]]
    boundary = [tag for _, tag in gmsh.model.getBoundary(entities, combined=True, oriented=False) if tag in of]
    corners, normals = [], []
    for tag in parts.sides[side]:
        if tag not in boundary:
            raise GeometryError(f"side {side}: {FACET_WORD[dim]} {tag} is not on the boundary of {body}")
        normal = of[tag].normals()
        area = np.linalg.norm(normal, axis=1)
        largest = int(np.argmax(area))
        step = STEP * area[largest] ** (1 / (dim - 1)) * normal[largest] / area[largest]
        point = of[tag].corners[largest].mean(axis=0) + step
        corners.append(of[tag].corners)
        normals.append(-normal if is_inside(point, [of[t].corners for t in boundary], dim) else normal)
    return np.concatenate(corners), np.concatenate(normals)


def is_inside(point: Array, boundary: list[Array], dim: int) -> bool:
    """Whether a closed boundary of facets (f, k, 3) encloses a point: a ray from it crosses an odd number of facets."""
    along = RAY * ([1, 1, 0] if dim == 2 else 1)
    crossed = 0
    for corners in boundary:
        for last in range(dim - 1, corners.shape[1]):  # a quadrilateral counts as two triangles
            origin = corners[:, 0]
            edges = [corners[:, last - 1] - origin, corners[:, last] - origin] if dim == 3 else [corners[:, 1] - origin]
            matrix = np.stack([*edges, np.broadcast_to(-along, origin.shape)], axis=2)[:, :dim]
            matrix[np.abs(np.linalg.det(matrix)) == 0] = np.inf  # facets along the ray are not crossed
            with np.errstate(invalid="ignore"):
                found = np.linalg.solve(matrix, (point - origin)[:, :dim, None])[..., 0]
            where, far = found[:, :-1], found[:, -1]
            crossed += int(np.sum((far > 0) & np.all(where >= 0, axis=1) & (where.sum(axis=1) <= 1)))
    return crossed % 2 == 1


def _sample(corners: Array, normals: Array) -> tuple[Array, Array]:
    """Extreme points of a side in 26 directions; if it is not flat, also facets with extreme normals."""
    units = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    directions = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)]) + TILT
    k = corners.shape[1]
    reach = corners.reshape(-1, 3) @ directions.T
    ends = np.argmax(reach, axis=0)
    points, outward = corners.reshape(-1, 3)[ends], units[ends // k]
    if np.ptp(units, axis=0).max() > FLAT_SIDE:
        facing = np.argmax(units @ directions.T, axis=0)
        points = np.concatenate([points, corners.mean(axis=1)[facing]])
        outward = np.concatenate([outward, units[facing]])
    return points, outward


def _mesh_facets(gmsh: Gmsh, dim: int) -> None:
    """Mesh the boundary of the model coarsely."""
    size = float(np.linalg.norm(np.ptp(np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3)), axis=0)))
    for option in ("FromPoints", "ExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size / COARSE)
    gmsh.option.setNumber("Mesh.MeshSizeMin", size / (20 * COARSE))
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", ROUND)
    gmsh.model.mesh.generate(dim - 1)


def _exact_size(gmsh: Gmsh, dim: int, tag: int, unit: float) -> float | None:
    """Area or length of a CAD entity [m^2 or m]; None if the model has no CAD entities."""
    if (dim, tag) not in gmsh.model.occ.getEntities(dim):
        return None
    return float(gmsh.model.occ.getMass(dim, tag)) * unit**dim


def _corners(gmsh: Gmsh, dim: int, tag: int) -> Array:
    """Corners (f, k, 3) of an entity's elements; no rows if it has no elements, or elements of several kinds."""
    kinds, _, nodes = gmsh.model.mesh.getElements(dim, tag)
    if len(kinds) != 1:
        return np.zeros((0, dim + 1, 3))
    count, _, corners = gmsh.model.mesh.getElementProperties(kinds[0])[3:6]
    rows = np.reshape(nodes[0], (-1, count))[:, :corners].astype(np.int64)
    return nodes_at(gmsh, dim, tag, rows)
