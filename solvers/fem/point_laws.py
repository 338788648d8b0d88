"""The compliance law in UFL at the contact points of a surface, where its points do not lie in the facets of one side.

Between bodies u_n is a jump across two meshes, and where contact slides the frames turn: no form over one mesh has it.
There each contact point is a cell of a mesh of its own. j_n(u; v) is then the sum of W_q p_n v_n over the points, with
u_n = N u of the contact operator.
"""

from __future__ import annotations

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.dolfinx_versions import ufl
from stickslip.solvers.fem.forms import compliant_pressure
from stickslip.solvers.laws.compliance import Compliance


class PointLaw:
    """A compliance law at m contact points: pressure, and its derivative by the penetration, both written in UFL."""

    def __init__(self, law: Compliance, count: int) -> None:
        """Compile both, or load them from the cache; the same on every rank, without communication.

        Args:
            law: the compliance law.
            count: number m of points.
        """
        self.count = count
        if not count:
            return
        space = dx.cells_of_points(count)
        domain = space.mesh
        self._dofs = dx.cell_dofs(space).ravel()
        self._penetration = dx.fem.Function(space)
        penetration = ufl.variable(self._penetration)
        pressure = compliant_pressure(dx.fem.Constant(domain, law.c_n), law.m_n, penetration)
        middle = dx.midpoint(domain)
        self._pressure = dx.CellExpression(pressure, middle, domain)
        self._stiffness = dx.CellExpression(ufl.diff(pressure, penetration), middle, domain)

    def pressure(self, penetration: Array) -> Array:
        """p_n (m,) [Pa] at a penetration u_n - g (m,) [m]."""
        return self._at(self._pressure, penetration) if self.count else np.zeros(0)

    def stiffness(self, penetration: Array) -> Array:
        """dp_n / d(u_n - g) (m,) [Pa/m]."""
        return self._at(self._stiffness, penetration) if self.count else np.zeros(0)

    def _at(self, expression: dx.CellExpression, penetration: Array) -> Array:
        self._penetration.x.array[self._dofs] = penetration
        return expression(np.arange(self.count)).ravel()
