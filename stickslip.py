"""Frictional contact between elastic bodies in FEniCSx: the public face.

>>> import stickslip
>>> scene = stickslip.read("block", ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5"])
>>> [step.time for step in stickslip.steps(scene)]
[1.0, 2.0]
"""

from __future__ import annotations

from collections.abc import Iterator

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
from geometry.errors import StickslipError
from geometry.obstacles.cylinder import Cylinder
from geometry.obstacles.plane import Plane
from geometry.obstacles.rotation import Rotation
from geometry.obstacles.sphere import Sphere
from geometry.user_files.user_file import UserFile
from solvers.effects.gravity import Gravity
from solvers.effects.periodic import Periodic
from solvers.laws.bilateral import Bilateral
from solvers.laws.compliance import Compliance
from solvers.laws.friction import Coulomb, Stick, Tresca
from solvers.laws.tangential_compliance import TangentialCompliance
from solvers.laws.tied import Tied
from solvers.laws.unilateral import Unilateral
from solvers.methods import Solver
from solvers.results.step_result import StepResult
from solvers.scene.contact import Contact
from solvers.scene.loads import Load, Support
from solvers.scene.material import Material
from solvers.scene.scene import Scene
from solvers.scene.settings import Output, Probe, Steps
from solvers.simulation.script import Script
from solvers.simulation.simulation import prepare
from workflows.run.run import run
from workflows.scene_file.read import read

__version__ = "0.1.0"


def steps(scene: Scene) -> Iterator[StepResult]:
    """Solve a scene, one `StepResult` a requested time; nothing is written."""
    yield from prepare(scene).steps()


__all__ = [
    "Arch",
    "Bilateral",
    "Block",
    "Compliance",
    "Contact",
    "Coulomb",
    "Cylinder",
    "Cylinders",
    "Gravity",
    "HalfBall",
    "HalfDisc",
    "HalfSpace",
    "Load",
    "Material",
    "Output",
    "Periodic",
    "Plane",
    "Probe",
    "Ring",
    "Rings",
    "Rotation",
    "Scene",
    "Script",
    "Solver",
    "Sphere",
    "Spheres",
    "Stack",
    "StepResult",
    "Steps",
    "Stick",
    "StickslipError",
    "Strip",
    "Support",
    "TangentialCompliance",
    "Tied",
    "Tresca",
    "TwoBlocks",
    "Unilateral",
    "UserFile",
    "prepare",
    "read",
    "run",
    "steps",
]
