"""Facets that are cut into cells keep their area and its moments."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.surfaces.cells import Cells, graded, uncovered
from stickslip.geometry.surfaces.surface import Surface

PLACES = {
    "interval": [[[0.0]], [[0.0], [1.0]], [[0.3]], [[0.0], [0.4]]],
    "triangle": [[[0, 0]], [[0, 0], [1, 0]], [[0, 0], [1, 0], [0, 1]], [[0.07, 0]], [[0.5, 0], [0.2, 0.3], [0, 0]]],
    "quadrilateral": [[[0, 0]], [[0, 0], [1, 0]], [[0, 0], [1, 1]], [[0.5, 0]], [[0.5, 0.2], [0.5, 0]]],
}


def facet(shape: str) -> Surface:
    local = dx.reference_nodes(shape, 1)
    numbers = np.arange(len(local))
    points = np.column_stack([local, np.zeros(len(local))])
    return Surface(
        shape=shape, degree=1, nodes=numbers, input=numbers, points=points, facets=numbers[None], outward=np.ones(1),
        axisymmetric=False,
    )  # fmt: skip


def moments(side: Surface, cells: Cells) -> np.ndarray:
    _, local, weights = cells.rule(side, 2)
    return weights @ np.column_stack([np.ones(len(local)), local, local**2])


def whole(side: Surface) -> np.ndarray:
    local, weights = dx.reference_rule(side.shape, 2)
    return weights @ np.column_stack([np.ones(len(local)), local, local**2])


@pytest.mark.parametrize(("shape", "places"), [(shape, each) for shape, them in PLACES.items() for each in them])
def test_cells_that_become_smaller_fill_their_facet_and_reach_each_place(shape: str, places: Any) -> None:
    side, at = facet(shape), np.array(places, float)
    cells = graded(side, np.zeros(len(at), np.int64), at)
    assert_allclose(moments(side, cells), whole(side), rtol=1e-8)
    local = cells.rule(side, 2)[1]
    assert np.linalg.norm(local - at[0], axis=1).min() < 1e-6 or len(at) > 1  # of two the edge between is reached


@pytest.mark.parametrize("shape", PLACES)
def test_what_is_covered_and_what_is_left_are_the_facet(shape: str) -> None:
    side = facet(shape)
    if shape == "interval":
        corners = np.array([[[0.1], [0.3]], [[0.3], [0.45]], [[0.8], [1.0]]])
    else:
        corners = np.array([[[0.1, 0.1], [0.4, 0.1], [0.1, 0.4]], [[0.4, 0.1], [0.4, 0.4], [0.1, 0.4]]])
    covered = Cells(np.zeros(len(corners), np.int64), np.zeros(len(corners), np.int64), corners)
    bare, left = uncovered(side, covered)
    assert not bare.any()
    assert_allclose(moments(side, covered) + moments(side, left), whole(side), rtol=1e-12)
    assert uncovered(side, covered[:0])[0].all()
