"""Judges one varied scene: its own audit, a second method, and a twin scene whose answer is known to be the same."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from time import process_time

import numpy as np

from stickslip import (
    GeometryError,
    NoEquilibriumError,
    Scene,
    SceneError,
    Simulation,
    Solver,
    Status,
    StepResult,
    StickslipError,
)
from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.limit_analysis import Balance
from stickslip.solvers.results.audit import Audit, Auditor
from stickslip.solvers.results.stored_fields import Record
from stickslip.solvers.results.verdict import passed
from stickslip.solvers.simulation.plan import refusals
from stickslip.solvers.simulation.resolve import resolve
from stickslip.workflows.lab.verification.hard.variations import Scale
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.lab.verification.units import Units
from stickslip.workflows.run.warnings import reasons_to_doubt

SECOND = ("nsgs", "surface-uzawa", "uzawa")  # the first of these that can solve the scene gives a second opinion
TOLERANCE = 1e-10  # of the second opinion
ITERATIONS = 3000  # of the second opinion
AGREEMENT = 1e-3  # of forces and displacements, relative to the largest: tolerance times condition
CONDITION = 300.0  # the latter, where a run has a loose tolerance; measured: 210 (`sphere`), 36 (`half_disc`), 19
MESH = 1e-9  # relative difference of where the nodes are, up to which meshes are the same
TWIN = 1e-5  # of a twin's forces and displacements
EVEN = 0.1  # share by which a twin's iterations may differ: rounding decides ties
AGREES, DIFFERS = "agrees", "differs"  # words for a twin that was compared
ELSEWHERE, NONE, SEVERAL = "other mesh", "no answer", "several solutions"  # and for one that was not
OWN = Scale()


class Outcome(Enum):
    """Ending of a variation; the values are the words of the page."""

    SOLVED = "solved"
    BRANCH = "solved, several solutions"  # others were met, or a second method found one: all satisfy all conditions
    PROVED = "no equilibrium, proved"
    UNDECIDED = "near a limit, undecided"  # of floating bodies: neither an equilibrium nor its absence is proved
    REFUSED = "refused"
    FAILED = "failed"
    DOUBTFUL = "doubtful"  # an answer that its own audit does not vouch for: the run ends with exit code 1
    WRONG = "wrong"


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The outcome of one variation."""

    outcome: Outcome
    reason: str = ""
    held: bool = True  # by supports alone: neither a body nor an obstacle follows from forces
    iterations: int = 0
    seconds: float = 0.0  # of the run itself, without the other judges
    second: str = ""  # what the second opinion is: a method's name and its word
    twin: str = ""  # what became of the twin, in one of the words above; empty: there is none


@dataclass(frozen=True)
class Solved:
    """A scene and its answer."""

    simulation: Simulation
    steps: tuple[StepResult, ...]

    @cached_property
    def complaints(self) -> tuple[str, ...]:
        """Complaints of the audit, and what else makes the answer doubtful."""
        auditor = Auditor(self.simulation.problem, self.simulation.mesh)
        audits, before = list[Audit](), None
        for step in self.steps:
            record = Record.of(step)
            audits.append(auditor(record, before if step.substeps == 1 else None))
            before = record
        times, errors = [s.time for s in self.steps], [s.law_error for s in self.steps]
        found = passed(audits, times, errors, self.simulation.scene.solver.tolerance)
        return (*found, *reasons_to_doubt(self.simulation, self.steps))

    @property
    def spread(self) -> float:
        """Root of the sum of the nodes' squared distances from their middle [m]: tells meshes apart."""
        points = self.simulation.data.points
        return float(np.linalg.norm(points - points.mean(axis=0)))

    @property
    def iterations(self) -> int:
        return sum(step.iterations for step in self.steps)

    def quantities(self) -> dict[str, tuple[str, Array]]:
        """Unit, and numbers (steps, k): resultants, and displacements of each step; signs of components left out."""
        return {
            "resultants": ("N", np.array([_resultants(step) for step in self.steps])),
            "displacement": ("m", np.array([[np.linalg.norm(step.displacement)] for step in self.steps])),
        }

    def nodal(self) -> Array:
        """Contact forces B^T p on all displacements (steps, k) [N]; none where contact slides: its rows change."""
        if any(step.searched for step in self.steps):
            return np.zeros((0, 0))
        stepper = self.simulation.stepper
        return np.array([stepper.system.interface.forces(*stepper.split(step.p)).array for step in self.steps])


def _resultants(step: StepResult) -> Array:
    found = [np.append(c.force, [c.normal_force, c.tangential_force]) for c in step.contacts.values()]
    found += [force for force, _ in step.supports.values()]
    return np.asarray(np.abs(np.concatenate([np.zeros(1), *found])))


def solve(scene: Scene) -> Solved:
    """Solve all steps; raises what `prepare` and `steps` raise."""
    simulation = prepare(scene)
    return Solved(simulation, tuple(simulation.steps()))


def supported(scene: Scene) -> bool:
    """Whether supports alone hold all bodies, and no obstacle follows from a force; nothing is meshed."""
    problem = resolve(scene)
    return not (problem.rigid_modes.shape[1] or problem.driven)


def judge(scene: Scene, twin: Scene | None = None, scale: Scale = OWN) -> Iterator[Verdict]:
    """Solve and judge a scene; the verdict without the second opinion first, for that may never come.

    Args:
        twin: a scene of the same answer, if there is one.
        scale: one metre and one newton of the scene, in units of the twin.
    """
    began, held = process_time(), True
    try:
        held = supported(scene)
        own = solve(scene)
    except (SceneError, GeometryError) as error:
        yield Verdict(outcome=Outcome.REFUSED, reason=str(error), held=held)
        return
    except NoEquilibriumError as error:
        yield Verdict(
            outcome=Outcome.WRONG if held else Outcome.PROVED,
            reason=("supports hold the bodies, but: " if held else "") + str(error),
            held=held,
            seconds=process_time() - began,
        )
        return
    except StickslipError as error:
        seconds = process_time() - began
        yield Verdict(outcome=_without_answer(str(error)), reason=str(error), held=held, seconds=seconds)
        return
    first = Verdict(outcome=Outcome.SOLVED, held=held, iterations=own.iterations, seconds=process_time() - began)
    others = max((len(step.other_solutions) for step in own.steps), default=0)
    if others:
        first = replace(first, outcome=Outcome.BRANCH, reason=f"{others} other solutions were met")
    if twin is not None:
        word, wrong = (SEVERAL, "") if others else _against_twin(own, twin, scale)  # it may take another one
        first = replace(first, twin=word)
        if wrong:
            first = replace(first, outcome=Outcome.WRONG, reason=wrong)
    if own.complaints:
        first = replace(first, outcome=Outcome.DOUBTFUL, reason="; ".join(own.complaints))
    yield first
    yield _with_second_opinion(first, own)


def _without_answer(sentence: str) -> Outcome:
    """The outcome of a run that ended with this sentence."""
    if Balance.UNDECIDED.value in sentence:
        return Outcome.UNDECIDED
    return Outcome.REFUSED if Status.APART.value in sentence else Outcome.FAILED


def _against_twin(own: Solved, scene: Scene, scale: Scale) -> tuple[str, str]:
    """Compare with the twin: what became of it in a word, and how the answer differs from it."""
    try:
        twin = solve(scene)
    except StickslipError:
        return NONE, ""  # judged where it is a variation itself
    if abs(own.spread - scale.length * twin.spread) > MESH * own.spread:
        return ELSEWHERE, ""  # the last digits of a mesh size let gmsh place its nodes otherwise
    if len(own.steps) != len(twin.steps):  # a clock has them where events begin and end
        return DIFFERS, f"twin: {len(own.steps)} steps, not {len(twin.steps)}"
    wrong = "; ".join(_differences(own, twin, scale))
    return (DIFFERS if wrong else AGREES), wrong


def _differences(own: Solved, twin: Solved, scale: Scale) -> Iterator[str]:
    """Differences of the answer from that of the twin, on the same mesh."""
    units = Units(length=scale.length, force=scale.force, plane=own.simulation.scene.model.startswith("plane"))
    theirs, clock = twin.quantities(), own.simulation.scene.steps.clock
    near = TWIN if clock is None else max(TWIN, clock.error)  # rounding moves its steps
    for key, (unit, mine) in own.quantities().items():
        off = apart(mine / units.factor(unit), theirs[key][1])
        if not off <= near:
            yield f"twin: {key} differ by {off:.1e}"
    if abs(own.iterations - twin.iterations) > max(1.0, EVEN * twin.iterations):
        yield f"twin: {own.iterations} iterations, not {twin.iterations}"


def _with_second_opinion(verdict: Verdict, own: Solved) -> Verdict:
    scene = own.simulation.scene
    candidates = (
        replace(scene, solver=Solver(method=name, tolerance=TOLERANCE, max_iterations=ITERATIONS)) for name in SECOND
    )
    asked = next(
        (c for c in candidates if c.solver.method != scene.solver.method and not any(refusals(resolve(c)))), None
    )
    if asked is None:
        return verdict
    name = asked.solver.method
    try:
        other = solve(asked)
    except StickslipError as error:
        if isinstance(error, NoEquilibriumError):
            return replace(verdict, outcome=Outcome.WRONG, reason=f"{name}: {error}", second=f"{name}: no equilibrium")
        return replace(verdict, second=f"{name}: none")
    off = _differences_of_methods(own, other)
    worst = max(off, key=lambda key: off[key])
    near = max(AGREEMENT, CONDITION * scene.solver.tolerance)
    if all(value <= near for value in off.values()):
        return replace(verdict, second=f"{name}: agrees")
    said = f"{name}: {worst} differ by {off[worst]:.1e}"
    if other.complaints:
        return replace(verdict, second=f"{name}: no use, {other.complaints[0]}")
    if verdict.outcome not in (Outcome.SOLVED, Outcome.BRANCH):
        return replace(verdict, reason=f"{verdict.reason}; {said}", second=said)
    wrong = [key for key in _unique(scene, verdict.held) if not off[key] <= near]
    if wrong:
        reason = "; ".join(f"{name}: {key} differ by {off[key]:.1e}" for key in wrong)
        return replace(verdict, outcome=Outcome.WRONG, reason=reason, second=said)
    return replace(verdict, outcome=Outcome.BRANCH, reason=verdict.reason or said, second=said)


def _differences_of_methods(own: Solved, other: Solved) -> dict[str, float]:
    """Relative differences by quantity; 0 of nodal forces where contact slides."""
    mine, theirs = own.quantities(), other.quantities()
    if len(own.steps) != len(other.steps):
        return dict.fromkeys([*mine, "nodal forces"], np.inf)
    nodal, others = own.nodal(), other.nodal()
    found = {key: apart(mine[key][1], theirs[key][1]) for key in mine}
    return found | {"nodal forces": apart(nodal, others) if nodal.size and others.size else 0.0}


def _unique(scene: Scene, held: bool) -> tuple[str, ...]:
    """Quantities of which there is only one answer: without friction an energy is least, convex in the displacements.

    Strains and forces follow from that; displacements too where supports hold the bodies.
    """
    smooth = all(c.friction is None or not c.friction.resists() for c in scene.contacts.values())
    if not smooth or any(c.sliding for c in scene.contacts.values()):
        return ()
    return ("resultants", "nodal forces", *(["displacement"] if held else []))


def apart(found: Array, expected: Array) -> float:
    """Largest difference of numbers (steps, k), relative to the largest of all steps.

    Raises:
        ValueError: they are not of the same steps and places.
    """
    if found.shape != expected.shape:
        raise ValueError(f"numbers of shape {found.shape} cannot be compared with others of {expected.shape}")
    size = np.abs(expected).max(initial=0.0)
    off = np.abs(found - expected).max(initial=0.0)
    return float(off / size if size else off)
