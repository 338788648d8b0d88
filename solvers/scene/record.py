"""Records: what a step reports, each number declared once with its unit and meaning by what it belongs to.

Names of goals, result.json with its schema and units, steps.csv, errors, reports and comparisons are walks over them.
A record is a class whose fields, or properties, are annotated with a `Number`. How each follows a second time from what
stands in the step's file is declared with it, or by its name in `AGAIN`: the audit judges all of them by that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, get_type_hints

import numpy as np

from stickslip.geometry.arrays import Array, cross
from stickslip.geometry.keys import Key

RecordType = Any  # a class whose fields or properties are annotated with a `Number`
Record = Any  # an instance of it
Value = float | Array  # a number, or a vector by component
Seen = Any  # what a step's file shows of a record's owner, see `stickslip.solvers.results.second_numbers`
OPEN, SLIP, STICK = 0, 1, 2  # values of `ContactState.status`
STATUS_WORDS = ("open", "slip", "stick")  # of these values, in tables
STRESSES = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "yz": (1, 2), "xz": (0, 2)}
KINDS = {  # of numbers that have one scale, by unit
    "N": "force", "N m": "moment", "m²": "area", "Pa": "pressure", "m": "length", "J": "energy", "rad": "rotation",
    "m³": "volume",
}  # fmt: skip


@dataclass(frozen=True)
class Number(Key):
    """A number that a step reports, or a vector: its unit, meaning and shape.

    A vector has d components; a turn, which is a moment or a rotation, is one about z in the plane and three in space;
    a stress has the six of `STRESSES`.
    """

    shape: Literal["", "vector", "turn", "stress"] = ""
    words: str = ""  # by which reports and comparisons show it; empty: they do not
    column: bool = True  # whether steps.csv has it by the name that goals use
    error: bool = True  # whether its error is estimated
    again: Callable[[Seen], Value] | None = None  # its second formula; None: that of its name in `AGAIN`
    needs: str = ""  # key of the record's table without which it is None, and stands nowhere

    @property
    def kind(self) -> str:
        """Kind of numbers that it is compared with; empty: it stands alone."""
        return KINDS.get(self.unit, "")

    def axes(self, size: int) -> Sequence[str]:
        """Names of its components; size: their number, or that of the dimensions."""
        turn = "xyz" if size == 3 else "z"
        return {"": ("",), "vector": "xyz"[:size], "turn": turn, "stress": tuple(STRESSES)}[self.shape]

    def value(self, found: Value) -> Value:
        """A float, or the components (k,) of what has several."""
        if self.shape == "stress":
            return np.array([np.asarray(found)[ij] for ij in STRESSES.values()])
        return np.asarray(found) if self.shape == "vector" or np.size(found) > 1 else float(np.ravel(found)[0])


class Event(NamedTuple):
    """A contact that slipped fast, from the moment at which a point reached the rate of `steps.clock.event`."""

    contact: Annotated[str, Key("", "its name")]
    start: Annotated[float, Key("s", "when a point became that fast")]
    end: Annotated[float, Key("s", "when all points were slower than a tenth of it")]
    moment: Annotated[float, Key("N m", "shear modulus of the slave times slip and area, in the plane per metre")]
    drop: Annotated[float, Key("Pa", "fall of the tangential traction, its mean by slip")]
    slip: Annotated[float, Key("m", "largest slip")]
    rate: Annotated[float, Key("m/s", "largest slip rate at the end of a step of the clock")]
    place: Annotated[tuple[float, ...], Key("m", "point that became that fast first")]


class Batch(NamedTuple):
    """A contact after a batch of the load cycles that `steps.cycle` stands for."""

    contact: Annotated[str, Key("", "its name")]
    cycles: Annotated[float, Key("", "number of cycles so far; the last one is told in steps")]
    max_wear: Annotated[float, Key("m", "largest worn depth of both sides together")]
    worn_volume: Annotated[float, Key("m³", "in the plane m²")]


class Reaction(NamedTuple):
    """Reaction of a support, or of an elastic one, on its body."""

    force: Annotated[Array, Number("N", "by component", "vector", "force")]
    moment: Annotated[Array, Number("N m", "about the origin, in the plane about z", "turn", "moment")]


class ObstacleState(NamedTuple):
    """Place of a rigid obstacle, without the part of a rotation, and its force on the bodies by all its contacts.

    The moment is about the point of its rotation, if any.
    """

    displacement: Annotated[Array, Number("m", "by component", "vector", "displacement")]
    force: Annotated[Array, Number("N", "by component", "vector", "force")]
    moment: Annotated[Array, Number("N m", "about the origin, in the plane about z", "turn", "moment")]


class ProbeValue(NamedTuple):
    """Fields at a point: the displacement, interpolated, and the stress (3, 3), of order 1 recovered."""

    displacement: Annotated[Array, Number("m", "by component", "vector", "displacement")]
    stress: Annotated[Array, Number("Pa", "xx, yy, zz, xy, yz, xz; tension is positive", "stress", "stress")]


class BodyState(NamedTuple):
    """The largest values of a body's fields."""

    max_displacement: Annotated[
        float, Number("m", "largest length of the displacement of a node", column=False, error=False)
    ]
    max_von_mises: Annotated[
        float, Number("Pa", "largest equivalent stress at the midpoint of a cell", words="largest von Mises stress")
    ]


@dataclass(frozen=True, kw_only=True)
class ContactNumbers:
    """A contact as a whole: resultants act on the side that the scene calls `surface`."""

    force: Annotated[Array, Number("N", "by component", "vector", column=False)]
    moment: Annotated[Array, Number("N m", "about the origin, in the plane about z", "turn", column=False)]
    normal_force: Annotated[float, Number("N", "integral of the pressure", words="normal force")]
    tangential_force: Annotated[
        float, Number("N", "length of the resultant of the tangential traction", words="tangential force")
    ]
    max_pressure: Annotated[float, Number("Pa", "largest pressure at contact points", words="largest pressure")]
    contact_area: Annotated[float, Number("m²", "of nodes that stick or slip", words="touching")]
    stick_area: Annotated[float, Number("m²", "of nodes that stick", words="stick")]
    slip_area: Annotated[float, Number("m²", "of nodes that slip", words="slip")]
    max_penetration: Annotated[float, Number("m", "largest penetration")]
    max_slip: Annotated[
        float, Number("m", "largest slip since t = 0 where the contact is closed", words="largest slip")
    ]
    dissipation: Annotated[float, Number("J", "work of friction, and of pressure on what wears away, in this step")]
    dissipation_total: Annotated[float, Number("J", "the same since t = 0", words="dissipated")]
    max_wear: Annotated[float | None, Number("m", "largest worn depth", words="largest wear", needs="wear")] = None
    worn_volume: Annotated[float | None, Number("m³", "worn off", words="worn volume", needs="wear")] = None
    slip_rate: Annotated[
        float | None,
        Number("m/s", "largest slip rate that friction asks for", words="largest slip rate", needs="rates"),
    ] = None
    state: Annotated[
        float | None, Number("s", "largest state theta of friction", words="oldest contact", needs="ages")
    ] = None

    @property
    def mean_pressure(self) -> Annotated[float, Number("Pa", "normal force over what touches", words="mean pressure")]:
        """Mean pressure [Pa]; 0 where nothing touches."""
        return self.normal_force / self.contact_area if self.contact_area else 0.0


@dataclass(frozen=True)
class Energy:
    """Works and energies, totals since t = 0 [J].

    In plane models they are per metre of thickness, in axisymmetric ones of the full circle. The balance is
    external = stored + contact, and contact = compliance + dissipated + time_remainder.
    """

    external: Annotated[float, Number("J", "work of loads, supports and obstacles", words="external work")]
    stored: Annotated[float, Number("J", "elastic energy", words="elastic energy")]
    contact: Annotated[float, Number("J", "work at contacts", words="contact work")]
    compliance: Annotated[float, Number("J", "stored in compliant contacts")]  # normal, and tangential by k_T
    dissipation: Array  # (contacts,) by friction, in the scene's order of contacts, >= 0 [J]; end-of-step rule

    @property
    def dissipated(self) -> Annotated[float, Number("J", "by friction and wear", words="dissipated")]:
        """Dissipation of all contacts together [J]."""
        return float(self.dissipation.sum())

    @property
    def time_remainder(self) -> Annotated[float, Number("J", "what finite steps leave of the balance", error=False)]:
        """Work of the contacts that is neither stored in their laws nor dissipated [J]: the error of time stepping.

        It vanishes with the first power of the step size. The work of closing an initial interference is part of it,
        and does not vanish.
        """
        return self.contact - self.compliance - self.dissipated


RECORDS: dict[str, RecordType] = {  # of every scene, by the table whose names it has; effects add theirs
    "contacts": ContactNumbers,
    "probes": ProbeValue,
    "supports": Reaction,
    "obstacles": ObstacleState,
    "bodies": BodyState,
    "energy": Energy,
}


def weighted(seen: Seen, field: str) -> Value:
    """Sum of the values of nodes by their weights."""
    return np.asarray(seen.weight @ getattr(seen, field))


def largest(values: Array) -> float:
    """Largest value (n,), or length of a vector (n, d); 0 without any."""
    return float((np.linalg.norm(values, axis=1) if values.ndim == 2 else values).max(initial=0.0))


def turning(seen: Seen) -> Array:
    """Moment about the origin of forces at points, (1,) or (3,) [N m]; none over a full circle."""
    turns = cross(seen.points, seen.forces + seen.turned).sum(axis=0)
    return np.asarray(seen.around[0] * np.atleast_1d(turns + seen.couple))


AGAIN: Mapping[str, Callable[[Seen], Value]] = {  # of numbers that are not seen as they are
    "force": lambda seen: np.asarray(seen.around * seen.forces.sum(axis=0)),  # radial parts balance in a full circle
    "moment": turning,
    "normal_force": lambda seen: weighted(seen, "pressure"),
    "tangential_force": lambda seen: float(np.linalg.norm(seen.around * weighted(seen, "traction"))),
    "max_pressure": lambda seen: largest(seen.peaks),
    "mean_pressure": lambda seen: weighted(seen, "pressure") / (weighted(seen, "touches") or 1.0),
    "contact_area": lambda seen: weighted(seen, "touches"),
    "stick_area": lambda seen: weighted(seen, "sticks"),
    "slip_area": lambda seen: weighted(seen, "slips"),
    "max_penetration": lambda seen: largest(seen.closing),
    "max_slip": lambda seen: largest(seen.slip[seen.touches]),
    "max_wear": lambda seen: largest(seen.wear),
    "worn_volume": lambda seen: seen.normal_weight @ seen.wear,
    "slip_rate": lambda seen: largest(seen.rates),
    "state": lambda seen: largest(seen.ages),
    "max_displacement": lambda seen: largest(seen.moved),
    "max_von_mises": lambda seen: largest(seen.von_mises),
}


@cache
def numbers_of(record: RecordType) -> dict[str, Number]:
    """The numbers of a record by name.

    >>> list(numbers_of(Reaction)), numbers_of(Energy)["dissipated"].unit
    (['force', 'moment'], 'J')
    """
    hints = get_type_hints(record, include_extras=True)
    getters = {name: found.fget for base in record.__mro__ for name, found in vars(base).items() if _is_getter(found)}
    hints |= {name: get_type_hints(getter, include_extras=True).get("return") for name, getter in getters.items()}
    said = {name: getattr(hint, "__metadata__", ()) for name, hint in hints.items()}
    return {name: part for name, parts in said.items() for part in parts if isinstance(part, Number)}


def _is_getter(found: object) -> bool:
    return isinstance(found, property) and found.fget is not None


CONTACT_NUMBERS = tuple(key for key, number in numbers_of(ContactNumbers).items() if number.column)


def singular(table: str) -> str:
    """Name of one record of a table: support, body, elastic_support."""
    return table.removesuffix("s") if not table.endswith("ies") else f"{table.removesuffix('ies')}y"


def flat_names(table: str, name: str, key: str, number: Number, size: int) -> list[str]:
    """Names of the components of a number, as goals and steps.csv have them.

    Args:
        table: of the scene, or of result.json.
        name: of the record in the table; empty: there is one only.
        size: number of the components, or of the dimensions.

    >>> flat_names("supports", "top", "moment", numbers_of(Reaction)["moment"], 2)
    ['support.top.moment.z']
    """
    owner = name if table == "contacts" else f"{singular(table)}.{name}"
    return [".".join(filter(None, (owner.strip("."), key, axis))) for axis in number.axes(size)]


def names(
    dim: int,
    owners: Iterable[tuple[str, str, RecordType]],
    lacks: Callable[[str, str], bool] = lambda name, key: True,
) -> tuple[str, ...]:
    """Names of all columns of records.

    Args:
        owners: table and name of each record.
        lacks: whether a number that `needs` a key of a record's table, by its name, lacks it.

    >>> names(2, [("contacts", "base", ContactNumbers)])[:2], names(2, [("probes", "tip", ProbeValue)])[:2]
    (('base.normal_force', 'base.tangential_force'), ('probe.tip.displacement.x', 'probe.tip.displacement.y'))
    """
    return tuple(
        found
        for table, name, record in owners
        for key, number in numbers_of(record).items()
        if number.column and not (number.needs and lacks(name, number.needs))
        for found in flat_names(table, name, key, number, dim)
    )
