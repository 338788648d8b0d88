"""Uzawa's methods as published: one answer, by steps, inner solves and friction updates of many kinds."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from shared.cases import every_nth, often, slow
from stickslip.geometry.errors import SceneError
from stickslip.solvers.classical.inexact_uzawa import InexactUzawa
from stickslip.solvers.classical.uzawa import InnerTolerance
from stickslip.solvers.interface.matrix_free import IterativeVolume, MatrixFreeSurface
from stickslip.solvers.iteration import Status
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.simulation import Simulation

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
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
        contacts={"base": {"surface": "block.bottom", "against": "foundation"} | SURFACES[surface]},
        supports={"top": {"boundary": "block.top", "displacement": motion}},
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
    contacts = scene_of(contacts={"base": {"surface": "block.bottom", "against": "foundation"} | given}).contacts

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
def test_a_step_that_is_given_is_the_one_taken(
    relaxation: float, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
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


def test_where_compliance_is_all_there_is_the_inner_solve_is_all(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
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
    stepper = simulation_of(dragged(scene_of, 2, "unilateral", method="inexact-uzawa", tolerance=1e-3)).stepper
    problem = stepper.reach(stepper.start(), 1.0, lambda row: None).problem
    nothing = np.zeros(len(problem.gap))

    class Careless(InexactUzawa):
        inner = InnerTolerance(share=300.0)  # which no scene can ask for

    ends = [kind(rtol=1e-6, max_it=400)(problem, nothing).status for kind in (InexactUzawa, Careless)]
    assert ends[0] is Status.CONVERGED
    assert ends[1] is not Status.CONVERGED
