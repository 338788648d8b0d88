"""The slip tangent of the perturbed Lagrangian, solved by GMRES with incomplete LU and by MUMPS."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from stickslip.solvers.classical.contact_element import SLIP
from stickslip.solvers.classical.perturbed_lagrangian import PerturbedLagrangian
from stickslip.workflows.lab.analysis.slip_tangent import SlipTangent, unsymmetry
from stickslip.workflows.lab.analysis.tangent_solves import ILU, Solve, condition, gauss_seidel, gmres, mumps
from stickslip.workflows.lab.studies.published.contact import march, scene, slipping
from stickslip.workflows.lab.studies.published.finding import Row

FORMS = ("displacements", "displacements and forces")
DIRECT, INCOMPLETE, CLASSICAL = "MUMPS", "GMRES, ILU(0)", "Gauss-Seidel"
RELAXED, STABILISED = "GMRES, relaxed ILU, ", "GMRES, stabilised ILU, "


def _by(ilu: ILU | None) -> Callable[[Any, Any], Solve]:
    return lambda K, b: gmres(K, b, ilu)


SOLVERS: Mapping[str, Callable[[Any, Any], Solve]] = {
    CLASSICAL: gauss_seidel,
    "GMRES": _by(None),
    INCOMPLETE: _by(ILU()),
    **{f"{RELAXED}{part:g}": _by(ILU(relaxation=part)) for part in (0.5, 0.9, 0.95, 1.0)},
    **{f"{STABILISED}{shift:g}": _by(ILU(shift=shift)) for shift in (1e-3, 1e-2, 1e-1)},
    "GMRES, ILU(1)": _by(ILU(levels=1)),
    "GMRES, ILU(2)": _by(ILU(levels=2)),
}


def tangent(dim: int, n: int, mu: float, omega_factor: float) -> list[Row]:
    """A row for each solver and form: the forces eliminated, or unknowns as in (4.5)."""
    found = scene(
        dim, n, mu, drag=slipping(dim, mu), method="perturbed-lagrangian", omega_factor=omega_factor, augment=False
    )
    simulation, accepted, status = march(found)
    row: Row = {"dim": dim, "n": n, "mu": mu, "omega_factor": omega_factor}
    if status != "converged":
        names = [(form, solver) for form in FORMS for solver in (DIRECT, *SOLVERS)]
        return [row | {"form": form, "solver": solver, "status": f"no tangent: {status}"} for form, solver in names]
    omega = PerturbedLagrangian.of(simulation.system.problem.solver).penalties(simulation.system)
    matrix = SlipTangent.at(simulation.system, accepted[-1], omega)
    row["sliding"] = matrix.share(SLIP)
    systems = dict(zip(FORMS, (matrix.of_displacements, matrix.of_both), strict=True))
    return [solve for form, (K, f) in systems.items() for solve in _solved(row | {"form": form}, K, f)]


def _solved(row: Row, K: Any, force: Any) -> Iterator[Row]:
    """One row for each solver; the first one, MUMPS, also has the data of the matrix."""
    x = mumps(K, force).x
    b = K @ x  # the exact x is known
    direct = mumps(K, b)
    matrix = {"dofs": K.shape[0], "unsymmetry": unsymmetry(K), "condition": condition(K)}
    yield row | matrix | _told(DIRECT, direct, x, direct)
    for name, solve in SOLVERS.items():
        yield row | _told(name, solve(K, b), x, direct)


def _told(name: str, solve: Solve, x: Any, direct: Solve) -> Row:
    """One row: error of the solution; seconds are those of MUMPS in the same process, times `ratio`."""
    done = solve.ended == "converged"
    off = float(np.linalg.norm(solve.x - x) / np.linalg.norm(x)) if done or name == DIRECT else None
    return {
        "solver": name,
        "status": solve.ended,
        "iterations": solve.iterations if done and name != DIRECT else None,
        "residual": solve.residual if np.isfinite(solve.residual) else None,
        "error": off,
        "fill": solve.fill,
        "ratio": solve.seconds / direct.seconds if done else None,
        "seconds": solve.seconds if np.isfinite(solve.seconds) else None,
    }
