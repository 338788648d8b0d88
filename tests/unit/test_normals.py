"""Normals at nodes: smooth sides are averaged, a crease belongs to its larger side."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from stickslip.geometry.surfaces.surface import CREASE, Surface

Array = NDArray[np.float64]


def polyline(points: list[tuple[float, float]]) -> Surface:
    """Walked with the body to the right: outward is to the left."""
    number = np.arange(len(points))
    facets = np.column_stack([number[:-1], number[1:]])
    return Surface("interval", 1, number, number, np.array(points), facets, -np.ones(len(facets)), axisymmetric=False)


def tent(angle: float, depth: float) -> Surface:
    """Strips, 1 and 5 long, that meet at the ridge x = 0 with `angle` [degrees] between their normals."""
    a = np.radians(angle)
    x = [(-1.0, 0.0), (0.0, 0.0), (5 * np.cos(a), -5 * np.sin(a))]
    points = np.array([(u, y, z) for u, z in x for y in (0.0, depth)])
    facets = np.array([[0, 2, 1], [3, 1, 2], [2, 4, 3], [5, 3, 4]])
    number = np.arange(6)
    return Surface("triangle", 1, number, number, points, facets, np.ones(4), axisymmetric=False)


def smooth_normals(side: Surface) -> Array:
    return side.node_normals(side.smooth_part(CREASE))


def slope(angle: float) -> Array:
    return np.array([np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])


def test_ridge_belongs_to_its_larger_side() -> None:
    normals = smooth_normals(tent(90.0, 1.0))
    assert_allclose(normals, [slope(0)] * 2 + [slope(90)] * 4, atol=1e-12)
    whole = tent(90.0, 1.0).node_normals()
    assert whole[2, 0] > 0.1
    assert whole[2, 2] > 0.1  # between the two


@pytest.mark.parametrize(("angle", "smooth"), [(39.9, True), (40.1, False)])
def test_crease_begins_above_its_angle(angle: float, smooth: bool) -> None:
    side = tent(angle, 1.0)
    normals = smooth_normals(side)
    assert np.allclose(normals, side.node_normals()) == smooth
    assert np.allclose(normals[2], slope(angle)) == (not smooth)


def test_a_corner_at_the_angle_of_the_crease_does_not_jump_when_it_moves() -> None:
    side = tent(30.0, 1.0)
    moved, counting = replace(side, points=side.points * [1.0, 1.0, 1 + 1e-6]), side.smooth_part(30.0)
    assert counting.all()
    assert not moved.smooth_part(30.0).all()
    assert_allclose(moved.node_normals(counting), side.node_normals(counting), atol=1e-6)


def test_fine_fan_is_smooth_though_its_ends_are_not() -> None:
    # a cone's apex with 12 facets: neighbours differ by 29 degrees, opposite ones by 120
    turn = 2 * np.pi * np.arange(12) / 12
    height = 1 / np.tan(np.radians(30.0))
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(12)])
    points = np.concatenate([rim / height, [[0.0, 0.0, 1.0]]])
    facets = np.array([[12, i, (i + 1) % 12] for i in range(12)])
    cone = Surface("triangle", 1, np.arange(13), np.arange(13), points, facets, np.ones(12), axisymmetric=False)
    assert_allclose(smooth_normals(cone)[12], [0, 0, 1], atol=1e-12)


def test_of_equal_sides_the_first_has_the_corner_however_it_is_turned() -> None:
    # whichever way rounding goes
    for angle in np.linspace(0.0, 6.0, 50):
        c, s = np.cos(angle), np.sin(angle)
        side = polyline([(0.0, 0.0), (c, s), (c + s, s - c)])
        assert_allclose(smooth_normals(side), [[-s, c], [-s, c], [c, s]], atol=1e-12)
