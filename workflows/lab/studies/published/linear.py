"""Linear saddle points: the factor of Uzawa's iteration by theory and as measured, for each inner solve."""

from __future__ import annotations

import numpy as np

from stickslip.workflows.lab.analysis.saddle_points import Exact, membrane
from stickslip.workflows.lab.studies.published.finding import Row
from stickslip.workflows.lab.studies.saddle_points import NODES, RULES, SOFTNESS, STEPS, factors


def linear(softness: str, rule: str) -> list[Row]:
    """C and the inner solve by name; every part of the limit 2 / lambda_1."""
    problem, Q = membrane(NODES, SOFTNESS[softness]), np.eye(NODES) / (NODES + 1)
    rows: list[Row] = []
    for part in STEPS:
        theory, measured, iterations = factors(problem, Q, RULES[rule], part)
        row = {"C": softness, "inner": rule, "exact": isinstance(RULES[rule], Exact), "part": part}
        rows.append(row | {"theory": theory, "measured": measured, "iterations": iterations})
    return rows
