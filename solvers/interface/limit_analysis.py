"""Limit analysis: whether contact and friction can balance the loads at all, by a linear programme on rigid bodies."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.optimize import OptimizeResult, linprog

from stickslip.geometry.arrays import CLOSE, ROUNDING, Array, Bools
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.admissible_set import ContactBlock
from stickslip.solvers.interface.problem import SurfaceProblem

SIDES = 32  # of the polygons that replace the disc of friction: the outer one is larger by 0.5 %
STEEP = 1e3  # largest ratio of tangential to normal traction where any pressure holds any traction (stick)


class Balance(Enum):
    """Result of the limit analysis: whether the bodies, taken as rigid, can be in equilibrium."""

    POSSIBLE = "rigid bodies could rest under these loads"
    IMPOSSIBLE = "contact and friction cannot balance the loads"
    UNDECIDED = "whether rigid bodies could rest under these loads is too close to tell"


class Mechanism(NamedTuple):
    """A rigid motion of collapse."""

    motion: Array  # (c,) of the contact dofs, its largest entry 1
    lacking: float  # of the work of the load along it, the part that contact and friction cannot take up [-]


def decide(problem: SurfaceProblem) -> Balance:
    """Limit analysis: whether there is an admissible p with R^T (f - B^T p) = 0, R the rigid modes.

    IMPOSSIBLE is a proof, since every friction bound is replaced by a larger one; POSSIBLE is a proof, since every
    bound is replaced by a smaller one.
    """
    if unbalanced_motion(problem) is not None:
        return Balance.IMPOSSIBLE
    return Balance.UNDECIDED if balancing_tractions(problem) is None else Balance.POSSIBLE


def unbalanced_motion(problem: SurfaceProblem) -> Mechanism | None:
    """Collapse mechanism: a rigid motion on which the loads do more work than contact and friction can dissipate.

    It consists of the multipliers of the programme that minimises the unbalanced load; None if there is no such motion.
    Bodies that nothing touches, however the load strains them, and that it moves on without closing a gap, have one
    too: pressures that would hold them have no cause.
    """
    programme = _Programme.of(problem, outer=True)
    if programme is None:
        return None
    drift, n = problem.surface.R @ problem.load.resultant, problem.surface.normal_rows
    still = problem.surface.R @ (problem.surface.R.T @ (problem.u_before - problem.load.free))
    w = problem.relative_displacement(problem.load.free + still)
    apart = ~programme.pulls & ((problem.gap - w)[:n] > problem.scales.no_motion(w)[:n])
    if apart.all() and not closes(problem, w, drift):
        return Mechanism(drift / np.abs(drift).max(), 1.0)
    left = 2 * programme.motions
    found = programme.solve(np.concatenate([np.zeros(programme.size - left), np.ones(left)]), left=np.inf)
    # unbalanced part of the load that counts as zero: ten times the tolerance of the programme
    if found is None or found.fun <= CLOSE + programme.rounding:
        return None
    along = found.eqlin.marginals
    motion = problem.surface.R @ along
    return Mechanism(motion / np.abs(motion).max(), float(found.fun / (along @ programme.load)))


def closes(problem: SurfaceProblem, w: Array, motion: Array) -> float:
    """Widest gap [m], now or at the start, that a rigid motion closes; 0: all points move apart, or along.

    Args:
        problem: the contact problem of the step.
        w: relative displacement (rows,) [m] from which the bodies go on.
        motion: rigid motion (c,) of the contact dofs.
    """
    n = problem.surface.normal_rows
    approach = (problem.surface.N @ motion)[:n] > CLOSE * np.abs(motion).max(initial=0.0)
    room = np.maximum(np.abs(problem.gap), problem.gap - w)
    return float(room[:n][approach].max(initial=0.0))


def spent(problem: SurfaceProblem, p: Array, motion: Array) -> bool:
    """Whether the loads do more work along a motion than contact and friction can take up at given pressures.

    With bounds of friction that are given, a motion that shows it is a proof.

    Args:
        p: tractions (rows,) [Pa]; of them the pressures count.
        motion: rigid motion (c,) of the contact dofs.
    """
    surface, cone, moved = problem.surface, problem.cone, problem.surface.N @ motion
    n = surface.normal_rows
    taken = float((surface.W * p * moved)[:n].sum())
    for place in cone.with_friction():
        far = np.linalg.norm((moved[place.tangential].reshape(place.rows.free.shape)) * place.rows.free, axis=1)
        bound = place.rows.W_t * cone.bound(place, p[place.normal])
        taken += float(bound[far > 0] @ far[far > 0])
    return float(problem.load.resultant @ (surface.R.T @ motion)) > taken


def balancing_tractions(problem: SurfaceProblem) -> Array | None:
    """Admissible tractions (rows,) [Pa] that balance the loads on rigid bodies; None if none were found.

    Among all such tractions they press across the smallest gaps, with little friction, and as evenly as possible.
    """
    programme = _Programme.of(problem, outer=False)
    if programme is None:
        return np.zeros(len(problem.gap))
    n = problem.surface.normal_rows
    room = (problem.gap - problem.offset)[:n]
    room = room / (
        max(problem.u_ref, np.abs(room).max(initial=0.0)) or 1.0
    )  # a gap much smaller than the deformation costs little
    # cost of friction, relative to that of pressing across the largest gap
    friction = np.full(programme.along.shape[1], 1e2)
    # an uneven pressure costs little beside pressing across the largest gap
    found = programme.solve(np.concatenate([room, friction, [CLOSE], np.zeros(2 * programme.motions)]), left=0.0)
    if found is None:
        return None
    forces = programme.onto @ found.x[: programme.onto.shape[1]]
    return np.asarray(programme.force * forces / problem.surface.W)


@dataclass(frozen=True, kw_only=True)
class _Programme:
    """The linear programme.

    Its unknowns, all of order 1: normal forces, friction by direction, the largest pressure, the unbalanced load.
    """

    force: float  # [N], the unit of forces
    rounding: float  # of the load, in that unit
    load: Array  # (r,) on the rigid modes
    onto: Sparse  # (rows, n + k): normal forces and friction by direction to forces on rows
    along: Sparse  # (rows, k): the columns of friction in it
    held: Array  # (r, n + k): the same forces to their work on the rigid modes
    A_ub: Sparse  # A_ub x <= b_ub
    b_ub: Array
    pulls: Bools  # (n,) normal forces of either sign

    @property
    def motions(self) -> int:
        """Number r of rigid modes."""
        return len(self.load)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.onto.shape[1]) + 1 + 2 * self.motions

    @classmethod
    def of(cls, problem: SurfaceProblem, outer: bool) -> _Programme | None:
        """The programme with bounds of friction from outside (`outer`) or inside; None if the load is zero."""
        surface, n, cone = problem.surface, problem.surface.normal_rows, problem.cone
        load, size = problem.load.resultant, np.sqrt(len(surface.R))
        force = size * float(np.linalg.norm(load))
        # resultant that counts as zero, relative to the sum of the magnitudes of all forces
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

    def solve(self, cost: Array, left: float) -> OptimizeResult | None:
        """The optimum for a cost (size,), or None; at most `left` of each load may stay unbalanced."""
        r, eye = self.motions, np.eye(self.motions)
        lower = np.concatenate([np.where(self.pulls, -np.inf, 0.0), np.zeros(self.size - len(self.pulls))])
        upper = np.concatenate([np.full(self.size - 2 * r, np.inf), np.full(2 * r, left)])
        A_eq = np.hstack([self.held, np.zeros((r, 1)), eye, -eye])
        found = linprog(
            cost, self.A_ub, self.b_ub, A_eq, self.load, bounds=np.column_stack([lower, upper]), method="highs"
        )
        return found if found.status == 0 else None


@dataclass(frozen=True, kw_only=True)
class _Bounds:
    """Friction bounds of one contact: sums @ forces by direction <= share @ normal forces + cap."""

    along: Sparse  # (rows, k): forces by direction to forces on rows
    share: Sparse  # (m, n)
    sums: Sparse  # (m, k)
    cap: Array  # (m,)


def _bounds(problem: SurfaceProblem, place: ContactBlock, outer: bool, force: float) -> _Bounds:
    """Each point's disc of friction replaced by a polygon around it (outer) or inside it (inner)."""
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
        slope = np.inf  # where some points may pull, others can press, and so hold, without limit
    slopes, a = [(slope, 0.0)], rows.friction.at_no_pressure
    if a:  # the inner bound vanishes with the pressure, as the law's own does
        slopes = [(slope, a)] if outer or rows.normal.sides == 2 else [(slope, a), (STEEP, 0.0)]
    found = []
    if np.isfinite(cap):
        found.append((sparse.csr_matrix((m, surface.normal_rows)), rows.W_t * cap / force))
    for slope, start in slopes:
        if not np.isfinite(slope):
            continue
        share = sparse.diags(slope * rows.W_t) @ place.average @ sparse.diags(1 / surface.W[place.normal])
        left, right = place.normal.start, surface.normal_rows - place.normal.stop
        share = sparse.hstack([sparse.csr_matrix((m, left)), share, sparse.csr_matrix((m, right))])
        found.append((share, rows.W_t * start / force))
    return _Bounds(
        along=along,
        share=sparse.vstack([sparse.csr_matrix((0, surface.normal_rows)), *(s for s, _ in found)]),
        sums=sparse.vstack([sparse.csr_matrix((0, m * count)), *(sums for _ in found)]),
        cap=np.concatenate([np.zeros(0), *(b for _, b in found)]),
    )
