"""Coulomb friction whose coefficient depends on the pressure: s = mu(p_n) p_n, mu from a table."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np

from stickslip.geometry.arrays import EXACT, Array
from stickslip.geometry.errors import SceneError
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.laws import mu_table
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw
from stickslip.solvers.laws.mu_table import MuTable


@dataclass(frozen=True, kw_only=True)
class PressureDependent(FrictionLaw):
    """s = mu(p_n) p_n, mu linear between the lines of the table and constant beyond them; s must not fall with p_n.

    Source: Bowden & Tabor, The friction and lubrication of solids (1950): mu of polymers and coatings falls as the
    true area of contact saturates.
    """

    mu: Annotated[MuTable, Key("Pa, -", "coefficient of friction by pressure, [[p_n, mu], ...]")]
    law: Annotated[Literal["pressure_dependent"], Key("-", "the law's name")] = "pressure_dependent"

    def __post_init__(self) -> None:
        super().__post_init__()
        mu_table.check(self.mu, "mu")
        for (p_0, mu_0), (p_1, mu_1) in pairwise(self.mu):
            if (
                mu_1 + p_1 * (mu_1 - mu_0) / (p_1 - p_0) < -EXACT * mu_0  # of mu
            ):  # ds/dp at the end of the piece, where it is least
                raise SceneError(
                    f"mu = {[[p_0, mu_0], [p_1, mu_1]]}: mu falls so fast that the bound mu p_n falls as the pressure "
                    "grows; set more lines, or capped_coulomb"
                )

    def resists(self) -> bool:
        return any(mu > 0 for _, mu in self.mu)

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        """mu(p_n) p_n (m_t,) [Pa].

        >>> from scipy import sparse
        >>> from stickslip.solvers.laws.normal import Unilateral
        >>> law, one = PressureDependent(mu=((0.0, 0.5), (4.0, 0.3))), sparse.identity(3, format="csr")
        >>> law.limit(np.array([-1.0, 2.0, 10.0]), one, Unilateral(), 1.0, 1.0)
        array([0. , 0.8, 3. ])
        """
        pressure = np.maximum(average @ p, 0.0)
        return np.asarray(mu_table.read(self.mu, pressure) * pressure)

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        pressure = average @ p
        slope = mu_table.read(self.mu, pressure) + mu_table.slope(self.mu, pressure) * pressure
        return average.multiply(np.where(pressure > 0, slope, 0.0)[:, None]).tocsr()

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        mu = [each for _, each in self.mu]
        return np.inf, min(mu), max(mu)
