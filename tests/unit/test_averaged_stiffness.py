"""Nearly incompressible bodies: products and factors without the matrix, whose entries are very many."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from petsc4py import PETSc

from shared.cases import every_nth, slow
from shared.matrices import whole
from stickslip.geometry.errors import SceneError
from stickslip.solvers.fem.mean_dilatation import MeanDilatation
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.linear.block_diagonal import BlockDiagonal
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.choice import Size, choose
from stickslip.solvers.system.system import System
from stickslip.workflows.scene_file.read import read

SystemOf = Callable[[Scene], System]
RUBBER = 'bodies.upper={ E = 1e6, nu = 0.4999, formulation = "auto" }'
SCENES: dict[str, tuple[str, ...]] = {
    "block": ("bodies.block.nu=0.499", "geometry.mesh_size=0.25", "geometry.contact_mesh_size=0.25"),
    "cube": ("bodies.block.nu=0.499", "geometry.mesh_size=0.34", "geometry.order=2"),
    "rubber_mount": ("geometry.mesh_size=0.01",),  # a rigid side: displacements are not only selected
    "two_blocks": (RUBBER, "geometry.mesh_size=0.25"),  # one of two bodies
    "axisymmetric": ("bodies.disc.nu=0.4999",),
}


def drawn(vector: Any, seed: int, system: System) -> Any:
    """Entries by lot, zero where nothing is free."""
    vector.array[:] = np.random.default_rng(seed).normal(size=len(vector.array))
    vector.array[system.constraints.eliminated()] = 0.0
    return vector


@pytest.mark.parametrize("name", SCENES)
def test_products_need_no_matrix(name: str, system_of: SystemOf) -> None:
    system = system_of(read(name, [*SCENES[name]]))
    assert system.problem.averaged
    u = system.vector()
    u.array[:] = np.random.default_rng(0).normal(size=len(u.array))
    expected = whole(system) * u
    assert (system.K * u - expected).norm() < 1e-12 * expected.norm()
    q = drawn(system.T.createVecRight(), 1, system)
    pulled = system.assembled().product * q - system.K_B * q
    pulled.array[system.constraints.eliminated()] = 0.0
    assert pulled.norm() < 1e-12 * (system.K_B * q).norm()


@pytest.mark.parametrize(("name", "by_blocks"), every_nth(2, SCENES, (False, True)))
def test_pressures_as_unknowns_change_nothing_but_rounding(name: str, by_blocks: bool, system_of: SystemOf) -> None:
    system = system_of(read(name, [*SCENES[name]]))
    dofs = system.interface.dofs
    several = system.mesh.part_count > 1 and not by_blocks
    known, mixed = FactorisedVolume(system.K_B, dofs, Counters(), several=several), system.assembled().mixed()
    volume = FactorisedVolume(system.assembled().product, dofs, Counters(), several=several, mixed=mixed)
    if by_blocks:  # what several ranks do, on one
        volume._parts[0]._factor_interior(dofs)
        volume.S = BlockDiagonal.whole(volume._parts[0].S)
    every = np.eye(len(dofs))
    S = known.S @ every
    assert_allclose(volume.S @ every, S, atol=1e-10 * np.abs(S).max())
    f, u_c = drawn(system.T.createVecRight(), 2, system), np.random.default_rng(3).normal(size=len(dofs))
    expected = known.condense(f)
    assert_allclose(volume.condense(f), expected, atol=1e-9 * np.abs(expected).max())
    q = known.expand(f, u_c)
    assert (volume.expand(f, u_c) - q).norm() < 1e-9 * q.norm()
    assert mixed is not None
    assert mixed.getInfo()["nz_used"] < system.K_B.getInfo()["nz_used"]


@pytest.mark.parametrize("name", ["block", *slow("two_blocks")])
def test_a_condensed_run_never_assembles_the_matrix(
    name: str, simulation_of: Callable[[Scene], Simulation], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = read(name, [*SCENES[name], 'solver.method="condensed-newton"'])
    expected = [step.p for step in simulation_of(scene).steps()]
    monkeypatch.setattr(MeanDilatation, "add_to", lambda self, K: pytest.fail("assembled"))
    for step, p in zip(simulation_of(scene).steps(), expected, strict=True):
        assert_allclose(step.p, p, rtol=0, atol=0)


def test_a_mechanism_is_seen_by_the_signs_of_the_pivots() -> None:
    """Of a mixed matrix only as many may be negative as there are pressures."""
    for pivot in (1.0, -1e-9):
        mixed, K = (PETSc.Mat().createAIJ((n, n), nnz=1) for n in (4, 3))
        for matrix in (mixed, K):
            for row, value in enumerate((1.0, 2.0, pivot, -1.0)[: matrix.size[0]]):
                matrix.setValue(row, row, value)
            matrix.assemble()
        if pivot > 0:
            FactorisedVolume(K, np.zeros(0, np.int32), Counters(), mixed=mixed)
        else:
            with pytest.raises(SceneError, match="stiffness of the bodies is singular"):
                FactorisedVolume(K, np.zeros(0, np.int32), Counters(), mixed=mixed)


@pytest.mark.parametrize(("name", "cells", "order"), every_nth(2, ("block", "cube"), ("tensor", "simplex"), (1, 2)))
def test_the_size_is_that_of_what_is_assembled(name: str, cells: str, order: int, system_of: SystemOf) -> None:
    h = (0.05 if name == "block" else 0.1) * order
    words = [f"geometry.mesh_size={h}", f"geometry.order={order}", f'geometry.cells="{cells}"', "bodies.block.nu=0.499"]
    words += [f"geometry.contact_mesh_size={h}"] * (name == "block")
    system = system_of(read(name, words))
    size = Size.of(system.problem, system.mesh, system.constraints, system.contacts)
    assert size.entries == pytest.approx(system.K_B.getInfo()["nz_used"], rel=0.45)  # fewer at the boundary


def test_where_multigrid_is_slow_a_factor_is_preferred(system_of: SystemOf) -> None:
    def first(nu: float) -> str:
        words = ["geometry.mesh_size=0.0625", f"bodies.block.nu={nu}", 'bodies.block.formulation="displacement"']
        return choose(system_of(read("cube", words))).stages[0].surface

    assert [first(nu) for nu in (0.3, 0.499)] == ["matrix-free", "condensed"]
