"""The plane or the cylinder on which a face lies, found from points on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import CLOSE, TINY, Array
from stickslip.geometry.facets import normals_of

FLAT = 100.0  # a cylinder's radius, relative to the face, is less than this


@dataclass(frozen=True, eq=False)
class Form:
    """A plane (in 2D a line), a cylinder (in 2D an arc of a circle), or another form, of which nothing is known."""

    kind: str  # plane, cylinder, other
    point: Array  # (3,) on the plane or on the axis [m]
    axis: Array  # (3,) unit vector: the plane's outward normal, or the cylinder's axis
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
        """Unit normals (n, 3) at points (n, 3) of a plane or a cylinder, outward."""
        if self.kind == "plane":
            return np.tile(self.axis, (len(x), 1))
        across = self._across(x - self.point) * np.sign(self.radius)
        return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), TINY))

    def same(self, other: Form) -> bool:
        """Whether both are one plane or one cylinder, with the body on the same side."""
        if self.kind != other.kind or self.kind == "other":
            return False
        near = CLOSE * max(self.size, other.size)  # points lie on the form to this, relative to the face
        if abs(abs(self.axis @ other.axis) - 1) > CLOSE:
            return False
        if self.kind == "plane":
            return bool(self.axis @ other.axis > 0 and abs(self.distance(other.point[None])[0]) < near)
        off = np.linalg.norm(self._across(other.point - self.point))
        return bool(off < near and abs(self.radius - other.radius) < near)

    def _across(self, away: Array) -> Array:
        """The part of vectors (..., 3) across the axis."""
        return np.asarray(away - (away @ self.axis)[..., None] * self.axis)


def fit(corners: Array, dim: int, between: Array | None = None) -> Form:
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
    across = np.linalg.svd(start[None])[2][1:]
    if dim == 3:
        from scipy.optimize import least_squares  # late: it loads much else

        tilt = least_squares(lambda t: _circle(nodes - middle, start + t @ across)[2] / size, np.zeros(2)).x
        start = start + tilt @ across
    axis = start / np.linalg.norm(start)
    centre, radius, off = _circle(nodes - middle, axis)
    if np.abs(off).max() > CLOSE * size or radius > FLAT * size:
        return other
    found = Form("cylinder", middle + centre, axis, radius, size)
    away = corners.mean(axis=1) - found.point
    outward = np.einsum("fd,fd->", found._across(away), normals)
    return Form("cylinder", middle + centre, axis, radius * float(np.sign(outward)), size)


def _narrowest(x: Array) -> Array:
    """The direction (d,) in which vectors (n, d) are shortest; the triangle of QR is as small as d for any n."""
    return np.asarray(np.linalg.svd(np.linalg.qr(x, mode="r"))[2][-1])


def _circle(x: Array, axis: Array) -> tuple[Array, float, Array]:
    """Centre (3,), radius, and how far points (n, 3) are from it, of the circle as seen along an axis."""
    basis = np.linalg.svd(axis[None])[2][1:]
    seen = x @ basis.T
    solved = np.linalg.lstsq(np.column_stack([2 * seen, np.ones(len(x))]), (seen**2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(solved[2] + solved[:2] @ solved[:2], 0.0)))
    return solved[:2] @ basis, radius, np.linalg.norm(seen - solved[:2], axis=1) - radius
