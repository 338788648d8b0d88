"""A surface that may touch an obstacle, and the laws that hold there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

from stickslip.geometry.errors import SceneError, prefixed, require
from stickslip.geometry.expression import Varying
from stickslip.geometry.field import Field, check_field, in_time
from stickslip.geometry.keys import Key, Noun
from stickslip.geometry.shape import Model
from stickslip.solvers.laws import FrictionLaw, NormalLaw
from stickslip.solvers.laws.friction import Stick
from stickslip.solvers.laws.normal import Unilateral


def table_of(name: str) -> str:
    """Name of the table that a contact comes from: that of one among several partners has the partner's behind it.

    >>> table_of("rest.left"), table_of("base")
    ('rest', 'base')
    """
    return name.partition(".")[0]


@dataclass(frozen=True, kw_only=True)
class Contact(Noun):
    """Contact of a slave surface with a rigid obstacle or another body."""

    surface: Annotated[str, Key("-", "side of a body, as body.side: the slave, see `slave`; resultants act on it")]
    against: Annotated[
        str | tuple[str, ...],
        Key(
            "-",
            "obstacle, or a side, of the same body too, or the same; of several each part has the one it reaches first",
        ),
    ]
    normal: Annotated[NormalLaw, Key("-", "normal law")] = Unilateral()
    friction: Annotated[FrictionLaw | None, Key("-", "friction law; absent: none")] = None

    slave: Annotated[
        Literal["auto", "surface", "against"],
        Key("-", "side that carries the tractions; auto: `surface`, or `against` if its body is 10 times softer"),
    ] = "auto"
    gap_offset: Annotated[
        Field,
        Key("m", "added to the geometric gap; negative: interference; in time, an expression, or a map of heights"),
    ] = 0.0

    gap: Annotated[
        float | None,
        Key(
            "m", "everywhere, instead of that of the meshes, whose facets overlap in a fit of cylinders; between bodies"
        ),
    ] = None

    operator: Annotated[
        Literal["mortar", "node-to-segment", "node-to-face"] | None, Key("-", "between bodies; absent: mortar")
    ] = None
    search_distance: Annotated[
        float | None, Key("m", "largest distance at which sides are paired; absent: a fifth of the sides' extent")
    ] = None

    sliding: Annotated[
        bool, Key("-", "pairs, normals and gaps follow the motion; false: those of the start, for small slips")
    ] = False

    def __post_init__(self) -> None:
        reach = self.search_distance
        require(reach is None or reach > 0, "search_distance", reach, "must be positive, in metres")
        several = self.partners
        require(0 < len(several) == len(set(several)), "against", list(several), "name at least one, and each once")
        require(not (self.sliding and self.normal.ties), "sliding", "true", "a tied surface does not slide")
        check_field(self.gap_offset, "gap_offset")
        given = self.gap is not None
        require(not (given and self.sliding), "gap", self.gap, "a side that slides has the gap that its mesh has there")
        require(not (given and self.normal.ties), "gap", self.gap, "a tied surface closes none; see gap_offset")
        if self.friction is not None:
            reason = "a tied surface sticks, leave it out" if self.normal.ties else self.friction.refuses(self.normal)
            if reason:
                raise SceneError(f"friction: {reason}")

    @property
    def partners(self) -> tuple[str, ...]:
        """All that `surface` may touch: obstacles, and sides of other bodies."""
        return (self.against,) if isinstance(self.against, str) else self.against

    def pairs(self, name: str) -> dict[str, Contact]:
        """The contact with each partner; of several its name has the obstacle's, or the body's, behind a point.

        >>> list(Contact(surface="bar.bottom", against=("left", "pin.skin")).pairs("rest"))
        ['rest.left', 'rest.pin']
        """
        if isinstance(self.against, str):
            return {name: self}
        labels = [partner.split(".")[0] for partner in self.against]
        whole = [partner.replace(".", "_") for partner in self.against]
        labels = [short if labels.count(short) == 1 else long for short, long in zip(labels, whole, strict=True)]
        found = zip(labels, self.against, strict=True)
        return {f"{name}.{label}": replace(self, against=partner) for label, partner in found}

    @property
    def tangential(self) -> FrictionLaw | None:
        """The friction law in force: a tied surface sticks."""
        return Stick() if self.normal.ties else self.friction

    def degree(self, order: int) -> int:
        """Quadrature degree that both laws need on facets."""
        return max(self.normal.degree(order), self.friction.degree(order) if self.friction else 0)

    def amplitudes(self) -> dict[tuple[str, ...], Varying]:
        """Its values in time by key and component."""
        of_law = self.friction.amplitudes() if self.friction else {}
        return {("friction", *part): value for part, value in of_law.items()} | in_time(self.gap_offset, "gap_offset")

    def check_model(self, model: Model) -> None:
        """Refuse what friction does not have in the model."""
        if self.friction is not None:
            with prefixed("friction"):
                self.friction.check_model(model)
