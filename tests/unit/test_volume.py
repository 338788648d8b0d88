"""Bodies are factorised and condensed onto their contact dofs, exactly, however they are stored and held."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy import sparse

import stickslip
from shared.cases import every_nth, often, slow
from shared.drawn import GEO, draw, scene_data
from shared.problems import SceneOf, SimulationOf, SystemOf, condensed_surface, dense, surface_problem, whole
from stickslip import Counters, MachineError, Scene, SceneError, Simulation
from stickslip.geometry.arrays import Array, inverse_and_determinant, inverses
from stickslip.geometry.protocols import Mat, Sparse, Vec
from stickslip.solvers.fem.mean_dilatation import MeanDilatation
from stickslip.solvers.fem.rigid_fields import rigid_fields
from stickslip.solvers.interface import schur_complement
from stickslip.solvers.interface.coarse_mesh import LEAST, CoarseMesh
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface, MemoisedMap, RowStiffness
from stickslip.solvers.iteration import OnStep, Solution, Status, ignore
from stickslip.solvers.linear import cholesky
from stickslip.solvers.linear import multigrid as multigrid_of
from stickslip.solvers.linear.block_diagonal import BlockDiagonal
from stickslip.solvers.linear.cholesky import SparseCholesky
from stickslip.solvers.linear.multigrid import multigrid
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.methods.surface_uzawa import LearningIteration
from stickslip.solvers.metrics import surface_metric
from stickslip.solvers.newton.active_set import linearise
from stickslip.solvers.newton.condensed_system import solve
from stickslip.solvers.stepping.choice import Size, choose
from stickslip.solvers.system.floating_modes import near_nullspace
from stickslip.solvers.system.stiffness import without_rounding
from stickslip.solvers.system.system import System
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict, read

STICKING: dict[str, Any] = {"friction": {"law": "stick"}}


def held(dim: int) -> dict[str, float]:
    return dict(zip("xyz"[:dim], (0.0, -0.1, -0.05), strict=False))


def scene_in(dim: int, scene_of: SceneOf, floating: bool = False) -> Scene:
    return scene_of(
        dim,
        {"contact_mesh_size": 0.2 if dim == 2 else 0.4},
        base=STICKING,
        top=None if floating else held(dim),
        loads={"push": {"boundary": "block.right", "pressure": 0.1}},
    )


def blocks(system: System) -> tuple[Array, Array, NDArray[np.bool_]]:
    """K_B, its Schur complement on the contact dofs, and where these stand."""
    K = dense(system.K_B)
    c = np.zeros(len(K), bool)
    c[system.interface.dofs] = True
    return K, K[c][:, c] - K[c][:, ~c] @ np.linalg.solve(K[~c][:, ~c], K[~c][:, c]), c


@pytest.mark.parametrize(("by_blocks", "dim", "floating"), every_nth(2, [False, True], [2, 3], [False, True]))
def test_schur_complement_condense_and_expand_are_exact(
    dim: int, floating: bool, by_blocks: bool, scene_of: SceneOf, system_of: SystemOf
) -> None:
    system = system_of(scene_in(dim, scene_of, floating))
    K, S, c = blocks(system)
    volume = FactorisedVolume(system.K_B, system.interface.dofs, Counters())
    if by_blocks:  # what several ranks do, on one
        volume._parts[0]._factor_interior(system.interface.dofs)
        volume.S = BlockDiagonal.whole(volume._parts[0].S)
    assert_allclose(volume.S, S, atol=1e-13 * np.abs(K).max())
    assert_allclose(volume.S, np.transpose(volume.S), atol=1e-14 * np.abs(K).max())
    random = np.random.default_rng(0)
    f, u_c = random.normal(size=len(K)), random.normal(size=c.sum())
    f_vec = system.K_B.createVecRight()
    f_vec.array[:] = f
    interior = np.linalg.solve(K[~c][:, ~c], f[~c])
    assert_allclose(volume.condense(f_vec), f[c] - K[c][:, ~c] @ interior, atol=1e-11)
    q = volume.expand(f_vec, u_c).array
    assert_allclose(q[c], u_c, rtol=1e-15)
    assert_allclose(K[~c] @ q, f[~c], atol=1e-11)
    assert_allclose(f_vec.array, f, rtol=0)  # the caller's vector is left alone
    assert volume.counters.volume_solves == 2
    assert volume.counters.factorisations == 1
    assert volume.counters.schur_size == c.sum()


def test_fronts_of_low_rank_change_nothing_but_rounding(scene_of: SceneOf, system_of: SystemOf) -> None:
    fine = {"mesh_size": 1 / 160, "contact_mesh_size": 1 / 160, "cells": "tensor"}
    system = system_of(scene_of(2, fine, base=STICKING, top=held(2)))
    full, low = (
        FactorisedVolume(system.K_B, system.interface.dofs, Counters(), low_rank=low_rank) for low_rank in (False, True)
    )
    factor = low._parts[0]._ksp.getPC().getFactorMatrix()
    assert factor.getMumpsInfog(35) < 0.99 * factor.getMumpsInfog(29)  # entries stored, and without compression
    S = np.asarray(full.S)
    assert_allclose(low.S, S, rtol=0, atol=1e-13 * np.abs(S).max())  # measured: 3e-15
    f = system.K_B.createVecRight()
    f.array[:] = np.random.default_rng(0).normal(size=len(f.array))
    u_c = np.ones(len(S))
    q = full.expand(f, u_c)
    assert (low.expand(f, u_c) - q).norm() < 2e-12 * q.norm()  # measured: 5e-14


@pytest.mark.parametrize("by_blocks", [False, True])
def test_a_factorisation_that_mumps_gave_too_little_memory_is_repeated_with_more(
    by_blocks: bool, scene_of: SceneOf, system_of: SystemOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    system = system_of(scene_in(3, scene_of))
    contact_dofs = system.interface.dofs

    def schur_complement() -> Array:
        volume = FactorisedVolume(system.K_B, contact_dofs, Counters())
        if by_blocks:
            volume._parts[0]._factor_interior(contact_dofs)
        return volume._parts[0].S

    expected = schur_complement()
    monkeypatch.setattr(
        "stickslip.solvers.interface.factorised.WORKSPACE", (-90,)
    )  # nine tenths less than MUMPS asks for
    with pytest.raises(MachineError, match="too little memory"):
        schur_complement()
    monkeypatch.setattr("stickslip.solvers.interface.factorised.WORKSPACE", (-90, 100))
    assert_allclose(schur_complement(), expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_a_body_without_contact_is_solved_directly(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = replace(scene_in(2, scene_of), contacts={})
    simulation = simulation_of(scene)
    system = simulation.system
    (step,) = simulation.steps()
    T, K = dense(system.T), dense(whole(system))
    T = T[:, T.any(axis=0)]  # of the free numbers
    u_s = system.prescribed(1.0).array
    u = T @ np.linalg.solve(T.T @ K @ T, T.T @ (system.load(1.0).array - K @ u_s)) + u_s
    assert_allclose(simulation.stepper.start().u.norm(), 0.0)
    found = np.zeros((system.nodes.total, 2))
    found[np.argsort(np.argsort(system.nodes.input))] = u.reshape(-1, 2)
    assert_allclose(step.displacement, found, atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_surface_displacement_is_that_of_the_bodies(dim: int, scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(scene_in(dim, scene_of))
    K, _, c = blocks(system)
    surface = condensed_surface(system)
    p = np.random.default_rng(1).normal(size=len(surface.W))
    f = np.zeros(len(K))
    f[c] = surface.forces(p)
    assert_allclose(surface.displacement(surface.forces(p)), np.linalg.solve(K, f)[c], atol=1e-11)
    (rows,) = system.contacts
    # <N u, W p> = <u, B^T p>
    u_c = np.random.default_rng(2).normal(size=c.sum())
    assert_allclose((surface.N @ u_c) @ (surface.W * p), u_c @ surface.forces(p), rtol=1e-12)
    assert surface.normal_rows == len(rows.W_n)


@pytest.mark.parametrize("law", ["unilateral", "compliance"])
@pytest.mark.parametrize("dim", [2, 3])
def test_lambda_max_bounds_the_largest_eigenvalue(law: str, dim: int, scene_of: SceneOf, system_of: SystemOf) -> None:
    normal = {"law": law} | ({"c_n": 2.0} if law == "compliance" else {})
    system = system_of(scene_of(dim, base=STICKING | {"normal": normal}, top=held(dim)))
    surface = condensed_surface(system)
    root = np.sqrt(surface.W)[:, None]
    B = root * surface.N.toarray()
    exact = float(np.linalg.eigvalsh(B @ np.linalg.solve(surface.S, B.T)).max())
    assert exact <= surface.lambda_max * (1 + 1e-12)  # Uzawa's step must not be too long
    assert surface.lambda_max <= exact * (1 + 1e-3)  # nor much shorter than it may be
    assert surface.counters.lanczos_applications > 0
    assert surface.counters.volume_solves == 0  # kept apart


@pytest.mark.parametrize("dim", [2, 3])
def test_a_floating_body_feels_no_augmentation(dim: int, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    shelf = {"load": {"boundary": "block.top", "pressure": 0.1}, "push": {"boundary": "block.left", "pressure": 0.01}}
    scene = scene_of(dim, base=STICKING | {"normal": {"law": "compliance", "c_n": 2.0}}, loads=shelf)
    simulation = simulation_of(scene)
    stepper, surface = simulation.stepper, simulation.stepper.surface
    assert surface.R.shape[1] == (3 if dim == 2 else 6)
    assert_allclose(surface.R.T @ surface.R, np.eye(surface.R.shape[1]), atol=1e-13)
    assert_allclose(surface.S @ surface.R, 0.0, atol=1e-12 * np.abs(surface.S).max())  # rigid: no stiffness
    problem, found = surface_problem(simulation), []
    for factor in (0.1, 20.0):
        other: CondensedSurface = prepare_surface(stepper.system, stepper.chain.volume)
        other.rho *= factor
        augmented = replace(problem, surface=other)
        closed = np.zeros(len(other.W))
        closed[: other.normal_rows] = augmented.p_ref
        found.append(solve(linearise(augmented, closed, augmented.gamma), np.zeros(other.size)))
    (p, u), (q, v) = found
    assert np.abs(p).max() > 0.1
    assert_allclose(p, q, atol=1e-9 * np.abs(p).max())  # rounding, rho over a factor of 200
    assert_allclose(u, v, atol=1e-9 * np.abs(u).max())
    # and the contact carries the loads: R^T (f - B^T p) = 0
    assert_allclose(surface.R.T @ (problem.load.f_c - surface.forces(p)), 0.0, atol=1e-12)


def test_loads_in_the_span_of_earlier_ones_are_condensed_for_nothing(scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(scene_in(2, scene_of))
    volume = FactorisedVolume(system.K_B, system.interface.dofs, Counters())
    condense = MemoisedMap(volume.condense, len(volume.S))
    one, other = system.K_B.createVecRight(), system.K_B.createVecRight()
    random = np.random.default_rng(0)
    one.array[:], other.array[:] = random.normal(size=(2, one.getSize()))
    for vector, solves in [(one, 1), (2 * one, 1), (0 * one, 1), (one + 1e-3 * other, 2), (3 * other - one, 2)]:
        found = condense(vector)
        assert volume.counters.volume_solves == solves
        volume.counters.volume_solves = 0
        assert_allclose(found, volume.condense(vector), atol=1e-10 * np.abs(found).max(initial=1e-300))
        volume.counters.volume_solves = solves
    for factor in (1e-250, 1e250):  # whose squares are 0 or infinite
        assert_allclose(condense(factor * one), factor * condense(one), rtol=1e-12)
    assert not np.isfinite(condense(np.inf * one)).any()


def test_eight_directions_are_kept_and_given_on() -> None:
    asked = list[Vec]()
    double = MemoisedMap(lambda vector: asked.append(vector) or 2 * vector.array, 12)
    units = [PETSc.Vec().createSeq(12) for _ in range(9)]
    for k, vector in enumerate(units):
        vector[k] = 1.0
    for vector in units * 2:
        assert_allclose(double(vector), 2 * vector.array)
    assert len(asked) == 9 + 1  # the last one twice
    other = MemoisedMap(lambda vector: 3 * vector.array, 12, double)
    assert_allclose([other(vector) for vector in units], [*(2 * np.eye(12)[:8]), 3 * np.eye(12)[8]])
    assert len(asked) == 10


@pytest.mark.parametrize("dim", [2, 3])
def test_supports_that_move_a_body_as_a_whole_leave_no_load(dim: int, scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(replace(scene_in(dim, scene_of), loads={}))
    u_s = system.prescribed(1.0)
    assert system.pull(1.0, system.load(1.0), u_s).norm(0) == 0.0
    assert (system.K * u_s).norm() < 1e-13 * whole(system).norm() * u_s.norm()
    prescribed = u_s.array.reshape(-1, dim)[system.constraints.prescribed_nodes]
    assert_allclose(prescribed, system.constraints.prescribed(1.0), atol=1e-14)


def three_blocks() -> BlockDiagonal:
    """Their rows are not next to each other."""
    random = np.random.default_rng(0)
    indices = (np.array([0, 3, 4]), np.array([1]), np.array([2, 5]))
    return BlockDiagonal(indices, tuple((A := random.normal(size=(len(i),) * 2)) + A.T for i in indices))


def test_products_are_those_of_the_dense_matrix() -> None:
    matrix, random = three_blocks(), np.random.default_rng(1)
    dense = np.asarray(matrix)
    assert np.count_nonzero(dense) == 9 + 1 + 4
    x, X = random.normal(size=6), random.normal(size=(6, 2))
    assert_allclose(matrix @ x, dense @ x, rtol=1e-14)
    assert_allclose(matrix @ X, dense @ X, rtol=1e-14)
    left, right = (sparse.random(4, 6, 0.4, "csr", random_state=k) for k in (2, 3))
    assert_allclose(matrix.between(left, right.T.tocsr()), left @ dense @ right.T.toarray(), atol=1e-14)
    assert matrix.trace == pytest.approx(np.trace(dense), rel=1e-14)
    assert matrix.magnitude == pytest.approx(np.abs(dense).sum(), rel=1e-14)
    more = matrix.extended(2)
    assert_allclose(np.asarray(more), np.pad(dense, ((0, 2), (0, 2))))
    assert len(more) == 8
    assert_allclose(np.asarray(matrix.of_blocks(lambda index, block: 2 * block)), 2 * dense)
    joined = matrix.together(np.array([1, 0, 1]))
    assert [index.tolist() for index in joined.indices] == [[1], [0, 2, 3, 4, 5]]
    assert_array_equal(np.asarray(joined), dense)


@pytest.mark.parametrize(
    "scene",
    [
        ("stack", "geometry.mesh_size=0.25"),
        ("spheres", "geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.2"),
        ("two_blocks", "geometry.order=2"),
    ],
)
def test_parts_are_condensed_as_the_whole_is(scene: tuple[str, ...]) -> None:
    """Floating and held bodies; some have no node inside."""
    system = prepare(read(scene[0], scene[1:])).system
    dofs = system.interface.dofs
    apart = FactorisedVolume(system.K_B, dofs, Counters(), several=True)
    whole = FactorisedVolume(system.K_B, dofs, Counters())
    assert len(apart.S.blocks) == len(apart._parts) == system.mesh.part_count > 1  # prescribed nodes are no parts
    scale = np.abs(np.asarray(whole.S)).max()
    assert_allclose(np.asarray(apart.S), np.asarray(whole.S), atol=1e-12 * scale)
    f = system.K_B.createVecRight()
    f.array[:] = np.random.default_rng(0).normal(size=f.getLocalSize())
    assert_allclose(apart.condense(f), whole.condense(f), atol=1e-10)
    u_c = np.random.default_rng(1).normal(size=len(dofs)) / scale
    assert_allclose(apart.expand(f, u_c).array, whole.expand(f, u_c).array, atol=1e-9 / scale)
    one, other = (prepare_surface(system, volume) for volume in (apart, whole))
    force = np.random.default_rng(2).normal(size=one.size)
    expected = other.flexibility @ force
    near = 1e-9 * np.abs(expected).max()
    assert_allclose(one.displacement(force), expected, atol=near)  # by the factors
    assert_allclose(one.flexibility @ force, expected, atol=near)


def test_memory_and_time_are_foreseen_for_each_part() -> None:
    whole = Size(3, 20_730, 9e5, 14_781)
    parts = Size(3, 20_730, 9e5, 14_781, parts=((20_730 / 18, 14_781 / 18),) * 18)
    assert parts.dense_bytes < whole.dense_bytes / 3
    assert parts.condensed_seconds < whole.condensed_seconds / 2
    assert parts.matrix_free_seconds("tangent-cg") == whole.matrix_free_seconds("tangent-cg")


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
    assert mixed.getInfo()["nz_used"] < system.K_B.getInfo()["nz_used"]


@pytest.mark.parametrize("name", ["block", *slow("two_blocks")])
def test_a_condensed_run_never_assembles_the_matrix(
    name: str, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
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


TOP = {"x": 0.0, "y": 0.0, "z": -0.01}


def entries(matrix: Mat) -> Sparse:
    """A PETSc matrix of one rank, of scipy."""
    indptr, indices, data = matrix.getValuesCSR()
    return sparse.csr_matrix((data, indices, indptr), shape=matrix.size)


def test_boxes_lose_a_third_of_their_entries_and_no_accuracy(scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(scene_of(3, {"cells": "tensor", "mesh_size": 0.125}, base={}, top=TOP))
    K = whole(system)
    before, size = entries(K), K.getDiagonal().array.max()
    found = without_rounding(K)
    assert found.block_size == 3
    after = entries(found)
    assert after.nnz < 0.75 * before.nnz
    assert abs(after - before).max() < 3e-14 * size

    points = system.nodes.points
    rigid = rigid_fields(points, points.mean(axis=0), 1.0, False).reshape(before.shape[0], -1)
    forces_before, forces_after = (np.linalg.norm(K_u) for K_u in (before @ rigid, after @ rigid))
    assert forces_after < 1.2 * forces_before  # 1.9 if what is left out were not added to the node's own entries


def test_rows_are_looked_at_in_parts(monkeypatch: pytest.MonkeyPatch, scene_of: SceneOf, system_of: SystemOf) -> None:
    K = whole(system_of(scene_of(3, {"cells": "tensor", "mesh_size": 0.25}, base={}, top=TOP)))
    parts = K.copy()
    expected = without_rounding(K).getValuesCSR()
    monkeypatch.setattr("stickslip.solvers.system.stiffness.CHUNK", 7)
    for found, wanted in zip(without_rounding(parts).getValuesCSR(), expected, strict=True):
        assert_array_equal(found, wanted)


@pytest.mark.parametrize(
    ("changes", "less"), [({}, True), ({"top": None}, False), ({"cells": "simplex"}, False)],
    ids=["held boxes", "a body that floats", "tetrahedra"],
)  # fmt: skip
def test_only_held_bodies_of_boxes_are_changed(
    changes: dict[str, Any], less: bool, scene_of: SceneOf, system_of: SystemOf
) -> None:
    shape = {"cells": changes.get("cells", "tensor"), "mesh_size": 0.2}
    system = system_of(scene_of(3, shape, base={}, top=changes.get("top", TOP)))
    K = whole(system)
    free = np.setdiff1d(np.arange(K.size[0]), system.constraints.eliminated())
    kept, every = (entries(matrix)[free][:, free].count_nonzero() for matrix in (system.K_B, K))
    assert (kept < 0.8 * every) is less
    u = K.createVecRight()
    u.array[:] = np.random.default_rng(0).standard_normal(u.getLocalSize())
    assert_allclose((system.K * u).array, (K * u).array, rtol=0, atol=1e-13 * K.norm())


PLANE = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
RUBBING = {"friction": {"law": "coulomb", "mu": 0.3}}
PUSH = {"push": {"boundary": "block.right", "pressure": 0.03}}
HELD = {"top": {"x": 0.05, "y": -0.1}, "loads": PUSH}
FORMS: dict[str, dict[str, Any]] = {
    "held": HELD,
    "floating": {"loads": PUSH | {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}},
    "driven": HELD | {"obstacles": {"foundation": PLANE | {"force": {"y": 0.2}}}},
}


@pytest.fixture
def simulation_named(scene_of: SceneOf, simulation_of: SimulationOf) -> Callable[[str], Simulation]:
    def make(name: str) -> Simulation:
        return simulation_of(scene_of(bodies={"block": {"E": 3.0, "nu": 0.3}}, base=RUBBING, **FORMS[name]))

    return make


def condensed(simulation: Simulation) -> CondensedSurface:
    surface = simulation.stepper.surface
    assert isinstance(surface, CondensedSurface)
    return surface


def fresh(surface: CondensedSurface) -> CondensedSurface:
    """Another one of the same bodies, which has done nothing yet."""
    return CondensedSurface(
        surface.volume, N=surface.N, W=surface.W, R=surface.R, normal_rows=surface.normal_rows, driven=surface.driven
    )


@pytest.mark.parametrize("name", FORMS)
def test_displacements_are_in_equilibrium(name: str, simulation_named: Callable[[str], Simulation]) -> None:
    """On the contact dofs, S u = f_c - N^T W p + rho R (b - R^T u) with b = 0; on all dofs, K u = f - B^T p."""
    problem = surface_problem(simulation_named(name))
    surface = problem.surface
    assert isinstance(surface, CondensedSurface)
    p = np.random.default_rng(0).normal(size=len(problem.gap))
    before = surface.counters.volume_solves
    u_c = surface.under(problem.load, p)
    assert surface.counters.volume_solves == before + 1
    held = surface.S + surface.rho * surface.R @ surface.R.T
    force = problem.load.f_c - surface.N.T @ (surface.W * p)
    assert_allclose(held @ u_c, force, atol=1e-11 * np.abs(force).max())
    u = surface.recover(problem.load, p, u_c)
    own, K = len(u_c) - surface.driven, surface.volume.K
    read = surface.volume.contact.read
    assert_allclose(read(u), u_c[:own])
    left = K * u - problem.load.f_q  # - B^T p, and what holds a floating body
    on_contact = (surface.S @ u_c - problem.load.f_c)[:own]
    assert_allclose(read(left), on_contact, atol=1e-11 * np.abs(force).max())
    surface.volume.contact.write(left, np.zeros(own))
    assert np.abs(left.array).max() < 1e-11 * np.abs(force).max()


def test_the_inverse_is_formed_when_it_pays(
    simulation_named: Callable[[str], Simulation], monkeypatch: pytest.MonkeyPatch
) -> None:
    surface = fresh(condensed(simulation_named("held")))
    monkeypatch.setattr(schur_complement, "PAYS", surface.size / 2)  # after more than two forces
    formed = []
    for k in range(4):
        surface.displacement(np.eye(surface.size)[k])
        formed.append("flexibility" in surface._dense)
    assert formed == [False, False, True, True]


def as_after(surface: CondensedSurface, forces: Array) -> CondensedSurface:
    """A fresh one that has answered some forces, and condensed a load."""
    other = fresh(surface)
    for force in forces:
        other.displacement(force)
    return other


@pytest.mark.parametrize("count", [1, 3])
def test_a_restored_one_answers_to_the_last_bit(
    count: int, simulation_named: Callable[[str], Simulation], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before and after the inverse is formed."""
    problem = surface_problem(simulation_named("held"))
    surface = problem.surface
    assert isinstance(surface, CondensedSurface)
    monkeypatch.setattr(schur_complement, "PAYS", surface.size / 2)
    forces = np.random.default_rng(0).normal(size=(6, surface.size))
    one, other = as_after(surface, forces[:count]), fresh(surface)
    f_q = problem.load.f_q
    one._condensed(f_q)
    one._lambda_max = 7.0  # what Lanczos found
    snapshot = one.snapshot()
    snapshot["condensed"]["vectors"] = [own.values for own in snapshot["condensed"]["vectors"]]  # as read from a file
    other.restore(snapshot)
    assert other.lambda_max == 7.0
    solves = surface.counters.volume_solves
    assert_array_equal(other._condensed(2.0 * f_q), one._condensed(2.0 * f_q))
    assert surface.counters.volume_solves == solves  # of a known load
    for force in forces[count:]:
        assert_array_equal(other.displacement(force), one.displacement(force))
        assert set(other._dense) == set(one._dense)


def test_once_the_inverse_is_formed_the_count_is_no_state(
    simulation_named: Callable[[str], Simulation], monkeypatch: pytest.MonkeyPatch
) -> None:
    surface = condensed(simulation_named("held"))
    monkeypatch.setattr(schur_complement, "PAYS", surface.size / 2)
    forces = np.random.default_rng(0).normal(size=(6, surface.size))
    kept = [as_after(surface, forces[:count]).snapshot() for count in (0, 1, 3, 5)]
    assert [(each["forces"], each["inverted"]) for each in kept] == [(0, False), (1, False), (0, True), (0, True)]


def test_other_contact_pairs_take_over_what_is_known_of_bodies(simulation_named: Callable[[str], Simulation]) -> None:
    surface = condensed(simulation_named("held"))
    forces = np.random.default_rng(0).normal(size=(6, surface.size))
    one, other = as_after(surface, forces), fresh(surface)
    other.adopt(one)
    assert other.flexibility is one.flexibility
    assert other._condensed is one._condensed
    # the factor is there, too: the first answer comes from the inverse, to the last bit
    assert_array_equal(other.displacement(forces[0]), one.flexibility @ forces[0])


@pytest.mark.parametrize("name", FORMS)
def test_a_load_with_more_forces_is_that_of_their_sum(name: str, simulation_named: Callable[[str], Simulation]) -> None:
    """But for its displacement without contact; forces that no rigid mode feels leave the resultant as it is."""
    surface, random = condensed(simulation_named(name)), np.random.default_rng(0)
    one, other = surface.volume.K.createVecRight(), surface.volume.K.createVecRight()
    one.array[:], other.array[:] = random.normal(size=(2, one.getLocalSize()))
    load = surface.load(one, random.normal(size=surface.driven))
    expected, condensed_too = surface.load(one + other, load.driving), surface.volume.condense(other)
    for found in (surface.with_more(load, other, balanced=False), surface.with_condensed(load, other, condensed_too)):
        assert_array_equal(found.f_q.array, (one + other).array)
        assert_allclose(found.f_c, expected.f_c, atol=1e-11)
        assert_allclose(found.resultant, expected.resultant, atol=1e-11)
        assert found.free is load.free
    assert surface.with_more(load, other, balanced=True).resultant is load.resultant


def bodies_of_blocks() -> CondensedSurface:
    """A held body, one that floats, and a driven obstacle, of any stiffness; their dofs are not next to each other."""
    random = np.random.default_rng(4)
    held, floating = (A @ A.T for A in random.normal(size=(2, 3, 3)))
    R = np.zeros((7, 2))
    R[[1, 4, 5], 0], R[6, 1] = [0.6, 0.0, 0.8], 1.0
    strains = np.eye(3) - np.outer(R[[1, 4, 5], 0], R[[1, 4, 5], 0])
    S = BlockDiagonal((np.array([0, 2, 3]), np.array([1, 4, 5])), (held, strains @ floating @ strains))
    N = sparse.csr_matrix(np.vstack([np.eye(7) + 0.2 * random.normal(size=(7, 7)), random.normal(size=(2, 7))]))
    volume: Any = SimpleNamespace(S=S, counters=Counters(), condense=None)
    return CondensedSurface(volume, N=N, W=random.uniform(1.0, 2.0, 9), R=R, normal_rows=4, driven=1)


def asked(surface: CondensedSurface) -> list[Array]:
    """All that is computed once and kept: flexibility, Delassus matrix, its diagonal and norm, stiffness by rows."""
    first, N = np.arange(9) < 7, surface.N.toarray()[:7]
    bodies = surface.row_stiffness(first)
    assert bodies is not None
    S = N.T @ bodies.H @ N
    return [np.asarray(surface.flexibility), surface.delassus, surface.give, np.array(surface.lambda_max), S]


def by_definition(surface: CondensedSurface, S: Array, R: Array) -> list[Array]:
    """The same by matrices of all dofs."""
    N, W = surface.N.toarray(), surface.W
    flexibility = np.linalg.inv(S + surface.rho * R @ R.T)
    D = N @ flexibility @ N.T * W
    return [flexibility, D, np.diag(D), np.linalg.eigvals(D).real.max(), S]


@pytest.mark.parametrize(("dofs", "blocks"), [([0, 2, 3], 3), ([0, 1, 3], 2)])
def test_bodies_on_springs_and_with_bolts_that_give_way_have_another_stiffness(dofs: list[int], blocks: int) -> None:
    """A bolt, in the held body or through both, gives way to v without force: H = S v, M = v^T S v."""
    surface = bodies_of_blocks()
    S, R, v = np.asarray(surface.S), surface.R, np.zeros((7, 1))
    v[dofs, 0] = [0.5, -0.3, 0.4]
    v -= R @ R.T @ v
    H = S @ v
    compliant, size = H.T / (v.T @ H), np.linalg.norm(v)
    before = asked(surface)
    softened = surface.softened(H, compliant, v)
    assert len(softened.S.blocks) == blocks
    for found, expected, modes in (
        (surface, S, R),
        (bodies_of_blocks().on_springs(0.7), S + 0.7 * R @ R.T, R[:, :0]),  # of which nothing was asked
        (softened, S - H @ compliant, np.column_stack([R, v / size])),
    ):
        assert_allclose(found.R @ found.R.T, modes @ modes.T, atol=1e-14)
        for one, other in zip(asked(found), by_definition(found, expected, modes), strict=True):
            assert_allclose(one, other, rtol=1e-3 if one.ndim == 0 else 0, atol=1e-11 * np.abs(other).max())
        tangent = np.diag(np.arange(7.0))
        factor = np.tril(found.factor(tangent)[0])
        assert_allclose(factor @ factor.T, expected + tangent + surface.rho * modes @ modes.T, atol=1e-12)
    for one, other in zip(asked(surface), before, strict=True):
        assert_array_equal(one, other)


def test_what_is_not_finite_goes_through_a_factor() -> None:
    """Or LAPACK says that it fails: a step ends by either, not by an error of ours."""
    with suppress(np.linalg.LinAlgError):
        assert np.isnan(bodies_of_blocks().factor(np.full((7, 7), np.nan))[0]).any()


@pytest.mark.parametrize("rows", [9, 8])
def test_other_contact_pairs_take_over_products_of_rows_that_are_the_same(rows: int) -> None:
    surface, N = bodies_of_blocks(), bodies_of_blocks().N.toarray()[:rows]
    N[[1, 5]] *= 2.0
    other = CondensedSurface(
        surface.volume, N=sparse.csr_matrix(N), W=surface.W[:rows], R=surface.R, normal_rows=4, driven=1
    )
    surface.coupling(np.eye(9)[[1, 3]], np.eye(9)[:, [5, 7]])
    other.adopt(surface)
    assert_array_equal(other._delassus[0], [3, 7] if rows == 9 else [])
    assert_allclose(other.delassus, N @ np.asarray(surface.flexibility) @ N.T * other.W, atol=1e-11)
    assert_array_equal(np.sort(other._delassus[0]), np.arange(rows))  # each of them once


def test_the_complement_by_rows_is_of_those_rows(simulation_named: Callable[[str], Simulation]) -> None:
    surface = condensed(simulation_named("held"))
    rows = np.ones(len(surface.W), bool)
    bodies = surface.row_stiffness(rows)
    N = surface.N.toarray()
    assert_allclose(N.T @ bodies.H @ N, surface.S, atol=1e-11 * np.abs(surface.S).max())
    assert surface.row_stiffness(rows) is bodies
    assert surface.row_stiffness(np.zeros_like(rows)) is None


@pytest.mark.parametrize(("scales", "determined"), [((1e6, 1e-1), True), ((1e6, 1e-4), False), ((1e-6, 1e-9), True)])
def test_rows_that_hardly_determine_a_dof_are_refused(scales: tuple[float, float], determined: bool) -> None:
    """By their pivots' ratio, whatever the unit."""
    N, S = sparse.diags(scales).tocsr(), np.eye(2)
    assert (RowStiffness.of(N, BlockDiagonal.whole(S), np.ones(2, bool)) is not None) is determined


def test_a_driven_obstacle_is_a_dof_without_stiffness(simulation_named: Callable[[str], Simulation]) -> None:
    surface = condensed(simulation_named("driven"))
    assert surface.driven == 1
    assert not np.asarray(surface.S)[-1].any()
    assert surface.floating


def smooth(make: SceneOf, dim: int, **tables: Any) -> Scene:
    """A block without friction, pressed from the side and from above."""
    return make(dim, **{"base": {}, "top": dict.fromkeys("xyz"[:dim], -0.1)} | tables)


@pytest.mark.parametrize(("dim", "count"), [pytest.param(2, 9, marks=pytest.mark.slow), (3, 15)])
def test_without_friction_only_normal_displacements_are_condensed(
    dim: int, count: int, scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = simulation_of(smooth(scene_of, dim))
    (step,) = simulation.steps()
    with_friction = simulation_of(smooth(scene_of, dim, base=RUBBING))
    assert (simulation.counters.schur_size, with_friction.counters.schur_size) == (count, dim * count)
    inclined = {"foundation": {"shape": "plane", "point": [0.0] * dim, "normal": [0.1] * (dim - 1) + [1.0]}}
    assert simulation_of(smooth(scene_of, dim, obstacles=inclined)).counters.schur_size == dim * count
    whole = simulation_of(smooth(scene_of, dim, solver={"method": "surface-uzawa"}))
    (other,) = whole.steps()
    assert whole.counters.schur_size == dim * count
    assert_allclose(step.displacement, other.displacement, atol=1e-6)
    monkeypatch.setattr(CondensedNewton, "__call__", broken)  # the next method of the chain needs all of them
    (instead,) = simulation.steps()
    assert_allclose(instead.displacement, other.displacement, atol=1e-6)
    assert simulation.stepper.chain.switches[0].after == "surface-uzawa (condensed)"
    assert simulation.stepper.chain.reached.whole
    assert (simulation.counters.factorisations, simulation.counters.schur_size) == (2, dim * count)


def broken(method: CondensedNewton, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
    return Solution(p=p, w=p, u_c=np.zeros(0), status=Status.STALLED, residual=1.0, history=())


def test_it_is_set_up_once_even_if_its_matrix_was_changed_for_a_while(scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(scene_of(3, base=RUBBING))
    K = system.K_B.copy()  # as `system` keeps its own
    pc = multigrid(K, False, lambda: near_nullspace(system), "test_")
    r, z = K.createVecLeft(), K.createVecRight()
    r.array[:] = np.random.default_rng(0).standard_normal(r.getLocalSize())

    def cycle() -> Array:
        pc.apply(r, z)
        return z.array_r.copy()

    before = cycle()
    K.scale(2.0)  # with another matrix it would be half as much
    assert_array_equal(cycle(), before)


@pytest.mark.parametrize("order", [2, 3])
def test_inverses_are_those_of_lapack(order):
    given = np.random.default_rng(order).standard_normal((50, order, order))
    given[0] = np.diag(10.0 ** np.arange(order) * 1e-9)  # of metres and micrometres, newtons and meganewtons
    given[1] = np.diag([1.0] + [1e12] * (order - 1))
    wanted = np.linalg.inv(given)

    found = inverses(given)
    assert np.allclose(found @ given, np.eye(order), rtol=0, atol=1e-9)
    assert np.all(np.abs(found - wanted) <= 1e-10 * np.linalg.norm(wanted, axis=(1, 2))[:, None, None])

    by_cofactors, determinant = inverse_and_determinant(np.moveaxis(given, 0, -1))
    assert np.array_equal(np.moveaxis(by_cofactors, -1, 0), found)
    assert np.allclose(determinant, np.linalg.det(given), rtol=1e-9, atol=0)


def block(scene_of: SceneOf, dim: int, n: int, floating: bool = False) -> Scene:
    held = None if floating else dict.fromkeys("xyz"[:dim], 0.0)
    return scene_of(dim, {"mesh_size": 1 / n, "cells": "tensor"}, base={}, top=held)


COARSENED: dict[str, Callable[[SceneOf], Scene]] = {
    "block": lambda make: block(make, 2, 16),
    "cube": lambda make: block(make, 3, 6),
    "two bodies": lambda make: read("two_blocks", ["geometry.mesh_size=0.25", "geometry.contact_mesh_size=0.12"]),
    "one held, one not, curved": lambda make: read(
        "cylinders", ["geometry.mesh_size=2.0", "geometry.contact_mesh_size=0.12"]
    ),
    "floating in the plane": lambda make: block(make, 2, 16, floating=True),
    "floating in space": lambda make: block(make, 3, 6, floating=True),
}


@pytest.mark.parametrize("name", COARSENED)
def test_smooth_forces_do_about_what_it_says(name: str, scene_of: SceneOf, system_of: SystemOf) -> None:
    """Cells twice as large, of order 1: their energy is wrong by a few percent where the force is a parabola."""
    fine = system_of(COARSENED[name](scene_of))
    coarse, exact = CoarseMesh.beside(fine), condensed_surface(fine)
    assert coarse.system.constraints.free_total <= LEAST * fine.constraints.free_total
    forces, displacements = coarse.smooth_responses(fine, exact.R, exact.rho)
    true = exact.flexibility @ forces
    work, true_work = forces.T @ displacements, forces.T @ true
    acting = np.diag(true_work) > 1e-12 * np.diag(true_work).max()  # flat sides: the square of 0 is 0
    assert acting.sum() >= 3 * fine.mesh.dim  # 1, x, x² for each component, at least
    assert_allclose(np.diag(work)[acting], np.diag(true_work)[acting], rtol=0.15 if fine.mesh.dim == 2 else 0.2)
    assert_allclose(work, true_work, rtol=0, atol=0.1 * np.abs(true_work).max())
    assert not displacements[:, ~acting].any()


def test_a_rigid_motion_is_answered_by_the_augmentation_of_bodies(scene_of: SceneOf, system_of: SystemOf) -> None:
    fine = system_of(block(scene_of, 2, 16, floating=True))
    coarse, exact = CoarseMesh.beside(fine), condensed_surface(fine)
    for rho in (exact.rho, 7 * exact.rho):
        forces, displacements = coarse.smooth_responses(fine, exact.R, rho)
        assert_allclose(exact.R.T @ displacements, exact.R.T @ forces / rho, atol=1e-12 * np.abs(forces).max() / rho)


def test_the_method_begins_with_what_it_says(scene_of: SceneOf, system_of: SystemOf) -> None:
    """The metric alone is wrong by half for smooth forces, primed it is right."""
    fine = system_of(block(scene_of, 3, 6))
    coarse, exact, metric = CoarseMesh.beside(fine), condensed_surface(fine), surface_metric(fine)
    smooth = coarse.smooth_responses(fine, exact.R, exact.rho)
    primed = LearningIteration(metric=metric, smooth=lambda: smooth)._primed()
    press = smooth[0][:, 2]  # of a constant normal traction
    true = press @ exact.flexibility @ press
    assert abs(press @ primed(press) / true - 1) < 0.1
    assert abs(press @ metric(press) / true - 1) > 0.2


def test_a_mesh_file_has_no_coarse_mesh_beside(system_of: SystemOf, tmp_path: Path) -> None:
    data = scene_data(draw(tmp_path / "b.msh", 2))
    assert CoarseMesh.beside(system_of(from_dict(data))) is None
    (tmp_path / "b.geo").write_text(GEO)
    drawn_anew = scene_data(tmp_path / "b.geo", mesh_size=0.2)
    assert CoarseMesh.beside(system_of(from_dict(drawn_anew))) is not None


@pytest.mark.parametrize(("n", "there"), [(2, True), (1, False)])
def test_no_coarse_mesh_where_it_is_hardly_coarser(n: int, there: bool, scene_of: SceneOf, system_of: SystemOf) -> None:
    fine = system_of(block(scene_of, 2, n))
    coarse = CoarseMesh.beside(fine)
    assert (coarse is not None) == there


def test_its_work_stands_in_the_result(tmp_path: Path) -> None:
    words = ["geometry.mesh_size=0.2", "output.error=false", "output.pictures=false"]
    solver = 'solver={ method = "surface-uzawa", surface = "matrix-free" }'
    _, result = run(read("cube", [*words, solver]), tmp_path / "out")
    work = result["counters"]["coarse_mesh"]
    assert work["factorisations"] == 1
    assert work["volume_solves"] > 0


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
    monkeypatch.setattr(multigrid_of, "HYPRE", False)
    for one, other in zip(stickslip.steps(free), exact, strict=True):
        # the scene's tolerance is 1e-8; BoomerAMG and GAMG both leave up to 4e-8 of the displacement
        assert_allclose(one.displacement, other.displacement, atol=3e-7 * np.abs(other.displacement).max())


def test_coarse_spaces_of_gamg_hold_the_rotation(system_of: SystemOf) -> None:
    """A clamped strip, a hundred times as long as it is thick: without its rotation, bending is seen too late."""
    system = system_of(stickslip.read("strip", STRIP))
    motions = near_nullspace(system)

    def iterations(kept: int) -> int:
        ksp, force = PETSc.KSP().create(), system.K_B.createVecRight()
        force.array[:] = motions.sum(axis=1)
        ksp.setOperators(system.K_B)
        ksp.setType("cg")
        ksp.setTolerances(rtol=1e-8)
        ksp.setPC(multigrid_of.gamg(system.K_B, motions[:, :kept], "strip_"))
        ksp.solve(force, force.duplicate())
        return int(ksp.getIterationNumber())

    assert motions.shape[1] == 3
    assert iterations(3) < 100 < iterations(2) / 2


def test_mumps_in_place_of_cholmod_factorises(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cholesky, "SOLVER", "mumps")
    A = sparse.diags([-1.0, 2.5, -1.0], [-1, 0, 1], shape=(50, 50))
    x = np.random.default_rng(0).standard_normal((50, 3))
    assert_allclose(A @ SparseCholesky(A).solve(x), x, atol=1e-13)
