"""Frictional contact between elastic bodies in FEniCSx: all that a script imports.

A first script
--------------
>>> import stickslip
>>> scene = stickslip.read("block", ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5"])
>>> for step in stickslip.steps(scene):
...     base = step.contacts["base"]
...     print(f"t = {step.time} s: N = {base.normal_force:.3f} N, T = {base.tangential_force:.3f} N")
t = 1.0 s: N = 0.246 N, T = 0.000 N
t = 2.0 s: N = 0.245 N, T = 0.033 N

Four ways to solve a scene
--------------------------
steps(scene)
    yields a `StepResult` for each requested time; writes nothing.
run(scene, folder)
    does what `stickslip run` does: solves, writes all files, audits them, draws the pictures.
prepare(scene)
    returns a `Simulation`: meshed, assembled and factorised once. `.steps()` solves the scene's
    history, `.data` is the mesh as arrays (`MeshData`), `.plan` lists the effects and why each is on.
prepare(scene).script()
    returns a `Script`, which is told each step: `script.step(to=1.0, supports={"top": {"x": 0.01}})`.

`read` takes a scene file, or the name of a ready scene. A `Scene` can also be built from its parts,
which have the names of the file's tables and keys:

    Scene(model="3d", geometry=Block(...), bodies={"block": Material(E=2e11, nu=0.3)}, ...)

All parts are frozen; `dataclasses.replace` makes a changed copy. workflows/SCENE.md lists every key
with type, unit and default.

What a step holds
-----------------
step.contacts["base"]   a `ContactState`: at each node of the slave side (n,) pressure, gap, status and
                        friction bound, (n, d) traction and slip; of the whole side force, moment, and
                        the areas that touch, stick and slip
step.displacement       (nodes, d) [m]
step.stress             (cells, 3, 3) [Pa]; step.von_mises (cells,) [Pa]
step.supports           reactions by name: force (d,) [N] and moment [N m]
step.obstacles          displacement (d,) [m], force (d,) [N] and moment [N m] by name
step.probes             displacement (d,) [m] and stress (3, 3) [Pa] at points, by name
step.energy             an `Energy` [J]
step.residual           how well equilibrium and contact laws are satisfied, relative

A status is `OPEN`, `SLIP` or `STICK`: `base.status == stickslip.STICK` is a mask (n,).

Units and signs
---------------
Units are SI; any consistent set works. d is 2 or 3. In plane models forces, areas and energies are per
metre of thickness; in axisymmetric ones they are of the full circle, and x is the radius. Pressure is
positive where it presses, a gap is positive where it is open. Forces and tractions of a contact act on
its slave side. Displacements are measured from the undeformed mesh.

Under mpirun all functions are collective: every rank calls them. Fields (displacement, stress,
`MeshData`) are on rank 0 and empty elsewhere; all other results are on every rank.

Errors
------
All derive from `StickslipError`; the text is one line. `SceneError` (with `FolderError`) and
`GeometryError` are about input and are raised before solving. `SolverError` is about a step:
`StepError` has its iterations in `.history`; it is a `NoEquilibriumError` where it is proved that
nothing can balance the loads. `MachineError` (with `DamagedError`) is about disk, memory, libraries.

Names
-----
Functions         read, prepare, steps, run
Scene             Scene, Material, Contact, Support, Load, Probe, Steps, Solver, Gram, Output, Exact,
                  Accuracy
Geometry          UserFile, Box; builders: Arch, Block, Cylinders, HalfBall, HalfDisc, HalfSpace, Ring,
                  Rings, Spheres, Stack, Strip, TwoBlocks
Obstacles         Plane, Cylinder, Sphere, Rotation
Normal laws       Unilateral, Compliance, Bilateral, Tied
Friction laws     Coulomb, Tresca, TangentialCompliance, Stick
Effects           Gravity, Periodic
Solving           Simulation, Script, PlanRow, Seconds, Counters; iterations: HistoryRow,
                  HistoryTuple, Step, Status
Results           StepResult, ContactState, OPEN, SLIP, STICK, Reaction, ObstacleState, ProbeValue,
                  Energy, MeshData, SurfaceMesh, Convergence; errors: Quantity, ErrorParts
Runs              Watch (callbacks of `run`), MeshReport, ContactReport, Outcome (how a run ended)
Errors            StickslipError, SceneError, FolderError, GeometryError, SolverError, StepError,
                  NoEquilibriumError, MachineError, DamagedError
Bases             Builder, Obstacle, NormalLaw, FrictionLaw, Key: to write a kind of one's own

A kind that a new file in geometry/builders, geometry/obstacles, solvers/laws or solvers/effects adds is
public here at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from geometry.builders import Builder
from geometry.builders.arch import Arch
from geometry.builders.block import Block
from geometry.builders.cylinders import Cylinders
from geometry.builders.half_ball import HalfBall
from geometry.builders.half_disc import HalfDisc
from geometry.builders.half_space import HalfSpace
from geometry.builders.ring import Ring
from geometry.builders.rings import Rings
from geometry.builders.spheres import Spheres
from geometry.builders.stack import Stack
from geometry.builders.strip import Strip
from geometry.builders.two_blocks import TwoBlocks
from geometry.errors import (
    DamagedError,
    FolderError,
    GeometryError,
    MachineError,
    SceneError,
    SolverError,
    StickslipError,
)
from geometry.keys import Choice, Key, Noun
from geometry.obstacles import Obstacle
from geometry.obstacles.cylinder import Cylinder
from geometry.obstacles.plane import Plane
from geometry.obstacles.rotation import Rotation
from geometry.obstacles.sphere import Sphere
from geometry.user_files.user_file import Box, UserFile
from solvers.effects.gravity import Gravity
from solvers.effects.periodic import Periodic
from solvers.laws import FrictionLaw, NormalLaw
from solvers.laws.bilateral import Bilateral
from solvers.laws.compliance import Compliance
from solvers.laws.friction import Coulomb, Stick, Tresca
from solvers.laws.tangential_compliance import TangentialCompliance
from solvers.laws.tied import Tied
from solvers.laws.unilateral import Unilateral
from solvers.methods import Solver
from solvers.newton.solution import Convergence, Status, Step
from solvers.parallel.counters import Counters
from solvers.results.error_parts import ErrorParts, Quantity
from solvers.results.step_result import (
    OPEN,
    SLIP,
    STICK,
    ContactState,
    MeshData,
    ObstacleState,
    ProbeValue,
    Reaction,
    StepResult,
    SurfaceMesh,
)
from solvers.scene.contact import Contact
from solvers.scene.gram import Gram
from solvers.scene.loads import Load, Support
from solvers.scene.material import Material
from solvers.scene.problem import PlanRow
from solvers.scene.scene import Scene
from solvers.scene.settings import Accuracy, Exact, Output, Probe, Steps
from solvers.simulation.script import Script
from solvers.simulation.simulation import Seconds, Simulation, prepare
from solvers.stepping.history import HistoryRow, HistoryTuple
from solvers.stepping.state import Energy
from solvers.stepping.stepper import NoEquilibriumError, StepError
from workflows.run.mesh_report import ContactReport, MeshReport
from workflows.run.result import Outcome
from workflows.run.run import run
from workflows.run.watch import Watch
from workflows.scene_file.read import read

__version__ = "0.1.0"


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
        NoEquilibriumError: so, and it is proved that contact and friction cannot balance the loads.
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


def __dir__() -> list[str]:
    """All public names, those of new kinds included."""
    return sorted({*__all__, *(kind.__name__ for kind in _kinds()), "__doc__", "__file__", "__version__"})


__all__ = [
    "OPEN",
    "SLIP",
    "STICK",
    "Accuracy",
    "Arch",
    "Bilateral",
    "Block",
    "Box",
    "Builder",
    "Compliance",
    "Contact",
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
    "Exact",
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
    "Key",
    "Load",
    "MachineError",
    "Material",
    "MeshData",
    "MeshReport",
    "NoEquilibriumError",
    "NormalLaw",
    "Obstacle",
    "ObstacleState",
    "Outcome",
    "Output",
    "Periodic",
    "PlanRow",
    "Plane",
    "Probe",
    "ProbeValue",
    "Quantity",
    "Reaction",
    "Ring",
    "Rings",
    "Rotation",
    "Scene",
    "SceneError",
    "Script",
    "Seconds",
    "Simulation",
    "Solver",
    "SolverError",
    "Sphere",
    "Spheres",
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
    "TangentialCompliance",
    "Tied",
    "Tresca",
    "TwoBlocks",
    "Unilateral",
    "UserFile",
    "Watch",
    "prepare",
    "read",
    "run",
    "steps",
]
