"""From the assembled system to the condensed surface: rows, weights and rigid modes on the contact dofs."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from solvers.condensed import CondensedSurface
from solvers.system import System
from solvers.volume import Volume


def prepare_surface(system: System, volume: Volume) -> CondensedSurface:
    """Stack all contacts: normal rows first, then tangential rows."""
    contacts, c = system.contacts, len(system.contact_dofs)
    traces = [system.trace(rows) for rows in contacts]
    normal = [rows.N_n @ trace for rows, trace in zip(contacts, traces, strict=True)]
    tangential = [rows.N_t @ trace for rows, trace in zip(contacts, traces, strict=True)]
    weights = [rows.W_n for rows in contacts] + [np.repeat(rows.W_t, rows.free.shape[1]) for rows in contacts]
    return CondensedSurface(
        volume,
        N=sparse.csr_matrix(sparse.vstack([sparse.csr_matrix((0, c)), *normal, *tangential])),
        W=np.concatenate([np.zeros(0), *weights]),
        R=system.rigid_modes(),
        normal_rows=sum(block.shape[0] for block in normal),
    )
