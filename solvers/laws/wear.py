"""Sliding that is prescribed along the direction out of the plane, friction that turns towards it, and wear.

Archard: dw = k p ds, w the depth that both sides together lose, ds the length of the slip. A step is implicit: within
it the worn depth is k Δs p with its own pressure, a compliance of the point. So it wraps the resolvent of any normal
law, and is stable; the pressures before a step, held in it, make surfaces of zigzags.

Source: Archard, J. Appl. Phys. 24 (1953), of k; Johansson, Comput. Struct. 52 (1994), of implicit steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.amplitude import Amplitude, listed_times, value_at
from stickslip.geometry.arrays import EPS, ROUNDING, TINY, Array
from stickslip.geometry.errors import prefixed, require
from stickslip.geometry.expression import Varying, check_varying
from stickslip.geometry.field import values
from stickslip.geometry.keys import Key, Noun
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.laws import mu_table
from stickslip.solvers.laws.friction import Stick
from stickslip.solvers.laws.law import Dragged, FrictionLaw, NormalLaw, Trial
from stickslip.solvers.laws.mu_table import MuTable
from stickslip.solvers.laws.normal import NEWTON_STEPS

# behind the name of a contact that wears, in `State.memory`: worn depth, path of the slip where friction or k asks for
# it (m_n,) [m], and pressure where k does [Pa]
WORN, SLID, PRESSED = ".worn", ".slid", ".pressed"
REPEAT = ".repeat"  # beside them: number of load cycles that a step stands for; absent: one


@dataclass(frozen=True, kw_only=True)
class Wear(Noun):
    """Archard's wear of a contact: the pressure times the slip takes off k of a depth."""

    k: Annotated[
        float | tuple[float, float] | MuTable | str,
        Key(
            "1/Pa",
            "worn depth by pressure and slip; [surface, against]: that of each side, their sum counts; an expression "
            "of place and time; or a table, see `by`",
        ),
    ]
    by: Annotated[
        Literal["pressure", "slip"], Key("-", "what a table [[., k], ...] goes by: pressure, or the way slid so far")
    ] = "pressure"

    def __post_init__(self) -> None:
        if isinstance(self.k, str):
            check_varying(self.k, "k")
        elif self.table:
            mu_table.check(self.table, "k")
            p, k = np.array(self.table).T
            slope = np.diff(k) / np.diff(p)
            falls = self.by == "pressure" and bool(np.any(k[1:] + slope * p[1:] < 0))  # least at the end of a piece
            require(not falls, "k", [list(line) for line in self.table], "k p must not fall as the pressure p grows")
        else:
            require(self.k != (), "k", "[]", "a table needs at least one [value, k]")
            for k in np.ravel(self.k).tolist():
                require(k >= 0, "k", k, "must not be negative, in 1/Pa")

    @property
    def table(self) -> MuTable:
        """k by pressure or slip, [[., k], ...]; empty: it is not given so."""
        listed = self.k if isinstance(self.k, tuple) else ()
        return tuple(line for line in listed if isinstance(line, tuple))

    def asks_for(self, what: str) -> bool:
        """Whether k depends on "pressure" or "slip"."""
        return bool(self.table) and self.by == what

    def rate(self, points: Array, time: float, end: float, pressed: Array | None, slid: Array | None) -> Array:
        """Both sides' k (m,) [1/Pa] at points (m, d) [m].

        Args:
            time, end: [s], of now and of the scene.
            pressed: pressure (m,) [Pa]; None: k does not depend on it.
            slid: way so far (m,) [m]; None: likewise.
        """
        if isinstance(self.k, str):
            with prefixed("wear"):
                found = values(self.k, "k", points, time, end)
                require(bool(np.all(found >= 0)), "k", f'"{self.k}"', "must not be negative, in 1/Pa")
                return found
        if self.table:
            at = pressed if self.by == "pressure" else slid
            assert at is not None
            return mu_table.read(self.table, at)
        return np.full(len(points), np.sum(self.k))


@dataclass(frozen=True, kw_only=True)
class Slide:
    """Sliding out of the plane, the same at all points; in axisymmetric models a turn about the axis."""

    given: Amplitude  # [m], or a speed [m/s]; of a turn [rad], [rad/s]
    speed: bool  # a bare number is then constant
    turns: bool = False  # whether it is a turn

    def travelled(self, time: float, end: float) -> float:
        """Length of the path up to a time [s], whatever its sense [m]; of a turn [rad].

        >>> Slide(given=((1.0, 2.0), (2.0, -1.0)), speed=False).travelled(3.0, 3.0)
        5.0
        >>> Slide(given=((0.0, 1.0), (2.0, -1.0)), speed=True).travelled(2.0, 2.0)
        1.0
        """
        knots = np.array(sorted({0.0, time, *(t for t in listed_times(self.given) if 0 < t < time)}))
        if self.speed and isinstance(self.given, float | int):
            return abs(self.given) * time
        values = np.array([value_at(self.given, t, end) for t in knots])
        a, b = values[:-1], values[1:]
        if not self.speed:
            return float(np.abs(b - a).sum())
        both = np.abs(a) + np.abs(b)  # of a speed that passes zero the areas on both sides count
        mean = np.where(a * b >= 0, both / 2, (a**2 + b**2) / np.maximum(2 * both, TINY))
        return float(np.diff(knots) @ mean)

    def within(self, points: Array, time: float, step: float, end: float) -> Array:
        """Length (m,) [m] by which points (m, d) [m] slide in a step of a length [s] up to a time [s]."""
        far = self.travelled(time, end) - self.travelled(time - step, end)
        rounding = ROUNDING * self.travelled(time, end)
        return (far if far > rounding else 0.0) * (points[:, 0] if self.turns else np.ones(len(points)))


@dataclass(frozen=True, kw_only=True)
class Worn(NormalLaw):
    """A normal law in a step in which points wear: the penetration is that of the law, and softness p."""

    of: NormalLaw  # presses only
    softness: Array  # (m,) k times the slip in the step [m/Pa], >= 0

    @property
    def at_quadrature(self) -> bool:  # type: ignore[override]
        return self.of.at_quadrature

    @property
    def power(self) -> float | None:
        return self.of.power if self.of.power == 1 else None

    @property
    def give(self) -> Array:
        return self.softness

    def resolvent(self, p_hat: Array, gamma: Array) -> Array:
        """Pressure (m,) [Pa] with p + gamma (softness p + the law's penetration) = p_hat.

        >>> from stickslip.solvers.laws.normal import Unilateral
        >>> Worn(of=Unilateral(), softness=np.full(2, 0.5)).resolvent(np.array([-1.0, 4.0]), np.full(2, 2.0))
        array([0., 2.])
        """
        soft = 1 + gamma * self.softness
        return self.of.resolvent(p_hat / soft, gamma / soft)

    def stiffness(self, p: Array, p_hat: Array) -> Array:
        k = self.of.stiffness(p, p_hat)
        finite = np.where(np.isfinite(k), k, 0.0)
        return np.where(np.isfinite(k), finite / (1 + finite * self.softness), k)  # of what is rigid see `give`

    def penetration(self, p: Array) -> Array:
        return self.of.penetration(p) + self.softness * p

    def energy(self, p: Array) -> Array:
        return self.of.energy(p)  # what wears away stores nothing


@dataclass(frozen=True, kw_only=True)
class Turned(FrictionLaw):
    """Friction of points that slide out of the plane: t = s Δu_T / sqrt(Δu_T² + Δs²), opposite to the whole slip.

    Where Δs is large nothing sticks, and friction in the plane is that of a viscous film. What a point remembers is
    |t| / s, the share of the bound that is left in the plane.
    """

    remembers: ClassVar[str] = "slip, turned towards the prescribed sliding"
    drags: ClassVar[bool] = True
    of: FrictionLaw
    normal: NormalLaw  # of the contact
    slide: Slide
    points: Array | None = None  # (m_t, d) that it is at [m]; None: nowhere yet
    time: float = 0.0  # [s]
    end: float = 0.0  # of the scene [s]

    @staticmethod
    def refuses_law(law: FrictionLaw) -> bool:
        """Whether a friction law cannot turn: it gives before slip, holds at any traction, or differs by what was."""
        return bool(law.remembers or law.orthotropic or law.k_T is not None or isinstance(law, Stick))

    @property
    def changes(self) -> bool:
        return True

    def placed(self, points: Array, time: float, end: float) -> FrictionLaw:
        return replace(self, of=self.of.placed(points, time, end), points=points, time=time, end=end)

    def resists(self) -> bool:
        return self.of.resists()

    def slid(self, step: float) -> Array:
        """Length (m_t,) [m] by which the points slide out of the plane in a step of a length [s] up to its time."""
        assert self.points is not None
        return self.slide.within(self.points, self.time, step, self.end)

    def after(self, memory: Array, slip: Array, step: float) -> Array:
        aside = self.slid(step)
        return np.divide(slip, np.hypot(slip, aside), out=np.ones_like(slip), where=aside > 0)

    def at(self, memory: Array) -> FrictionLaw:
        return _Left(of=self.of, share=memory)

    def within(self, memory: Array, step: float) -> FrictionLaw:
        aside, now = self.slid(step), (self.normal, self.time, self.end)
        return _Turning(of=self.of, aside=aside, now=now) if aside.any() else self.of

    def work_aside(self, p: Array, average: Sparse, memory: Array, step: float) -> Array:
        """Work (m_t,) [J/m²] on the sliding out of the plane in a step that has ended at pressures p (m_n,) [Pa]."""
        s = self.of.limit(p, average, self.normal, self.time, self.end)
        return np.asarray(s * np.sqrt(np.maximum(1 - memory**2, 0.0)) * self.slid(step))

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return self.of.limit(p, average, normal, time, end)

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return self.of.lines(normal, time, end)

    def amplitudes(self) -> Mapping[tuple[str, ...], Varying]:
        return self.of.amplitudes()


@dataclass(frozen=True, kw_only=True)
class _Left(FrictionLaw):
    """Friction of which a share of the bound is left in the plane."""

    of: FrictionLaw
    share: Array  # (m_t,) [-]

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return self.share * self.of.limit(p, average, normal, time, end)

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        return self.of.limit_slope(p, average, normal).multiply(self.share[:, None]).tocsr()

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return self.of.lines(normal, time, end)


@dataclass(frozen=True, kw_only=True)
class _Turning(FrictionLaw):
    """The law in a step: slip in the plane raises its bound there, from nothing at rest to that of the law."""

    drags: ClassVar[bool] = True
    of: FrictionLaw
    aside: Array  # (m_t,) length of the sliding out of the plane in the step [m]
    now: tuple[NormalLaw, float, float]  # the normal law, time and end [s]

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return self.of.limit(p, average, normal, time, end)

    def dragged(self, p: Array, average: Sparse, trial: Trial) -> Dragged:
        """Solve s x / sqrt(x² + Δs²) + gamma x = |t_hat| for the slip x, by Newton's method from below."""
        s, slope = self.of.limit(p, average, *self.now), self.of.limit_slope(p, average, self.now[0])
        aside = np.maximum(self.aside, TINY)
        x = np.maximum((trial.size - s) / trial.gamma, trial.size / (trial.gamma + s / aside))
        for _ in range(NEWTON_STEPS):  # the left side is concave: it is approached from below
            length = np.hypot(x, aside)
            steep = trial.gamma + s * (aside / length) ** 2 / length
            step = (trial.size - s * x / length - trial.gamma * x) / steep
            x = x + np.maximum(step, 0.0)
            if np.all(step <= 2 * EPS * x):
                break
        length = np.hypot(x, aside)
        left, growth = x / length, s * (aside / length) ** 2 / length
        stiff = trial.gamma + growth
        by_pressure = slope.multiply((left * trial.gamma / stiff)[:, None]).tocsr()
        return Dragged(left * s, growth / stiff, by_pressure)

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return self.of.lines(normal, time, end)

    def homogeneous(self, normal: NormalLaw, time: float, end: float) -> bool:
        return False
