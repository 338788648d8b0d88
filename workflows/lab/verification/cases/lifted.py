"""The column lifted off and set down again: grazing, pressed, sheared, contact lost, moved aside, regained.

Column lifted off its base and set down again: an open contact carries no friction and keeps no memory.

A column of constrained modulus M, shear modulus G and height H with periodic lateral faces, its top at (V, -U), its
base at w and at first a gap g above a rigid plane: p = M (U - g)+ / H, tau = G (V - w) / H, |tau| <= mu p, V, w and tau
vectors along the plane. Compression and shear do not interact. While the base hangs free it is below its
top, w = V: that is the clip to a bound of 0. On a foundation that gives way p is that of `column` instead. A step's
answer is the bound at its end, on the trial traction from w at its start, or from where it touches in the step; work is
that at the end too, so what the base rubs while p falls to 0 within a step is not seen.

Source: derived here. Only steps in which nothing turns from one state to another and back are exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stickslip import OPEN, Compliance, Coulomb, NormalLaw, Plane, Scene, StepResult, Steps, Support
from stickslip.geometry.arrays import LAST_DIGITS, Array
from stickslip.workflows.lab.verification.cases import sheared_column
from stickslip.workflows.lab.verification.cases.column import C_N, driven_by_displacement
from stickslip.workflows.lab.verification.cases.sheared_column import COLUMN, MU, PRESSURE, RIGID, E, M, solve
from stickslip.workflows.lab.verification.check import Check, accounted, farthest, problem, worst


@dataclass(frozen=True, kw_only=True)
class LiftedColumn:
    """The column, its gap and its friction."""

    M: float  # [Pa]
    G: float  # [Pa]
    mu: float
    gap: float  # at the start [m]
    height: float = 1.0  # [m]
    foundation: tuple[float, float] | None = None  # c_n [Pa/m^m], m; None: rigid

    def pressed(self, U: float) -> tuple[float, float]:
        """Pressure [Pa], and the gap that is left, negative where the foundation gives way [m]."""
        if self.foundation is None:
            return self.M / self.height * max(U - self.gap, 0.0), max(self.gap - U, 0.0)
        c_n, m = self.foundation
        state = driven_by_displacement(M=self.M, U=U, g=self.gap, c_n=c_n, m=m, height=self.height)
        return state.pressure, self.gap - state.displacement


@dataclass(frozen=True, kw_only=True)
class LiftedHistory:
    """The states after each step."""

    pressure: Array  # (steps,) [Pa]
    gap: Array  # (steps,) [m]
    tau: Array  # (steps, d - 1) in the sense of the slip [Pa]
    slip: Array  # (steps, d - 1) displacement of the base along the plane [m]
    dissipation: Array  # (steps,) so far, per area of the base [J/m²]


def follow(column: LiftedColumn, down: Array, along: Array) -> LiftedHistory:
    """Move the top, from an undeformed start.

    Args:
        down: U at the end of each step (steps,) [m].
        along: V (steps, d - 1) [m].

    >>> column = LiftedColumn(M=1000.0, G=100.0, mu=0.5, gap=0.0)
    >>> history = follow(column, np.array([0.01, 0.01, -0.01]), np.array([[0.0], [0.1], [0.1]]))
    >>> history.pressure, history.tau[:, 0], history.slip[:, 0], history.gap
    (array([10., 10.,  0.]), array([0., 5., 0.]), array([0.  , 0.05, 0.1 ]), array([0.  , 0.  , 0.01]))
    """
    before, start = np.append(0.0, down[:-1]), np.vstack([np.zeros_like(along[:1]), along[:-1]])
    closes = np.flatnonzero((before < column.gap) & (down > column.gap))
    part = ((column.gap - before) / np.where(down != before, down - before, 1.0))[closes]
    touch = start[closes] + part[:, None] * (along - start)[closes]
    U, V = np.insert(down, closes, column.gap), np.insert(along, closes, touch, axis=0)
    pressure, gap = np.array([column.pressed(float(each)) for each in U]).T
    tau, slip, dissipation = sheared_column.follow(column.G / column.height, column.mu * pressure, V)
    ends = np.delete(np.arange(len(U)), closes + np.arange(len(closes)))
    return LiftedHistory(
        pressure=pressure[ends], gap=gap[ends], tau=tau[ends], slip=slip[ends], dissipation=dissipation[ends]
    )


GAP = 0.002  # [m]
PRESS = GAP + PRESSURE / M  # of the top, downward [m]: the bound is 3 Pa
MM = 1e-3
MOVES: tuple[tuple[str, float, float, float], ...] = (  # name; U, V_x, V_y of the top [m]
    ("touches", GAP, 0.0, 0.0),
    ("pressed", PRESS, 0.0, 0.0),
    ("sticks", PRESS, 2 * MM, 0.0),
    ("slips", PRESS, 10 * MM, 0.0),
    ("half let go, slips on", (GAP + PRESS) / 2, 10 * MM, 0.0),
    ("grazes by a millionth of the gap", GAP * (1 + 1e-6), 10 * MM, 0.0),
    ("lost by a thousand millionth", GAP * (1 - 1e-9), 10 * MM, 0.0),
    ("in the air", 0.0, 10 * MM, 0.0),
    ("carried back", 0.0, -20 * MM, 5 * MM),
    ("touches again", GAP, -20 * MM, 5 * MM),
    ("pressed again, unsheared", PRESS, -20 * MM, 5 * MM),
    ("nothing moves", PRESS, -20 * MM, 5 * MM),
    ("sticks again", PRESS, -21 * MM, 6 * MM),
    ("slips again", PRESS, -40 * MM, 6 * MM),
    ("nothing moves while it slips", PRESS, -40 * MM, 6 * MM),
    ("reversed", PRESS, 0.0, -10 * MM),
    ("let go at once", -GAP, 0.0, 0.0),
    ("pressed and dragged at once", (GAP + PRESS) / 2, 10 * MM, 10 * MM),
)
FOUNDATIONS = tuple(Compliance(c_n=C_N[m], m_n=m) for m in (1, 2, 3))
GRAZES = "grazes by a millionth of the gap"
STILL = ("nothing moves", "nothing moves while it slips")
TOLERANCE = 1e-9  # of the pressure and the largest move: the solver's 1e-12 over all steps, and two digits to spare


def scene(method: str, dim: int, mu: float = MU, normal: NormalLaw = RIGID) -> Scene:
    """The sheared column above a gap, its top moved as listed."""
    path = moves(dim)
    times = [float(k + 1) for k in range(len(path))]
    components = dict(zip("xyz", path.T.tolist(), strict=False))
    top = {axis: tuple(zip(times, values, strict=True)) for axis, values in components.items()}
    drawn = sheared_column.scene(
        dim=dim, method=method, E=E, friction=Coulomb(mu=mu), path=np.zeros((1, dim - 1)), normal=normal
    )
    across = (0.0,) * (dim - 1)
    return replace(
        drawn,
        obstacles={"floor": Plane(point=(*across, -GAP), normal=(*across, 1.0))},
        supports={"top": Support(boundary="block.top", displacement=top)},  # type: ignore[arg-type]
        steps=Steps(end=times[-1], count=len(times)),
    )


def moves(dim: int) -> Array:
    """Displacements of the top (moves, dim) [m], upward last; in 2D the components along y are left out."""
    U, along = np.array([move[1] for move in MOVES]), np.array([move[2:] for move in MOVES])
    return np.column_stack([along[:, : dim - 1], -U])


def checks_of(method: str, dim: int, mu: float = MU, normal: NormalLaw = RIGID) -> list[Check]:
    """Every move against the closed form, at the worst node of the base."""
    steps, path = solve(scene(method, dim, mu, normal)), moves(dim)
    foundation = (normal.c_n, normal.m_n) if isinstance(normal, Compliance) else None
    column = LiftedColumn(M=M, G=COLUMN.G, mu=MU, gap=GAP, foundation=foundation)
    exact = follow(column, -path[:, -1], path[:, :-1])
    kind = f"{dim}D" if foundation is None else f"{dim}D, m = {foundation[1]:g}"
    found, farthest_move = [], float(np.abs(path).max())
    for k, (step, (name, *_)) in enumerate(zip(steps, MOVES, strict=True)):
        base, at = step.contacts["base"], f"{kind}, {name} (move {k + 1})"
        shear, slip = -base.traction[:, : dim - 1] - exact.tau[k], base.slip[:, : dim - 1] - exact.slip[k]
        pressure, works = TOLERANCE * PRESSURE, TOLERANCE * MU * PRESSURE * farthest_move
        found += [
            _near(f"{at}: pressure [Pa]", farthest(base.pressure, exact.pressure[k]), exact.pressure[k], pressure),
            _near(f"{at}: shear less the closed form's [Pa]", float(np.abs(shear).max()), 0.0, pressure),
            _near(f"{at}: slip less the closed form's [m]", float(np.abs(slip).max()), 0.0, TOLERANCE * farthest_move),
            _near(f"{at}: gap [m]", farthest(base.gap, exact.gap[k]), exact.gap[k], TOLERANCE * GAP),
            _near(f"{at}: dissipation so far [J]", base.dissipation_total, exact.dissipation[k], works),
        ]
        if exact.pressure[k] == 0 and exact.gap[k] > 0:
            found.append(_near(f"{at}: nodes that touch", float(np.sum(base.status != OPEN)), 0.0, 0.0))
        if name == GRAZES and foundation is None:  # of a soft one c_n (1e-6 g)^m is beyond the solver's tolerance
            pressed = farthest(base.pressure, exact.pressure[k])  # as `column.grazing`
            found.append(Check(f"{at}: pressure in its own measure [Pa]", pressed, exact.pressure[k], 1e-5, True))
        if name in STILL:
            found += _unchanged(at, steps[k - 1], step, LAST_DIGITS * works / TOLERANCE)
    return found + accounted(f"{kind}, lost and regained", steps)


def _near(name: str, computed: float, reference: float, tolerance: float) -> Check:
    return Check(name, float(computed), float(reference), tolerance, relative=False)


def _unchanged(at: str, before: StepResult, now: StepResult, rounding: float) -> list[Check]:
    """A step without an increment takes at most one iteration and changes nothing but the `rounding` of works [J]."""
    return [
        Check(f"{at}: iterations", now.iterations, 0, 1, relative=False),
        # rounding of one solve with the bodies
        _near(f"{at}: change of the tractions [Pa]", np.abs(now.p - before.p).max(), 0.0, 1e-12 * PRESSURE * 10),
        _near(f"{at}: dissipation [J]", now.contacts["base"].dissipation, 0.0, rounding),
    ]


@problem("grazing, contact lost and regained, closed form")
def checks(method: str) -> list[Check]:
    """In 2D, and in 3D along oblique paths; on rigid ground and on foundations of steep and of zero initial tangent."""
    kinds: list[tuple[int, NormalLaw]] = [(2, RIGID), (3, RIGID), *((2, law) for law in FOUNDATIONS)]
    return [check for dim, law in kinds for check in worst(checks_of(method, dim, normal=law))]
