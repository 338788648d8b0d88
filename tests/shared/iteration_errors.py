"""What `error.iteration` states, beside the true distance to the exact solution of the same mesh, laws and steps."""

from functools import lru_cache

import numpy as np
from mpi4py import MPI

from stickslip.geometry.errors import SceneError
from stickslip.geometry.protocols import Vec
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import read

# methods that solve the laws only nearly: their own solution is what they iterate towards
APPROXIMATE = ("perturbed-lagrangian", "regularised")
EXACT = {"perturbed-lagrangian": 1e-12, "regularised": 1e-12, "condensed-newton": 1e-13}
WAYS = (
    "condensed-newton", "surface-uzawa, condensed", "surface-uzawa, matrix-free", "uzawa, condensed", "inexact-uzawa",
    "nonlinear-uzawa", "gram-uzawa", "nsgs", "block-uzawa", "block-uzawa, ksp", "perturbed-lagrangian", "regularised",
    "tangent-cg",
)  # fmt: skip
OPTIONS = {"": (), "ksp": ('solver.outer="ksp"',), "condensed": ('solver.surface="condensed"',)}
OPTIONS |= {"matrix-free": ('solver.surface="matrix-free"',)}
FLOOR = 1e-10  # relative; below that rounding and the exact solution's own residual are of one size


def scene_of(name: str, over: tuple[str, ...], way: str, tolerance: float) -> Scene:
    """A ready scene with overrides, a method ("NAME" or "NAME, form") and a tolerance."""
    method, _, form = way.partition(", ")
    return read(name, [*over, f"solver.method={method}", *OPTIONS[form], f"solver.tolerance={tolerance}"])


def refused(name: str, over: tuple[str, ...], way: str) -> bool:
    """Whether the method does not work with the scene."""
    try:
        make_plan(scene_of(name, over, way, 1e-8))
    except SceneError:
        return True
    return False


def solve(scene: Scene) -> tuple[Simulation, list[tuple[Vec, float]], float]:
    """The simulation; displacement [m] and largest energy so far [J] of each step; the largest stated error [-]."""
    simulation = prepare(scene, MPI.COMM_SELF)
    found, stated = [], 0.0
    for step in simulation.steps():
        state = simulation.reported.state
        found.append((state.u.copy(), state.peak))
        stated = float(np.maximum(stated, step.iteration_error))  # nan stays nan
    return simulation, found, stated


@lru_cache(maxsize=2)
def exact(name: str, over: tuple[str, ...], method: str) -> tuple[Simulation, list[tuple[Vec, float]], float]:
    """The exact solution of each step."""
    return solve(scene_of(name, over, method, EXACT[method]))


def stated_and_true(name: str, over: tuple[str, ...], way: str, tolerance: float) -> tuple[float, float]:
    """The largest stated and the largest true error of a run, relative, energy norm."""
    method = way.partition(", ")[0]
    simulation, expected, _ = exact(name, over, method if method in APPROXIMATE else "condensed-newton")
    _, found, stated = solve(scene_of(name, over, way, tolerance))
    true = 0.0
    for (u, _), (u_exact, peak) in zip(found, expected, strict=True):
        off = u - u_exact
        true = max(true, float(np.sqrt(max((simulation.system.K * off).dot(off), 0.0) / (2 * peak))) if peak else 0.0)
    return stated, true
