"""The material of a body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key, Noun


@dataclass(frozen=True, kw_only=True)
class Material(Noun):
    """Linear elastic, isotropic."""

    E: Annotated[float, Key("Pa", "Young's modulus")]
    nu: Annotated[float, Key("-", "Poisson's ratio")]
    density: Annotated[float, Key("kg/m³", "mass density, used with [gravity] and [centrifugal]")] = 0.0

    def __post_init__(self) -> None:
        require(self.E > 0, "E", self.E, "must be positive, in pascal")
        require(-1 < self.nu < 0.5, "nu", self.nu, "must lie between -1 and 0.5; for rubber try 0.49")
        require(self.density >= 0, "density", self.density, "must not be negative, in kg/m³")

    @property
    def lame_lambda(self) -> float:
        """Lamé's first parameter [Pa]."""
        return self.E * self.nu / ((1 + self.nu) * (1 - 2 * self.nu))

    @property
    def lame_mu(self) -> float:
        """Shear modulus [Pa]."""
        return self.E / (2 * (1 + self.nu))
