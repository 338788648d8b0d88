"""Scenes that once ended in a wrong answer: each ends in the right one, or says why it cannot."""

from collections.abc import Callable
from typing import Any

import pytest
from numpy.testing import assert_allclose

from stickslip.geometry.errors import SceneError
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.stepper import NoEquilibriumError

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]


def contact(mu: float = 0.3) -> dict[str, Any]:
    return {"base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": mu}}}


def pulled(mu: float) -> dict[str, Any]:
    """Pressed by 0.2 N, pulled by 0.02 N, held by nothing else."""
    return {"contacts": contact(mu), "loads": {"top": {"boundary": "block.top", "traction": [0.01, -0.1]}}}


def test_body_held_by_friction_alone_stays_below_the_limit(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    (step,) = simulation_of(scene_of(**pulled(mu=0.2))).steps()
    assert_allclose(step.contacts["base"].force, [-0.02, 0.2], rtol=1e-9)


def test_body_pulled_beyond_friction_has_no_answer(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """The pull is twice the friction limit: no displacement, however large, is an equilibrium."""
    with pytest.raises(NoEquilibriumError, match="cannot balance the loads"):
        list(simulation_of(scene_of(**pulled(mu=0.05))).steps())


def test_friction_coefficient_zero_holds_nothing(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    with pytest.raises(SceneError, match="nothing resists the translation along x"):
        simulation_of(scene_of(**pulled(mu=0.0)))


def test_unloading_to_zero_leaves_no_traction(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    lid = {"boundary": "block.top", "displacement": {"x": 0.0, "y": [[0, 0], [1, -0.1], [2, 0.0]]}}
    bare = {"base": {"surface": "block.bottom", "against": "foundation"}}
    scene = scene_of(contacts=bare, supports={"lid": lid}, steps={"end": 2.0, "count": 2})
    pressed, unloaded = simulation_of(scene).steps()
    assert pressed.contacts["base"].normal_force > 0.1
    assert abs(unloaded.contacts["base"].normal_force) < 1e-15


@pytest.mark.parametrize("slide", [1e-3, 4.0])
def test_friction_does_not_fade_with_the_length_of_the_slide(
    slide: float, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """A stiff body pressed by a nanometre: its friction is mu times the normal force, after a metre too."""
    floor = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    moving = {"foundation": floor | {"displacement": {"x": [[0, 0], [1, 0], [2, slide]]}}}
    lid = {"boundary": "block.top", "displacement": {"x": 0.0, "y": [[0, 0], [1, -1e-9]]}}
    scene = scene_of(
        bodies={"block": {"E": 2e11, "nu": 0.3}},
        obstacles=moving,
        contacts=contact(),
        supports={"lid": lid},
        steps={"end": 2.0, "count": 2},
    )
    *_, step = simulation_of(scene).steps()
    base = step.contacts["base"]
    assert_allclose(base.tangential_force, 0.3 * base.normal_force, rtol=1e-6)
    assert_allclose(base.slip_area, 2.0)


def test_obstacle_that_faces_away_is_refused(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    upside_down = {"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, -1.0]}}
    with pytest.raises(SceneError, match=r"obstacles\.foundation: its normal must point against block\.bottom"):
        simulation_of(scene_of(obstacles=upside_down, contacts=contact()))


def test_contact_on_a_surface_that_a_support_carries_is_refused(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    held = {"bed": {"boundary": "block.bottom", "displacement": {"x": 0.0, "y": 0.0}}}
    with pytest.raises(SceneError, match=r"contacts\.base: supports prescribe the normal motion"):
        simulation_of(scene_of(contacts=contact(), supports=held))


def test_body_that_is_prescribed_whole_is_refused(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    whole = {
        side: {"boundary": f"block.{side}", "displacement": {"x": 0.0, "y": 0.0}} for side in ("left", "right", "top")
    }
    scene = scene_of(geometry={"mesh_size": 1.0, "length": 1.0}, supports=whole)
    with pytest.raises(SceneError, match="nothing is left to solve"):
        simulation_of(scene)
