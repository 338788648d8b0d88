"""The motions of a rigid body as displacement fields."""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import Array


def rigid_names(dim: int, axisymmetric: bool) -> list[str]:
    """Names of the k rigid modes, in the order of `rigid_fields`."""
    if axisymmetric:
        return ["translation along y"]
    turns = ["rotation"] if dim == 2 else [f"rotation about {axis}" for axis in "xyz"]
    return [f"translation along {axis}" for axis in "xyz"[:dim]] + turns


def rigid_fields(points: Array, centre: Array, size: float, axisymmetric: bool) -> Array:
    """Rigid modes (translations and infinitesimal rotations) at given points, of comparable magnitude.

    Their number k is 3 in plane models, 6 in 3D, and 1 in axisymmetric ones, where only the translation along the axis
    is rigid.

    Args:
        points: (m, d) [m].
        centre: (d,) [m], point about which the bodies rotate.
        size: [m], length by which distances are divided.
        axisymmetric: whether the model is.

    Returns:
        Fields (m, d, k), without unit.

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


def parts_of_motion(z: Array, dim: int) -> tuple[Array, Array]:
    """Translation (d,) and rotation, (1,) in 2D and (3,) in 3D, of components (k,); also force and moment.

    >>> parts_of_motion(np.array([1.0, 2.0, 3.0]), 2)
    (array([1., 2.]), array([3.]))
    """
    if len(z) == 1:  # axisymmetric
        return np.array([0.0, z[0]]), np.zeros(1)
    return z[:dim], z[dim:]
