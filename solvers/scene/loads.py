"""Loads, and boundary conditions: supports, which prescribe displacements, and springs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from stickslip.geometry.amplitude import Amplitude
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError, require, require_components
from stickslip.geometry.expression import Varying, check_varying
from stickslip.geometry.keys import LIST, TABLE, Key, Noun, Vector
from stickslip.geometry.shape import Model, dimensions
from stickslip.solvers.scene.timeline import Place

End = str | Vector  # of a link: a side, as body.side, or a point [m], at which a mesh vertex lies


@dataclass(frozen=True, kw_only=True)
class Load(Noun):
    """Exactly one of traction, pressure, force."""

    boundary: Annotated[str, Key("-", "side, as body.side")]
    traction: Annotated[tuple[Varying, ...] | None, Key("Pa", "force per area, by component"), LIST] = None
    pressure: Annotated[
        Varying | None, Key("Pa", 'positive pushes inward; of water up to y = 2: "9810*max(2-y, 0)"')
    ] = None
    force: Annotated[
        tuple[Amplitude, ...] | None, Key("N", "resultant, spread evenly; per metre in plane models"), LIST
    ] = None

    def __post_init__(self) -> None:
        given = [key for key in ("traction", "pressure", "force") if getattr(self, key) is not None]
        if len(given) != 1:
            raise SceneError(
                f"{' / '.join(given) or 'traction / pressure / force'}: exactly one of the three is needed"
            )
        for amplitude in self.amplitudes().values():
            check_varying(amplitude, given[0])

    @property
    def vector(self) -> tuple[Varying, ...] | None:
        """The traction or the force by component; None: a pressure."""
        return self.traction if self.traction is not None else self.force

    def amplitudes(self) -> dict[tuple[str, str], Varying]:
        """Its values in time by key and component; a pressure has none."""
        if self.pressure is not None:
            return {("pressure", ""): self.pressure}
        key = "traction" if self.traction is not None else "force"
        return {(key, axis): value for axis, value in zip("xyz", self.vector or (), strict=False)}

    def check_model(self, model: Model) -> None:
        """Refuse components that the model does not have, or lacks."""
        key, found = "traction" if self.traction is not None else "force", list(self.vector or ())
        require_components(self.vector, key, dimensions(model))
        radial = model == "axisymmetric" and self.force is not None and self.force[0] != 0
        require(not radial, key, found, "a radial force has no resultant; use traction or pressure")


Direction = Literal["x", "y", "z", "normal"]


@dataclass(frozen=True, kw_only=True)
class Support(Noun):
    """Prescribed displacement; components that are not named stay free."""

    displacement: Annotated[Mapping[Direction, Varying], Key("m", "by component x, y, z or normal (outward)"), TABLE]
    boundary: Annotated[str | None, Key("-", "side, as body.side")] = None
    point: Annotated[Vector | None, Key("m", "a mesh vertex lies here; instead of boundary")] = None

    def __post_init__(self) -> None:
        if (self.boundary is None) == (self.point is None):
            wrong = "missing, a support needs one" if self.boundary is None else "a support needs exactly one"
            raise SceneError(f"boundary / point: {wrong} of the two")
        require(len(self.displacement) > 0, "displacement", "{}", "name at least one of x, y, z, normal")
        for axis, amplitude in self.displacement.items():
            check_varying(amplitude, f"displacement.{axis}")
        if self.point is not None:
            require(
                "normal" not in self.displacement, "displacement.normal", "given", "a point has no normal; use x, y, z"
            )

    def amplitudes(self) -> dict[tuple[str, str], Varying]:
        """Its values in time by key and component."""
        return {("displacement", axis): value for axis, value in self.displacement.items()}

    def check_model(self, model: Model) -> None:
        """Refuse components that the model does not have, or lacks."""
        require_components(self.point, "point", dimensions(model))
        if model != "3d" and "z" in self.displacement:
            raise SceneError("displacement.z: a plane model has x and y only")


@dataclass(frozen=True, kw_only=True)
class Springs:
    """Linear springs per area between a side and the ground, that an effect declares: they hold bodies."""

    boundary: str  # side, as body.side
    normal: float  # stiffness along the normal [Pa/m]
    tangential: float  # stiffness along the side [Pa/m]
    key: str  # of the scene

    def directions(self, normals: Array) -> list[Array]:
        """Directions (m, d) in which they resist motion, of normals (m, d); together they span all of them."""
        axes = np.eye(normals.shape[1])
        across = [axis - (normals @ axis)[:, None] * normals for axis in axes] if self.tangential else []
        return across + [normals] * (self.normal > 0)


@dataclass(frozen=True, kw_only=True)
class Link:
    """Springs, r of them, between two places or a place and the ground, that an effect declares.

    A place is a point, or the mean displacement of a side: the force is then spread evenly over the side.
    """

    ends: Mapping[str, tuple[End, float]]  # by key, each with the sign with which its displacement counts
    directions: Array  # (r, d) unit vectors
    stiffness: Array  # (r,) [N/m]; per metre in plane models
    rests: Mapping[Place, Array]  # by its value in time, elongation (r,) at which they pull nothing, at value 1 [m]
    tension: Place | None = None  # [N] given, of one spring; the value of its one rest is then found
    held_from: float = np.inf  # [s], from there on that value is kept
    slack: Place | None = None  # among the rests of one spring that acts in one way: its value is found
    gap: float = 0.0  # [m] before it acts
    table: str
    name: str

    @property
    def key(self) -> str:
        """Of the scene."""
        return f"{self.table}.{self.name}"


@dataclass(frozen=True, kw_only=True)
class Coupling:
    """A point coupled to a side, that an effect declares; components of its motion are numbered as `rigid_fields`."""

    boundary: str  # side, as body.side
    point: Vector  # [m]
    rigid: bool  # whether the side moves as a rigid body
    prescribed: Mapping[int, Place]  # value in time by component [m, rad]
    loads: Mapping[int, Place]  # likewise force [N] and moment [N m]
    key: str  # of the scene
