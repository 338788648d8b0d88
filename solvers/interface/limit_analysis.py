"""Whether contact and friction can balance the loads at all: a linear programme over the tractions on rigid bodies."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from geometry.arrays import Array, Bools
from solvers.contact.admissible_set import ContactBlock
from solvers.interface.problem import SurfaceProblem

SIDES = 32  # of the polygons that stand for the disc of friction: the outer one is larger by 0.5 %
STEEP = 1e3  # tangential over normal traction up to which a point counts as pressed, where it has only to touch
MISSING = 1e-6  # part of the load that is left when none is: ten times the programme's own tolerance
ROUNDING = 1e-10  # a resultant that is none, beside the single forces
EVEN = 1e-6  # worth of an even pressure beside that of staying out of the largest gap
ROUGH = 1e2  # cost of friction beside that of closing the largest gap


class Balance(Enum):
    """What is known of the equilibrium of the bodies as rigid ones."""

    POSSIBLE = "rigid bodies could rest under these loads"
    IMPOSSIBLE = "contact and friction cannot balance the loads"
    UNDECIDED = "whether rigid bodies could rest under these loads is too close to tell"


def decide(problem: SurfaceProblem) -> Balance:
    """Whether there is p in the cone with R^T (f - B^T p) = 0.

    Impossible is a proof, for every bound is replaced by a larger one; possible is one, by smaller ones.
    """
    if unbalanced_motion(problem) is not None:
        return Balance.IMPOSSIBLE
    return Balance.UNDECIDED if balancing_tractions(problem) is None else Balance.POSSIBLE


def unbalanced_motion(problem: SurfaceProblem) -> Array | None:
    """Rigid motion of the contact dofs (c,), largest entry 1, on which the loads do more work than contact can take.

    None if there is none. Work is that of the tractions that leave the least of the load: their multipliers.
    """
    programme = _Programme.of(problem, outer=True)
    if programme is None:
        return None
    left = 2 * programme.motions
    found = programme.solve(np.concatenate([np.zeros(programme.size - left), np.ones(left)]), left=np.inf)
    if found is None or found.fun <= MISSING + programme.rounding:
        return None
    motion = problem.surface.R @ found.eqlin.marginals
    return np.asarray(motion / np.abs(motion).max())


def balancing_tractions(problem: SurfaceProblem) -> Array | None:
    """Tractions (rows,) [Pa] in the cone that hold the bodies, were they rigid; None if none were found.

    Of all those they press across the smallest gaps, with little friction, and as evenly as can be.
    """
    programme = _Programme.of(problem, outer=False)
    if programme is None:
        return np.zeros(len(problem.gap))
    n = problem.surface.normal_rows
    room = (problem.gap - problem.offset)[:n]
    room = room / (max(problem.u_ref, np.abs(room).max(initial=0.0)) or 1.0)  # less than bodies give is no gap
    friction = np.full(programme.along.shape[1], ROUGH)
    found = programme.solve(np.concatenate([room, friction, [EVEN], np.zeros(2 * programme.motions)]), left=0.0)
    if found is None:
        return None
    forces = programme.onto @ found.x[: programme.onto.shape[1]]
    return np.asarray(programme.force * forces / problem.surface.W)


@dataclass(frozen=True)
class _Programme:
    """Unknowns, all of order 1: normal forces, friction by direction, largest pressure, what is left of the load."""

    force: float  # [N], the unit of forces
    rounding: float  # of the load, in that unit
    load: Array  # (r,) on the rigid motions
    onto: Any  # (rows, n + k) sparse: normal forces and friction by direction to forces on rows
    along: Any  # (rows, k) sparse: friction's part of it
    held: Array  # (r, n + k) what they do to the rigid motions
    A_ub: Any
    b_ub: Array
    pulls: Bools  # (n,) which normal forces may have any sign

    @property
    def motions(self) -> int:
        return len(self.load)

    @property
    def size(self) -> int:
        return int(self.onto.shape[1]) + 1 + 2 * self.motions

    @classmethod
    def of(cls, problem: SurfaceProblem, outer: bool) -> _Programme | None:
        """None if no load is there to be balanced."""
        surface, n, cone = problem.surface, problem.surface.normal_rows, problem.cone
        load, size = problem.load.resultant, np.sqrt(len(surface.R))
        force = size * float(np.linalg.norm(load))
        rounding = size * ROUNDING * problem.load.magnitude
        if force <= rounding:
            return None
        bounds = [_bounds(problem, place, outer, force) for place in cone.with_friction()]
        along = sparse.hstack([sparse.csr_matrix((len(surface.W), 0)), *(b.along for b in bounds)])
        onto = sparse.hstack([sparse.eye(len(surface.W), n), along]).tocsr()
        share = sparse.vstack([sparse.csr_matrix((0, n)), *(b.share for b in bounds)])
        sums = sparse.block_diag([sparse.csr_matrix((0, 0)), *(b.sums for b in bounds)])
        weights = surface.W[:n] / surface.W[:n].sum()
        A_ub = sparse.bmat(
            [[-share, sums, None], [sparse.eye(n), sparse.csr_matrix((n, along.shape[1])), -weights[:, None]]]
        )
        nothing = sparse.csr_matrix((A_ub.shape[0], 2 * len(load)))
        return cls(
            force=force,
            rounding=rounding / force,
            load=size * load / force,
            onto=onto,
            along=along,
            held=size * (onto.T @ (surface.N @ surface.R)).T,
            A_ub=sparse.hstack([A_ub, nothing], format="csc"),
            b_ub=np.concatenate([np.zeros(0), *(b.cap for b in bounds), np.zeros(n)]),
            pulls=np.concatenate([np.full(len(c.W_n), c.normal.sides == 2) for c in cone.contacts]),
        )

    def solve(self, cost: Array, left: float) -> Any:
        """The optimum, or None; at most `left` of each load may stay unbalanced."""
        r, eye = self.motions, np.eye(self.motions)
        lower = np.concatenate([np.where(self.pulls, -np.inf, 0.0), np.zeros(self.size - len(self.pulls))])
        upper = np.concatenate([np.full(self.size - 2 * r, np.inf), np.full(2 * r, left)])
        A_eq = np.hstack([self.held, np.zeros((r, 1)), eye, -eye])
        found = linprog(
            cost, self.A_ub, self.b_ub, A_eq, self.load, bounds=np.column_stack([lower, upper]), method="highs"
        )
        return found if found.status == 0 else None


@dataclass(frozen=True)
class _Bounds:
    """Friction of one contact: sums of forces by direction <= share of the normal forces + cap."""

    along: Any  # (rows, k) sparse
    share: Any  # (m, n) sparse
    sums: Any  # (m, k) sparse
    cap: Array  # (m,)


def _bounds(problem: SurfaceProblem, place: ContactBlock, outer: bool, force: float) -> _Bounds:
    """Each point's disc as a polygon whose sides (outer) or corners (inner) touch it, first of all on the axes."""
    surface, cone, rows = problem.surface, problem.cone, place.rows
    assert rows.friction is not None
    m, c = rows.free.shape
    if c == 1:
        corners = np.array([[1.0], [-1.0]])
    else:
        angles = 2 * np.pi * (np.arange(SIDES) + (0.5 if outer else 0.0)) / SIDES
        corners = np.column_stack([np.cos(angles), np.sin(angles)]) / (np.cos(np.pi / SIDES) if outer else 1.0)
    count = len(corners)
    values = rows.free[:, None, :] * corners  # (m, count, c)
    row = place.tangential.start + np.arange(m * c).reshape(m, 1, c)
    column = np.arange(m * count).reshape(m, count, 1)
    row, column = (np.broadcast_to(index, values.shape).ravel() for index in (row, column))
    along = sparse.csr_matrix((values.ravel(), (row, column)), shape=(len(surface.W), m * count))
    sums = sparse.kron(sparse.eye(m), np.ones((1, count)), format="csr")
    cap, below, above = rows.friction.lines(rows.normal, cone.time, cone.end)
    slope = above if outer else below
    if rows.normal.sides == 1 and not outer:
        slope = min(slope, STEEP)
    elif rows.normal.sides == 2 and outer and np.isfinite(slope):
        slope = np.inf  # where some points may pull, the others can press, and hold, without limit
    found = []
    if np.isfinite(cap):
        found.append((sparse.csr_matrix((m, surface.normal_rows)), rows.W_t * cap / force))
    if np.isfinite(slope):
        average = place.average.maximum(0.0) if outer else place.average  # s = mu max(average p, 0) <= mu (average)+ p
        share = sparse.diags(slope * rows.W_t) @ average @ sparse.diags(1 / surface.W[place.normal])
        left, right = place.normal.start, surface.normal_rows - place.normal.stop
        share = sparse.hstack([sparse.csr_matrix((m, left)), share, sparse.csr_matrix((m, right))])
        found.append((share, np.zeros(m)))
    return _Bounds(
        along=along,
        share=sparse.vstack([sparse.csr_matrix((0, surface.normal_rows)), *(s for s, _ in found)]),
        sums=sparse.vstack([sparse.csr_matrix((0, m * count)), *(sums for _ in found)]),
        cap=np.concatenate([np.zeros(0), *(b for _, b in found)]),
    )
