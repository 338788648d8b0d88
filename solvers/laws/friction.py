"""Friction laws: the tangential traction is bounded, and opposes slip.

Coulomb's law and what is proportional to the pressure like it; bounds that are given, capped or raised; a bound by the
penetration.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check, value_at
from stickslip.geometry.arrays import Array, Bools, Ints
from stickslip.geometry.errors import SceneError, prefixed, require
from stickslip.geometry.expression import Varying
from stickslip.geometry.field import Field, check_field, in_time, number, values
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw, touched, touching


@dataclass(frozen=True, kw_only=True)
class Proportional(FrictionLaw):
    """Base of laws with s = mu p_n, mu one number or one by point."""

    @property
    def coefficient_now(self) -> Array | float:
        """mu [-] or (m_t,)."""
        raise NotImplementedError

    def resists(self) -> bool:
        return bool(np.any(np.asarray(self.coefficient_now) > 0))

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return np.asarray(self.coefficient_now * np.maximum(average @ p, 0.0))

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        slope = average.copy()
        slope.data *= np.repeat(np.where(average @ p > 0, self.coefficient_now, 0.0), np.diff(average.indptr))
        return slope

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        mu = self.coefficient_now
        return np.inf, float(np.min(mu, initial=np.inf)), float(np.max(mu, initial=0.0))


@dataclass(frozen=True, kw_only=True)
class CappedCoulomb(FrictionLaw):
    """s = min(mu p_n, s_max): under high pressure the softer body shears before the surfaces slip on each other.

    Source: Orowan, Proc. Inst. Mech. Eng. 150 (1943), rolling: s_max is the yield stress in shear.
    """

    mu: Annotated[float, Key("-", "coefficient of friction")]
    s_max: Annotated[float, Key("Pa", "largest tangential traction, at any pressure")]
    law: Annotated[Literal["capped_coulomb"], Key("-", "the law's name")] = "capped_coulomb"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.mu >= 0, "mu", self.mu, "must not be negative")
        require(self.s_max > 0, "s_max", self.s_max, "must be positive, in pascal; without friction set mu = 0")

    def resists(self) -> bool:
        return self.mu > 0

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        """min(mu p_n, s_max), (m_t,) [Pa].

        >>> from scipy import sparse
        >>> from stickslip.solvers.laws.normal import Unilateral
        >>> law, one = CappedCoulomb(mu=0.5, s_max=2.0), sparse.identity(3, format="csr")
        >>> law.limit(np.array([-1.0, 2.0, 10.0]), one, Unilateral(), 1.0, 1.0)
        array([0., 1., 2.])
        """
        return np.asarray(np.clip(self.mu * (average @ p), 0.0, self.s_max))

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        uncapped = self.mu * (average @ p)
        slope = np.where((uncapped > 0) & (uncapped < self.s_max), self.mu, 0.0)
        return average.multiply(slope[:, None]).tocsr()

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return self.s_max, self.mu, self.mu


@dataclass(frozen=True, kw_only=True)
class Cohesion(FrictionLaw):
    """s = a + mu p_n where p_n > 0, or everywhere if the normal law is bilateral; a does not hold surfaces together.

    Source: Coulomb, Mém. Math. Phys. Acad. Roy. Sci. 7 (1776), of masonry and soil: the law of Mohr and Coulomb.
    """

    continuous: ClassVar = "coulomb"
    a: Annotated[float, Key("Pa", "cohesion: the bound at no pressure")]
    mu: Annotated[float, Key("-", "coefficient of friction")]
    law: Annotated[Literal["cohesion"], Key("-", "the law's name")] = "cohesion"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.a >= 0, "a", self.a, "must not be negative, in pascal")
        require(self.mu >= 0, "mu", self.mu, "must not be negative")

    def resists(self) -> bool:
        return self.a > 0 or self.mu > 0

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        """a + mu p_n (m_t,) [Pa] where the surfaces press.

        >>> from scipy import sparse
        >>> from stickslip.solvers.laws.normal import Unilateral
        >>> law, one = Cohesion(a=2.0, mu=0.5), sparse.identity(3, format="csr")
        >>> law.limit(np.array([-1.0, 0.0, 4.0]), one, Unilateral(), 1.0, 1.0)
        array([0., 0., 4.])
        """
        return np.asarray(self.a * touched(p, average, normal) + self.mu * np.maximum(average @ p, 0.0))

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        return average.multiply(np.where(average @ p > 0, self.mu, 0.0)[:, None]).tocsr()

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return np.inf, self.mu, self.mu

    @property
    def at_no_pressure(self) -> float:
        return self.a


@dataclass(frozen=True, kw_only=True)
class Coulomb(Proportional):
    """Coulomb's law, s = mu p_n."""

    mu: Annotated[
        Field, Key("-", "coefficient of friction: a number, in time, an expression, or a map of values over places")
    ]
    law: Annotated[Literal["coulomb"], Key("-", "the law's name")] = "coulomb"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_field(self.mu, "mu")
        require(not isinstance(self.mu, float | int) or self.mu >= 0, "mu", self.mu, "must not be negative")

    @property
    def coefficient_now(self) -> float:
        return number(self.mu)

    def resists(self) -> bool:
        return not isinstance(self.mu, float | int) or self.mu > 0

    @property
    def changes(self) -> bool:
        return bool(self.amplitudes())

    def amplitudes(self) -> Mapping[tuple[str, ...], Varying]:
        return in_time(self.mu, "mu")

    def placed(self, points: Array, time: float, end: float) -> FrictionLaw:
        if isinstance(self.mu, float | int):
            return self
        with prefixed("friction"):
            mu = np.broadcast_to(values(self.mu, "mu", points, time, end), len(points))
            return CoulombByPoint(mu=mu, k_T=self.k_T)


@dataclass(frozen=True, kw_only=True)
class CoulombByPoint(Proportional):
    """Coulomb's law, s = mu p_n with mu by point: that of a field, of slip, or of a rate."""

    mu: Array  # (m_t,) [-]
    most: Array | None = None  # (m_t,) that mu can become by slip [-]; None: it is constant

    def __post_init__(self) -> None:
        super().__post_init__()
        least = float(self.mu.min(initial=0.0))
        require(least >= 0, "mu", least, "must not be negative")

    @property
    def coefficient_now(self) -> Array:
        return self.mu

    def of_point(self, point: int) -> FrictionLaw:
        return Coulomb(mu=float(self.mu[point]), k_T=self.k_T)

    def of_points(self, points: Ints) -> FrictionLaw:
        return replace(self, mu=self.mu[points], most=None if self.most is None else self.most[points])

    def homogeneous(self, normal: NormalLaw, time: float, end: float) -> bool:
        return True

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        cap, below, above = super().lines(normal, time, end)
        return cap, below, above if self.most is None else float(self.most.max(initial=0.0))


@dataclass(frozen=True, kw_only=True)
class Tresca(FrictionLaw):
    """Tresca's law: s is given, where p_n > 0, or everywhere if the normal law is bilateral."""

    continuous: ClassVar = "capped_coulomb"
    bound: Annotated[Amplitude, Key("Pa", "bound of the tangential traction, in time")]
    law: Annotated[Literal["tresca"], Key("-", "the law's name")] = "tresca"

    def __post_init__(self) -> None:
        super().__post_init__()
        check(self.bound, "bound")
        values = [self.bound] if isinstance(self.bound, float | int) else [v for _, v in self.bound]
        require(min(values) >= 0, "bound", min(values), "must not be negative, in pascal")

    def resists(self) -> bool:
        return any(value for _, value in ([(0.0, self.bound)] if isinstance(self.bound, float | int) else self.bound))

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return value_at(self.bound, time, end) * touched(p, average, normal)

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return value_at(self.bound, time, end), np.inf, np.inf

    def amplitudes(self) -> Mapping[tuple[str, ...], Varying]:
        return {("bound",): self.bound}


@dataclass(frozen=True, kw_only=True)
class Stick(FrictionLaw):
    """No slip where the surfaces touch: the bound is infinite.

    With a growing coefficient of Coulomb's law a point that lifts can keep its traction while its pressure goes to
    zero, as 1 / mu: with unilateral contact there is no solution then.
    """

    continuous: ClassVar = "coulomb"
    law: Annotated[Literal["stick"], Key("-", "the law's name")] = "stick"

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return np.where(touching(p, average, normal), np.inf, 0.0)

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return np.inf, np.inf, np.inf


@dataclass(frozen=True, kw_only=True)
class OrthotropicCoulomb(Proportional):
    """(t_1 / mu_1)^2 + (t_2 / mu_2)^2 <= p_n^2, and slip is normal to the ellipse: it dissipates as much as it can.

    Measured along e_1 mu_1 / mu and e_2 mu_2 / mu, mu the larger one, the ellipse is Coulomb's disc of radius mu p_n,
    and the work t . slip stays what it is: all methods solve it as they solve Coulomb's law.

    Source: Michalowski & Mróz, Arch. Mech. 30 (1978); Hjiaj et al., Int. J. Numer. Meth. Engng 60 (2004).
    """

    orthotropic: ClassVar[bool] = True
    mu_1: Annotated[float, Key("-", "coefficient of friction along `axis`")]
    mu_2: Annotated[float, Key("-", "coefficient of friction across it")]
    axis: Annotated[tuple[float, ...], Key("-", "direction of mu_1, projected onto the tangent plane of each point")]
    law: Annotated[Literal["orthotropic_coulomb"], Key("-", "the law's name")] = "orthotropic_coulomb"

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("mu_1", "mu_2"):
            require(getattr(self, key) > 0, key, getattr(self, key), "must be positive")
        require(self.k_T is None, "k_T", self.k_T, "orthotropic friction is rigid before slip; leave it out")
        require(len(self.axis) == 3 and any(self.axis), "axis", list(self.axis), "expected a direction [x, y, z]")

    def check_model(self, model: str) -> None:
        if model != "3d":
            raise SceneError(f'law = "{self.law}": a plane model has one tangential direction; use coulomb')

    def directions(self, tangents: Array, free: Bools) -> Array:
        e = np.array(self.axis) / np.linalg.norm(self.axis)
        seen = np.einsum("mcd,d->mc", tangents, e)  # of the axis in the tangent plane
        size = np.linalg.norm(seen, axis=1)
        # sine of the angle between `axis` and a normal, below which it gives no direction of the tangent plane
        found = bool(np.all(size > 1e-3))
        require(found, "axis", list(self.axis), "is normal to the side at some point, and gives no direction there")
        c, s = (seen / size[:, None]).T
        turn = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)  # (m, 2, 2): axis first
        scale = np.array([self.mu_1, self.mu_2]) / self.coefficient_now
        turned = scale[:, None] * (turn @ tangents)
        # a support leaves one direction: there the ellipse is cut along it
        cut = 1 / np.linalg.norm(np.swapaxes(turn, 1, 2) / scale, axis=2)
        return np.where(free.all(axis=1)[:, None, None], turned, cut[:, :, None] * tangents)

    @property
    def coefficient_now(self) -> float:
        return max(self.mu_1, self.mu_2)
