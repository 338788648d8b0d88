"""The rigid flat punch: quadratic triangles, and a block so large that its far sides do not matter.

In the plane the influence of the far sides falls no faster than a / size (they hold back the stretch of the surface,
which a bonded punch feels): at .5 a the bonded shear is 9.2, 4.6, .3, .2 % too small at size = 40, 80, 2000, 4000 a,
the pressure .3, .2, .03, .03 %. Cells that grow with the distance make 4000 a as cheap as 40 a.

Rigid flat punch on an elastic half-plane: frictionless, bonded, and with Coulomb friction.

The punch |x| <= a presses with P per metre of thickness on y <= 0 in plane strain, without rotation. A half-plane's
surface moves, downwards (w) and along x, by

    w'(x)   = -k / pi PV∫ p(s) / (x - s) ds + beta k q(x)
    u_x'(x) = -k / pi PV∫ q(s) / (x - s) ds - beta k p(x),    k = 2 (1 - nu²) / E, beta = (1 - 2 nu) / (2 (1 - nu)),

with p the pressure and q the shear traction on the half-plane, along x. Without friction q = 0 and w' = 0: p is
P / (pi sqrt(a² - x²)). Bonded, u_x' = 0 too. With x = a tanh(t), p = C cosh(t) cos(2 eps t), q = C cosh(t) sin(2 eps t)
solve both: PV∫ cos(o s) / sinh(t - s) ds = pi tanh(pi o / 2) sin(o t), and the same with sin and -cos, so that
tanh(pi eps) = beta, or eps = ln(3 - 4 nu) / (2 pi). Tractions change sign infinitely often at the edge, from about
1e-7 a on.

With friction the stick width does not depend on the load, because the contact width is fixed.

Source: Muskhelishvili (1953), derived here as above. For friction: Spence, Proc. Camb. Phil. Soc. 73 (1973); STICK was
computed for this project by an independent half-plane program, and is data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np

from stickslip import Contact, Coulomb, FrictionLaw, HalfSpace, Material, NormalLaw, Plane, Scene, StepResult, Support
from stickslip.geometry.arrays import Array
from stickslip.solvers.laws.normal import Bilateral, Tied, Unilateral
from stickslip.workflows.lab.verification.check import Check, problem
from stickslip.workflows.lab.verification.prepared import solved, solver

NU = 0.3
X = np.array([0.0, 0.5, 0.9])  # samples, over a
STICK = {0.1: 0.038, 0.2: 0.362, 0.3: 0.690, 0.5: 0.941}  # half-width of the sticking part over a, by mu; nu = 0.3
STICK_DIGITS = 0.004  # accuracy of STICK


def frictionless(x: Array, a: float = 1.0, P: float = 1.0) -> Array:
    """Pressure [Pa] at x [m], |x| < a.

    >>> frictionless(X).round(5)
    array([0.31831, 0.36755, 0.73025])
    """
    return np.asarray(P / (np.pi * np.sqrt(a**2 - x**2)))


def oscillation(nu: float) -> float:
    """eps, the exponent's imaginary part [-]: 0 for an incompressible half-plane, which moves as if frictionless."""
    return float(np.log(3 - 4 * nu) / (2 * np.pi))


def bonded(x: Array, nu: float, a: float = 1.0, P: float = 1.0) -> tuple[Array, Array]:
    """Pressure and shear traction on the half-plane [Pa], outward where x > 0.

    >>> p, q = bonded(X, NU)
    >>> p.round(5), q.round(5)
    (array([0.33216, 0.38152, 0.73329]), array([0.     , 0.03935, 0.20725]))
    """
    eps = oscillation(nu)
    size = np.cosh(np.pi * eps) * frictionless(x, a, P)
    angle = eps * np.log((a + x) / (a - x))
    return np.asarray(size * np.cos(angle)), np.asarray(size * np.sin(angle))


REFERENCE = "condensed-newton"
HELD, PRESSED, BONDED = Bilateral(), Unilateral(), Tied()
FAR = 4000.0  # depth and half width of the block, over a
FINE = 0.0125  # cells of the contact part, over a; a tenth of it at its edges
AGREEMENT = 1e-6  # of two methods at tolerance 1e-10, times the condition of the punch
MEANS = {1: np.array([1, 1]) / 2, 2: np.array([1, 1, 4]) / 6}  # Simpson; facets list their ends first


@dataclass(frozen=True, kw_only=True)
class Cut:
    """A punch of a = 1 m on a mesh."""

    method: str
    normal: NormalLaw = HELD
    friction: FrictionLaw | None = None
    nu: float = NU
    formulation: Literal["auto", "displacement"] = "auto"
    order: Literal[1, 2] = 2
    fine: float = FINE
    edge: float | None = FINE / 10
    size: float = FAR
    symmetric: bool = False


def scene(cut: Cut) -> Scene:
    """Block held at its bottom, the punch driven down; its load is a result."""
    half = {"axis": Support(boundary="half_space.axis", displacement={"x": 0.0})} if cut.symmetric else {}
    return Scene(
        model="plane strain",
        geometry=HalfSpace(
            contact_half_width=1.0,
            size=cut.size,
            mesh_size=cut.size / 4,
            contact_mesh_size=cut.fine,
            edge_mesh_size=cut.edge,
            order=cut.order,
            symmetric=cut.symmetric,
        ),
        bodies={"half_space": Material(E=1000.0, nu=cut.nu, formulation=cut.formulation)},
        obstacles={"punch": Plane(point=(0.0, 0.0), normal=(0.0, -1.0), displacement={"y": -0.01})},
        contacts={
            "face": Contact(surface="half_space.contact", against="punch", normal=cut.normal, friction=cut.friction)
        },
        supports={"bottom": Support(boundary="half_space.bottom", displacement={"x": 0.0, "y": 0.0})} | half,
        solver=solver(cut.method, 1e-10),
    )


@dataclass(frozen=True)
class Face:
    """Tractions at P = 1 N/m, mean over each facet: at single nodes those of quadratic cells scatter."""

    x: Array  # middles of the facets (f,) [m]
    p: Array  # (f,) [Pa]
    q: Array  # shear on the half-plane (f,) [Pa]
    stick: float  # length that sticks [m]
    step: StepResult

    def at(self, x: Array) -> tuple[Array, Array]:
        """p and q at x [m]."""
        return np.interp(x, self.x, self.p), np.interp(x, self.x, self.q)


@lru_cache
def solve(cut: Cut) -> Face:
    """Its only step."""
    simulation, (step,) = solved(scene(cut))
    face = step.contacts["face"]
    points, facets, _ = simulation.data.surfaces["face"]
    x, p, q = (values[facets] @ MEANS[cut.order] for values in (points[:, 0], face.pressure, face.traction[:, 0]))
    order = np.argsort(x)
    P = face.normal_force * (2 if cut.symmetric else 1)
    return Face(x[order], p[order] / P, q[order] / P, face.stick_area, step)


def tractions(method: str, order: Literal[1, 2] = 2) -> list[Check]:
    """Without friction and bonded."""
    # the mesh: at 4, 2 and 1 times FINE the largest error is .24, .45 and .08 % of p; 1 % is asked for
    smooth = solve(Cut(method=method, order=order))
    held = solve(Cut(method=method, order=order, normal=BONDED))
    p_smooth, (p, q) = smooth.at(X)[0], held.at(X)
    exact_p, exact_q = bonded(X, NU)
    found = []
    for k, x in enumerate(X):
        free = frictionless(x)
        found += [
            Check(f"frictionless, x = {x:g} a: p a / P", p_smooth[k], float(free), 2e-3, relative=True),
            Check(f"bonded, x = {x:g} a: p a / P", p[k], exact_p[k], 2e-3, relative=True),
            Check(f"bonded, x = {x:g} a: q a / P", q[k], exact_q[k], 2e-3 * exact_p[k], relative=False),
        ]
    return found


def far(method: str) -> list[Check]:
    """A block of half the size gives the same: the far sides do not matter."""
    here, near = (solve(Cut(method=method, normal=BONDED, size=size)) for size in (FAR, FAR / 2))
    scale = bonded(np.zeros(1), NU)[0][0]
    # the influence falls as 1 / size: what is left is as large as this change, an eighth of the mesh error allowed
    return [
        Check(f"{name}, x = {x:g} a: change from size {FAR / 2:g} a to {FAR:g} a", a, b, 2.5e-4 * scale, relative=False)
        for name, ours, theirs in zip("pq", here.at(X), near.at(X), strict=True)
        for x, a, b in zip(X, ours, theirs, strict=True)
    ]


def stick(method: str, fine: float = 0.005, mus: tuple[float, ...] = tuple(STICK)) -> list[Check]:
    """Sticking half-width with Coulomb friction, measured by the weights of the nodes that stick.

    .01, .005, .0025 a: mu = .1 sticks to .0382, .0358, .0371; .2 to .3604, .3603, .3618; .3 to .6892, .6897, .6899;
    .5 to .9450, .9427, .9413 a.
    """
    found = []
    for mu in mus:
        cut = Cut(method=method, normal=PRESSED, friction=Coulomb(mu=mu), fine=fine, edge=fine / 2, symmetric=True)
        allowed = max(STICK_DIGITS, fine / 2)  # digits of the source, or the distance of two nodes
        found.append(Check(f"mu = {mu}: stick over a", solve(cut).stick, STICK[mu], allowed, relative=False))
    return found


def incompressible(
    method: str, order: Literal[1, 2] = 2, formulation: Literal["auto", "displacement"] = "auto"
) -> list[Check]:
    """nu = .4999: a bonded punch has the pressure of a frictionless one; displacements of order 1 alone lock."""
    face = solve(Cut(method=method, normal=BONDED, nu=0.4999, order=order, formulation=formulation))
    p = face.at(X)[0]
    # 1 % is asked for; with FINE the largest error is .8 % with order 1, .11 % with order 2
    name = f"nu = .4999, bonded, order {order}"
    return [
        Check(f"{name}, x = {x:g} a: p a / P", p[k], float(frictionless(x)), 0.01, relative=True)
        for k, x in enumerate(X)
    ]


def agree(method: str) -> list[Check]:
    """Two methods on a mesh that suits both: cells of one size, in a small block."""
    found = []
    for name, normal, friction in (("bonded", BONDED, None), ("mu = .3", PRESSED, Coulomb(mu=0.3))):
        cut = Cut(method=method, normal=normal, friction=friction, order=1, fine=0.1, edge=None, size=10.0)
        a, b = solve(cut).step, solve(replace(cut, method=REFERENCE)).step
        apart = float(np.abs(a.displacement - b.displacement).max() / np.abs(b.displacement).max())
        mine, theirs = a.contacts["face"], b.contacts["face"]
        found += [
            Check(f"{name}, coarse, against {REFERENCE}: displacement", apart, 0.0, AGREEMENT, relative=False),
            Check(
                f"{name}, coarse: normal force [N/m]", mine.normal_force, theirs.normal_force, AGREEMENT, relative=True
            ),
        ]
    return found


@problem("rigid flat punch, closed forms and stick widths")
def checks(method: str) -> list[Check]:
    """All of them with the reference; plain Uzawa needs over 10000 iterations on meshes graded to a thousandth."""
    if method != REFERENCE:
        return agree(method)
    return tractions(method) + far(method) + stick(method) + incompressible(method) + incompressible(method, order=1)
