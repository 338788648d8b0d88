"""Non-smooth Gauss-Seidel: sweep over the contact points, and solve the contact problem of each point exactly.

W of a discrete problem is sparse: two contacts are coupled if they act on the same body. Contacts of one colour are not
coupled, so that one array operation answers all of them, to the numbers that one after the other would give.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from typing import Any, ClassVar

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import EXACT, LAST_DIGITS, TINY, Array, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.admissible_set import ContactBlock, project_disc
from stickslip.solvers.interface.discrete import DiscreteProblem, GivenSurface
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import PATIENT, Driver, Iterate, OnStep, Solution, Stall, ignore
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw
from stickslip.solvers.methods.method import Applicability, Method, Ready, SameEveryStep, Setup, Solve, Turn


def sweeps(
    problem: SurfaceProblem, tractions: Callable[[], Array], sweep: Callable[[], None], looks: Callable[[int], bool]
) -> Iterator[Iterate]:
    """Yield what sweeps over the contact points have reached.

    Args:
        problem: the contact problem of the step.
        tractions: those reached (rows,) [Pa], an array of its own each time.
        sweep: goes once over all points.
        looks: whether to look after k sweeps.
    """
    for k in count():
        if looks(k):
            p = tractions()
            u_c = problem.contact_displacement(p)
            w = problem.relative_displacement(u_c)
            yield Iterate(k, problem.natural_residual(p, w), p, w, u_c)
        sweep()


@dataclass(frozen=True)
class Colour:
    """Contacts of one colour."""

    rows: Ints  # (k, d) of W
    W: Sparse  # (k d, rows) those rows of W
    q: Array  # (k, d)
    mu: Array  # (k,)
    push: Array  # (k, d-1) change of u_T with r_n
    rho_n: Array  # (k,) inverse of the flexibility along the normal
    rho_T: Array  # (k, 1) inverse of the largest flexibility across

    def answer(self, r: Array) -> None:
        """Give the contacts, in r (rows,), normal reactions that their u_n asks for, then friction within mu r_n."""
        old = r[self.rows]
        u = (self.W @ r).reshape(old.shape) + self.q
        new = np.empty_like(old)
        new[:, 0] = np.maximum(old[:, 0] - self.rho_n * u[:, 0], 0.0)
        u_T = u[:, 1:] + self.push * (new[:, 0] - old[:, 0])[:, None]
        new[:, 1:] = project_disc(old[:, 1:] - self.rho_T * u_T, self.mu * new[:, 0])
        r[self.rows] = new


@dataclass(frozen=True, kw_only=True)
class ColouredSweeps:
    """Non-smooth Gauss-Seidel on a discrete problem; `Sweeps` of `nsgs` is the same on a dense operator.

    A contact's normal reaction is exact for its present u_T; its friction is one projected step of size
    1 / lambda_max of its own tangential block, which is exact in 2D.
    """

    rtol: float
    max_it: int

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        assert isinstance(problem, DiscreteProblem)
        N, colours = problem.surface.N, coloured(problem)
        r = np.asarray(N.T @ p)

        def sweep() -> None:
            for colour in colours:
                colour.answer(r)

        def looks(k: int) -> bool:  # which costs as much as a sweep
            return k <= 10 or k % 5 == 0 or k == self.max_it

        driver = Driver(problem.surface.counters, self.rtol, self.max_it, on_step)
        reached = sweeps(problem, lambda: np.asarray(N @ r), sweep, looks)
        return driver.run(reached, Stall(40 * PATIENT))  # plateaus of 2000 were seen


def coloured(problem: DiscreteProblem) -> list[Colour]:
    """The contacts by colour."""
    surface, d = problem.surface, problem.dim
    own = _own_blocks(surface.matrix, d)
    give_n, give_T = own[:, 0, 0], np.linalg.eigvalsh(own[:, 1:, 1:])[:, -1]
    # smallest flexibility of a point, relative to the largest: for rows that move nothing
    least = EXACT * max(give_n.max(), give_T.max()) or 1.0
    rho_n, rho_T = 1 / np.maximum(give_n, least), 1 / np.maximum(give_T, least)[:, None]
    found, q = [], problem.q.reshape(-1, d)
    for members in colours(surface.matrix, d):
        rows = members[:, None] * d + np.arange(d)
        push, W = own[members, 1:, 0], surface.matrix[rows.ravel()]
        found.append(Colour(rows, W, q[members], problem.mu[members], push, rho_n[members], rho_T[members]))
    return found


def colours(W: Sparse, d: int) -> list[Ints]:
    """Sets of contacts, none coupled by W (rows, rows) to another of its set: greedy, most coupled first.

    >>> [set.tolist() for set in colours(sparse.csr_matrix(np.eye(4) + np.eye(4, k=2) + np.eye(4, k=-2)), 2)]
    [[0], [1]]
    """
    entries = W.tocoo()
    m = W.shape[0] // d
    coupled = sparse.csr_matrix((np.ones(entries.nnz), (entries.row // d, entries.col // d)), shape=(m, m))
    coupled.sum_duplicates()
    colour = np.full(m, -1)
    for contact in np.argsort(-np.diff(coupled.indptr), kind="stable"):
        taken = set(colour[coupled.indices[coupled.indptr[contact] : coupled.indptr[contact + 1]]])
        colour[contact] = next(k for k in range(m) if k not in taken)
    return [np.flatnonzero(colour == k) for k in range(colour.max(initial=-1) + 1)]


def _own_blocks(W: Sparse, d: int) -> Array:
    """Diagonal blocks (contacts, d, d) of W."""
    entries = W.tocoo()
    own = entries.row // d == entries.col // d
    row, column = entries.row[own], entries.col[own]
    blocks = np.zeros((W.shape[0] // d, d, d))
    blocks[row // d, row % d, column % d] = entries.data[own]
    return blocks


@dataclass(frozen=True, kw_only=True)
class NSGS(Method):
    """For each point in turn r = R - D W p, then solve its contact laws for its p; other points keep their tractions.

    D = N F N^T (rows, rows) is the Delassus operator, F the flexibility of the contact dofs, R = N F f + offset - gap
    the relative displacement under the loads without contact, less the gap. For a normal row the answer is its law's
    resolvent with gamma = 1 / (D_ii W_i); for a tangential point it lies in the disc of the friction bound at the
    latest pressures, with the point's diagonal block of D W. If pressures are at quadrature points, each of them is a
    point, and the friction of a node comes right after the last one that its bound depends on. There is no step size;
    the number of sweeps grows with the number of points.

    It is the last of the chain of `auto` for bodies that supports hold, in 3D and with every law: slow, and hard to
    lose. The methods before it solve all of the ready scenes and their variations.

    Source: Jean, Comput. Methods Appl. Mech. Engrg. 177 (1999); Acary & Brogliato, Numerical Methods for Nonsmooth
    Dynamical Systems (2008).
    """

    NAME: ClassVar = "nsgs"
    WHEN: ClassVar = (
        "the standard of non-smooth contact dynamics, to compare with: point by point on the Delassus operator, each "
        "point's laws answered exactly. 70–180 sweeps a step at tolerance 1e-11 on coarse `block`, `cube` and "
        "`cylinders`; they grow with the number of points"
    )
    WORKS_WITH: ClassVar = Applicability(floating=False, rates=False, matrix_free=False, contends=False)
    TURNS: ClassVar = (Turn("condensed", 3),)

    def build(self, setup: Setup) -> Ready:
        return Sweeps(self, _delassus(setup))

    def discrete(self, surface: GivenSurface) -> Solve:
        return ColouredSweeps(rtol=self.rtol, max_it=self.max_it)


@dataclass(frozen=True)
class Sweeps(SameEveryStep):
    """The iteration for the contact rows of a system."""

    method: NSGS
    D: Array  # Delassus operator (rows, rows) [m/N]

    def renewed(self, setup: Setup) -> Ready:
        """Build again: the operator depends on the contact rows."""
        return self.method.build(setup)

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        W, p = problem.surface.W, np.where(problem.cone.carrying, p, 0.0)
        loaded = problem.relative_displacement(problem.load.free) - problem.gap
        points = list(_points(problem, self.D))

        def sweep() -> None:
            forces = W * p
            for point in points:
                i = point.rows
                p[i] = point.answer(p, loaded[i] - self.D[i] @ forces)
                forces[i] = W[i] * p[i]

        driver = Driver(problem.surface.counters, self.method.rtol, self.method.max_it, on_step)
        return driver.run(sweeps(problem, p.copy, sweep, lambda k: True), Stall(PATIENT))


@dataclass(frozen=True)
class NormalPoint:
    """One normal row: r = law's inverse(p), where r decreases by `give` [m/Pa] per unit of pressure."""

    rows: slice
    law: NormalLaw
    gamma: Array  # (1,) 1 / give [Pa/m]

    def answer(self, p: Array, r: Array) -> Array:
        """Pressure (1,) [Pa] that satisfies the law.

        Args:
            p: current tractions (rows,) [Pa] of all points.
            r: relative displacement less the gap (1,) [m] under p.
        """
        return self.law.resolvent(p[self.rows] + self.gamma * r, self.gamma)


@dataclass(frozen=True)
class FrictionPoint:
    """One tangential point: r - t / k_T is zero inside the disc of the friction bound, and parallel to t on its edge.

    r changes by -A dt with its traction.
    """

    rows: Ints  # (c,) the point's rows that carry a traction
    law: FrictionLaw
    normal: NormalLaw
    pressed_by: Ints  # (k,) normal rows that the bound depends on
    average: Array  # (1, k) weights of their pressures
    A: Array  # (c, c) [m/Pa] diagonal block of D W
    give: Array  # (c,) [m/Pa] eigenvalues of A + 1 / k_T
    axes: Array  # (c, c) eigenvectors, columns
    time: float  # of the step [s]
    end: float  # of the scene [s]

    def answer(self, p: Array, r: Array) -> Array:
        """Traction (c,) [Pa] that satisfies the law.

        Args:
            p: current tractions (rows,) [Pa] of all points.
            r: relative displacement less the gap (c,) [m] under p.
        """
        bound = self.law.limit(p[self.pressed_by], self.average, self.normal, self.time, self.end)
        asked = self.axes.T @ (r + self.A @ p[self.rows])
        return np.asarray(self.axes @ in_disc(self.give, asked, float(bound[0])))


def in_disc(give: Array, asked: Array, bound: float) -> Array:
    """Traction t (c,) [Pa] with (give + x) t = asked, |t| <= bound, x >= 0, and x = 0 if |t| < bound.

    |t| is a decreasing convex function of x; Newton's method on 1 / |t| converges monotonically to 1 / bound.

    Args:
        give: flexibilities along the principal axes (c,) [m/Pa].
        asked: slip without friction, along the same axes (c,) [m].
        bound: friction bound [Pa].

    >>> in_disc(np.array([1.0, 2.0]), np.array([3.0, 8.0]), np.inf)
    array([3., 4.])
    >>> in_disc(np.array([1.0, 1.0]), np.array([3.0, 4.0]), 1.0)
    array([0.6, 0.8])
    """
    t = asked / give
    length = float(np.sqrt(t @ t))
    if length <= bound:
        return np.asarray(t)
    if bound <= 0:
        return np.zeros_like(t)
    x = 0.0
    for _ in range(50 if len(t) > 1 else 0):  # with one axis the answer is +-bound
        if length <= bound * (1 + LAST_DIGITS):  # relative, of a length
            break
        x += (length / bound - 1) * length**2 / float(t @ (t / (give + x)))
        t = asked / (give + x)
        length = float(np.sqrt(t @ t))
    return np.asarray(t * (bound / length))


def _delassus(setup: Setup) -> Array:
    """N F N^T (rows, rows) [m/N], symmetric."""
    surface = condensed(setup.surface)
    return surface.flexibility.between(surface.N, surface.N.T.tocsr())


def _points(problem: SurfaceProblem, D: Array) -> Iterator[NormalPoint | FrictionPoint]:
    """All points in the order of the sweep: each tangential point right after the last normal row of its bound."""
    give = np.maximum(D.diagonal() * problem.surface.W, TINY)
    for place in problem.cone.places:
        least = EXACT * float(give[place.normal].max(initial=0.0))
        gamma = 1 / np.maximum(give[place.normal], least)
        ordered: list[tuple[float, Any]] = [
            (k, NormalPoint(slice(i, i + 1), place.rows.normal, gamma[k : k + 1]))
            for k, i in enumerate(range(place.normal.start, place.normal.stop))
        ]
        ordered += _friction_points(problem, D, place)
        yield from (point for _, point in sorted(ordered, key=lambda each: each[0]))


def _friction_points(problem: SurfaceProblem, D: Array, place: ContactBlock) -> Iterator[tuple[float, FrictionPoint]]:
    """The tangential points of a contact, each with its place in the sweep among the normal rows."""
    law, cone, W = place.rows.friction, problem.cone, problem.surface.W
    if law is None:
        return
    every = np.arange(place.tangential.start, place.tangential.stop).reshape(-1, place.components)
    average = place.average.tocsr()
    for j, free in enumerate(place.rows.free):
        rows = every[j][free]
        if not len(rows):
            continue
        own = average[j]
        A = D[np.ix_(rows, rows)] * W[rows]
        give, axes = np.linalg.eigh((A + A.T) / 2 + np.diag(cone.softness[rows]))
        give = np.maximum(give, EXACT * float(give.max()))
        yield (
            float(own.indices.max(initial=-1)) + 0.5,
            FrictionPoint(
                rows,
                law.of_point(j),
                place.rows.normal,
                place.normal.start + own.indices,
                own.data[None, :],
                A,
                give,
                axes,
                cone.time,
                cone.end,
            ),
        )
