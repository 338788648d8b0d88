"""The contact laws at trial tractions, linearised: which rows become constraints, which springs, which slip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_solve

from solvers.condensed import CondensedSurface
from solvers.surface_problem import SurfaceProblem

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
BALANCE = 1e-8  # force out of balance, relative, at which a solution of the linear system is none
ROUNDING = 1e-12  # forces that are none, beside those of moving one contact dof alone as far


@dataclass(frozen=True)
class LinearisedLaws:
    """One Newton system.

    Springs (compliance, stick with k_T): p = p_0 + k (w - gap), folded into the stiffness.
    Carried rows (closed, stick, slip): A_p p + A_w w = rhs. All other tractions are zero.
    """

    problem: SurfaceProblem
    k: Array  # (rows,) spring stiffness [Pa/m], 0 where there is none
    p_0: Array  # (rows,) [Pa]
    carried: Mask  # (rows,)
    A_p: sparse.csr_matrix  # (carried, rows)
    A_w: sparse.csr_matrix  # (carried, rows)
    rhs: Array  # (carried,)

    def solve(self) -> tuple[Array, Array]:
        """Tractions (rows,) and displacement of the contact dofs (c,) that satisfy the linearised laws exactly.

        Raises:
            LinAlgError: the carried rows do not hold the bodies.
        """
        problem, surface = self.problem, self.problem.surface
        assert isinstance(surface, CondensedSurface)
        N, W, R, rho = surface.N, surface.W, surface.R, surface.rho
        # p = p_0 + k (N u + offset - gap) + E p_c, E the columns of the carried rows
        p_fixed = self.p_0 + self.k * (problem.offset - problem.gap)
        B_c = N[self.carried].multiply(W[self.carried][:, None]).T.tocsc()  # (c, carried)
        A_u = (self.A_w + self.A_p @ sparse.diags(self.k)) @ N  # (carried, c)
        rhs = self.rhs - self.A_p @ p_fixed - self.A_w @ problem.offset
        load = problem.load.f_c - N.T @ (W * p_fixed)
        columns = np.column_stack([B_c.toarray(), rho * R, load])
        if self.k.any():
            tangent = (N.T @ sparse.diags(W * self.k) @ N).toarray()
            moved = cho_solve(surface.factor(tangent), columns)
        else:
            moved = surface.flexibility @ columns
        m, r = B_c.shape[1], R.shape[1]
        Y, Z, u_0 = moved[:, :m], moved[:, m : m + r], moved[:, -1]
        A_c = self.A_p[:, self.carried].toarray()
        # u = u_0 - Y p_c + Z b,  b = R^T u
        system = np.block([[A_c - A_u @ Y, A_u @ Z], [R.T @ Y, np.eye(r) - R.T @ Z]])
        right = np.concatenate([rhs - A_u @ u_0, R.T @ u_0])
        found = np.linalg.solve(system, right)
        u_c = u_0 - Y @ found[:m] + Z @ found[m:]
        p = p_fixed + self.k * (N @ u_c)
        p[self.carried] = found[:m]
        held = surface.forces(p)
        unbalanced = R.T @ (problem.load.f_c - held)
        allowed = BALANCE * (np.abs(problem.load.f_c).sum() + np.abs(held).sum())
        carried_along = np.abs(problem.offset - problem.gap).max(initial=0.0)
        allowed += ROUNDING * float(np.abs(surface.S).sum() * carried_along)  # as a whole, there is no force
        if np.abs(unbalanced).sum() > allowed:
            raise np.linalg.LinAlgError("the system is singular: some rigid motion is not held")
        return p, u_c


def linearise(problem: SurfaceProblem, p_hat: Array, gamma: Array) -> LinearisedLaws:
    """Linearise p = P_C(p + gamma (w - gap)) at the trial tractions p_hat (rows,) [Pa]."""
    cone, rows = problem.cone, len(p_hat)
    p = cone.project(p_hat, gamma)
    k, p_0 = np.zeros(rows), np.zeros(rows)
    carried = np.zeros(rows, bool)
    A_p = sparse.lil_matrix((rows, rows))
    A_w = np.zeros(rows)  # diagonal part
    blocks: list[sparse.coo_matrix] = []
    rhs = np.zeros(rows)
    for place in cone.places:
        n, law = place.normal, place.rows.normal
        slope = law.stiffness(p[n], p_hat[n])
        closed = np.isinf(slope)
        index = np.arange(n.start, n.stop)
        carried[index[closed]] = True
        A_w[index[closed]] = gamma[n][closed]  # gamma (w - gap) = 0: rows of one unit, Pa
        rhs[index[closed]] = (gamma * problem.gap)[n][closed]
        spring = ~closed & (slope > 0)
        k[index[spring]] = slope[spring]
        p_0[index[spring]] = p[n][spring] - slope[spring] * law.penetration(p[n])[spring]
    for place in cone.with_friction():
        span, c, free = place.tangential, place.components, place.rows.free
        index = np.arange(span.start, span.stop).reshape(-1, c)
        trial = p_hat[span].reshape(-1, c) * free
        length, s = np.linalg.norm(trial, axis=1), cone.bound(place, p[place.normal])
        soft = place.rows.friction.softness  # type: ignore[union-attr]
        stick = (length <= s * (1 + gamma[index[:, 0]] * soft)) & (s > 0)
        slip = ~stick & (s > 0)
        stuck = index[stick[:, None] & free]
        if soft:
            k[stuck] = 1 / soft
        else:
            carried[stuck] = True
            A_w[stuck] = gamma[stuck]
            rhs[stuck] = (gamma * problem.gap)[stuck]
        # slip: t = s(p_n) e + J (t + gamma (w - gap) - t_hat), J = s/|t_hat| (I - e e^T)
        e = trial[slip] / length[slip][:, None]
        J = (s[slip] / length[slip])[:, None, None] * (np.eye(c) - e[:, :, None] * e[:, None, :])
        J *= free[slip][:, :, None] & free[slip][:, None, :]
        at, step = index[slip], gamma[index[slip]]
        carried[at[free[slip]]] = True
        i, j = np.broadcast_to(at[:, :, None], J.shape), np.broadcast_to(at[:, None, :], J.shape)
        shape = (rows, rows)
        blocks.append(sparse.coo_matrix(((-J * step[:, None, :]).ravel(), (i.ravel(), j.ravel())), shape=shape))
        follow = sparse.coo_matrix(((np.eye(c) - J).ravel(), (i.ravel(), j.ravel())), shape=shape)
        on_normal = cone.bound_slope(place, p[place.normal])[slip].tocoo()
        rows_n = at[on_normal.row]  # (nnz, c)
        cols_n = np.broadcast_to(place.normal.start + on_normal.col[:, None], rows_n.shape)
        coupling = sparse.coo_matrix(
            ((-e[on_normal.row] * on_normal.data[:, None]).ravel(), (rows_n.ravel(), cols_n.ravel())), shape=shape
        )
        A_p = A_p + follow + coupling
        right = s[slip][:, None] * e - np.einsum("mab,mb->ma", J, step * problem.gap[at] + trial[slip])
        rhs[at] = right
        np.add.at(rhs, rows_n, -e[on_normal.row] * (on_normal.data * p[place.normal][on_normal.col])[:, None])
    full_w = sparse.diags(A_w) + sum(blocks, sparse.csr_matrix((rows, rows)))
    return LinearisedLaws(
        problem, k, p_0, carried, sparse.csr_matrix(A_p)[carried], sparse.csr_matrix(full_w)[carried], rhs[carried]
    )
