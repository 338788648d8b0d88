"""All that a script imports, by name: `stickslip.NAME` is taken from here when it is first asked for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from stickslip.geometry.builders import Builder
from stickslip.geometry.builders.blocks import Stack, TwoBlocks
from stickslip.geometry.builders.cuboid import Block, Strip
from stickslip.geometry.builders.domes import Cylinders, HalfBall, HalfDisc, Spheres
from stickslip.geometry.builders.half_space import HalfSpace
from stickslip.geometry.builders.ring import Arch, Ring, Rings
from stickslip.geometry.errors import (
    DamagedError,
    FolderError,
    GeometryError,
    MachineError,
    SceneError,
    SolverError,
    StickslipError,
)
from stickslip.geometry.keys import Choice, Key, Noun, typed
from stickslip.geometry.obstacles import Obstacle
from stickslip.geometry.obstacles.obstacle import Rotation
from stickslip.geometry.obstacles.plane import Plane
from stickslip.geometry.obstacles.round import Cylinder, Sphere
from stickslip.geometry.user_files.user_file import Box, UserFile
from stickslip.solvers.classical.gram_uzawa import Gram
from stickslip.solvers.effects.body_forces import Gravity
from stickslip.solvers.effects.bolts import BoltState
from stickslip.solvers.effects.periodic import Periodic
from stickslip.solvers.effects.remote_points import RemoteState
from stickslip.solvers.effects.springs import SpringForce
from stickslip.solvers.iteration import Convergence, Status, Step
from stickslip.solvers.laws import FrictionLaw, NormalLaw
from stickslip.solvers.laws.friction import Coulomb, Stick, Tresca
from stickslip.solvers.laws.normal import Bilateral, Compliance, Tied, Unilateral
from stickslip.solvers.laws.tangential_compliance import TangentialCompliance
from stickslip.solvers.laws.wear import Wear
from stickslip.solvers.method_registry import Solver
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.step_result import (
    OPEN,
    SLIP,
    STICK,
    ContactState,
    ErrorParts,
    MeshData,
    Quantity,
    Slope,
    StepResult,
    SurfaceMesh,
)
from stickslip.solvers.scene.contact import Contact, Initial
from stickslip.solvers.scene.loads import Load, Support
from stickslip.solvers.scene.material import Material, Orthotropic
from stickslip.solvers.scene.parameters import Sensitivity
from stickslip.solvers.scene.problem import PlanRow
from stickslip.solvers.scene.record import (
    Batch,
    BodyState,
    ContactNumbers,
    Energy,
    Event,
    Number,
    ObstacleState,
    ProbeValue,
    Reaction,
)
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Accuracy, Exact, Output, Probe, Steps
from stickslip.solvers.simulation.script import Limit, Script
from stickslip.solvers.simulation.simulation import Seconds, Simulation, prepare
from stickslip.solvers.stepping.history import HistoryRow, HistoryTuple
from stickslip.solvers.stepping.stepper import NoEquilibriumError, StepError
from stickslip.workflows.accuracy.rounds import run
from stickslip.workflows.run.mesh_report import ContactReport, MeshReport
from stickslip.workflows.run.result import Outcome
from stickslip.workflows.run.stored_results import Loaded, load
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read
from stickslip.workflows.sweep.fit import Fit, fit
from stickslip.workflows.sweep.sweep import Solved, Sweep, sweep


@typed
def steps(scene: Scene) -> Iterator[StepResult]:
    """Solve a scene; nothing is written. Collective.

    Args:
        scene: what to solve, from `read` or built from its parts.

    Returns:
        An iterator over the requested times: those of the equal steps, and every time that a table of the scene lists.
        Each `StepResult` is solved when it is asked for, and stays valid.

    Raises:
        SceneError, GeometryError: the scene cannot be solved as it stands; at the first step, before solving.
        StepError: a step could not be solved; its last good substep, if there is one, was yielded before.
        NoEquilibriumError: so, and it is shown that contact and friction cannot balance the loads.
    """
    yield from prepare(scene).steps()


def _kinds(noun: type[Any] = Noun) -> Iterator[type[Any]]:
    """The classes that a scene is made of, found by what they derive from; of a family, its base and its kinds."""
    for found in noun.__subclasses__():
        of_family = issubclass(found, Choice) and Choice not in found.__bases__
        if found is not Choice and not (of_family and found not in found.kinds):  # what some kinds share is no kind
            yield found
        yield from _kinds(found)


def __getattr__(name: str) -> type[Any]:
    """A kind that is not imported above: builder, obstacle, law or effect's table of a new file, or a script's own.

    Raises:
        AttributeError: there is none of this name.
    """
    for kind in _kinds():
        if kind.__name__ == name:
            return kind
    raise AttributeError(f"module 'stickslip' has no attribute {name!r}")


def names() -> set[str]:
    """All public names, those of new kinds included."""
    return {*__all__, *(kind.__name__ for kind in _kinds())}


__all__ = [
    "OPEN",
    "SLIP",
    "STICK",
    "Accuracy",
    "Arch",
    "Batch",
    "Bilateral",
    "Block",
    "BodyState",
    "BoltState",
    "Box",
    "Builder",
    "Compliance",
    "Contact",
    "ContactNumbers",
    "ContactReport",
    "ContactState",
    "Convergence",
    "Coulomb",
    "Counters",
    "Cylinder",
    "Cylinders",
    "DamagedError",
    "Energy",
    "ErrorParts",
    "Event",
    "Exact",
    "Fit",
    "FolderError",
    "FrictionLaw",
    "GeometryError",
    "Gram",
    "Gravity",
    "HalfBall",
    "HalfDisc",
    "HalfSpace",
    "HistoryRow",
    "HistoryTuple",
    "Initial",
    "Key",
    "Limit",
    "Load",
    "Loaded",
    "MachineError",
    "Material",
    "MeshData",
    "MeshReport",
    "NoEquilibriumError",
    "NormalLaw",
    "Number",
    "Obstacle",
    "ObstacleState",
    "Orthotropic",
    "Outcome",
    "Output",
    "Periodic",
    "PlanRow",
    "Plane",
    "Probe",
    "ProbeValue",
    "Quantity",
    "Reaction",
    "RemoteState",
    "Ring",
    "Rings",
    "Rotation",
    "Scene",
    "SceneError",
    "Script",
    "Seconds",
    "Sensitivity",
    "Simulation",
    "Slope",
    "Solved",
    "Solver",
    "SolverError",
    "Sphere",
    "Spheres",
    "SpringForce",
    "Stack",
    "Status",
    "Step",
    "StepError",
    "StepResult",
    "Steps",
    "Stick",
    "StickslipError",
    "Strip",
    "Support",
    "SurfaceMesh",
    "Sweep",
    "TangentialCompliance",
    "Tied",
    "Tresca",
    "TwoBlocks",
    "Unilateral",
    "UserFile",
    "Watch",
    "Wear",
    "fit",
    "load",
    "prepare",
    "read",
    "run",
    "steps",
    "sweep",
]
