"""Small discrete Coulomb problems, and files of FCLIB as another program writes them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import Array

ONE = {  # u = r + q, mu = 1/2, in 3D: q, r, u
    "opens": ([1.0, 2.0, 0.0], [0.0, 0.0, 0.0], [1.0, 2.0, 0.0]),
    "presses": ([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    "sticks": ([-1.0, -0.3, 0.2], [1.0, 0.3, -0.2], [0.0, 0.0, 0.0]),
    "slips": ([-1.0, 0.0, -2.0], [1.0, 0.0, 0.5], [0.0, 0.0, -1.5]),
}
KINDS = ("columns", "rows", "triplets", "triplets as CSparse has them")


def random_problem(seed: int, contacts: int = 6, dim: int = 3, bodies: int = 9) -> tuple[Array, Array, Array]:
    """W of rank `bodies` at most, q in its range, so that a solution exists, and mu."""
    random = np.random.default_rng(seed)
    H = random.normal(size=(bodies, dim * contacts))
    return H.T @ H, H.T @ random.normal(size=bodies), random.uniform(0.1, 0.6, contacts)


def stored(A: Array, kind: str) -> dict[str, Any]:
    """The members of a matrix in a storage kind, with room to spare as C programs leave it."""
    m, n = A.shape
    if kind == "columns":
        S = sparse.csc_matrix(A)
        p, i, x, nz = S.indptr, S.indices, S.data, -1
    elif kind == "rows":
        S = sparse.csr_matrix(A)
        p, i, x, nz = S.indptr, S.indices, S.data, -2
    else:
        S = sparse.coo_matrix(A)
        p, i, x, nz = (S.row, S.col, S.data, S.nnz) if kind == "triplets" else (S.col, S.row, S.data, S.nnz)
    spare = 0 if nz >= 0 else 3
    return {
        **{name: np.array([number], np.int32) for name, number in (("m", m), ("n", n), ("nz", nz))},
        "nzmax": np.array([len(x) + spare], np.int32),
        "p": p.astype(np.int32),
        "i": np.concatenate([i, np.zeros(spare)]).astype(np.int32),
        "x": np.concatenate([x, np.zeros(spare)]),
    }


def write(path: Path, content: Mapping[str, Any]) -> Path:
    """A file with these datasets; a mapping is a group."""

    def put(group: Any, members: Mapping[str, Any]) -> None:
        for name, value in members.items():
            if isinstance(value, Mapping):
                put(group.require_group(name), value)
            else:
                group[name] = value

    with h5py.File(path, "w") as file:
        put(file, content)
    return path


def local(W: Array, q: Array, mu: Array, kind: str = "columns", **others: Any) -> dict[str, Any]:
    """The content of a local problem's file."""
    vectors = {"q": np.asarray(q, float), "mu": np.asarray(mu, float)}
    dim = np.array([len(q) // max(len(mu), 1)], np.int32)
    return {"fclib_local": {"spacedim": dim, "W": stored(np.asarray(W), kind), "vectors": vectors, **others}}
