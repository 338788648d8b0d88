"""Forces of the multipliers of a contact with a rigid obstacle, from UFL forms: the audit's own B^T p."""

from __future__ import annotations

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import ROUNDING, Array
from stickslip.geometry.protocols import Vec
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.system.nodal_contact import NodalContact, traction_fields
from stickslip.solvers.system.system import System


class MultiplierForces:
    """∫ p_n n . v ds + b(lambda, v; s) of one contact, by dolfinx; s lambda is the tangential traction t.

    The solver's forces are N^T W p of the contact rows, and so would be an audit with the same rows: a wrong N or W
    would then be wrong on both sides, and never seen. Here only the fields come from the rows (which nodes a multiplier
    stands for, and its direction); positions, areas and sums are those of the mesh, as dolfinx has them.
    """

    def __init__(self, system: System, rows: ContactRows) -> None:
        """Compile the forms; collective. Later calls only set their fields, also where the contact slides.

        Args:
            system: at the start.
            rows: of the contact, at the start; with a pressure multiplier or friction.
        """
        self._nodal, compile_ = NodalContact(system, rows), system.weak.compile
        self._pressure, self._lam, self._bound = (dx.fem.Function(system.space) for _ in range(3))
        sliding = system.problem.pairs[rows.name].contact.sliding
        self._moved = dx.fem.Function(system.space) if sliding else None
        self._areas = compile_(self._nodal.rule.areas(self._moved))
        forms, v, works = self._nodal.forms, system.weak.v, []
        if not rows.normal.at_quadrature:
            works.append(forms.normal_work(self._pressure, v))
        if rows.friction is not None:
            works.append(forms.friction_work(self._lam, v, self._bound[0]))
        self._work = compile_(sum(works[1:], start=works[0]))
        self._weigh()

    def _weigh(self) -> None:
        """W_j = ∫ phi~_j ds of the side as it lies."""
        nodal, surface = self._nodal, self._nodal.rows.surface
        areas = nodal.assembled_at_nodes(self._areas).reshape(-1, surface.dim)[:, 0]
        nodal.weigh(surface.forces_transform @ areas)

    def __call__(self, rows: ContactRows, p_n: Array, t: Array, s: Array, scale: float, moved: Array | None) -> Vec:
        """Nodal forces over all displacements [N]; collective.

        Args:
            rows: of the contact in this step.
            p_n: pressures (m_n,) [Pa]; of no account where the law gives them by the displacement.
            t: tangential multipliers (m_t, d-1) [Pa].
            s: friction bounds (m_t,) [Pa]. Where they are infinite or negligible, lambda has no unit: the field is the
                traction itself, and s is 1.
            scale: of tractions in this step [Pa].
            moved: of a sliding contact, the displacement (n, d) [m] at which its rows were built; None: none.
        """
        nodal, d = self._nodal, rows.surface.dim
        if self._moved is not None:
            at = nodal.spread(np.zeros(rows.points.size) if moved is None else moved.ravel())
            dx.fill(self._moved, at.array_r)
            self._weigh()
        normal, tangential = traction_fields(rows)
        bound = rows.share_t.T @ s
        # of the step's scale of traction; a smaller bound is no unit to measure lambda in
        bound[~np.isfinite(bound) | (bound <= ROUNDING * scale)] = 1.0
        fields = (self._pressure, normal.T @ p_n), (self._bound, np.repeat(bound, d))
        for function, values in (*fields, (self._lam, tangential.T @ t.ravel() / np.repeat(bound, d))):
            dx.fill(function, nodal.spread(values).array_r)
        return nodal.on_displacements(dx.assemble_vector(self._work))
