"""Bodies that share no node are condensed apart: the same as together, in less memory."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import sparse

from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.linear.block_diagonal import BlockDiagonal
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.stepping.choice import Size
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import read


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
    assert len(apart.S.blocks) == system.mesh.part_count > 1
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
