"""One semismooth Newton system with the Schur complement of the bodies, exact.

Its unknowns are the tractions of the active rows (dual) or the motions of the inactive rows (primal), whichever are
fewer.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.linalg import cho_solve

from stickslip.geometry.arrays import EXACT, ROUNDING, Array
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.schur_complement import CondensedSurface, RowStiffness
from stickslip.solvers.newton.active_set import ActiveSet


def solve(laws: ActiveSet, u_c: Array) -> tuple[Array, Array]:
    """Solve a Newton system with the bodies.

    Rigid motions that the active set leaves free, and along which nothing pushes, stay those of the iterate. With a
    proximal term soft springs hold all of them near to it, so that no active set leaves one free.

    Args:
        laws: the active set.
        u_c: displacement (c,) [m] of the iterate.

    Returns:
        Tractions (rows,) [Pa] and displacement of the contact dofs (c,) [m] that satisfy the linearised laws exactly.

    Raises:
        LinAlgError: the active set leaves a rigid mode free that forces push.
    """
    problem, surface = laws.problem, condensed(laws.problem.surface)
    bodies = surface.row_stiffness(problem.cone.carrying)
    # ratio of unknown tractions to unknown motions below which the inverse that tractions need pays
    few = not laws.k.any() and (~laws.given).sum() < 0.5 * (~laws.fixed).sum()
    if laws.hold and surface.floating:
        return by_tractions(laws, surface, laws.hold * surface.rho * np.eye(surface.R.shape[1]), u_c)
    held = unfelt(laws, surface)
    if held.any():
        p, u_c = by_tractions(laws, surface, surface.rho * held, u_c)
    else:
        p, u_c = by_tractions(laws, surface) if bodies is None or few else by_motion(laws, bodies)
    carried_along = np.abs(problem.offset - problem.gap).max(initial=0.0)
    laws.refuse_unbalanced(p, EXACT * surface.total * carried_along)  # a common motion causes no force but rounding
    return p, u_c


def unfelt(laws: ActiveSet, surface: CondensedSurface, of: int | None = None) -> Array:
    """Projection (r, r) onto the rigid motions that no linearised law resists; zero if there are none.

    Args:
        laws: the active set.
        surface: the bodies.
        of: how many of the rigid motions are meant, the first r; None: all of them.
    """
    R = surface.R[:, :of]
    if not R.size:
        return np.zeros((0, 0))
    scale = np.where(laws.k > 0, laws.k, laws.problem.gamma)
    resisted = sparse.diags(1 / scale) @ laws.A_w @ (surface.N @ R)
    _, sizes, motions = np.linalg.svd(np.linalg.qr(resisted, mode="r"))
    # of gamma: stiffness of slip below which it does not resist a motion
    free = motions[np.count_nonzero(sizes > ROUNDING) :]
    return np.asarray(free.T @ free)


def by_motion(laws: ActiveSet, bodies: RowStiffness) -> tuple[Array, Array]:
    """Primal reduction: the unknowns are w on the rows that are not held; W p = q - H w gives p.

    Returns:
        Tractions (rows,) [Pa] and displacement of the contact dofs (c,) [m].
    """
    problem, index, given = laws.problem, bodies.index, laws.given
    W, offset = problem.surface.W[index], problem.offset[index]
    held = laws.fixed[index]
    moving = np.flatnonzero(~held)
    rows = index[moving]
    w = np.where(held, problem.gap[index], 0.0)
    force = bodies.forces(problem.load.f_c) - bodies.H @ (w - offset)
    per_force = laws.A_p[rows]
    per_force.data /= problem.surface.W[per_force.indices]
    per_force = per_force[:, index]
    H = bodies.H[:, moving]
    right = laws.rhs[rows] - per_force @ force  # no law of a moving row involves w of held rows
    matrix = -(per_force @ H)
    if not given[rows].all():
        matrix += laws.A_w[rows][:, rows].toarray()
    w[moving] = np.linalg.solve(matrix, right)
    p = np.zeros(len(laws.rhs))
    p[index] = (force - H @ w[moving]) / W
    p[given] = 0.0  # exact zeros: the diagonal of A_p is 1 there
    p[given] = (laws.rhs - laws.A_p @ p)[given]
    return p, bodies.displacement(w - offset)


def by_tractions(
    laws: ActiveSet, surface: CondensedSurface, springs: Array | None = None, rest: Array | None = None
) -> tuple[Array, Array]:
    """Dual reduction: the unknowns are x, the tractions of the active rows, and the rigid motions b of floating bodies.

    p = E x + p_0 + k (w - gap): springs are added to the stiffness of the bodies where they are too many to be active
    rows like others; rows of given p depend on x.

    Args:
        laws: the active set.
        surface: the bodies.
        springs: stiffness (r, r) [N/m] that holds the rigid motions; None: none does.
        rest: displacement (c,) [m] at which these have no force.

    Returns:
        Tractions (rows,) [Pa] and displacement of the contact dofs (c,) [m].
    """
    if laws.k.any() and np.count_nonzero(~laws.given) < surface.size:
        laws = laws.without_springs()
    problem, N, W, R, k = laws.problem, surface.N, surface.W, surface.R, laws.k
    rows, spring = len(k), k > 0
    on_springs = abs(laws.A_p) @ spring.astype(float) > 0 if spring.any() else spring  # slip by a spring's pressure
    unknown = (~laws.given | on_springs) & ~spring
    x = np.flatnonzero(unknown)
    own_rows = np.ones(len(x)), np.arange(len(x)), np.append(0, np.cumsum(unknown))
    E = sparse.csr_matrix(own_rows, (rows, len(x))) - _scaled((~unknown & ~spring).astype(float), laws.A_p[:, x])
    p_0 = np.where(unknown, 0.0, laws.rhs) + k * problem.offset  # of springs, rhs = p_0 - k gap
    B = sparse.csr_matrix(_scaled(W, N).T @ E)  # (c, x)
    A_p, A_w = laws.A_p[x], laws.A_w[x]
    A_u = (A_w + A_p @ sparse.diags(k) if spring.any() else A_w) @ N
    right = laws.rhs[x] - A_p @ p_0 - A_w @ problem.offset
    f, of_springs = problem.load.f_c - N.T @ (W * p_0), np.zeros_like(R)
    if spring.any():
        tangent = N.T @ sparse.diags(W * k) @ N
        factor = surface.factor(tangent.toarray())
        # not checked for NaN here: NaN ends as Status.NOT_FINITE
        moved, Y = (
            cho_solve(factor, side, check_finite=False) for side in (np.column_stack([surface.rho * R, f]), B.toarray())
        )
        Z, u_0, of_springs = moved[:, :-1], moved[:, -1], tangent @ R
        coupling, balance = A_u @ Y, (B.T @ R - Y.T @ of_springs).T
    else:
        Z, u_0 = R, surface.flexibility @ f
        coupling, balance = surface.coupling(A_w, _scaled(W, E)), R.T @ B
    # u = u_0 - Y x + Z b with b = R^T u, which is the same as balance: R^T (f - B x - tangent u) = 0
    own, carried = of_springs.T @ Z, R.T @ f - of_springs.T @ u_0
    if springs is not None and rest is not None:
        own, carried = own + springs, carried + springs @ (R.T @ rest)
    held = (A_p @ E).toarray() - coupling
    tractions, b = saddle_point(held, A_u @ Z, balance, own, right - A_u @ u_0, carried)
    moved_by = Y @ tractions if spring.any() else surface.flexibility @ (B @ tractions)
    u_c = u_0 - moved_by + Z @ b
    return p_0 + k * (N @ u_c) + E @ tractions, u_c


def _scaled(factor: Array, matrix: Sparse) -> Sparse:
    """diag(factor) M of a matrix of rows (r, n), without the product of two sparse matrices."""
    found = sparse.csr_matrix(matrix, copy=True)
    found.data *= np.repeat(factor, np.diff(found.indptr))
    return found


def saddle_point(A: Array, B: Array, C: Array, D: Array, f: Array, g: Array) -> tuple[Array, Array]:
    """Solve A x + B y = f, C x + D y = g, see `balanced`.

    Returns:
        x (m,) and y (r,).
    """
    matrix, of, by = balanced(A, B, C, D)
    found = np.linalg.solve(matrix, np.concatenate([f, by * g]))
    return found[: len(A)], of * found[len(A) :]


def balanced(A: Array, B: Array, C: Array, D: Array) -> tuple[Array, float, float]:
    """The matrix of a saddle point with its blocks scaled to one size.

    Else the pivots depend on what is called a metre, and so does the rounding. Where D is all that its rows have, C is
    rounding: a pivot in it would drown B in D.

    Returns:
        The matrix (m + r, m + r), and the factors of its last r columns and of its last r rows.
    """
    size = np.abs(A).max(initial=0.0) or 1.0
    of = size / (np.abs(B).max(initial=0.0) or size)
    by = size / (max(np.abs(C).max(initial=0.0), of * np.abs(D).max(initial=0.0)) or size)
    return np.block([[A, of * B], [by * C, by * of * D]]), of, by
