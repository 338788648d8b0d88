"""The contact laws in contact coordinates: local problems of the points, their tangent, and the energy of friction.

Each rank has the rows of its own slave nodes, and of others only the pressures that its friction bounds depend on.
Where pressure is a function of displacement, at quadrature points, it is a force on the coordinates like those of the
bodies, see `CompliantFaces`.

Compliant faces press at quadrature points, of which every rank has all: their pressure is a function of displacement,
and acts as forces on the coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import Array, Bools, Ints, inverses
from stickslip.geometry.mesh.ranks import of_all_ranks
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.admissible_set import AdmissibleSet, ContactBlock
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.parallel.replicated import Replicated
from stickslip.solvers.tangent.coordinates import ContactCoordinates
from stickslip.solvers.tangent.operator import TangentOperator


@dataclass(frozen=True)
class Pressed:
    """The faces at a displacement; arrays (rows,) are zero at rows that are not compliant."""

    p: Array  # (rows,) [Pa]
    penetration: Array  # (rows,) [m]
    stiffness: Array  # (rows,) W dp/d(penetration) [N/m]
    force: Array  # (owned,) on the coordinates [N]
    diagonal: Array  # (owned,) sums of the rows of their stiffness [N/m]


class CompliantFaces:
    """Motion of the faces by the coordinates, N T, and the forces of their pressures."""

    def __init__(self, operator: TangentOperator, coordinates: ContactCoordinates, problem: SurfaceProblem) -> None:
        """Take the faces of a step; collective."""
        self.problem, self.operator = problem, operator
        self.places = [block for block in problem.cone.places if block.rows.normal.at_quadrature]
        self._vector = operator.K_B.createVecRight()
        none, size = np.zeros(len(problem.gap)), self._vector.getLocalSize()
        self._nothing = Pressed(none, none, none, *np.zeros((2, size)))
        if self.places:
            compliant = np.zeros(len(problem.gap))
            for block in self.places:
                compliant[block.normal] = 1.0
            self.N: Sparse = (sparse.diags(compliant) @ coordinates.rows).tocsr()
            self._size = abs(self.N)
            self._sums = self._size @ np.ones(self.N.shape[1])
            self.scatter = Replicated(self._vector, coordinates.numbers)

    def motion(self, v: Array) -> Array:
        """Closing motion N v (rows,) [m] of coordinates v (owned,); collective."""
        if not self.places:
            return np.zeros(len(self.problem.gap))
        self._vector.array[:] = v
        return np.asarray(self.N @ self.scatter.read(self._vector))

    def pressed(self, v: Array) -> Pressed:
        """The faces at coordinates v (owned,) [m]; collective."""
        if not self.places:
            return self._nothing
        p, x = self._pressures(v)
        stiffness = np.zeros(len(p))
        for block in self.places:
            n = block.normal
            stiffness[n] = self.problem.surface.W[n] * block.rows.normal.stiffness(p[n], x[n])
        diagonal = self._written(self._size.T @ (stiffness * self._sums))
        return Pressed(p, x, stiffness, self.forces(self.problem.surface.W * p), diagonal)

    def _pressures(self, v: Array) -> tuple[Array, Array]:
        """Pressures (rows,) [Pa] and penetrations (rows,) [m] at coordinates v (owned,) [m]; collective."""
        p, x = np.zeros(len(self.problem.gap)), self.motion(v) + self.problem.offset - self.problem.gap
        for block in self.places:
            p[block.normal] = block.rows.normal.pressure(x[block.normal])
        return p, x

    def forces(self, weighted: Array) -> Array:
        """Forces N^T f (owned,) [N] of forces f (rows,) [N] of the points, if faces are compliant; collective."""
        return self._written(self.N.T @ weighted)

    def _written(self, values: Array) -> Array:
        """Values (owned,) of those of all coordinates of contact nodes (n d,); collective."""
        self._vector.array[:] = 0.0
        self.scatter.write(self._vector, values)
        return np.array(self._vector.array_r)

    def growth(self, was: Pressed, v: Array, moved: Array) -> float:
        """Growth of the energy stored in the faces [J] by a motion from v; collective."""
        if not self.places:
            return 0.0
        energy, W = self.problem.cone.energy, self.problem.surface.W
        return float(W @ (energy(self._pressures(v + moved)[0]) - energy(was.p)))


DAMPED = 1.8  # factor on the diagonal of K in a sweep: all nodes move at the same time


@dataclass(frozen=True, kw_only=True)
class Slip:
    """The m slipping points of one contact, those without friction too."""

    place: ContactBlock
    rows: Ints  # (m, c)
    e: Array  # (m, c) direction of slip
    across: Array  # (m,) stiffness W s / |slip| [N/m] against turning
    slope: Sparse  # (m, m_n) of the bound by the pressures that can change


@dataclass(frozen=True, kw_only=True)
class Tangent:
    """The laws linearised at a state."""

    free: Bools  # (rows,) open, slipping, or on a spring: not held
    spring: Array  # (rows,) stiffness W k_T [N/m] of points that stick on a spring
    slips: tuple[Slip, ...]
    bound: Array  # (rows,) W s [N] of slipping rows
    p: Array  # (rows,) tractions [Pa] by the laws, those of held rows by equilibrium
    pressed: Pressed  # the compliant faces


class ContactPoints:
    """The laws of one step on this rank's rows. Arrays (m d,) are over its coordinates at slave nodes."""

    def __init__(
        self, operator: TangentOperator, coordinates: ContactCoordinates, problem: SurfaceProblem, faces: CompliantFaces
    ) -> None:
        """Take the rows that this rank needs; collective."""
        self.comm, self.faces, self.operator = operator.comm, faces, operator
        low, high = operator.K_B.getOwnershipRange()
        mine = (coordinates.at >= low) & (coordinates.at < high)
        self.cone, self.of = problem.cone, np.arange(len(mine))
        if self.comm.size > 1:
            self.cone, self.of = _part(problem.cone, mine)
        at = coordinates.at[self.of]
        self.target = (problem.gap - problem.offset)[self.of]  # w - gap is v - target
        self.W, self.size = problem.surface.W[self.of], len(mine)
        self.rows = np.flatnonzero(at >= 0)
        self.own = np.flatnonzero(mine[self.of])
        place = np.full(high - low, -1)
        place[operator.at] = np.arange(len(operator.at))
        self.place = np.full(len(at), -1)  # (rows,) positions of this rank's own rows among (m d,)
        self.place[self.own] = place[at[self.own] - low]
        self._vector = operator.K_B.createVecRight()
        self.scatter = Replicated(self._vector, at[self.rows]) if self.comm.size > 1 else None
        self.k_s = DAMPED * np.einsum("mii->mi", operator.slaves.diagonal).ravel()
        self.k = self.read(self.k_s)
        self.k[self.k == 0] = 1.0  # rows that carry nothing, or are compliant
        for block in self.cone.with_friction():
            k = np.where(block.rows.free, self.k[block.tangential].reshape(block.rows.free.shape), 0.0)
            self.k[block.tangential] = np.repeat(np.where(k.any(axis=1), k.max(axis=1, initial=0.0), 1.0), k.shape[1])

    def read(self, x: Array) -> Array:
        """Row values (rows,) of values x (m d,); collective."""
        found = np.zeros(len(self.of))
        if self.scatter is None:
            found[self.own] = x[self.place[self.own]]
            return found
        self._vector.array[self.operator.at] = x
        found[self.rows] = self.scatter.read(self._vector)
        return found

    def write(self, rows: Array, others: Array) -> Array:
        """Values (m d,) of row values (rows,), and of `others` (m d,) at coordinates that are no row."""
        found = others.copy()
        found[self.place[self.own]] = rows[self.own]
        return found

    def gathered(self, x: Array) -> Array:
        """Row values of all rows on every rank, from those of each rank's own ones; collective."""
        found = np.zeros(self.size)
        found[self.of] = x  # compliant rows are everywhere
        found[of_all_ranks(self.comm, self.of[self.own])] = of_all_ranks(self.comm, x[self.own])
        return found

    def relax(self, v: Array, g: Array, pressed: Pressed) -> tuple[Array, Array]:
        """One step of every point to the solution of its own laws, as if the others were at rest.

        Args:
            v: coordinates (m d,) [m].
            g: forces (m d,) [N] that bodies leave to contact.
            pressed: the compliant faces.

        Returns:
            The change of v, and the trial tractions (rows,) [Pa].
        """
        at, force, gamma = self.read(v), self.read(g), self.k / self.W
        trial = force / self.W + gamma * (at - self.target)
        self._set_pressed(trial, pressed, gamma)
        p = self.cone.project(trial, gamma)
        moved = (force - self.W * p) / self.k
        held = (p == trial) & (self.cone.softness == 0)
        moved[held] = (self.target - at)[held]
        return self.write(moved, g / (self.k_s + DAMPED * pressed.diagonal[self.operator.at])), trial

    def tangent(self, v: Array, g: Array, trial: Array, pressed: Pressed) -> Tangent:
        """The laws linearised where `relax` has led, friction bounds by the pressures that equilibrium asks for."""
        force, moved, soft = self.read(g), self.read(v) - self.target, self.cone.softness
        before = self.cone.project(trial, self.k / self.W)
        count = len(force)
        free, spring, bound = np.ones(count, bool), np.zeros(count), np.zeros(count)
        p, slips = np.zeros(count), []
        for block in self.cone.places:
            n, law = block.normal, block.rows.normal
            if law.at_quadrature:
                before[n] = p[n] = pressed.p[self.of[n]]
                continue
            closed = np.isinf(law.stiffness(before[n], trial[n]))
            free[n] = ~closed
            asked = force[n] / self.W[n]
            p[n] = np.where(closed, asked if law.sides == 2 else np.maximum(asked, 0.0), 0.0)
        for block in self.cone.with_friction():
            n, shape = block.normal, block.rows.free.shape
            rows = np.arange(block.tangential.start, block.tangential.stop).reshape(shape)
            s, was = self.cone.bound(block, p[n]), self.cone.bound(block, before[n])
            hat, slid = trial[rows] * block.rows.free, moved[rows] * block.rows.free
            length = np.linalg.norm(slid, axis=1)
            gives = 1 + (self.k / self.W * soft)[rows[:, 0]]
            sticks = ((np.linalg.norm(hat, axis=1) <= was * gives) | (length == 0)) & (was > 0)
            stuck, at = rows[sticks].ravel(), np.flatnonzero(~sticks)
            on_spring = soft[stuck] > 0
            free[stuck] = on_spring
            spring[stuck] = np.divide(self.W[stuck], soft[stuck], out=np.zeros(len(stuck)), where=on_spring)
            p[stuck] = np.where(on_spring, spring[stuck] * moved[stuck], force[stuck]) / self.W[stuck]
            moves = length[at] > 0
            e = np.divide(slid[at], length[at, None], out=np.zeros_like(slid[at]), where=moves[:, None])
            p[rows[at]], bound[rows[at]] = s[at, None] * e, (self.W[rows[at, 0]] * s[at])[:, None]
            across = np.divide(bound[rows[at, 0]], length[at], out=np.zeros(len(at)), where=moves)
            changing = np.ones(len(p[n])) if block.rows.normal.at_quadrature else (~free[n]).astype(float)
            slope = self.cone.bound_slope(block, p[n])[at].multiply(changing[None, :]).tocsr()
            across = np.minimum(across, 1e6 * self.k[rows[at, 0]])  # largest stiffness across the slip
            slips.append(Slip(place=block, rows=rows[at], e=e, across=across, slope=slope))
        return Tangent(free=free, spring=spring, slips=tuple(slips), bound=bound, p=p, pressed=pressed)

    def residual(self, tangent: Tangent, g: Array) -> Array:
        """Forces (m d,) [N] out of balance on what is free to move, of forces g that bodies leave to contact."""
        return self.write(np.where(tangent.free, self.read(g) - self.W * tangent.p, 0.0), g)

    def apply(self, tangent: Tangent, y: Array, d: Array, closing: Array) -> Array:
        """Apply the laws to a motion d (m d,) [m] that bodies answer by forces y (m d,) [N].

        Args:
            closing: growth of the pressures of compliant faces by that motion (rows,) [Pa].
        """
        force, motion = self.read(y), self.read(d)
        found = force + tangent.spring * motion
        for slip in tangent.slips:
            n, rows = slip.place.normal, slip.rows
            less = -closing[self.of[n]] if slip.place.rows.normal.at_quadrature else force[n] / self.W[n]
            found[rows] -= (self.W[rows[:, 0]] * (slip.slope @ less))[:, None] * slip.e
            along = np.einsum("mc,mc->m", slip.e, motion[rows])[:, None] * slip.e
            found[rows] += slip.across[:, None] * (motion[rows] - along)
        return self.write(np.where(tangent.free, found, 0.0), y)

    def truncated(self, tangent: Tangent, d: Array) -> Array:
        """A motion d (m d,) without what is held."""
        return self.write(np.where(tangent.free, self.read(d), 0.0), d)

    def inverse_blocks(self, tangent: Tangent) -> Array:
        """Inverses (k, d, d) of the tangent's blocks at this rank's nodes around, zero on what is held."""
        operator, dim, pressed = self.operator, self.operator.dim, tangent.pressed.diagonal
        K, every = operator.slaves.diagonal, operator.around.diagonal.copy()
        D = K.copy()
        lines, of_K = D.reshape(-1, dim), K.reshape(-1, dim)
        for slip in tangent.slips:
            at, entries = self.place[slip.rows], slip.slope.tocoo()
            normal = slip.place.normal.start + entries.col
            same = (self.place[normal] >= 0) & (self.place[normal] // dim == at[entries.row, 0] // dim)
            point, normal = entries.row[same], normal[same]
            share = self.W[slip.rows[point, 0]] * entries.data[same] / self.W[normal]
            for c in range(at.shape[1]):
                np.subtract.at(lines, at[point, c], (share * slip.e[point, c])[:, None] * of_K[self.place[normal]])
                for b in range(at.shape[1]):
                    own = slip.place.rows.free[:, c][(slip.rows[:, 0] - slip.place.tangential.start) // at.shape[1]]
                    turned = slip.across * ((c == b) - slip.e[:, c] * slip.e[:, b])
                    lines[at[own, c], at[own, b] % dim] += turned[own]
        spring = self.write(tangent.spring, np.zeros(len(self.k_s)))
        D[:, range(dim), range(dim)] += (spring + pressed[operator.at]).reshape(-1, dim)
        free = self.write(tangent.free.astype(float), np.ones(len(self.k_s))).reshape(-1, dim)
        both = free[:, :, None] * free[:, None, :]
        D *= both
        D[:, range(dim), range(dim)] += 1 - free
        every[:, range(dim), range(dim)] += pressed[operator.around.at].reshape(-1, dim)
        here = operator.here[::dim] // dim
        every[here] = D
        every = inverses(every)
        every[here] *= both
        return every

    def sticking(self, tangent: Tangent) -> float:
        """Share of the closed area that sticks; collective."""
        share = np.zeros(len(self.of))
        share[self.own] = 1.0
        held, areas = ~tangent.free | (tangent.spring > 0), np.zeros(2)
        for block in self.cone.places:
            n = block.normal
            if block.rows.normal.at_quadrature:  # rows of every rank
                share[n] = 1 / self.comm.size
            first = np.arange(block.tangential.start, block.tangential.stop).reshape(block.rows.free.shape)[:, 0]
            areas += (self.W * share)[first] @ held[first], (self.W * share)[n] @ (held | (tangent.p > 0))[n]
        stuck, closed = self.comm.allreduce(areas)
        return float(stuck / closed) if closed else 1.0

    def project(self, tangent: Tangent, v: Array, new: Array) -> Array:
        """`new` without penetration, and without slip that has turned back on the way from v; all (m d,) [m]."""
        was, now = self.read(v) - self.target, self.read(new) - self.target
        for block in self.cone.places:
            if block.rows.normal.sides == 1:
                now[block.normal] = np.minimum(now[block.normal], 0.0)
        for slip in tangent.slips:
            back = np.einsum("mc,mc->m", was[slip.rows], now[slip.rows]) <= 0
            back &= tangent.bound[slip.rows[:, 0]] > 0
            now[slip.rows[back]] = 0.0
        return self.write(now + self.target, new)

    def friction_work(self, tangent: Tangent, v: Array, new: Array) -> float:
        """Growth of the energy of friction [J] at this rank's points from v to new, with frozen bounds; of springs."""
        was, now = self.read(v) - self.target, self.read(new) - self.target
        total = float((tangent.spring * (now**2 - was**2))[self.own].sum()) / 2
        for slip in tangent.slips:
            longer = np.linalg.norm(now[slip.rows], axis=1) - np.linalg.norm(was[slip.rows], axis=1)
            total += float(tangent.bound[slip.rows[:, 0]] @ longer)
        return total

    def _set_pressed(self, trial: Array, pressed: Pressed, gamma: Array) -> None:
        """Set the trial pressures of compliant rows to those whose resolvent is their pressure."""
        for block in self.cone.places:
            n, law = block.normal, block.rows.normal
            if law.at_quadrature:
                trial[n] = (pressed.p + pressed.penetration)[self.of[n]]
                gamma[n] = 1.0


def _part(cone: AdmissibleSet, mine: Bools) -> tuple[AdmissibleSet, Ints]:
    """The laws on the rows (rows,) that are mine, with the pressures that their bounds depend on; and those rows."""
    contacts: list[ContactRows] = []
    normal: list[Ints] = []
    tangential: list[Ints] = []
    for block in cone.places:
        c, shape = block.rows, block.rows.free.shape
        points = np.flatnonzero(mine[block.tangential].reshape(shape).any(axis=1))
        pressures = mine[block.normal].copy()
        pressures[c.average[points].indices] = True
        at = np.flatnonzero(pressures | c.normal.at_quadrature)
        rows = np.arange(block.tangential.start, block.tangential.stop).reshape(shape)
        contacts.append(
            replace(
                c,
                friction=c.friction and c.friction.of_points(points),
                W_n=c.W_n[at],
                W_t=c.W_t[points],
                free=c.free[points],
                psi=c.psi[:, at],
                phi=c.phi[:, at],
                share_t=c.share_t[points],
            )
        )
        normal.append(block.normal.start + at)
        tangential.append(rows[points].ravel())
    of = np.concatenate([np.zeros(0, np.int64), *normal, *tangential])
    return replace(cone, contacts=tuple(contacts)), of
