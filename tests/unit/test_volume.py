"""The bodies prepared once: what the surface feels is exact, by dense algebra."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from shared.cases import every_nth
from shared.matrices import dense, whole
from stickslip.geometry.errors import MachineError
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.linear.block_diagonal import BlockDiagonal
from stickslip.solvers.linear.memoised_map import MemoisedMap
from stickslip.solvers.newton.active_set import linearise
from stickslip.solvers.newton.condensed_system import solve
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.system.system import System

Array = NDArray[np.float64]
SceneOf = Callable[..., Scene]
SystemOf = Callable[[Scene], System]
STICKING = {"base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "stick"}}}


def held(dim: int) -> dict[str, Any]:
    return {"top": {"boundary": "block.top", "displacement": dict(zip("xyz"[:dim], (0.0, -0.1, -0.05), strict=False))}}


def scene_in(dim: int, scene_of: SceneOf, floating: bool = False) -> Scene:
    return scene_of(
        dim,
        {"contact_mesh_size": 0.2 if dim == 2 else 0.4},
        contacts=STICKING,
        supports={} if floating else held(dim),
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
    system = system_of(scene_of(2, fine, contacts=STICKING, supports=held(2)))
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


def test_a_body_without_contact_is_solved_directly(
    scene_of: SceneOf, simulation_of: Callable[[Scene], Simulation]
) -> None:
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
    surface = prepare_surface(system, FactorisedVolume(system.K_B, system.interface.dofs, Counters()))
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
def test_lambda_max_bounds_the_largest_eigenvalue_closely(
    law: str, dim: int, scene_of: SceneOf, system_of: SystemOf
) -> None:
    normal = {"law": law} | ({"c_n": 2.0} if law == "compliance" else {})
    scene = scene_of(dim, contacts={"base": STICKING["base"] | {"normal": normal}}, supports=held(dim))
    system = system_of(scene)
    surface = prepare_surface(system, FactorisedVolume(system.K_B, system.interface.dofs, Counters()))
    root = np.sqrt(surface.W)[:, None]
    B = root * surface.N.toarray()
    exact = float(np.linalg.eigvalsh(B @ np.linalg.solve(surface.S, B.T)).max())
    assert exact <= surface.lambda_max * (1 + 1e-12)  # Uzawa's step must not be too long
    assert surface.lambda_max <= exact * (1 + 1e-3)  # nor much shorter than it may be
    assert surface.counters.lanczos_applications > 0
    assert surface.counters.volume_solves == 0  # kept apart


@pytest.mark.parametrize("dim", [2, 3])
def test_a_floating_body_does_not_feel_its_augmentation(
    dim: int, scene_of: SceneOf, simulation_of: Callable[[Scene], Simulation]
) -> None:
    shelf = {"load": {"boundary": "block.top", "pressure": 0.1}, "push": {"boundary": "block.left", "pressure": 0.01}}
    scene = scene_of(
        dim,
        contacts={"base": STICKING["base"] | {"normal": {"law": "compliance", "c_n": 2.0}}},
        loads=shelf,
    )
    stepper = simulation_of(scene).stepper
    surface = stepper.surface
    assert surface.R.shape[1] == (3 if dim == 2 else 6)
    assert_allclose(surface.R.T @ surface.R, np.eye(surface.R.shape[1]), atol=1e-13)
    assert_allclose(surface.S @ surface.R, 0.0, atol=1e-12 * np.abs(surface.S).max())  # rigid: no stiffness
    accepted = stepper.reach(stepper.start(), 1.0, lambda row: None)
    found = []
    for factor in (0.1, 20.0):
        other: CondensedSurface = prepare_surface(stepper.system, stepper.chain.volume)
        other.rho *= factor
        problem = replace(accepted.problem, surface=other)
        closed = np.zeros(len(other.W))
        closed[: other.normal_rows] = problem.p_ref
        found.append(solve(linearise(problem, closed, problem.gamma), np.zeros(problem.surface.size)))
    (p, u), (q, v) = found
    assert np.abs(p).max() > 0.1
    assert_allclose(p, q, atol=1e-9 * np.abs(p).max())  # rounding, rho over a factor of 200
    assert_allclose(u, v, atol=1e-9 * np.abs(u).max())
    # and the contact carries the loads: R^T (f - B^T p) = 0
    assert_allclose(surface.R.T @ (accepted.problem.load.f_c - surface.forces(p)), 0.0, atol=1e-12)


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


@pytest.mark.parametrize("dim", [2, 3])
def test_supports_that_move_a_body_as_a_whole_leave_no_load(dim: int, scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(replace(scene_in(dim, scene_of), loads={}))
    u_s = system.prescribed(1.0)
    assert system.pull(1.0, system.load(1.0), u_s).norm(0) == 0.0
    assert (system.K * u_s).norm() < 1e-13 * whole(system).norm() * u_s.norm()
    prescribed = u_s.array.reshape(-1, dim)[system.constraints.prescribed_nodes]
    assert_allclose(prescribed, system.constraints.prescribed(1.0), atol=1e-14)
