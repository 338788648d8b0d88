"""Moments of what acts on bodies: forces act where points are now, pressures along the normals of there.

The model stays that of small strain: tractions are those of the reference configuration. Only where they act follows
the motion, gaps that close and slips included; of what the normals' turn adds to it the first order is taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import Array, cross
from stickslip.geometry.obstacles.obstacle import Obstacle
from stickslip.geometry.protocols import Vec
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.system.system import System

Reacting = tuple[Array, Array]  # force (d,) [N] and moment (1,) or (3,) [N m]


@dataclass(frozen=True)
class Acting:
    """Forces on the n nodes of a contact's slave: the master, or an obstacle, feels the opposite at the same places."""

    points: Array  # (n, d) where they are now [m]
    forces: Array  # (n, d) by the rows of the contact [N]
    turned: Array  # (n, d) by which the turn of the normals since the rows were made changes them, first order [N]

    @classmethod
    def of(
        cls, rows: ContactRows, forces: Array, moved: Array, begun: Array, slid: Array, obstacle: Obstacle | None
    ) -> Acting:
        """The forces of a contact in its state.

        Args:
            forces: nodal forces B^T p (n_all, d) [N] of both sides.
            moved: displacement (n, d) [m] of the slave's nodes.
            begun: where they were (n, d) [m] when the rows were made, an obstacle being where it began.
            slid: displacement (n, d) [m] since then, relative to the obstacle.
            obstacle: None where the other side is deformable.
        """
        on_slave = -forces[: len(moved)]
        before, now, pushed = np.zeros_like(slid), np.zeros_like(slid), on_slave.any(axis=1)
        if obstacle is None or rows.normal.ties:  # they turn with the slave
            before, now = (replace(rows.surface, points=x).node_normals() for x in (begun, begun + slid))
            now = np.where(rows.surface.at_edge[:, None] > 0, before, now)  # an edge has the other side's normal
        elif pushed.any():
            before[pushed], now[pushed] = (-obstacle.normals(x[pushed]) for x in (begun, begun + slid))
        along, turn = (np.einsum("nd,nd->n", before, v)[:, None] for v in (on_slave, now))
        turn = now - turn * before
        turned = along * turn - np.einsum("nd,nd->n", turn, on_slave)[:, None] * before  # (n x turn) x force
        return cls(np.asarray(rows.surface.points + moved), on_slave, np.asarray(turned))

    @property
    def moment(self) -> Array:
        """Moment about the origin, (1,) or (3,) [N m]."""
        return np.asarray(np.atleast_1d(cross(self.points, self.forces + self.turned).sum(axis=0)))


def acting(
    system: System,
    rows: ContactRows,
    forces: Array,
    moved: Array,
    searched: Mapping[str, Array],
    at: tuple[float, Array],
) -> Acting:
    """What acts on the slave of a contact.

    Args:
        forces: nodal forces B^T p (n_all, d) [N] of both sides.
        moved: displacement (n_all, d) [m] of both.
        searched: see `State.searched`.
        at: time [s], and the motion of driven obstacles [m].
    """
    name, n, slid = system.problem.pairs[rows.name].obstacle, len(rows.surface.points), moved
    if name is not None and rows.name in searched:
        slid = moved - system.obstacles.motion(rows.name, rows.points, *at)
    elif name is not None:  # one that turns stays in its own place
        slid = moved - system.obstacles.translation(name, *at)
    before = searched.get(rows.name, np.zeros_like(moved))[:n]
    obstacle = None if name is None else system.problem.obstacles[name]
    return Acting.of(rows, forces, moved[:n], rows.surface.points + before, slid[:n] - before, obstacle)


def moved_along(system: System, u: Vec, reactions: Mapping[str, Reacting]) -> dict[str, Reacting]:
    """What holds the bodies where its sides are now, as they have moved in the mean; collective.

    Args:
        u: displacement of all dofs [m].
        reactions: force [N] and moment about the origin [N m] of supports and of springs to the ground, at the start.
    """
    if system.mesh.axisymmetric:
        return dict(reactions)
    values = u.array_r.reshape(-1, system.mesh.dim)
    places = system.held_places
    sums = [np.append(weights @ values[nodes], weights.sum()) for nodes, weights in places.values()]
    total = system.mesh.comm.allreduce(np.reshape(sums, (len(places), system.mesh.dim + 1)))
    shift = {key: own[:-1] / own[-1] for key, own in zip(places, total, strict=True)}
    return {
        key: (force, moment + np.atleast_1d(cross(shift[key], force)) if key in shift else moment)
        for key, (force, moment) in reactions.items()
    }
