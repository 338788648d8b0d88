"""Contact in UFL: works of multipliers and of compliance on a side, the law at contact points, and smoothed laws.

Works of multipliers are sampled at the nodes of a side. Their quadrature is chosen so that the matrix of b(lambda, v;
s) is B = W N to rounding: the points are the nodes, each with the weight W_j = ∫ phi~_j ds that the dual (biorthogonal)
multipliers of the other methods have there.

Between bodies u_n is a jump across two meshes, and where contact slides the frames turn: no form over one mesh has it.
There each contact point is a cell of a mesh of its own. j_n(u; v) is then the sum of W_q p_n v_n over the points, with
u_n = N u of the contact operator.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.dolfinx_versions import ufl
from stickslip.geometry.protocols import Constant, Function, Measure, UflExpr, UflForm
from stickslip.geometry.surfaces.surface import FACET_OF
from stickslip.solvers.fem.forms import WeakForms, compliant_pressure
from stickslip.solvers.laws.friction import Coulomb, Tresca
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.scene.contact import Contact


@dataclass(frozen=True)
class NodalRule:
    """The integral ∫ f ds over a side as the sum of W_j f_j over its nodes: a quadrature rule of dolfinx, and a factor.

    `share` holds W_j over the weight that the rule itself gives node j, in every component [-]: 1 on flat sides of
    order 1, other values on curved facets, at order 2 (where fields are coefficients of phi~, see `Surface`), and in
    axisymmetric models. The works of the multipliers of a contact with a rigid obstacle are named as in the source.
    """

    weak: WeakForms
    side: str

    @cached_property
    def share(self) -> Function:
        return dx.fem.Function(self.weak.space)

    @cached_property
    def measure(self) -> Measure:
        """Samples the side at its nodes, with equal weights on a facet."""
        mesh = self.weak.mesh
        points = dx.reference_nodes(FACET_OF[mesh.domain.topology.cell_type.name], mesh.degree)
        rule = {
            "quadrature_rule": "custom",
            "quadrature_degree": mesh.degree,
            "quadrature_points": points.tolist(),
            "quadrature_weights": [1 / len(points)] * len(points),
        }
        measure = ufl.Measure("ds", domain=mesh.domain, subdomain_data=mesh.facet_tags, metadata=rule)
        return measure(mesh.sides[self.side])

    def integral(self, f: UflExpr | int) -> UflForm:
        """∫ f ds by this rule."""
        density: Any = self.share[0] * f
        return density * self.measure

    def sampled(self) -> UflForm:
        """Linear form whose entries are the weights that the rule itself gives each node, in every component."""
        return sum(self.weak.v[i] for i in range(self.weak.mesh.dim)) * self.measure

    def areas(self, moved: Function | None = None) -> UflForm:
        """∫ v ds in every component, by a quadrature of the facets: areas that do not come from `Surface`.

        Args:
            moved: displacement [m]; ds is then that of the side as moved by it, |cof(I + grad moved) n| times that of
                the start. Only its values at the nodes of the side matter.
        """
        mesh, v = self.weak.mesh, self.weak.v
        degree = 2 * mesh.degree + mesh.axisymmetric
        density = sum(v[i] for i in range(mesh.dim))
        if moved is None:
            return density * self.weak.boundary(self.side, degree)
        F = ufl.Identity(mesh.dim) + ufl.grad(moved)
        stretched = ufl.dot(ufl.cofac(F), ufl.FacetNormal(mesh.domain))
        measure = ufl.Measure("ds", domain=mesh.domain, subdomain_data=mesh.facet_tags)
        around = 2 * np.pi * (ufl.SpatialCoordinate(mesh.domain)[0] + moved[0]) if mesh.axisymmetric else 1
        area = density * around * ufl.sqrt(ufl.inner(stretched, stretched))
        return area * measure(mesh.sides[self.side], metadata={"quadrature_degree": degree})

    def friction_work(self, lam: UflExpr, v: UflExpr, s: UflExpr | float = 1.0) -> UflForm:
        """b(lambda, v; s) = ∫ s lambda . v_T ds, |lambda| <= 1; lambda is tangential, so lambda . v_T = lambda . v.

        Args:
            lam: lambda [-], vectors in the tangent plane. For B: the trial function, with s = 1, so t = s lambda [Pa].
            v: test function.
            s: friction bound [Pa].

        Source: Pop (1999), (2.3): c_T p_T is s.
        """
        return self.integral(s * ufl.inner(lam, v))

    def normal_work(self, p: UflExpr, v: UflExpr) -> UflForm:
        """∫ p_n v_n ds of a pressure multiplier (unilateral, bilateral, tied), as p . v with p = p_n n.

        Args:
            p: p_n n [Pa]; the trial function for its matrix.
            v: test function.
        """
        return self.integral(ufl.inner(p, v))

    def elastic_slip(self, v: UflExpr, k_T: float) -> UflForm:
        """∫ v / k_T ds in every component: the diagonal of C, lumped, for a surface with tangential stiffness k_T."""
        softness = self.weak.constant(1 / k_T)
        return self.integral(softness * sum(v[i] for i in range(self.weak.mesh.dim)))


@dataclass(frozen=True)
class ComplianceForms:
    """j_n of one compliant contact with a rigid obstacle, and the derivative of F = K u + j_n that UFL takes of it."""

    weak: WeakForms
    contact: Contact
    law: Compliance

    @cached_property
    def relative(self) -> Function:
        """u less the motion of the obstacle [m]: the argument of j_n."""
        return dx.fem.Function(self.weak.space)

    @cached_property
    def work(self) -> UflForm:
        """j_n(u; v) = ∫ c_n (u_n - g)_+^m_n v_n ds."""
        return self.weak.normal_compliance(self.relative, self.contact, self.law)

    @cached_property
    def tangent(self) -> UflForm:
        """dj_n(u; v) / du, a bilinear form."""
        return ufl.derivative(self.work, self.relative)


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
        return dx.fem.Function(self.weak.space)

    @cached_property
    def before(self) -> Function:
        return dx.fem.Function(self.weak.space)

    @cached_property
    def normal(self) -> Function:
        return dx.fem.Function(self.weak.space)

    @cached_property
    def relative(self) -> Function:
        """Displacement relative to the obstacle [m], for the normal compliance form."""
        return dx.fem.Function(self.weak.space)

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
            return self.weak.constant(law.coefficient_now) * ufl.max_value(p, 0)
        assert isinstance(law, Tresca)
        return self.bound if self.contact.normal.sides == 2 else self.bound * ufl.min_value(p / self.widths.pressure, 1)
