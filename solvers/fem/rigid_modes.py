"""Rigid modes of the bodies: translations and rotations, which of them supports leave free, which they prescribe."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from mpi4py import MPI
from scipy.linalg import null_space

from stickslip.geometry.arrays import CLOSE, EXACT, ROUNDING, Array, Ints
from stickslip.geometry.mesh.joints import Joints
from stickslip.solvers.fem.constraints import Constraints
from stickslip.solvers.fem.rigid_fields import rigid_fields, rigid_names


class RigidModes:
    """Rigid motions of the parts of the mesh, given by coefficients (parts k,) of the k modes of `rigid_fields`.

    Where a rigid motion satisfies everything that is prescribed, it is the lifting u_s of the prescribed displacement:
    it strains no body.
    """

    def __init__(self, constraints: Constraints, joints: Joints, low: Array, high: Array) -> None:
        """Factorise what resists them, rank by rank; collective.

        Args:
            constraints: supports and periodicity.
            joints: nodes that several parts share.
            low, high: corners of the box around the mesh (d,) [m].
        """
        self.joints = joints
        self.constraints, self.centre, self.size = constraints, (low + high) / 2, float(np.max(high - low))
        self._followed: tuple[object, Array | None] | None = None  # what was asked last, and its answer
        comm = constraints.comm
        self._Q, self._R = np.linalg.qr(self._resisted())  # Q R are the rows that resist
        if comm.size > 1:
            every = comm.allgather(self._R)
            whole, self._R = np.linalg.qr(np.concatenate(every))
            first = sum(len(each) for each in every[: comm.rank])
            self._Q = self._Q @ whole[first : first + len(every[comm.rank])]  # of this rank

    def fields(self, points: Array) -> Array:
        """Rigid modes (m, d, k) at points (m, d) [m]; see `rigid_fields`."""
        return rigid_fields(points, self.centre, self.size, self.constraints.axisymmetric)

    def _resisted(self) -> Array:
        """(rows, parts k) of this rank: motion of each mode along supports and springs, and in joints.

        So they are between periodic sides. Rows that every rank knows are those of rank 0.
        """
        of, kinds = self.constraints, len(rigid_names(self.constraints.dim, self.constraints.axisymmetric))
        nothing = np.zeros((1, of.parts * kinds))
        blocks = []
        for alike in of.alike:
            at = of.held[alike.at[alike.own]] - of.nodes.offset
            held = self._of_parts(of.nodes.points[at], of.nodes.part[at])
            blocks.append(np.einsum("krd,kdc->krc", alike.directions[alike.own], held))
        if of.comm.rank == 0:
            blocks += self._shared()
        fields = self._of_parts(of.sprung.points, of.sprung.part)
        blocks.append(np.einsum("md,mdc->mc", of.sprung.directions, fields))
        return np.concatenate([nothing, *(block.reshape(-1, of.parts * kinds) for block in blocks)])

    def _shared(self) -> list[Array]:
        """Rows that every rank knows, those of rigid sides first."""
        of, periodic = self.constraints, self.constraints.periodic
        blocks = [point.motion_of(self._of_parts(point.points, point.part)) for point in of.remote.rigid]
        blocks.append(
            self._of_parts(periodic.points, periodic.part)
            - periodic.turn @ self._of_parts(periodic.root_points, periodic.root_part)
        )
        one, other = self.joints.parts.T
        blocks.append(self._of_parts(self.joints.points, one) - self._of_parts(self.joints.points, other))
        linked = np.einsum("wd,wdc->wc", of.links.weights, self._of_parts(of.links.points, of.links.part))
        blocks.append(np.zeros((len(of.links.stiffness), linked.shape[1])))
        np.add.at(blocks[-1], of.links.of, linked)
        for point in of.remote.rigid:
            if len(np.unique(point.part)) > 1:
                blocks.append(point.left(self._of_parts(point.points, point.part)))
        return blocks

    def _of_parts(self, points: Array, part: Ints) -> Array:
        """Rigid modes (n, d, parts k) at points (n, d) of parts (n,); zero for all other parts."""
        fields = self.fields(points)
        found = np.zeros((*fields.shape[:2], self.constraints.parts, fields.shape[2]))
        found[np.arange(len(points)), :, part] = fields
        return found.reshape(*fields.shape[:2], self.constraints.parts * fields.shape[2])

    @cached_property
    def unresisted(self) -> Array:
        """Coefficients (parts k, r) of the rigid modes that supports leave free: the null space of `_resisted`."""
        return np.asarray(null_space(self._R, rcond=ROUNDING))

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.pinv(self._R, rcond=ROUNDING))

    def hinge(self, modes: Array) -> Array | None:
        """Where (d,) [m] parts turn against each other most in motions (parts k, s); None if they do so nowhere."""
        one, other = modes.reshape(self.constraints.parts, -1)[self.joints.parts.T]
        apart = np.linalg.norm(one - other, axis=1)
        # coefficients of motions of size 1 that differ by less are equal
        turning = len(apart) > 0 and apart.max() > CLOSE
        return self.joints.points[np.argmax(apart)] if turning else None

    def followed(self, time: float) -> Array | None:
        """Coefficients (parts, k) [m] of a rigid motion that satisfies all that is prescribed at a time, or None.

        Collective. A substep asks three times; the last answer is kept.
        """
        asked = self.constraints.course.at(time)
        if self._followed is None or self._followed[0] != asked:
            self._followed = asked, self._follow(time)
        return self._followed[1]

    def _follow(self, time: float) -> Array | None:
        of, comm = self.constraints, self.constraints.comm
        rows = [values[alike.own].ravel() for alike, values in zip(of.alike, of.wanted(time), strict=True)]
        of_rigid = [point.wanted(of.course, time) for point in of.remote.rigid]  # all ranks raise, or none
        wanted = np.concatenate([np.zeros(1), *rows, *(of_rigid if comm.rank == 0 else [])])
        wanted = np.pad(wanted, (0, len(self._Q) - len(wanted)))
        # of the largest prescribed displacement: a smaller difference counts as zero
        rounding = EXACT * comm.allreduce(float(np.abs(wanted).max()), op=MPI.MAX)
        found = self._inverse @ comm.allreduce(self._Q.T @ wanted)
        found[np.abs(found) <= rounding] = 0.0  # periodic sides must move alike to the last digit
        off = float(np.abs(self._Q @ (self._R @ found) - wanted).max())
        if comm.allreduce(off, op=MPI.MAX) > rounding:
            return None
        return np.asarray(found.reshape(of.parts, -1))

    def displacement(self, coefficients: Array, points: Array, part: Ints) -> Array:
        """Displacement (m, d) [m] of a rigid motion.

        Args:
            coefficients: (parts, k) [m].
            points: (m, d) [m].
            part: (m,) part of the mesh that each point belongs to.
        """
        d, arms = points.shape[1], points - self.centre
        frame = self.centre + self.size * np.concatenate([np.zeros((1, d)), np.eye(d)])
        of_frame = self.fields(frame) @ coefficients.T  # (1 + d, d, parts)
        shift, turn = of_frame[0].T, (of_frame[1:] - of_frame[0]).transpose(2, 1, 0) / self.size
        if len(coefficients) == 1:
            return np.asarray(arms @ turn[0].T + shift[0])
        return np.asarray(np.einsum("mij,mj->mi", turn[part], arms) + shift[part])
