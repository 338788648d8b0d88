"""Uzawa's methods as published: one answer, by steps, inner solves and friction updates of many kinds."""

from collections.abc import Callable
from typing import Any

import pytest
from numpy.testing import assert_allclose

from geometry.errors import SceneError
from solvers.nouns.scene import Scene
from solvers.plan import make_plan
from solvers.simulation import Simulation
from solvers.step_result import StepResult

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


def dragged(scene_of: SceneOf, dim: int, surface: str, **solver: Any) -> Scene:
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


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("dim", [2, 3])
def test_uzawa_finds_newtons_answer(
    dim: int, surface: str, scene_of: SceneOf, simulation_of: SimulationOf, exact: Any
) -> None:
    simulation = simulation_of(dragged(scene_of, dim, surface, method="uzawa"))
    assert_equal(steps(simulation), exact(dim, surface))


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("dim", [2, 3])
def test_bounds_that_are_frozen_and_renewed_lead_to_the_same_fixed_point(
    dim: int, surface: str, scene_of: SceneOf, simulation_of: SimulationOf, exact: Any
) -> None:
    simulation = simulation_of(dragged(scene_of, dim, surface, method="uzawa", friction_update="outer"))
    found = steps(simulation)
    assert_equal(found, exact(dim, surface))
    other = steps(simulation_of(dragged(scene_of, dim, surface, method="uzawa")))
    assert [s.iterations for s in found] != [s.iterations for s in other]


@pytest.mark.parametrize("relaxation", [0.9, 1.5])
def test_a_step_that_is_given_is_the_one_taken(
    relaxation: float, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    by_bound = simulation_of(dragged(scene_of, 2, "unilateral", method="uzawa", relaxation=relaxation))
    alpha = relaxation / by_bound.stepper.surface.lambda_max
    given = simulation_of(dragged(scene_of, 2, "unilateral", method="uzawa", alpha=alpha))
    assert [s.iterations for s in steps(given)] == [s.iterations for s in steps(by_bound)]
    assert given.counters.lanczos_applications == 0


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("relaxation", 2.0, r"solver\.relaxation = 2\.0: must lie between 0 and 2"),
        ("relaxation", 0.0, r"solver\.relaxation = 0\.0: must lie between 0 and 2"),
        ("alpha", -1.0, r"solver\.alpha = -1\.0: must be positive, in Pa/m"),
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
    with pytest.raises(SceneError, match=rf"solver\.{key} = {value}: solver\.method = {method} does not know it; use"):
        make_plan(scene)
