"""Other solutions of a step are looked for where there may be some, and each is said once."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from stickslip.geometry.arrays import CLOSE, SLIGHT, Array
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.laws.coulomb_by_point import CoulombByPoint
from stickslip.solvers.newton import path
from stickslip.solvers.newton.attempts import Start
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.stepper import Accepted

MUCH = {"law": "coulomb", "mu": 2.0}
DRIVEN = {"supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}}}
PULLED = {"loads": {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}}
SOFT = {"normal": {"law": "compliance", "c_n": 20.0}}


WEDGED = {"x": [[1.0, 0.05], [2.0, 0.12]], "y": [[1.0, -0.036], [2.0, 0.0013]]}  # and lifted off, but for friction
LIFTED = {"x": 0.1, "y": 0.02}


@pytest.fixture
def reached(scene_of: Callable[..., Scene], simulation_of: Callable[[Scene], Simulation]) -> Callable[..., Accepted]:
    """The last step of a block with friction that weakens from mu_s."""

    def make(mu_s: float, mu_k: float, slip_length: float, top: dict[str, Any], count: int) -> Accepted:
        law = {"law": "static_kinetic", "mu_s": mu_s, "mu_k": mu_k, "slip_length": slip_length}
        stepper = simulation_of(
            scene_of(
                contacts={"base": {"surface": "block.bottom", "against": "foundation", "friction": law}},
                supports={"top": {"boundary": "block.top", "displacement": top}},
                steps={"end": float(count), "count": count},
            )
        ).stepper
        state = stepper.start()
        for time in range(1, count + 1):
            accepted = stepper.reach(state, float(time), lambda row: None)
            state = accepted.state
        return accepted

    return make


@pytest.fixture
def problem_of(
    scene_of: Callable[..., Scene], simulation_of: Callable[[Scene], Simulation]
) -> Callable[..., SurfaceProblem]:
    """A block pressed and dragged in one step."""

    def make(
        friction: dict[str, Any] | None, normal: dict[str, Any] | None = None, tables: dict[str, Any] = DRIVEN
    ) -> SurfaceProblem:
        base = {"surface": "block.bottom", "against": "foundation"} | (normal or {})
        base |= {"friction": friction} if friction else {}
        stepper = simulation_of(scene_of(contacts={"base": base}, **tables)).stepper
        return stepper.reach(stepper.start(), 1.0, lambda row: None).problem

    return make


@pytest.mark.parametrize(
    ("friction", "normal", "most"),
    [
        (None, None, 0.0),
        ({"law": "coulomb", "mu": 0.4}, None, 0.4),
        ({"law": "coulomb", "mu": 3.0}, None, 3.0),
        ({"law": "compliance", "c_T": 50.0}, SOFT, 2.5),  # c_T d under p = c_n d
    ],
)
def test_the_most_friction_is_that_of_the_laws(
    friction: dict[str, Any] | None, normal: Any, most: float, problem_of: Callable[..., SurfaceProblem]
) -> None:
    assert path._most_friction(problem_of(friction, normal)) == pytest.approx(most)


def test_points_that_have_slipped_hide_no_others(reached: Callable[..., Accepted]) -> None:
    """One end has mu = .9, the other points 2: it is wedged, and could as well be off the ground."""
    accepted = reached(2.0, 0.9, 1e-3, WEDGED, 2)
    (contact,) = accepted.problem.cone.contacts
    assert isinstance(contact.friction, CoulombByPoint)
    assert_allclose(np.unique(contact.friction.mu), [0.9, 2.0])
    assert path._most_friction(accepted.problem) == pytest.approx(2.0)
    assert accepted.state.p.max() > 0.01
    assert_array_equal(accepted.others, [np.zeros_like(accepted.state.p)])


@pytest.mark.parametrize(
    ("friction", "tables", "looked_for"),
    [
        (MUCH, DRIVEN, True),
        ({"law": "coulomb", "mu": path.ENOUGH}, DRIVEN, False),
        (None, DRIVEN, False),
        ({"law": "stick"}, DRIVEN, False),
        ({"law": "tresca", "bound": 0.1}, DRIVEN, False),
        (MUCH, PULLED, False),
        ({"law": "capped_coulomb", "mu": 2.0, "s_max": 0.1}, DRIVEN, False),
        ({"law": "capped_coulomb", "mu": 2.0, "s_max": 0.1}, PULLED, False),
    ],
)
def test_others_are_looked_for_where_there_may_be_some(
    friction: dict[str, Any] | None, tables: dict[str, Any], looked_for: bool,
    problem_of: Callable[..., SurfaceProblem], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    problem, asked = problem_of(friction, tables=tables), list[int]()
    monkeypatch.setattr(path, "path_from_open", lambda of, kinks: asked.append(kinks) or iter(()))
    assert not list(path.others(problem, np.zeros(len(problem.gap))))
    assert asked == ([path.FOLLOWED] if looked_for else [])


@pytest.mark.parametrize("size", [1e-6, 1.0])
def test_each_solution_is_said_once(
    size: float, problem_of: Callable[..., SurfaceProblem], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = problem_of(MUCH)
    p, other = size * np.random.default_rng(0).random((2, len(problem.gap)))
    met: list[tuple[Array, float]] = [
        (p * (1 + 0.5 * SLIGHT), 0.0),  # the known one
        (2 * other, 2 * CLOSE),  # no solution
        (other, 0.5 * CLOSE),
        (other * (1 + 0.5 * SLIGHT), 0.0),
        (-p, 0.0),
        (p * (1 - 2 * SLIGHT), 0.0),
        (np.zeros_like(p), 0.0),
    ]
    nowhere = np.zeros(problem.surface.size)
    residuals = iter([residual for _, residual in met])

    def starts(of: SurfaceProblem, kinks: int) -> Iterator[Start]:
        return (Start(p=at, u_c=nowhere, p_hat=at) for at, _ in met)

    monkeypatch.setattr(path, "path_from_open", starts)
    monkeypatch.setattr(SurfaceProblem, "natural_residual", lambda self, p, w: next(residuals))
    found = list(path.others(problem, p))
    assert_array_equal(found, [other, -p, p * (1 - 2 * SLIGHT), 0 * p])


def test_solutions_are_apart_by_a_part_of_the_larger_one(
    problem_of: Callable[..., SurfaceProblem], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside a known state that is all but open: what differs from it by little is measured by what is met."""
    problem = problem_of(MUCH)
    zero = np.zeros(len(problem.gap))
    one = zero + 1.0
    end = Start(p=one, u_c=np.zeros(problem.surface.size), p_hat=one)
    monkeypatch.setattr(path, "path_from_open", lambda of, kinks: iter([end]))
    monkeypatch.setattr(SurfaceProblem, "natural_residual", lambda self, p, w: 0.0)
    assert len(list(path.others(problem, zero))) == 1
    assert not list(path.others(problem, one))


def test_tractions_that_are_rounding_are_no_other_solution(
    problem_of: Callable[..., SurfaceProblem], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = problem_of(MUCH)
    touching = np.full(len(problem.gap), 1e-16 * problem.p_ref)
    end = Start(p=0 * touching, u_c=np.zeros(problem.surface.size), p_hat=0 * touching)
    monkeypatch.setattr(path, "path_from_open", lambda of, kinks: iter([end]))
    monkeypatch.setattr(SurfaceProblem, "natural_residual", lambda self, p, w: 0.0)
    assert not list(path.others(problem, touching))


def test_others_have_the_friction_of_their_own_slip(reached: Callable[..., Accepted]) -> None:
    """Three answers with mu = 3 everywhere: open, stick, and one that slips, which has not 3 then."""
    accepted = reached(3.0, 0.1, 0.01, LIFTED, 1)
    assert not accepted.state.p.any()
    frozen = list(path.others(accepted.problem, accepted.state.p))
    assert len(frozen) == 2
    assert_array_equal(accepted.others, frozen[1:])
