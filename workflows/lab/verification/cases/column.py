"""The column on a compliant foundation: pressed, overlapping at the start, force-driven, grazing.

The state is uniform, so any mesh is exact, and two cells on each side show that it is the same everywhere.

Column pressed on a compliant foundation: M (U - d) / H = c_n (d - g)_+^m.

A square or cube with u_x (= u_y) = 0 on its sides is under uniaxial strain, so the pressure is the same at every
height: M times the shortening (U - d) / H, M the constrained modulus. At the base it is the normal compliance
law. The displacement is linear, so any finite element must reproduce these numbers to solver precision.

Signs: U and d are the downward displacements of the top and of the base, g the initial gap (negative = overlap at the
start), all in [m]; the pressure is positive when pressing. c_n has the unit Pa/m^m.

Source: equilibrium, derived here; the table is recomputed in test_closed_forms.py with 50 digits.
"""

from dataclasses import dataclass
from typing import Literal

from stickslip import Block, Compliance, Contact, Load, Material, Plane, Scene, StepResult, Support
from stickslip.solvers.method_registry import METHODS
from stickslip.workflows.lab.verification.check import Check, close, farthest, problem
from stickslip.workflows.lab.verification.prepared import solved, solver


@dataclass(frozen=True, kw_only=True)
class ColumnState:
    """Place and load of the column's base."""

    penetration: float  # d - g where they touch, otherwise 0 [m]
    displacement: float  # d, downward [m]
    pressure: float  # [Pa]


def constrained_modulus(E: float, nu: float) -> float:
    """Stiffness under uniaxial strain, M = E (1 - nu) / ((1 + nu) (1 - 2 nu)) [Pa].

    >>> round(constrained_modulus(1000.0, 0.3), 4)
    1346.1538
    """
    return E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))


def penetration(*, stiffness: float, excess: float, c_n: float, m: float) -> float:
    """Root x > 0 of stiffness (excess - x) = c_n x^m; 0 where excess <= 0 [m].

    The unknown is x = d - g itself and not d: at grazing contact x is many orders smaller than g, and d - g would lose
    those digits. With x = excess y the equation is y + K y^m = 1: increasing, convex for m >= 1, and of relative
    condition at most 1 at its root. Newton from above therefore falls monotonically, until rounding stops it.

    Args:
        stiffness: M / H [Pa/m].
        excess: U - g, penetration without resistance of the base [m].
        c_n: compliance coefficient [Pa/m^m], > 0.
        m: compliance exponent, >= 1.

    Raises:
        ValueError: for m < 1, or a stiffness or c_n that is not positive.
    """
    if m < 1:
        raise ValueError(f"m = {m}: the compliance exponent must be at least 1")
    if stiffness <= 0 or c_n <= 0:
        raise ValueError(f"stiffness = {stiffness}, c_n = {c_n}: both must be positive")
    if excess <= 0:
        return 0.0
    K = c_n * excess ** (m - 1) / stiffness
    y = 1.0 if K <= 1 else K ** (-1 / m)
    while True:
        smaller = y - (y + K * y**m - 1) / (1 + m * K * y ** (m - 1))
        if smaller >= y:
            return excess * y
        y = smaller


def driven_by_displacement(*, M: float, U: float, g: float, c_n: float, m: float, height: float = 1.0) -> ColumnState:
    """State under a prescribed top displacement U (downward).

    U - g is exact in floating point when U and g are within a factor 2 (Sterbenz), so the answer belongs to the two
    numbers as given. Where g (1 + 1e-6) is meant more exactly than a float can hold it, call `penetration` with the
    excess g 1e-6.

    >>> state = driven_by_displacement(M=1000.0, U=0.03, g=0.01, c_n=1000.0, m=1)
    >>> round(state.displacement, 12), round(state.pressure, 12)
    (0.02, 10.0)
    """
    x = penetration(stiffness=M / height, excess=U - g, c_n=c_n, m=m)
    return ColumnState(penetration=x, displacement=g + x if x > 0 else U, pressure=c_n * x**m)


def driven_by_force(*, p: float, g: float, c_n: float, m: float) -> ColumnState:
    """State under a prescribed pressure p on top: d = g + (p / c_n)^(1 / m), whatever the column is made of.

    >>> driven_by_force(p=4.0, g=0.5, c_n=1.0, m=2).displacement
    2.5
    """
    if p < 0:
        raise ValueError(f"p = {p} Pa: a pulled column leaves its foundation, p must not be negative")
    x = (p / c_n) ** (1 / m)
    return ColumnState(penetration=x, displacement=g + x, pressure=p)


@dataclass(frozen=True, kw_only=True)
class ColumnCase:
    """One tabulated column of height 1 m with the digits it was published with."""

    U: float  # [m]
    g: float  # [m]
    c_n: float  # [Pa/m^m]
    m: float
    d: float  # [m]
    p: float  # [Pa]
    digits: int  # significant digits of d and p
    E: float = 1000.0  # [Pa]
    nu: float = 0.3


TABLE = (
    ColumnCase(U=0.01, g=0.002, c_n=1e4, m=1, d=2.9491525e-3, p=9.4915254, digits=8),
    ColumnCase(U=0.01, g=0.002, c_n=1e6, m=2, d=4.6768878e-3, p=7.1657280, digits=8),
    ColumnCase(U=0.01, g=0.002, c_n=1e8, m=3, d=5.8291773e-3, p=5.6145690, digits=8),
    # overlap at the start
    ColumnCase(U=0.0, g=-0.002, c_n=1e4, m=1, d=-1.7627119e-3, p=2.3728814, digits=8),
    # nearly incompressible
    ColumnCase(U=0.01, g=0.002, c_n=1e4, m=1, d=9.952299e-3, p=79.52299, digits=7, nu=0.4999),
)


E, NU = 1000.0, 0.3
M = constrained_modulus(E, NU)
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
    _, (step,) = solved(scene)
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
    exact = driven_by_displacement(M=M, U=top, g=GAP, c_n=c_n, m=m)
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
    stiffness = constrained_modulus(E, nu)
    exact = driven_by_displacement(M=stiffness, U=top, g=GAP, c_n=c_n, m=m)
    # the stiffness matrix's condition is 1 / (1 - 2 nu) times the column's, and so is the rounding
    return compare(f"{dim}D, nu = {nu}", step, exact, GAP, 1e-8)


def force_driven(method: str, dim: int, m: float, order: Literal[1, 2] = 1) -> list[Check]:
    """p = 7 Pa on top: only the foundation holds the column, and its tangent stiffness is 0 at first touch."""
    p, c_n = 7.0, C_N[m]
    step = solve(scene(dim=dim, method=method, c_n=c_n, m=m, g=GAP, pressure=p, order=order))
    exact = driven_by_force(p=p, g=GAP, c_n=c_n, m=m)
    return compare(f"{dim}D, order {order}, force-driven, m = {m:g}", step, exact, GAP)


def offset(method: str, dim: int, g: float, share: float) -> list[Check]:
    """A share of the gap or of the initial overlap is given as gap_offset: the answer does not change."""
    c_n, m, top = C_N[2], 2, 0.005
    step = solve(scene(dim=dim, method=method, c_n=c_n, m=m, g=g, top=top, offset=share * g))
    exact = driven_by_displacement(M=M, U=top, g=g, c_n=c_n, m=m)
    return compare(f"{dim}D, g = {g:g}, {100 * share:g} % of it gap_offset", step, exact, g)


def grazing(method: str, dim: int, m: int, beyond: float) -> list[Check]:
    """Top driven to g (1 + beyond): the pressure is 0, or of the order of c_n (g beyond)^m."""
    c_n, top = C_N[m], GAP * (1 + beyond)
    step = solve(scene(dim=dim, method=method, c_n=c_n, m=m, g=GAP, top=top))
    exact = driven_by_displacement(M=M, U=top, g=GAP, c_n=c_n, m=m).pressure
    name = f"{dim}D, U = g (1 {beyond:+g}), m = {m}"
    found = farthest(step.contacts["base"].pressure, exact)
    checks = [Check(f"{name}: pressure [Pa]", found, exact, 1e-9 * c_n * GAP**m, relative=False)]
    if exact > 0:
        # the solver's 1e-12 g is 1e-6 of the penetration g 1e-6, and 3e-6 of its cube
        checks.append(Check(f"{name}: pressure in its own measure [Pa]", found, exact, 1e-5, relative=True))
    if method == "condensed-newton":
        checks.append(Check(f"{name}: iterations", step.iterations, 0, GRAZING_ITERATIONS, relative=False))
    return checks


@problem("column on a compliant foundation, against the closed form", slow=("surface-uzawa",))
def checks(method: str) -> list[Check]:
    """All of them."""
    found: list[Check] = []
    for dim in (2, 3):
        for m in C_N:
            found += pressed(method, dim, m)
        for case in TABLE:
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
