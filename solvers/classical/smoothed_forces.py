"""Contact forces of the smoothed laws on the free displacements, and their tangent, assembled from UFL forms."""

from __future__ import annotations

from collections.abc import Mapping

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.amplitude import value_at
from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Mat, Vec
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.fem.smoothed_laws import SmoothedContact, Widths
from stickslip.solvers.laws.friction import Tresca
from stickslip.solvers.system.nodal_contact import FormOfPart, NodalContact, relative_to_obstacle
from stickslip.solvers.system.system import System


class SmoothedForces:
    """Contact forces B^T p of all contacts as a function of the free displacements q, u = T q + u_s."""

    def __init__(self, system: System) -> None:
        """Compile the forms; collective."""
        self.system = system
        self.widths = Widths.of(system.weak)
        self.contacts = [Nodal(system, rows, self.widths) for rows in system.contacts]
        self.parts = [part for contact in self.contacts for part in contact.parts()]

    def begin(self, u: Vec, motion: Mapping[str, Array], time: float) -> None:
        """Start a step.

        Args:
            u: displacement [m] at the last accepted step, over all displacements.
            motion: motion (n, d) [m] of each contact's obstacle at that step, by contact.
            time: end of the step [s].
        """
        u_s = self.system.prescribed(time)
        for contact in self.contacts:
            contact.begin(u, motion[contact.rows.name], u_s, time)

    def forces(self, q: Vec) -> Vec:
        """B^T p [N] over the free displacements."""
        total = q.duplicate()
        for part in self.parts:
            part.at(q)
            part.add_forces(total)
        return total

    def add_tangent(self, q: Vec, J: Mat) -> None:
        """J += d forces / d q."""
        for part in self.parts:
            part.at(q)
            part.add_tangent(J)


class Nodal:
    """One contact: its forms, and their data at the nodes of its surface."""

    def __init__(self, system: System, rows: ContactRows, widths: Widths) -> None:
        contact, weak = system.problem.pairs[rows.name].contact, system.weak
        self.system, self.rows = system, rows
        self.bound = weak.constant(0.0)
        self.nodal = NodalContact(system, rows)
        self.forms = SmoothedContact(weak, self.nodal.rule, contact, widths, self.bound)
        self.P = self.nodal.change.matMult(system.T) if self.nodal.change else system.T
        dx.fill(self.forms.normal, self.nodal.spread(rows.frames[:, 0].ravel()).array_r)
        self.relative_shift, self.motion_shift = system.vector(), system.vector()

    def parts(self) -> list[FormOfPart]:
        """The forms, compiled."""
        compile_, found = self.system.weak.compile, []
        for field, work, tangent in self.forms.works():
            nodal = field is self.forms.motion
            P, shift = (self.P, self.motion_shift) if nodal else (self.system.T, self.relative_shift)
            found.append(FormOfPart(field, P, shift, compile_(work), compile_(tangent)))
        return found

    def begin(self, u: Vec, motion: Array, u_s: Vec, time: float) -> None:
        """Set the data of a step.

        Args:
            u: displacement [m] at the last accepted step, over all displacements.
            motion: motion (n, d) [m] of the obstacle at that step.
            u_s: prescribed displacement [m] at `time`, over all displacements.
            time: end of the step [s].
        """
        end, law = self.system.problem.timeline.end, self.rows.friction
        if isinstance(law, Tresca):
            self.bound.value = value_at(law.bound, time, end)
        dx.fill(self.forms.before, self._motion(u - self.nodal.spread(motion.ravel())).array_r)
        relative = relative_to_obstacle(self.system, self.rows.name, u_s, time)
        relative.copy(self.relative_shift)
        self._motion(relative).copy(self.motion_shift)

    def _motion(self, relative: Vec) -> Vec:
        """Relative displacement [m] in the basis phi~, less g n."""
        motion = self.nodal.coefficients(relative)
        motion.axpy(-1.0, self.nodal.spread((self.rows.node_gap[:, None] * self.rows.frames[:, 0]).ravel()))
        return motion
