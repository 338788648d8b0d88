"""How verification problems are solved: by a method's name; surface-uzawa as it is meant, without a dense matrix."""

from __future__ import annotations

from solvers.scene.settings import Solver


def solver(method: str, tolerance: float) -> Solver:
    """`auto` would condense bodies as small as these."""
    return Solver(method=method, tolerance=tolerance, surface="matrix-free" if method == "surface-uzawa" else "auto")
