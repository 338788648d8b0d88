"""Inverses of many small matrices, beside LAPACK's."""

import numpy as np
import pytest

from stickslip.geometry.arrays import inverse_and_determinant, inverses


@pytest.mark.parametrize("order", [2, 3])
def test_inverses_are_those_of_lapack(order):
    given = np.random.default_rng(order).standard_normal((50, order, order))
    given[0] = np.diag(10.0 ** np.arange(order) * 1e-9)  # of metres and micrometres, newtons and meganewtons
    given[1] = np.diag([1.0] + [1e12] * (order - 1))
    wanted = np.linalg.inv(given)

    found = inverses(given)
    assert np.allclose(found @ given, np.eye(order), rtol=0, atol=1e-9)
    assert np.all(np.abs(found - wanted) <= 1e-10 * np.linalg.norm(wanted, axis=(1, 2))[:, None, None])

    by_cofactors, determinant = inverse_and_determinant(np.moveaxis(given, 0, -1))
    assert np.array_equal(np.moveaxis(by_cofactors, -1, 0), found)
    assert np.allclose(determinant, np.linalg.det(given), rtol=1e-9, atol=0)
