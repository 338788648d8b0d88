"""All methods give one answer on the ready scenes `block`, `cube`, `cylinders`, `shrink_fit`.

Forces B^T p, resultants and displacements are compared. A method that approximates the laws runs at three levels of its
approximation: each states an error that holds, and the limit is the answer of the others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from stickslip import Scene, SceneError, Simulation, StepResult
from stickslip.geometry.arrays import Array
from stickslip.solvers.method_registry import METHODS, Solver
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.lab.verification.check import Check, problem, within
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import read

REFERENCE = "condensed-newton"  # what the other methods are compared with
ALL = tuple(method for method in METHODS if method != "auto")
SLOW = tuple(method for method in ALL if method not in (REFERENCE, "surface-uzawa"))  # on all scenes
TOLERANCE = 1e-11  # of the residual
AGREEMENT = 1e-8  # of what is compared, relative: that tolerance times the condition of these scenes
BLOCK = ("geometry.mesh_size=0.4", "geometry.contact_mesh_size=0.2")
# half of an arc never touches: as a candidate it would make the steps of Uzawa's methods 5 times smaller
CYLINDERS = (
    "geometry.mesh_size=2.0",
    "geometry.lower_mesh_size=2.7",
    "geometry.contact_mesh_size=0.4",
    "contacts.line.search_distance=0.2",
    "steps.count=2",
)
RINGS = ("geometry.mesh_size=1.0", "geometry.inner_mesh_size=0.75")
CLOSER = 0.1  # error of the limit over that of the finest level, at most
AT_ONCE = ("supports.top.displacement={x=0.05, y=-0.1}", "steps={end=1.0, count=1}")
# otherwise contact alone holds the inner ring, which not all methods can do
HELD = ("loads={}", 'supports.shaft={boundary="inner.inside", displacement={x=[[0, 0], [1, 0], [2, 5e-4]], y=0.0}}')
SCENES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "block": ("block", BLOCK),
    "block, in one step": ("block", BLOCK + AT_ONCE),
    "cube": ("cube", ("geometry.mesh_size=0.25",)),
    "cylinders": ("cylinders", CYLINDERS),
    "shrink_fit": ("shrink_fit", RINGS),
    "shrink_fit, its shaft held": ("shrink_fit", RINGS + HELD),
}
FORMS: Mapping[str, tuple[str, ...]] = {"surface-uzawa": ("condensed", "matrix-free")}  # where one method has two
# no smaller: a smoothing of 1e-9 or springs 1e8 times as stiff as cells leave too few digits of penetrations
LEVELS: Mapping[str, tuple[str, tuple[float, ...]]] = {"regularised": ("smoothing", (1e-6, 1e-7, 1e-8))}


def scene(name: str, method: str, **solver: Any) -> Scene:
    """One of the scenes, solved by a method."""
    ready, overrides = SCENES[name]
    return replace(read(ready, overrides), solver=Solver(method=method, tolerance=TOLERANCE, **solver))


def fits(name: str, method: str) -> bool:
    """Whether the method can solve the scene."""
    try:
        make_plan(scene(name, method))
    except SceneError:
        return False
    return True


@dataclass(frozen=True)
class Answer:
    """All steps, and the compared quantities: one row for each step."""

    simulation: Simulation
    steps: tuple[StepResult, ...]

    def quantities(self) -> dict[str, Array]:
        """Forces [N], resultants [N], displacements [m]: (steps, k)."""
        surface, steps = self.simulation.stepper.surface, self.steps
        return {
            "forces B^T p": np.array([surface.forces(step.p) for step in steps]),
            "resultants": np.array([_resultants(step) for step in steps]),
            "displacements": np.array([step.displacement.ravel() for step in steps]),
        }

    def energy_norm(self, other: Answer) -> Iterator[float]:
        """Energy norm of the difference from another answer, by step, relative to the largest so far; one rank only."""
        system = self.simulation.system
        apart, own = system.vector(), system.nodes.input[: system.nodes.owned]
        peak = 0.0
        for mine, theirs in zip(self.steps, other.steps, strict=True):
            peak = max(peak, theirs.energy.stored)
            apart.array[:] = (mine.displacement - theirs.displacement)[own].ravel()
            yield float(np.sqrt((system.K * apart).dot(apart) / (2 * peak)))


def _resultants(step: StepResult) -> Array:
    """Resultants on contacts and supports; the pressing force is the scale where their sum is 0."""
    found = [np.append(c.force, c.normal_force) for c in step.contacts.values()]
    found += [force for force, _ in step.supports.values()]
    return np.concatenate(found)


@lru_cache
def solve(name: str, method: str, **solver: Any) -> Answer:
    """Solve a scene by a method with the given keys."""
    simulation = prepare(scene(name, method, **solver))
    return Answer(simulation, tuple(simulation.steps()))


def apart(found: Mapping[str, Array], expected: Mapping[str, Array]) -> dict[str, float]:
    """Largest difference of each quantity over all steps, relative to its largest value in that step."""
    return {
        key: float(np.max(np.abs(found[key] - values).max(axis=1) / np.abs(values).max(axis=1)))
        for key, values in expected.items()
    }


def limit(levels: Array, found: list[dict[str, Array]]) -> dict[str, Array]:
    """Limit of the quantities for level -> 0: the polynomial through them at 0 (Richardson)."""
    weights = [np.prod([other / (other - own) for other in levels if other != own]) for own in levels]
    return {key: np.asarray(sum(w * f[key] for w, f in zip(weights, found, strict=True))) for key in found[0]}


def mixed(name: str) -> list[Check]:
    """Part of the surface sticks and part slips at the end: the answer on which the methods agree is not trivial."""
    contacts = solve(name, REFERENCE).steps[-1].contacts.values()
    return [
        within(f"{name}: share that sticks", c.stick_area / (c.stick_area + c.slip_area), 0.1, 0.9) for c in contacts
    ]


def agree(name: str, method: str, **solver: Any) -> list[Check]:
    """A method that solves the laws themselves, against the reference."""
    differences = apart(solve(name, method, **solver).quantities(), solve(name, REFERENCE).quantities())
    where = ", ".join([name, *solver.values()])
    return [Check(f"{where}: {key}, relative", off, 0.0, AGREEMENT, relative=False) for key, off in differences.items()]


def approach(name: str, method: str) -> list[Check]:
    """A method that approximates the laws: within its stated error at each level, and the reference in the limit."""
    reference, (key, values) = solve(name, REFERENCE), LEVELS[method]
    expected = reference.quantities()
    answers = [solve(name, method, **{key: value}) for value in values]
    found = []
    for value, answer in zip(values, answers, strict=True):
        stated = [step.law_error for step in answer.steps]
        share = max(np.divide(list(answer.energy_norm(reference)), stated))
        # .15: a bound a hundred times too large would be useless
        found.append(within(f"{name}, {key} = {value:g}: energy norm of its error over that stated", share, 0.15, 1.0))
    levels = np.array(values) if values[-1] < values[0] else 1 / np.array(values)
    single = apart(answers[-1].quantities(), expected)
    for what, off in apart(limit(levels, [answer.quantities() for answer in answers]), expected).items():
        found.append(Check(f"{name}, limit: {what}, relative", off, 0.0, AGREEMENT, relative=False))
        found.append(within(f"{name}, limit: {what}, over that of {key} = {value:g}", off / single[what], 0.0, CLOSER))
    return found


def compared(name: str, method: str) -> list[Check]:
    """One scene."""
    if method in LEVELS:
        return approach(name, method)
    return [check for form in FORMS.get(method, ("auto",)) for check in agree(name, method, surface=form)]


@problem("ready scenes: forces, resultants, displacements of every method are the same", methods=ALL, slow=SLOW)
def checks(method: str) -> list[Check]:
    """All scenes that the method can do."""
    if method == REFERENCE:
        return [check for name in SCENES for check in mixed(name)]
    return [check for name in SCENES if fits(name, method) for check in compared(name, method)]
