"""Cell sizes that grow away from where bodies touch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import brentq

GROWTH = 0.3  # growth of the cell size per unit of distance from a contact


def beyond(radius: float, distance: str) -> str:
    """Formula of how far a point lies out of a ball, or whatever `distance` is measured from; zero inside.

    >>> beyond(2.0, "Abs(x)")
    '(0.5*(Abs(x)-2+Abs(Abs(x)-2)))'
    """
    return f"(0.5*({distance}-{radius:.17g}+Abs({distance}-{radius:.17g})))"


def norm(*terms: str) -> str:
    """Formula of the length of a vector with these components.

    >>> norm("x", "y")
    'Sqrt((x)*(x)+(y)*(y))'
    """
    return f"Sqrt({'+'.join(f'({term})*({term})' for term in terms)})"


def grow(gmsh: Any, coarse: float, near: Sequence[tuple[float, str]]) -> None:
    """Cells of size `coarse`, and of the size given where one of the distances of `near`, a formula, is zero."""
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
    """About how many cells fill half a ball of radius `reach` if they are `fine` within `radius` and then grow.

    >>> round(cells_around(2, 0.1, 1.0, 0.1, 1.0))  # half a disc of area pi / 2
    157
    """
    r = np.concatenate([np.linspace(0, radius, 200), np.geomspace(radius, reach, 2000)]) if radius else None
    r = np.linspace(0, reach, 20000) if r is None else r
    size = np.minimum(coarse, fine + GROWTH * np.maximum(r - radius, 0))
    return float(np.trapz(np.pi * (dim - 1) * r ** (dim - 1) / size**dim, r))


def graded(length: float, fine: float, coarse: float, ends: int) -> tuple[int, float]:
    """Number of cells along a line that is fine at `ends` of its ends, and the ratio of neighbours.

    With two ends the ratio is gmsh's bump coefficient.
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
