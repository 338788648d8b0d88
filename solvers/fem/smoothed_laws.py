"""Smoothed contact laws in UFL: penalty for rigid normal laws, and |slip| rounded off near zero."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.dolfinx_versions import ufl
from stickslip.geometry.protocols import Constant, Function, UflForm
from stickslip.solvers.fem.contact_forms import NodalRule
from stickslip.solvers.fem.forms import WeakForms, compliant_pressure
from stickslip.solvers.laws.compliance import Compliance
from stickslip.solvers.laws.friction import Coulomb, Tresca
from stickslip.solvers.scene.contact import Contact


@dataclass(frozen=True)
class Widths:
    """Widths over which the laws are smoothed; all three are proportional to the level."""

    slip: Constant  # eps [m]
    flexibility: Constant  # delta [m/Pa]: penetration per pressure of a rigid normal law
    pressure: Constant  # [Pa] over which Tresca's bound rises from 0

    @classmethod
    def of(cls, weak: WeakForms) -> Widths:
        """Constants that compiled forms read at run time; `set` gives them their values."""
        return cls(*(weak.constant(1.0) for _ in range(3)))

    def set(self, level: float, u_ref: float, p_ref: float) -> None:
        """Set the widths to `level` [-] times the scales of the step.

        Args:
            u_ref: scale of displacements [m].
            p_ref: scale of tractions [Pa].
        """
        self.slip.value, self.flexibility.value = level * u_ref, level * u_ref / p_ref
        self.pressure.value = level * p_ref


@dataclass(frozen=True)
class SmoothedContact:
    """The laws of one contact at the nodes of its surface, where the other methods have their multipliers.

    The fields are in the displacement space; their values at the nodes of the surface are

        motion  displacement relative to the obstacle, less g n, so that motion . n = u_n - g [m],
        before  the same at the last accepted step [m],
        normal  n, towards the obstacle [-].
    """

    weak: WeakForms
    rule: NodalRule
    contact: Contact
    widths: Widths
    bound: Constant  # bound of Tresca's law at the time of the step [Pa]

    @cached_property
    def motion(self) -> Function:
        found: Function = dx.fem.Function(self.weak.space)
        return found

    @cached_property
    def before(self) -> Function:
        found: Function = dx.fem.Function(self.weak.space)
        return found

    @cached_property
    def normal(self) -> Function:
        found: Function = dx.fem.Function(self.weak.space)
        return found

    @cached_property
    def relative(self) -> Function:
        """Displacement relative to the obstacle [m], for the normal compliance form."""
        found: Function = dx.fem.Function(self.weak.space)
        return found

    def works(self) -> list[tuple[Function, UflForm, UflForm]]:
        """Forms whose sum is ∫ p_n v_n + t . v_T ds; for each its field, the form, and its derivative by the field."""
        p = self._pressure(ufl.inner(self.motion, self.normal))
        found, tractions, law = [], [], self.contact.normal
        if isinstance(law, Compliance):  # at quadrature points, as for every method
            found.append((self.relative, self.weak.normal_compliance(self.relative, self.contact, law)))
        else:
            tractions.append(p * self.normal)
        if self.contact.friction is not None:
            tractions.append(self._limit(p) * self._direction())
        if tractions:
            found.append((self.motion, self.rule.integral(ufl.inner(sum(tractions), self.weak.v))))
        return [(field, form, ufl.derivative(form, field)) for field, form in found]

    def _direction(self) -> Any:
        """Du_T / sqrt(|Du_T|² + eps²), Du_T the slip since the last accepted step."""
        slip = self.motion - self.before
        slip_T = slip - ufl.inner(slip, self.normal) * self.normal
        return slip_T / ufl.sqrt(ufl.inner(slip_T, slip_T) + self.widths.slip**2)

    def _pressure(self, penetration: Any) -> Any:
        """p_n [Pa]: from the law if it is a compliance law, otherwise by penalty."""
        law = self.contact.normal
        if isinstance(law, Compliance):
            return compliant_pressure(self.weak.constant(law.c_n), law.m_n, penetration)
        return (penetration if law.sides == 2 else ufl.max_value(penetration, 0)) / self.widths.flexibility

    def _limit(self, p: Any) -> Any:
        """Friction bound s [Pa]; the jump of Tresca's law at p = 0 becomes a ramp."""
        law = self.contact.friction
        if isinstance(law, Coulomb):
            return self.weak.constant(law.mu) * ufl.max_value(p, 0)
        assert isinstance(law, Tresca)
        return self.bound if self.contact.normal.sides == 2 else self.bound * ufl.min_value(p / self.widths.pressure, 1)
