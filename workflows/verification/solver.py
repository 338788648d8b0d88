"""Solver settings of the verification problems: surface-uzawa runs matrix-free, as intended for large bodies."""

from __future__ import annotations

from solvers.scene.settings import Solver


def solver(method: str, tolerance: float) -> Solver:
    """Settings for a method; `auto` would condense bodies as small as these."""
    return Solver(method=method, tolerance=tolerance, surface="matrix-free" if method == "surface-uzawa" else "auto")
