"""Outline of a user's file, found before its volumes are meshed: names, bounding box, sample points of the sides."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, product

import numpy as np

from stickslip.geometry.arrays import CLOSE, EXACT, ROUNDING, STEPS, TINY, Array, Ints
from stickslip.geometry.curved_facets import curved, edge_middles, normals_of
from stickslip.geometry.errors import GeometryError, GluedError
from stickslip.geometry.mesh.gmsh_session import generate
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.user_files.parts import FACET_WORD, Parts, nodes_at
from stickslip.geometry.user_files.raw_mesh import RawMesh, facets_among, read_raw_mesh

COARSE = 8  # cells along the box's diagonal, for sampling and drawing
ROUND = 16  # cells on a full circle
KNOWN = ("Plane", "Cylinder", "Line", "Circle")  # gmsh's types of entities that facets' corners tell all about
CURVED, CHECKED = 10_000, 50  # facets of a face whose bulge is asked for, and of those that are checked, at most
STEEP = 0.5  # bulge of an edge of a facet relative to its length, at most; a half circle's
RAY = np.array([0.5377, 0.7217, 0.4359])  # direction that is unlikely to meet an edge
TILT = np.array([0.0131, 0.0073, 0.0037])  # decides between equal extremes, alike on opposite sides
DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)]) + TILT


@dataclass(frozen=True)
class Facets:
    """Facets of a gmsh entity (a face in 3D, an edge in 2D)."""

    number: int  # gmsh's tag
    name: str
    corners: Array  # (f, k, 3) [m]; their order makes normals point out of the first of `bodies`
    exact: float | None  # area or length [m^2 or m], if the CAD kernel gives it
    bodies: tuple[str, ...] = ()  # that it bounds; two where they are joined there
    between: Array | None = None  # (n, 3) [m] points between the corners, of a CAD face that is curved
    bulge: Array | None = None  # (f, e, 3) [m] see `curved`, of a CAD face that is no plane and no cylinder
    off: float = 0.0  # [m] how far curved facets are from the CAD kernel's face

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


@dataclass(frozen=True)
class Outline:
    """Names, box and sample points of a geometry; lengths in metres."""

    bodies: dict[str, tuple[str, ...]]  # body -> its sides
    box: Array  # (2, 3)
    volume: float  # [m^3], of a plane model area [m^2]; that of the box if the model does not say it
    entities: tuple[Facets, ...]
    samples: dict[str, tuple[Array, Array]]  # body.side -> points (k, 3), unit outward normals (k, 3)
    side_of: dict[int, str]  # tag of an entity -> its body.side
    shared: dict[tuple[str, str], Array] = field(default_factory=dict)  # two bodies -> points (n, 3) of both
    note: str = ""  # what was done to the cells of a mesh, in a line

    def skin(self, body: str) -> tuple[Array, Array]:
        """Sample points (k, 3) of all of a body's skin, and unit outward normals there."""
        return sample([face for face in self.entities if face.bodies == (body,)], body)

    @cached_property
    def forms(self) -> dict[int, Form]:
        """The form of each entity by its tag."""
        of = ((face, simplices([face.corners])) for face in self.entities)
        return {face.number: fit(corners, corners.shape[1], face.between, spheres=True) for face, corners in of}

    def times(self, factor: float, dim: int) -> Outline:
        """The same, its lengths multiplied by a factor: in another unit."""
        if factor == 1:
            return self
        side = factor ** (dim - 1)
        entities = (
            replace(
                face,
                corners=factor * face.corners,
                exact=face.exact and side * face.exact,
                between=None if face.between is None else factor * face.between,
                bulge=None if face.bulge is None else factor * face.bulge,
                off=factor * face.off,
            )
            for face in self.entities
        )
        samples = {name: (factor * points, normals) for name, (points, normals) in self.samples.items()}
        shared = {bodies: factor * points for bodies, points in self.shared.items()}
        box, volume = factor * self.box, factor**dim * self.volume
        return replace(self, box=box, volume=volume, entities=tuple(entities), samples=samples, shared=shared)


def read_outline(gmsh: Gmsh, dim: int, parts: Parts, unit: float) -> Outline:
    """Outline of the current gmsh model, whose facets are meshed coarsely if it has no mesh.

    Raises:
        GeometryError: the model has no boundary, or its mesh cannot be used.
    """
    meshed = len(gmsh.model.mesh.getElementTypes(dim)) > 0
    raw = read_raw_mesh(gmsh, dim, parts) if meshed else None
    if raw is None:
        _mesh_facets(gmsh, dim)
    entities = [int(tag) for _, tag in gmsh.model.getEntities(dim - 1)]
    corners = {tag: found for tag in entities if len(found := unit * _corners(gmsh, dim - 1, tag))}
    if raw is None:
        bodies, corners = _outward_of_cad(gmsh, dim, parts, corners)
    else:
        bodies, corners = _outward_of_mesh(gmsh, dim, raw, corners, unit)
    of = {
        tag: Facets(
            tag,
            gmsh.model.getEntityName(dim - 1, tag),
            found,
            _exact_size(gmsh, dim - 1, tag, unit),
            bodies[tag],
            *_curved_face(gmsh, dim - 1, tag, found, unit),
        )
        for tag, found in corners.items()
    }
    if raw is None and not of:
        raise GeometryError("has no boundary")
    samples = {side: sample(_faces(dim, side, tags, of), side.split(".")[0]) for side, tags in parts.sides.items()}
    points = unit * raw.points if raw else np.concatenate([f.corners.reshape(-1, 3) for f in of.values()])
    sides = {body: tuple(s.split(".")[1] for s in parts.sides if s.split(".")[0] == body) for body in parts.bodies}
    box = np.array([points.min(axis=0), points.max(axis=0)])
    side_of = {tag: side for side, tags in parts.sides.items() for tag in tags}
    exact = [_exact_size(gmsh, dim, tag, unit) for _, tag in gmsh.model.getEntities(dim)]
    volume = sum(size or np.inf for size in exact)
    volume = min(volume, float(np.prod(np.ptp(box, axis=0)[:dim])))
    if raw is None:
        rows = {tag: _nodes_of_facets(gmsh, dim - 1, tag).ravel() for tag in of}
        nodes = {body: [rows[tag] for tag in of if body in of[tag].bodies] for body in parts.bodies}
        shared = _shared(
            {body: np.concatenate(own) for body, own in nodes.items() if own}, lambda n: nodes_at(gmsh, -1, -1, n)
        )
    else:
        shared = _shared(raw.cells, lambda n: raw.points[n])
    shared = {bodies: unit * points for bodies, points in shared.items()}
    return Outline(sides, box, volume, tuple(of.values()), samples, side_of, shared, raw.note if raw else "")


def _shared(nodes: dict[str, Ints], at: Callable[[Ints], Array]) -> dict[tuple[str, str], Array]:
    """Return extreme ones (n, 3) of the nodes that two bodies have both, by the names of the two.

    Args:
        nodes: of each body.
        at: their places.
    """
    found = {}
    for one, other in combinations(nodes, 2):
        both = np.intersect1d(nodes[one], nodes[other])
        if len(both):
            points = at(both)
            found[one, other] = points[np.unique(np.argmax(points @ DIRECTIONS.T, axis=0))]
    return found


def _faces(dim: int, side: str, tags: list[int], of: dict[int, Facets]) -> list[Facets]:
    """The entities of a side, each on the boundary of its body alone."""
    body = side.split(".")[0]
    for tag in tags:
        if tag not in of or body not in of[tag].bodies:
            raise GeometryError(f"side {side}: {FACET_WORD[dim]} {tag} is not on the boundary of {body}")
        if len(of[tag].bodies) > 1:
            raise GluedError(
                f"side {side}: {FACET_WORD[dim]} {tag} lies inside, {' and '.join(of[tag].bodies)} share it"
            )
    return [of[tag] for tag in tags]


Oriented = tuple[dict[int, tuple[str, ...]], dict[int, Array]]  # bodies and corners of each entity, as in `Facets`


def _outward_of_mesh(gmsh: Gmsh, dim: int, raw: RawMesh, corners: dict[int, Array], unit: float) -> Oriented:
    """Each facet's normal points away from the cell behind it."""
    numbers = np.unique(np.asarray(gmsh.model.mesh.getElementsByType(raw.kind)[1], np.int64))
    middles = {body: raw.points[rows].mean(axis=1) for body, rows in raw.cells.items()}
    bodies: dict[int, tuple[str, ...]] = {}
    oriented: dict[int, Array] = {}
    for tag, x in corners.items():
        rows = _nodes_of_facets(gmsh, dim - 1, tag)
        known = np.where(
            np.isin(rows, numbers), np.searchsorted(numbers, rows), len(raw.points)
        )  # the last: of no cell
        wanted, place = np.unique(np.sort(known, axis=1), axis=0, return_inverse=True)
        behind, found = np.full((len(wanted), 3), np.nan), []
        for body, cells in raw.cells.items():
            facet, cell = facets_among(cells, raw.kind, wanted)
            found += [body] * bool(len(facet))
            new = np.isnan(behind[facet, 0])
            behind[facet[new]] = middles[body][cell[new]]
        bodies[tag] = tuple(found)
        away = np.einsum("fd,fd->f", x.mean(axis=1) - unit * behind[place.ravel()], normals_of(x))
        oriented[tag] = np.where((away < 0)[:, None, None], x[:, ::-1], x)
    return bodies, oriented


def _outward_of_cad(gmsh: Gmsh, dim: int, parts: Parts, corners: dict[int, Array]) -> Oriented:
    """Normals of an entity point outward if that of one of its large facets leads out of the part that it bounds.

    The sides of a closed crack bound different parts of a body.
    """
    bodies: dict[int, tuple[str, ...]] = dict.fromkeys(corners, ())
    oriented = dict(corners)
    for body, tags in parts.bodies.items():
        skin = gmsh.model.getBoundary([(dim, tag) for tag in tags], combined=True, oriented=False)
        for part in tags:
            boundary = gmsh.model.getBoundary([(dim, part)], combined=True, oriented=False)
            own = [tag for _, tag in boundary if tag in corners]
            shell = Shell([corners[tag] for tag in own], dim) if own else None
            for place, tag in enumerate(own):
                if shell is not None and (dim - 1, tag) in skin:
                    bodies[tag] += (body,)
                    if len(bodies[tag]) == 1 and not shell.outward(place):
                        oriented[tag] = corners[tag][:, ::-1]
    return bodies, oriented


class Shell:
    """A closed boundary of facets; a ray that begins outside it crosses an even number of them."""

    def __init__(self, boundary: list[Array], dim: int) -> None:
        """Facets (f, k, 3) of each entity; a quadrilateral counts as two triangles."""
        parts, facet = [], []
        for x in boundary:
            lasts = range(2, x.shape[1]) if dim == 3 else range(1)
            parts.append(np.concatenate([x[:, [0, last - 1, last]] if dim == 3 else x for last in lasts]))
            facet.append(np.tile(np.arange(len(x)), len(lasts)))
        self.boundary, self.dim = boundary, dim
        self.corners, self.facet = np.concatenate(parts)[..., :dim], np.concatenate(facet)
        self.entity = np.repeat(np.arange(len(parts)), [len(part) for part in parts])

    def outward(self, entity: int) -> bool:
        """Whether the normals of an entity point out of what the boundary encloses.

        The ray begins on the facet that is the largest as seen along it, and that facet itself is not counted: the
        body may be as thin as it likes.
        """
        corners, along = self.boundary[entity], RAY[: self.dim]
        seen = normals_of(corners)[:, : self.dim] @ along
        facet = int(np.argmax(np.abs(seen)))
        others = self.corners[(self.entity != entity) | (self.facet != facet)]
        (crossed,) = crossings(others, corners[facet].mean(axis=0)[None, : self.dim], along)
        return bool((np.count_nonzero(np.array(crossed) > 0) % 2 == 0) == (seen[facet] > 0))


def crossings(skin: Array, start: Array, direction: Array) -> list[list[float]]:
    """Return where whole lines through points (r, d) cross facets (f, d, d), in order: multiples of the direction."""
    across = np.linalg.svd(direction[None])[2][1:]  # a line is a point in this projection
    flat, along, at = skin @ across.T, skin @ direction / (direction @ direction), start @ across.T
    slack = ROUNDING * np.ptp(flat.reshape(-1, len(across)), axis=0)
    sides, low, high = flat[:, 1:] - flat[:, :1], flat.min(axis=1) - slack, flat.max(axis=1) + slack
    keep = np.all((high >= at.min(axis=0)) & (low <= at.max(axis=0)), axis=1)
    keep &= np.abs(np.linalg.det(sides)) > 0  # facets along the lines are not crossed
    flat, along, inverse = flat[keep], along[keep], np.linalg.inv(sides[keep])
    found = []
    for point, begin in zip(at, start @ direction / (direction @ direction), strict=True):
        where = np.einsum("fk,fkl->fl", point - flat[:, 0], inverse)
        hit = np.all(where >= 0, axis=1) & (where.sum(axis=1) <= 1)
        far = along[hit, 0] + np.einsum("fk,fk->f", where[hit], along[hit, 1:] - along[hit, :1]) - begin
        found.append(np.sort(far).tolist())
    return found


def simplices(faces: Iterable[Array]) -> Array:
    """Corners (f, d, 3) of all facets; a quadrilateral is two triangles."""
    parts = [x if x.shape[1] < 4 else np.concatenate([x[:, :3], x[:, [0, 2, 3]]]) for x in faces]
    return np.concatenate(parts)


def sample(of: Sequence[Facets], body: str) -> tuple[Array, Array]:
    """Extreme points of a side in 26 directions, of each of its faces if they are flat; else also extreme normals."""
    corners = simplices(face.corners if face.bodies[0] == body else face.corners[:, ::-1] for face in of)
    units = normals_of(corners)
    units /= np.linalg.norm(units, axis=1, keepdims=True)
    k = corners.shape[1]
    # a side is flat if the components of its unit normals differ by less
    faces, face = np.unique((units / CLOSE).round(), axis=0, return_inverse=True)
    flat = len(faces) <= len(DIRECTIONS)
    points, outward = [], []
    for facets in [np.flatnonzero(face.ravel() == n) for n in range(len(faces))] if flat else [np.arange(len(units))]:
        ends = np.argmax(corners[facets].reshape(-1, 3) @ DIRECTIONS.T, axis=0)
        points.append(corners[facets].reshape(-1, 3)[ends])
        outward.append(units[facets][ends // k])
    if not flat:
        facing = np.argmax(units @ DIRECTIONS.T, axis=0)
        points.append(corners.mean(axis=1)[facing])
        outward.append(units[facing])
    return np.concatenate(points), np.concatenate(outward)


def _mesh_facets(gmsh: Gmsh, dim: int) -> None:
    """Mesh the boundary of the model coarsely."""
    size = float(np.linalg.norm(np.ptp(np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3)), axis=0)))
    for option in ("FromPoints", "ExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size / COARSE)
    gmsh.option.setNumber("Mesh.MeshSizeMin", size / (20 * COARSE))
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", ROUND)
    generate(gmsh, dim - 1)


def _exact_size(gmsh: Gmsh, dim: int, tag: int, unit: float) -> float | None:
    """Area or length of a CAD entity [m^2 or m]; None if the model has no CAD entities."""
    if (dim, tag) not in gmsh.model.occ.getEntities(dim):
        return None
    return float(gmsh.model.occ.getMass(dim, tag)) * unit**dim


def _curved_face(
    gmsh: Gmsh, dim: int, tag: int, corners: Array, unit: float
) -> tuple[Array | None, Array | None, float]:
    """Return `between`, `bulge` and `off` of the facets (f, k, 3) of an entity; see `Facets`."""
    known = corners.shape[1] != dim + 1 or gmsh.model.getType(dim, tag) in KNOWN
    if known or (dim, tag) not in gmsh.model.occ.getEntities(dim):
        return None, None, 0.0

    from scipy.spatial import cKDTree  # late: it loads much else

    _, nodes, at = gmsh.model.mesh.getNodes(dim, tag, includeBoundary=True)
    _, place = cKDTree(unit * np.reshape(nodes, (-1, 3))).query(corners)
    parameters = np.reshape(at, (-1, dim))[place]

    def nearest(x: Array, guess: Array, far: Array) -> Array:
        """Return the points of the entity nearest to x (..., 3), of which parameters (..., dim) are guessed."""
        flat, first, same = np.unique(x.reshape(-1, 3), axis=0, return_index=True, return_inverse=True)
        found = _nearest(gmsh, dim, tag, flat / unit, guess.reshape(-1, dim)[first], far.ravel()[first] / unit)
        return np.asarray(unit * found[same.ravel()].reshape(x.shape))

    def bulge_of(rows: Ints) -> Array:
        x = corners[rows]
        middles = edge_middles(x)
        edges = x - np.roll(x, 1, axis=1) if dim == 1 else x[:, [1, 2, 0]] - x[:, [2, 0, 1]]
        far = STEEP * np.linalg.norm(edges, axis=2)[:, : middles.shape[1]]
        bulge = nearest(middles, edge_middles(parameters[rows]), far) - middles
        bulge[np.linalg.norm(bulge, axis=2) > far] = 0.0  # of another branch of the surface
        return bulge

    some = np.linspace(0, len(corners) - 1, min(CHECKED, len(corners))).astype(int)
    bulge = bulge_of(some)
    between = (edge_middles(corners[some]) + bulge)[np.any(bulge != 0, axis=2)]
    if len(corners) > CURVED or fit(corners, dim + 1, between).kind != "other":
        return between, None, 0.0
    at = np.tile([0.25, 0.75] if dim == 1 else [1 / 3, 1 / 3, 1 / 3], (len(some), 1))
    points, _ = curved(corners[some], bulge, at)
    guess = np.einsum("pk,pkd->pd", at, parameters[some])
    far = np.linalg.norm(bulge, axis=2).max(axis=1)
    off = float(np.linalg.norm(nearest(points, guess, far) - points, axis=1).max())
    return between, bulge if len(some) == len(corners) else bulge_of(np.arange(len(corners))), off


def _nearest(gmsh: Gmsh, dim: int, tag: int, x: Array, at: Array, far: Array) -> Array:
    """Return the points (n, 3) of a CAD entity nearest to x (n, 3), by the Gauss-Newton method.

    The CAD kernel's own search takes up to 3 ms a point on a swept surface, and is used where this one does not end: at
    rims and seams.

    Args:
        at: parameters (n, dim) to begin with.
        far: (n,) a point that is farther away is on another branch.
    """
    low, high = gmsh.model.getParametrizationBounds(dim, tag)
    found, open_ = np.empty_like(x), np.arange(len(x))
    for _ in range(STEPS):
        at = np.clip(at, low, high)
        found[open_] = np.reshape(gmsh.model.getValue(dim, tag, at.ravel()), (-1, 3))
        tangents = np.reshape(gmsh.model.getDerivative(dim, tag, at.ravel()), (-1, dim, 3))
        away = x[open_] - found[open_]
        step = np.einsum("nd,ndk->nk", away, np.linalg.pinv(tangents))
        more = np.linalg.norm(np.einsum("nk,nkd->nd", step, tangents), axis=1) > EXACT * np.ptp(x, axis=0).max()
        more |= np.linalg.norm(away, axis=1) > far[open_]
        open_, at = open_[more], (at + step)[more]
        if not len(open_):
            return found
    found[open_] = np.reshape(gmsh.model.getClosestPoint(dim, tag, x[open_].ravel())[0], (-1, 3))
    return found


def _corners(gmsh: Gmsh, dim: int, tag: int) -> Array:
    """Return the corners (f, k, 3) of an entity's elements; no rows if it has none."""
    rows = _nodes_of_facets(gmsh, dim, tag)
    return nodes_at(gmsh, dim, tag, rows) if len(rows) else np.zeros((0, dim + 1, 3))


def _nodes_of_facets(gmsh: Gmsh, dim: int, tag: int) -> Ints:
    """Return gmsh's tags (f, k) of the corners of an entity's elements, as in `_corners`."""
    kinds, _, nodes = gmsh.model.mesh.getElements(dim, tag)
    parts = [np.zeros((0, dim + 1), np.int64)] * (len(kinds) != 1)
    for kind, rows in zip(kinds, nodes, strict=True):
        count, _, corners = gmsh.model.mesh.getElementProperties(kind)[3:6]
        found = np.reshape(rows, (-1, count))[:, :corners].astype(np.int64)
        # where there are triangles too, a quadrilateral is two
        parts += [found] if len(kinds) == 1 or corners < 4 else [found[:, :3], found[:, [0, 2, 3]]]
    return np.concatenate(parts)


FLAT = 100.0  # a cylinder's radius, relative to the face, is less than this


@dataclass(frozen=True, eq=False)
class Form:
    """A plane (in 2D a line), a cylinder (an arc of a circle), a sphere, or another form, of which nothing is known."""

    kind: str  # plane, cylinder, sphere, other
    point: Array  # (3,) on the plane, on the axis, or the centre [m]
    axis: Array  # (3,) unit vector: the plane's outward normal, or the cylinder's axis; of a sphere any
    radius: float = 0.0  # [m]; negative: the body is outside, as of a bore
    size: float = 0.0  # of the face [m]

    def distance(self, x: Array) -> Array:
        """Distance (n,) [m] of points (n, 3), positive outside the body."""
        away = x - self.point
        if self.kind == "plane":
            return np.asarray(away @ self.axis)
        return np.asarray(np.sign(self.radius) * np.linalg.norm(self._across(away), axis=1) - self.radius)

    def onto(self, x: Array) -> Array:
        """The points of the form nearest to points (n, 3); of another form the points themselves."""
        if self.kind == "other":
            return x
        if self.kind == "plane":
            return np.asarray(x - self.distance(x)[:, None] * self.axis)
        across = self._across(x - self.point)
        long = np.maximum(np.linalg.norm(across, axis=1, keepdims=True), TINY)
        return np.asarray(x + across * (abs(self.radius) / long - 1))

    def normals(self, x: Array) -> Array:
        """Unit normals (n, 3) at points (n, 3) of a form that is known, outward."""
        if self.kind == "plane":
            return np.tile(self.axis, (len(x), 1))
        across = self._across(x - self.point) * np.sign(self.radius)
        return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), TINY))

    def same(self, other: Form) -> bool:
        """Whether both are one plane, cylinder or sphere, with the body on the same side."""
        if self.kind != other.kind or self.kind == "other":
            return False
        near = CLOSE * max(self.size, other.size)  # points lie on the form to this, relative to the face
        if self.kind != "sphere" and abs(abs(self.axis @ other.axis) - 1) > CLOSE:
            return False
        if self.kind == "plane":
            return bool(self.axis @ other.axis > 0 and abs(self.distance(other.point[None])[0]) < near)
        off = np.linalg.norm(self._across(other.point - self.point))
        return bool(off < near and abs(self.radius - other.radius) < near)

    def _across(self, away: Array) -> Array:
        """The part of vectors (..., 3) across the axis; from the centre of a sphere all of it."""
        return away if self.kind == "sphere" else away - np.asarray(away @ self.axis)[..., None] * self.axis


def fit(corners: Array, dim: int, between: Array | None = None, *, spheres: bool = False) -> Form:
    """The form on which facets (f, k, 3) with outward normals lie.

    Args:
        between: other points (n, 3) of the face, as a CAD kernel knows them: corners of a few facets lie on a plane or
            on a cylinder where a crowned face does not.
    """
    known = corners.reshape(-1, 3)
    nodes = np.unique(known if between is None else np.concatenate([known, between]), axis=0)
    normals = normals_of(corners)
    middle, size = nodes.mean(axis=0), float(np.ptp(nodes, axis=0).max())
    axis = np.append(_narrowest((nodes - middle)[:, :dim]), np.zeros(3 - dim))
    if np.abs((nodes - middle) @ axis).max() <= CLOSE * size:
        return Form("plane", middle, axis * np.sign(normals.sum(axis=0) @ axis or 1.0), size=size)
    other = Form("other", middle, axis, size=size)
    if len(nodes) < (8 if dim == 3 else 4):
        return other
    start = _narrowest(normals) if dim == 3 else np.array([0.0, 0.0, 1.0])
    across, kind = np.linalg.svd(start[None])[2][1:], "cylinder"
    if dim == 3:
        from scipy.optimize import least_squares  # late: it loads much else

        tilted = least_squares(
            lambda t: _circle(nodes - middle, start + t @ across)[2] / size,
            np.zeros(2),
            ftol=EXACT,
            xtol=EXACT,
            gtol=EXACT,
        )
        start = start + tilted.x @ across
    axis = start / np.linalg.norm(start)
    centre, radius, off = _circle(nodes - middle, axis)
    if spheres and dim == 3 and np.abs(off).max() > CLOSE * size:
        kind, (centre, radius, off) = "sphere", _circle(nodes - middle)
    if np.abs(off).max() > CLOSE * size or radius > FLAT * size:
        return other
    found = Form(kind, middle + centre, axis, radius, size)
    away = corners.mean(axis=1) - found.point
    outward = np.einsum("fd,fd->", found._across(away), normals)
    return replace(found, radius=radius * float(np.sign(outward)))


def _narrowest(x: Array) -> Array:
    """The direction (d,) in which vectors (n, d) are shortest; the triangle of QR is as small as d for any n."""
    return np.asarray(np.linalg.svd(np.linalg.qr(x, mode="r"))[2][-1])


def _circle(x: Array, axis: Array | None = None) -> tuple[Array, float, Array]:
    """Centre (3,), radius, and how far points (n, 3) are from it: of a circle as seen along an axis, or a sphere."""
    basis = np.eye(3) if axis is None else np.linalg.svd(axis[None])[2][1:]
    seen = x @ basis.T
    *centre, rest = np.linalg.lstsq(np.column_stack([2 * seen, np.ones(len(x))]), (seen**2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(rest + np.square(centre).sum(), 0.0)))
    return centre @ basis, radius, np.linalg.norm(seen - centre, axis=1) - radius
