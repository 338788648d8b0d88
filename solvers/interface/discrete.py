"""A discrete Coulomb problem u = W r + q as a surface problem: its Delassus operator is W, given, and nothing else.

It is what non-smooth contact dynamics solves in a time step. Per contact, normal first: with v = u + mu |u_T| n,
r = P_K(r - v), K the cone |r_T| <= mu r_n. In our terms p = r and w = -(W r + q), gap 0, no load, no rigid modes.

Source: Acary & Brogliato, Numerical Methods for Nonsmooth Dynamical Systems (2008).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from petsc4py import PETSc
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from stickslip.geometry.arrays import HALF_DIGITS, Array, Bools
from stickslip.geometry.protocols import Sparse, Vec
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.flexibility import DelassusOperator, Load
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.scales import Scales
from stickslip.solvers.laws.friction import CoulombByPoint
from stickslip.solvers.laws.normal import Unilateral
from stickslip.solvers.linear.block_diagonal import BlockDiagonal
from stickslip.solvers.parallel.counters import Counters

LEAST = 1e-10  # smallest flexibility of a row, relative to the largest, that scales its trial tractions


class GivenSurface(DelassusOperator):
    """A Delassus operator whose matrix is given, symmetric and positive semi-definite; often rank-deficient.

    The contact dofs are its rows, in the order of the file: per contact, normal first. N puts normal rows first. There
    is no stiffness: `row_stiffness` and `factor` of the condensed form have nothing to return.
    """

    exact = True
    rho = 1.0  # no rigid modes, so no effect
    total = 0.0  # of the stiffness, [N/m]

    def __init__(self, matrix: Sparse, contacts: int) -> None:
        """
        Args:
            matrix: (rows, rows) csr.
            contacts: number of contacts.
        """
        rows = matrix.shape[0]
        order = np.arange(rows).reshape(contacts, -1)
        order = np.concatenate([order[:, 0], order[:, 1:].ravel()])
        N = sparse.csr_matrix((np.ones(rows), (np.arange(rows), order)), shape=(rows, rows))
        super().__init__(
            N=N, W=np.ones(rows), R=np.zeros((rows, 0)), normal_rows=contacts, driven=0, counters=Counters()
        )
        self.matrix = matrix

    @cached_property
    def flexibility(self) -> BlockDiagonal:
        """The matrix, dense."""
        return BlockDiagonal.whole(self.matrix.toarray())

    def row_stiffness(self, carrying: Bools) -> None:
        """None: see the class."""

    def load(self, f_q: Vec, driving: Array, error: float = 0.0) -> Load:
        nothing = np.zeros(self.size)
        return Load(f_q=f_q, driving=driving, f_c=nothing, resultant=np.zeros(0), free=nothing)

    def displacement(self, force: Array, error: float = 0.0) -> Array:
        self.counters.volume_solves += 1
        return np.asarray(self.matrix @ force)

    def under(self, load: Load, p: Array, error: float = 0.0) -> Array:
        return self.displacement(-self.forces(p))

    def recover(self, load: Load, p: Array, u_c: Array) -> Vec:
        return load.f_q

    def adopt(self, other: DelassusOperator) -> None:
        """Nothing: contacts of a discrete problem do not change."""


@dataclass(frozen=True, kw_only=True)
class DiscreteProblem(SurfaceProblem):
    """A scaled discrete problem: the largest diagonal entry of its matrix is 1, and the norm of q is 1, or 0."""

    surface: GivenSurface
    mu: Array  # (contacts,) [-]
    q: Array  # (rows,) in the order of the contact dofs
    units: tuple[float, float]  # of r and of u: what one unit here is in the problem as it was given

    scales = Scales(motion=1.0, traction=1.0, given=np.ones(1))  # by the scaling above

    @property
    def dim(self) -> int:
        return len(self.q) // len(self.mu)

    def natural_residual(self, p: Array, w: Array) -> float:
        """|r - P_K(r - v)|, v = u + mu |u_T| n and rho = 1: relative to the norm of q, which is 1 here.

        Args:
            p: r, normal rows first (rows,).
            w: -u, normal rows first (rows,).
        """
        N = self.surface.N
        return residual(N.T @ p, -(N.T @ w), self.mu)

    def regular(self, p: Array, epsilon: float) -> DiscreteProblem:
        """The problem with W + epsilon I and q - epsilon r for W and q, at p (rows,): regular for epsilon > 0."""
        shift = sparse.identity(len(p), format="csr") * epsilon
        surface = GivenSurface(self.surface.matrix + shift, len(self.mu))
        surface.counters = self.surface.counters
        q = self.q - epsilon * self.surface.forces(p)
        return replace(self, surface=surface, q=q, offset=-(surface.N @ q), gamma=1 / (1 / self.gamma + epsilon))

    def reactions(self, p: Array) -> Array:
        """r (rows,) of the problem as it was given, per contact, from p (rows,)."""
        return np.asarray(self.surface.forces(p) * self.units[0])

    def velocities(self, p: Array) -> Array:
        """u = W r + q (rows,) of the problem as it was given, per contact, from p (rows,)."""
        return np.asarray((self.surface.matrix @ self.surface.forces(p) + self.q) * self.units[1])


def discrete_problem(matrix: Sparse, q: Array, mu: Array) -> DiscreteProblem:
    """Scale a discrete problem, and state it as a surface problem.

    Args:
        matrix: W (rows, rows), symmetric up to rounding: its symmetric part is taken.
        q: (rows,), per contact, normal first.
        mu: (contacts,), >= 0.
    """
    contacts, rows = len(mu), len(q)
    dim = rows // contacts
    W = sparse.csr_matrix((matrix + matrix.T) / 2)
    size, length = float(W.diagonal().max()) or 1.0, float(np.linalg.norm(q)) or 1.0
    surface = GivenSurface(W / size, contacts)
    nothing = PETSc.Vec().createSeq(0, comm=PETSc.COMM_SELF)
    give = surface.matrix.diagonal().reshape(contacts, dim)
    give[:, 1:] = give[:, 1:].max(axis=1, keepdims=True)  # one for a point's tangential rows: its bound is a disc
    gamma = 1 / np.maximum(surface.N @ give.ravel(), LEAST)
    return DiscreteProblem(
        surface=surface,
        cone=AdmissibleSet((_rows(mu, dim),), 1.0, 1.0),
        load=surface.load(nothing, np.zeros(0)),
        offset=-(surface.N @ q) / length,
        u_before=np.zeros(surface.size),
        gap=np.zeros(rows),
        gamma=gamma,
        weight=gamma,
        force=1.0,
        stiffness=1.0,
        mu=mu,
        q=q / length,
        units=(length / size, length),
    )


def residual(r: Array, u: Array, mu: Array) -> float:
    """Norm of r - P_K(r - v), v = u + mu |u_T| n.

    Args:
        r, u: (rows,), per contact, normal first.
        mu: (contacts,).

    >>> residual(np.array([1.0, 0.5]), np.array([0.0, 0.0]), np.array([1.0]))
    0.0
    >>> residual(np.array([1.0, 0.0]), np.array([0.0, -1.0]), np.array([0.0]))
    0.0
    """
    r, v = r.reshape(len(mu), -1), u.reshape(len(mu), -1).copy()
    v[:, 0] += mu * np.linalg.norm(v[:, 1:], axis=1)
    return float(np.linalg.norm(r - project_cone(r - v, mu)))


def rank(matrix: Sparse) -> int | None:
    """Numerical rank of a symmetric matrix, by the eigenvalues of its uncoupled parts; None if one is too large.

    >>> rank(sparse.csr_matrix([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 2.0]]))
    2
    """
    count, part = connected_components(matrix, directed=False)
    members = [np.flatnonzero(part == k) for k in range(count)]
    if max(map(len, members)) > 2000:  # rows; it takes a second
        return None
    values = np.concatenate([np.abs(np.linalg.eigvalsh(matrix[rows][:, rows].toarray())) for rows in members])
    return int((values > HALF_DIGITS * values.max()).sum())  # relative: eigenvalues below count as zero


def project_cone(x: Array, mu: Array) -> Array:
    """Nearest points of the cones |x_T| <= mu x_n.

    Args:
        x: (m, d), normal first.
        mu: (m,).

    >>> project_cone(np.array([[-1.0, 0.5], [0.0, 2.0], [3.0, 1.0]]), np.array([1.0, 1.0, 1.0]))
    array([[0., 0.],
           [1., 1.],
           [3., 1.]])
    """
    n, length = x[:, 0], np.linalg.norm(x[:, 1:], axis=1)
    on_edge = np.maximum((n + mu * length) / (1 + mu**2), 0.0)
    edge = np.column_stack([on_edge, x[:, 1:] * (mu * on_edge / np.where(length > 0, length, 1.0))[:, None]])
    return np.where((length <= mu * n)[:, None], x, edge)


def _rows(mu: Array, dim: int) -> ContactRows:
    """All contacts as the rows of one: a cloud of points of weight 1, without a mesh, all in the origin."""
    m = len(mu)
    number, identity = np.arange(m), sparse.identity(m, format="csr")
    components = sparse.identity(m * dim, format="csr")
    tangential = np.delete(np.arange(m * dim), np.s_[::dim])
    frames = np.tile(np.eye(dim), (m, 1, 1))
    points = Surface(
        shape="interval" if dim == 2 else "triangle",
        degree=1,
        nodes=number,
        input=number,
        points=np.zeros((m, dim)),
        facets=np.zeros((0, dim), np.int64),
        outward=np.zeros(0),
        axisymmetric=False,
    )
    return ContactRows(
        name="contacts",
        surface=points,
        master=None,
        normal=Unilateral(),
        friction=CoulombByPoint(mu=mu),
        frames=frames,
        node_weights=np.ones(m),
        node_gap=np.zeros(m),
        node_distance=np.zeros(m),
        relative=identity,
        N_n=components[::dim],
        W_n=np.ones(m),
        normals=frames[:, 0],
        gap=np.zeros(m),
        N_t=components[tangential],
        W_t=np.ones(m),
        tangents=frames[:, 1:],
        free=np.ones((m, dim - 1), bool),
        psi=identity,
        phi=identity,
        share_t=identity,
        dropped=0,
    )
