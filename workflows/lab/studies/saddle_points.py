"""Uzawa's iteration on a linear saddle point: contraction factor in theory and measured, exact and inexact solves."""

from collections.abc import Iterator

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.workflows.lab.analysis.saddle_points import (
    Bounds,
    Exact,
    InexactRichardson,
    Inner,
    Reducing,
    SaddlePoint,
    Tied,
    Worst,
    measured,
    membrane,
)

NODES = 8  # along a side of the membrane
SOFTNESS = {"0": 0.0, "W/omega": 0.3}  # C; 1/omega is about the largest eigenvalue of W^-1 B A^-1 B^T
STEPS = (0.25, 0.5, 0.8, 0.99, 1.01)  # parts of the limit 2 / lambda_1
RULES: dict[str, Inner] = {
    "exact": Exact(),
    "CG, residual falls to .03": Reducing(0.03),
    "worst residual, .03": Worst(Reducing(0.03)),
    "CG, residual falls to .3": Reducing(0.3),
    "worst residual, .3": Worst(Reducing(0.3)),
    "CG, tied to .1 of the outer one": Tied(0.1),
    "worst residual tied to .1": Worst(Tied(0.1)),
}
WIDTHS = (9, 33, 9, 9, 9, 12)


def factors(problem: SaddlePoint, Q: Array, inner: Inner, part: float) -> tuple[float, float, int]:
    """Contraction factor in theory, measured factor of the last iterations, number of iterations."""
    bounds = Bounds.of(problem, Q)
    alpha = part * bounds.limit
    rate, weight = inner.rate(bounds, alpha)
    start = np.random.default_rng(1).normal(size=len(problem.q))
    errors = InexactRichardson(alpha=alpha, Q=Q, inner=inner)(problem, np.zeros(len(problem.p)), start)
    return rate, measured(errors, weight)[1], len(errors) - 1


def table() -> Iterator[tuple[str, ...]]:
    """Rows of text: C, the inner solve, alpha lambda_1 / 2, both factors, iterations."""
    for C, softness in SOFTNESS.items():
        problem = membrane(NODES, softness)
        Q = np.eye(NODES) / (NODES + 1)
        for rule, inner in RULES.items():
            for part in STEPS:
                rate, found, iterations = factors(problem, Q, inner, part)
                end = "diverges" if found > 1 else f"{iterations}"
                yield C, rule, f"{part:g}", f"{rate:.4f}", f"{found:.4f}", end


if __name__ == "__main__":
    heads = ("C", "inner solve", "a l_1/2", "theory", "measured", "iterations")
    for row in (heads, *table()):
        print("".join(cell.ljust(width) for cell, width in zip(row, WIDTHS, strict=True)).rstrip())
