"""The boundary metric: near what the bodies give at any mesh size, exact on what was measured."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import eigh

from stickslip.geometry.surfaces.surface import lumped_mass, surface_stiffness
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.linear.cholesky import InverseRoot, poles
from stickslip.solvers.metrics import Secants, surface_metric
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.system.system import System
from stickslip.workflows.scene_file.read import read

Array = NDArray[np.float64]
SceneOf = Callable[..., Scene]
SystemOf = Callable[[Scene], System]
BASE = {"base": {"surface": "block.bottom", "against": "foundation"}}


def block(scene_of: SceneOf, dim: int, n: int, order: int = 1) -> Scene:
    top = {"boundary": "block.top", "displacement": dict.fromkeys("xyz"[:dim], 0.0)}
    size = {"mesh_size": 1 / n, "cells": "tensor", "order": order}
    return scene_of(dim, size, contacts=BASE, supports={"top": top})


def spectrum(system: System, layer: bool = True) -> Array:
    """Eigenvalues of K_B^-1 on the contact dofs beside the metric, or beside its formula alone."""
    surface = prepare_surface(system, FactorisedVolume(system.K_B, system.interface.dofs, Counters()))
    assert isinstance(surface, CondensedSurface)
    metric = surface_metric(system)
    if not layer:
        metric._layer = None
    F = metric(np.eye(surface.size))
    assert_allclose(F, F.T, atol=1e-12 * np.abs(F).max())
    return np.asarray(eigh(surface.flexibility, (F + F.T) / 2, eigvals_only=True))


@pytest.mark.parametrize(("order", "sizes"), [(1, (8, 16, 32, 64)), (2, (8, 16, 32))])
def test_the_metric_is_equivalent_to_the_bodies_at_every_mesh_size_in_the_plane(
    order: int, sizes: tuple[int, ...], scene_of: SceneOf, system_of: SystemOf
) -> None:
    ends = np.array([spectrum(system_of(block(scene_of, 2, n, order)))[[0, -1]] for n in sizes])
    assert ends.min() > 0.4  # half-plane: 1; the held layer gives less,
    assert ends.max() < 3  # a free corner about 3 times as much
    assert_allclose(ends / ends[-1], 1.0, atol=0.1)


@pytest.mark.parametrize(("order", "sizes"), [(1, (4, 6, 8)), (2, (2, 3, 4))])
def test_in_space_the_layer_of_cells_brings_it_nearer_at_every_mesh_size(
    order: int, sizes: tuple[int, ...], scene_of: SceneOf, system_of: SystemOf
) -> None:
    systems = [system_of(block(scene_of, 3, n, order)) for n in sizes]
    ends = np.array([spectrum(system)[[0, -1]] for system in systems])
    alone = np.array([spectrum(system, layer=False)[[0, -1]] for system in systems])
    assert ends.min() > 0.45
    assert ends.max() < 3.5
    assert_allclose(alone[:, 1], 5.2, atol=0.1)  # a cube's corner beside a half-space
    condition, without = ends[:, 1] / ends[:, 0], alone[:, 1] / alone[:, 0]
    assert (condition < 0.65 * without).all()


@pytest.mark.parametrize(("name", "size"), [
    ("two_blocks", (0.3, 0.15)), ("two_blocks", (0.16, 0.08)),
    ("cylinders", (3.0, 0.25)), ("cylinders", (2.0, 0.12)),
])  # fmt: skip
def test_so_it_is_for_two_bodies_and_curved_sides(name: str, size: tuple[float, float], system_of: SystemOf) -> None:
    sizes = [f"geometry.mesh_size={size[0]}", f"geometry.contact_mesh_size={size[1]}"]
    scene = read(name, sizes)
    found = spectrum(system_of(scene))
    assert found[0] > 0.3  # 0.33 to 0.42 on finer and coarser meshes, without a trend
    assert found[-1] < 3


@pytest.mark.parametrize(("ratio", "count", "error"), [(1e2, 8, 1e-8), (1e4, 8, 1e-5), (1e6, 8, 1e-3), (1e6, 12, 1e-5)])
def test_a_few_poles_give_the_inverse_root(ratio: float, count: int, error: float) -> None:
    """2 exp(-2 pi² count / (log ratio + 3)), the bound of the source: 4e-9, 1e-5 (half), 3e-4, 3e-6."""
    weights, shifts = poles(1.0, ratio, count)
    x = np.geomspace(1.0, ratio, 500)
    assert weights.min() > 0
    assert_allclose((weights / (x[:, None] + shifts)).sum(axis=1) * np.sqrt(x), 1.0, atol=error)


@pytest.mark.parametrize(("count", "error"), [(4, 1e-5), (8, 5e-11)])
def test_the_inverse_root_of_a_matrix_squares_to_its_inverse(count: int, error: float) -> None:
    """Twice the bound above for the ratio 22: 9e-6, 2e-11."""
    n = 40
    A = sparse.diags([np.full(n, 2.2), np.full(n - 1, -1.0), np.full(n - 1, -1.0)], [0, 1, -1]).tocsr()
    root = InverseRoot(A, 0.2, count)(np.eye(n))
    assert_allclose(root @ root @ A.toarray(), np.eye(n), atol=error)


@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1), (3, 2)])
def test_surface_forms_integrate_linear_fields_exactly(
    dim: int, order: int, scene_of: SceneOf, system_of: SystemOf
) -> None:
    system = system_of(block(scene_of, dim, 3, order))
    (rows,) = system.contacts
    L, mass, x = surface_stiffness(rows.surface), lumped_mass(rows.surface), rows.surface.points[:, 0]
    area = 2.0  # a 2 x 1 side, or 2 long
    assert_allclose(mass.sum(), area, rtol=1e-12)
    assert mass.min() > 0
    assert_allclose(x @ L @ x, area, rtol=1e-12)  # ∫ |grad x|²
    assert_allclose(L @ np.ones(len(x)), 0.0, atol=1e-12)


@pytest.fixture
def measured() -> tuple[Array, Array, Secants]:
    """A flexibility, six forces and a guess that learnt of them."""
    random = np.random.default_rng(3)
    Q = np.linalg.qr(random.normal(size=(30, 30)))[0]
    F, S = Q @ np.diag(np.geomspace(1e-3, 1.0, 30)) @ Q.T, random.normal(size=(30, 6))
    known = Secants(lambda f: 0.3 * f, np.zeros((30, 0)), np.zeros((30, 0)))
    for s in S.T:
        known.learn(s, F @ s)
    return F, S, known


def test_what_was_measured_is_exact_and_the_rest_stays_positive(measured: tuple[Array, Array, Secants]) -> None:
    F, S, known = measured
    assert_allclose(known(S), F @ S, atol=1e-12)
    matrix = known(np.eye(30))
    assert_allclose(matrix, matrix.T, atol=1e-12)
    assert np.linalg.eigvalsh(matrix).min() > 1e-5  # F itself reaches down to 1e-3
    assert np.abs(known(np.eye(30)) - F).max() > 0.1  # and six forces are not all


def test_a_pair_that_says_nothing_new_is_left_out(measured: tuple[Array, Array, Secants]) -> None:
    F, S, known = measured
    known.learn(S @ np.arange(1.0, 7.0), F @ S @ np.arange(1.0, 7.0))
    assert known.count == 6
    known.learn(S[:, 0], -S[:, 0])  # the error of a solve, larger than what it measured
    assert known.count == 6
    assert_allclose(known(S), F @ S, atol=1e-9)


def test_a_pair_that_leaves_nothing_positive_is_left_out() -> None:
    """A guess that gives nothing under a force cannot be corrected along it: S^T F S has no Cholesky factor."""
    guess = np.diag([0.0, 0.5, 0.5])
    known = Secants(lambda f: guess @ f, np.zeros((3, 0)), np.zeros((3, 0)))
    known.learn(np.array([0.0, 1.0, 1.0]), np.array([0.0, 1.0, 1.0]))
    before = known(np.eye(3))
    known.learn(np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    known.learn(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, np.nan]))
    assert known.count == 1
    assert_allclose(known(np.eye(3)), before, rtol=0)
    known.learn(np.array([0.0, 1.0, -1.0]), np.array([0.0, 1.0, -1.0]))
    assert known.count == 2  # and it goes on learning
    assert_allclose(known(np.array([0.0, 1.0, 0.0])), [0.0, 1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("noise", [1e-8, 1e-3, 0.1])
def test_inexact_measurements_leave_it_positive_and_bounded(noise: float) -> None:
    random = np.random.default_rng(4)
    F = np.diag(np.geomspace(0.05, 1.0, 30))
    known = Secants(lambda f: 0.3 * f, np.zeros((30, 0)), np.zeros((30, 0)))
    direction = random.normal(size=30)
    for _ in range(40):  # ever more alike, as steps of an iteration are
        direction = F @ direction + 0.3 * random.normal(size=30)
        exact = F @ direction
        known.learn(direction, exact + noise * np.linalg.norm(exact) * random.normal(size=30) / np.sqrt(30))
    values = np.linalg.eigvalsh(known(np.eye(30)))
    assert values.min() > 0
    assert values.max() < 3  # F: 1
