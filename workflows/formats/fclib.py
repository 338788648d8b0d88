"""Discrete Coulomb problems in the FCLIB format, the HDF5 files of the field's public collection, read and written.

Local problems are u = W r + q. Global ones are M v = H r + G lambda + f, G^T v + b = 0, u = H^T v + w; they are reduced
to local ones by a sparse factorisation. Both have Coulomb friction, r in the cone |r_T| <= mu r_n, normal first.

Source: Acary, Brémond, Koziara & Pérignon, FCLIB: a collection of discrete 3D frictional contact problems,
INRIA RT-0444 (2014); names and storage kinds from its header fclib.h.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from stickslip.geometry.arrays import CLOSE, AnyArray, Array
from stickslip.geometry.errors import SceneError
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.user_files.hdf5_datasets import elsewhere
from stickslip.workflows.formats.files import write_aside

COLUMNS, ROWS = -1, -2  # values of nz: compressed columns, compressed rows; others: the number of triplets
ASYMMETRY = 1e-2  # of the largest entry: files of the collection reach 1e-3
BLOCK = 256  # columns of H that are solved together


@dataclass(frozen=True, kw_only=True)
class LocalProblem:
    """u = W r + q with Coulomb friction, per contact, normal first."""

    W: Sparse  # (rows, rows) csr, as stored: symmetric up to `ASYMMETRY`
    q: Array  # (rows,)
    mu: Array  # (contacts,)

    @property
    def dim(self) -> int:
        return len(self.q) // len(self.mu)

    def others(self, r: Array) -> Mapping[str, Array]:
        """Numbers that a solution holds besides u and r, by their names in the format."""
        return {}


@dataclass(frozen=True, kw_only=True)
class ReducedProblem(LocalProblem):
    """A global problem, reduced: v and lambda are linear in r."""

    response: Array  # (n + p, rows) of v and lambda to r
    free: Array  # (n + p,) v and lambda at r = 0
    motions: int  # n, the length of v

    def others(self, r: Array) -> Mapping[str, Array]:
        found = self.response @ r + self.free
        v, multipliers = found[: self.motions], found[self.motions :]
        return {"v": v, "l": multipliers} if len(multipliers) else {"v": v}


Checked = TypeVar("Checked", bound=LocalProblem)


def read_problem(path: Path) -> LocalProblem:
    """Read a local problem, or a global one and reduce it.

    Raises:
        SceneError: it cannot be read, holds no such problem, or its sizes or numbers are wrong.
    """
    try:
        content = io.BytesIO(path.read_bytes())
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None
    with _named(path), h5py.File(content, "r") as file:
        if name := elsewhere(file):
            raise SceneError(f"{name} has its numbers in another file: not supported")
        if "fclib_local" in file:
            return _local(file["fclib_local"])
        if "fclib_global" in file:
            return _global(file["fclib_global"])
        if any("rolling" in name for name in file):
            raise SceneError("a problem with rolling friction: not supported")
        raise SceneError("holds no problem of FCLIB: neither fclib_local nor fclib_global")


def write_solved(source: Path, target: Path, solution: Mapping[str, Array], about: Mapping[str, str | float]) -> None:
    """Copy a problem's file, with this solution in place of any that it held; `source` stays as it is.

    Args:
        source: the file that the problem was read from.
        target: the copy.
        solution: by name: u, r, and v, l of a global problem.
        about: attributes of the group `solution`.

    Raises:
        MachineError: the disk is full.
    """
    content = io.BytesIO(source.read_bytes())
    with h5py.File(content, "r+") as file:
        if "solution" in file:
            del file["solution"]
        _put_solution(file, solution, about)
    write_aside(target, content.getbuffer())


def write_local(path: Path, problem: LocalProblem, info: Mapping[str, str], solution: Mapping[str, Array]) -> None:
    """Write a local problem with its solution, W in compressed columns.

    Args:
        path: of the file.
        problem: what to write.
        info: title, description, math_info.
        solution: u and r.

    Raises:
        MachineError: the disk is full.
    """
    content, W = io.BytesIO(), sparse.csc_matrix(problem.W)
    with h5py.File(content, "w", libver=("v108", "v108")) as file:
        numbers = {"m": W.shape[0], "n": W.shape[1], "nzmax": W.nnz, "nz": COLUMNS}
        local = file.create_group("fclib_local")
        local["spacedim"] = np.array([problem.dim], np.int32)
        for name, number in numbers.items():
            local[f"W/{name}"] = np.array([number], np.int32)
        local["W/p"], local["W/i"] = W.indptr.astype(np.int32), W.indices.astype(np.int32)
        local["W/x"] = W.data
        local["vectors/q"], local["vectors/mu"] = problem.q, problem.mu
        for name, text in info.items():
            local[f"info/{name}"] = np.bytes_(text.encode("ascii", "replace") + b"\0")
        _put_solution(file, solution, {})
    write_aside(path, content.getbuffer())


def _put_solution(file: Any, solution: Mapping[str, Array], about: Mapping[str, str | float]) -> None:
    group = file.create_group("solution")
    for name, values in solution.items():
        group[name] = np.asarray(values, np.float64)
    group.attrs.update(about)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Put the file's name before what is wrong with it; what HDF5 itself cannot read is no file of that format."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
    except KeyError as error:
        raise SceneError(f"{path}: {error.args[0]}") from None
    except (OSError, RuntimeError) as error:
        text = " ".join(str(error).split())
        raise SceneError(f"{path}: not an HDF5 file, or a damaged one: {text}") from None


def _local(group: Any) -> LocalProblem:
    dim, vectors = _dimension(group), _found(group, "vectors")
    W, q, mu = _matrix(group, "W"), _vector(vectors, "q"), _vector(vectors, "mu")
    for name in ("V", "R"):
        if name in group and _number(group[name], "n"):
            raise SceneError(f"{group.name}/{name}: equality constraints of a local problem are not supported")
    return _checked(LocalProblem(W=_symmetric(W, "W"), q=q, mu=mu), dim)


def _global(group: Any) -> ReducedProblem:
    dim, vectors = _dimension(group), _found(group, "vectors")
    M, H = _symmetric(_matrix(group, "M"), "M"), _matrix(group, "H")
    n, rows = H.shape
    G = _matrix(group, "G") if "G" in group else sparse.csr_matrix((n, 0))
    f, w, mu = _vector(vectors, "f"), _vector(vectors, "w"), _vector(vectors, "mu")
    b = _vector(vectors, "b") if G.shape[1] else np.zeros(0)
    for name, size, other, expected in (
        ("H", n, "M", M.shape[0]),
        ("G", G.shape[0], "M", M.shape[0]),
        ("f", len(f), "M", M.shape[0]),
        ("w", len(w), "columns of H", rows),
        ("b", len(b), "columns of G", G.shape[1]),
    ):
        if size != expected:
            raise SceneError(f"{name} has {size} rows, {other} {expected}")
    A = sparse.bmat([[M, -G], [G.T, None]], format="csc") if G.shape[1] else M.tocsc()
    found = _solved(A, sparse.vstack([H, sparse.csr_matrix((G.shape[1], rows))]).tocsc(), np.concatenate([f, -b]))
    response, free = found[:, :-1], found[:, -1]
    W, q = sparse.csr_matrix(H.T @ response[:n]), H.T @ free[:n] + w
    return _checked(ReducedProblem(W=W, q=q, mu=mu, response=response, free=free, motions=n), dim)


def _solved(A: Sparse, H: Sparse, right: Array) -> Array:
    """A^-1 [H, right] (n, rows + 1), a block of columns at a time."""
    try:
        factor = splu(A)
    except RuntimeError:  # SuperLU: exactly singular
        raise SceneError("M is singular on the motions that G leaves free: not supported") from None
    blocks = [factor.solve(H[:, k : k + BLOCK].toarray()) for k in range(0, H.shape[1], BLOCK)]
    found = np.column_stack([*blocks, factor.solve(right)])
    asked = np.column_stack([H.toarray(), right])
    # relative residual that a factorisation of M may leave
    if not np.abs(A @ found - asked).max(initial=0.0) <= CLOSE * np.abs(asked).max(initial=0.0):
        raise SceneError("M is nearly singular on the motions that G leaves free: not supported")
    return found


def _checked(problem: Checked, dim: int) -> Checked:
    """The problem, if its sizes and signs are possible."""
    rows, contacts = len(problem.q), len(problem.mu)
    if not contacts:
        raise SceneError("vectors/mu is empty: there is no contact")
    if rows != dim * contacts or problem.W.shape != (rows, rows):
        size = " x ".join(map(str, problem.W.shape))
        raise SceneError(
            f"sizes do not match: spacedim {dim}, {contacts} entries of mu, {rows} of q (or w), W is {size}"
        )
    if problem.mu.min() < 0:
        k = int(problem.mu.argmin())
        raise SceneError(f"vectors/mu: entry {k} is {problem.mu[k]:g}: must not be negative")
    give = problem.W.diagonal()
    if give.min() < -ASYMMETRY * np.abs(give).max():
        k = int(give.argmin())
        raise SceneError(f"W: diagonal entry {k} is {give[k]:g}: W must be positive semi-definite")
    return problem


def _symmetric(A: Sparse, name: str) -> Sparse:
    if A.shape[0] != A.shape[1]:
        raise SceneError(f"{name} is {A.shape[0]} x {A.shape[1]}: must be square")
    off, size = (float(np.abs(B.data).max(initial=0.0)) for B in ((A - A.T).tocsr(), A))
    if off > ASYMMETRY * size:
        raise SceneError(f"{name} is not symmetric: entries differ from their mirrors by up to {off / size:.1g}")
    return A


def _dimension(group: Any) -> int:
    dim = _number(group, "spacedim")
    if dim not in (2, 3):
        raise SceneError(f"{group.name}/spacedim = {dim}: must be 2 or 3")
    return dim


def _matrix(group: Any, name: str) -> Sparse:
    """A matrix in any storage kind, csr."""
    place = _found(group, name)
    m, n, nz = (_number(place, key) for key in ("m", "n", "nz"))
    x, p, i = _vector(place, "x"), _integers(place, "p"), _integers(place, "i")
    where = f"{group.name}/{name}"
    if min(m, n) < 0 or nz < ROWS:
        raise SceneError(
            f"{where}: m = {m}, n = {n}, nz = {nz}: sizes are not negative, nz is -1 (compressed columns), -2 "
            "(compressed rows) or the number of triplets"
        )
    if nz >= 0:
        return _triplets(where, x[:nz], p[:nz], i[:nz], (m, n), nz)
    outer, inner = (n, m) if nz == COLUMNS else (m, n)
    sound = len(p) == outer + 1 and p[0] == 0 and (np.diff(p) >= 0).all() and p[-1] <= min(len(i), len(x))
    if not sound or not _within(i[: p[-1]], inner):
        raise SceneError(f"{where}: p and i do not fit a matrix of {m} x {n} with {len(x)} entries")
    kind = sparse.csc_matrix if nz == COLUMNS else sparse.csr_matrix
    return kind((x[: p[-1]], i[: p[-1]], p), shape=(m, n)).tocsr()


def _triplets(where: str, x: Array, p: AnyArray, i: AnyArray, shape: tuple[int, int], nz: int) -> Sparse:
    """Rows in p and columns in i, as fclib.h says, or the other way round, as CSparse does and files have it."""
    if min(len(x), len(p), len(i)) < nz:
        raise SceneError(f"{where}: nz = {nz}, but x, p, i have {len(x)}, {len(p)}, {len(i)} entries")
    m, n = shape
    fits = _within(p, m) and _within(i, n), _within(p, n) and _within(i, m)
    if not any(fits):
        raise SceneError(f"{where}: p and i do not fit a matrix of {m} x {n}")
    if all(fits) and m != n:
        raise SceneError(f"{where}: it cannot be told which of p and i are rows; store it in compressed columns")
    rows, columns = (p, i) if fits[0] else (i, p)
    return sparse.csr_matrix((x, (rows, columns)), shape=shape)


def _within(index: AnyArray, size: int) -> bool:
    return not len(index) or (int(index.min()) >= 0 and int(index.max()) < size)


def _found(group: Any, name: str) -> Any:
    if name not in group:
        raise SceneError(f"{group.name}/{name} is missing")
    return group[name]


def _array(group: Any, name: str, kinds: str) -> AnyArray:
    data = _found(group, name)
    if not isinstance(data, h5py.Dataset) or data.dtype.kind not in kinds:
        raise SceneError(f"{group.name}/{name} does not hold numbers of the right kind")
    return np.asarray(data[()]).ravel()


def _number(group: Any, name: str) -> int:
    found = _array(group, name, "iu")
    if len(found) != 1:
        raise SceneError(f"{group.name}/{name} is not one number")
    return int(found[0])


def _integers(group: Any, name: str) -> AnyArray:
    return _array(group, name, "iu").astype(np.int64)


def _vector(group: Any, name: str) -> Array:
    found = _array(group, name, "fiu").astype(np.float64)
    wrong = np.flatnonzero(~np.isfinite(found))
    if len(wrong):
        raise SceneError(f"{group.name}/{name}: entry {wrong[0]} is {found[wrong[0]]}: must be finite")
    return found
