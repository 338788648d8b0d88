"""Friction by slip rate and state: it rises at once with the rate, and changes with the age of what touches.

f = a asinh(V / (2 V0) exp(psi / a)) with psi = f0 + b ln(V0 theta / Dc), and the traction f p_n + eta V. The state
theta is that at the end of a step by its law's exact solution at the step's own rate. Nothing ever rests: the
regularised form gives each traction a rate, however small.

A traction that grows with the rate has one rate. Where b > a it falls again once V Δt exceeds about Dc, unless bodies
and radiation are stiffer: steps have to be shorter than Dc / V there.

Source: Dieterich, J. Geophys. Res. 84 (1979), Ruina, J. Geophys. Res. 88 (1983), of both laws of the state; Rice,
Lapusta & Ranjith, J. Mech. Phys. Solids 49 (2001), of the regularised form.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import EPS, SLIGHT, TINY, Array, Ints
from stickslip.geometry.errors import prefixed, require
from stickslip.geometry.expression import Varying
from stickslip.geometry.field import Field, check_field, in_time, values
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.laws.law import Dragged, FrictionLaw, NormalLaw, Trial
from stickslip.solvers.laws.normal import NEWTON_STEPS
from stickslip.solvers.laws.rate_dependent import Sliding

STEADY = "steady"


@dataclass(frozen=True, kw_only=True)
class RateAndState(FrictionLaw):
    """Friction by slip rate V and state theta, f = a asinh(V / (2 V0) exp((f0 + b ln(V0 theta / Dc)) / a))."""

    remembers: ClassVar[str] = "slip rate and state"
    timed: ClassVar[bool] = True
    drags: ClassVar[bool] = True
    f0: Annotated[float, Key("-", "coefficient of friction in steady sliding at V0")]
    a: Annotated[Field, Key("-", "direct effect of the rate: a number, an expression, or a map over places")]
    b: Annotated[Field, Key("-", "effect of the state, likewise")]
    Dc: Annotated[Field, Key("m", "slip over which the state changes, likewise")]
    V0: Annotated[float, Key("m/s", "rate of f0")]
    evolution: Annotated[
        Literal["aging", "slip"], Key("-", "law of the state: 1 - V theta / Dc, or -V theta / Dc ln(V theta / Dc)")
    ] = "aging"
    damping: Annotated[
        float, Key("Pa s/m", "radiation damping eta: eta V beside friction; G / (2 c_s) of a half-space")
    ] = 0.0
    theta: Annotated[float | None, Key("s", "state at t = 0; absent: Dc / V0")] = None
    law: Annotated[Literal["rate_and_state"], Key("-", "the law's name")] = "rate_and_state"

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("a", "b", "Dc"):
            check_field(getattr(self, key), key)
            require(not in_time(getattr(self, key), key), key, getattr(self, key), "does not change in time")
        for key, value in ((key, getattr(self, key)) for key in ("a", "Dc", "f0", "V0")):
            require(not isinstance(value, float | int) or value > 0, key, value, "must be positive")
        require(not isinstance(self.b, float | int) or self.b >= 0, "b", self.b, "must not be negative")
        require(self.damping >= 0, "damping", self.damping, "must not be negative, in Pa s/m")
        require(self.theta is None or self.theta > 0, "theta", self.theta, "must be positive, in seconds")
        require(self.k_T is None, "k_T", self.k_T, "friction that slips at all tractions is not elastic before it")

    def placed(self, points: Array, time: float, end: float) -> FrictionLaw:
        with prefixed("friction"):
            found = {
                key: np.broadcast_to(values(getattr(self, key), key, points, end, end), len(points)).astype(float)
                for key in ("a", "b", "Dc")
            }
            for key in ("a", "Dc"):
                require(bool(np.all(found[key] > 0)), key, getattr(self, key), "must be positive everywhere")
            least = f"must be at least f0 / 1000 = {SLIGHT * self.f0:g}; friction that no rate changes is coulomb"
            require(bool(np.all(found["a"] >= SLIGHT * self.f0)), "a", self.a, least)
        return RateAndStateByPoint(of=self, a=found["a"], b=found["b"], Dc=found["Dc"])

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return np.asarray(self.f0 * np.maximum(average @ p, 0.0))

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return np.inf, 0.0, np.inf

    def amplitudes(self) -> Mapping[tuple[str, ...], Varying]:
        return {}


@dataclass(frozen=True, kw_only=True)
class RateAndStateByPoint(FrictionLaw):
    """The law at tangential points; memory (m_t, 2) is ln(V0 theta / Dc) and V."""

    remembers: ClassVar[str] = RateAndState.remembers
    timed: ClassVar[bool] = True
    drags: ClassVar[bool] = True
    rests: ClassVar[bool] = False
    of: RateAndState
    a: Array  # (m_t,) [-], like the next
    b: Array
    Dc: Array  # [m]

    def memory(self, points: int) -> Array:
        aged = np.zeros(points) if self.of.theta is None else np.log(self.of.V0 * self.of.theta / self.Dc)
        return np.column_stack([aged, np.zeros(points)])

    def state(self, aged: Array, V: Array, step: float) -> tuple[Array, Array]:
        """ln(V0 theta / Dc) (m_t,) after a step of a length [s] at rates V (m_t,) [m/s], and its derivative by ln V.

        >>> one = np.ones(1)
        >>> law = RateAndState(f0=0.6, a=0.01, b=0.015, Dc=1.0, V0=1.0, evolution="slip").placed(one[:, None], 1.0, 1.0)
        >>> law.state(0 * one, np.e * one, 1 / np.e)[0]
        array([-0.63212056])
        """
        u = V * step / self.Dc
        if self.of.evolution == "slip":
            faster = np.log(np.maximum(V, TINY) / self.of.V0)
            left = np.exp(-u) * (faster + aged)
            return left - faster, np.exp(-u) - 1 - u * left
        start, scale = np.exp(aged), self.of.V0 * step / self.Dc  # of theta, by Dc / V0
        healed = -scale * np.expm1(-u) / np.maximum(u, TINY)
        healed = np.where(u > EPS, healed, scale)
        theta = healed + start * np.exp(-u)
        return np.log(theta), (scale * np.exp(-u) - healed - start * u * np.exp(-u)) / theta

    def coefficient(self, aged: Array, V: Array) -> tuple[Array, Array, Array]:
        """f (m_t,) at states and rates, and its derivatives by ln V and by the state [-]."""
        with np.errstate(divide="ignore"):
            ln_x = np.log(V) - self.ln_least(aged)
        direct = self.a * np.exp(-np.logaddexp(0.0, -2 * ln_x) / 2)  # a x / sqrt(1 + x^2)
        return self.a * _asinh_exp(ln_x), direct, self.b / self.a * direct

    def ln_least(self, aged: Array) -> Array:
        """ln of 2 V0 exp(-(f0 + b ln(V0 theta / Dc)) / a), below which rates are creep (m_t,)."""
        return np.asarray(np.log(2 * self.of.V0) - (self.of.f0 + self.b * aged) / self.a)

    def rate(self, aged: Array, size: Array, pressure: Array) -> Array:
        """V (m_t,) [m/s] at states, of tractions f pressure + eta V = size [Pa], by Newton's method from above.

        >>> law = RateAndState(f0=0.6, a=0.01, b=0.015, Dc=1.0, V0=1e-6, damping=1e4).placed(np.ones((1, 1)), 1.0, 1.0)
        >>> law.rate(np.zeros(1), law.coefficient(np.zeros(1), np.full(1, 0.1))[0] + 1e3, np.ones(1))
        array([0.1])
        """
        ln_e, eta = self.ln_least(aged), self.of.damping
        size, ap = np.where(pressure > 0, size, 0.0), np.maximum(self.a * pressure, TINY)
        y = size / ap  # V = e sinh(y): the function below is convex, and positive here
        if eta:
            y = np.minimum(y, _asinh_exp(np.log(np.maximum(size, TINY) / eta) - ln_e))
            for _ in range(NEWTON_STEPS):
                V = np.exp(ln_e + _ln_sinh(y))
                off = ap * y + eta * V - size
                if np.all(off <= 8 * EPS * size):
                    break
                y = y - off / (ap + eta * np.hypot(V, np.exp(ln_e)))  # e cosh(y)
        return np.asarray(np.exp(ln_e + _ln_sinh(y)))

    def evolves(self, aged: Array, V: Array) -> Array:
        """d ln(theta) / dt (m_t,) [1/s] at states and rates."""
        if self.of.evolution == "slip":
            return np.asarray(-V / self.Dc * (np.log(np.maximum(V, TINY) / self.of.V0) + aged))
        return np.asarray((self.of.V0 * np.exp(-aged) - V) / self.Dc)

    def begun(
        self, memory: Array, pressure: Array, size: Array, state: Array | str | None, rate: float | None
    ) -> Array:
        require(bool(np.all(pressure > 0)), "pressure", float(pressure.min()), "must be positive at every point")
        f, aged = size / pressure, memory[:, 0]
        if rate is not None:
            f = f - self.of.damping * rate / pressure
            require(bool(np.all(f > 0)), "rate", rate, "radiates more than the traction")
            require(bool(np.all(self.b > 0)), "rate", rate, "is that of the traction alone where b is 0; give state")
            aged = (self.a * (np.log(2 * self.of.V0 / rate) + _ln_sinh(f / self.a)) - self.of.f0) / self.b
        elif isinstance(state, str):
            apart = bool(np.all(self.a != self.b) and np.all(f > 0))
            require(apart, "state", state, "needs a traction, and a that differs from b; give it in seconds")
            faster = (np.log(2.0) + _ln_sinh(f / self.a) - self.of.f0 / self.a) * self.a / (self.a - self.b)
            aged = -faster  # ln(V / V0), radiation left out
        elif state is not None:
            require(bool(np.all(state > 0)), "state", float(state.min()), "must be positive, in seconds")
            aged = np.log(self.of.V0 * state / self.Dc)
        return np.column_stack([aged, self.rate(aged, size, pressure)])

    def resists(self) -> bool:
        return True

    def after(self, memory: Array, slip: Array, step: float) -> Array:
        if step <= 0:
            return memory
        V = slip / step
        return np.column_stack([self.state(memory[:, 0], V, step)[0], V])

    def at(self, memory: Array) -> FrictionLaw:
        f, V = self.coefficient(memory[:, 0], memory[:, 1])[0], memory[:, 1]
        return Sliding(f=f, beside=self.of.damping * V)

    def within(self, memory: Array, step: float) -> FrictionLaw:
        return _InStep(of=self, start=memory[:, 0], step=step) if step > 0 else self.at(memory)

    def rates(self, memory: Array) -> Array | None:
        return memory[:, 1]

    def ages(self, memory: Array) -> Array | None:
        return np.asarray(self.Dc / self.of.V0 * np.exp(memory[:, 0]))

    def of_points(self, points: Ints) -> FrictionLaw:
        return replace(self, a=self.a[points], b=self.b[points], Dc=self.Dc[points])

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return self.of.limit(p, average, normal, time, end)

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return self.of.lines(normal, time, end)


@dataclass(frozen=True, kw_only=True)
class _InStep(FrictionLaw):
    """The law in a step: a trial traction leads to the rate that balances it, state and all."""

    drags: ClassVar[bool] = True
    of: RateAndStateByPoint
    start: Array  # (m_t,) ln(V0 theta / Dc) at the start of the step
    step: float  # [s]

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return self.of.limit(p, average, normal, time, end)

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return self.of.lines(normal, time, end)

    def homogeneous(self, normal: NormalLaw, time: float, end: float) -> bool:
        return False

    def dragged(self, p: Array, average: Sparse, trial: Trial) -> Dragged:
        """Solve f p + eta V + gamma V Δt = |t_hat| for ln V, by Newton's method within a bracket."""
        pressure, eta = np.maximum(average @ p, 0.0), self.of.of.damping
        size = np.maximum(trial.size, TINY)
        viscous = np.where(pressure > 0, eta, 0.0) + trial.gamma * self.step
        y = high = np.log(size / viscous)
        low = np.minimum(high - np.log(2.0), self._slowest(size / 2, pressure))
        for _ in range(NEWTON_STEPS):
            V = np.exp(y)
            f, slope = self._friction(V)
            off = f * pressure + viscous * V - size
            low, high = np.where(off < 0, y, low), np.where(off > 0, y, high)
            if np.all((np.abs(off) <= 4 * EPS * size) | (high - low <= 4 * EPS * np.abs(y))):
                break
            steep = slope * pressure + viscous * V
            newton = y - off / np.where(steep > 0, steep, np.inf)
            y = np.where((newton > low) & (newton < high) & (steep > 0), newton, (low + high) / 2)
        V = np.exp(y)
        f, slope = self._friction(V)
        steep = slope * pressure + np.where(pressure > 0, eta, 0.0) * V  # of the traction by ln V
        whole = steep + trial.gamma * self.step * V
        bound = np.where(pressure > 0, f * pressure + eta * V, 0.0)
        steep = np.where(whole > 0, steep, pressure > 0)  # of a rate below the smallest number: it rests
        whole = np.where(whole > 0, whole, 1.0)
        by_pressure = np.where(pressure > 0, f * trial.gamma * self.step * V / whole, 0.0)
        return Dragged(bound, steep / whole, average.multiply(by_pressure[:, None]).tocsr())

    def _friction(self, V: Array) -> tuple[Array, Array]:
        """f (m_t,) at the end of a step at rates V, and its derivative by ln V."""
        aged, by_rate = self.of.state(self.start, V, self.step)
        f, direct, by_state = self.of.coefficient(aged, V)
        return f, direct + by_state * by_rate

    def _slowest(self, size: Array, pressure: Array) -> Array:
        """ln V at which friction of surfaces that have aged all the step without slip is as large as (m_t,) [Pa]."""
        law, of = self.of, self.of.of
        aged = np.log(np.exp(self.start) + of.V0 * self.step / law.Dc)
        z = size / np.maximum(law.a * pressure, TINY)
        return np.asarray(law.ln_least(aged) + _ln_sinh(z))


def _asinh_exp(z: Array) -> Array:
    """asinh(e^z)."""
    return np.asarray(np.logaddexp(z, np.logaddexp(0.0, 2 * z) / 2))


def _ln_sinh(y: Array) -> Array:
    """ln sinh(y), y >= 0."""
    with np.errstate(divide="ignore"):
        return np.asarray(y + np.log(-np.expm1(-2 * y)) - np.log(2.0))
