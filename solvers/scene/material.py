"""Materials of bodies: isotropic with two elastic constants, or orthotropic with nine along axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array
from stickslip.geometry.errors import SceneError, require, require_components
from stickslip.geometry.keys import LIST, ByKeys, Key, Vector
from stickslip.geometry.shape import Model, dimensions

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

    def stress(self, strain: Array, plane_stress: bool) -> Array:
        """Stress (..., 3, 3) [Pa] of an elastic strain (..., 3, 3) [-]; in plane stress strain_zz is not read."""
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
        near = f"must lie above -1 by {LEAST:g}, or shear drowns all else"
        require(self.nu >= LEAST - 1, "nu", self.nu, near)
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

    def stress(self, strain: Array, plane_stress: bool, dilatation: Array | None = None) -> Array:
        """Stress (..., 3, 3) [Pa] of an elastic strain (..., 3, 3) [-].

        Args:
            dilatation: (...,) in place of the trace of the strain, see `MeanDilatation`.

        >>> steel = Material(E=1.0, nu=0.25)
        >>> steel.stress(np.diag([1.0, 0.0, 0.0]), plane_stress=True).round(3).diagonal()
        array([1.067, 0.267, 0.   ])
        """
        strain, first, second = np.array(strain, float), self.lame_lambda, self.lame_mu
        if plane_stress:
            strain[..., 2, 2] = -first / (first + 2 * second) * (strain[..., 0, 0] + strain[..., 1, 1])
        trace = np.trace(strain, axis1=-2, axis2=-1) if dilatation is None else dilatation
        return np.asarray(2 * second * strain + (first * trace)[..., None, None] * np.eye(3))


PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))  # components of a symmetric tensor as a vector of six
DOUBLED = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # shear strains in that vector are 2 eps_ij
PULL = "contraction along {1} by the elongation along {0}, under a pull along {0}"


@dataclass(frozen=True, kw_only=True)
class Orthotropic(Elastic, kind="orthotropic"):
    """Linear elastic, orthotropic: constants along three axes; in 2D axis 3 is z, in axisymmetric models the hoop."""

    E_1: Annotated[float, Key("Pa", "Young's modulus along axis 1")]
    E_2: Annotated[float, Key("Pa", "Young's modulus along axis 2")]
    E_3: Annotated[float, Key("Pa", "Young's modulus along axis 3; in 2D z, in axisymmetric models the hoop")]
    G_12: Annotated[float, Key("Pa", "shear modulus between axes 1 and 2")]
    G_13: Annotated[float | None, Key("Pa", "shear modulus between axes 1 and 3; in 3D only, and needed there")] = None
    G_23: Annotated[float | None, Key("Pa", "shear modulus between axes 2 and 3; in 3D only, and needed there")] = None
    nu_12: Annotated[float, Key("-", PULL.format(1, 2))]
    nu_13: Annotated[float, Key("-", PULL.format(1, 3))]
    nu_23: Annotated[float, Key("-", PULL.format(2, 3))]
    axis_1: Annotated[
        Vector | None, Key("-", "direction of axis 1; absent: x, in axisymmetric models the radius"), LIST
    ] = None
    axis_2: Annotated[
        Vector | None,
        Key("-", "direction of axis 2, of which the part across axis 1 counts; absent: in 2D across axis 1, in 3D y"),
        LIST,
    ] = None
    density: Annotated[float, Key("kg/m³", "mass density, used with [gravity] and [centrifugal]")] = 0.0

    def __post_init__(self) -> None:
        for key in ("E_1", "E_2", "E_3", "G_12", "G_13", "G_23"):
            value = getattr(self, key)
            require(value is None or value > 0, key, value, "must be positive, in pascal")
        require(self.density >= 0, "density", self.density, "must not be negative, in kg/m³")
        for i, j in ((1, 2), (1, 3), (2, 3)):
            key, most = f"nu_{i}{j}", float(np.sqrt(self._E[i - 1] / self._E[j - 1]))
            why = f"must lie between -{most:.4g} and {most:.4g}, sqrt(E_{i} / E_{j}): else a pull would gain work"
            require(abs(getattr(self, key)) < most, key, getattr(self, key), why)
        why = (
            f"with nu_12 = {self.nu_12:g} and nu_23 = {self.nu_23:g} a load would gain work: 1 - nu_12 nu_21 - "
            f"nu_23 nu_32 - nu_13 nu_31 - 2 nu_21 nu_32 nu_13 is {self.determinant:.3g}, and must be at least {LEAST:g}"
        )
        require(self.determinant >= LEAST, "nu_13", self.nu_13, why)
        self.axes  # noqa: B018  refuses those that are none

    def check_model(self, model: Model) -> None:
        for key in ("axis_1", "axis_2"):
            require_components(getattr(self, key), key, dimensions(model))
        for key in ("G_13", "G_23") if model == "3d" else ():
            if getattr(self, key) is None:
                raise SceneError(f"{key}: missing, an orthotropic body in 3D needs it")

    @property
    def _E(self) -> Array:
        return np.array([self.E_1, self.E_2, self.E_3])

    @property
    def determinant(self) -> float:
        """Of the compliance of normal stresses, times E_1 E_2 E_3 [-]; positive where no load gains work."""
        nu_21, nu_31 = self.nu_12 * self.E_2 / self.E_1, self.nu_13 * self.E_3 / self.E_1
        nu_32 = self.nu_23 * self.E_3 / self.E_2
        squares = self.nu_12 * nu_21 + self.nu_23 * nu_32 + self.nu_13 * nu_31
        return float(1 - squares - 2 * nu_21 * nu_32 * self.nu_13)

    @cached_property
    def axes(self) -> Array:
        """Unit vectors of the axes 1, 2, 3 as rows (3, 3), right-handed.

        Raises:
            SceneError: they are zero or parallel.
        """
        flat = 2 in (len(axis) for axis in (self.axis_1, self.axis_2) if axis is not None)
        first = _unit("axis_1", self.axis_1, np.eye(3)[0])
        across = np.array([-first[1], first[0], 0.0])
        second = _unit("axis_2", self.axis_2, across if flat else np.eye(3)[1])
        rest = second - (second @ first) * first
        given = list(self.axis_2) if self.axis_2 is not None else "absent, so y"
        require(
            # sine of the angle below which two axes are parallel
            float(np.linalg.norm(rest)) > CLOSE,
            "axis_2",
            given,
            "is parallel to axis_1; give another direction",
        )
        second = rest / np.linalg.norm(rest)
        return np.array([first, second, np.cross(first, second)])

    @property
    def modulus(self) -> float:
        """Geometric mean of E_1, E_2, E_3."""
        return float(np.prod(self._E ** (1 / 3)))

    @property
    def least_modulus(self) -> float:
        return float(self._E.min())

    @property
    def shear_modulus(self) -> float:
        """Geometric mean of those that are given."""
        given = [G for G in (self.G_12, self.G_13, self.G_23) if G is not None]
        return float(np.prod(np.array(given) ** (1 / len(given))))

    def modulus_along(self, normals: Array) -> float:
        n = np.zeros((len(normals), 3))
        n[:, : normals.shape[1]] = normals
        squares = _six(n[:, :, None] * n[:, None, :])
        return float(1 / np.einsum("mi,ij,mj->m", squares, self.compliance, squares).mean())

    @property
    def near_incompressible(self) -> float:
        """By the smallest eigenvalue of its compliance, each normal stress by the root of its E: 1 - 2 nu of it."""
        scale = np.sqrt(self._E)
        return float(1 - np.linalg.eigvalsh(scale[:, None] * self._normal_compliance * scale)[0]) / 2

    @property
    def constants(self) -> Mapping[str, float]:
        keys = ("E_1", "E_2", "E_3", "G_12", "G_13", "G_23", "nu_12", "nu_13", "nu_23")
        return {key: getattr(self, key) for key in keys if getattr(self, key) is not None}

    @property
    def _normal_compliance(self) -> Array:
        """Strains by stresses along the axes (3, 3) [1/Pa]."""
        E, nu = self._E, np.array([[0, self.nu_12, self.nu_13], [0, 0, self.nu_23], [0, 0, 0]])
        off = -nu / E[:, None]
        return np.asarray(np.diag(1 / E) + off + off.T)

    @cached_property
    def stiffness(self) -> Array:
        """C (6, 6) [Pa] in the scene's axes, from strains eps_xx, yy, zz, 2 xy, 2 yz, 2 xz to stresses in that order.

        Moduli G_13 and G_23 that a scene in 2D does not give take no part there; G_12 stands in their place.
        """
        own = np.zeros((3, 3, 3, 3))
        normal = np.linalg.inv(self._normal_compliance)
        own[np.arange(3)[:, None], np.arange(3)[:, None], np.arange(3), np.arange(3)] = (normal + normal.T) / 2
        for (i, j), G in (((0, 1), self.G_12), ((1, 2), self.G_23), ((0, 2), self.G_13)):
            own[i, j, i, j] = own[j, i, i, j] = own[i, j, j, i] = own[j, i, j, i] = self.G_12 if G is None else G
        Q = self.axes
        turned = np.einsum("ai,bj,ck,dl,abcd->ijkl", Q, Q, Q, Q, own, optimize=True)
        rows, columns = np.array(PAIRS).T
        found = turned[rows[:, None], columns[:, None], rows, columns]
        return np.asarray((found + found.T) / 2)

    @cached_property
    def compliance(self) -> Array:
        """The inverse of `stiffness` (6, 6) [1/Pa]."""
        return np.linalg.inv(self.stiffness)

    def stiffness_in(self, plane_stress: bool) -> Array:
        """`stiffness`; in plane stress with sigma_zz = 0, whatever eps_zz is."""
        C = self.stiffness
        return C - np.outer(C[:, 2], C[2]) / C[2, 2] if plane_stress else C

    def tensor_in(self, plane_stress: bool) -> Array:
        """`stiffness_in` as a tensor C_ijkl (3, 3, 3, 3) [Pa]."""
        C, place = self.stiffness_in(plane_stress), np.empty((3, 3), int)
        for k, (i, j) in enumerate(PAIRS):
            place[i, j] = place[j, i] = k
        return np.asarray(C[place[:, :, None, None], place])

    def stress(self, strain: Array, plane_stress: bool) -> Array:
        """See `Elastic.stress`.

        >>> wood = Orthotropic(E_1=10.0, E_2=2.0, E_3=2.0, G_12=1.0, nu_12=0.0, nu_13=0.0, nu_23=0.0, axis_1=(0.0, 1.0))
        >>> wood.stress(np.diag([1.0, 1.0, 0.0]), plane_stress=True).diagonal().round(12) + 0.0
        array([ 2., 10.,  0.])
        """
        six = (_six(np.asarray(strain, float)) * DOUBLED) @ self.stiffness_in(plane_stress)
        found = np.empty((*six.shape[:-1], 3, 3))
        for k, (i, j) in enumerate(PAIRS):
            found[..., i, j] = found[..., j, i] = six[..., k]
        return found


def _six(tensor: Array) -> Array:
    """The components `PAIRS` (..., 6) of symmetric tensors (..., 3, 3)."""
    return np.stack([tensor[..., i, j] for i, j in PAIRS], axis=-1)


def _unit(key: str, given: Vector | None, default: Array) -> Array:
    """Unit vector (3,) of an axis.

    Raises:
        SceneError: it is zero, or has not two or three components.
    """
    if given is None:
        return default
    require(len(given) in (2, 3), key, list(given), "expected a direction of 2 components, of 3 in 3D")
    vector = np.zeros(3)
    vector[: len(given)] = given
    largest = float(np.abs(vector).max())
    require(largest > 0, key, list(given), "must be a direction, not zero")
    vector = vector / largest
    return vector / np.linalg.norm(vector)
