"""Polygons of an overlay are cut into the same triangles whichever of their corners comes first."""

import numpy as np
import pytest

from stickslip.geometry.surfaces import clipping

POLYGON = np.array([[0.1, 0.1], [0.6, 0.05], [0.7, 0.2], [0.3, 0.6], [0.05, 0.4]])
AGAIN = POLYGON[[0, 1, 1, 2, 3, 4]]  # as clipping leaves a corner that lies on an edge: there twice


@pytest.mark.parametrize("first", range(6))
def test_triangles_do_not_depend_on_the_first_corner(first: int) -> None:
    _, parts = clipping._fan(np.roll(AGAIN, -first, axis=0)[None])
    _, expected = clipping._fan(POLYGON[None])
    found = sorted(np.sort(part, axis=0).tolist() for part in parts)
    assert found == sorted(np.sort(part, axis=0).tolist() for part in expected)
    assert len(found) == 3
