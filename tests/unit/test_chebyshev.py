"""Chebyshev's iteration: the errors of its sweeps are those of its polynomials."""

import numpy as np
from numpy.testing import assert_allclose

from stickslip.solvers.tangent.operator import chebyshev


def test_errors_are_those_of_the_polynomial() -> None:
    low, high, count = 0.1, 2.0, 6
    eigenvalues = np.linspace(0.05, 2.05, 41)
    x, more = np.zeros((2, len(eigenvalues)))
    for again, share in chebyshev(low, high, count):
        more = again * more + share * (1 - eigenvalues * x)
        x = x + more
    polynomial = np.polynomial.chebyshev.Chebyshev.basis(count)
    expected = polynomial((high + low - 2 * eigenvalues) / (high - low)) / polynomial((high + low) / (high - low))
    assert_allclose(1 - eigenvalues * x, expected, atol=1e-12)
