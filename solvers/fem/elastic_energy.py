"""The elastic energy of the bodies, written a second time: the audit's forces share no stress with the solver's.

That of orthotropic bodies is written in their own axes: it shares no tensor with the solver either.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.dolfinx_versions import ufl
from stickslip.geometry.protocols import Constant, Function, UflExpr, UflForm
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.scene.material import Orthotropic


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
    squares = sum(e**2 for e in normal) + sum(g**2 for g in shear) / 2
    v, found = ufl.TestFunction(weak.space), list[UflForm]()

    def forces(density: UflExpr, name: str) -> UflForm:
        return ufl.derivative(density * around * dx(mesh.bodies[name]), u, v)

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


def energy_density(
    body: Orthotropic,
    normal: Sequence[UflExpr],
    gradient: UflExpr,
    plane_stress: bool,
    constant: Callable[[float | Array], Constant],
) -> UflExpr:
    """Half of sigma : eps [Pa], by strains along the axes: (sum_ij c_ij eps_ii eps_jj + sum_ij G_ij (2 eps_ij)²) / 2.

    Args:
        normal: strains along x, y, and z or around the axis of symmetry, as many as the model has.
        gradient: of the displacement (d, d).
        plane_stress: whether sigma_33 = 0.
        constant: of a number or a matrix.
    """
    dim = gradient.ufl_shape[0]
    strain: list[list[UflExpr | int]] = [[0] * 3 for _ in range(3)]
    for i in range(3):
        for j in range(3):
            if i == j and i < len(normal):
                strain[i][j] = normal[i]
            elif i != j and max(i, j) < dim:
                strain[i][j] = (gradient[i, j] + gradient[j, i]) / 2
    Q = constant(axes_again(body))
    along, c = Q * ufl.as_matrix(strain) * ufl.transpose(Q), normal_stiffness(body, plane_stress)
    stretch, stiffness = ufl.as_vector([along[a, a] for a in range(len(c))]), constant(c)
    found = ufl.inner(stretch, stiffness * stretch)
    shears = ((0, 1, body.G_12), (1, 2, body.G_23), (0, 2, body.G_13))
    for a, b, G in shears if dim == 3 else shears[:1]:
        assert G is not None
        found += constant(G) * (along[a, b] + along[b, a]) ** 2
    return found / 2


def axes_again(body: Orthotropic) -> Array:
    """Axes 1, 2, 3 as rows (3, 3), right-handed, of a QR decomposition of the directions that are given."""
    given = [np.array(axis, float) for axis in (body.axis_1, body.axis_2) if axis is not None]
    first = np.resize([*body.axis_1, 0.0], 3) if body.axis_1 is not None else np.array([1.0, 0.0, 0.0])
    flat = any(len(axis) == 2 for axis in given)
    second = np.array([-first[1], first[0], 0.0]) if flat else np.array([0.0, 1.0, 0.0])
    second = np.resize([*body.axis_2, 0.0], 3) if body.axis_2 is not None else second
    Q, R = np.linalg.qr(np.column_stack([first, second]))
    a, b = (Q * np.sign(np.diag(R))).T
    return np.array([a, b, np.cross(a, b)])


def normal_stiffness(body: Orthotropic, plane_stress: bool) -> Array:
    """c_ij from strains to stresses along the axes [Pa]: (3, 3), in plane stress (2, 2).

    Source: Jones, Mechanics of Composite Materials (1999), equations 2.23 and 2.61.

    >>> cork = Orthotropic(E_1=4.0, E_2=1.0, E_3=1.0, G_12=1.0, nu_12=0.5, nu_13=0.0, nu_23=0.0)
    >>> (normal_stiffness(cork, plane_stress=True) * 15 / 16).round(12).tolist()
    [[4.0, 0.5], [0.5, 1.0]]
    """
    E_1, E_2, E_3 = body.E_1, body.E_2, body.E_3
    nu_12, nu_13, nu_23 = body.nu_12, body.nu_13, body.nu_23
    nu_21, nu_31, nu_32 = nu_12 * E_2 / E_1, nu_13 * E_3 / E_1, nu_23 * E_3 / E_2
    if plane_stress:
        return np.array([[E_1, nu_21 * E_1], [nu_12 * E_2, E_2]]) / (1 - nu_12 * nu_21)
    rows = [
        [E_1 * (1 - nu_23 * nu_32), E_1 * (nu_21 + nu_31 * nu_23), E_1 * (nu_31 + nu_21 * nu_32)],
        [E_2 * (nu_12 + nu_32 * nu_13), E_2 * (1 - nu_13 * nu_31), E_2 * (nu_32 + nu_12 * nu_31)],
        [E_3 * (nu_13 + nu_12 * nu_23), E_3 * (nu_23 + nu_21 * nu_13), E_3 * (1 - nu_12 * nu_21)],
    ]
    return np.array(rows) / (1 - nu_12 * nu_21 - nu_23 * nu_32 - nu_31 * nu_13 - 2 * nu_21 * nu_32 * nu_13)


def stress_by_compliance(body: Orthotropic, strain: Array, plane_stress: bool) -> Array:
    """Stress (n, 3, 3) [Pa] of elastic strains (n, 3, 3) [-]; in plane stress eps_33 is not read."""
    Q = axes_again(body)
    along = Q @ strain @ Q.T
    c = normal_stiffness(body, plane_stress)
    found, count = np.zeros_like(along), len(c)
    for a in range(count):
        found[:, a, a] = sum(c[a, b] * along[:, b, b] for b in range(count))
    for a, b, G in ((0, 1, body.G_12), (1, 2, body.G_23), (0, 2, body.G_13)):
        if G is not None:
            found[:, a, b] = found[:, b, a] = 2 * G * along[:, a, b]
    return np.asarray(Q.T @ found @ Q)
