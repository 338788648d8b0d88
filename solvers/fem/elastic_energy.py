"""The elastic energy of the bodies, written a second time: the audit's forces share no stress with the solver's."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stickslip.geometry.dolfinx_versions import ufl
from stickslip.geometry.protocols import Function, UflExpr, UflForm
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.fem.own_axes import energy_density


def forces_of_energy(weak: WeakForms, u: Function, dilatation: Mapping[str, Function]) -> list[UflForm]:
    """Linear forms of the inner forces [N], one for each body: the derivative of its energy by the displacement.

    The energy is ∫ G (eps : eps + c (tr eps)²) dx, with G = E / (2 (1 + nu)) and c = nu / (1 - 2 nu), in plane stress
    c = nu / (1 - nu); of orthotropic bodies see `energy_density`. Bodies of one kind share a compiled form.

    Args:
        weak: for its mesh, space and materials; none of its forms is used.
        u: displacement [m].
        dilatation: of bodies where it is averaged [-], see `MeanDilatation`: theirs is ∫ G eps : eps dx, and
            ∫ lambda dilatation tr eps(v) dx is added to its derivative.
    """
    mesh, problem = weak.mesh, weak.problem
    r = ufl.SpatialCoordinate(mesh.domain)[0]
    around = 2 * np.pi * r if mesh.axisymmetric else 1
    rule = {} if mesh.quadrature is None else {"quadrature_degree": mesh.quadrature}
    dx = ufl.Measure("dx", domain=mesh.domain, subdomain_data=mesh.cell_tags, metadata=rule)
    gradient = ufl.grad(u)
    normal = [gradient[i, i] for i in range(mesh.dim)] + ([u[0] / r] if mesh.axisymmetric else [])
    shear = [gradient[i, j] + gradient[j, i] for i in range(mesh.dim) for j in range(i)]
    squares: UflExpr = sum(e**2 for e in normal) + sum(g**2 for g in shear) / 2
    v, found = ufl.TestFunction(weak.space), list[UflForm]()

    def forces(density: UflExpr, name: str) -> UflForm:
        derivative: UflForm = ufl.derivative(density * around * dx(mesh.bodies[name]), u, v)
        return derivative

    for name, body in problem.isotropic.items():
        c = body.nu / (1 - body.nu if problem.model == "plane stress" else body.give)
        modulus = weak.constant(body.E / (2 + 2 * body.nu))
        if name in dilatation:
            pressing = weak.constant(body.E / (1 + body.nu) * c) * dilatation[name]
            volumetric = pressing * ufl.derivative(sum(normal), u, v) * around * dx(mesh.bodies[name])
            found.append(forces(modulus * squares, name) + volumetric)
        else:
            found.append(forces(modulus * (squares + weak.constant(c) * sum(normal) ** 2), name))
    for name, material in problem.orthotropic.items():
        density = energy_density(material, normal, gradient, problem.model == "plane stress", weak.constant)
        found.append(forces(density, name))
    return found
