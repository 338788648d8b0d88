"""A surface that may touch an obstacle, and the laws that hold there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import combinations
from typing import Annotated, Any, Literal

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check, listed_times, value_at
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError, prefixed, require, require_components
from stickslip.geometry.expression import Varying
from stickslip.geometry.field import Field, check_field, in_time
from stickslip.geometry.keys import Key, Noun, Vector
from stickslip.geometry.obstacles.obstacle import AXES, ByAxis, Obstacle
from stickslip.geometry.shape import SKIN, Model, dimensions
from stickslip.solvers.laws import FrictionLaw, NormalLaw
from stickslip.solvers.laws.friction import Stick
from stickslip.solvers.laws.normal import Bilateral, Tied, Unilateral
from stickslip.solvers.laws.rate_and_state import STEADY, RateAndState
from stickslip.solvers.laws.tangential_compliance import TangentialCompliance
from stickslip.solvers.laws.wear import Slide, Turned, Wear


def table_of(name: str) -> str:
    """Name of the table that a contact comes from: that of one among several has the partner's, or both, behind it.

    >>> table_of("rest.left"), table_of("base")
    ('rest', 'base')
    """
    return name.partition(".")[0]


@dataclass(frozen=True, kw_only=True)
class Initial(Noun):
    """Tractions at t = 0 that the bodies are in equilibrium with, undeformed, and the state of friction; not ramped."""

    pressure: Annotated[Field, Key("Pa", "a number, an expression, or a map over places")] = 0.0
    traction: Annotated[
        float | Vector,
        Key("Pa", "shear that drives `surface`: a vector, or in the plane a number, along +x, or +y of a steep side"),
    ] = 0.0
    state: Annotated[
        Field | None, Key("s", 'theta of rate_and_state, likewise; "steady": Dc / V at the rate of the traction')
    ] = None
    rate: Annotated[float | None, Key("m/s", "instead of it the slip rate that it follows from")] = None

    def __post_init__(self) -> None:
        for key in ("pressure", "state"):
            if (value := getattr(self, key)) not in (None, STEADY):
                check_field(value, key)
                require(not in_time(value, key), key, value, "does not change in time")
        require(self.rate is None or self.rate > 0, "rate", self.rate, "must be positive, in m/s")
        require(self.rate is None or self.state is None, "rate", self.rate, "leave it out, or `state`")


REACH = 0.2  # of the sides' extent: as far as contact is searched for where the scene does not say


@dataclass(frozen=True, kw_only=True)
class PairChange(Noun):
    """What is different in one pair of a contact `between` bodies; what is absent is that of the contact."""

    off: Annotated[bool, Key("-", "true: the two do not touch each other")] = False
    normal: Annotated[NormalLaw | None, Key("-", "normal law")] = None
    friction: Annotated[FrictionLaw | None, Key("-", "friction law")] = None
    slave: Annotated[str | None, Key("-", "body whose skin carries the tractions; absent: the softer one")] = None
    gap_offset: Annotated[Field | None, Key("m", "see contacts.NAME")] = None
    gap: Annotated[float | None, Key("m", "see contacts.NAME")] = None
    search_distance: Annotated[float | None, Key("m", "see contacts.NAME")] = None

    def applied(self, contact: Contact, one: str, other: str) -> Contact:
        """The contact of two bodies' skins, with what is given here; a tie has no friction and no gap, nor slides."""
        sides: dict[str, Any] = {"surface": f"{one}.{SKIN}", "against": f"{other}.{SKIN}"}
        if self.slave is not None:
            sides["slave"] = "surface" if self.slave == one else "against"
        found = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("off", "slave")}
        tied = {"friction": None, "gap": None, "sliding": False} if self.normal is not None and self.normal.ties else {}
        given = tied | {name: value for name, value in found.items() if value is not None}
        return replace(contact, **{"between": None, "pairs": {}} | sides | given)


@dataclass(frozen=True, kw_only=True)
class Contact(Noun):
    """Contact of a slave surface with a rigid obstacle or another body, or of all bodies with each other."""

    surface: Annotated[
        str, Key("-", "side of a body, as body.side, or body.*, all of its skin: the slave; resultants act on it")
    ] = ""
    against: Annotated[
        str | tuple[str, ...],
        Key(
            "-",
            "obstacle, or a side, of the same body too, or the same; of several each part has the one it reaches first",
        ),
    ] = ()
    between: Annotated[
        Literal["all"] | tuple[str, ...] | None,
        Key(
            "-", 'instead of `surface` and `against`: "all" bodies or some, whose skins are paired where they come near'
        ),
    ] = None
    pairs: Annotated[
        Mapping[str, PairChange], Key("-", 'with `between`, what is different in a pair, pairs."hub.shaft"')
    ] = field(default_factory=dict)
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
        float | None,
        Key(
            "m",
            "largest distance at which sides are paired; absent: a fifth of the sides' extent; of skins parts "
            "within it enter, absent within 1e-3 of the geometry's diagonal, at the start and as bodies move",
        ),
    ] = None

    sliding: Annotated[
        bool, Key("-", "pairs, normals and gaps follow the motion; false: those of the start, for small slips")
    ] = False

    slide: Annotated[
        Amplitude | ByAxis | None,
        Key(
            "m",
            "sliding of `surface` in time, that friction turns to: out of the plane; axisymmetric: a turn [rad]; or by "
            "component, { x = ... }, along a rigid plane or the axis of a rigid cylinder",
        ),
    ] = None
    slide_speed: Annotated[
        Amplitude | None, Key("m/s", "instead of it its speed, constant if it is a number; axisymmetric: [rad/s]")
    ] = None
    initial: Annotated[Initial | None, Key("-", "tractions and state at t = 0; absent: none")] = None
    wear: Annotated[Wear | None, Key("-", "wear by all slip that friction or `slide` has; absent: none")] = None

    def __post_init__(self) -> None:
        reach = self.search_distance
        require(reach is None or reach > 0, "search_distance", reach, "must be positive, in metres")
        self._check_sides()
        require(not (self.sliding and self.normal.ties), "sliding", "true", "a tied surface does not slide")
        check_field(self.gap_offset, "gap_offset")
        given = self.gap is not None
        require(not (given and self.sliding), "gap", self.gap, "a side that slides has the gap that its mesh has there")
        require(not (given and self.normal.ties), "gap", self.gap, "a tied surface closes none; see gap_offset")
        self._check_wear()
        self._check_initial()
        if self.friction is not None:
            reason = "a tied surface sticks, leave it out" if self.normal.ties else self.friction.refuses(self.normal)
            if reason:
                raise SceneError(f"friction: {reason}")

    def _check_initial(self) -> None:
        if (given := self.initial) is None:
            return
        whole = self.between is not None or self.surface.endswith(SKIN)
        require(
            not (self.sliding or whole), "initial", "given", "names tractions at points: not of `sliding`, or skins"
        )
        with prefixed("initial"):
            for key in ("state", "rate"):
                value = getattr(given, key)
                require(value is None or self.ages is not None, key, value, "is one of friction rate_and_state")
            if self.ages and isinstance(given.pressure, float | int):
                require(given.pressure > 0, "pressure", given.pressure, "must be positive for rate_and_state, in Pa")

    def _check_wear(self) -> None:
        given = {key: getattr(self, key) for key in ("slide", "slide_speed", "wear")}
        skins = self.surface.endswith(SKIN) and any(each.endswith(SKIN) for each in self.partners)
        for key, value in ((key, value) for key, value in given.items() if value is not None):
            said = "true" if key == "wear" else value
            for place, amplitude in self._slides().items() if key != "wear" else ():
                check(amplitude, ".".join(place))
            require(self.normal.sides == 1, key, said, "needs surfaces that only press: unilateral or compliance")
            require(not self.sliding, key, said, "not where pairs are searched again, `sliding`, yet")
            require(self.between is None and not skins, key, said, "not between whole skins yet; name two sides")
        require(self.slide is None or self.slide_speed is None, "slide", self.slide, "leave it out, or `slide_speed`")
        law = self.friction
        slides = self.aside is not None
        if slides and law is not None and Turned.refuses_law(law):
            key = "law" if law.k_T is None else "k_T"
            raise SceneError(f"friction.{key} = {getattr(law, key, '')}: does not turn to `slide` yet; use coulomb")
        if self.wear is not None:
            if law is not None and law.k_T is not None:
                raise SceneError(f"friction.k_T = {law.k_T}: has no slip that wears yet; leave out k_T, or wear")
            require(law is not None or slides, "wear", "true", "needs friction or `slide` out of the plane, which slip")
            if isinstance(law, TangentialCompliance):
                raise SceneError(f"friction.law = {law.law}: is bounded by the penetration, of which wear takes a part")

    def check_clock(self) -> None:
        """Refuse what `steps.clock` does not follow: slip and state flow, of points that stay where they are."""
        said, law = "steps.clock does not follow it yet: give steps.count instead", self.friction
        flows = law is None or isinstance(law, RateAndState | Stick)
        require(flows, "friction.law", getattr(law, "law", ""), f"{said}, or use rate_and_state")
        rigid = isinstance(self.normal, Unilateral | Bilateral | Tied)
        require(rigid, "normal.law", getattr(self.normal, "law", ""), said)
        for key in ("sliding", "wear"):
            require(not getattr(self, key), key, "true", said)
        require(not self.along, "slide", "given", said)

    @property
    def along(self) -> ByAxis:
        """Components of its sliding along the other side; empty: it slides out of the plane, or not."""
        return self.slide if isinstance(self.slide, Mapping) else {}

    @property
    def aside(self) -> Amplitude | None:
        """Its sliding out of the plane, or the speed of that."""
        return self.slide_speed if self.slide is None or isinstance(self.slide, Mapping) else self.slide

    def _slides(self) -> dict[tuple[str, ...], Amplitude]:
        """Its sliding by key and component."""
        if self.along:
            return {("slide", axis): value for axis, value in self.along.items()}
        return {(key,): value for key in ("slide", "slide_speed") if (value := getattr(self, key)) is not None}

    def slid(self, time: float, end: float, dim: int) -> Array:
        """Sliding (d,) [m] along the other side at a time [s]; end: of the scene [s]."""
        return np.array([value_at(self.along.get(axis, 0.0), time, end) for axis in AXES[:dim]])

    def check_partner(self, obstacle: Obstacle | None, end: float, dim: int) -> None:
        """Refuse sliding along another side that it does not leave in its place.

        Args:
            obstacle: the other side; None: a body's.
            end: of the scene [s].
            dim: number of the dimensions.
        """
        times = {end, *(t for amplitude in self.along.values() for t in listed_times(amplitude))} if self.along else ()
        for way in (self.slid(time, end, dim) for time in times):
            alike = obstacle is not None and obstacle.alike_along(way)
            said = "only along a rigid plane, or the axis of a rigid cylinder, is the other side the same everywhere"
            require(alike, "slide", way.tolist(), said)

    def check_cycle(self) -> None:
        """Refuse friction by the slip so far, of which a cycle that stands for many does not tell."""
        law = self.friction
        adds = law is not None and bool(law.remembers) and (not law.drags or self.ages)
        require(not adds, "friction.law", getattr(law, "law", ""), "changes from cycle to cycle; leave out steps.cycle")
        require(not self.sliding, "sliding", "true", "pairs that are searched again do not go with steps.cycle yet")

    def law(self, turns: bool) -> tuple[FrictionLaw | None, Slide | None]:
        """The friction law in force, turned towards the sliding out of the plane, and that; turns: about an axis."""
        given, law = self.aside, self.tangential
        if given is None:
            return law, None
        slide = Slide(given=given, speed=self.slide_speed is not None, turns=turns)
        return law and Turned(of=law, normal=self.normal, slide=slide), slide

    def _check_sides(self) -> None:
        several = self.partners
        if self.between is None:
            for key in ("surface", "against"):
                if getattr(self, key) == "":
                    raise SceneError(f"{key}: missing, it has no default")
            require(len(several) > 0, "against", "[]", "is empty: name an obstacle or a side of another body")
            require(len(several) == len(set(several)), "against", list(several), "name each once")
            require(not self.pairs, "pairs", list(self.pairs), "is for a contact between bodies")
            return
        for key in ("surface", "against"):
            require(not getattr(self, key), key, getattr(self, key), "leave it out: `between` names the bodies")
        if self.between != "all":
            twice = len(self.between) != len(set(self.between))
            require(not twice and len(self.between) > 1, "between", list(self.between), "name two bodies or more, once")

    @property
    def partners(self) -> tuple[str, ...]:
        """All that `surface` may touch: obstacles, and sides of other bodies."""
        return (self.against,) if isinstance(self.against, str) else self.against

    def each(self, name: str, bodies: Sequence[str]) -> dict[str, Contact]:
        """The contact with each partner; of several its name has the obstacle's, or the body's, behind a point.

        Args:
            bodies: all that there are.

        >>> list(Contact(surface="bar.bottom", against=("left", "pin.skin")).each("rest", ()))
        ['rest.left', 'rest.pin']
        >>> list(Contact(between="all").each("any", ("hub", "pin", "shaft")))
        ['any.hub.pin', 'any.hub.shaft', 'any.pin.shaft']
        """
        if self.between is not None:
            listed = bodies if self.between == "all" else self.between
            changes = {pair: self.change(*pair) for pair in combinations(listed, 2)}
            return {f"{name}.{a}.{b}": c.applied(self, a, b) for (a, b), c in changes.items() if not c.off}
        if isinstance(self.against, str):
            return {name: self}
        labels = [partner.split(".")[0] for partner in self.against]
        whole = [partner.replace(".", "_") for partner in self.against]
        labels = [short if labels.count(short) == 1 else long for short, long in zip(labels, whole, strict=True)]
        found = zip(labels, self.against, strict=True)
        return {f"{name}.{label}": replace(self, against=partner) for label, partner in found}

    def change(self, one: str, other: str) -> PairChange:
        """What is different in the pair of two bodies, in whatever order `pairs` has them."""
        return self.pairs.get(f"{one}.{other}") or self.pairs.get(f"{other}.{one}") or PairChange()

    @property
    def rates(self) -> bool | None:
        """True where friction asks for a slip rate; None: not."""
        return True if self.friction is not None and self.friction.timed else None

    @property
    def ages(self) -> bool | None:
        """True where friction has a state; None: not."""
        return True if isinstance(self.friction, RateAndState) else None

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
        found = {("friction", *part): value for part, value in of_law.items()} | in_time(self.gap_offset, "gap_offset")
        return found | self._slides()

    def check_model(self, model: Model) -> None:
        """Refuse what friction and sliding do not have in the model."""
        key = "slide" if self.slide_speed is None else "slide_speed"
        none = model != "3d" or self.aside is None
        require(none, key, self.aside, "there is no direction out of the plane in 3D; give slide = { x = ... }")
        for axis in self.along:
            known = axis in AXES[: dimensions(model)] and (model, axis) != ("axisymmetric", "x")
            require(known, f"slide.{axis}", "given", "is no direction in which this model can slide")
        if self.initial is not None:
            with prefixed("initial"):
                traction = self.initial.traction
                if not isinstance(traction, float | int):
                    require_components(traction, "traction", dimensions(model))
                else:
                    require(model != "3d" or not traction, "traction", traction, "give [x, y, z] in 3D")
        if self.friction is not None:
            with prefixed("friction"):
                self.friction.check_model(model)
