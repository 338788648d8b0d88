"""Rigid motions of a body: translations and infinitesimal rotations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rigid_names(dim: int, axisymmetric: bool) -> list[str]:
    """The rigid motions, in the order of `rigid_fields`."""
    if axisymmetric:
        return ["translation along y"]
    turns = ["rotation"] if dim == 2 else [f"rotation about {axis}" for axis in "xyz"]
    return [f"translation along {axis}" for axis in "xyz"[:dim]] + turns


def rigid_fields(points: Array, centre: Array, size: float, axisymmetric: bool) -> Array:
    """Translations and infinitesimal rotations (m, d, k) at `points` (m, d), of comparable magnitude.

    Their number k is 3 in plane models, 6 in 3D, 1 in axisymmetric ones, where only the shift along the axis is rigid.

    >>> rigid_fields(np.array([[2.0, 0.0]]), np.zeros(2), 2.0, axisymmetric=False)[0]
    array([[ 1.,  0., -0.],
           [ 0.,  1.,  1.]])
    """
    m, d = points.shape
    x = (points - centre) / size
    translations = np.tile(np.eye(d), (m, 1, 1))
    if axisymmetric:
        return translations[:, :, 1:]
    if d == 2:
        return np.concatenate([translations, np.stack([-x[:, 1], x[:, 0]], axis=1)[:, :, None]], axis=2)
    rotations = np.stack([np.cross(axis, x) for axis in np.eye(3)], axis=2)
    return np.concatenate([translations, rotations], axis=2)
