"""The rigid flat punch: quadratic triangles, and a block so large that its far sides do not matter.

In the plane the influence of the far sides falls no faster than a / size (they hold back the stretch of the surface,
which a bonded punch feels): at .5 a the bonded shear is 9.2, 4.6, .3, .2 % too small at size = 40, 80, 2000, 4000 a,
the pressure .3, .2, .03, .03 %. Cells that grow with the distance make 4000 a as cheap as 40 a.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.builders.half_space import HalfSpace
from stickslip.geometry.obstacles.plane import Plane
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw
from stickslip.solvers.laws.normal import Bilateral, Tied, Unilateral
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.scene.loads import Support
from stickslip.solvers.scene.material import Material
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.lab.verification.check import Check
from stickslip.workflows.lab.verification.closed_forms import punch
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.lab.verification.solver import solver

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
    nu: float = punch.NU
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
        title="Rigid flat punch on a half-plane",
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
    simulation = prepare(scene(cut))
    (step,) = simulation.steps()
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
    bonded = solve(Cut(method=method, order=order, normal=BONDED))
    p_smooth, (p, q) = smooth.at(punch.X)[0], bonded.at(punch.X)
    exact_p, exact_q = punch.bonded(punch.X, punch.NU)
    found = []
    for k, x in enumerate(punch.X):
        free = punch.frictionless(x)
        found += [
            Check(f"frictionless, x = {x:g} a: p a / P", p_smooth[k], float(free), 2e-3, relative=True),
            Check(f"bonded, x = {x:g} a: p a / P", p[k], exact_p[k], 2e-3, relative=True),
            Check(f"bonded, x = {x:g} a: q a / P", q[k], exact_q[k], 2e-3 * exact_p[k], relative=False),
        ]
    return found


def far(method: str) -> list[Check]:
    """A block of half the size gives the same: the far sides do not matter."""
    here, near = (solve(Cut(method=method, normal=BONDED, size=size)) for size in (FAR, FAR / 2))
    scale = punch.bonded(np.zeros(1), punch.NU)[0][0]
    # the influence falls as 1 / size: what is left is as large as this change, an eighth of the mesh error allowed
    return [
        Check(f"{name}, x = {x:g} a: change from size {FAR / 2:g} a to {FAR:g} a", a, b, 2.5e-4 * scale, relative=False)
        for name, ours, theirs in zip("pq", here.at(punch.X), near.at(punch.X), strict=True)
        for x, a, b in zip(punch.X, ours, theirs, strict=True)
    ]


def stick(method: str, fine: float = 0.005, mus: tuple[float, ...] = tuple(punch.STICK)) -> list[Check]:
    """Sticking half-width with Coulomb friction, measured by the weights of the nodes that stick.

    .01, .005, .0025 a: mu = .1 sticks to .0382, .0358, .0371; .2 to .3604, .3603, .3618; .3 to .6892, .6897, .6899;
    .5 to .9450, .9427, .9413 a.
    """
    found = []
    for mu in mus:
        cut = Cut(method=method, normal=PRESSED, friction=Coulomb(mu=mu), fine=fine, edge=fine / 2, symmetric=True)
        allowed = max(punch.STICK_DIGITS, fine / 2)  # digits of the source, or the distance of two nodes
        found.append(Check(f"mu = {mu}: stick over a", solve(cut).stick, punch.STICK[mu], allowed, relative=False))
    return found


def incompressible(
    method: str, order: Literal[1, 2] = 2, formulation: Literal["auto", "displacement"] = "auto"
) -> list[Check]:
    """nu = .4999: a bonded punch has the pressure of a frictionless one; displacements of order 1 alone lock."""
    face = solve(Cut(method=method, normal=BONDED, nu=0.4999, order=order, formulation=formulation))
    p = face.at(punch.X)[0]
    # 1 % is asked for; with FINE the largest error is .8 % with order 1, .11 % with order 2
    name = f"nu = .4999, bonded, order {order}"
    return [
        Check(f"{name}, x = {x:g} a: p a / P", p[k], float(punch.frictionless(x)), 0.01, relative=True)
        for k, x in enumerate(punch.X)
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


def checks(method: str) -> list[Check]:
    """All of them with the reference; plain Uzawa needs over 10000 iterations on meshes graded to a thousandth."""
    if method != REFERENCE:
        return agree(method)
    return tractions(method) + far(method) + stick(method) + incompressible(method) + incompressible(method, order=1)
