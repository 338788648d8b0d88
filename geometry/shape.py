"""Interface of a geometry, builder or user's file: its names and sides before any mesh exists, and its gmsh model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Self, cast

import numpy as np

from stickslip.geometry.arrays import LAST_DIGITS, Array, Ints, cross
from stickslip.geometry.curved_facets import Bulging, find_bulging, find_edges
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.mesh_sizes import SizeField
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.units import Units

MOST_CELLS = 50_000_000
BYTES, SECONDS = 1500, 1e-4  # of a cell in gmsh and dolfinx, measured: 600 to 1600 bytes, 8 to 100 microseconds
SIZES = ("edge_mesh_size", "contact_mesh_size", "lower_mesh_size", "inner_mesh_size")  # besides `mesh_size`
SKIN = "*"  # name of the side that is all of a body's skin
Model = Literal["plane strain", "plane stress", "axisymmetric", "3d"]


def dimensions(model: Model) -> int:
    """Number of space dimensions of a model."""
    return 3 if model == "3d" else 2


@dataclass(frozen=True, kw_only=True)
class Turn:
    """Turn about an axis, right-handed, that takes one side of a cyclic sector to the other; in the plane about z."""

    angle: float  # in degrees
    point: tuple[float, ...]  # of the axis [m]
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)

    def matrix(self, dim: int) -> Array:
        """By which displacements turn (d, d)."""
        from scipy.spatial.transform import Rotation  # late: it loads much else

        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        found = Rotation.from_rotvec(np.radians(self.angle) * axis).as_matrix()
        found[np.abs(found) < LAST_DIGITS] = 0.0  # of right angles
        return np.asarray(found[:dim, :dim])

    def of(self, points: Array, motion: Array) -> Array:
        """Angles (m,) in degrees by which a motion (m, d) [m] turns points (m, d) [m]."""
        d, axis = points.shape[1], np.array(self.axis) / np.linalg.norm(self.axis)
        x = points - self.point[:d]
        if d == 3:
            x, motion = (v - np.outer(v @ axis, axis) for v in (x, motion))
        turn = cross(x, x + motion)
        sine, cosine = turn @ axis if d == 3 else turn, np.einsum("md,md->m", x, x + motion)
        return np.asarray(np.degrees(np.arctan2(sine, cosine)))

    def moved(self, points: Array) -> Array:
        """Points (m, d) [m] on the other side."""
        d = points.shape[1]
        return np.asarray((points - self.point[:d]) @ self.matrix(d).T + self.point[:d])


@dataclass(frozen=True, kw_only=True)
class Request:
    """Requirements of a scene for its mesh beyond the shape itself; sides are named body.side."""

    model: Model
    contact_sides: tuple[str, ...] = ()  # sides to refine to `contact_mesh_size`
    facing: tuple[tuple[str, str], ...] = ()  # of them pairs that need it only where they are close to each other
    periodic: tuple[tuple[str, str], ...] = ()  # pairs of sides whose meshes must match
    turns: Mapping[str, Turn] = field(default_factory=dict)  # of them cyclic ones, by the first side
    sizes: SizeField | None = None  # instead of the shape's own mesh sizes

    @property
    def dim(self) -> int:
        return dimensions(self.model)

    @property
    def sectors(self) -> tuple[Turn, ...]:
        """Turns to the sectors on both sides of a cyclic one; none of another body."""
        first = next(iter(self.turns.values()), None)
        if first is None:
            return ()
        return (first,) if abs(first.angle) == 180 else (first, replace(first, angle=-first.angle))

    def refuse_other_sectors(self) -> None:
        """
        Raises:
            SceneError: sectors differ, so that bodies of one lie elsewhere in those of the other.
        """
        at = np.vstack([np.zeros(self.dim), np.eye(self.dim)])
        for side, turn in self.turns.items():
            if not any(np.allclose(turn.moved(at), known.moved(at)) for known in self.sectors):
                angles = f"{self.sectors[0].angle:g} and {turn.angle:g} degrees, or about two axes"
                raise SceneError(f"periodic: {side} turns as no other side, {angles}; bodies that touch turn alike")

    @property
    def turned(self) -> Array:
        """By which displacements turn to each sector (s, d, d), this one first, see `sectors`."""
        return np.stack([np.eye(self.dim), *(turn.matrix(self.dim) for turn in self.sectors)])


def apart(one: Array, other: Array) -> float:
    """Distance [m] of two bodies at least, whose boxes are those of `Shape.boxes`."""
    a, b = one[:, None], other[None]
    between = np.maximum(np.maximum(a[:, :, 0] - b[:, :, 1], b[:, :, 0] - a[:, :, 1]), 0.0)
    return float(np.linalg.norm(between, axis=2).min())


class Shape:
    """A geometry, in the scene's unit of length. `dim` (2 or 3) is that of the model; shapes may differ in 2D and 3D.

    Any of these methods may raise a GeometryError or SceneError if the shape cannot be what the scene says.
    """

    @property
    def degree(self) -> int:
        """Polynomial degree of displacement and geometry, 1 or 2."""
        raise NotImplementedError

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        """Names of the bodies and of each body's sides."""
        raise NotImplementedError

    def measured_in(self, units: Units) -> Self:
        """The shape in the length unit of the scene's units; all shapes are, but files with a unit of their own.

        Raises:
            SceneError: of the two units one is not known.
        """
        return self

    def check_model(self, model: Model) -> None:
        """Raise SceneError for a parameter that the model does not have, or that it needs and that is missing."""
        raise NotImplementedError

    def box(self, dim: int) -> Array:
        """Lower and upper corner of the bounding box (2, d) [m]."""
        raise NotImplementedError

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        """Sample points (k, d) [m] of a side (named body.side) and the unit outward normals there (k, d).

        They include the corners and extreme points of the side; opposite periodic sides list them in the same order.
        """
        raise NotImplementedError

    def meeting(self, one: str, other: str, reach: float, dim: int) -> tuple[Array, Array]:
        """Sample points (k, d) [m] of a side, and normals, where it has another one within reach [m]; or all."""
        return self.sample(one, dim)

    def skin(self, body: str, dim: int) -> tuple[Array, Array]:
        """Sample points of all of a body's skin, and normals, as of a side."""
        samples = [self.sample(f"{body}.{side}", dim) for side in self.bodies(dim)[body]]
        points, normals = (np.concatenate(each) for each in zip(*samples, strict=True))
        return points, normals

    def boxes(self, body: str, dim: int) -> Array:
        """Lower and upper corners (b, 2, d) [m] of the boxes of all that a body's skin is made of."""
        samples = [self.sample(f"{body}.{side}", dim)[0] for side in self.bodies(dim)[body]]
        return np.array([[points.min(axis=0), points.max(axis=0)] for points in samples])

    def shared(self, dim: int) -> Mapping[tuple[str, str], Array]:
        """Points (n, d) [m] where two bodies have the same nodes and hold each other, by the names of the two."""
        return {}

    def note(self, dim: int) -> str:
        """What was done to the cells of a mesh, in a line; "": nothing."""
        return ""

    def refined(self, factor: float) -> Self:
        """The same shape with cells `factor` times as long.

        Raises:
            SceneError: the scene has no mesh size that could be changed.
        """
        raise SceneError("mesh_size: cells that were made of others have none that could be changed")

    def of_order(self, order: int) -> Self:
        """The same shape with cells of a degree, 1 or 2."""
        return cast(Self, replace(cast(Any, self), order=order))

    def refuse_sizes(self, request: Request) -> None:
        """Refuse cells of given sizes, see `Request.sizes`, where they cannot be made; by default they can.

        Raises:
            SceneError: why not.
        """

    def cell_count(self, request: Request) -> float:
        """About how many cells the mesh will have; 0 if the mesh sizes are not the scene's."""
        raise NotImplementedError

    def meshing_time(self, request: Request) -> float:
        """About how long gmsh takes [s]."""
        with np.errstate(all="ignore"):
            return float(self.cell_count(request)) * SECONDS

    def refuse_too_large(self, request: Request, free: float = np.inf) -> None:
        """Refuse a mesh that is too large, by the key that makes it so; called before gmsh starts.

        Args:
            free: memory that it may take [bytes].

        Raises:
            SceneError: key, size, number of cells, what they need.
        """
        with np.errstate(all="ignore"):  # sizes of 1e-300 m make infinitely many
            count = float(self.cell_count(request))
            memory, time = count * BYTES, count * SECONDS
            if count < MOST_CELLS and memory < free and time < 3600.0:
                return
            key = next(
                (key for key in self._sizes() if self._without(key).cell_count(request) < count / 2), "mesh_size"
            )
        expected = f"makes more than {MOST_CELLS} cells"
        if count < MOST_CELLS:
            expected = f"makes about {count:.2g} cells; gmsh would take "
            expected += f"about {time / 60:.0f} minutes" if memory < free else _gigabytes(memory, free)
        require(False, key, getattr(self, key), f"{expected}; use a larger size")

    def _sizes(self) -> tuple[str, ...]:
        """The keys of mesh sizes that are given and may be left out, the finest first."""
        return tuple(key for key in SIZES if getattr(self, key, None) is not None)

    def _without(self, key: str) -> Shape:
        found: Shape = replace(cast(Any, self), **{key: None})
        return found

    def put(self, gmsh: Gmsh, request: Request) -> float:
        """Put the shape, its mesh sizes and its named physical groups into the current gmsh model, and mesh it.

        Bodies are physical groups of cells, sides are groups of facets named body.side. The mesh may have degree 1;
        the caller raises it to `degree`.

        Returns:
            Length of the gmsh model's unit [m].
        """
        raise NotImplementedError

    def bulging(self, gmsh: Gmsh, dim: int, unit: float) -> Bulging:
        """Find by how much curved surfaces bulge out of the facets of the current gmsh model, after `put`.

        Args:
            unit: length of the gmsh model's unit [m].
        """
        return find_bulging(gmsh, dim, unit)

    def edges(self, gmsh: Gmsh, sides: Mapping[str, Sequence[int]], dim: int) -> Mapping[str, Ints]:
        """Find the edges of sides in the current gmsh model, after `put`; see `find_edges`."""
        return find_edges(gmsh, dim, sides)


def skins(gmsh: Gmsh, dim: int, bodies: Mapping[str, Sequence[int]]) -> dict[str, list[int]]:
    """Entities of each body's skin, as body.*, without those that two bodies share.

    A body of a mesh whose entities tell no boundary is left out.
    """
    found = {
        body: {int(t) for _, t in gmsh.model.getBoundary([(dim, tag) for tag in tags], combined=True, oriented=False)}
        for body, tags in bodies.items()
    }
    times = Counter(tag for tags in found.values() for tag in tags)
    return {f"{body}.{SKIN}": sorted(t for t in tags if times[t] == 1) for body, tags in found.items() if tags}


def _gigabytes(needed: float, free: float) -> str:
    return f"about {needed / 1e9:.2g} GB of memory, and {free / 1e9:.2g} GB are free"
