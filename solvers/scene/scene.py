"""The scene: all tables of the user, checked against each other before a mesh is made."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, reduce
from itertools import combinations, permutations
from operator import or_
from typing import Annotated, Any, ClassVar, get_origin

import numpy as np

from stickslip.geometry.amplitude import Amplitude
from stickslip.geometry.arrays import ROUNDING, Array
from stickslip.geometry.builders import Builder
from stickslip.geometry.errors import (
    LONGEST,
    Mistakes,
    SceneError,
    nearest,
    prefixed,
    require,
    require_known,
    shortened,
)
from stickslip.geometry.expression import CONSTANTS, RATE, Expression, Varying
from stickslip.geometry.keys import Key, Keys, Noun, completed, numbers_in
from stickslip.geometry.obstacles import Obstacle
from stickslip.geometry.shape import SKIN, Model, Request, Turn, apart, dimensions
from stickslip.geometry.units import Units
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.scene.contact import REACH, Contact, table_of
from stickslip.solvers.scene.loads import Coupling, Link, Load, Springs, Support
from stickslip.solvers.scene.material import Elastic
from stickslip.solvers.scene.parameters import (
    CORRELATIONS,
    PHYSICAL,
    Sensitivity,
    Uncertain,
    chosen,
    covariance,
    parameters,
)
from stickslip.solvers.scene.record import RECORDS, RecordType, names
from stickslip.solvers.scene.settings import LARGEST, SMALLEST, Accuracy, Exact, Output, Probe, Solver, Steps
from stickslip.solvers.scene.timeline import Place, Timeline

NAME = re.compile(r"[a-z][a-z0-9_]*")
Change = Callable[[Place, Amplitude], Amplitude]
Driven = tuple[Place, Varying]
Section = Any  # the table of an effect, or several by name


class EffectTable(Noun):
    """A table of the scene that an effect owns: [gravity], or several by name, [periodic.NAME]."""

    kinds: ClassVar[dict[str, Any]] = {}  # by section, its type: a table, or a Mapping of them; filled by `Effect`
    reports: ClassVar[RecordType | None] = None  # what a step reports of each table, see `Effect.read`

    def amplitudes(self) -> Mapping[tuple[str, str], Varying]:
        """The table's values in time by key and component ("" if it has none); steps end exactly at their times.

        Expressions are for [EFFECT.BODY] only, and as loads, see `WeakForms.load`.
        """
        return {}

    def periodic_pairs(self) -> tuple[tuple[str, str], ...]:
        """Slave and master sides whose meshes must match and whose displacements are the same."""
        return ()

    def turns(self) -> Mapping[str, Turn]:
        """By the first of such sides, the turn that takes the second one there, and its displacements."""
        return {}

    def springs(self, key: str) -> tuple[Springs, ...]:
        """All the stiffness that the effect adds, if it is that of springs to the ground: then they hold bodies.

        Args:
            key: dotted key of the table in the scene.
        """
        return ()

    def links(self, key: str) -> tuple[Link, ...]:
        """Springs between places of bodies and the ground, which hold bodies too; they need no `Effect.stiffness`."""
        return ()

    def couplings(self, scene: Scene, key: str) -> tuple[Coupling, ...]:
        """Points coupled to sides; they need no `Effect.loads`."""
        return ()

    def check(self, scene: Scene, key: str) -> None:
        """Check the table against the rest of the scene.

        Args:
            scene: the whole scene.
            key: dotted key of the table in the scene.

        Raises:
            SceneError: key, found value, what is expected.
        """


@dataclass(frozen=True, kw_only=True)
class Scene(Noun):
    """Frozen and validated; `sections` holds the tables that effects own.

    Each of these is also given, replaced and read by its own name, as gravity or springs; None or {}: there is none.
    """

    model: Annotated[Model, Key("-", "kinematics; plane: per metre; axisymmetric: x radius, y axis, full circle")]
    geometry: Builder | UserFile
    bodies: Mapping[str, Elastic]
    title: Annotated[str, Key("-", "a sentence for tables and pictures")] = ""
    units: Annotated[
        str, Key("-", '"SI", "mm-N-MPa", or other units of length, force and pressure: what results are labelled with')
    ] = "SI"
    obstacles: Mapping[str, Obstacle] = field(default_factory=dict)
    contacts: Mapping[str, Contact] = field(default_factory=dict)
    supports: Mapping[str, Support] = field(default_factory=dict)
    loads: Mapping[str, Load] = field(default_factory=dict)
    probes: Mapping[str, Probe] = field(default_factory=dict)
    steps: Steps = Steps()
    solver: Solver = field(default_factory=Solver.default)
    output: Output = Output()
    exact: Exact = Exact()
    accuracy: Accuracy = Accuracy()
    sensitivity: Sensitivity = Sensitivity()
    uncertainty: Annotated[
        Mapping[str, Uncertain],
        Key(
            "-",
            'one standard deviation of numbers of the scene, "bodies.hub.E" = "3 %", or in the unit of the number; '
            "correlations = [[KEY, KEY, NUMBER], ...] of those that depend on each other",
        ),
    ] = field(default_factory=dict)
    sections: Mapping[str, EffectTable | Mapping[str, EffectTable]] = field(default_factory=dict)

    @classmethod
    def added(cls) -> Keys:
        return EffectTable.kinds

    @classmethod
    def gathered(cls, values: Keys) -> Keys:
        given = {key: value for key, value in values.items() if key in EffectTable.kinds}
        kept = {key: table for key, table in values.get("sections", {}).items() if key not in given}
        sections = {"sections": kept | {key: table for key, table in given.items() if table}}
        return {key: value for key, value in values.items() if key not in given} | sections

    def __getattr__(self, name: str) -> Section:
        """The table of an effect, or several by name.

        Raises:
            AttributeError: no effect has one of this name.
        """
        if name not in EffectTable.kinds:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return self.sections.get(name, {} if get_origin(EffectTable.kinds[name]) else None)

    def __post_init__(self) -> None:
        """Check all tables against each other; what rests on names is checked where all names are right.

        Raises:
            SceneError, GeometryError: with a line for each mistake.
        """
        object.__setattr__(self, "geometry", self.geometry.measured_in(self.labels))
        self._complete()
        for checks in ((self._check_names,), (self._check_dimensions, self._check_references), (self._check_rest,)):
            mistakes = Mistakes()
            for check in checks:
                check(mistakes)
            mistakes.report()

    def _complete(self) -> None:
        """Give vectors that are tables by axis all components of the model."""

        def whole(key: str, tables: Any) -> Any:
            if isinstance(tables, Mapping):
                return {name: whole(f"{key}.{name}" if key else name, table) for name, table in tables.items()}
            with prefixed(key):
                return completed(tables, self.dim)

        for key in ("bodies", "loads"):
            object.__setattr__(self, key, whole(key, getattr(self, key)))
        object.__setattr__(self, "sections", whole("", self.sections))

    @property
    def labels(self) -> Units:
        """Units of the scene and of its results."""
        return Units.of(self.units)

    @property
    def dim(self) -> int:
        return dimensions(self.model)

    @property
    def axisymmetric(self) -> bool:
        return self.model == "axisymmetric"

    @cached_property
    def pairs(self) -> Mapping[str, Contact]:
        """Every contact of one side and one partner by name; of several partners, or of all bodies, each is one.

        Two bodies are one where they are near enough to be paired some time, however the scene moves them.
        """
        found = {name: c.each(name, tuple(self.bodies)) for name, c in self.contacts.items()}
        boxes = cache(lambda body: self.geometry.boxes(body, self.dim))
        for name, each in found.items():
            if self.contacts[name].between is not None:
                found[name] = {pair: contact for pair, contact in each.items() if self._may_meet(contact, boxes)}
        return {pair: contact for each in found.values() for pair, contact in each.items()}

    def _may_meet(self, contact: Contact, boxes: Callable[[str], Array]) -> bool:
        one, other = (boxes(side.split(".")[0]) for side in (contact.surface, *contact.partners))
        size = min(float(np.linalg.norm(np.ptp(each, axis=(0, 1)))) for each in (one, other))
        return apart(one, other) <= max(contact.search_distance or 0.0, REACH * size) + self._travel

    @cached_property
    def _travel(self) -> float:
        """How far [m] two bodies may be moved against each other; inf where springs or forces decide that."""
        turned = any(obstacle.driven() or obstacle.rotation is not None for obstacle in self.obstacles.values())
        if turned or self.ground_springs() or self.links():
            return np.inf
        moves: dict[tuple[str, str], list[float]] = {}
        for place, amplitude in self.drives().items():
            if place.quantity == "displacement":
                knots = amplitude if isinstance(amplitude, tuple) else ((0.0, amplitude),)
                moves.setdefault(place[:2], []).append(max(abs(value) for _, value in knots))
        return 2 * max((float(np.linalg.norm(sizes)) for sizes in moves.values()), default=0.0)

    @property
    def sums(self) -> Mapping[str, tuple[str, ...]]:
        """Contacts of several partners, or of all bodies, and the names of their `pairs`."""
        return {
            name: tuple(pair for pair in self.pairs if table_of(pair) == name)
            for name, c in self.contacts.items()
            if not isinstance(c.against, str)
        }

    def request(self) -> Request:
        """Sides and periodic pairs that the mesh must have."""
        rigid = {c.surface for c in self.pairs.values() if c.against in self.obstacles}
        pairs = [(c.surface, side) for c in self.pairs.values() for side in c.partners if side not in self.obstacles]
        return Request(
            model=self.model,
            facing=tuple(pair for pair in pairs if rigid.isdisjoint(pair)),
            contact_sides=tuple(
                dict.fromkeys(
                    s for c in self.pairs.values() for s in (c.surface, *c.partners) if s not in self.obstacles
                )
            ),
            periodic=tuple(pair for table in self.effect_tables().values() for pair in table.periodic_pairs()),
            turns=reduce(or_, (dict(table.turns()) for table in self.effect_tables().values()), {}),
        )

    def sides(self) -> tuple[str, ...]:
        """All sides, as body.side."""
        return tuple(f"{body}.{side}" for body, sides in self.geometry.bodies(self.dim).items() for side in sides)

    def require_side(self, side: str, key: str, skins: bool = False) -> None:
        """Check that the geometry has a side.

        Args:
            side: as body.side.
            key: dotted key of the scene that names it.
            skins: whether it may be body.*, too.

        Raises:
            SceneError: the geometry does not have it; the nearest name is given.
        """
        require_known(key, side, (*self.sides(), *(self._skins if skins else ())), "no such side")

    @property
    def _skins(self) -> tuple[str, ...]:
        """The whole skin of each body, as a side."""
        return tuple(f"{body}.{SKIN}" for body in self.bodies)

    def require_body(self, key: str) -> None:
        """Check that the table [EFFECT.BODY] of a key has the name of a body.

        Raises:
            SceneError: the geometry does not have it; the nearest name is given.
        """
        body = key.split(".")[-1]
        if body not in self.bodies:
            raise SceneError(f"{key}: no such body in the geometry; {nearest(body, self.bodies)}")

    def quantities(self) -> tuple[str, ...]:
        """Names of the numbers that every step of this scene has."""
        owners = [("contacts", name, RECORDS["contacts"]) for name in (*self.pairs, *self.sums)]
        named = ("probes", "supports", "obstacles", "bodies")
        owners += [(table, name, RECORDS[table]) for table in named for name in getattr(self, table)]
        tables = [(*place, table.reports) for place, table in self.effect_tables().items()]
        of_effects = [(section, name, record) for section, name, record in tables if record is not None]

        def lacks(name: str, key: str) -> bool:
            return all(getattr(self.pairs[pair], key) is None for pair in self.sums.get(name, (name,)))

        return names(self.dim, [*owners, *of_effects, ("energy", "", RECORDS["energy"])], lacks)

    def parameters(self, geometry: bool = True) -> dict[str, float]:
        """Numbers that results may be derived by, by key, with those of the geometry or without."""
        tables = {key: getattr(self, key) for key in PHYSICAL} | dict(self.sections)
        return parameters(tables | ({"geometry": self.geometry} if geometry else {}))

    @property
    def derived_by(self) -> tuple[str, ...]:
        """Keys of those that derivatives are asked by."""
        asked, uncertain = self.sensitivity.parameters, [key for key in self.uncertainty if key != CORRELATIONS]
        return chosen(asked, uncertain, self.parameters(), self.parameters(False)) if asked or uncertain else ()

    @property
    def covariance(self) -> dict[str, dict[str, float]]:
        """Covariances of those that are uncertain, in their own units."""
        return covariance(self.uncertainty, self.parameters()) if self.uncertainty else {}

    def effect_tables(self) -> dict[tuple[str, str], EffectTable]:
        """Tables that effects own, by (effect, name of the table); the name is "" if the effect has one table only."""
        found: dict[tuple[str, str], EffectTable] = {}
        for section, tables in self.sections.items():
            named = tables if isinstance(tables, Mapping) else {"": tables}
            found |= {(section, name): table for name, table in named.items()}
        return found

    def ground_springs(self) -> tuple[Springs, ...]:
        """Springs to the ground of all effects."""
        return tuple(springs for key, table in self._tables_by_key().items() for springs in table.springs(key))

    def links(self) -> tuple[Link, ...]:
        """Springs between places of all effects."""
        return tuple(link for key, table in self._tables_by_key().items() for link in table.links(key))

    def couplings(self) -> tuple[Coupling, ...]:
        """Points coupled to sides, of all effects."""
        return tuple(found for key, table in self._tables_by_key().items() for found in table.couplings(self, key))

    def _tables_by_key(self) -> dict[str, EffectTable]:
        tables = self.effect_tables().items()
        return {f"{section}.{name}" if name else section: table for (section, name), table in tables}

    def timeline(self) -> Timeline:
        """Every value in time, and the times that are requested."""
        expressions = self.expressions().items()
        moving = [place for place, found in expressions if found.in_time and place.table != "contacts"]
        jumps = any(self.sampled(place, 0.0).any() for place in moving)
        steps = self.steps
        return Timeline(self.drives(), steps.end, steps.count, self.expressions(), jumps, steps.clock, steps.cycle)

    def requested_times(self) -> tuple[float, ...]:
        """Times [s] at which results are asked for; see `Timeline.times`."""
        return self.timeline().times

    def drives(self) -> dict[Place, Amplitude]:
        """Every value in time by its place: loads, motions, friction bounds and those of effects."""
        return {place: value for place, value in self._varying() if not isinstance(value, str)}

    def expressions(self) -> dict[Place, Expression]:
        """Every expression by its place, with the constants of the body that it acts on."""
        found: dict[Place, Expression] = {}
        for place, value in self._varying():
            if isinstance(value, str):
                acts = self._acting(place)
                body = self.bodies.get(place.name if acts is None else (acts.boundary or "").split(".")[0])
                found[place] = Expression(value, body.constants if body is not None else {})
        return found

    def sampled(self, place: Place, time: float) -> Array:
        """Values (m,) of an expression at points where it acts, at a time [s]; inf or NaN where it has none."""
        acts = self._acting(place)
        if place.table == "contacts":
            sides = [c.surface for name, c in self.pairs.items() if table_of(name) == place.name]
            points = np.concatenate([self.geometry.sample(side, self.dim)[0] for side in dict.fromkeys(sides)])
        elif acts is None:
            low, high = self.geometry.box(self.dim)
            points = low + (high - low) * np.random.default_rng(0).random((30, self.dim))
        elif acts.boundary is None:
            points = np.array([acts.point], float)
        else:
            points = self.geometry.sample(acts.boundary, self.dim)[0]
        return self.expressions()[place](points, time, self.steps.end)

    def _acting(self, place: Place) -> Load | Support | None:
        """The load or support with a place; None for the tables of effects."""
        acting: Mapping[str, Mapping[str, Load | Support]] = {"supports": self.supports, "loads": self.loads}
        return acting[place.table][place.name] if place.table in acting else None

    def _varying(self) -> Iterator[Driven]:
        for key in ("supports", "loads", "obstacles", "contacts"):
            for name, noun in getattr(self, key).items():
                yield from ((Place(key, name, *part), value) for part, value in noun.amplitudes().items())
        for (section, name), table in self.effect_tables().items():
            yield from ((Place(section, name, *part), value) for part, value in table.amplitudes().items())

    def _check_names(self, mistakes: Mistakes) -> None:
        for key, number in numbers_in(vars(self) | {"sections": ()} | dict(self.sections)):
            with mistakes:
                ok = number == 0 or SMALLEST <= abs(number) <= LARGEST
                require(ok, ".".join(key), number, f"must be 0, or from {SMALLEST:g} to {LARGEST:g} in size")
        tables = ("bodies", "obstacles", "contacts", "supports", "loads", "probes")
        names = [(table, name) for table in tables for name in getattr(self, table)]
        for table, name in [*names, *((section, name) for section, name in self.effect_tables() if name)]:
            with mistakes:
                require(len(name) <= LONGEST, table, name, f"a name has at most {LONGEST} letters")
                if not NAME.fullmatch(name):
                    raise SceneError(f"{table}.{name}: a name is made of a-z, 0-9 and _, and begins with a letter")
        known = self.geometry.bodies(self.dim)
        wrong = {
            name: f"no such body in the geometry; {nearest(name, known)}" for name in self.bodies if name not in known
        }
        lacking = {
            name: "missing, this body of the geometry needs E and nu" for name in known if name not in self.bodies
        }
        for name, why in (wrong or lacking).items():  # a name that is misspelt is both
            with mistakes:
                raise SceneError(f"bodies.{name}: {why}")

    def _check_dimensions(self, mistakes: Mistakes) -> None:
        with mistakes, prefixed("geometry"):
            self.geometry.check_model(self.model)
        for key in ("obstacles", "contacts", "bodies", "loads", "supports", "probes"):
            for name, noun in getattr(self, key).items():
                with mistakes, prefixed(f"{key}.{name}"):
                    noun.check_model(self.model)
        for name, contact in self.contacts.items():
            with mistakes, prefixed(f"contacts.{name}"):
                if self.steps.clock is not None:
                    contact.check_clock()
                if self.steps.cycle is not None:
                    contact.check_cycle()
            for pair in contact.each(name, tuple(self.bodies)).values() if contact.along else ():
                with mistakes, prefixed(f"contacts.{name}"):
                    contact.check_partner(self.obstacles.get(pair.partners[0]), self.steps.end, self.dim)
            with mistakes:
                timed = (contact.friction is not None and contact.friction.timed) or contact.slide_speed is not None
                key = "slide_speed is a rate" if contact.slide_speed is not None else "friction depends on slip rates"
                said = f"contacts.{name}.{key}: say that times are seconds, seconds = true"
                require(self.steps.seconds or self.steps.clock is not None or not timed, "steps.seconds", "false", said)

    def _check_rest(self, mistakes: Mistakes) -> None:
        with mistakes:
            self._check_expressions()
        with mistakes:
            self._check_cycle()
        with mistakes, prefixed("geometry"):
            self.geometry.refuse_too_large(self.request())
        for key, table in self._tables_by_key().items():
            with mistakes:
                table.check(self, key)
        with mistakes:
            _ = self.derived_by, self.covariance
        mistakes.report()  # effects know the quantities
        known = self.quantities()
        for key, asked in (("exact.values", self.exact.values), ("accuracy.goals", self.accuracy.goals)):
            with mistakes:
                for name in asked:
                    require_known(key, name, known, "no such quantity")

    def _check_cycle(self) -> None:
        """Refuse a cycle that wears nothing, or that does not end where it began, but for the way slid."""
        if (cycle := self.steps.cycle) is None:
            return
        wears = any(contact.wear is not None for contact in self.contacts.values())
        require(wears, "steps.cycle", "given", "leave it out: no contact wears")
        timeline, times = self.timeline(), np.linspace(cycle.from_, cycle.to, 9)
        onward = [p for p, _ in self._varying() if p.quantity in ("slide", "slide_speed") and not p.component]
        for place in (place for place, _ in self._varying() if place not in onward):
            value = self.sampled if place in timeline.expressions else timeline.value
            found = np.array([value(place, t) for t in times.tolist()])
            same = np.abs(found[0] - found[-1]).max() <= ROUNDING * np.abs(found).max()
            said = f"is not the same at both ends of steps.cycle, {cycle.from_:g} and {cycle.to:g} s"
            require(bool(same), str(place), "changes", said)

    def _check_expressions(self) -> None:
        for place, expression in self.expressions().items():
            for name, ok, why in (
                ("z", self.dim == 3, "a plane model has x and y only"),
                (RATE, False, "the slip rate, which friction laws alone depend on"),
                *((name, name in expression.constants, _lacking(expression)) for name in CONSTANTS),
            ):
                known = ok or name not in expression.names
                require(bool(known), str(place), f'"{shortened(expression.text)}"', f"{name}: {why}")

    def slave_and_master(self, name: str) -> tuple[str, str | None]:
        """The side of a contact that carries the tractions, and the other one, None for an obstacle.

        A side that is much stiffer than the other one, and finer, would bend the other one to each of its nodes:
        pressures oscillate. So the softer body's side carries the tractions.
        """
        contact = self.pairs[name]
        (against,) = contact.partners
        if against in self.obstacles:
            return contact.surface, None
        found, softer = self.contacts[table_of(name)].between is not None, self._softer(contact, against)
        if contact.slave == "against" or (contact.slave == "auto" and softer > (1 if found else 10)):
            return against, contact.surface
        return contact.surface, against

    def _softer(self, contact: Contact, against: str) -> float:
        """How many times the body of `against` is softer, where mortar pairs the sides; else 0.

        A side with several partners keeps its role, but for skins, of which bodies have one each.
        """
        own, other = (self.bodies[side.split(".")[0]].modulus for side in (contact.surface, against))
        sides = [side for each in self.pairs.values() for side in (each.surface, *each.partners)]
        alone = sides.count(against) == sides.count(contact.surface) == 1 or against.endswith(SKIN)
        return own / other if alone and contact.operator in (None, "mortar") else 0.0

    def _check_references(self, mistakes: Mistakes) -> None:
        for table, items in (("supports", self.supports), ("loads", self.loads)):
            for name, item in items.items():
                if item.boundary is not None:
                    with mistakes:
                        self.require_side(item.boundary, f"{table}.{name}.boundary")
        for name, contact in self.contacts.items():
            if contact.between is not None:
                self._check_between(name, contact, mistakes)
                continue
            with mistakes:
                self.require_side(contact.surface, f"contacts.{name}.surface", skins=True)
            for against in contact.partners:
                with mistakes:
                    self._check_other_side(name, contact, against)
        mistakes.report()  # roles are those of sides that are there
        self._check_roles()

    def _check_between(self, name: str, contact: Contact, mistakes: Mistakes) -> None:
        """Check the names of bodies, of exceptions, and that no other contact has the sides of its pairs."""
        bodies = tuple(self.bodies) if contact.between == "all" else contact.between or ()
        for body in bodies:
            with mistakes:
                require_known(f"contacts.{name}.between", body, self.bodies, "no such body")
        with mistakes:
            require(len(bodies) > 1, f"contacts.{name}.between", contact.between, "the geometry has one body only")
            self._check_operator(f"contacts.{name}.operator", contact.operator)
        known = [f"{one}.{other}" for one, other in permutations(bodies, 2)]
        for pair, change in contact.pairs.items():
            key, both = f'contacts.{name}.pairs."{pair}"', pair.split(".")
            with mistakes:
                require_known(key, pair, known, "no such pair of its bodies")
                other = ".".join(reversed(both))
                twice = other in contact.pairs and other < pair
                require(not twice, key, other, "is the same pair; keep one")
                if change.slave is not None:
                    require_known(f"{key}.slave", change.slave, both, "not one of the two")
            with mistakes, prefixed(key):
                contact.each(name, both)
        for other, beside in self.contacts.items():
            for against in beside.partners:
                both = [side.split(".")[0] for side in (beside.surface, against)]
                met = against not in self.obstacles and {*both} <= {*bodies} and not contact.change(*both).off
                with mistakes:
                    said = f'contacts.{name} pairs the two; keep one, or set contacts.{name}.pairs."{".".join(both)}"'
                    require(not met or both[0] == both[1], f"contacts.{other}.against", against, f"{said}.off = true")
            if other > name and beside.between is not None:
                others = {*self.bodies} if beside.between == "all" else {*beside.between}
                for one, two in combinations([body for body in bodies if body in others], 2):
                    with mistakes:
                        off = contact.change(one, two).off or beside.change(one, two).off
                        pair = f"{one}.{two}"
                        said = f"contacts.{other} pairs them too; keep one, or set off = true"
                        require(off, f'contacts.{name}.pairs."{pair}"', pair, said)

    def _check_roles(self) -> None:
        of_slaves: dict[str, list[str]] = {}
        for name in self.pairs:
            of_slaves.setdefault(self.slave_and_master(name)[0], []).append(name)
        for slave, of_slave in of_slaves.items():
            self._check_partners(slave, of_slave)
        roles = {self.slave_and_master(name): name for name in self.pairs}
        for name, contact in self.pairs.items():
            slave, master = self.slave_and_master(name)
            other = roles.get((master or "", slave), name)
            mutual = master is not None and other != name
            expected = f"contacts.{other} has the same two sides exchanged: both would carry the pressure; keep one"
            require(not mutual, f"contacts.{name}.against", contact.against, expected)

    def _check_partners(self, slave: str, pairs: list[str]) -> None:
        """Check that the contacts of one slave side differ in what it may touch, and search it in the same way."""
        known: dict[str, str] = {}
        for name in pairs:
            contact, master = self.pairs[name], self.slave_and_master(name)[1]
            first, partner = self.pairs[pairs[0]], master or str(contact.against)
            other = known.setdefault(partner, name)
            key = f"contacts.{name}.{'surface' if slave == contact.surface else 'against'}"
            require(other == name, key, slave, f"contacts.{other} has the same slave and the same partner, keep one")
            alike = f"must be that of contacts.{pairs[0]}, which has the same slave"
            moved = contact.normal.ties or first.normal.ties or contact.sliding == first.sliding
            require(moved, f"contacts.{name}.sliding", str(contact.sliding).lower(), alike)
            if master is not None:
                operator = contact.operator or "mortar"
                first = next(self.pairs[n] for n in pairs if self.slave_and_master(n)[1])
                alike = f"{slave} meets other bodies by {first.operator or 'mortar'}; one side has one operator"
                require(operator == (first.operator or "mortar"), f"contacts.{name}.operator", operator, alike)

    def _check_other_side(self, name: str, contact: Contact, against: str) -> None:
        """Check that `against` is an obstacle or a side of another body, and that the model has the operator."""
        known = (*self.obstacles, *self.sides(), *self._skins)
        require_known(f"contacts.{name}.against", against, known, "no such obstacle or side")
        rigid = against in self.obstacles
        alone = all(partner in self.obstacles for partner in contact.partners)
        require(not rigid or contact.slave != "against", f"contacts.{name}.slave", "against", "an obstacle is no slave")
        given = f"contacts.{name}.gap"
        require(not rigid or contact.gap is None, given, contact.gap, "an obstacle has its exact shape; see gap_offset")
        if contact.operator is not None:
            key = f"contacts.{name}.operator"
            require(not alone, key, contact.operator, "a rigid obstacle needs none; remove the key")
            itself = against == contact.surface and contact.operator != "mortar"
            require(not itself, key, contact.operator, "a side that touches itself needs mortar")
            self._check_operator(key, contact.operator)

    def _check_operator(self, key: str, operator: str | None) -> None:
        wrong = {2: "node-to-face", 3: "node-to-segment"}[self.dim]
        require(operator != wrong, key, operator, f"there is none in {self.dim}D; use mortar")


def _lacking(expression: Expression) -> str:
    """Explain why an expression does not know a constant of a material."""
    own = ", ".join(expression.constants)
    return f"this body has {own}" if own else "no body has it here; only sides and bodies do"


def over(scene: Scene, change: Change) -> Scene:
    """The scene with every value in time changed; expressions stay.

    Args:
        change: takes the place of a value and the value, and returns the new value.
    """
    return with_values(scene, {place: change(place, amplitude) for place, amplitude in scene.drives().items()})


def with_values(scene: Scene, values: Mapping[Place, Varying]) -> Scene:
    """The scene with other values in time, or expressions, at places that it has."""
    tables: dict[str, Any] = {}
    for place, value in values.items():
        root = "sections" if place.table in scene.sections else place.table
        path = [word for word in (place if root == "sections" else place[1:]) if word]
        tables[root] = _with(tables.get(root, getattr(scene, root)), path, value)
    return replace(scene, **tables)


def _with(noun: Any, path: list[str], amplitude: Varying) -> Any:
    """A copy of a dataclass, a table of them or a vector, with the value at the end of the path replaced."""
    if not path:
        return amplitude
    first, *rest = path
    if isinstance(noun, Mapping):
        return {**noun, first: _with(noun[first], rest, amplitude)}
    if isinstance(noun, tuple):
        axis = "xyz".index(first)
        return (*noun[:axis], amplitude, *noun[axis + 1 :])
    return replace(noun, **{first: _with(getattr(noun, first), rest, amplitude)})
