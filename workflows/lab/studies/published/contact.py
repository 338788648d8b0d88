"""A scene solved by one method: iterations, volume solves, and the residuals of the last step."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from stickslip.geometry.errors import StickslipError
from stickslip.solvers.classical.perturbed_lagrangian import PerturbedLagrangian
from stickslip.solvers.classical.uzawa import Uzawa
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.results.observe import law_error
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.workflows.lab.studies.published.finding import Row
from stickslip.workflows.lab.studies.published.scenes import scene
from stickslip.workflows.lab.studies.published.spectrum import plain

EXACT = 1e-10  # tolerance of a reference
TRIED = 3000  # iterations after which a step size has shown whether it converges


def march(found: Scene) -> tuple[Simulation, list[Accepted], str]:
    """Solve all steps without results; how many were solved, and how the run ended."""
    simulation, accepted = prepare(found, MPI.COMM_SELF), list[Accepted]()
    state = simulation.stepper.start()
    for time in found.requested_times():
        try:
            accepted.append(simulation.stepper.reach(state, time, lambda row: None))
        except StickslipError as error:
            return simulation, accepted, str(error)
        state = accepted[-1].state
    return simulation, accepted, "converged"


def solved(
    dim: int,
    n: int,
    method: str,
    mu: float = 0.3,
    normal: str = "unilateral",
    drag: float | None = None,
    given: float | None = None,
    **solver: Any,
) -> list[Row]:
    """One row for both steps together; a method that fails has no counts."""
    simulation, accepted, status = march(scene(dim, n, mu, normal, drag, given=given, method=method, **solver))
    row: Row = {"dim": dim, "n": n, "method": method, "mu": mu, "normal": normal, "drag": drag} | solver
    row |= {"status": status, "dofs": simulation.system.constraints.free_total}
    if status != "converged":
        return [row]
    counts = {key: sum(getattr(a, key) for a in accepted) for key in ("iterations", "volume_solves", "substeps")}
    history = [h.step.residual for h in accepted[-1].history if h.time == accepted[-1].state.time]
    linear = simulation.counters.linear_iterations
    return [row | counts | {"linear_iterations": linear, "residual": accepted[-1].residual, "history": history}]


def springs(dim: int, n: int, omega_factor: float) -> list[Row]:
    """The perturbed Lagrangian against condensed-newton: true and stated error in the energy norm.

    Its condition number is that of B K_B^-1 B^T - K_C, K_C = -W/ω.
    """
    exact = march(scene(dim, n, method="condensed-newton", tolerance=EXACT))
    simulation, accepted, status = march(
        scene(dim, n, method="perturbed-lagrangian", omega_factor=omega_factor, augment=False, tolerance=EXACT)
    )
    row: Row = {"dim": dim, "n": n, "omega_factor": omega_factor, "status": status}
    if status != "converged":
        return [row]
    K, u = exact[0].system.K, exact[1][-1].state.u
    off, problem = accepted[-1].state.u - u, accepted[-1].problem
    assert isinstance(problem.surface, CondensedSurface)
    omega = PerturbedLagrangian.of(simulation.system.problem.solver).penalties(simulation.system)
    values = plain(problem.surface, problem.cone, 1 / omega)
    return [
        row
        | {"condition": values[-1] / values[0]}
        | {"iterations": sum(a.iterations for a in accepted), "stated": law_error(accepted[-1])}
        | {"error": float(np.sqrt((K * off).dot(off) / (K * u).dot(u)))}
    ]


def stepped(dim: int, n: int, friction: str, part: float) -> list[Row]:
    """Uzawa on the first step, alpha = part * 2 / lambda_1, from random tractions: whether it converges.

    Args:
        friction: "stick", which makes the problem linear as all of the base is pressed; or "coulomb".
    """
    _, accepted, _ = march(scene(dim, n, sticks=friction == "stick", method="condensed-newton"))
    problem = accepted[0].problem
    method = Uzawa(alpha=part * 2 / problem.surface.lambda_max, rtol=EXACT, max_it=TRIED)
    start = np.random.default_rng(1).normal(1.0, 0.1, problem.cone.size) * problem.p_ref
    found = method(problem, start)
    row = {"dim": dim, "n": n, "friction": friction, "part": part, "status": found.status.value}
    return [row | {"iterations": found.iterations, "residual": found.residual, "first": found.history[0].residual}]
