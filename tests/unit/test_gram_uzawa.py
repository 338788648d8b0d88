"""The published preconditioner: its factors, what they do to condition numbers, and where the method leads."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import sparse

from shared.cases import slow
from stickslip.geometry.errors import MachineError, SceneError
from stickslip.solvers.classical.gram_uzawa import (
    Gram,
    GramIteration,
    GramMetric,
    contact_last,
    incomplete_cholesky,
    volume_block,
    volume_gram,
)
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Solution
from stickslip.solvers.laws.compliance import Compliance
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.lab.studies import gram as study

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
IC0, DROP = Gram(factor="ic0"), Gram(factor="drop")
CHOICES = {
    "complete": Gram(),
    "drop": DROP,
    "ic0": IC0,
    "tractions": Gram(unknown="tractions"),
}


@pytest.fixture(scope="module")
def conditions() -> dict[int, dict[str, float]]:
    return {n: {row.reading: row.condition for row in study.rows(n)} for n in (8, 16)}


def laplace(n: int) -> Any:
    """Five-point differences on n x n nodes: an M-matrix."""
    line = sparse.diags([np.full(n, 2.0), np.full(n - 1, -1.0), np.full(n - 1, -1.0)], [0, 1, -1])
    return sparse.csr_matrix(sparse.kron(line, sparse.eye(n)) + sparse.kron(sparse.eye(n), line))


def test_a_factor_that_drops_nothing_is_complete() -> None:
    A = laplace(7)
    found = incomplete_cholesky(A, 0.0)
    assert_allclose(found.P.toarray(), np.linalg.cholesky(A.toarray()), atol=1e-13)
    assert found.shift == 0
    inner, last = slice(0, 42), slice(42, 49)
    dense = A.toarray()
    schur = dense[last, last] - dense[last, inner] @ np.linalg.solve(dense[inner, inner], dense[inner, last])
    assert_allclose(found.trailing(7), schur, atol=1e-13)


def test_ic0_is_right_in_the_pattern_and_leaves_the_rest_in_s() -> None:
    """Meijerink & van der Vorst: S = P P^T - A is zero wherever A is not."""
    A = laplace(7)
    P = incomplete_cholesky(A).P
    S = (P @ P.T - A).toarray()
    assert P.nnz == sparse.tril(A).nnz
    assert_allclose(S[A.toarray() != 0], 0.0, atol=1e-14)
    assert np.abs(S).max() > 0.1


def test_less_is_left_out_the_smaller_the_tolerance() -> None:
    A = laplace(9)
    factors = [incomplete_cholesky(A, drop).P for drop in (1e-1, 1e-2, 1e-3)]
    left = [abs(P @ P.T - A).max() for P in factors]
    assert left[0] > left[1] > left[2] > 0
    assert factors[0].nnz < factors[1].nnz < factors[2].nnz


def test_dropping_goes_by_no_unit() -> None:
    A = laplace(9)
    one, other = (incomplete_cholesky(scale * A, 1e-2).P for scale in (1.0, 1e12))
    assert_allclose(other.toarray(), 1e6 * one.toarray(), rtol=1e-12)


def test_the_diagonal_is_raised_where_a_pivot_fails() -> None:
    """Kershaw's matrix (1978): positive definite, and IC(0) meets a negative pivot."""
    A = sparse.csr_matrix(np.array([[3.0, -2, 0, 2], [-2, 3, -2, 0], [0, -2, 3, -2], [2, 0, -2, 3]]))
    assert np.linalg.eigvalsh(A.toarray()).min() > 0
    found = incomplete_cholesky(A)
    assert found.shift > 0
    assert (found.P.diagonal() > 0).all()
    with pytest.raises(MachineError, match="not positive definite"):
        incomplete_cholesky(-A)


@pytest.mark.parametrize("dim", [*slow(2), 3])
def test_the_complete_block_is_the_schur_complement_of_the_gram_matrix(dim: int) -> None:
    """By MUMPS, by our own factor in the order that puts contact last, and by definition: S^-1 = (Gamma^-1)_cc."""
    system = study.block(4, dim=dim)
    matrix, contact = volume_gram(system, 1.0), system.interface.dofs
    whole, order = contact_last(matrix, contact)
    assert (order[-len(contact) :] == contact).all()
    found = volume_block(system, study.METRE)
    inverse = np.linalg.inv(whole.toarray())[-len(contact) :, -len(contact) :]
    assert_allclose(found @ inverse, np.eye(len(contact)), atol=1e-10)
    own = incomplete_cholesky(whole, 0.0).trailing(len(contact))
    assert_allclose(own, found, atol=1e-10 * np.abs(found).max())
    incomplete = volume_block(system, replace(study.METRE, factor="ic0"))
    assert np.abs(incomplete - found).max() > 1e-2 * np.abs(found).max()


def test_the_gram_matrix_is_the_product_of_h1() -> None:
    """u = (y, 0) on 4 x 2 m, no supports: ∫ |grad u|² = 8, ∫ |u|² = 4 * 8/3."""
    system = study.block(4, held=False)
    matrix = volume_gram(system, 0.5)
    u = system.vector()
    u.array[0::2] = system.nodes.points[:, 1]
    assert u.dot(matrix * u) == pytest.approx(8 + 32 / 3 / 0.5**2, rel=1e-12)


@pytest.mark.parametrize(("n", "none", "multiplier", "complete"), [(8, 110, 7237, 9.4), (16, 215, None, 9.7)])
def test_condition_numbers_are_those_found_beforehand(
    conditions: dict[int, dict[str, float]], n: int, none: float, multiplier: float | None, complete: float
) -> None:
    """Figures of an independent study of the same block, with the Gram matrix of all displacements, supports or not."""
    found = conditions[n]
    assert found["none"] == pytest.approx(none, rel=0.005)
    assert found["volume, complete, supports left out"] == pytest.approx(complete, rel=0.01)
    assert found["volume, complete"] == pytest.approx(complete, rel=0.08)  # V of the source is zero on supports
    if multiplier is not None:
        assert found["multiplier"] == pytest.approx(multiplier, rel=0.001)


def test_only_the_complete_factor_of_the_volume_is_independent_of_h(conditions: dict[int, dict[str, float]]) -> None:
    growth = {reading: conditions[16][reading] / conditions[8][reading] for reading in conditions[8]}
    assert growth["volume, complete"] < 1.05
    assert growth["multiplier"] == pytest.approx(8, rel=0.1)  # order 2 for -1: like h^-3
    for reading in ("none", "volume, IC(0)"):
        assert growth[reading] == pytest.approx(2, rel=0.1)
    assert 1.1 < growth["volume, drop 1e-3"] < growth["volume, drop 1e-2"] < growth["volume, IC(0)"]


def pressed(scene_of: SceneOf, dim: int = 2, friction: dict[str, Any] | None = None, **solver: Any) -> Scene:
    """Pressed, then dragged until a part slips."""
    last = "xyz"[dim - 1]
    drag = dict.fromkeys("xyz"[:dim], 0.0) | {"x": [[0, 0], [1, 0], [2, 0.02]], last: [[0, 0], [1, -0.05]]}
    base = {"surface": "block.bottom", "against": "foundation"}
    return scene_of(
        dim,
        contacts={"base": base | {"friction": friction or {"law": "coulomb", "mu": 0.3}}},
        supports={"top": {"boundary": "block.top", "displacement": drag}},
        steps={"end": 2.0, "count": 2},
        solver={"tolerance": 1e-11} | solver,
    )


def with_gram(scene: Scene, gram: Gram) -> Scene:
    return replace(scene, solver=replace(scene.solver, method="gram-uzawa", gram=gram))


@pytest.mark.parametrize(("dim", "choice"), [*((2, name) for name in CHOICES), (3, "complete")])
def test_it_finds_what_newton_finds(dim: int, choice: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = pressed(scene_of, dim, method="condensed-newton")
    for step, other in zip(
        simulation_of(with_gram(scene, CHOICES[choice])).steps(), simulation_of(scene).steps(), strict=True
    ):
        size = np.abs(other.displacement).max()
        assert_allclose(step.displacement, other.displacement, rtol=0, atol=1e-8 * size)
        assert_allclose(step.contacts["base"].force, other.contacts["base"].force, rtol=0, atol=1e-9)
    assert 0 < step.contacts["base"].slip_area < 2.0  # a part slips, a part sticks


@pytest.mark.parametrize("dim", [2, *slow(3)])
def test_a_metric_without_full_rank_meets_compliant_faces(
    dim: int, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """More quadrature points than nodes: the steps of Uzawa's method are bounded by what pushes nodes."""
    scene = pressed(scene_of, dim, method="condensed-newton")
    base = replace(scene.contacts["base"], normal=Compliance(c_n=40.0, m_n=2.0))
    scene = replace(scene, contacts={"base": base})
    simulation = simulation_of(with_gram(scene, Gram()))
    surface, cone = simulation.stepper.surface, simulation.stepper.cone
    metric = GramMetric(simulation.system, Gram())
    Q, values = metric.on_tractions(surface, cone), metric.spectrum(surface, cone)
    assert len(values) == np.linalg.matrix_rank(Q) < len(Q)
    largest = values[-1] * (1 + 1e-9)
    BKB = surface.W[:, None] * (surface.N @ surface.flexibility @ surface.N.T) * surface.W
    assert np.linalg.eigvalsh(largest * Q - BKB).min() > -1e-9 * np.linalg.norm(BKB)
    for step, other in zip(simulation.steps(), simulation_of(scene).steps(), strict=True):
        size = np.abs(other.displacement).max()
        assert_allclose(step.displacement, other.displacement, rtol=0, atol=1e-8 * size)


def test_a_step_contracts_below_twice_the_inverse_of_lambda_max_and_not_beyond(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tresca, so that bounds are fixed. The error's norm in the metric Q never grows."""
    simulation = simulation_of(with_gram(pressed(scene_of, friction={"law": "tresca", "bound": 0.01}), Gram()))
    whole, problems = GramIteration.__call__, list[SurfaceProblem]()

    def listening(self: GramIteration, problem: SurfaceProblem, *arguments: Any) -> Solution:
        problems.append(problem)
        return whole(self, problem, *arguments)

    monkeypatch.setattr(GramIteration, "__call__", listening)
    accepted = list(simulation.steps())[-1].p
    problem, metric = problems[-1], GramMetric(simulation.system, Gram())
    Q = metric.on_tractions(problem.surface, problem.cone)
    ends = {}
    for relaxation in (0.5, 1.0, 1.9, 4.0):
        method = GramIteration(metric, relaxation=relaxation, max_it=1)
        p, errors = np.zeros_like(accepted), []
        for _ in range(40):
            errors.append(float((p - accepted) @ Q @ (p - accepted)) ** 0.5)
            p = method(problem, p).p
        ends[relaxation] = errors[-1] / errors[0]
        if relaxation < 2:
            assert (np.diff(errors) <= 0.05 * np.array(errors[:-1])).all()  # the surface is solved to a tenth
    assert max(ends[0.5], ends[1.0], ends[1.9]) < 0.2
    assert ends[4.0] > 0.2


def test_fewer_iterations_than_plain_uzawa(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = pressed(scene_of, method="uzawa", tolerance=1e-8)
    plain, gram, ic0 = (
        sum(step.iterations for step in simulation_of(each).steps())
        for each in (scene, with_gram(scene, Gram()), with_gram(scene, IC0))
    )
    assert gram < ic0 < plain
    assert gram < plain / 3


def test_the_multipliers_own_gram_matrix_is_of_the_wrong_order(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """From no tractions at all: where the volume's has come far, it has hardly begun."""
    simulation = simulation_of(pressed(scene_of, method="condensed-newton"))
    stepper = simulation.stepper
    problem = stepper.reach(stepper.start(), 1.0, lambda row: None).problem
    residuals = {}
    for gram in (Gram(), Gram(space="multiplier")):
        method = GramIteration(GramMetric(simulation.system, gram), max_it=20)
        residuals[gram.space] = method(problem, np.zeros(problem.cone.size)).residual
    assert residuals["multiplier"] > 10 * residuals["volume"]


def test_the_answer_goes_by_no_unit_of_length(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """H1 has a length in it: that of the bodies, so a scene in mm takes the same iterations."""
    counts = []
    for unit in (1.0, 1e3):
        sizes = {key: unit * size for key, size in (("length", 2.0), ("height", 1.0), ("mesh_size", 0.25))}
        drag = {"x": unit * 0.02, "y": -0.05 * unit}
        base = {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}
        scene = scene_of(
            2,
            sizes,
            contacts={"base": base},
            supports={"top": {"boundary": "block.top", "displacement": drag}},
            solver={"method": "gram-uzawa"},
        )
        (step,) = simulation_of(scene).steps()
        counts.append(step.iterations)
    assert counts[0] == counts[1]


def test_what_has_no_gram_matrix_is_refused(scene_of: SceneOf) -> None:
    base = {"surface": "block.bottom", "against": "foundation", "normal": {"law": "compliance", "c_n": 20.0}}
    scene = pressed(scene_of, method="gram-uzawa")
    compliant = replace(scene, contacts=scene_of(contacts={"base": base}).contacts)
    make_plan(compliant)  # forces on the nodes, by the Gram matrix of their displacements
    for key, value, other in (("space", "multiplier", "volume"), ("unknown", "tractions", "forces")):
        message = rf"solver\.gram\.{key} = {value}: solver\.method = gram-uzawa has no basis in H1 .*; use {other}"
        with pytest.raises(SceneError, match=message):
            make_plan(with_gram(compliant, Gram(**{key: value})))
    with pytest.raises(SceneError, match=r"solver\.surface = matrix-free: solver\.method = gram-uzawa needs"):
        make_plan(replace(scene, solver=replace(scene.solver, surface="matrix-free")))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [("drop", 0.0, "must lie between 0 and 1"), ("length", -1.0, "must be positive"), ("factor", "lu", "factor")],
)
def test_nonsense_is_refused_by_name(key: str, value: Any, message: str, scene_of: SceneOf) -> None:
    with pytest.raises(SceneError, match=rf"solver\.gram.*{message}"):
        pressed(scene_of, method="gram-uzawa", gram={key: value})
