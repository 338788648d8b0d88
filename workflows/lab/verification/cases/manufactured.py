"""The manufactured solution: body force and side tractions vary in space, which no scene file can describe.

A smooth field on the unit square that meets normal compliance and Coulomb slip exactly on its base y = 0.

Penetration d(x) > 0 and slip a(x) > 0 of the base are chosen, so that p = c_n d^m presses and sigma_xy = mu p opposes
the slip. These fix the field's values and its derivatives in y on the base,

    u_x = a,  u_y = -d,  du_x/dy = b = mu p / G + d',  du_y/dy = e = -(p + lambda a') / (lambda + 2 G),

and u_x = a(0) + (a - a(0)) (1 - y^2) + b y (1 - y), u_y = -d (1 - y^2) + e y (1 - y) continue them: the top moves by
a(0) as a rigid body, and u_x = a(0) on the left too, for d is chosen so that b(0) = 0. So supports can hold the top,
and the left side with the corner of the base.

d = (P / c_n)^(1/m) s with s(0) = 1: the pressure is P s^m. Written with operators alone: arrays of numbers and symbols
of UFL take the same path.

Source: derived here; tests differentiate it numerically.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import truediv
from typing import Any, Literal, get_args

import numpy as np

from stickslip import Block, Compliance, Contact, Coulomb, Material, Plane, Scene, Support
from stickslip.geometry import dolfinx_versions as dx
from stickslip.solvers.fem.terms import LoadTerm
from stickslip.solvers.system.applied_loads import AppliedLoads
from stickslip.solvers.system.system import System
from stickslip.workflows.lab.verification.check import Check, problem
from stickslip.workflows.lab.verification.prepared import accepted, solver, system_of

E, NU, MU = 10.0, 0.3, 0.4
G = E / (2 * (1 + NU))
LAMBDA = E * NU / ((1 + NU) * (1 - 2 * NU))
P = 0.05  # pressure at the left corner [Pa]
SLIP = 0.02  # a(0), of top and left side [m]
RATES = {1: (2, 1, 2), 2: (3, 2, 3)}  # by order: L2 norms of displacement, stress, pressure


@dataclass(frozen=True, kw_only=True)
class Manufactured:
    """The field of one law."""

    c_n: float  # [Pa/m^m]
    m: int

    @property
    def depth(self) -> float:
        """d(0) [m]."""
        return float((P / self.c_n) ** (1 / self.m))

    @property
    def fall(self) -> float:
        """-s'(0), so that b(0) = 0."""
        return MU * P / G / self.depth

    def shape(self, x: Any) -> Any:
        """s(x), from 1 to 1."""
        return 1 - self.fall * (x - x**2) + (x**2 - x**3) / 4

    def shape_slope(self, x: Any) -> Any:
        """ds/dx."""
        return -self.fall * (1 - 2 * x) + (2 * x - 3 * x**2) / 4

    def pressure(self, x: Any) -> Any:
        """p(x) [Pa]."""
        return P * self.shape(x) ** self.m

    def displacement(self, x: Any, y: Any) -> tuple[Any, Any]:
        """u(x, y) [m]."""
        more, slope = SLIP * (x - x**3) / 4, SLIP * (1 - 3 * x**2) / 4  # a - a(0), a'
        p = self.pressure(x)
        b = MU * p / G + self.depth * self.shape_slope(x)
        e = -(p + LAMBDA * slope) / (LAMBDA + 2 * G)
        across = SLIP + more * (1 - y**2) + b * y * (1 - y)
        return across, -self.depth * self.shape(x) * (1 - y**2) + e * y * (1 - y)


LAWS = (Manufactured(c_n=2.0, m=1), Manufactured(c_n=400.0, m=2), Manufactured(c_n=4e4, m=3))


MESHES = (4, 8, 16, 32)
DEGREE = 10  # quadrature degree: exact for polynomial fields, else far below the discretisation error
NORMS = ("L2(u)", "L2(stress)", "L2(p)")
SLACK = 0.25  # tolerance of a rate: with coarse meshes in the fit it is off by up to .23, on the last two meshes by .15
Held = Literal["away from the base", "beside the base"]
AWAY, BESIDE = get_args(Held)
TOP = Support(boundary="block.top", displacement={"x": SLIP, "y": 0.0})
HOLDS: dict[Held, dict[str, Support]] = {
    AWAY: {"top": TOP},
    BESIDE: {"top": TOP, "left": Support(boundary="block.left", displacement={"x": SLIP})},
}


def scene(exact: Manufactured, method: str, order: int, n: int, mu: float, held: Held) -> Scene:
    """Unit square of n x n x 2 triangles, held at its top, perhaps at its left, on a compliant base."""
    return Scene(
        model="plane strain",
        geometry=Block(length=1.0, height=1.0, mesh_size=1.0 / n, order=order),  # type: ignore[arg-type]
        bodies={"block": Material(E=E, nu=NU)},
        obstacles={"foundation": Plane(point=(0.0, 0.0), normal=(0.0, 1.0))},
        contacts={
            "base": Contact(
                surface="block.bottom",
                against="foundation",
                normal=Compliance(c_n=exact.c_n, m_n=exact.m),
                friction=Coulomb(mu=mu),
            )
        },
        supports=HOLDS[held],
        solver=solver(method, 1e-11),
    )


def loaded(scene: Scene, exact: Manufactured) -> tuple[System, Any]:
    """The scene's system under the loads of the manufactured field, and the field."""
    system = system_of(scene)
    field = system.weak.field(exact.displacement)
    form = system.weak.balance(field, "block", ("block.left", "block.right"), DEGREE)
    return replace(system, loads=AppliedLoads(system.weak, [LoadTerm(drive=1.0, form=form)])), field


@lru_cache
def errors(
    exact: Manufactured, method: str, order: int, n: int, mu: float = MU, held: Held = AWAY
) -> tuple[float, ...]:
    """L2 errors of `NORMS`, relative; the pressure where the law is evaluated, at the quadrature points of the base."""
    system, field = loaded(scene(exact, method, order, n, mu, held), exact)
    (step,) = accepted(system)
    u = dx.fem.Function(system.space)
    dx.fill(u, step.state.u.array_r)
    (base,), weak = system.contacts, system.weak
    at = base.surface.quadrature(base.normal.degree(order))[1]
    x = (at @ base.surface.points[base.surface.facets][:, :, 0, None]).ravel()
    p = exact.pressure(x)
    off = step.state.p[: len(p)] - p
    stresses = (norm(system, weak.stress(w, "block")) for w in (u - field, field))
    of_p = float(np.sqrt(base.W_n @ off**2 / (base.W_n @ p**2)))
    return norm(system, u - field) / norm(system, field), truediv(*stresses), of_p


def norm(system: System, expression: Any) -> float:
    """In L2, up to a factor that is the same for all fields: the cells have one size."""
    points, weights = dx.reference_rule("triangle", DEGREE)
    cells = np.arange(system.mesh.domain.topology.index_map(2).size_local)
    values = dx.CellExpression(expression, points, system.mesh.domain)(cells)
    return float(np.sqrt(np.einsum("cqi,q->", values**2, weights)))


def slopes(found: Sequence[tuple[float, ...]], meshes: Sequence[int]) -> list[float]:
    """Slope of each error over the mesh size, fitted over the meshes."""
    return [float(-slope) for slope in np.polyfit(np.log(meshes), np.log(found), 1)[0]]


def rates(method: str, law: Manufactured, order: int, meshes: Sequence[int] = MESHES, mu: float = MU) -> list[Check]:
    """Of the three errors, against theory."""
    found = slopes([errors(law, method, order, n, mu) for n in meshes], meshes)
    return [
        Check(f"P{order}, c_n = {law.c_n:g}, m = {law.m}: rate of {norm}", rate, expected, SLACK, relative=False)
        for norm, rate, expected in zip(NORMS, found, RATES[order], strict=True)
    ]


@problem("rates of convergence, both orders, three laws", slow=("uzawa", "surface-uzawa"))
def checks(method: str, mu: float = MU) -> list[Check]:
    """All laws and both orders; with another mu than 0.4 they must fail."""
    return [check for law in LAWS for order in RATES for check in rates(method, law, order, mu=mu)]
