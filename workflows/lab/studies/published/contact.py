"""Measured rows: iterations, volume solves and residuals of a scene, spectra of metrics, linear saddle points.

The scenes are the ready ones, `block` and `cube`, with n cells over the height, any friction, sheared until they slip.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.linalg import eigh

from stickslip import Scene, Simulation, StickslipError, prepare, read
from stickslip.geometry.arrays import Array
from stickslip.solvers.classical.perturbed_lagrangian import PerturbedLagrangian
from stickslip.solvers.classical.uzawa import Uzawa
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.metrics import surface_metric
from stickslip.solvers.results.observe import law_error
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.workflows.lab.studies import gram
from stickslip.workflows.lab.studies.finding import Row
from stickslip.workflows.lab.studies.saddle_points import NODES, RULES, SOFTNESS, STEPS, Exact, factors, membrane
from stickslip.workflows.lab.verification.hard.tables import toml
from stickslip.workflows.lab.verification.prepared import PRESSED, pressed
from stickslip.workflows.lab.verification.prepared import march as accept

PULL = 2.0  # shear over (mu times indentation) at which a part of the base slips, for any mu
STIFF = {"compliance": {"c_n": 20.0, "m_n": 1.0}}  # [Pa/m]: twenty times as stiff as the body over its depth, or more


def slipping(dim: int, mu: float) -> float:
    """Shear displacement [m] at which a part of the base slips."""
    return round(PULL * mu * PRESSED[dim], 9)


def scene(
    dim: int,
    n: int,
    mu: float = 0.3,
    normal: str = "unilateral",
    drag: float | None = None,
    sticks: bool = False,
    given: float | None = None,
    at_once: bool = False,
    **solver: Any,
) -> Scene:
    """Describe the block or the cube.

    Args:
        sticks: without a bound of friction.
        given: that bound itself [Pa], whatever mu.
        normal: law of the contact.
        drag: m, absent as the ready scene has it.
        at_once: whether it is pressed and dragged in one step.
        solver: keys of [solver].
    """
    friction: dict[str, Any] = {"law": "stick"} if sticks else {"law": "coulomb", "mu": mu}
    if given is not None:
        friction = {"law": "tresca", "bound": [[0, given]]}
    settings = {
        "geometry.cells": "tensor",
        "contacts.base.friction": friction,
        "contacts.base.normal": {"law": normal} | STIFF.get(normal, {}),
        "solver": {"tolerance": 1e-6} | solver,
    }
    words = [f"{key}={toml(value)}" for key, value in settings.items()]
    return read("block" if dim == 2 else "cube", [*pressed(dim, n, drag, at_once=at_once), *words])


PLAIN, LEARNING = "W (uzawa)", "boundary operator (surface-uzawa)"


def plain(surface: CondensedSurface, cone: AdmissibleSet, give: Array | float = 0.0) -> Array:
    """Eigenvalues of W^-1 (B K_B^-1 B^T - K_C) on the rows that carry tractions [m/Pa], increasing; see (5.5).

    Args:
        give: 1/ω (rows,) [m/Pa].
    """
    N, root = surface.N.toarray(), np.sqrt(surface.W)
    S = root[:, None] * (N @ surface.flexibility @ N.T) * root + np.diag(np.broadcast_to(give, root.shape))
    return np.asarray(np.linalg.eigvalsh(S[np.ix_(cone.carrying, cone.carrying)]))


def spectrum(dim: int, n: int) -> list[Row]:
    """A row for each metric, with all eigenvalues."""
    rows = [(row.reading, row.spectrum, row.fill) for row in gram.rows(n, dim)]
    system = gram.block(n, dim=dim)
    surface, cone = gram.surface_of(system)
    guessed = surface_metric(system)(np.eye(surface.size))
    on, N = cone.carrying, surface.N.toarray()
    given, guess = ((N @ F @ N.T)[np.ix_(on, on)] for F in (surface.flexibility, guessed))
    rows.append((PLAIN, plain(surface, cone), None))
    rows.append((LEARNING, eigh(given, guess, eigvals_only=True), None))
    return [
        {"dim": dim, "n": n, "metric": metric, "least": values[0], "largest": values[-1]}
        | {"condition": values[-1] / values[0], "fill": fill, "values": values.tolist()}
        for metric, values, fill in rows
    ]


def linear(softness: str, rule: str) -> list[Row]:
    """C and the inner solve by name; every part of the limit 2 / lambda_1."""
    problem, Q = membrane(NODES, SOFTNESS[softness]), np.eye(NODES) / (NODES + 1)
    rows: list[Row] = []
    for part in STEPS:
        theory, measured, iterations = factors(problem, Q, RULES[rule], part)
        row = {"C": softness, "inner": rule, "exact": isinstance(RULES[rule], Exact), "part": part}
        rows.append(row | {"theory": theory, "measured": measured, "iterations": iterations})
    return rows


EXACT = 1e-10  # tolerance of a reference
TRIED = 3000  # iterations after which a step size has shown whether it converges


def march(found: Scene) -> tuple[Simulation, list[Accepted], str]:
    """Solve all steps without results; how many were solved, and how the run ended."""
    simulation, accepted = prepare(found, MPI.COMM_SELF), list[Accepted]()
    try:
        accepted.extend(accept(simulation.stepper))
    except StickslipError as error:
        return simulation, accepted, str(error)
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
