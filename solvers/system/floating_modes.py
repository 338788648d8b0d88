"""Rigid motions as vectors over the free displacements: multigrid's near-nullspace, and motions of floating bodies."""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.parallel.replicated import Replicated
from stickslip.solvers.system.system import System


def near_nullspace(system: System) -> Array:
    """The k rigid motions (owned, k) of all bodies together, as if there were no supports."""
    return _on_free_numbers(system, _fields(system))


class FloatingMotions:
    """Motions that no support resists, K_B Z = 0, r of them; R (c, r) are their values at the contact dofs.

    R is orthonormal: R^T u_c are the amplitudes (r,) of the motions in a displacement, Z^T f the resultant of a force.
    """

    def __init__(self, system: System, contact: Replicated, R: Array) -> None:
        self.R, self.contact, self.comm = R, contact, system.mesh.comm
        if not R.shape[1]:
            self.Z = np.zeros((system.K_B.getLocalSize()[0], 0))
            return
        motions = system.lifting.unresisted
        parts = system.mesh.part_count
        own = motions.reshape(parts, len(motions) // parts, R.shape[1])[system.nodes.part[: system.nodes.owned]]
        fields = _on_free_numbers(system, _fields(system) @ own)
        values = np.zeros((len(contact.rows), R.shape[1]))
        values[contact.mine] = fields[contact.local]
        self.Z = fields @ np.linalg.inv(R.T @ self.comm.allreduce(values))

    def resultant(self, f: Array) -> Array:
        """Z^T f (r,) [N] of forces (owned,); collective."""
        return np.asarray(self.comm.allreduce(self.Z.T @ f))

    def balance(self, f: Array) -> None:
        """Subtract forces at the contact dofs so that the resultant of f (owned,) [N] is zero; in place, collective."""
        if self.R.shape[1]:
            f[self.contact.local] -= (self.R @ self.resultant(f))[self.contact.mine]

    def pin(self, q: Array, along: Array | float = 0.0) -> None:
        """Move a displacement (owned,) along the motions until R^T q_c is `along`; in place, collective."""
        if self.R.shape[1]:
            moved = self.comm.allreduce(self.R[self.contact.mine].T @ q[self.contact.local])
            q += self.Z @ (along - moved)


def _fields(system: System) -> Array:
    """Rigid motions (m, d, k) at the owned nodes; see `rigid_fields`."""
    return system.lifting.fields(system.nodes.points[: system.nodes.owned])


def _on_free_numbers(system: System, fields: Array) -> Array:
    """Free displacements q (owned, k) of displacements (m, d, k) that supports and periodic sides allow."""
    T = system.T  # its columns are orthogonal to each other
    u, q = T.createVecLeft(), T.createVecRight()
    weight = T.transposeMatMult(T).getDiagonal().array
    found = np.zeros((q.getLocalSize(), fields.shape[2]))
    for k in range(fields.shape[2]):
        u.array[:] = fields[:, :, k].ravel()
        T.multTranspose(u, q)
        found[:, k] = np.divide(q.array, weight, out=np.zeros(len(weight)), where=weight > 0)
    return found
