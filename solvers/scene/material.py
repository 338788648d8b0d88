"""The material of a body: what the program asks of any of them, and the isotropic one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import ByKeys, Key
from stickslip.geometry.shape import Model

NEARLY = 0.49  # Poisson's ratio from which on linear elements lock
LEAST = 1e-5  # of 1 - 2 nu; displacements under given loads are off by as large a part, or less


class Elastic(ByKeys):
    """Base of the linear elastic materials; the keys of a body's table choose the kind."""

    density: float  # [kg/m³]

    @property
    def modulus(self) -> float:
        """A Young's modulus for scales [Pa]."""
        raise NotImplementedError

    @property
    def least_modulus(self) -> float:
        """Young's modulus in the softest direction [Pa]."""
        return self.modulus

    @property
    def shear_modulus(self) -> float:
        """A shear modulus for scales [Pa]."""
        raise NotImplementedError

    def modulus_along(self, normals: Array) -> float:
        """Young's modulus along directions (m, d), by the mean of its inverse [Pa]."""
        return self.modulus

    @property
    def near_incompressible(self) -> float:
        """Poisson's ratio [-] of the isotropic body that is as nearly incompressible, see `NEARLY`."""
        raise NotImplementedError

    @property
    def averages(self) -> bool:
        """Whether its dilatation is averaged, see `MeanDilatation`; in plane stress nothing is."""
        return False

    @property
    def constants(self) -> Mapping[str, float]:
        """The constants that expressions may name, by their keys."""
        raise NotImplementedError

    def check_model(self, model: Model) -> None:
        """Refuse what the model cannot have.

        Raises:
            SceneError: key, found value, what is expected.
        """


@dataclass(frozen=True, kw_only=True)
class Material(Elastic, kind="isotropic"):
    """Linear elastic, isotropic."""

    E: Annotated[float, Key("Pa", "Young's modulus")]
    nu: Annotated[float, Key("-", "Poisson's ratio")]
    formulation: Annotated[
        Literal["auto", "displacement", "mean-dilatation"],
        Key("-", "mean-dilatation: volumes change as a mean around each node, no locking; auto: so from nu = 0.49 on"),
    ] = "auto"
    density: Annotated[float, Key("kg/m³", "mass density, used with [gravity] and [centrifugal]")] = 0.0

    def __post_init__(self) -> None:
        require(self.E > 0, "E", self.E, "must be positive, in pascal")
        require(-1 < self.nu <= 0.5, "nu", self.nu, "must lie above -1, and not above 0.5")
        locks = self.nu == 0.5 and self.formulation == "displacement"
        require(not locks, "nu", self.nu, 'must lie below 0.5 with formulation = "displacement"')
        require(self.density >= 0, "density", self.density, "must not be negative, in kg/m³")

    @property
    def modulus(self) -> float:
        return self.E

    @property
    def shear_modulus(self) -> float:
        return self.lame_mu

    @property
    def near_incompressible(self) -> float:
        return self.nu

    @property
    def averages(self) -> bool:
        return self.formulation == "mean-dilatation" or (self.formulation == "auto" and self.nu >= NEARLY)

    @property
    def constants(self) -> Mapping[str, float]:
        return {"E": self.E, "nu": self.nu}

    @property
    def give(self) -> float:
        """1 - 2 nu [-], at least `LEAST`: so much an incompressible body yields after all."""
        return max(1 - 2 * self.nu, LEAST)

    @property
    def lame_lambda(self) -> float:
        """Lamé's first parameter [Pa]."""
        return self.E * self.nu / ((1 + self.nu) * self.give)

    @property
    def lame_mu(self) -> float:
        """Shear modulus [Pa]."""
        return self.E / (2 * (1 + self.nu))
