"""The slip tangent, and the solvers it is tried with."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy import sparse

from stickslip.geometry.errors import MachineError
from stickslip.solvers.classical.contact_element import SLIP, penalties
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.workflows.lab.analysis.slip_tangent import SlipTangent, unsymmetry
from stickslip.workflows.lab.analysis.tangent_solves import ILU, condition, dropped_fill, gauss_seidel, gmres, mumps
from stickslip.workflows.lab.studies.published.contact import march, scene

Array = NDArray[np.float64]
ILUS = [ILU(), ILU(relaxation=0.9), ILU(relaxation=1.0), ILU(shift=1e-2), ILU(levels=1)]


@pytest.fixture(scope="module")
def solved() -> tuple[SlipTangent, CondensedSurface]:
    """The block dragged until a part slips, and its bodies."""
    simulation, accepted, status = march(scene(2, 6, drag=0.07, method="perturbed-lagrangian"))
    assert status == "converged"
    surface = accepted[-1].problem.surface
    assert isinstance(surface, CondensedSurface)
    return SlipTangent.at(simulation.system, accepted[-1], penalties(simulation.system, 1000.0)), surface


def upwind(n: int) -> Any:
    """Diffusion and drift on n x n nodes: an unsymmetric M-matrix."""
    line = sparse.diags([np.full(n, 3.0), np.full(n - 1, -2.0), np.full(n - 1, -1.0)], [0, -1, 1])
    return sparse.csr_matrix(sparse.kron(line, sparse.eye(n)) + sparse.kron(sparse.eye(n), line))


def incomplete(A: Array) -> tuple[Array, Array]:
    """L and U of ILU(0), dense, as Saad writes it."""
    F, pattern = A.copy(), A != 0
    for i in range(1, len(F)):
        for k in np.flatnonzero(pattern[i, :i]):
            F[i, k] /= F[k, k]
            right = pattern[i] & (np.arange(len(F)) > k)
            F[i, right] -= F[i, k] * F[k, right] * pattern[k, right]
    return np.tril(F, -1) + np.eye(len(F)), np.triu(F)


def test_relaxed_by_one_the_factors_keep_row_sums() -> None:
    A = upwind(6)
    plain, kept = (incomplete((A + sparse.diags(r * dropped_fill(A, r))).toarray()) for r in (0.0, 1.0))
    sums = A @ np.ones(36)
    assert_allclose(kept[0] @ kept[1] @ np.ones(36), sums, atol=1e-13)
    assert np.abs(plain[0] @ plain[1] @ np.ones(36) - sums).max() > 0.1


def test_what_is_dropped_is_what_the_product_has_outside_the_pattern() -> None:
    A = upwind(5)
    L, U = incomplete(A.toarray())
    outside = np.where(A.toarray() == 0, L @ U, 0.0)
    assert_allclose(dropped_fill(A, 0.0), -outside.sum(axis=1), atol=1e-14)


def test_a_zero_pivot_is_said() -> None:
    A = sparse.csr_matrix(np.array([[1.0, 1.0], [1.0, 1.0]]))
    with pytest.raises(MachineError, match="pivot 1"):
        dropped_fill(A, 0.5)
    found = gmres(A, np.array([1.0, 2.0]), ILU(relaxation=0.5))
    assert (found.ended, found.iterations) == ("incomplete LU: pivot 1 is 0.0", 0)


@pytest.mark.parametrize("ilu", ILUS, ids=str)
def test_all_solve_what_mumps_solves(ilu: ILU) -> None:
    A = upwind(12)
    b = A @ np.sin(np.arange(144.0))
    direct, found = mumps(A, b), gmres(A, b, ilu)
    assert direct.residual < 1e-14
    assert found.ended == "converged"
    assert found.residual <= 1e-8
    assert_allclose(found.x, direct.x, atol=1e-6)
    assert found.iterations < gmres(A, b, None).iterations  # a preconditioner is one
    assert (found.fill > 1) == (ilu.levels > 0)


def test_without_fill_an_incomplete_factor_is_complete() -> None:
    A = sparse.csr_matrix(sparse.diags([np.full(30, 3.0), np.full(29, -2.0), np.full(29, -1.0)], [0, -1, 1]))
    assert gmres(A, np.ones(30), ILU()).iterations == 1
    assert gmres(A, np.ones(30), ILU(shift=0.1)).iterations > 1


def test_modified_factors_suit_smooth_solutions() -> None:
    """Gustafsson (1978): on a Laplacian the modified factorisation takes fewer iterations than ILU(0)."""
    line = sparse.diags([np.full(40, 2.0), np.full(39, -1.0), np.full(39, -1.0)], [0, -1, 1])
    A = sparse.csr_matrix(sparse.kron(line, sparse.eye(40)) + sparse.kron(sparse.eye(40), line))
    b = np.ones(1600)
    assert gmres(A, b, ILU(relaxation=1.0)).iterations < gmres(A, b, ILU()).iterations


def test_gauss_seidel_is_that_and_says_when_it_ends() -> None:
    A, b = upwind(8), np.ones(64)
    x, count, lower = np.zeros(64), 0, sparse.tril(A, format="csr")
    while np.linalg.norm(b - A @ x) > 1e-8 * np.linalg.norm(b):
        x, count = x + sparse.linalg.spsolve_triangular(lower, b - A @ x), count + 1
    found = gauss_seidel(A, b)
    assert (found.ended, found.iterations) == ("converged", count)
    assert_allclose(found.x, x, rtol=1e-12)
    bad = sparse.csr_matrix(np.array([[1.0, 3.0], [3.0, 1.0]]))  # its iteration matrix has 9
    assert gauss_seidel(bad, np.ones(2)).ended == "diverged"


def test_the_condition_number_is_that_of_the_one_norm() -> None:
    A = upwind(4)
    assert condition(A) == pytest.approx(np.linalg.cond(A.toarray(), 1), rel=0.1)  # an estimate, rarely far below


def test_condensed_it_is_the_tangent_of_the_method(solved: tuple[SlipTangent, CondensedSurface]) -> None:
    """Schur complements on the contact dofs: (K^-1)_cc^-1 = S + N^T Σ*' N."""
    tangent, surface = solved
    K = tangent.of_displacements[0].toarray()
    contact = np.unique(tangent.N.tocoo().col)
    inverse = np.linalg.inv(K)[np.ix_(contact, contact)]
    expected = surface.S + (surface.N.T @ tangent.slope @ surface.N).toarray()
    assert_allclose(np.linalg.inv(inverse), expected, atol=1e-8 * np.abs(expected).max())


def test_forces_eliminated_or_not_the_displacements_are_the_same(solved: tuple[SlipTangent, CondensedSurface]) -> None:
    (K, f), (whole, g) = solved[0].of_displacements, solved[0].of_both
    u = mumps(K, f).x
    assert np.abs(u).max() > 0
    assert_allclose(mumps(whole, g).x[: len(u)], u, atol=1e-10 * np.abs(u).max())


def test_it_is_unsymmetric_where_something_slides(solved: tuple[SlipTangent, CondensedSurface]) -> None:
    assert 0 < solved[0].share(SLIP) < 1
    assert unsymmetry(solved[0].of_displacements[0]) > 0.01
    assert unsymmetry(solved[0].K_B) < 1e-14
