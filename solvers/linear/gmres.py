"""GMRES with a preconditioner on the right, so that it stops on the residual of the equations themselves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stickslip.geometry.arrays import Array


def gmres(
    A: Callable[[Array], Array], b: Array, x: Array, M: Callable[[Array], Array], atol: float, max_it: int = 200
) -> tuple[Array, float]:
    """Solve A x = b.

    Args:
        A: linear map (n,) to (n,).
        b: right-hand side (n,).
        x: start (n,).
        M: the preconditioner, a linear map that approximates A^-1.
        atol: 2-norm of the residual at which to stop, in the unit of b.
        max_it: largest number of iterations; there are no restarts.

    Returns:
        x (n,) with ||b - A x||_2 <= atol, or the best after max_it iterations; and that norm.

    Source: Saad & Schultz, SIAM J. Sci. Stat. Comput. 7 (1986).
    """
    r = b - A(x)
    left = float(np.linalg.norm(r))
    if not left > atol:
        return x, left
    V, Z = [r / left], []
    R, rotated = np.zeros((max_it, max_it)), np.zeros(max_it + 1)
    rotated[0] = left
    cosines, sines = np.zeros(max_it), np.zeros(max_it)
    k = 0
    while k < max_it and left > atol:
        Z.append(M(V[k]))
        new, basis = A(Z[k]), np.array(V)
        h = basis @ new
        new = new - h @ basis
        again = basis @ new  # Gram-Schmidt twice keeps the basis orthogonal
        new -= again @ basis
        h += again
        size = float(np.linalg.norm(new))
        for i in range(k):
            h[i], h[i + 1] = cosines[i] * h[i] + sines[i] * h[i + 1], cosines[i] * h[i + 1] - sines[i] * h[i]
        radius = np.hypot(h[k], size)
        if not radius > 0:
            break
        cosines[k], sines[k] = h[k] / radius, size / radius
        h[k] = radius
        R[: k + 1, k] = h
        rotated[k : k + 2] = cosines[k] * rotated[k], -sines[k] * rotated[k]
        left = abs(float(rotated[k + 1]))
        k += 1
        if not size > 0:
            break
        V.append(new / size)
    return x + np.linalg.solve(R[:k, :k], rotated[:k]) @ np.array(Z[:k]) if k else x, left
