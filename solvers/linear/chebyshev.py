"""Chebyshev's iteration: sweeps whose errors are small over an interval of eigenvalues, without scalar products.

Source: Saad, Iterative Methods for Sparse Linear Systems, 2nd ed. (2003), algorithm 12.1.
"""

from __future__ import annotations

from collections.abc import Iterator


def chebyshev(low: float, high: float, count: int) -> Iterator[tuple[float, float]]:
    """Factors of each sweep: of the last correction, and of the preconditioned residual; their sum is the next one.

    Args:
        low, high: interval of eigenvalues of the preconditioned operator.
        count: number of sweeps.

    >>> list(chebyshev(1.0, 1.0 + 1e-9, 2))[0]
    (0.0, 0.9999999995)
    """
    middle, half = (high + low) / 2, (high - low) / 2
    rho = half / middle
    yield 0.0, 1 / middle
    for _ in range(count - 1):
        before, rho = rho, 1 / (2 * middle / half - rho)
        yield before * rho, 2 * rho / half
