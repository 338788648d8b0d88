"""How verification problems are solved: by a method's name; surface-uzawa as it is meant, without a dense matrix."""

from __future__ import annotations

from solvers import methods
from solvers.scene.settings import Solver


def solver(method: str, tolerance: float) -> Solver:
    """`auto` would condense bodies as small as these."""
    surface = "matrix-free" if method == "surface-uzawa" else "auto"
    chosen: Solver = methods.Solver(method=method, tolerance=tolerance, surface=surface)
    return chosen
