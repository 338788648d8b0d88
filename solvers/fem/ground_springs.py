"""What springs per area between sides and the ground exert on the bodies, in a displacement of these.

Their stress is linear and symmetric, so a component of the force or moment is the work of it on a rigid motion, which
is in every finite element space: one row of forces a component, assembled once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Comm, Sparse, Vec
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.fem.rigid_fields import parts_of_motion, rigid_names


@dataclass(frozen=True)
class GroundSprings:
    """All springs to the ground of a problem, each with k components: force [N], and moment about the origin [N m]."""

    keys: tuple[str, ...]
    forces: Sparse  # (keys k, own dofs) by unit translation [N/m] or rotation [N]
    comm: Comm

    @classmethod
    def of(cls, weak: WeakForms) -> GroundSprings:
        """Assemble the rows; collective."""
        rows, dim = list[Sparse](), weak.mesh.dim
        modes = np.eye(len(rigid_names(dim, weak.mesh.axisymmetric)))
        for springs in weak.problem.springs:
            translation, rotation = (weak.constant(part) for part in parts_of_motion(0 * modes[0], dim))
            form = weak.compile(weak.springs(springs, weak.rigid_motion(translation, rotation)))
            for mode in modes:
                translation.value[:], rotation.value[:] = parts_of_motion(mode, dim)
                rows.append(sparse.csr_matrix(dx.assemble_vector(form).array_r))
        forces = sparse.vstack(rows).tocsr() if rows else sparse.csr_matrix((0, 0))
        return cls(tuple(springs.key for springs in weak.problem.springs), forces, weak.mesh.comm)

    def exerted(self, u: Vec) -> Array:
        """All components on the bodies (keys k,) in a displacement [m]; collective."""
        if not self.keys:
            return np.zeros(0)
        return np.asarray(self.comm.allreduce(-(self.forces @ u.array_r)))

    def by_key(self, components: Array, dim: int) -> Mapping[str, tuple[Array, Array]]:
        """Force (d,) [N] and moment (1,) or (3,) [N m] of each; radial forces and moments are 0 over a full circle."""
        each = np.split(components, max(len(self.keys), 1))
        return {key: parts_of_motion(own, dim) for key, own in zip(self.keys, each, strict=False)}
