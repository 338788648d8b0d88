"""The linear programme proves what it says: bounds from outside forbid, bounds from inside allow."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import often
from shared.problems import SceneOf, SimulationOf, times
from stickslip.solvers.interface.limit_analysis import Balance, balancing_tractions, decide, unbalanced_motion
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.simulation.simulation import prepare
from stickslip.solvers.stepping.stepper import NoEquilibriumError
from stickslip.workflows.scene_file.read import read

PRESS = 0.2  # N on a block of 2 m (and 1 m wide in 3D)


@pytest.fixture
def problem_of(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., SurfaceProblem]:
    """A block pressed onto the foundation and pulled along it, held by the contact alone; nothing is solved."""

    def make(
        dim: int, pull: list[float], friction: dict[str, Any], normal: str = "unilateral", **others: Any
    ) -> SurfaceProblem:
        area = 2.0
        normals = {"unilateral": {"law": "unilateral"}, "bilateral": {"law": "bilateral"},
                   "compliance": {"law": "compliance", "c_n": 20.0, "m_n": 2.0}}  # fmt: skip
        low = {"surface": "block.bottom", "against": "foundation", "friction": friction, "normal": normals[normal]}
        ground = {"foundation": {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}}
        walls = {"wall": {"shape": "plane", "point": [0.0] * dim, "normal": [1.0] + [0.0] * (dim - 1)}}
        scene = scene_of(
            dim,
            geometry={"cells": "tensor"},
            obstacles=ground | (walls if others else {}),
            contacts=others | {"base": low},
            loads={"lid": {"boundary": "block.bottom", "traction": [*(f / area for f in pull), -PRESS / area]}},
        )
        seen: list[SurfaceProblem] = []
        monkeypatch.setattr(
            "stickslip.solvers.stepping.substep.unbalanced_motion", lambda problem: seen.append(problem) or np.ones(1)
        )
        monkeypatch.setattr("stickslip.solvers.stepping.halving.describe_motion", lambda system, motion, dofs: "")
        stepper = simulation_of(scene).stepper
        with pytest.raises(NoEquilibriumError, match="cannot balance"):
            stepper.reach(stepper.start(), 1.0, lambda row: None)
        return seen[0]

    return make


LAWS: list[tuple[dict[str, Any], float]] = [  # with the pull that they can just hold [N]
    ({"law": "coulomb", "mu": 0.3}, 0.3 * PRESS),
    ({"law": "coulomb", "mu": 0.3, "k_T": 7.0}, 0.3 * PRESS),
    ({"law": "tresca", "bound": 0.02}, 0.02 * 2.0),
]


@pytest.mark.parametrize(("friction", "limit"), LAWS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_pull_up_to_the_limit_is_possible_and_beyond_it_impossible(
    sign: float, friction: dict[str, Any], limit: float, problem_of: Callable[..., SurfaceProblem]
) -> None:
    assert decide(problem_of(2, [sign * 0.9999 * limit], friction)) is Balance.POSSIBLE
    beyond = problem_of(2, [sign * 1.0001 * limit], friction)
    assert decide(beyond) is Balance.IMPOSSIBLE
    motion = unbalanced_motion(beyond)
    assert motion is not None
    assert_allclose(np.abs(motion).max(), 1.0)
    assert sign * motion[::2].mean() > 0.9  # it slides with the pull


@pytest.mark.parametrize("turn", often(range(0, 91, 15), (0, 15, 60)))
def test_polygons_enclose_the_disc_of_friction(turn: int, problem_of: Callable[..., SurfaceProblem]) -> None:
    """In whatever direction: wrong answers never, undecided within the half per cent between the polygons."""
    way = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
    friction, limit = {"law": "coulomb", "mu": 0.3}, 0.3 * PRESS
    found = {
        share: decide(problem_of(3, (share * limit * way).tolist(), friction))
        for share in (0.994, 0.9999, 1.0001, 1.006)
    }
    assert (found[0.994], found[1.006]) == (Balance.POSSIBLE, Balance.IMPOSSIBLE)
    assert found[0.9999] is not Balance.IMPOSSIBLE
    assert found[1.0001] is not Balance.POSSIBLE


@pytest.mark.parametrize("dim", [2, 3])
def test_balancing_tractions_balance_and_lie_in_the_cone(dim: int, problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of(dim, [0.05, 0.01][: dim - 1], {"law": "coulomb", "mu": 0.3})
    p, surface = balancing_tractions(problem), problem.surface
    assert p is not None
    left = surface.R.T @ (problem.load.f_c - surface.forces(p))
    assert_allclose(left, 0.0, atol=1e-7 * np.abs(problem.load.f_c).sum())  # the programme's own tolerance
    assert_allclose(problem.project(p, problem.gamma), p, atol=1e-7 * np.abs(p).max())


def test_stick_holds_any_pull_but_no_lift(problem_of: Callable[..., SurfaceProblem]) -> None:
    assert decide(problem_of(2, [50 * PRESS], {"law": "stick"})) is Balance.POSSIBLE
    pressed = problem_of(2, [0.0], {"law": "stick"})
    lifted = replace(pressed, load=times(pressed.load, -1.0))
    assert decide(lifted) is Balance.IMPOSSIBLE
    assert balancing_tractions(lifted) is None


def test_a_surface_that_pulls_presses_elsewhere_as_hard_as_need_be(problem_of: Callable[..., SurfaceProblem]) -> None:
    """Bilateral contact with Coulomb friction: no pull is forbidden, for rigid bodies may be pressed and pulled."""
    assert decide(problem_of(2, [3 * PRESS], {"law": "coulomb", "mu": 0.3}, "bilateral")) is not Balance.IMPOSSIBLE


@pytest.mark.parametrize(("m_T", "expected"), [(2.0, Balance.IMPOSSIBLE), (1.0, Balance.UNDECIDED)])
def test_bounds_that_are_no_lines_are_not_guessed(
    m_T: float, expected: Balance, problem_of: Callable[..., SurfaceProblem]
) -> None:
    """s = c_T delta^m_T at p = 20 delta²: m_T = 2 is Coulomb's law with mu = c_T / 20."""
    friction = {"law": "compliance", "c_T": 2.0, "m_T": m_T}
    assert decide(problem_of(2, [0.5 * PRESS], friction, "compliance")) is expected


def test_no_load_is_balanced_by_nothing(problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of(2, [0.01], {"law": "coulomb", "mu": 0.3})
    problem = replace(problem, load=times(problem.load, 0.0))
    assert decide(problem) is Balance.POSSIBLE
    assert not balancing_tractions(problem).any()  # type: ignore[union-attr]


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_the_answer_is_the_same_in_every_unit(unit: float, problem_of: Callable[..., SurfaceProblem]) -> None:
    for share, expected in ((0.9999, Balance.POSSIBLE), (1.0001, Balance.IMPOSSIBLE)):
        problem = problem_of(2, [share * 0.3 * PRESS], {"law": "coulomb", "mu": 0.3})
        assert decide(replace(problem, load=times(problem.load, unit))) is expected


def test_what_is_left_of_forces_that_cancel_is_no_load(problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of(2, [2 * PRESS], {"law": "coulomb", "mu": 0.3})
    for left, expected in ((1e-12, Balance.POSSIBLE), (1e-6, Balance.IMPOSSIBLE)):
        load = replace(problem.load, resultant=left * problem.load.resultant)
        assert decide(replace(problem, load=load)) is expected


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_bilateral_contact_pulls(sign: float, problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of(2, [0.9 * 0.04], {"law": "tresca", "bound": 0.02}, "bilateral")
    assert decide(replace(problem, load=times(problem.load, sign))) is Balance.POSSIBLE
    p = balancing_tractions(replace(problem, load=times(problem.load, sign)))
    assert p is not None
    assert sign * problem.surface.W[: problem.surface.normal_rows] @ p[: problem.surface.normal_rows] > 0.9 * PRESS


def test_stick_holds_more_than_is_proved_and_nothing_forbids_it(problem_of: Callable[..., SurfaceProblem]) -> None:
    assert decide(problem_of(2, [5000 * PRESS], {"law": "stick"})) is Balance.UNDECIDED
    assert decide(problem_of(2, [5000 * PRESS], {"law": "stick"}, "bilateral")) is Balance.POSSIBLE


def test_a_wall_holds_what_is_pushed_against_it(problem_of: Callable[..., SurfaceProblem]) -> None:
    """Two contacts: each has the rows and the friction of its own."""
    wall = {"surface": "block.left", "against": "wall", "friction": {"law": "coulomb", "mu": 0.8}}
    for pull, expected in ((-3.0, Balance.POSSIBLE), (0.29, Balance.POSSIBLE), (0.31, Balance.IMPOSSIBLE)):
        assert decide(problem_of(2, [pull * PRESS], {"law": "coulomb", "mu": 0.3}, wall=wall)) is expected
    problem = problem_of(2, [-3.0 * PRESS], {"law": "coulomb", "mu": 0.3}, wall=wall)
    p, (first, second) = balancing_tractions(problem), problem.cone.places
    assert p is not None
    for place, at_least in ((first, 2.6), (second, 0.0)):
        assert problem.surface.W[place.normal] @ p[place.normal] > at_least * PRESS
    assert_allclose(problem.project(p, problem.gamma), p, atol=1e-6 * np.abs(p).max())


def test_rigid_bodies_rest_where_gaps_are_small_and_evenly(problem_of: Callable[..., SurfaceProblem]) -> None:
    """A gap that the motion of the foundation has closed is none."""
    problem = problem_of(2, [0.0], {"law": "coulomb", "mu": 0.3})
    n = problem.surface.normal_rows
    rows, W = np.arange(len(problem.gap)), problem.surface.W[: problem.surface.normal_rows]
    even = balancing_tractions(problem)
    assert even is not None
    assert_allclose(even[:n], PRESS / W.sum(), rtol=1e-6)
    (corners,) = np.nonzero(W / W.max() < 0.6)
    touching = np.isin(rows, corners)
    assert touching.sum() == 2
    for opening in (1e-3, 1.0, 1e3):  # small or large beside the motion without contact
        away = np.where((rows < n) & ~touching, opening * problem.u_ref, 0.0)
        rests = replace(problem, gap=problem.gap + away)
        moved = replace(rests, gap=rests.gap + 50 * problem.u_ref, offset=rests.offset + 50 * problem.u_ref)
        raised = replace(problem, offset=problem.offset - away)
        for case in (rests, moved, raised):
            p = balancing_tractions(case)
            assert p is not None
            assert_allclose(p[:n][touching[:n]], PRESS / W[touching[:n]].sum(), rtol=1e-5)
            assert_allclose(np.delete(p[:n], corners), 0.0, atol=1e-6 * PRESS)
    # in another unit of loads and lengths
    small = replace(
        rests,
        load=times(rests.load, 1e-9), gap=1e-9 * rests.gap, offset=1e-9 * rests.offset, force=1e-9 * rests.force,
    )  # fmt: skip
    p = balancing_tractions(small)
    assert p is not None
    assert_allclose(p[:n][touching[:n]], 1e-9 * PRESS / W[touching[:n]].sum(), rtol=1e-5)


def test_a_body_without_friction_says_where_nothing_holds_it() -> None:
    """Its surface problem has the normal motions of contact alone."""
    away = ["obstacles.plane.force.y=[[0, 0], [1, 2e-4], [2, -2e-4]]", "steps={ end = 2.0, count = 2 }"]
    simulation = prepare(read("sphere", ["geometry.mesh_size=1.4", "geometry.contact_mesh_size=0.01", *away]))
    with pytest.raises(NoEquilibriumError, match="plane moves along"):
        list(simulation.steps())
