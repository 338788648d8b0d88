"""Rigid modes of the bodies: translations and rotations, which of them supports leave free, which they prescribe."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.linalg import null_space

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.mesh.joints import Joints
from stickslip.solvers.fem.constraints import Constraints
from stickslip.solvers.fem.rigid_fields import rigid_fields, rigid_names

TURNING = 1e-6  # coefficients of motions of size 1 that differ by less are equal
ROUNDING = 1e-12  # of the largest prescribed displacement: a smaller difference counts as zero


class RigidModes:
    """Rigid motions of the parts of the mesh, given by coefficients (parts k,) of the k modes of `rigid_fields`.

    Where a rigid motion satisfies everything that is prescribed, it is the lifting u_s of the prescribed displacement:
    it strains no body.
    """

    def __init__(self, constraints: Constraints, joints: Joints, low: Array, high: Array) -> None:
        """
        Args:
            constraints: supports and periodicity.
            joints: nodes that several parts share.
            low, high: corners of the box around the mesh (d,) [m].
        """
        self.joints = joints
        self.constraints, self.centre, self.size = constraints, (low + high) / 2, float(np.max(high - low))

    def fields(self, points: Array) -> Array:
        """Rigid modes (m, d, k) at points (m, d) [m]; see `rigid_fields`."""
        return rigid_fields(points, self.centre, self.size, self.constraints.axisymmetric)

    @cached_property
    def resisted(self) -> Array:
        """(rows, parts k): motion of each mode along supports and springs, between periodic sides, and in joints."""
        of, kinds = self.constraints, len(rigid_names(self.constraints.dim, self.constraints.axisymmetric))
        held = self._of_nodes(of.held)
        blocks = [np.einsum("krd,kdc->krc", alike.directions, held[alike.at]) for alike in of.alike]
        for point in of.remote.rigid:
            moved = self._of_parts(point.points, point.part)
            blocks.append(point.motion_of(moved))
        blocks.append(self._of_nodes(of.followers) - self._of_nodes(of.roots(of.followers)))
        one, other = self.joints.parts.T
        blocks.append(self._of_parts(self.joints.points, one) - self._of_parts(self.joints.points, other))
        fields = self._of_parts(of.sprung.points, of.sprung.part)
        blocks.append(np.einsum("md,mdc->mc", of.sprung.directions, fields))
        linked = np.einsum("wd,wdc->wc", of.links.weights, self._of_parts(of.links.points, of.links.part))
        blocks.append(np.zeros((len(of.links.stiffness), linked.shape[1])))
        np.add.at(blocks[-1], of.links.of, linked)
        for point in of.remote.rigid:
            if len(np.unique(point.part)) > 1:
                blocks.append(point.left(self._of_parts(point.points, point.part)))
        nothing = np.zeros((1, of.parts * kinds))
        return np.concatenate([nothing, *(block.reshape(-1, of.parts * kinds) for block in blocks)])

    def _of_nodes(self, nodes: Ints) -> Array:
        """Rigid modes (n, d, parts k) at nodes (n,); zero for the other parts than a node's own."""
        part = np.array([self.constraints.part[int(n)] for n in nodes], np.int64)
        return self._of_parts(self.constraints.points_of(nodes), part)

    def _of_parts(self, points: Array, part: Ints) -> Array:
        """Rigid modes (n, d, parts k) at points (n, d) of parts (n,); zero for all other parts."""
        fields = self.fields(points)
        found = np.zeros((*fields.shape[:2], self.constraints.parts, fields.shape[2]))
        found[np.arange(len(points)), :, part] = fields
        return found.reshape(*fields.shape[:2], self.constraints.parts * fields.shape[2])

    @cached_property
    def unresisted(self) -> Array:
        """Coefficients (parts k, r) of the rigid modes that supports leave free: the null space of `resisted`."""
        return np.asarray(null_space(np.linalg.qr(self.resisted, mode="r"), rcond=1e-9))

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.pinv(self.resisted, rcond=1e-9))

    def hinge(self, modes: Array) -> Array | None:
        """Where (d,) [m] parts turn against each other most in motions (parts k, s); None if they do so nowhere."""
        one, other = modes.reshape(self.constraints.parts, -1)[self.joints.parts.T]
        apart = np.linalg.norm(one - other, axis=1)
        turning = len(apart) > 0 and apart.max() > TURNING
        return self.joints.points[np.argmax(apart)] if turning else None

    def followed(self, time: float) -> Array | None:
        """Coefficients (parts, k) [m] of a rigid motion that satisfies all that is prescribed at a time, or None."""
        of = self.constraints
        of_rigid = [point.wanted(of.course, time) for point in of.remote.rigid]
        wanted = np.concatenate([np.zeros(1), *(rows.ravel() for rows in of.wanted(time)), *of_rigid])
        wanted = np.pad(wanted, (0, len(self.resisted) - len(wanted)))
        found, rounding = self._inverse @ wanted, ROUNDING * np.abs(wanted).max()
        found[np.abs(found) <= rounding] = 0.0  # periodic sides must move alike to the last digit
        if np.any(np.abs(self.resisted @ found - wanted) > rounding):
            return None
        return np.asarray(found.reshape(self.constraints.parts, -1))

    def displacement(self, coefficients: Array, points: Array, part: Ints) -> Array:
        """Displacement (m, d) [m] of a rigid motion.

        Args:
            coefficients: (parts, k) [m].
            points: (m, d) [m].
            part: (m,) part of the mesh that each point belongs to.
        """
        d = points.shape[1]
        of_frame = self.fields(np.concatenate([np.zeros((1, d)), np.eye(d)])) @ coefficients.T  # (1 + d, d, parts)
        shift, turn = of_frame[0].T, (of_frame[1:] - of_frame[0]).transpose(2, 1, 0)
        if len(coefficients) == 1:
            return np.asarray(points @ turn[0].T + shift[0])
        return np.asarray(np.einsum("mij,mj->mi", turn[part], points) + shift[part])
