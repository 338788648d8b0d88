"""The column on a compliant foundation: pressed, overlapping at the start, force-driven, grazing.

The state is uniform, so any mesh is exact, and two cells on each side show that it is the same everywhere.
"""

from __future__ import annotations

from typing import Literal

from stickslip.geometry.builders.cuboid import Block
from stickslip.geometry.obstacles.plane import Plane
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.scene.loads import Load, Support
from stickslip.solvers.scene.material import Material
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.lab.verification.check import Check, close, farthest
from stickslip.workflows.lab.verification.closed_forms import column
from stickslip.workflows.lab.verification.closed_forms.column import ColumnCase, ColumnState
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.lab.verification.solver import solver

SLOW = ("surface-uzawa",)  # methods that take more than some seconds
E, NU = 1000.0, 0.3
M = column.constrained_modulus(E, NU)
TOLERANCE = 1e-9  # the solver's 1e-12 times the condition of the column, about 10, and two digits to spare
GAP = 0.002  # [m]
C_N = {1: 1e4, 1.5: 1e5, 2: 1e6, 2.7: 1e7, 3: 1e8}  # by exponent [Pa/m^m]
FORCED: tuple[tuple[int, Literal[1, 2]], ...] = ((2, 1), (3, 1), (2, 2))  # dimension, order
EXPONENTS = (1.5, 2.7, 3)  # from zero contact, by force
OFFSETS = ((GAP, 1.0), (GAP, -0.5), (-GAP, 1.0))  # gap [m], share of it that is gap_offset
GRAZING = (0.0, -1e-9, 1e-6)  # U / g - 1
GRAZING_ITERATIONS = 10


def scene(
    *,
    dim: int,
    method: str,
    c_n: float,
    m: float,
    g: float,
    top: float | None = None,
    pressure: float | None = None,
    nu: float = NU,
    cells: Literal["simplex", "tensor"] = "simplex",
    order: Literal[1, 2] = 1,
    mesh_size: float = 0.5,
    offset: float = 0.0,
) -> Scene:
    """Column of side 1 m above a gap of g, its top driven down by `top` [m] or by `pressure` [Pa].

    `offset` [m] of the gap is gap_offset, the rest is geometry.
    """
    up = "xyz"[dim - 1]
    sides = {"left": "x", "right": "x"} | ({"front": "y", "back": "y"} if dim == 3 else {})
    supports = {side: Support(boundary=f"block.{side}", displacement={axis: 0.0}) for side, axis in sides.items()}  # type: ignore[dict-item]
    loads = {}
    if top is not None:
        supports["top"] = Support(boundary="block.top", displacement={up: -top})  # type: ignore[dict-item]
    if pressure is not None:
        loads["top"] = Load(boundary="block.top", traction=(0.0,) * (dim - 1) + (-pressure,))
    across = (0.0,) * (dim - 1)
    normal = Compliance(c_n=c_n, m_n=m)
    return Scene(
        title="Column on a compliant foundation",
        model="3d" if dim == 3 else "plane strain",
        geometry=Block(
            length=1.0, width=1.0 if dim == 3 else None, height=1.0, mesh_size=mesh_size, cells=cells, order=order
        ),
        bodies={"block": Material(E=E, nu=nu)},
        obstacles={"foundation": Plane(point=(*across, offset - g), normal=(*across, 1.0))},
        contacts={"base": Contact(surface="block.bottom", against="foundation", normal=normal, gap_offset=offset)},
        supports=supports,
        loads=loads,
        solver=solver(method, 1e-12),
    )


def solve(scene: Scene) -> StepResult:
    """Its only step."""
    (step,) = prepare(scene).steps()
    return step


def compare(name: str, step: StepResult, exact: ColumnState, g: float, tolerance: float = TOLERANCE) -> list[Check]:
    """Pressure and displacement at the worst node of the base, and the resultant over the area of 1 m²."""
    base = step.contacts["base"]
    pressure, displacement = farthest(base.pressure, exact.pressure), farthest(g - base.gap, exact.displacement)
    return [
        close(f"{name}: base displacement [m]", displacement, exact.displacement, tolerance, abs(g)),
        close(f"{name}: pressure [Pa]", pressure, exact.pressure, tolerance, M * abs(g)),
        close(f"{name}: upward force [N]", base.force[-1], exact.pressure, tolerance, M * abs(g)),
    ]


def pressed(method: str, dim: int, m: float, cells: Literal["simplex", "tensor"] = "simplex") -> list[Check]:
    """Top driven 10 mm down across a gap of 2 mm."""
    top, c_n = 0.01, C_N[m]
    step = solve(scene(dim=dim, method=method, c_n=c_n, m=m, g=GAP, top=top, cells=cells))
    exact = column.driven_by_displacement(M=M, U=top, g=GAP, c_n=c_n, m=m)
    return compare(f"{dim}D, m = {m:g}", step, exact, GAP)


def tabulated(method: str, dim: int, case: ColumnCase) -> list[Check]:
    """The published digits, initial overlap and nu = 0.4999 among them."""
    step = solve(scene(dim=dim, method=method, c_n=case.c_n, m=case.m, g=case.g, top=case.U, nu=case.nu))
    rounding = 0.5 * 10.0 ** (1 - case.digits)  # half a unit of the last digit, for a leading 1
    exact = ColumnState(penetration=case.d - case.g, displacement=case.d, pressure=case.p)
    return compare(f"{dim}D, table, m = {case.m:g}, U = {case.U:g}, nu = {case.nu:g}", step, exact, case.g, rounding)


def incompressible(method: str, dim: int) -> list[Check]:
    """nu = 0.4999 against the closed form, beyond the digits of the table: in uniform strain nothing locks."""
    nu, top, c_n, m = 0.4999, 0.01, C_N[1], 1
    step = solve(scene(dim=dim, method=method, c_n=c_n, m=m, g=GAP, top=top, nu=nu))
    stiffness = column.constrained_modulus(E, nu)
    exact = column.driven_by_displacement(M=stiffness, U=top, g=GAP, c_n=c_n, m=m)
    # the stiffness matrix's condition is 1 / (1 - 2 nu) times the column's, and so is the rounding
    return compare(f"{dim}D, nu = {nu}", step, exact, GAP, 1e-8)


def force_driven(method: str, dim: int, m: float, order: Literal[1, 2] = 1) -> list[Check]:
    """p = 7 Pa on top: only the foundation holds the column, and its tangent stiffness is 0 at first touch."""
    p, c_n = 7.0, C_N[m]
    step = solve(scene(dim=dim, method=method, c_n=c_n, m=m, g=GAP, pressure=p, order=order))
    exact = column.driven_by_force(p=p, g=GAP, c_n=c_n, m=m)
    return compare(f"{dim}D, order {order}, force-driven, m = {m:g}", step, exact, GAP)


def offset(method: str, dim: int, g: float, share: float) -> list[Check]:
    """A share of the gap or of the initial overlap is given as gap_offset: the answer does not change."""
    c_n, m, top = C_N[2], 2, 0.005
    step = solve(scene(dim=dim, method=method, c_n=c_n, m=m, g=g, top=top, offset=share * g))
    exact = column.driven_by_displacement(M=M, U=top, g=g, c_n=c_n, m=m)
    return compare(f"{dim}D, g = {g:g}, {100 * share:g} % of it gap_offset", step, exact, g)


def grazing(method: str, dim: int, m: int, beyond: float) -> list[Check]:
    """Top driven to g (1 + beyond): the pressure is 0, or of the order of c_n (g beyond)^m."""
    c_n, top = C_N[m], GAP * (1 + beyond)
    step = solve(scene(dim=dim, method=method, c_n=c_n, m=m, g=GAP, top=top))
    exact = column.driven_by_displacement(M=M, U=top, g=GAP, c_n=c_n, m=m).pressure
    name = f"{dim}D, U = g (1 {beyond:+g}), m = {m}"
    found = farthest(step.contacts["base"].pressure, exact)
    checks = [Check(f"{name}: pressure [Pa]", found, exact, 1e-9 * c_n * GAP**m, relative=False)]
    if exact > 0:
        # the solver's 1e-12 g is 1e-6 of the penetration g 1e-6, and 3e-6 of its cube
        checks.append(Check(f"{name}: pressure in its own measure [Pa]", found, exact, 1e-5, relative=True))
    if method == "condensed-newton":
        checks.append(Check(f"{name}: iterations", step.iterations, 0, GRAZING_ITERATIONS, relative=False))
    return checks


def checks(method: str) -> list[Check]:
    """All of them."""
    found: list[Check] = []
    for dim in (2, 3):
        for m in C_N:
            found += pressed(method, dim, m)
        for case in column.TABLE:
            found += tabulated(method, dim, case)
        found += incompressible(method, dim)
        for g, share in OFFSETS:
            found += offset(method, dim, g, share)
    if METHODS[method].WORKS_WITH.floating:
        for dim, order in FORCED:
            for m in EXPONENTS:
                found += force_driven(method, dim, m, order)
    for m in (1, 2, 3):
        for beyond in GRAZING:
            found += grazing(method, 2, m, beyond)
    return found
