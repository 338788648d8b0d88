"""The resolved problem: data that follow from a scene, computed once. Rooms below the simulation read only this.

It is made in two steps: `Setup` follows from the scene's names alone; `Problem` has the rigid modes of the setup too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.obstacles import Obstacle
from stickslip.geometry.shape import SKIN, Model, Request, Shape
from stickslip.geometry.units import SI, Units
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.scene.loads import Coupling, Link, Load, Springs, Support
from stickslip.solvers.scene.material import Elastic, Material, Orthotropic
from stickslip.solvers.scene.settings import Probe, Solver
from stickslip.solvers.scene.timeline import Timeline


@dataclass(frozen=True, kw_only=True)
class PlanRow:
    """One line of `stickslip plan`: an effect, whether it is active, and the scene key that switches it on."""

    effect: str
    on: bool
    because: str
    adds: str = ""  # what it adds to the problem, and what that costs


BESIDE = ", in three sectors"  # behind the name of a side


@dataclass(frozen=True, kw_only=True)
class Pair:
    """One contact: a slave side, and the rigid obstacle or the master side of another body that it may touch."""

    name: str
    contact: Contact
    slave: str  # side, as body.side
    master: str | None  # side of another body; None: contact with a rigid obstacle
    obstacle: str | None  # name of the rigid obstacle; None: contact with another body
    found: bool = False  # whether it is one of a contact between bodies, so that it may touch nowhere
    cyclic: bool = False  # whether bodies are sectors of cyclic ones

    @property
    def skins(self) -> bool:
        """Whether all of two bodies may touch, so that what is near is looked for again as they move."""
        both = self.slave, self.master or ""
        return all(side.endswith(SKIN) for side in both) and self.slave != self.master

    @property
    def surfaces(self) -> tuple[str, str | None]:
        """Names of the surfaces that touch: the sides, or of one that touches itself its halves.

        What sectors of cyclic bodies touch is also in the sectors beside them.
        """
        halves = f"{self.slave}, one half", f"{self.slave}, other half"
        one, two = halves if self.slave == self.master else (self.slave, self.master)
        return one, f"{two}{BESIDE}" if two and self.cyclic else two

    @property
    def bodies(self) -> tuple[str, ...]:
        """The body of the slave, and that of the master if there is one."""
        return tuple(side.split(".")[0] for side in (self.slave, self.master) if side is not None)


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Sides, contact pairs, springs, values in time and active effects of a scene; its rigid modes are not known."""

    model: Model
    shape: Shape
    request: Request  # sides and periodic pairs that the mesh must offer
    bodies: Mapping[str, Elastic]
    obstacles: Mapping[str, Obstacle]
    pairs: Mapping[str, Pair]
    supports: Mapping[str, Support]
    loads: Mapping[str, Load]
    springs: tuple[Springs, ...]  # to the ground, of effects
    links: tuple[Link, ...]  # springs between places, of effects
    couplings: tuple[Coupling, ...]  # points coupled to sides, of effects
    probes: Mapping[str, Probe]
    tables: Mapping[str, Any]  # of the active effects, by the effect's name: a frozen table, or several by name
    plan: tuple[PlanRow, ...]
    timeline: Timeline
    solver: Solver
    labels: Units = SI  # of all numbers, in what is said of them
    sums: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # contacts of several partners, and their pairs

    @property
    def dim(self) -> int:
        """Number of space dimensions, 2 or 3."""
        return self.request.dim

    @property
    def axisymmetric(self) -> bool:
        """Whether x is the radius about the axis of symmetry."""
        return self.model == "axisymmetric"

    def shares(self, name: str) -> bool:
        """Whether the slave side of a pair is that of another one too, so that a part of it is the pair's."""
        return sum(pair.slave == self.pairs[name].slave for pair in self.pairs.values()) > 1

    @property
    def extent(self) -> float:
        """Largest size of all bodies together along an axis [m]."""
        return float(np.ptp(self.shape.box(self.dim), axis=0).max())

    def sample(self, side: str) -> tuple[Array, Array]:
        """Sample points (k, d) [m] of a side (named body.side) and the unit outward normals there (k, d)."""
        return self.shape.sample(side, self.dim)

    @property
    def isotropic(self) -> Mapping[str, Material]:
        """Bodies with two elastic constants."""
        return {name: material for name, material in self.bodies.items() if isinstance(material, Material)}

    @property
    def orthotropic(self) -> Mapping[str, Orthotropic]:
        """Bodies with nine elastic constants along axes."""
        return {name: material for name, material in self.bodies.items() if isinstance(material, Orthotropic)}

    @property
    def averaged(self) -> tuple[str, ...]:
        """Bodies whose dilatation is averaged; none in plane stress, where the thickness changes freely."""
        found = (name for name, material in self.bodies.items() if material.averages)
        return tuple(found) if self.model != "plane stress" else ()

    @property
    def softest(self) -> float:
        """Smallest Young's modulus of all bodies [Pa]: the scale of tractions for a given strain."""
        return min(material.least_modulus for material in self.bodies.values())

    @property
    def driven(self) -> tuple[tuple[str, str], ...]:
        """Obstacle and axis (x, y, z) of each obstacle motion (o,) that a force drives: an unknown."""
        return tuple((name, axis) for name, obstacle in self.obstacles.items() for axis in obstacle.driven())


@dataclass(frozen=True, kw_only=True)
class Problem(Setup):
    """All data of a scene that assembly, methods and results need."""

    rigid_modes: Array  # (k, r) orthonormal basis of the rigid modes that no support or spring resists
    bedded: bool  # whether supports and compliant pressures together resist all rigid modes
    unheld: str  # in words, a rigid mode that no support, contact or friction resists; empty if all are resisted
