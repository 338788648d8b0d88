"""Solver settings of the verification problems: surface-uzawa runs matrix-free, as intended for large bodies."""

from __future__ import annotations

from stickslip.solvers import method_registry
from stickslip.solvers.scene.settings import Solver


def solver(method: str, tolerance: float) -> Solver:
    """`auto` would condense bodies as small as these."""
    surface = "matrix-free" if method == "surface-uzawa" else "auto"
    chosen: Solver = method_registry.Solver(method=method, tolerance=tolerance, surface=surface)
    return chosen
