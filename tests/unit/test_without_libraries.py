"""PETSc without hypre and without CHOLMOD, as in PyPI's wheels: GAMG with the rigid modes, and MUMPS."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from petsc4py import PETSc
from scipy import sparse

import stickslip
from shared.cases import often
from stickslip.solvers.linear import cholesky, multigrid
from stickslip.solvers.linear.cholesky import SparseCholesky
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.system.floating_modes import near_nullspace
from stickslip.solvers.system.system import System

STRIP = ["geometry.length=10", "geometry.mesh_size=0.025", "geometry.layers=4", "supports.grip.displacement.y=0.0"]


# held; one of two floats; all float
@pytest.mark.parametrize("name", often(["cube", "cylinders", "stack"], ["cylinders"]))
def test_gamg_in_place_of_hypre_finds_the_same(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = {
        "cube": ["geometry.mesh_size=0.25"],
        "cylinders": ["geometry.mesh_size=2.0", "geometry.contact_mesh_size=0.12"],
    }
    coarse = ["output.error=false", *sizes.get(name, [])]
    free = stickslip.read(name, [*coarse, "solver.surface=matrix-free"])
    exact = [*stickslip.steps(stickslip.read(name, [*coarse, "solver.surface=condensed"]))]
    monkeypatch.setattr(multigrid, "HYPRE", False)
    for one, other in zip(stickslip.steps(free), exact, strict=True):
        # the scene's tolerance is 1e-8; BoomerAMG and GAMG both leave up to 4e-8 of the displacement
        assert_allclose(one.displacement, other.displacement, atol=3e-7 * np.abs(other.displacement).max())


def test_coarse_spaces_of_gamg_hold_the_rotation(system_of: Callable[[Scene], System]) -> None:
    """A clamped strip, a hundred times as long as it is thick: without its rotation, bending is seen too late."""
    system = system_of(stickslip.read("strip", STRIP))
    motions = near_nullspace(system)

    def iterations(kept: int) -> int:
        ksp, force = PETSc.KSP().create(), system.K_B.createVecRight()
        force.array[:] = motions.sum(axis=1)
        ksp.setOperators(system.K_B)
        ksp.setType("cg")
        ksp.setTolerances(rtol=1e-8)
        ksp.setPC(multigrid.gamg(system.K_B, motions[:, :kept], "strip_"))
        ksp.solve(force, force.duplicate())
        return int(ksp.getIterationNumber())

    assert motions.shape[1] == 3
    assert iterations(3) < 100 < iterations(2) / 2


def test_mumps_in_place_of_cholmod_factorises(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cholesky, "SOLVER", "mumps")
    A = sparse.diags([-1.0, 2.5, -1.0], [-1, 0, 1], shape=(50, 50))
    x = np.random.default_rng(0).standard_normal((50, 3))
    assert_allclose(A @ SparseCholesky(A).solve(x), x, atol=1e-13)
