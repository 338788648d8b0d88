"""Mesh sizes: growing with the distance from where bodies touch, or given point by point, as error estimates do."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import EXACT, ROUNDING, TINY, Array, Ints
from stickslip.geometry.protocols import Gmsh

GROWTH = 0.3  # of the cell size per distance from the contact
SIMPLICES = {2: 2.3, 3: 8.0}  # of edge length 1 in a unit square and cube; gmsh's meshes have about so many


def beyond(radius: float, distance: str) -> str:
    """gmsh formula of max(distance - radius, 0).

    Args:
        distance: a formula in x, y and z.

    >>> beyond(2.0, "Abs(x)")
    '(0.5*(Abs(x)-2+Abs(Abs(x)-2)))'
    """
    return f"(0.5*({distance}-{radius:.17g}+Abs({distance}-{radius:.17g})))"


def norm(*terms: str) -> str:
    """gmsh formula of the length of a vector whose components are these formulas.

    >>> norm("x", "y")
    'Sqrt((x)*(x)+(y)*(y))'
    """
    return f"Sqrt({'+'.join(f'({term})*({term})' for term in terms)})"


def grow(gmsh: Gmsh, coarse: float, near: Sequence[tuple[float, str]]) -> None:
    """Set the mesh size to min(coarse, fine + GROWTH * distance) over all pairs (fine, distance) of `near`.

    Args:
        coarse: largest cell size, in the model's unit.
        near: cell size at distance zero, and the formula of the distance.
    """
    field = gmsh.model.mesh.field
    tags = []
    for formula in (f"{coarse:.17g}", *(f"{fine:.17g} + {GROWTH} * {distance}" for fine, distance in near)):
        tags.append(field.add("MathEval"))
        field.setString(tags[-1], "F", formula)
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", tags)
    field.setAsBackgroundMesh(least)
    _only_by_field(gmsh)


def _only_by_field(gmsh: Gmsh) -> None:
    """Have gmsh take mesh sizes from the background field alone."""
    for option in ("FromPoints", "FromCurvature", "ExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)


def cells_around(dim: int, fine: float, radius: float, coarse: float, reach: float) -> float:
    """Estimate how many cells fill half a disc (dim = 2) or half a ball (dim = 3) of radius `reach`.

    Their size is `fine` within `radius` and then grows up to `coarse`.

    >>> round(cells_around(2, 0.1, 1.0, 0.1, 1.0))  # half a disc of area pi / 2
    157
    """
    from scipy.integrate import trapezoid  # late: it loads much else

    r = np.concatenate([np.linspace(0, radius, 200), np.geomspace(radius, reach, 2000)]) if radius else None
    r = np.linspace(0, reach, 20000) if r is None else r
    size = np.minimum(coarse, fine + GROWTH * np.maximum(r - radius, 0))
    return float(trapezoid(np.pi * (dim - 1) * r ** (dim - 1) / size**dim, r))


def filled(volume: float, size: float, dim: int) -> float:
    """About how many simplices of an edge length fill a volume (an area if dim = 2)."""
    return SIMPLICES[dim] * _over(volume, size, dim)


def refined_near(area: float, depth: float, fine: float, coarse: float, dim: int) -> float:
    """About how many simplices more there are if they grow from `fine` at a side of this area (length if dim = 2).

    >>> round(refined_near(1.0, 1.0, 0.001, 0.1, 2))  # the integral of SIMPLICES / size**2, less those of `coarse`
    7514
    """
    far = min(depth, (coarse - fine) / GROWTH)
    near = (_over(1.0, fine, dim - 1) - _over(1.0, fine + GROWTH * far, dim - 1)) / (GROWTH * (dim - 1))
    return SIMPLICES[dim] * area * max(0.0, near - _over(far, coarse, dim))


def _over(number: float, size: float, times: int) -> float:
    """number / size**times; a power of a small size would be 0, and that of a large one fail."""
    for _ in range(times):
        number /= size
    return number


def graded_count(length: float, fine: float, coarse: float, ends: int) -> float:
    """Number of cells along a line as from `graded`, not rounded."""
    part = length / ends
    return ends * max(1.0, math.log1p(part / fine * GROWTH) / math.log(1 + GROWTH), part / coarse)


def graded(length: float, fine: float, coarse: float, ends: int) -> tuple[int, float]:
    """Number of cells along a line that has fine cells at one end or at both, and its grading coefficient.

    Args:
        ends: number of fine ends, 1 or 2.

    Returns:
        The coefficient is the ratio of neighbouring cells, or gmsh's bump coefficient if both ends are fine.
    """
    from scipy.optimize import brentq  # late: it loads much else

    part = length / ends
    if part <= fine:
        return ends, 1.0
    ratio = 1 + GROWTH
    n = max(2, int(np.ceil(np.log1p(part / fine * GROWTH) / np.log(ratio))))
    n = max(n, int(np.ceil(part / coarse)))
    if n * fine >= part:
        return ends * n, 1.0
    ratio = brentq(lambda r: fine * (r**n - 1) / (r - 1) - part, 1 + ROUNDING, 10.0)
    return (n, ratio) if ends == 1 else (2 * n, ratio ** (-n))


USUAL = {2: np.sqrt(3) / 4, 3: 0.2}  # mean volume of gmsh's cells for a size of 1; a regular tetrahedron's is .118
LIST = {3: "ST", 4: "SS"}  # gmsh's names of list data on triangles and tetrahedra, by their corners


@dataclass(frozen=True, eq=False)
class SizeField:
    """Edge lengths on the cells of an earlier mesh, linear in each."""

    points: Array  # (n, d) [m]
    cells: Ints  # (c, d+1) triangles or tetrahedra
    sizes: Array  # (n,) [m]

    def in_units_of(self, unit: float) -> SizeField:
        """All lengths divided by `unit` [m]."""
        return replace(self, points=self.points / unit, sizes=self.sizes / unit)

    def times(self, factor: float) -> SizeField:
        """All edges `factor` times as long."""
        return replace(self, sizes=factor * self.sizes)

    def impose(self, gmsh: Gmsh) -> None:
        """Make it the only rule for sizes in the current gmsh model, in its unit; grids become free meshes."""
        gmsh.model.mesh.removeConstraints()
        _only_by_field(gmsh)
        points, sizes, cells = self._with_layer()
        corners = np.zeros((*cells.shape, 3))
        corners[:, :, : points.shape[1]] = points[cells]
        data = np.concatenate([corners.transpose(0, 2, 1).reshape(len(corners), -1), sizes[cells]], axis=1)
        view = gmsh.view.add("sizes")
        gmsh.view.addListData(view, LIST[self.cells.shape[1]], len(data), data.ravel().tolist())
        field = gmsh.model.mesh.field.add("PostView")
        gmsh.model.mesh.field.setNumber(field, "ViewTag", view)
        gmsh.model.mesh.field.setAsBackgroundMesh(field)

    def _with_layer(self) -> tuple[Array, Array, Ints]:
        """Points, sizes and cells with a layer of more outside, as high as curved sides bulge beyond straight facets.

        gmsh knows no size outside of all cells: there it takes the largest of all.
        """
        d = self.points.shape[1]
        facets = np.concatenate([np.delete(self.cells, k, axis=1) for k in range(d + 1)])
        _, first, count = np.unique(np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True)
        first = first[count == 1]
        facets, inner = np.sort(facets[first], axis=1), self.cells.T.ravel()[first]
        edges = self.points[facets[:, 1:]] - self.points[facets[:, :1]]
        normal = edges[:, 0, ::-1] * [1, -1] if d == 2 else np.cross(edges[:, 0], edges[:, 1])
        inwards = np.einsum("fd,fd->f", normal, self.points[inner] - self.points[facets[:, 0]])
        normal *= -(np.sign(inwards) / np.linalg.norm(normal, axis=1))[:, None]
        length = np.linalg.norm(edges, axis=2).max(axis=1)
        mean, height = np.zeros_like(self.points), np.zeros(len(self.points))
        np.add.at(mean, facets, normal[:, None])
        mean /= np.maximum(np.linalg.norm(mean, axis=1), TINY)[:, None]
        turned = np.linalg.norm(mean[facets] - normal[:, None], axis=2)  # half of that from facet to facet
        np.maximum.at(height, facets, length[:, None] * turned / 2)  # twice the height of an arc over its chord
        outer = facets + len(self.points)
        layer = np.concatenate([np.concatenate([facets[:, k:], outer[:, : k + 1]], axis=1) for k in range(d)])
        points = np.concatenate([self.points, self.points + height[:, None] * mean])
        thick = volumes(points, layer) > EXACT * np.tile(length, d) ** d
        return points, np.tile(self.sizes, 2), np.concatenate([self.cells, layer[thick]])

    def smooth(self) -> SizeField:
        """The largest sizes below these that grow by no more than GROWTH per distance.

        Where bodies touch in a single node, its neighbours are as far from there as the old cells are long: the next
        contact lies between them.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import dijkstra

        n, corners = len(self.points), range(self.cells.shape[1])
        a, b = np.concatenate([self.cells[:, pair] for pair in itertools.combinations(corners, 2)]).T
        grown = GROWTH * np.linalg.norm(self.points[a] - self.points[b], axis=1)
        start, away = np.concatenate([a, np.full(n, n)]), np.concatenate([b, np.arange(n)])
        _, first = np.unique(np.sort([start, away], axis=0), axis=1, return_index=True)  # entries twice would add up
        lengths = np.concatenate([grown, self.sizes])
        edges = coo_array((lengths[first], (start[first], away[first])), shape=(n + 1, n + 1))
        return replace(self, sizes=dijkstra(edges.tocsr(), directed=False, indices=n)[:n])

    def cell_count(self) -> float:
        """About how many cells the mesh will have."""
        d = self.points.shape[1]
        wanted = self.sizes[self.cells].mean(axis=1)
        return float(np.sum(volumes(self.points, self.cells) / (USUAL[d] * wanted**d)))


def volumes(points: Array, cells: Ints) -> Array:
    """Volumes (c,) [m^d] of triangles or tetrahedra."""
    sides = points[cells[:, 1:]] - points[cells[:, :1]]
    return np.asarray(np.abs(np.linalg.det(sides)) / {2: 2, 3: 6}[points.shape[1]])


def adapted(points: Array, cells: Ints, error: Array, factor: float, order: int = 1) -> SizeField:
    """Sizes with which all cells have the same error, and all of it together is `factor` times what it was.

    A cell's error falls with the power `order` of its size: of all sizes with that sum, these need the fewest cells.

    Args:
        points, cells: triangles or tetrahedra of the present mesh.
        error: (c,) of each cell, in the energy norm; its square adds up.
        factor: of the error of all cells.
        order: of the next mesh.
    """
    d, volume = points.shape[1], volumes(points, cells)
    size = (volume / USUAL[d]) ** (1 / d)
    error = np.maximum(error, EXACT * error.max(initial=TINY))
    power = 1 / (order + d / 2)
    share = 2 * order * power
    level = (factor**2 * np.sum(error**2) / np.sum(error ** (2 - share))) ** (1 / share)
    wanted = size * np.clip((level / error) ** power, 0.125, 2.0)  # more from one mesh to the next is not trusted
    # a node takes the mean of its cells, in the logarithm
    node = cells.ravel()
    count = np.maximum(np.bincount(node, minlength=len(points)), 1)
    logs = np.bincount(node, np.repeat(np.log(wanted), cells.shape[1]), len(points)) / count
    return SizeField(points, cells, np.exp(logs))
