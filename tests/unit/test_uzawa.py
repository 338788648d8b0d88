"""Published Uzawa methods, with inexact solves and with Gram matrices, find the answer of Newton's method."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import sparse
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from shared.cases import every_nth, often, slow
from shared.problems import SceneOf, SimulationOf, surface_problem
from stickslip import Compliance, MachineError, Scene, SceneError, Simulation, StepResult
from stickslip.solvers.classical.gram_uzawa import (
    Gram,
    GramIteration,
    GramMetric,
    contact_last,
    incomplete_cholesky,
    volume_block,
    volume_gram,
)
from stickslip.solvers.classical.inexact_uzawa import InexactUzawa
from stickslip.solvers.interface.matrix_free import IterativeVolume, MatrixFreeSurface
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Solution, Status
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.lab.studies import gram as study

COULOMB = {"law": "coulomb", "mu": 0.3}
COMPLIANCE = {"law": "compliance", "c_n": 40.0, "m_n": 2.0}
TIGHT = 1e-11  # the tolerance that methods are compared at
EQUAL = 1e-8  # of the forces, relative: they are that tolerance times a condition number of about 100

SURFACES: dict[str, dict[str, Any]] = {
    "unilateral": {"friction": COULOMB},
    "tresca": {"friction": {"law": "tresca", "bound": 0.01}},
    "compliance": {"normal": COMPLIANCE, "friction": COULOMB},
    "tangential compliance": {"normal": COMPLIANCE, "friction": {"law": "compliance", "c_T": 0.4, "m_T": 1.0}},
    "soft before slip": {"normal": COMPLIANCE, "friction": COULOMB | {"k_T": 20.0}},
}


def dragged(scene_of: SceneOf, dim: int, surface: str, /, **solver: Any) -> Scene:
    """Pressed, then dragged until a part slips."""
    motion: dict[str, Any] = {"x": [[0, 0], [1, 0], [2, 0.02]], "xyz"[dim - 1]: [[0, 0], [1, -0.05]]}
    if dim == 3:
        motion["y"] = [[0, 0], [1, 0], [2, 0.01]]
    return scene_of(
        dim,
        base=SURFACES[surface],
        top=motion,
        steps={"end": 2.0, "count": 2},
        solver={"tolerance": TIGHT} | solver,
    )


def steps(simulation: Simulation) -> list[StepResult]:
    return list(simulation.steps())


@pytest.fixture(scope="module")
def exact(scene_of: SceneOf, simulation_of: SimulationOf) -> Callable[[int, str], list[StepResult]]:
    """The steps by condensed-newton."""
    known: dict[tuple[int, str], list[StepResult]] = {}

    def steps_of(dim: int, surface: str) -> list[StepResult]:
        if (dim, surface) not in known:
            known[dim, surface] = steps(simulation_of(dragged(scene_of, dim, surface, method="condensed-newton")))
        return known[dim, surface]

    return steps_of


def assert_equal(found: list[StepResult], expected: list[StepResult]) -> None:
    for one, other in zip(found, expected, strict=True):
        size = max(abs(other.contacts["base"].force))
        assert_allclose(one.contacts["base"].force, other.contacts["base"].force, rtol=0, atol=EQUAL * size)
        size = abs(other.displacement).max()
        assert_allclose(one.displacement, other.displacement, rtol=0, atol=EQUAL * size)
    assert found[-1].contacts["base"].slip_area > 0


CASES = [*((2, surface) for surface in SURFACES), (3, "unilateral"), (3, "compliance")]
RULES = ("elman-golub", "bramble-pasciak-vassilev")


@pytest.mark.parametrize(("case", "method"), every_nth(3, CASES, ["uzawa", "inexact-uzawa", "nonlinear-uzawa"]))
def test_each_method_finds_newtons_answer(
    case: tuple[int, str], method: str, scene_of: SceneOf, simulation_of: SimulationOf, exact: Any
) -> None:
    dim, surface = case
    assert_equal(steps(simulation_of(dragged(scene_of, dim, surface, method=method))), exact(dim, surface))


@pytest.mark.parametrize("method", [*slow("inexact-uzawa"), "nonlinear-uzawa"])
def test_other_inner_and_friction_rules_lead_to_the_same_answer(
    method: str, scene_of: SceneOf, simulation_of: SimulationOf, exact: Any
) -> None:
    others = {"inner_rule": RULES[1], "friction_update": "outer", "relaxation": 1.0}
    found = steps(simulation_of(dragged(scene_of, 2, "compliance", method=method, **others)))
    assert_equal(found, exact(2, "compliance"))


@pytest.mark.parametrize(("dim", "surface"), CASES)
def test_the_metric_of_the_generalised_jacobian_leads_to_the_same_answer_in_a_few_iterations(
    dim: int, surface: str, scene_of: SceneOf, simulation_of: SimulationOf, exact: Any
) -> None:
    scene = dragged(scene_of, dim, surface, method="nonlinear-uzawa", outer_metric="jacobian")
    found = steps(simulation_of(scene))
    assert_equal(found, exact(dim, surface))
    assert max(s.iterations for s in found) <= 30  # by points it takes hundreds


def test_with_given_friction_it_is_superlinear(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """Chen's theorem; by points the rate is linear."""
    given = {"normal": COMPLIANCE, "friction": {"law": "tresca", "bound": 0.004}}
    contacts = scene_of(base=given).contacts

    def rates(metric: str) -> list[float]:
        scene = dragged(scene_of, 2, "compliance", method="nonlinear-uzawa", outer_metric=metric)
        residuals = [row[2] for row in steps(simulation_of(replace(scene, contacts=contacts)))[0].history]
        return [after / before for before, after in pairwise(residuals)]

    fast, slow = rates("jacobian"), rates("points")
    assert fast[-1] < 0.01 * fast[0]  # ever faster
    assert len(slow) > 20
    assert min(slow[-10:]) > 0.1  # it stays as it is


@pytest.mark.parametrize("case", often(CASES, [(2, "unilateral"), (3, "compliance")]))
def test_bounds_that_are_frozen_and_renewed_lead_to_the_same_fixed_point(
    case: tuple[int, str], scene_of: SceneOf, simulation_of: SimulationOf, exact: Any
) -> None:
    dim, surface = case
    simulation = simulation_of(dragged(scene_of, dim, surface, method="uzawa", friction_update="outer"))
    found = steps(simulation)
    assert_equal(found, exact(dim, surface))
    other = steps(simulation_of(dragged(scene_of, dim, surface, method="uzawa")))
    assert [s.iterations for s in found] != [s.iterations for s in other]


@pytest.mark.parametrize("relaxation", [*slow(0.9), 1.5])
def test_a_step_that_is_given_is_taken(relaxation: float, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    by_bound = simulation_of(dragged(scene_of, 2, "unilateral", method="uzawa", relaxation=relaxation))
    alpha = relaxation / by_bound.stepper.surface.lambda_max
    given = simulation_of(dragged(scene_of, 2, "unilateral", method="uzawa", alpha=alpha))
    assert [s.iterations for s in steps(given)] == [s.iterations for s in steps(by_bound)]
    assert given.counters.lanczos_applications == 0


def test_the_metric_of_the_generalised_jacobian_takes_no_relaxation(scene_of: SceneOf) -> None:
    with pytest.raises(SceneError, match=r"solver\.relaxation = 1\.0: changes nothing with outer_metric = jacobian"):
        dragged(scene_of, 2, "unilateral", method="nonlinear-uzawa", outer_metric="jacobian", relaxation=1.0)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("relaxation", 2.0, r"solver\.relaxation = 2\.0: must lie between 0 and 2"),
        ("relaxation", 0.0, r"solver\.relaxation = 0\.0: must lie between 0 and 2"),
        ("alpha", -1.0, r"solver\.alpha = -1\.0: must be positive, in Pa/m"),
        ("inner_tolerance", 1.0, r"solver\.inner_tolerance = 1\.0: must lie between 0 and 1"),
        ("friction_update", "never", r'solver\.friction_update = "never": not one of these; '),
    ],
)
def test_steps_that_make_no_sense_are_refused(key: str, value: Any, says: str, scene_of: SceneOf) -> None:
    with pytest.raises(SceneError, match=says):
        dragged(scene_of, 2, "unilateral", method="uzawa", **{key: value})


@pytest.mark.parametrize(("key", "value"), [("relaxation", 1.0), ("alpha", 0.5), ("friction_update", "outer")])
@pytest.mark.parametrize("method", ["auto", "condensed-newton", "surface-uzawa", "regularised"])
def test_keys_that_would_change_nothing_are_refused(method: str, key: str, value: Any, scene_of: SceneOf) -> None:
    scene = dragged(scene_of, 2, "unilateral", method=method, **{key: value})
    with pytest.raises(SceneError, match=rf"solver\.{key} = {value}: solver\.method = {method} does not use it; use"):
        make_plan(scene)


@pytest.mark.parametrize(
    ("method", "key", "value"),
    [
        ("uzawa", "inner_rule", "bramble-pasciak-vassilev"),
        ("uzawa", "inner_tolerance", 0.2),
        ("nonlinear-uzawa", "alpha", 0.5),
        ("inexact-uzawa", "surface", "condensed"),
        ("nonlinear-uzawa", "surface", "matrix-free"),
    ],
)
def test_what_a_method_cannot_do_is_refused(method: str, key: str, value: Any, scene_of: SceneOf) -> None:
    scene = dragged(scene_of, 2, "compliance", method=method, **{key: value})
    with pytest.raises(SceneError, match=rf"solver\.{key} = {value}: solver\.method = {method} .*; use \S+"):
        make_plan(scene)


@pytest.mark.parametrize("method", ["uzawa", "inexact-uzawa", "nonlinear-uzawa"])
def test_bodies_that_contact_alone_holds_are_refused(method: str, scene_of: SceneOf) -> None:
    scene = replace(dragged(scene_of, 2, "unilateral", method=method), supports={})
    with pytest.raises(SceneError, match=rf"solver\.method = {method}: needs bodies that their supports hold"):
        make_plan(scene)


def solves(found: list[StepResult]) -> list[int]:
    """Volume solves of each iteration but the first of a step."""
    return [after[3] - before[3] for step in found for before, after in pairwise(step.history)]


def test_an_iteration_is_a_volume_solve_and_the_last_of_an_inexact_one_two(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    assert set(solves(steps(simulation_of(dragged(scene_of, 2, "unilateral", method="uzawa"))))) == {1}
    found = steps(simulation_of(dragged(scene_of, 2, "unilateral", method="inexact-uzawa")))
    for step in found:
        taken = solves([step])
        assert taken[-1] == 2  # small, and certainly so
        assert set(taken) == {1, 2}
        assert taken.count(2) <= 3


def test_where_compliance_is_all_the_inner_solve_is_all(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    smooth = {"base": {"surface": "block.bottom", "against": "foundation", "normal": COMPLIANCE}}
    contacts = scene_of(contacts=smooth).contacts
    one, other = (
        steps(simulation_of(replace(dragged(scene_of, 2, "compliance", method=method), contacts=contacts)))
        for method in ("nonlinear-uzawa", "uzawa")
    )
    assert [step.iterations for step in one] == [0, 0]
    assert other[0].iterations > 20  # there the pressure is iterated too
    assert_allclose(one[-1].contacts["base"].force, other[-1].contacts["base"].force, rtol=0, atol=EQUAL * 0.05)


@dataclass
class Watched:
    """Inner solves, and what they leave by a direct solver: ||delta|| of before and after in the norm of K_B^-1."""

    exact: Any
    allowed: list[float] = field(default_factory=list)
    start: list[float] = field(default_factory=list)
    end: list[float] = field(default_factory=list)
    p: list[Any] = field(default_factory=list)

    def size(self, volume: Any, f: Any, v: Any) -> float:
        left = (f - volume.K * v).array
        return float(np.sqrt(left @ self.exact(left)))


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch, scene_of: SceneOf, simulation_of: SimulationOf) -> Any:
    """The first step by inexact-uzawa, under watch: its simulation, its inner solves."""

    def solve(rule: str, share: float) -> tuple[Simulation, Watched]:
        solver = {"inner_rule": rule, "inner_tolerance": share, "tolerance": 1e-6}
        simulation = simulation_of(dragged(scene_of, 2, "unilateral", method="inexact-uzawa", **solver))
        indptr, indices, data = simulation.system.K_B.getValuesCSR()
        seen = Watched(splu(csr_matrix((data, indices, indptr)).tocsc()).solve)
        solve_residual, nearly = IterativeVolume.solve_residual, MatrixFreeSurface.nearly

        def inner(volume: IterativeVolume, f: Any, v: Any, allowed: Any) -> None:
            seen.start.append(seen.size(volume, f, v))
            solve_residual(volume, f, v, allowed)
            seen.end.append(seen.size(volume, f, v))
            seen.allowed.append(allowed(seen.start[-1]))

        def told(surface: MatrixFreeSurface, load: Any, p: Any, allowed: Any) -> Any:
            seen.p.append(p)
            return nearly(surface, load, p, allowed)

        monkeypatch.setattr(IterativeVolume, "solve_residual", inner)
        monkeypatch.setattr(MatrixFreeSurface, "nearly", told)
        next(simulation.steps())
        monkeypatch.undo()
        return simulation, seen

    return solve


MULTIGRID = (
    2.0  # 1 / sqrt(1 - c): what its norm may lack beside that of K_B^-1 where a cycle leaves c = 3/4 of an error
)


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_inner_residuals_obey_the_rule_of_elman_and_golub(share: float, watched: Any) -> None:
    simulation, seen = watched("elman-golub", share)
    surface = simulation.stepper.surface
    moved = np.linalg.norm(np.sqrt(surface.W) * np.diff(seen.p, axis=0), axis=1)[:-1]  # the last is sure of it
    outer = moved * np.sqrt(surface.lambda_max / 1.5)  # relaxation 1.5
    new = moved > 0  # tractions that seem to be the answer are solved for again, exactly
    assert_allclose(np.array(seen.allowed[1:-1])[new], share * outer[new], rtol=1e-6)
    assert np.max(np.array(seen.end[1:]) / np.array(seen.allowed[1:])) <= MULTIGRID


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_inner_residuals_obey_the_rule_of_bramble_pasciak_and_vassilev(share: float, watched: Any) -> None:
    _, seen = watched("bramble-pasciak-vassilev", share)
    assert_allclose(seen.allowed[:-1], share * np.array(seen.start[:-1]))
    assert np.max(np.array(seen.end[1:]) / np.array(seen.allowed[1:])) <= MULTIGRID


@pytest.mark.parametrize("rule", RULES)
def test_a_looser_inner_tolerance_saves_inner_iterations_and_costs_few_outer_ones(rule: str, watched: Any) -> None:
    counts = []
    for share in (0.01, 0.5):
        simulation, seen = watched(rule, share)
        counts.append((simulation.counters.linear_iterations, len(seen.end)))
    (tight, outer_tight), (loose, outer_loose) = counts
    assert loose < tight / 2
    assert outer_loose == pytest.approx(outer_tight, rel=0.1)


def test_no_inner_accuracy_at_all_does_not_converge(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = dragged(scene_of, 2, "unilateral", method="inexact-uzawa", tolerance=1e-3)
    problem = surface_problem(simulation_of(scene))
    nothing = np.zeros(len(problem.gap))

    class Careless(InexactUzawa):
        def inner(self, *of: Any, **how: Any) -> Any:
            return super().inner(*of, share=1000.0)  # which no scene can ask for

    ends = [kind(rtol=1e-6, max_it=400)(problem, nothing).status for kind in (InexactUzawa, Careless)]
    assert ends[0] is Status.CONVERGED
    assert ends[1] is not Status.CONVERGED


IC0, DROP = Gram(factor="ic0"), Gram(factor="drop")
CHOICES = {"complete": Gram(), "drop": DROP, "ic0": IC0, "tractions": Gram(unknown="tractions")}


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


def with_gram(scene: Scene, gram: Gram) -> Scene:
    return replace(scene, solver=replace(scene.solver, method="gram-uzawa", gram=gram))


@pytest.mark.parametrize(("dim", "choice"), [*((2, name) for name in CHOICES), (3, "complete")])
def test_it_finds_what_newton_finds(dim: int, choice: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = dragged(scene_of, dim, "unilateral", method="condensed-newton")
    for step, other in zip(
        simulation_of(with_gram(scene, CHOICES[choice])).steps(), simulation_of(scene).steps(), strict=True
    ):
        size = np.abs(other.displacement).max()
        assert_allclose(step.displacement, other.displacement, rtol=0, atol=1e-8 * size)
        assert_allclose(step.contacts["base"].force, other.contacts["base"].force, rtol=0, atol=1e-9)
    assert 0 < step.contacts["base"].slip_area < 2.0  # a part slips, a part sticks


@pytest.mark.parametrize("dim", [2, *slow(3)])
def test_a_metric_of_low_rank_meets_compliant_faces(dim: int, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """More quadrature points than nodes: the steps of Uzawa's method are bounded by what pushes nodes."""
    scene = dragged(scene_of, dim, "unilateral", method="condensed-newton")
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
    simulation = simulation_of(with_gram(dragged(scene_of, 2, "tresca"), Gram()))
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
    scene = dragged(scene_of, 2, "unilateral", method="uzawa", tolerance=1e-8)
    plain, gram, ic0 = (
        sum(step.iterations for step in simulation_of(each).steps())
        for each in (scene, with_gram(scene, Gram()), with_gram(scene, IC0))
    )
    assert gram < ic0 < plain
    assert gram < plain / 3


def test_the_multipliers_own_gram_matrix_is_of_the_wrong_order(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """From no tractions at all: where the volume's has come far, it has hardly begun."""
    simulation = simulation_of(dragged(scene_of, 2, "unilateral", method="condensed-newton"))
    problem = surface_problem(simulation)
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
            top=drag,
            solver={"method": "gram-uzawa"},
        )
        (step,) = simulation_of(scene).steps()
        counts.append(step.iterations)
    assert counts[0] == counts[1]


def test_what_has_no_gram_matrix_is_refused(scene_of: SceneOf) -> None:
    base = {"surface": "block.bottom", "against": "foundation", "normal": {"law": "compliance", "c_n": 20.0}}
    scene = dragged(scene_of, 2, "unilateral", method="gram-uzawa")
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
        dragged(scene_of, 2, "unilateral", method="gram-uzawa", gram={key: value})
