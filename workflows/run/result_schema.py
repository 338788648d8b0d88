"""What result.json holds: a record for each of its tables, with unit and meaning; its JSON schema, and its `units`.

result.py fills these records; a test holds what it writes against the schema.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, NotRequired, get_args, get_origin, get_type_hints

from pydantic import ConfigDict, TypeAdapter, with_config
from typing_extensions import TypedDict, is_typeddict

from stickslip.geometry.keys import Key
from stickslip.geometry.units import SI, Units
from stickslip.solvers.iteration import Convergence
from stickslip.solvers.results.audit import Audit
from stickslip.solvers.results.linear_reference import LinearReference
from stickslip.solvers.stepping.method_chain import Switch
from stickslip.workflows.pictures.report_results import PER_METRE

DIALECT = "https://json-schema.org/draft/2020-12/schema"
Status = Literal["converged", "doubtful", "not_converged", "no_equilibrium", "inaccurate", "interrupted"]
Vector = list[float]
Value = float | Vector
closed = with_config(ConfigDict(extra="forbid"))  # for a table whose keys are all listed


@closed
class ErrorRecord(TypedDict):
    """The error of a number, in its unit; of a vector by component. null: not computed."""

    total: Annotated[Value | None, Key("", "sum of the parts; null if one of them is")]
    mesh: Annotated[Value | None, Key("", "of the finite element space")]
    geometry: Annotated[Value | None, Key("", "of curved sides that straight ones cut")]
    time_step: Annotated[Value | None, Key("", "of the finite steps of the history")]
    law: Annotated[Value | None, Key("", "of a method's approximation of the contact laws")]
    iteration: Annotated[Value | None, Key("", "of what iterations left")]
    linear_solver: Annotated[Value | None, Key("", "of iterative volume solves")]
    converges: Annotated[bool | None, Key("", "whether the number has a limit on ever finer meshes; null: not known")]
    corrected: Annotated[Value | None, Key("", "the number with most of the mesh's error removed")]


@closed
class EnergyNorm(TypedDict):
    """Error of the displacement, relative to the largest so far, by its parts."""

    total: float | None
    mesh: float | None
    geometry: float | None
    time_step: float | None
    law: float | None
    iteration: float | None
    linear_solver: float | None
    converges: bool


@closed
class StepErrors(TypedDict):
    """Errors of the step as a whole."""

    energy_norm: EnergyNorm


Errors = Annotated[dict[str, ErrorRecord] | None, Key("", "by number; null: not estimated")]
Force = Annotated[Vector, Key("N", "by component")]
Moment = Annotated[Value, Key("N m", "about the origin, in the plane about z")]
Displacement = Annotated[Vector, Key("m", "by component")]


@closed
class Counts(TypedDict):
    """Number of the nodes of each status."""

    open: int
    slip: int
    stick: int


@closed
class ContactRecord(TypedDict):
    """A contact: resultants on the side that the scene calls `surface`."""

    force: Force
    moment: Moment
    normal_force: Annotated[float, Key("N", "integral of the pressure")]
    tangential_force: Annotated[float, Key("N", "length of the resultant of the tangential traction")]
    max_pressure: Annotated[float, Key("Pa", "largest pressure at contact points")]
    contact_area: Annotated[float, Key("m²", "of nodes that stick or slip")]
    stick_area: Annotated[float, Key("m²", "of nodes that stick")]
    slip_area: Annotated[float, Key("m²", "of nodes that slip")]
    max_penetration: Annotated[float, Key("m", "largest penetration")]
    max_slip: Annotated[float, Key("m", "largest slip since t = 0 where the contact is closed")]
    dissipation: Annotated[float, Key("J", "work of friction in this step")]
    dissipation_total: Annotated[float, Key("J", "work of friction since t = 0")]
    statuses: Annotated[Counts, Key("", "number of nodes")]
    error: Errors


@closed
class SupportRecord(TypedDict):
    """What a support exerts on its body, or an elastic one."""

    force: Force
    moment: Moment
    error: Errors


@closed
class ObstacleRecord(TypedDict):
    """Where an obstacle is, and what it exerts on bodies; the moment is about the point of its rotation, if any."""

    displacement: Displacement
    force: Force
    moment: Moment
    error: Errors


@closed
class SpringRecord(TypedDict):
    """What a spring exerts on the body at its end `at`."""

    force: Force
    error: Errors


@closed
class BoltRecord(TypedDict):
    """A bolt."""

    tension: Annotated[float, Key("N", "positive where it clamps")]
    shortening: Annotated[float, Key("m", "of its shank")]
    error: Errors


@closed
class RemotePointRecord(TypedDict):
    """A remote point, and what it exerts on its side."""

    displacement: Displacement
    rotation: Annotated[Value, Key("rad", "in the plane about z")]
    force: Force
    moment: Annotated[Value, Key("N m", "about the point")]
    error: Errors


@closed
class ProbeRecord(TypedDict):
    """Fields at a point."""

    displacement: Displacement
    stress: Annotated[Vector, Key("Pa", "xx, yy, zz, xy, yz, xz; tension is positive")]
    error: Errors


@closed
class BodyRecord(TypedDict):
    """The largest values of a body."""

    max_displacement: Annotated[float, Key("m", "largest length of the displacement of a node")]
    max_von_mises: Annotated[float, Key("Pa", "largest equivalent stress at the midpoint of a cell")]


@closed
class EnergyRecord(TypedDict):
    """Totals since t = 0."""

    external: Annotated[float, Key("J", "work of loads, supports and obstacles")]
    stored: Annotated[float, Key("J", "elastic energy")]
    contact: Annotated[float, Key("J", "work at contacts")]
    compliance: Annotated[float, Key("J", "stored in compliant contacts")]
    dissipated: Annotated[float, Key("J", "by friction")]
    time_remainder: Annotated[float, Key("J", "what finite steps leave of the balance")]
    error: Errors


@closed
class StepRecord(TypedDict):
    """A reported step."""

    time: Annotated[float, Key("s", "its end")]
    substeps: int
    iterations: int
    volume_solves: int
    residual: Annotated[float, Key("", "natural residual, relative")]
    contacts: dict[str, ContactRecord]
    supports: dict[str, SupportRecord]
    obstacles: dict[str, ObstacleRecord]
    springs: dict[str, SpringRecord]
    bolts: dict[str, BoltRecord]
    remote_points: dict[str, RemotePointRecord]
    elastic_support: dict[str, SupportRecord]
    probes: dict[str, ProbeRecord]
    bodies: dict[str, BodyRecord]
    energy: EnergyRecord
    error: StepErrors
    audit: Annotated[Audit | None, Key("", "relative defects; null: not audited")]
    convergence: Annotated[Convergence | None, Key("", "of Uzawa's iteration; null: not measured")]
    other_solutions: Annotated[list[dict[str, float]], Key("N", "normal force by contact of solutions that were met")]


@closed
class ChoiceRecord(TypedDict):
    """The first method, and why it was chosen."""

    method: str
    surface: str
    safe: bool
    because: str


@closed
class PlanRecord(TypedDict):
    """An effect."""

    effect: str
    on: bool
    because: str
    adds: str  # to the problem, and what that costs


@closed
class Unknowns(TypedDict):
    """Numbers of unknowns."""

    displacement: int
    normal: int
    tangential: int


@closed
class Counters(TypedDict):
    """What the run has done so many times."""

    unknowns: Unknowns
    dropped_multipliers: int
    forms: int
    searches: int
    factorisations: int
    schur_size: int
    volume_solves: int
    linear_iterations: int
    error_solves: int
    lanczos_applications: int
    coarse_mesh: dict[str, int] | None


@closed
class Verdict(TypedDict):
    """The audit's limits, and those that were exceeded."""

    limits: Audit
    passed: list[str]
    shared: Annotated[list[str], Key("", "what the audit takes from the code that it judges")]


@closed
class RunErrors(TypedDict):
    """Largest errors of all steps."""

    discretisation: float | None
    law: float | None
    iteration: float | None
    linear_solver: float | None
    what: str


@closed
class SecondsRecord(TypedDict):
    """Wall time by phase; all others add up to `total`."""

    imports: Annotated[float, Key("s", "loading libraries, and reading the scene; 0 in a script")]
    mesh: float
    assemble: float
    prepare: float
    iterate: float
    error: float
    audit: float
    output: float
    linear_reference: Annotated[float | None, Key("s", "of the fastest solver: the unit of cost")]
    linear_reference_others: Annotated[float | None, Key("s", "of the solvers that it was compared with")]
    other: float
    total: float


@closed
class ProfileRecord(TypedDict):
    """A phase, or a part of one; all together they are the run."""

    phase: str
    part: Annotated[str, Key("", "empty: what of the phase is in no part")]
    seconds: float
    calls: Annotated[int, Key("", "how often it began")]
    volume_solves: Annotated[int, Key("", "those for estimates of errors too")]


@closed
class GoalRecord(TypedDict):
    """A number that rounds refine for, and its error in one of them."""

    value: float
    error: float
    asked: Annotated[float, Key("", "in the number's own unit, as the error")]


@closed
class RoundRecord(TypedDict):
    """A round of solving and estimating."""

    order: int
    unknowns: int
    steps: int
    seconds: float
    goals: dict[str, GoalRecord]


@closed
class AccuracyRecord(TypedDict):
    """What became of the goals of a run; steps and errors are those of the last round."""

    met: Annotated[bool, Key("", "false: exit code 3, the budget did not reach a goal")]
    rounds: list[RoundRecord]
    scene: Annotated[str, Key("", "hash of the scene as it was asked, before refinement")]


@closed
class ResultRecord(TypedDict):
    """A run. null: not computed."""

    format: Literal[1]
    status: Annotated[Status, Key("", "exit codes: converged 0, doubtful 1, interrupted 130, the others 3")]
    sentence: Annotated[str, Key("", "what the run says at its end; empty when converged")]
    warnings: list[str]
    units: Annotated[dict[str, str], Key("", "of the numbers of a step, as table.number")]
    scene: Annotated[dict[str, Any], Key("", "the resolved scene with all defaults, and its hash")]
    version: str
    dolfinx: str
    packages: dict[str, str]
    ranks: int
    method: str
    choice: ChoiceRecord
    switches: list[Switch]
    dofs: int
    contact_points: int
    plan: list[PlanRecord]
    steps: list[StepRecord]
    counters: Counters
    audit: Annotated[Audit | None, Key("", "the largest defects of all steps")]
    verdict: Verdict | None
    error: RunErrors
    seconds: Annotated[SecondsRecord, Key("s", "wall time")]
    profile: list[ProfileRecord]
    linear_reference: LinearReference | None
    accuracy: NotRequired[AccuracyRecord]


def result_schema() -> dict[str, Any]:
    """The schema of what this version writes; a number that is not finite is null."""
    found = TypeAdapter(ResultRecord).json_schema()
    return {"$schema": DIALECT, **_nullable(found), "title": "result.json of stickslip"}


def units(plane: bool, of: Units = SI) -> dict[str, str]:
    """Units of the numbers of a step.

    Args:
        plane: whether forces, areas and energies are those of a metre of thickness.
        of: those of the scene.

    >>> units(plane=True)["contacts.normal_force"], units(plane=False)["contacts.normal_force"]
    ('N/m', 'N')
    """
    return {name: of(PER_METRE.get(unit, unit) if plane else unit) for name, unit in _units(StepRecord) if unit}


def _units(record: Any, above: str = "") -> Iterator[tuple[str, str]]:
    for name, hint in get_type_hints(record, include_extras=True).items():
        if get_origin(hint) is Annotated:
            yield f"{above}{name}", next((part.unit for part in get_args(hint) if isinstance(part, Key)), "")
        table = get_args(hint)[1] if get_origin(hint) is dict else hint
        if is_typeddict(table) and name != "error":
            yield from _units(table, f"{name}.")


def _nullable(node: Any) -> Any:
    """Numbers may be null; titles repeat the keys."""
    if isinstance(node, list):
        return [_nullable(item) for item in node]
    if not isinstance(node, Mapping):
        return node
    found = {key: _nullable(value) for key, value in node.items() if not (key == "title" and isinstance(value, str))}
    return found | {"type": ["number", "null"]} if node.get("type") == "number" else found
