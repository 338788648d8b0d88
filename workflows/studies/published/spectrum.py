"""Spectra of Q^-1 B K_B^-1 B^T for every metric Q that a method takes, all of the base closed and sticking."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import eigh

from solvers.surface_metric import surface_metric
from workflows.studies import gram

Row = dict[str, Any]
PLAIN, LEARNING = "W (uzawa)", "boundary operator (surface-uzawa)"


def spectrum(dim: int, n: int) -> list[Row]:
    """A row for each metric, with all eigenvalues."""
    rows = [(row.reading, row.spectrum, row.fill) for row in gram.rows(n, dim)]
    system = gram.block(n, dim=dim)
    surface, cone = gram.surface_of(system)
    guessed = surface_metric(system)(np.eye(surface.size))
    on, N = cone.carrying, surface.N.toarray()
    given, guess = ((N @ F @ N.T)[np.ix_(on, on)] for F in (surface.flexibility, guessed))
    root = np.sqrt(surface.W[on])
    rows.append((PLAIN, np.linalg.eigvalsh(root[:, None] * given * root), None))
    rows.append((LEARNING, eigh(given, guess, eigvals_only=True), None))
    return [
        {"dim": dim, "n": n, "metric": metric, "least": values[0], "largest": values[-1]}
        | {"condition": values[-1] / values[0], "fill": fill, "values": values.tolist()}
        for metric, values, fill in rows
    ]
