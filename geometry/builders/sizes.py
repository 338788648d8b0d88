"""Mesh sizes that grow with the distance from where bodies touch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from geometry.protocols import Gmsh

GROWTH = 0.3  # of the cell size per distance from the contact


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
    for option in ("FromPoints", "FromCurvature", "ExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)


def cells_around(dim: int, fine: float, radius: float, coarse: float, reach: float) -> float:
    """Estimate how many cells fill half a disc (dim = 2) or half a ball (dim = 3) of radius `reach`.

    Their size is `fine` within `radius` and then grows up to `coarse`.

    >>> round(cells_around(2, 0.1, 1.0, 0.1, 1.0))  # half a disc of area pi / 2
    157
    """
    r = np.concatenate([np.linspace(0, radius, 200), np.geomspace(radius, reach, 2000)]) if radius else None
    r = np.linspace(0, reach, 20000) if r is None else r
    size = np.minimum(coarse, fine + GROWTH * np.maximum(r - radius, 0))
    return float(np.trapz(np.pi * (dim - 1) * r ** (dim - 1) / size**dim, r))


def graded(length: float, fine: float, coarse: float, ends: int) -> tuple[int, float]:
    """Number of cells along a line that has fine cells at one end or at both, and its grading coefficient.

    Args:
        ends: number of fine ends, 1 or 2.

    Returns:
        The coefficient is the ratio of neighbouring cells, or gmsh's bump coefficient if both ends are fine.
    """
    part = length / ends
    if part <= fine:
        return ends, 1.0
    ratio = 1 + GROWTH
    n = max(2, int(np.ceil(np.log1p(part / fine * GROWTH) / np.log(ratio))))
    n = max(n, int(np.ceil(part / coarse)))
    if n * fine >= part:
        return ends * n, 1.0
    ratio = brentq(lambda r: fine * (r**n - 1) / (r - 1) - part, 1 + 1e-9, 10.0)
    return (n, ratio) if ends == 1 else (2 * n, ratio ** (-n))
