"""Results of a solved step: fields, contact states, reactions, probes, energy, and errors; plain arrays, no PETSc.

Every number of a step is found by a walk over its records, see `stickslip.solvers.scene.record`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import reduce
from html import escape
from operator import add, or_
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip.geometry.arrays import SLIGHT, AnyArray, Array, Ints
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import DataFrame
from stickslip.solvers.effects import is_single, records
from stickslip.solvers.iteration import Convergence
from stickslip.solvers.parallel.serialise import Plain, deserialise, serialise
from stickslip.solvers.scene.record import (
    CONTACT_NUMBERS,
    RECORDS,
    Batch,
    BodyState,
    ContactNumbers,
    Energy,
    Event,
    Number,
    ObstacleState,
    ProbeValue,
    Reaction,
    Record,
    RecordType,
    Value,
    flat_names,
    numbers_of,
)
from stickslip.solvers.scene.record import (
    OPEN as OPEN,
)
from stickslip.solvers.scene.record import (
    SLIP as SLIP,
)
from stickslip.solvers.scene.record import (
    STATUS_WORDS as STATUS_WORDS,
)
from stickslip.solvers.scene.record import (
    STICK as STICK,
)
from stickslip.solvers.stepping.history import HistoryTuple


class Quantity(NamedTuple):
    """Key of a reported number, as it stands in result.json.

    >>> print(Quantity("contacts", "base", "normal_force"), Quantity("energy", "", "stored"))
    contacts.base.normal_force energy.stored
    """

    kind: str  # table: contacts, supports, obstacles, probes, energy, or that of an effect
    name: str  # in the table; empty for energy
    quantity: str

    def __str__(self) -> str:
        return ".".join(word for word in self if word)


@dataclass(frozen=True, kw_only=True)
class ErrorParts:
    """Error of one number by its sources, each >= 0 in the unit of the number; of a vector by component.

    None: that part is not computed. So the total, the sum of what is there, may be too small; it is None without the
    mesh's part, seldom the least, unless that was left out for its price.
    """

    mesh: Annotated[Value | None, Key("", "of the finite element space")] = None
    geometry: Annotated[Value | None, Key("", "of curved sides that straight ones cut")] = None
    time_step: Annotated[Value | None, Key("", "of the finite steps of the history")] = None
    law: Annotated[Value | None, Key("", "of a method's approximation of the contact laws")] = None
    iteration: Annotated[Value | None, Key("", "of what iterations left")] = None
    linear_solver: Annotated[Value | None, Key("", "of iterative volume solves")] = None
    converges: Annotated[
        bool | None, Key("", "whether the number has a limit on ever finer meshes; null: not known")
    ] = None
    model: Annotated[
        Value | None, Key("", "of strains and rotations taken to be small, see docs/theory/errors.md; not in the total")
    ] = None
    # else, where it is found with the step, it stands in `StepResult.corrected`
    corrected: Annotated[Value | None, Key("", "the number with most of the mesh's error removed")] = None
    by: Annotated[str | None, Key("", "what tells the mesh's part: order 2, bubbles, rough; null: not said")] = None
    unsure: Annotated[bool | None, Key("", "whether two estimates of the mesh's part differ by more than 2")] = None
    # by part: times the run that it would cost; all others that are None could not be computed at any price
    dear: Mapping[str, float] | None = None

    @property
    def lacking(self) -> dict[str, float | None]:
        """Parts that are not in the total: times the run that each would cost; None: it is not known at any price."""
        return {name: (self.dear or {}).get(name) for name in PARTS if getattr(self, name) is None}

    @property
    def total(self) -> Value | None:
        """Sum of the parts that are there, in whose order they are added."""
        parts = [part for part in (getattr(self, name) for name in PARTS) if part is not None]
        stated = self.converges is not False and (self.mesh is not None or "mesh" in (self.dear or {}))
        # not sum(): from Python 3.12 on it rounds floats, which a resumed run reads, otherwise than numpy's numbers
        return reduce(add, parts) if stated and parts else None

    @classmethod
    def added(cls, parts: Sequence[ErrorParts]) -> ErrorParts:
        """The most that a sum of several numbers is off, by its sources."""
        found = {name: [getattr(part, name) for part in parts] for name in PARTS}
        limits = [part.converges for part in parts]
        known = {
            name: None if any(x is None for x in all_of) else reduce(add, all_of) for name, all_of in found.items()
        }
        dear = {name: cost for part in parts for name, cost in (part.dear or {}).items()}
        by = ", ".join(dict.fromkeys(part.by for part in parts if part.by))
        return cls(
            **known,
            converges=None if None in limits else all(limits),
            by=by or None,
            unsure=any(part.unsure for part in parts) or None,
            dear=dear or None,
        )

    def joined(self, other: ErrorParts) -> ErrorParts:
        """The parts of both; where both have one, that of `other`."""
        known = {name: part for name, part in vars(other).items() if part is not None}
        return ErrorParts(**vars(self) | known | {"dear": {**(self.dear or {}), **(other.dear or {})} or None})


@dataclass(frozen=True)
class Slope:
    """Derivative of a number by a number of the scene: one, or two where points are at their bound; None: none."""

    value: Value | None = None
    below: Value | None = None  # by a smaller one
    above: Value | None = None  # by a larger one

    @classmethod
    def of(cls, below: Value, above: Value, rounding: float) -> Slope:
        """Of both one-sided differences; where they are one, the error of second order cancels in their mean.

        Args:
            rounding: what it leaves in them.
        """
        apart, size = np.abs(above - below).max(), max(np.abs(below).max(), np.abs(above).max())
        return cls(below=below, above=above) if apart > max(SLIGHT * size, rounding) else cls((below + above) / 2)

    @property
    def mean(self) -> Value | None:
        """The derivative, of two sides their mean; None: there is none."""
        return self.value if self.below is None or self.above is None else (self.below + self.above) / 2

    @property
    def square(self) -> Value:
        """Its square, of two sides their mean; NaN: there is none."""
        sides = (self.value,) if self.below is None else (self.below, self.above)
        found: Value = np.mean(np.square(np.asarray(sides, float)), axis=0)
        return found

    @property
    def plain(self) -> Plain:
        """A number, a vector, a table of both sides, or null."""
        sides = {"below": _plain(self.below), "above": _plain(self.above)}
        return sides if self.below is not None else _plain(self.value)


PARTS = ("mesh", "geometry", "time_step", "law", "iteration", "linear_solver")
Errors = Mapping[Quantity, ErrorParts]  # of one step


class SurfaceMesh(NamedTuple):
    """The slave side of a contact as a mesh; its nodes are in the order of `ContactState`."""

    points: Array  # (n, d) [m], undeformed
    facets: Ints  # (f, k) nodes of each facet, in dolfinx's order
    shape: str  # interval, triangle or quadrilateral


@dataclass(frozen=True, kw_only=True, repr=False)
class ContactState(ContactNumbers):
    """One contact at the end of a step, at the n nodes of its slave side and as resultants.

    Vectors have d Cartesian components. Tractions, `force` and `moment` act on the side that the scene calls `surface`,
    and slips are its own, whichever side is the slave. Pressure is positive where it presses, a gap is positive where
    it is open. In plane models resultants and areas are per metre of thickness, in
    axisymmetric ones of the full circle.
    """

    points: Array  # (n, d) undeformed [m]
    weight: Array  # (n,) area that each node stands for [m^(d-1)]; its sum is the area of the side
    gap: Array  # (n,) current gap g - u_n [m]; negative: penetration
    pressure: Array  # (n,) p_n [Pa]
    traction: Array  # (n, d) tangential traction sigma_T [Pa]
    slip: Array  # (n, d) tangential displacement of `surface` relative to the other side, since t = 0 [m]
    slip_increment: Array  # (n, d) the same, since the last accepted substep [m]
    bound: Array  # (n,) friction bound s on |sigma_T| [Pa]; inf: never slips, 0: no friction
    lam: Array  # (n, d) lambda = -sigma_T / s [-]; its length is 1 where the node slips; 0 where s = 0
    status: NDArray[np.int8]  # (n,) OPEN, SLIP or STICK
    wear: Array | None = None  # (n,) worn depth of both sides together [m]; None: nothing wears
    rate: Array | None = None  # (n,) slip rate at the end of the step [m/s]; None: friction does not know it
    moved: Array | None = None  # (n, d) displacement of the slave side [m]; None: made without it

    def columns(self) -> dict[str, AnyArray]:
        """Values at the nodes, by the columns of contact_NAME.csv but `arc`: arrays (n,); a status is a word."""
        axes = "xyz"[: self.points.shape[1]]
        vectors = (("traction", self.traction), ("slip", self.slip), ("slip_increment", self.slip_increment))
        parts = (("", self.points), *((f"{name}_", values) for name, values in (*vectors, ("lambda", self.lam))))
        (place, *at_nodes) = ({f"{name}{a}": v for a, v in zip(axes, values.T, strict=True)} for name, values in parts)
        numbers = {"weight": self.weight, "gap": self.gap, "pressure": self.pressure}
        numbers |= {key: found for key in ("wear", "rate") if (found := getattr(self, key)) is not None}
        words = {"status": np.array(STATUS_WORDS)[self.status]}
        return reduce(or_, (place, numbers, *at_nodes, words))

    def to_pandas(self) -> DataFrame:
        """The nodes as a `pandas.DataFrame`, with the same columns.

        Raises:
            ImportError: pandas is not installed.
        """
        return data_frame(self.columns())

    def counts(self) -> dict[str, int]:
        """Number of nodes that are open, slip and stick."""
        return dict(zip(STATUS_WORDS, np.bincount(self.status, minlength=3).tolist(), strict=True))

    def __repr__(self) -> str:
        said = ", ".join(f"{number} {word}" for word, number in self.counts().items())
        forces = f"normal_force={self.normal_force:.6g}, tangential_force={self.tangential_force:.6g}"
        return f"ContactState({len(self.weight)} nodes: {said}; {forces}, max_pressure={self.max_pressure:.6g})"

    def _repr_html_(self) -> str:
        """A table of the resultants, for notebooks."""
        return html_table("contact", {"": {**self.counts(), **numbers_shown(self)}})


def numbers_shown(contact: ContactNumbers) -> dict[str, float]:
    """Numbers that a contact has, by name."""
    found = {key: getattr(contact, key) for key in CONTACT_NUMBERS}
    return {key: value for key, value in found.items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """Numbers that bodies, supports, obstacles and effects report; keys are the names of the scene.

    Each table that an effect reports is an attribute too: `bolts` is `effects["bolts"]`, empty if the scene has none.
    """

    contacts: Mapping[str, ContactState]
    supports: Mapping[str, Reaction]
    obstacles: Mapping[str, ObstacleState]
    energy: Energy  # totals since t = 0 [J]
    effects: Mapping[str, Mapping[str, Record]] = field(default_factory=dict)  # records by table and name
    sums: Mapping[str, ContactNumbers] = field(default_factory=dict)  # of each contact with several partners

    def parts(self, name: str) -> dict[str, ContactState]:
        """Contacts that make up a sum, with each partner one, by name."""
        return {pair: contact for pair, contact in self.contacts.items() if pair.startswith(f"{name}.")}

    def __getattr__(self, name: str) -> Mapping[str, Record]:
        """A table of an effect.

        Raises:
            AttributeError: no effect reports one of this name.
        """
        if name.startswith("_") or name in RECORDS or name not in records():
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return self.effects.get(name, {})


@dataclass(frozen=True, kw_only=True, repr=False)
class StepResult(Numbers):
    """The solution at a requested time.

    Nodes and cells are in the order of the gmsh model, whatever the number of ranks. `displacement`, `stress` and
    `stress_error` are on rank 0 (empty elsewhere), all else is on every rank. Mappings have the names of the scene as
    keys. d is 2 or 3.
    """

    time: Annotated[float, Number("s", "its end")]
    substeps: Annotated[int, Number("", "number of parts that it was solved in; 1 if it succeeded as a whole")]
    iterations: Annotated[int, Number("", "of all substeps, failed attempts included")]
    volume_solves: Annotated[int, Number("", "applications of K_B^-1 in this step")]
    residual: Annotated[float, Number("", "natural residual, relative")]  # of the contact laws at the end
    displacement: Array  # (nodes, d) [m]
    stress: Array  # (cells, 3, 3) at the midpoints [Pa], tension positive
    probes: Mapping[str, ProbeValue]
    iteration_error: float  # bound on what iterations left, energy norm, relative to the largest [-]; nan: unknown
    mesh_error: float  # estimate of what the mesh leaves, energy norm, relative to the largest [-]; nan: none
    stress_error: Array  # (cells,) the same as an error of the stress [Pa], see `MeshError`; empty: not estimated
    law_error: float  # the same by the method's approximation of the contact laws, earlier steps included [-]
    p: Array  # (rows,) tractions, flat [Pa]; for the audit and the next step
    w: Array  # (rows,) relative displacement, flat [m]
    reference: Array  # (rows,) that the contact laws subtract from w [m]: the gap, and the slip at the substep's start
    driven: Array  # (o,) displacement of the obstacles that forces drive [m], for the audit
    shortened: Array  # (b,) that are found: shortening of bolts by force, slack of springs of one way [m]
    searched: Mapping[str, Array]  # by sliding contact, displacement (n_all, d) that its pairs were searched at [m]
    memory: Mapping[str, Array]  # by contact whose friction remembers slip: its length so far [m], or rate [m/s] (m_t,)
    p_ref: float  # scale of tractions: of statuses, and of what counts as none [Pa]
    u_ref: float  # scale of relative displacements: of statuses [m]
    history: tuple[HistoryTuple, ...]  # each iteration: time, iteration, residual, volume solves, seconds, method
    weakening: float = 0.0  # how much faster than bodies unload friction weakened by slip [-]; above 1 slip jumped
    linear_error: float = 0.0  # error left by an iterative volume solve, energy norm, relative [-]; 0: direct solver
    convergence: Convergence | None = None  # of Uzawa's iteration, from methods that measure it
    other_solutions: tuple[Mapping[str, float], ...] = ()  # that friction admits: normal force by contact [N]
    unique: Literal["proved", "several", "not proved"] = "not proved"  # whether friction admits one solution
    jump: float | None = None  # energy [J] set free where no solution goes on from the step before; None: one does
    corrected: Mapping[str, Value] = field(default_factory=dict)  # by `Quantity`: most of the mesh's error removed
    errors: Mapping[str, ErrorParts] = field(default_factory=dict)  # by `Quantity`, but for those of the time steps
    sensitivity: Mapping[str, Mapping[str, Slope]] = field(default_factory=dict)  # by `Quantity`, and by scene's number
    covariance: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # of the uncertain ones of these
    bodies: Mapping[str, BodyState] = field(default_factory=dict)
    events: tuple[Event, ...] = ()  # that ended in this step, of a clock
    batches: tuple[Batch, ...] = ()  # of load cycles in this step, of `steps.cycle`
    columns: Mapping[str, float] = field(default_factory=dict)  # numbers that effects add to steps.csv, by column

    def __repr__(self) -> str:
        return f"StepResult(time={self.time:g}, {len(self.displacement)} nodes, contacts={dict(self.contacts)})"

    def _repr_html_(self) -> str:
        """A table of the contacts' resultants, for notebooks."""
        numbers = {name: numbers_shown(c) for name, c in self.contacts.items()}
        return html_table(f"t = {self.time:g}", numbers)

    def without_fields(self) -> StepResult:
        """The same, fields of nodes and cells empty: their memory grows with the mesh."""
        nothing = np.zeros(0)
        return replace(self, displacement=np.zeros((0, 0)), stress=np.zeros((0, 3, 3)), stress_error=nothing)

    @property
    def von_mises(self) -> Array:
        """Equivalent stress (cells,) [Pa], >= 0; on rank 0 (empty elsewhere)."""
        return von_mises(self.stress)


def tables_of(step: Numbers) -> dict[str, Mapping[str, Record]]:
    """All records of a step by table and name; that of a table without names is at ""."""
    own = {f.name for f in fields(step)} - {"energy"}
    tables = {table: getattr(step, table) for table in RECORDS if table in own}
    tables["contacts"] = dict(step.contacts) | dict(step.sums)
    return tables | dict(step.effects) | {"energy": {"": step.energy}}


def walk(step: Numbers) -> Iterator[tuple[Quantity, Number, Value]]:
    """Every number that a step reports, in SI units: its key, what is declared of it, and its value."""
    kinds = records()
    for table, by_name in tables_of(step).items():
        for name, record in by_name.items():
            for key, number in numbers_of(kinds[table]).items():
                if (found := getattr(record, key)) is not None:
                    yield Quantity(table, name, key), number, number.value(found)


def quantities(step: Numbers) -> dict[Quantity, Value]:
    """Every number of a step whose error is estimated: floats, and vectors (k,) by component."""
    return {key: value for key, number, value in walk(step) if number.error}


def values(step: Numbers) -> dict[str, float]:
    """All numbers of a step by name: base.normal_force, probe.tip.stress.xx, energy.stored.

    `Scene.quantities` gives the same names before anything is solved.
    """
    columns = ((key, value) for key, number, value in walk(step) if number.column)
    return {name: _part(value, axis) for key, value in columns for name, axis in names_of(key, value)}


def total_errors(step: StepResult, errors: Errors) -> dict[str, float]:
    """Total error of every number by the names that `values` has; NaN: not known."""
    found: dict[str, float] = {}
    for key, value in quantities(step).items():
        total = errors[key].total if key in errors else None
        parts = np.full(np.shape(value), np.nan if total is None else total)
        found |= {name: _part(parts, axis) for name, axis in names_of(key, value)}
    return found


def names_of(key: Quantity, value: Value) -> Sequence[tuple[str, int | None]]:
    """Names of a number as `values` has them, and the component that each is; None: it has no components."""
    found = flat_names(key.kind, key.name, key.quantity, number_of(key), np.size(value))
    return [(name, axis if np.ndim(value) else None) for axis, name in enumerate(found)]


def number_of(key: Quantity) -> Number:
    """Declaration of a number."""
    return numbers_of(records()[key.kind])[key.quantity]


def _part(value: Value, axis: int | None) -> float:
    return float(value if axis is None else np.asarray(value)[axis])


def to_plain(step: StepResult) -> Plain:
    """A step as plain data, which a file may hold; tables of effects stand beside the others."""
    plain = serialise(step)
    return plain | plain.pop("effects")


def from_plain(plain: Plain) -> StepResult:
    """The step to the same bits.

    Raises:
        KeyError: something is missing.
    """
    found = {
        table: {name: deserialise(record, value) for name, value in plain[table].items()}
        for table, record in records().items()
        if table not in RECORDS and plain.get(table)
    }
    return deserialise(StepResult, {"sensitivity": {}, "covariance": {}} | plain, effects=found)


def told(step: StepResult, errors: Errors | None) -> Plain:
    """A step as plain data of dicts, lists and numbers, as result.json has it; its errors are null if they are None."""
    found: dict[str, Plain] = {table: {} for table in records()}
    for table, by_name in tables_of(step).items():
        found[table] = {name: {} for name in by_name}
    for key, _, value in walk(step):
        found[key.kind][key.name][key.quantity] = _plain(value)
    for name, contact in step.contacts.items():
        found["contacts"][name]["statuses"] = contact.counts()
    for name in step.sums:
        each = [contact.counts() for contact in step.parts(name).values()]
        found["contacts"][name]["statuses"] = {word: sum(counts[word] for counts in each) for word in STATUS_WORDS}
    for table, record in records().items():
        for name, own in found[table].items() if is_estimated(record) else ():
            stated = {
                key.quantity: _parts(parts)
                | {"model": _plain(parts.model), "corrected": _plain(_corrected(step, key, parts))}
                | {"by": parts.by, "unsure": parts.unsure, "lacking": parts.lacking}
                for key, parts in (errors or {}).items()
                if key[:2] == (table, name)
            }
            own["error"] = stated or None
            own |= _by_inputs(step, (table, name), errors or {})
    return {
        **{key: getattr(step, key) for key in numbers_of(StepResult)},
        **{table: by_name.get("") if is_single(table) else by_name for table, by_name in found.items()},
        "error": {"energy_norm": energy_norm(step)},
        "convergence": step.convergence and asdict(step.convergence),
        "other_solutions": [dict(forces) for forces in step.other_solutions],
        "unique": step.unique,
        "jump": step.jump,
    }


def _by_inputs(step: StepResult, owner: tuple[str, str], errors: Errors) -> Plain:
    """Derivatives of the numbers of a record, and its uncertainties; nothing where the scene asks for none."""
    slopes = {
        key: step.sensitivity[str(key)] for key in quantities(step) if key[:2] == owner and str(key) in step.sensitivity
    }
    if not slopes:
        return {}
    found = {"sensitivity": {key.quantity: {by: s.plain for by, s in own.items()} for key, own in slopes.items()}}
    if step.covariance:
        by_inputs = {key.quantity: uncertainty(own, step.covariance, errors.get(key)) for key, own in slopes.items()}
        found["uncertainty"] = by_inputs
    return found


def uncertainty(
    slopes: Mapping[str, Slope], covariance: Mapping[str, Mapping[str, float]], error: ErrorParts | None
) -> Plain:
    """Standard uncertainty of a number, k = 1, by those of the scene's numbers and by its own error, to first order.

    The stated error is half the width of an interval: its standard uncertainty is that of a uniform distribution in it.
    Where a derivative has two sides it is the root mean square of both, beside those of other numbers their mean; null
    where there is none. What two correlated numbers cause together is shared half and half.

    Args:
        slopes: derivatives of the number.
        covariance: of uncertain numbers, by both.
        error: of the number.

    Source: Evaluation of measurement data: Guide to the expression of uncertainty in measurement, JCGM 100 (2008), 5.1.
    """
    means = {by: mean for by in covariance if (mean := slopes[by].mean) is not None}
    if len(means) < len(covariance):
        return {"inputs": None, "combined": None, "shares": None}
    beside = {by: sum(row[other] * means[other] for other in row if other != by) for by, row in covariance.items()}
    known = {by: slopes[by].square * row[by] + means[by] * beside[by] for by, row in covariance.items()}
    variance, total = reduce(add, known.values()), None if error is None else error.total
    some = np.where(variance > 0, variance, 1.0)
    return {
        "inputs": _plain(np.sqrt(variance)),
        "combined": None if total is None else _plain(np.sqrt(variance + np.square(total) / 3)),
        "shares": {by: _plain(part / some) for by, part in known.items()},
    }


def slopes_of(step: StepResult) -> dict[str, dict[str, tuple[float, float]]]:
    """Derivatives by the names that `values` has, and by number of the scene, by a smaller and by a larger one.

    Those that there are none of are left out.
    """
    found = dict[str, dict[str, tuple[float, float]]]()
    for key, value in quantities(step).items():
        both = {by: (s.below, s.above) if s.below is not None else (s.value, s.value) for by, s in _slopes(step, key)}
        known = {by: (low, high) for by, (low, high) in both.items() if low is not None and high is not None}
        for name, axis in names_of(key, value) if known else ():
            found[name] = {by: (_part(low, axis), _part(high, axis)) for by, (low, high) in known.items()}
    return found


def _slopes(step: StepResult, key: Quantity) -> Iterable[tuple[str, Slope]]:
    return step.sensitivity.get(str(key), {}).items()


def slope_columns(step: StepResult) -> dict[str, float]:
    """Derivatives by column, NAME.sensitivity.NUMBER, and uncertainties by inputs; NaN: none, or two sides."""
    found = dict[str, float]()
    for key, value in quantities(step).items() if step.sensitivity else ():
        slopes = step.sensitivity.get(str(key), {})
        uncertain = step.covariance and slopes
        inputs = uncertainty(slopes, step.covariance, None)["inputs"] if uncertain else None
        for name, axis in names_of(key, value):
            each = {f"{name}.sensitivity.{by}": slope.value for by, slope in slopes.items()}
            each |= {f"{name}.uncertainty": inputs} if uncertain else {}
            found |= {column: np.nan if known is None else _part(known, axis) for column, known in each.items()}
    return found


def _corrected(step: StepResult, key: Quantity, parts: ErrorParts) -> Value | None:
    return step.corrected.get(str(key)) if parts.corrected is None else parts.corrected


def is_estimated(record: RecordType) -> bool:
    """Whether some of its numbers have errors."""
    return any(number.error for number in numbers_of(record).values())


def energy_norm(step: StepResult) -> Plain:
    """Error of the displacement, relative to the largest so far, by its parts; null: not computed, nor is the total."""
    parts = ErrorParts(mesh=step.mesh_error, law=step.law_error, iteration=step.iteration_error, converges=True)
    return _parts(parts) | {"total": None, "linear_solver": step.linear_error}


def _parts(parts: ErrorParts) -> Plain:
    """The error of one number, in its unit; null: not computed."""
    found = {name: getattr(parts, name) for name in ("total", *PARTS, "converges")}
    return {name: _plain(value) for name, value in found.items()}


def _plain(value: object) -> Plain:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


@dataclass(frozen=True, kw_only=True, repr=False)
class MeshData:
    """The mesh as plain arrays in the order of the gmsh model.

    `points`, `cells`, `body` and `slaves` are on rank 0 (empty elsewhere), all else is on every rank.
    """

    points: Array  # (nodes, d) [m], undeformed
    cells: Ints  # (cells, k) rows of `points`, in dolfinx's order of a cell's nodes
    shape: str  # of the cells: triangle, quadrilateral, tetrahedron or hexahedron
    body: Ints  # (cells,) index into `bodies`
    bodies: tuple[str, ...]
    surfaces: Mapping[str, SurfaceMesh]  # by contact
    slaves: Mapping[str, Ints] = field(default_factory=dict)  # by contact, (n,) rows of `points` of its surface
    gaps: Mapping[str, Array] = field(default_factory=dict)  # by contact, (n,) initial gap [m]

    def __repr__(self) -> str:
        found = f"{len(self.cells)} cells ({self.shape}), {len(self.points)} nodes, bodies {', '.join(self.bodies)}"
        return f"MeshData({found})"


def von_mises(stress: Array) -> Array:
    """Equivalent stress (cells,) [Pa] of stresses (cells, 3, 3)."""
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    return np.asarray(np.sqrt(1.5 * np.einsum("cij,cij->c", deviator, deviator)))


def data_frame(content: Mapping[str, AnyArray] | Sequence[Mapping[str, object]]) -> DataFrame:
    """A `pandas.DataFrame` of columns by name, or of rows.

    Raises:
        ImportError: pandas is not installed.
    """
    try:
        import pandas
    except ModuleNotFoundError:
        line = "to_pandas: pandas is not installed; pip install pandas (Debian 12: pip install pandas 'numpy<2')"
        raise ImportError(line) from None
    return pandas.DataFrame(content)


def html_table(title: str, numbers: Mapping[str, Mapping[str, float | str]]) -> str:
    """Names and numbers, or what is said of these, as a table of HTML: a column for each name, a row for each number.

    >>> html_table("t = 1", {"base": {"force": 2.0}})
    '<table><tr><th>t = 1</th><th>base</th></tr><tr><td>force</td><td>2</td></tr></table>'
    """
    rows = dict.fromkeys(row for column in numbers.values() for row in column)
    head = "".join(f"<th>{escape(text)}</th>" for text in (title, *numbers))
    said = {row: [n if isinstance(n := c[row], str) else f"{n:.6g}" for c in numbers.values()] for row in rows}
    lines = [f"<td>{escape(row)}</td>" + "".join(f"<td>{n}</td>" for n in cells) for row, cells in said.items()]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in (head, *lines))}</table>"
