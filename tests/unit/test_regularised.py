"""The method `regularised`: smoothed laws lead to the answer of the laws themselves, as closely as it says."""

from dataclasses import replace
from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import often
from shared.problems import SceneOf, SimulationOf
from stickslip.geometry.errors import SceneError
from stickslip.solvers.classical import regularised as module
from stickslip.solvers.classical.regularised import NextStep
from stickslip.solvers.method_registry import METHODS, Solver
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.stepper import StepError

NORMAL: dict[str, dict[str, Any]] = {
    "unilateral": {"law": "unilateral"},
    "bilateral": {"law": "bilateral"},
    "linear": {"law": "compliance", "c_n": 20.0},
    "power": {"law": "compliance", "c_n": 20.0, "m_n": 2.0},
}
FRICTION: dict[str, dict[str, Any]] = {
    "coulomb": {"law": "coulomb", "mu": 0.4},
    "tresca": {"law": "tresca", "bound": 0.02},
    "stick": {"law": "stick"},
}


def pressed(
    scene_of: SceneOf, dim: int = 2, normal: str = "unilateral", friction: str = "coulomb", **tables: Any
) -> Scene:
    """Pressed and dragged in one step, by the top and by the foundation; in 3D along both axes."""
    drag = {"x": 0.06, "y": -0.1} if dim == 2 else {"x": 0.06, "y": 0.03, "z": -0.1}
    low = {"point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}
    laws = {"normal": NORMAL[normal], "friction": FRICTION[friction]}
    made: dict[str, Any] = {
        "obstacles": {"foundation": {"shape": "plane", "displacement": {"x": -0.01, "y": 0.02}} | low},
        "contacts": {"base": {"surface": "block.bottom", "against": "foundation"} | laws},
        "supports": {"top": {"boundary": "block.top", "displacement": drag}},
        "solver": {"method": "regularised", "tolerance": 1e-9},
    }
    return scene_of(dim, **(made | tables))


def exactly(scene: Scene) -> Scene:
    """The same, solved by the reference method."""
    other = replace(scene.solver, method="condensed-newton", smoothing=Solver().smoothing)
    return replace(scene, solver=other)


def energy_norm(simulation: Simulation, step: StepResult, reference: StepResult) -> float:
    """Of the difference, relative to the reference."""
    K, nodes = simulation.system.K, simulation.system.nodes
    apart = simulation.system.vector()
    apart.array[:] = (step.displacement - reference.displacement)[nodes.input].ravel()
    return float(np.sqrt((K * apart).dot(apart) / (2 * reference.energy.stored)))


def difference(scene: Scene, simulation_of: SimulationOf) -> tuple[StepResult, StepResult, float]:
    """Last steps of `regularised` and of the reference, and how far they are apart."""
    *_, step = simulation_of(scene).steps()
    simulation = simulation_of(exactly(scene))
    *_, reference = simulation.steps()
    return step, reference, energy_norm(simulation, step, reference)


ROUND = {"foundation": {"shape": "sphere", "center": [1.0, 0.5, -4.0], "radius": 4.0, "displacement": {"x": -0.01}}}
SCENES: dict[str, dict[str, Any]] = {
    "unilateral, Coulomb": {},
    "order 2": {"geometry": {"order": 2}},
    "bilateral, Tresca": {"normal": "bilateral", "friction": "tresca"},
    "unilateral, Tresca": {"friction": "tresca"},
    "power compliance, Tresca": {"normal": "power", "friction": "tresca"},
    "cube": {"dim": 3},
    "cube of order 2 on a sphere": {"dim": 3, "geometry": {"order": 2}, "obstacles": ROUND},
}
OFTEN = ("unilateral, Coulomb", "bilateral, Tresca", "power compliance, Tresca", "cube of order 2 on a sphere")


@pytest.mark.parametrize("name", often(SCENES, OFTEN))
def test_the_difference_is_no_larger_than_stated(name: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    step, reference, apart = difference(pressed(scene_of, **SCENES[name]), simulation_of)
    assert 0 < apart <= step.law_error < 2e-3  # level 1e-4
    assert reference.law_error == 0.0
    mine, theirs = step.contacts["base"], reference.contacts["base"]
    assert_allclose(mine.force, theirs.force, atol=step.law_error * np.linalg.norm(theirs.force))
    assert theirs.slip_area > 0
    assert mine.slip_area == pytest.approx(theirs.slip_area, abs=0.3 * theirs.contact_area)
    # friction makes the answer: without it the difference would be far larger than stated
    assert theirs.tangential_force > 10 * step.law_error * theirs.normal_force


def test_a_compliant_bound_at_nodes_costs_what_falls_with_the_mesh_size(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """Coulomb's bound is that of the pressure at the node; other methods take its average around the node."""
    sizes = {size: pressed(scene_of, normal="linear", geometry={"mesh_size": size}) for size in (0.25, 0.125, 0.0625)}
    apart = [difference(scene, simulation_of)[2] for scene in sizes.values()]
    assert apart[0] < 0.02
    for coarse, fine in pairwise(apart):
        assert fine < 0.6 * coarse  # first order, measured .53 and .44


def test_in_axisymmetry_radial_friction_agrees(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """A cylinder pressed flat spreads against friction; its axis moves along itself only."""
    scene = pressed(
        scene_of,
        model="axisymmetric",
        obstacles={"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        contacts={
            "base": {
                "surface": "block.bottom",
                "against": "foundation",
                "friction": {"law": "coulomb", "mu": 0.02},
            }
        },
        supports={"top": {"boundary": "block.top", "displacement": {"y": -0.1}}},
    )
    step, reference, apart = difference(scene, simulation_of)
    assert 0 < apart <= step.law_error < 2e-3
    slippery = replace(scene, contacts={"base": replace(scene.contacts["base"], friction=None)})
    assert difference(slippery, simulation_of)[1].contacts["base"].max_slip > 1.02 * reference.contacts["base"].max_slip


def test_the_error_falls_with_the_level_and_stays_below_what_is_stated(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    scene, found = pressed(scene_of), []
    for smoothing in (1e-3, 1e-4, 1e-5):
        level = replace(scene, solver=replace(scene.solver, smoothing=smoothing))
        step, _, apart = difference(level, simulation_of)
        assert apart <= step.law_error
        found.append(apart)
    assert found[1] < found[0] / 5  # proportional to the level, or nearly so
    assert found[2] < found[1] / 5


def test_errors_of_the_steps_are_added_up(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = pressed(scene_of, steps={"count": 4})
    steps, simulation = list(simulation_of(scene).steps()), simulation_of(exactly(scene))
    absolute = [step.law_error * np.sqrt(2 * step.energy.stored) for step in steps]
    assert np.all(np.diff(absolute) > 0)
    for step, reference in zip(steps, simulation.steps(), strict=True):
        assert energy_norm(simulation, step, reference) <= step.law_error


def at_random(scene: Scene, simulation_of: SimulationOf) -> tuple[NextStep, Any, Any]:
    """The method at t = 1 with coarse smoothing; random displacements, partly touching, and a direction."""
    simulation = simulation_of(scene)
    stepper = simulation.stepper
    step: Any = stepper.method_after(stepper.start())
    contact, random = step.method.contact, np.random.default_rng(3)
    contact.begin(step.u, step.motion, 1.0)
    contact.widths.set(0.3, 0.1, 0.05)
    q, direction = (simulation.system.K_B.createVecRight() for _ in range(2))
    q.array[:] = random.normal(scale=0.05, size=q.size)
    direction.array[:] = random.normal(size=q.size)
    return step, q, direction


@pytest.mark.parametrize(
    ("dim", "normal", "friction", "order"),
    [
        (2, "unilateral", "coulomb", 1),
        (2, "power", "coulomb", 2),
        (2, "unilateral", "tresca", 1),
        (3, "bilateral", "tresca", 1),
        (3, "unilateral", "coulomb", 2),
    ],
)
def test_the_tangent_is_the_derivative_of_the_forces(
    dim: int, normal: str, friction: str, order: int, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    scene = pressed(scene_of, dim, normal, friction, geometry={"order": order})
    step, q, direction = at_random(scene, simulation_of)
    contact, K = step.method.contact, step.method.system.K_B
    J = K.copy()
    contact.add_tangent(q, J)
    J.axpy(-1.0, K)
    h = 1e-7
    slope = (contact.forces(q + h * direction) - contact.forces(q - h * direction)) / (2 * h)
    assert slope.norm() > 0
    assert (slope - J * direction).norm() < 1e-6 * slope.norm()  # differences: h², eps/h


@pytest.mark.parametrize(
    ("dim", "normal", "order"), [(2, "unilateral", 1), (2, "linear", 2), (3, "power", 1), (3, "unilateral", 2)]
)
def test_tractions_add_up_to_the_assembled_forces(
    dim: int, normal: str, order: int, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    simulation = simulation_of(pressed(scene_of, dim, normal, geometry={"order": order}))
    stepper = simulation.stepper
    accepted = stepper.reach(stepper.start(), 1.0, lambda row: None)
    step: Any = stepper.method_after(stepper.start())
    contact = step.method.contact
    contact.begin(step.u, step.motion, 1.0)
    contact.widths.set(step.method.levels[-1], accepted.problem.u_ref, accepted.problem.p_ref)
    assembled = stepper.chain.volume.contact.read(
        contact.forces(step.method.system.free_part(accepted.state.u, accepted.state.time))
    )
    by_rows = stepper.surface.forces(accepted.state.p)
    assert np.abs(by_rows).max() > 1e-3
    assert_allclose(by_rows, assembled, atol=1e-7 * np.abs(by_rows).max())  # tolerance 1e-9
    # what is reported is the residual of these tractions, and it shows the smoothing
    problem = accepted.problem
    assert accepted.residual == pytest.approx(problem.natural_residual(accepted.state.p, accepted.state.w), rel=1e-3)
    nodal = normal in ("linear", "power")  # by bounds, not by the smoothing: see above
    assert 1e-6 < accepted.residual < (0.1 if nodal else 1e-2)


def test_only_what_the_table_knows_is_accepted(scene_of: SceneOf) -> None:
    """Every method with every normal and every friction law: solved, or refused in one line."""
    refused = 0
    for method, normal, friction in product(METHODS, NORMAL, FRICTION):
        scene = pressed(scene_of, 2, normal, friction, solver={"method": method})
        laws = {"normal": NORMAL[normal]["law"], "friction": friction}
        known = {"normal": METHODS[method].WORKS_WITH.normal, "friction": METHODS[method].WORKS_WITH.friction}
        unknown = [key for key, law in laws.items() if known[key] is not None and law not in known[key]]
        if not unknown:
            make_plan(scene)
            continue
        refused += 1
        key = unknown[0]
        with pytest.raises(SceneError, match=rf"contacts\.base\.{key}\.law = {laws[key]}: solver\.method = {method}"):
            make_plan(scene)
    # `regularised` with stick: there is no bound to smooth; `perturbed-lagrangian` with a law that is a spring itself
    assert refused >= len(NORMAL) + 2 * len(FRICTION)


def test_what_contact_alone_holds_is_refused(scene_of: SceneOf) -> None:
    with pytest.raises(SceneError, match=r"solver\.method = regularised: needs bodies that their supports hold"):
        make_plan(pressed(scene_of, supports={}))


def test_a_level_of_smoothing_must_lie_between_0_and_1(scene_of: SceneOf) -> None:
    for value in (0.0, 2.0):
        with pytest.raises(SceneError, match=rf"smoothing = {value}: must be above 0 and at most 1"):
            pressed(scene_of, solver={"method": "regularised", "smoothing": value})


def test_it_says_when_newton_ran_out_of_iterations(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    solver = {"method": "regularised", "max_iterations": 3}
    with pytest.raises(StepError, match="after 3 iterations; the iterations ran out"):
        list(simulation_of(pressed(scene_of, solver=solver)).steps())


def test_it_says_when_newton_stalls(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "levels", lambda smoothing: (1e-8,))  # without the levels that lead there
    monkeypatch.setattr(module, "NEWTON_STEPS", 10)
    stepper = simulation_of(pressed(scene_of, 2)).stepper
    with pytest.raises(StepError, match="the residual stopped falling"):
        stepper.reach(stepper.start(), 1.0, lambda row: None)


def test_each_iteration_costs_a_factorisation(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = pressed(scene_of)
    simulation = simulation_of(scene)
    (step,) = simulation.steps()
    assert simulation.counters.factorisations == 1 + step.iterations  # one more for the condensed surface
    assert len(step.history) == step.iterations + len(
        module.levels(scene.solver.smoothing)
    )  # each level measures where it starts


def test_the_user_can_stop_it(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    def stop(row: Any) -> None:
        if row.step.iteration == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(simulation_of(pressed(scene_of)).steps(stop))


def test_without_load_nothing_moves(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = pressed(
        scene_of,
        obstacles={"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        supports={"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}},
    )
    (step,) = simulation_of(scene).steps()
    assert (step.iterations, step.law_error, np.abs(step.displacement).max(), np.abs(step.p).max()) == (0, 0, 0, 0)


def test_ctrl_c_in_the_middle_of_newtons_method_is_ctrl_c(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = simulation_of(pressed(scene_of))

    def interrupted(*arguments: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(module.VolumeNewton, "_residual", interrupted)
    with pytest.raises(KeyboardInterrupt):
        list(simulation.steps())
