"""Derivatives of the numbers of a step by numbers of the scene, and what the uncertainty of these leaves in them.

Differences of a solution's neighbours are read by the same walk as the solution itself: see `Neighbours`. An area is a
sum of weights of nodes, which no small change alters: its derivative is that of the area with its edge between nodes,
and none where there is no edge.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import ROUNDING
from stickslip.geometry.errors import SceneError, StickslipError
from stickslip.geometry.mesh.mesh import Mesh, build_mesh
from stickslip.solvers.accuracy.areas import areas_inside_facets
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import Quantity, Slope, number_of, quantities
from stickslip.solvers.scene.parameters import scaled
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.record import Value
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.stepping.sensitivity import STEP, Neighbours, beside, refuse
from stickslip.solvers.stepping.stepper import Accepted, Stepper
from stickslip.solvers.stepping.substep import SubstepSolver
from stickslip.solvers.system.system import System, assemble

log = logging.getLogger(__name__)
WITHOUT_STIFFNESS = ("contacts", "obstacles", "supports", "loads")  # tables that the stiffness of bodies does not see
OTHER_CELLS = "another value gives a mesh of other cells, so that differences are those of meshes"
AREAS = ("contact_area", "stick_area", "slip_area")


def neighbours(scene: Scene, stepper: Stepper) -> Neighbours | None:
    """The neighbours that a scene asks for, on the mesh of its solution; None: it asks for none.

    Raises:
        SceneError: a number has no derivative that could be found, with the reason.
    """
    asked, values = scene.derived_by, scene.parameters()
    if not asked:
        return None
    bolts = stepper.system.initial.tightened
    if bolts:
        names = ", ".join(f"{bolt.shortening.table}.{bolt.shortening.name}" for bolt in bolts)
        raise SceneError(f"sensitivity: is not built for {names}, whose lengths are found by solving each step again")
    refuse(stepper)
    pairs = dict[str, tuple[SubstepSolver, SubstepSolver]]()
    for key in asked:
        try:
            below, above = (
                beside(stepper, _changed(scene, stepper.system, key, sign * STEP))
                for sign in np.sign([-values[key], values[key]])
            )
        except StickslipError as error:
            if key in scene.sensitivity.parameters or key in scene.uncertainty:
                raise SceneError(f"sensitivity: {key}: {error}") from None
            log.warning("sensitivity: %s is left out: %s", key, error)
        else:
            pairs[key] = below, above
    return Neighbours(stepper, pairs)


def _changed(scene: Scene, system: System, key: str, by: float) -> System:
    """The scene with a number multiplied by 1 + `by`, assembled on the same cells.

    Raises:
        SceneError: its mesh has other cells.
    """
    problem, mesh = resolve(scaled(scene, key, 1 + by)), system.mesh
    if problem.shape != system.problem.shape:
        mesh = _remeshed(problem, mesh)
    found = assemble(problem, mesh, Counters())
    if mesh is not system.mesh and not np.array_equal(dx.cell_dofs(found.space), dx.cell_dofs(system.space)):
        raise SceneError(OTHER_CELLS)
    alike = key.partition(".")[0] in WITHOUT_STIFFNESS
    return replace(found, assembled=system.assembled) if alike else found


def _remeshed(problem: Problem, mesh: Mesh) -> Mesh:
    """The mesh of a changed shape.

    Raises:
        SceneError: it has other cells.
    """
    found = build_mesh(problem.shape, problem.request, mesh.comm)
    if found.sides != mesh.sides or found.domain.geometry.x.shape != mesh.domain.geometry.x.shape:
        raise SceneError(OTHER_CELLS)
    return found


class Slopes:
    """Reads the derivatives of the numbers of a step off its neighbours."""

    def __init__(self, scene: Scene, observer: Observer, neighbours: Neighbours) -> None:
        """Prepare to read each neighbour; of probes the strain is compiled.

        Args:
            observer: of the solution.
            neighbours: of it.
        """
        self.neighbours, own, values = neighbours, observer.without_errors(), scene.parameters()
        self.by = {key: STEP * abs(values[key]) for key in neighbours.keys}
        self._observers = [
            Observer.of(solver) if own.probes and at else replace(own, stepper=solver)
            for at, solver in enumerate(neighbours.solvers)
        ]

    def __call__(self, accepted: Accepted) -> dict[str, dict[str, Slope]]:
        """By `Quantity`, and by number of the scene."""
        own, *others = (self._numbers(at, observer, accepted) for at, observer in enumerate(self._observers))
        sizes, slopes = dict[str, float](), dict[str, dict[str, Slope]]()
        for quantity, value in own.items():
            unit = number_of(quantity).unit
            sizes[unit] = max(sizes.get(unit, 0.0), float(np.abs(value).max()))
        for (key, by), below, above in zip(self.by.items(), others[::2], others[1::2], strict=True):
            for quantity, value in own.items():
                one, two = (value - below[quantity]) / by, (above[quantity] - value) / by
                slope = Slope.of(one, two, ROUNDING * sizes[number_of(quantity).unit] / by)
                if quantity.quantity in AREAS:  # one whose nodes change jumps
                    slope = Slope((one + two) / 2 if np.abs(one - two) < np.abs(one + two) / 2 else None)
                slopes.setdefault(str(quantity), {})[key] = slope
        return slopes

    def _numbers(self, at: int, observer: Observer, accepted: Accepted) -> dict[Quantity, Value]:
        """The numbers of a neighbour; collective."""
        near = replace(
            accepted,
            stepper=self.neighbours.solvers[at],
            state=accepted.state.neighbours[at],
            start=accepted.start.neighbours[at],
            substep_start=accepted.substep_start.neighbours[at],
        )
        numbers = observer.numbers(near)
        found = quantities(numbers) | areas_inside_facets(near.stepper.system.contacts, numbers)
        return found | observer.at_probes(near)
