"""Coulomb friction with two coefficients, along two directions of the tangent plane: an elliptic cone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import Array, Bools
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw

ALONG = 1e-3  # sine of the angle between `axis` and a normal, below which it gives no direction of the tangent plane


@dataclass(frozen=True, kw_only=True)
class OrthotropicCoulomb(FrictionLaw):
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
        found = bool(np.all(size > ALONG))
        require(found, "axis", list(self.axis), "is normal to the side at some point, and gives no direction there")
        c, s = (seen / size[:, None]).T
        turn = np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)  # (m, 2, 2): axis first
        scale = np.array([self.mu_1, self.mu_2]) / self._mu
        turned = scale[:, None] * (turn @ tangents)
        # a support leaves one direction: there the ellipse is cut along it
        cut = 1 / np.linalg.norm(np.swapaxes(turn, 1, 2) / scale, axis=2)
        return np.where(free.all(axis=1)[:, None, None], turned, cut[:, :, None] * tangents)

    @property
    def _mu(self) -> float:
        return max(self.mu_1, self.mu_2)

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return np.asarray(self._mu * np.maximum(average @ p, 0.0))

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        return average.multiply(np.where(average @ p > 0, self._mu, 0.0)[:, None]).tocsr()

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return np.inf, self._mu, self._mu
