"""Coulomb friction whose coefficient depends on the slip of the point so far: s = mu(slip) p_n."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.solvers.laws import mu_table
from stickslip.solvers.laws.friction import CoulombByPoint
from stickslip.solvers.laws.law import FrictionLaw
from stickslip.solvers.laws.mu_table import MuTable


@dataclass(frozen=True, kw_only=True)
class BySlip(FrictionLaw):
    """Base of laws with a mu that depends on the accumulated slip of a point: the length of its path while it touches.

    A point that sticks, turns back or opens keeps what it has slipped: worn surfaces do not heal. A step is solved
    with Coulomb's law and a mu for each point, again and again until mu is that of the slip at the end of the step.

    Source: Ida, J. Geophys. Res. 77 (1972), of slip weakening; Andrews, J. Geophys. Res. 81 (1976), of the path.
    """

    remembers: ClassVar[str] = "slip"

    @property
    def table(self) -> MuTable:
        """mu by slip, [[slip, mu], ...]."""
        raise NotImplementedError

    def resists(self) -> bool:
        return any(mu > 0 for _, mu in self.table)

    def after(self, memory: Array, slip: Array, step: float) -> Array:
        return memory + slip

    def at(self, memory: Array) -> FrictionLaw:
        """Coulomb's law with the mu of points whose path of slip is as long as `memory` (m_t,) [m]."""
        most = mu_table.largest_from(self.table, memory)
        return CoulombByPoint(mu=mu_table.read(self.table, memory), most=most, k_T=self.k_T)

    @property
    def weakening(self) -> float:
        return mu_table.steepest_fall(self.table)


@dataclass(frozen=True, kw_only=True)
class SlipDependent(BySlip):
    """mu from a table of the accumulated slip, linear between its lines and constant beyond them."""

    mu: Annotated[MuTable, Key("m, -", "coefficient of friction by accumulated slip, [[slip, mu], ...]")]
    law: Annotated[Literal["slip_dependent"], Key("-", "the law's name")] = "slip_dependent"

    def __post_init__(self) -> None:
        super().__post_init__()
        mu_table.check(self.mu, "mu")

    @property
    def table(self) -> MuTable:
        return self.mu


@dataclass(frozen=True, kw_only=True)
class StaticKinetic(BySlip):
    """mu falls from mu_s to mu_k, linearly in the accumulated slip, over slip_length."""

    mu_s: Annotated[float, Key("-", "static coefficient of friction, of a point that has not slipped")]
    mu_k: Annotated[float, Key("-", "kinetic coefficient of friction, not above mu_s")]
    slip_length: Annotated[float, Key("m", "accumulated slip after which mu is mu_k")]
    law: Annotated[Literal["static_kinetic"], Key("-", "the law's name")] = "static_kinetic"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.mu_k >= 0, "mu_k", self.mu_k, "must not be negative")
        require(self.mu_s >= self.mu_k, "mu_s", self.mu_s, f"must not be below mu_k = {self.mu_k}")
        require(self.slip_length > 0, "slip_length", self.slip_length, "must be positive, in metres")

    @property
    def table(self) -> MuTable:
        return ((0.0, self.mu_s), (self.slip_length, self.mu_k))
