"""How a slave surface sees what it may touch, whatever the operator: weights, relative displacement, gap, normals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.arrays import Array, Bools
from geometry.surfaces.surface import Surface


@dataclass(frozen=True)
class Points:
    """q points of the slave surface at which a compliance pressure is a function of displacement."""

    weights: Array  # (q,) [m^(d-1)]
    relative: Any  # (q, n + n_master) sparse: nodal displacements of both sides to relative displacement
    gap: Array  # (q,) [m]
    normals: Array  # (q, d)
    psi: Any  # (n, q) sparse: ∫ psi_j of a field, by slave node


@dataclass(frozen=True)
class Coupling:
    """n nodes of the slave surface, n_master of the other (0 if it is a rigid obstacle), basis phi~ of `Surface`."""

    surface: Surface
    master: Surface | None
    weights: Array  # (n,) ∫ phi~_j over the part that faces the other side, and what neighbours hand over; >= 0
    relative: Any  # (n, n + n_master) sparse: nodal displacements of both sides to relative displacement
    gap: Array  # (n,) [m]
    normals: Array  # (n, d) unit, towards the other side, half way between both sides' own
    carries: Bools  # (n,) nodes with a multiplier of their own; others hand theirs to neighbours
    points: Callable[[int], Points]  # for a quadrature degree


def between(own: Array, other: Array, gap: Array) -> tuple[Array, Array]:
    """Unit normals (m, d) half way between those of two sides, and the gaps (m,) along `own` as they see them.

    Neither side is preferred: equal bodies pressed against each other do not shear where they touch. Where nothing
    faces a point its `other` is 0.

    >>> tilted = np.array([[0.6, -0.8]])
    >>> normals, gap = between(tilted, np.array([[0.6, 0.8]]), np.array([0.5]))
    >>> normals.tolist(), gap.tolist()
    ([[0.0, -1.0]], [0.4])
    """
    normals = own - other
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, gap * np.einsum("md,md->m", own, normals)
