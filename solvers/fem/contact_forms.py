"""Friction's work b(lambda, v; s), and the work of pressure multipliers, in UFL, sampled at the nodes of a side.

The quadrature is chosen so that the matrix of b is B = W N to rounding: the points are the nodes, each with the
weight W_j = ∫ phi~_j ds that the dual (biorthogonal) multipliers of the other methods have there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.dolfinx_versions import ufl
from stickslip.geometry.protocols import Function, Measure, UflExpr, UflForm
from stickslip.geometry.surfaces.surface import FACET_OF
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.laws.compliance import Compliance
from stickslip.solvers.scene.contact import Contact


@dataclass(frozen=True)
class NodalRule:
    """The integral ∫ f ds over a side as the sum of W_j f_j over its nodes: a quadrature rule of dolfinx, and a factor.

    `share` holds W_j over the weight that the rule itself gives node j, in every component [-]: 1 on flat sides of
    order 1, other values on curved facets, at order 2 (where fields are coefficients of phi~, see `Surface`), and in
    axisymmetric models.
    """

    weak: WeakForms
    side: str

    @cached_property
    def share(self) -> Function:
        found: Function = dx.fem.Function(self.weak.space)
        return found

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
        found: Measure = measure(mesh.sides[self.side])
        return found

    def integral(self, f: UflExpr | int) -> UflForm:
        """∫ f ds by this rule."""
        density: Any = self.share[0] * f
        found: UflForm = density * self.measure
        return found

    def sampled(self) -> UflForm:
        """Linear form whose entries are the weights that the rule itself gives each node, in every component."""
        found: UflForm = sum(self.weak.v[i] for i in range(self.weak.mesh.dim)) * self.measure
        return found

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
            found: UflForm = density * self.weak.boundary(self.side, degree)
            return found
        F = ufl.Identity(mesh.dim) + ufl.grad(moved)
        stretched = ufl.dot(ufl.cofac(F), ufl.FacetNormal(mesh.domain))
        measure = ufl.Measure("ds", domain=mesh.domain, subdomain_data=mesh.facet_tags)
        around = 2 * np.pi * (ufl.SpatialCoordinate(mesh.domain)[0] + moved[0]) if mesh.axisymmetric else 1
        area = density * around * ufl.sqrt(ufl.inner(stretched, stretched))
        found = area * measure(mesh.sides[self.side], metadata={"quadrature_degree": degree})
        return found


@dataclass(frozen=True)
class ContactForms:
    """The works of the multipliers of one contact with a rigid obstacle, named as in the source."""

    weak: WeakForms
    rule: NodalRule

    def friction_work(self, lam: UflExpr, v: UflExpr, s: UflExpr | float = 1.0) -> UflForm:
        """b(lambda, v; s) = ∫ s lambda . v_T ds, |lambda| <= 1; lambda is tangential, so lambda . v_T = lambda . v.

        Args:
            lam: lambda [-], vectors in the tangent plane. For B: the trial function, with s = 1, so t = s lambda [Pa].
            v: test function.
            s: friction bound [Pa].

        Source: Pop (1999), (2.3): c_T p_T is s.
        """
        return self.rule.integral(s * ufl.inner(lam, v))

    def normal_work(self, p: UflExpr, v: UflExpr) -> UflForm:
        """∫ p_n v_n ds of a pressure multiplier (unilateral, bilateral, tied), as p . v with p = p_n n.

        Args:
            p: p_n n [Pa]; the trial function for its matrix.
            v: test function.
        """
        return self.rule.integral(ufl.inner(p, v))

    def elastic_slip(self, v: UflExpr, k_T: float) -> UflForm:
        """∫ v / k_T ds in every component: the diagonal of C, lumped, for a surface with tangential stiffness k_T."""
        softness = self.weak.constant(1 / k_T)
        return self.rule.integral(softness * sum(v[i] for i in range(self.weak.mesh.dim)))


@dataclass(frozen=True)
class ComplianceForms:
    """j_n of one compliant contact with a rigid obstacle, and the derivative of F = K u + j_n that UFL takes of it."""

    weak: WeakForms
    contact: Contact
    law: Compliance

    @cached_property
    def relative(self) -> Function:
        """u less the motion of the obstacle [m]: the argument of j_n."""
        found: Function = dx.fem.Function(self.weak.space)
        return found

    @cached_property
    def work(self) -> UflForm:
        """j_n(u; v) = ∫ c_n (u_n - g)_+^m_n v_n ds."""
        return self.weak.normal_compliance(self.relative, self.contact, self.law)

    @cached_property
    def tangent(self) -> UflForm:
        """dj_n(u; v) / du, a bilinear form."""
        found: UflForm = ufl.derivative(self.work, self.relative)
        return found
