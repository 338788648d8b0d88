"""Spectra of Q^-1 B K_B^-1 B^T for the metric Q of every method, with the whole base closed and sticking."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from stickslip.geometry.arrays import Array
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.metrics import surface_metric
from stickslip.workflows.lab.studies import gram
from stickslip.workflows.lab.studies.published.finding import Row

PLAIN, LEARNING = "W (uzawa)", "boundary operator (surface-uzawa)"


def plain(surface: CondensedSurface, cone: AdmissibleSet, give: Array | float = 0.0) -> Array:
    """Eigenvalues of W^-1 (B K_B^-1 B^T - K_C) on the rows that carry tractions [m/Pa], increasing; see (5.5).

    Args:
        give: 1/ω (rows,) [m/Pa].
    """
    N, root = surface.N.toarray(), np.sqrt(surface.W)
    S = root[:, None] * (N @ surface.flexibility @ N.T) * root + np.diag(np.broadcast_to(give, root.shape))
    return np.asarray(np.linalg.eigvalsh(S[np.ix_(cone.carrying, cone.carrying)]))


def spectrum(dim: int, n: int) -> list[Row]:
    """A row for each metric, with all eigenvalues."""
    rows = [(row.reading, row.spectrum, row.fill) for row in gram.rows(n, dim)]
    system = gram.block(n, dim=dim)
    surface, cone = gram.surface_of(system)
    guessed = surface_metric(system)(np.eye(surface.size))
    on, N = cone.carrying, surface.N.toarray()
    given, guess = ((N @ F @ N.T)[np.ix_(on, on)] for F in (surface.flexibility, guessed))
    rows.append((PLAIN, plain(surface, cone), None))
    rows.append((LEARNING, eigh(given, guess, eigvals_only=True), None))
    return [
        {"dim": dim, "n": n, "metric": metric, "least": values[0], "largest": values[-1]}
        | {"condition": values[-1] / values[0], "fill": fill, "values": values.tolist()}
        for metric, values, fill in rows
    ]
