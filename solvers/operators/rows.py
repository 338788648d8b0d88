"""One contact's rows: where its unknowns live, what they weigh, and what they measure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.obstacles import Obstacle
from geometry.surface import Surface
from solvers.effects.laws import FrictionLaw, NormalLaw

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ContactRows:
    """m_n normal points, m_t tangential points, n surface nodes, d dimensions.

    `N_n`, `N_t` act on the displacement of the surface's nodes relative to the obstacle, flattened (n d).
    """

    name: str
    surface: Surface
    obstacle: Obstacle
    normal: NormalLaw
    friction: FrictionLaw | None
    frames: Array  # (n, d, d): row 0 the normal n, then the tangents
    node_weights: Array  # (n,) [m^(d-1)]
    node_gap: Array  # (n,) [m], gap_offset included; like all nodal values in the basis phi~ of `Surface`
    N_n: Any  # (m_n, n d) sparse
    W_n: Array  # (m_n,)
    gap: Array  # (m_n,) [m]
    N_t: Any  # (m_t (d-1), n d) sparse
    W_t: Array  # (m_t,)
    free: NDArray[np.bool_]  # (m_t, d-1) tangential directions that carry a multiplier
    psi: Any  # (n, m_n) sparse: ∫ psi_j of a normal field, by node
    share_t: Any  # (m_t, n) sparse: which nodes a tangential point stands for; columns add up to 1
    dropped: int  # nodes whose multiplier a support or another contact makes redundant

    @property
    def average(self) -> Any:
        """Sparse (m_t, m_n): pressure at normal points to psi_j-average at tangential points."""
        return (self.share_t @ self.psi).multiply(1 / self.W_t[:, None]).tocsr()

    def node_pressure(self, p_n: Array) -> Array:
        """Pressure (n,) [Pa] at the surface's nodes, with the same resultant."""
        return np.asarray((self.psi @ p_n) / self.node_weights)

    def node_traction(self, t: Array) -> Array:
        """Tangential multiplier t (n, d) [Pa], Cartesian, at the surface's nodes; sigma_T = -t."""
        n, d = self.surface.points.shape
        if not len(self.W_t):
            return np.zeros((n, d))
        nodal_forces = self.N_t.T @ (t.reshape(len(self.W_t), d - 1) * self.W_t[:, None]).ravel()
        forces = self.surface.forces_transform @ nodal_forces.reshape(n, d)
        return np.asarray(forces / self.node_weights[:, None])

    def nodal_forces(self, p_n: Array, t: Array) -> Array:
        """B^T p (n, d) [N]; the force on the body is its negative."""
        total = self.N_n.T @ (self.W_n * p_n)
        if len(self.W_t):
            total = total + self.N_t.T @ (t.reshape(len(self.W_t), -1) * self.W_t[:, None]).ravel()
        return np.asarray(total.reshape(self.surface.points.shape))

    def node_motion(self, relative: Array) -> tuple[Array, Array]:
        """Normal (n,) and tangential (n, d), Cartesian, parts of a relative displacement (n, d) [m]."""
        relative = self.surface.transform @ relative
        normal = np.einsum("nd,nd->n", self.frames[:, 0], relative)
        return normal, relative - normal[:, None] * self.frames[:, 0]
