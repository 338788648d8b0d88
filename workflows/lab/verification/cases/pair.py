"""Pairs of bodies with friction, turned as a whole by any angle about any axis: scalar results do not change."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from stickslip import Builder, Contact, Coulomb, Cylinders, Material, Scene, Spheres, StepResult, Steps, TwoBlocks
from stickslip.geometry.amplitude import Amplitude
from stickslip.geometry.arrays import Array
from stickslip.geometry.shape import Model
from stickslip.solvers.scene.loads import Direction, Support
from stickslip.workflows.lab.verification.check import Check, problem
from stickslip.workflows.lab.verification.prepared import observed, rotation, solver, turned_system

REACH = 0.3  # [m]; by default a part of the box along the axes, which is another one when turned
TOLERANCE = 1e-9  # of the largest value: the solver's 1e-12 over three steps
HORIZONTAL: tuple[Direction, ...] = ("x", "y")
TURNS: Mapping[int, tuple[tuple[float, float, float], float]] = {  # by dimension: axis, angle [rad]; no symmetry of any
    2: ((0.0, 0.0, 1.0), 0.7613),
    3: ((1.0, -2.0, 0.5), 2.1379),
}


def pressed(
    method: str, geometry: Builder, model: Model, sides: tuple[str, str, str, str], depth: float, way: tuple[float, ...]
) -> Scene:
    """The upper body pressed `depth` [m] down, then moved sideways along `way` [m], and halfway back.

    Args:
        sides: where the upper and the lower body are held, then slave and master.
    """
    held, base, slave, master = sides
    up: Direction = "z" if model == "3d" else "y"
    moves: dict[Direction, Amplitude] = {up: ((0.0, 0.0), (1.0, -depth))}
    for axis, move in zip(HORIZONTAL, way, strict=False):
        moves[axis] = ((1.0, 0.0), (2.0, move), (3.0, move / 2))
    return Scene(
        model=model,
        geometry=geometry,
        bodies={"upper": Material(E=1000.0, nu=0.3), "lower": Material(E=3000.0, nu=0.2)},
        contacts={"joint": Contact(surface=slave, against=master, friction=Coulomb(mu=0.3), search_distance=REACH)},
        supports={
            "held": Support(boundary=held, displacement=moves),
            "base": Support(boundary=base, displacement=dict.fromkeys(moves, 0.0)),
        },
        steps=Steps(end=3.0, count=3),
        solver=solver(method, 1e-12),
    )


BLOCK_SIDES = ("upper.top", "lower.bottom", "upper.bottom", "lower.top")
BLOCKS_2D = TwoBlocks(
    length=1.0, height=0.5, lower_length=2.0, lower_height=0.5, offset=0.1, mesh_size=0.1, lower_mesh_size=0.15
)
BLOCKS_3D = TwoBlocks(
    length=1.0, width=1.0, height=0.5, lower_length=1.5, lower_height=0.5, mesh_size=0.25, lower_mesh_size=0.375
)
ROLLERS = Cylinders(
    radius=1.0, lower_radius=2.0, mesh_size=0.25, contact_mesh_size=0.02, lower_mesh_size=0.375, order=2
)
BALLS = Spheres(radius=1.0, lower_radius=1.5, mesh_size=0.5, contact_mesh_size=0.06, contact_radius=0.12)
ROUND_SIDES = {
    2: ("upper.top", "lower.base", "upper.arc", "lower.arc"),
    3: ("upper.top", "lower.base", "upper.cap", "lower.cap"),
}
SCENES: Mapping[str, Callable[[str], Scene]] = {
    "blocks": partial(pressed, geometry=BLOCKS_2D, model="plane strain", sides=BLOCK_SIDES, depth=0.01, way=(0.003,)),
    "blocks, 3D": partial(pressed, geometry=BLOCKS_3D, model="3d", sides=BLOCK_SIDES, depth=0.01, way=(0.003, -0.001)),
    "rollers, order 2": partial(
        pressed, geometry=ROLLERS, model="plane strain", sides=ROUND_SIDES[2], depth=0.01, way=(0.001,)
    ),
    "balls": partial(pressed, geometry=BALLS, model="3d", sides=ROUND_SIDES[3], depth=0.02, way=(0.001, -0.0005)),
}
GRADED = ("rollers, order 2", "balls")


def steps_of(scene: Scene, Q: Array) -> list[StepResult]:
    """All steps of the turned scene."""
    return list(observed(turned_system(scene, Q)))


def scalars(step: StepResult, Q: Array) -> dict[str, Array]:
    """Quantities that a turn must not change; the displacement is turned back."""
    joint = step.contacts["joint"]
    d = joint.traction.shape[1]
    return {
        "pressure": joint.pressure,
        "traction": joint.traction @ Q[:d, :d],
        "slip": joint.slip @ Q[:d, :d],
        "displacement": step.displacement @ Q[:d, :d],
        "stored energy": np.array([step.energy.stored]),
        "dissipation": np.array([joint.dissipation_total]),
    }


def turned(name: str, method: str) -> list[Check]:
    """One scene, straight and turned: the worst of each figure."""
    scene = SCENES[name](method)
    Q = rotation(*TURNS[scene.dim])
    straight, oblique = steps_of(scene, np.eye(3)), steps_of(scene, Q)
    worst: dict[str, float] = {}
    for here, there in zip(straight, oblique, strict=True):
        plain, back = scalars(here, np.eye(3)), scalars(there, Q)
        for key, values in plain.items():
            size = max(float(np.abs(scalars(step, np.eye(3))[key]).max()) for step in straight)
            worst[key] = max(worst.get(key, 0.0), float(np.abs(back[key] - values).max()) / size)
    return [Check(f"{name}, turned: {key}", off, 0.0, TOLERANCE, relative=False) for key, off in worst.items()]


@problem("two bodies with friction, turned as a whole: nothing changes", slow=("uzawa", "surface-uzawa"))
def checks(method: str) -> list[Check]:
    """All of them; plain Uzawa needs tens of thousands of iterations where cells are graded."""
    names = [name for name in SCENES if method == "condensed-newton" or name not in GRADED]
    return [check for name in names for check in turned(name, method)]
