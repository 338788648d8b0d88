"""Coulomb friction whose coefficient depends on the slip rate: s = mu(V) p_n, solved with the contact of each step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.expression import FUNCTIONS, RATE, Expression, check_varying
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.laws import mu_table
from stickslip.solvers.laws.friction import CoulombByPoint, Proportional
from stickslip.solvers.laws.law import Dragged, FrictionLaw, NormalLaw, Trial
from stickslip.solvers.laws.mu_table import MuTable
from stickslip.solvers.laws.normal import NEWTON_STEPS

SPEEDS = np.append(0.0, np.logspace(-12, 6, 361))  # at which an expression is looked at [m/s]
EPS, TINY = float(np.finfo(float).eps), float(np.sqrt(np.finfo(float).tiny))
COMPLEX: Mapping[str, Any] = {  # for derivatives, which are imaginary parts
    **FUNCTIONS,
    "abs": lambda x: np.where(x.real < 0, -x, x),
    "min": lambda x, y: np.where(x.real <= y.real, x, y),
    "max": lambda x, y: np.where(x.real >= y.real, x, y),
}


@dataclass(frozen=True, kw_only=True)
class RateDependent(FrictionLaw):
    """mu at the slip rate V = |slip in a step| / length of the step (backward Euler); it must not fall with V.

    Where it falls, a body slides in jumps, and nothing but inertia or radiation says how long they are. An expression
    is sampled, over 18 decades and about each number that is written in it: a dip between the samples is not seen.

    Source: Rabinowicz, J. Appl. Phys. 22 (1951), of mu by the rate; Rice & Ruina, J. Appl. Mech. 50 (1983), of jumps.
    """

    remembers: ClassVar[str] = "slip rate"
    timed: ClassVar[bool] = True
    drags: ClassVar[bool] = True
    mu: Annotated[
        MuTable | str, Key("m/s, -", "coefficient of friction by slip rate, [[V, mu], ...], or an expression in V")
    ]
    damping: Annotated[
        float, Key("Pa s/m", "radiation damping eta: eta V beside friction; G / (2 c_s) of a half-space")
    ] = 0.0
    law: Annotated[Literal["rate_dependent"], Key("-", "the law's name")] = "rate_dependent"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.damping >= 0, "damping", self.damping, "must not be negative, in Pa s/m")
        falls = "mu falls as the slip rate grows, so that bodies slide in jumps without end; let it grow, or stay"
        rest = "is 0 at V = 0, so that nothing holds bodies at rest; give it a small value there, such as 1e-3"
        if not isinstance(self.mu, str):
            mu_table.check(self.mu, "mu")
            require(self.mu[0][1] > 0 or not self.most, "mu", [list(line) for line in self.mu], rest)
            require(not mu_table.steepest_fall(self.mu), "mu", [list(line) for line in self.mu], falls)
            return
        check_varying(self.mu, "mu")
        others = Expression(self.mu).names - {RATE, "pi"}
        require(not others, "mu", f'"{self.mu}"', f"{', '.join(sorted(others))}: mu depends on V alone")
        V = self._sampled()
        mu, slope = self.coefficient(V), self.slope(V)
        smooth = np.isfinite(mu) & np.isfinite(slope) & np.isclose(self._dual(V).real, mu)  # apart beside a pole
        for bad, said in (
            (mu < 0, "is {mu:.3g} at V = {V:.3g}; must not be negative"),
            (~smooth, "has no finite value or no finite slope at V = {V:.3g}"),
        ):
            for k in np.flatnonzero(bad)[:1]:
                raise SceneError(f'mu = "{self.mu}": {said.format(mu=mu[k], V=V[k])}')
        with np.errstate(over="ignore"):
            falling = slope * np.maximum(V, SPEEDS[1]) < -4 * EPS * mu  # by more than rounding makes of a level line
        rises = (mu[1:] >= mu[:-1] * (1 - 4 * EPS)).all() and not falling.any()
        require(bool(rises), "mu", f'"{self.mu}"', falls)
        require(bool(mu[0] > 0 or not mu.any()), "mu", f'"{self.mu}"', rest)

    def coefficient(self, V: Array) -> Array:
        """mu (m,) [-] at slip rates V (m,) [m/s].

        >>> RateDependent(mu="0.3 + 0.1*V").coefficient(np.array([0.0, 2.0]))
        array([0.3, 0.5])
        """
        if not isinstance(self.mu, str):
            return mu_table.read(self.mu, V)
        with np.errstate(all="ignore"):
            found = Expression(self.mu).build({RATE: V}, np.float64, FUNCTIONS)
        return np.broadcast_to(np.asarray(found, float), np.shape(V))

    def slope(self, V: Array) -> Array:
        """d mu / dV (m,) [s/m]; at a corner of a table that of the line before it.

        >>> RateDependent(mu="0.3 + 0.1*V**2").slope(np.array([0.0, 2.0]))
        array([0. , 0.4])
        """
        if not isinstance(self.mu, str):
            return mu_table.slope(self.mu, V)
        with np.errstate(over="ignore"):
            return np.imag(self._dual(V)) / TINY

    def _dual(self, V: Array) -> Array:
        """mu + i TINY d mu / dV (m,) of an expression."""
        assert isinstance(self.mu, str)
        with np.errstate(all="ignore"):
            found = Expression(self.mu).build({RATE: V + 1j * TINY}, np.complex128, COMPLEX)
        return np.broadcast_to(np.asarray(found, complex), np.shape(V))

    def _sampled(self) -> Array:
        """Speeds [m/s] at which an expression is looked at: `SPEEDS`, and as far from each number in it."""
        assert isinstance(self.mu, str)
        about = [number + sign * SPEEDS for number in Expression(self.mu).numbers for sign in (-1, 1)]
        V = np.unique(np.concatenate([SPEEDS, *about]))
        return np.asarray(V[np.clip(V, SPEEDS[0], SPEEDS[-1]) == V])

    @property
    def most(self) -> float:
        """The largest mu [-]; inf: not known."""
        return np.inf if isinstance(self.mu, str) else self.mu[-1][1]

    def resists(self) -> bool:
        return bool((self.coefficient(SPEEDS) > 0).any()) if isinstance(self.mu, str) else self.most > 0

    def after(self, memory: Array, slip: Array, step: float) -> Array:
        return slip / step if step > 0 else np.zeros_like(slip)

    def at(self, memory: Array) -> FrictionLaw:
        """Coulomb's law with the mu of points that slip at rates `memory` (m_t,) [m/s], and what they radiate."""
        mu = self.coefficient(memory)
        if self.damping:
            return Sliding(f=mu, beside=self.damping * memory, k_T=self.k_T)
        return CoulombByPoint(mu=mu, most=np.full(len(memory), self.most), k_T=self.k_T)

    def within(self, memory: Array, step: float) -> FrictionLaw:
        return _InStep(of=self, step=step, k_T=self.k_T) if step > 0 else self.at(np.zeros_like(memory))

    def rate(self, size: Array, pressure: Array, gamma: Array) -> Array:
        """V (m,) [m/s] with mu(V) pressure + gamma V = size, 0 where mu(0) pressure is more; Newton within a bracket.

        Args:
            size: of a trial traction (m,) [Pa].
            pressure: (m,) [Pa].
            gamma: positive (m,) [Pa s/m].

        >>> law = RateDependent(mu=((1.0, 0.5), (2.0, 1.0)))
        >>> law.rate(np.array([0.4, 1.5, 3.0]), np.ones(3), np.ones(3))
        array([0., 1., 2.])
        """
        low, V = np.zeros_like(size), np.maximum(size - self.coefficient(np.zeros_like(size)) * pressure, 0.0) / gamma
        high = V
        for _ in range(NEWTON_STEPS):
            off = self.coefficient(V) * pressure + gamma * V - size
            if np.all((np.abs(off) <= 4 * EPS * size) | (high <= 0)):
                break
            low, high = np.where(off < 0, V, low), np.where(off > 0, V, high)
            newton = V - off / (self.slope(V) * pressure + gamma)
            V = np.where((newton > low) & (newton < high), newton, (low + high) / 2)
        return V


@dataclass(frozen=True, kw_only=True)
class Sliding(FrictionLaw):
    """Traction of points that slide at known rates: friction, and what they radiate."""

    f: Array  # coefficient of friction (m_t,) [-]
    beside: Array  # eta V (m_t,) [Pa]

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        pressure = np.maximum(average @ p, 0.0)
        return np.where(pressure > 0, self.f * pressure + self.beside, 0.0)

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        return average.multiply(np.where(average @ p > 0, self.f, 0.0)[:, None]).tocsr()

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        above = np.inf if self.beside.any() else float(self.f.max(initial=0.0))
        return np.inf, float(self.f.min(initial=np.inf)), above

    def of_points(self, points: Ints) -> FrictionLaw:
        return replace(self, f=self.f[points], beside=self.beside[points])


@dataclass(frozen=True, kw_only=True)
class _InStep(Proportional):
    """The law in a step: its bound is that of points at rest, and slip raises it; no scene asks for it."""

    drags: ClassVar[bool] = True
    of: RateDependent
    step: float  # [s]

    @cached_property
    def coefficient_now(self) -> float:
        return float(self.of.coefficient(np.zeros(1))[0])

    def resists(self) -> bool:
        return self.of.resists()

    def dragged(self, p: Array, average: Sparse, trial: Trial) -> Dragged:
        pressure, soft = np.maximum(average @ p, 0.0), 1 + trial.gamma * self.softness
        eta = np.where(pressure > 0, self.of.damping, 0.0)
        V = self.of.rate(trial.size, soft * pressure, trial.gamma * self.step + soft * eta)
        mu, slope = self.of.coefficient(V), self.of.slope(V) * pressure + eta
        stiff = soft * slope + trial.gamma * self.step
        by_pressure = np.where(pressure > 0, mu * trial.gamma * self.step / stiff, 0.0)
        return Dragged(mu * pressure + eta * V, slope / stiff, average.multiply(by_pressure[:, None]).tocsr())

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return np.inf, self.coefficient_now, np.inf if self.of.damping else self.of.most

    def homogeneous(self, normal: NormalLaw, time: float, end: float) -> bool:
        return False
