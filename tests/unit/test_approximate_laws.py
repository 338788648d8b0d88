"""Smoothed laws and springs approximate the laws, and state the error that they make."""

import tomllib
from dataclasses import replace
from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.cases import often, slow
from shared.problems import FRICTION, NORMAL, plane, pressed, two_blocks
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError
from stickslip.solvers.classical import perturbed_lagrangian as on_springs
from stickslip.solvers.classical import regularised as module
from stickslip.solvers.classical.contact_element import OPEN, SLIP, STICK, ContactElements, held_from, penalties
from stickslip.solvers.classical.perturbed_lagrangian import Newton, least_energy, newton_step, residual
from stickslip.solvers.classical.regularised import NextStep
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Status, ignore
from stickslip.solvers.laws.friction import Coulomb, Stick, Tresca
from stickslip.solvers.laws.law import FrictionLaw
from stickslip.solvers.method_registry import METHODS, Solver
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.stepper import StepError
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import READY, from_dict, read

SMOOTHED = {"method": "regularised", "tolerance": 1e-9}
SPRINGS = {"method": "perturbed-lagrangian", "augment": False, "tolerance": 1e-11}
FLAT = {"foundation": plane()}
STILL = {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}}


def exactly(scene: Scene) -> Scene:
    """The same, solved by the reference method."""
    usual = {key: getattr(Solver(), key) for key in ("smoothing", "omega_factor", "augment")}
    return replace(scene, solver=replace(scene.solver, method="condensed-newton", **usual))


Apart = tuple[StepResult, StepResult, float]


def differences(scene: Scene, reference: Scene | None = None) -> list[Apart]:
    """Steps of the method, those of the reference, and how far they are apart in the reference's energy norm."""
    simulation, found = prepare(reference or exactly(scene)), []
    for step, exact in zip(prepare(scene).steps(), simulation.steps(), strict=True):
        K, apart = simulation.system.K, simulation.system.vector()
        apart.array[:] = (step.displacement - exact.displacement)[simulation.system.nodes.input].ravel()
        found.append((step, exact, float(np.sqrt((K * apart).dot(apart) / (2 * exact.energy.stored)))))
    return found


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
def test_the_difference_is_no_larger_than_stated(name: str) -> None:
    ((step, reference, apart),) = differences(pressed(solver=SMOOTHED, **SCENES[name]))
    assert 0 < apart <= step.law_error < 2e-3  # level 1e-4
    assert reference.law_error == 0.0
    mine, theirs = step.contacts["base"], reference.contacts["base"]
    assert_allclose(mine.force, theirs.force, atol=step.law_error * np.linalg.norm(theirs.force))
    assert theirs.slip_area > 0
    assert mine.slip_area == pytest.approx(theirs.slip_area, abs=0.3 * theirs.contact_area)
    # friction makes the answer: without it the difference would be far larger than stated
    assert theirs.tangential_force > 10 * step.law_error * theirs.normal_force


def test_a_compliant_bound_at_nodes_costs_what_falls_with_cells() -> None:
    """Coulomb's bound is that of the pressure at the node; other methods take its average around the node."""
    sizes = {
        size: pressed(solver=SMOOTHED, normal="linear", geometry={"mesh_size": size}) for size in (0.25, 0.125, 0.0625)
    }
    apart = [differences(scene)[-1][2] for scene in sizes.values()]
    assert apart[0] < 0.02
    for coarse, fine in pairwise(apart):
        assert fine < 0.6 * coarse  # first order, measured .53 and .44


def test_in_axisymmetry_radial_friction_agrees() -> None:
    """A cylinder pressed flat spreads against friction; its axis moves along itself only."""
    scene = pressed(
        solver=SMOOTHED,
        model="axisymmetric",
        obstacles=FLAT,
        contacts={
            "base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.02}}
        },
        supports={"top": {"boundary": "block.top", "displacement": {"y": -0.1}}},
    )
    ((step, reference, apart),) = differences(scene)
    assert 0 < apart <= step.law_error < 2e-3
    slippery = replace(scene, contacts={"base": replace(scene.contacts["base"], friction=None)})
    assert differences(slippery)[0][1].contacts["base"].max_slip > 1.02 * reference.contacts["base"].max_slip


def test_the_error_falls_with_the_level_and_is_less_than_stated() -> None:
    scene, found = pressed(solver=SMOOTHED), []
    for smoothing in (1e-3, 1e-4, 1e-5):
        level = replace(scene, solver=replace(scene.solver, smoothing=smoothing))
        ((step, _, apart),) = differences(level)
        assert apart <= step.law_error
        found.append(apart)
    assert found[1] < found[0] / 5  # proportional to the level, or nearly so
    assert found[2] < found[1] / 5


def test_errors_of_the_steps_are_added_up() -> None:
    found = differences(pressed(solver=SMOOTHED, steps={"count": 4}))
    absolute = [step.law_error * np.sqrt(2 * step.energy.stored) for step, _, _ in found]
    assert np.all(np.diff(absolute) > 0)
    assert all(apart <= step.law_error for step, _, apart in found)


def at_random(scene: Scene) -> tuple[NextStep, Any, Any]:
    """The method at t = 1 with coarse smoothing; random displacements, partly touching, and a direction."""
    simulation = prepare(scene)
    stepper = simulation.stepper
    step: Any = stepper.method_after(stepper.start())
    contact, random = step.method.contact, np.random.default_rng(3)
    cone = stepper.cone.at(1.0)
    contact.begin(step.before.u, step.before.motion, cone, np.zeros(cone.size))
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
def test_the_tangent_is_the_derivative_of_the_forces(dim: int, normal: str, friction: str, order: int) -> None:
    scene = pressed(dim, normal, friction, solver=SMOOTHED, geometry={"order": order})
    step, q, direction = at_random(scene)
    contact, K = step.method.contact, step.method.system.K_B
    J = K.copy()
    contact.add_tangent(q, J)
    J.axpy(-1.0, K)
    h = 1e-7
    slope = (contact.forces(q + h * direction) - contact.forces(q - h * direction)) / (2 * h)
    assert slope.norm() > 0
    assert (slope - J * direction).norm() < 1e-6 * slope.norm()  # differences: h², eps/h


@pytest.mark.parametrize(
    ("dim", "normal", "order"),
    [
        (2, "unilateral", 1),
        (2, "linear", 2),
        (3, "power", 1),
        (3, "unilateral", 2),
    ],
)
def test_tractions_add_up_to_the_assembled_forces(dim: int, normal: str, order: int) -> None:
    simulation = prepare(pressed(dim, normal, solver=SMOOTHED, geometry={"order": order}))
    stepper = simulation.stepper
    accepted = stepper.reach(stepper.start(), 1.0, lambda row: None)
    step: Any = stepper.method_after(stepper.start())
    contact = step.method.contact
    step.begin(accepted.problem)
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


def test_only_what_the_table_knows_is_accepted() -> None:
    """Every method with every normal and every friction law: solved, or refused in one line."""
    refused = 0
    for method, normal, friction in product(METHODS, NORMAL, ("coulomb", "tresca", "stick")):
        scene = pressed(2, normal, friction, solver={"method": method})
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
    assert refused >= len(NORMAL) + 2 * 3


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (SMOOTHED | {"smoothing": 0.0}, "smoothing = 0.0: must be above 0 and at most 1"),
        (SMOOTHED | {"smoothing": 2.0}, "smoothing = 2.0: must be above 0 and at most 1"),
        (SPRINGS | {"omega_factor": 0.0}, "omega_factor = 0.*: must be positive"),
    ],
)
def test_a_level_of_smoothing_and_a_penalty_have_their_limits(keys: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        pressed(solver=keys)


@pytest.mark.parametrize(("solver", "most"), [(SMOOTHED, 3), (SPRINGS, 2)])
def test_it_says_when_newton_ran_out_of_iterations(solver: dict[str, Any], most: int) -> None:
    with pytest.raises(StepError, match=f"after {most} iterations; the iterations ran out"):
        list(prepare(pressed(solver=solver | {"max_iterations": most})).steps())


def test_it_says_when_it_stalls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "levels", lambda smoothing: (1e-8,))  # without the levels that lead there
    monkeypatch.setattr(module, "NEWTON_STEPS", 10)
    with pytest.raises(StepError, match="the residual stopped falling"):
        list(prepare(pressed(solver=SMOOTHED)).steps())


def test_each_iteration_costs_a_factorisation() -> None:
    simulation = prepare(pressed(solver=SMOOTHED))
    (step,) = simulation.steps()
    assert simulation.counters.factorisations == 1 + step.iterations  # one more for the condensed surface
    assert [row.iteration for row in step.history] == list(range(1 + step.iterations))


def test_the_user_can_stop_it() -> None:
    def stop(row: Any) -> None:
        if row.step.iteration == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(prepare(pressed(solver=SMOOTHED)).steps(stop))


@pytest.mark.parametrize("solver", [SMOOTHED, SPRINGS])
def test_without_load_nothing_moves(solver: dict[str, Any]) -> None:
    (step,) = prepare(pressed(solver=solver, obstacles=FLAT, supports=STILL)).steps()
    assert (step.iterations, step.law_error, np.abs(step.displacement).max(), np.abs(step.p).max()) == (0, 0, 0, 0)


def test_ctrl_c_in_the_middle_of_newtons_method_is_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = prepare(pressed(solver=SMOOTHED))

    def interrupted(*arguments: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(module.VolumeNewton, "_residual", interrupted)
    with pytest.raises(KeyboardInterrupt):
        list(simulation.steps())


def on_a_block(dim: int) -> Scene:
    """Slave nodes on master facets of another block; pressed and dragged."""
    last, size = ("y", 0.2) if dim == 2 else ("z", 0.3)
    shape = {"length": 1.0, "height": 1.0, "lower_length": 1.5, "mesh_size": size, "lower_mesh_size": 0.8 * size}
    drag = {"x": 0.12, last: -0.05} | ({"y": 0.05} if dim == 3 else {})
    joint = {"operator": "node-to-segment" if dim == 2 else "node-to-face", "friction": FRICTION["coulomb"]}
    width = {"width": 0.7} if dim == 3 else {}
    return two_blocks(dim, drag, joint, geometry=shape | width, solver=SPRINGS)


def problem_of(simulation: Simulation, time: float = 1.0) -> tuple[SurfaceProblem, Array, Array]:
    """The surface problem of the first step, its solution u_c (c,) [m] and its tractions (rows,) [Pa]."""
    stepper = simulation.stepper
    reached = stepper.reach(stepper.start(), time, lambda row: None)
    return reached.problem, reached.problem.contact_displacement(reached.state.p), reached.state.p


def mixed(problem: SurfaceProblem, omega: Array) -> tuple[ContactElements, Array, Array]:
    """Elements with forces of a last step, at a random displacement at which some are open, some stick, some slip."""
    random = np.random.default_rng(2)
    p_old = problem.p_ref * random.normal(scale=0.02, size=len(omega))
    elements = ContactElements.of(problem, omega, p_old)
    u_c = problem.u_ref * (0.2 + random.normal(scale=0.1, size=problem.surface.size))
    n = problem.surface.normal_rows
    G = elements.gaps(u_c)
    G[:n] = problem.u_ref * np.where(np.arange(n) % 4 == 0, -0.3, random.uniform(0.2, 1.0, n))
    ratio = 0.3 if problem.surface.size == 2 * n else 0.25  # of tangential gaps: on both sides of mu
    G[n:] = ratio * problem.u_ref * random.normal(size=len(G) - n)
    fits = np.linalg.lstsq(problem.surface.N.toarray(), G - elements.gaps(0 * u_c), rcond=None)[0]
    assert_allclose(elements.gaps(fits), G, atol=1e-9 * problem.u_ref)
    return elements, fits, problem.surface.W * problem.p_ref * random.normal(size=len(G))


BODIES = [(2, "obstacle"), (3, "obstacle"), (2, "bodies"), (3, "bodies")]


def scene_for(dim: int, against: str) -> Scene:
    return pressed(dim, solver=SPRINGS) if against == "obstacle" else on_a_block(dim)


@pytest.mark.parametrize(("dim", "against"), BODIES)
def test_the_tangent_is_the_derivative_of_the_residual(dim: int, against: str) -> None:
    """By central differences over all displacements and forces, in stick, slip and open."""
    simulation = prepare(scene_for(dim, against))
    problem = problem_of(simulation)[0]
    elements, u_c, Sigma = mixed(problem, problem.gamma)  # soft springs: both blocks of R are of the same size
    answer, c = elements.answer(elements.gaps(u_c)), len(u_c)
    n = problem.surface.normal_rows
    assert set(answer.status[n:]) == {OPEN, STICK, SLIP}
    to_dofs, to_forces, K_C = (block.toarray() for block in elements.tangent(answer))
    K = np.block([[problem.surface.S, to_dofs], [to_forces, K_C]])
    x, h = np.concatenate([u_c, Sigma]), 1e-5 * problem.u_ref

    def R(x: Array) -> Array:
        moved = elements.answer(elements.gaps(x[:c]))
        assert_array_equal(moved.status, answer.status)  # else choose another seed
        return np.concatenate(residual(elements, moved, x[:c], x[c:]))

    differences = np.stack([(R(x + h * e) - R(x - h * e)) / (2 * h) for e in np.eye(len(x))], axis=1)
    assert_allclose(K, differences, atol=1e-7 * np.abs(K).max())
    for state in (OPEN, STICK, SLIP):  # each on its own, beside its own size
        rows = c + n + np.flatnonzero(answer.status[n:] == state)
        assert_allclose(K[rows], differences[rows], atol=1e-7 * np.abs(K[rows]).max())
    slip, closed = n + np.flatnonzero(answer.status[n:] == SLIP), np.flatnonzero(answer.status == STICK)
    slope = answer.slope.toarray()
    assert np.abs(slope[np.ix_(slip, closed[closed < n])]).max() > 0.1 * slope.max()  # mu, and not back: unsymmetric
    assert not slope[:n, n:].any()


@pytest.mark.parametrize(("dim", "nodes"), [(2, 3), (3, 4)])
def test_an_element_has_the_published_nodes(dim: int, nodes: int) -> None:
    """A slave node and the two or three of the master facet."""
    (rows,) = prepare(on_a_block(dim)).system.contacts
    touched = [len(np.unique(row.indices[np.abs(row.data) > 1e-12] // dim)) for row in rows.N_n]
    assert max(touched) == nodes


@pytest.mark.parametrize(("dim", "against"), BODIES)
@pytest.mark.parametrize("friction", [Coulomb(mu=0.4), Tresca(bound=0.02), Stick()])
def test_elements_ask_for_what_the_laws_allow(dim: int, against: str, friction: FrictionLaw) -> None:
    scene = scene_for(dim, against)
    ((name, contact),) = scene.contacts.items()
    problem = problem_of(prepare(exactly(replace(scene, contacts={name: replace(contact, friction=friction)}))))[0]
    elements, u_c, _ = mixed(problem, problem.gamma)
    G, W = elements.gaps(u_c), problem.surface.W
    assert_allclose(elements.answer(G).Sigma, W * problem.cone.project(elements.omega * G / W, problem.gamma))


@pytest.mark.parametrize("name", [*slow("block"), "shaft", *slow("cube", "sliding")])
def test_springs_that_start_again_leave_the_laws_themselves(name: str) -> None:
    """As published, the residual of the laws is that of the springs, 1e-4; `shaft` needs softer ones to start again."""
    sizes = {"block": (0.25, 0.25), "shaft": (0.2, 0.08)}.get(name, ())
    words = [f"geometry.{key}={size}" for key, size in zip(("mesh_size", "contact_mesh_size"), sizes, strict=False)]
    scene = read(name, ["solver.method=perturbed-lagrangian", *words])
    assert scene.solver.augment
    for step, _, apart in differences(scene):
        assert step.residual <= scene.solver.tolerance
        assert apart < 1e-6
    published = replace(scene, solver=replace(scene.solver, augment=False))
    assert max(step.residual for step in prepare(published).steps()) > 1e-5


@pytest.mark.parametrize(("dim", "against"), BODIES)
def test_convergence_is_quadratic_once_the_status_has_settled(dim: int, against: str) -> None:
    """In 2D the settled system is linear: one step. In 3D the direction of slip turns."""
    simulation = prepare(scene_for(dim, against))
    problem, u_c, p = problem_of(simulation)
    elements = ContactElements.of(problem, 10 * problem.gamma, np.zeros_like(p))
    newton = Newton(problem, 1000, ignore, u_c, problem.surface.W * p)
    assert newton.solve(10 * problem.gamma, np.zeros_like(p), 1e-13) is Status.CONVERGED
    solution, status = newton.u_c, elements.answer(elements.gaps(newton.u_c)).status
    assert SLIP in status
    away = np.random.default_rng(1).normal(size=len(solution))
    x, apart = (solution + 1e-3 * problem.u_ref * away, newton.Sigma), [1e-3 * float(np.linalg.norm(away))]
    for _ in range(4):
        answer = elements.answer(elements.gaps(x[0]))
        assert_array_equal(answer.status, status)  # settled; else start nearer
        step = newton_step(elements, answer, *x)
        x = x[0] + step[0], x[1] + step[1]
        apart.append(float(np.linalg.norm(x[0] - solution)) / problem.u_ref)
    rounding = 1e-12
    if dim == 2:
        assert apart[1] < rounding
        return
    assert apart[1] > 1e3 * rounding
    factor = apart[1] / apart[0] ** 2
    for before, after in pairwise(apart[1:]):
        assert after < max(10 * factor * before**2, rounding)  # the factor depends on the direction


def coarse(name: str, **solver: Any) -> Scene:
    """A ready scene on a coarse mesh."""
    scene = read(name, ["geometry.mesh_size=0.25"] + ["geometry.contact_mesh_size=0.25"] * (name == "block"))
    return replace(
        scene, solver=replace(scene.solver, method="perturbed-lagrangian", augment=False, tolerance=1e-11, **solver)
    )


@pytest.mark.parametrize("name", [*slow("block"), "cube"])
def test_stated_errors_hold_on_ready_scenes_and_fall_like_omega(name: str) -> None:
    found = []
    for factor in (10.0, 100.0, 1000.0):
        steps = differences(coarse(name, omega_factor=factor))
        for step, _, error in steps:
            assert 0.2 * step.law_error < error <= step.law_error
        found.append([error for _, _, error in steps])
    assert_allclose(np.divide(found[1], found[0]), 0.1, rtol=0.15)  # first order in 1/omega
    assert_allclose(np.divide(found[2], found[1]), 0.1, rtol=0.02)
    assert max(found[2]) < 6e-4  # a layer of springs 1/1000 as thick as a cell, of four to eight cells in the depth
    slippery = coarse(name)
    contact: Any = slippery.contacts["base"]
    worn = replace(slippery, contacts={"base": replace(contact, friction=replace(contact.friction, mu=0.29))})
    assert differences(worn, exactly(slippery))[-1][2] > 2 * steps[-1][0].law_error  # a friction 3 % off shows


def test_extrapolated_to_stiff_springs_it_agrees_with_the_laws_themselves() -> None:
    """(10 u_10ω - u_ω) / 9 has lost the first order, once ω does not change the status of any element."""
    scenes = [*(coarse("block", omega_factor=factor) for factor in (1e3, 1e4)), exactly(coarse("block"))]
    soft, stiff, reference = (list(prepare(scene).steps()) for scene in scenes)
    for a, b, exact in zip(soft, stiff, reference, strict=True):
        forces = [step.contacts["base"].force for step in (a, b, exact)]
        first = np.abs(forces[1] - forces[2]).max()
        assert first > 0
        assert np.abs((10 * forces[1] - forces[0]) / 9 - forces[2]).max() < 1e-2 * first


ON_SPRINGS: dict[str, dict[str, Any]] = {
    "no friction": {"friction": None},
    "order 2": {"geometry": {"order": 2}},
    "bilateral, Tresca": {"normal": "bilateral", "friction": "tresca"},
    "stick": {"friction": "stick"},
    "tied": {"normal": "tied", "friction": None},
    "tangential stiffness": {"friction": {"law": "coulomb", "mu": 0.1, "k_T": 5.0}},
    "high friction": {"friction": {"law": "coulomb", "mu": 1.5}},
    "cube on a sphere": {"dim": 3, "obstacles": ROUND},
    # as a whole the bodies sink into the springs
    "held by friction": {"supports": {}, "loads": {"top": {"boundary": "block.top", "traction": [0.03, -0.1]}}},
    "driven obstacle": {
        "obstacles": {"foundation": FLAT["foundation"] | {"force": {"y": 0.1}, "displacement": {"x": -0.02}}},
        "supports": STILL,
    },
}


@pytest.mark.parametrize("name", ON_SPRINGS)
def test_the_stated_error_holds(name: str) -> None:
    ((step, _, apart),) = differences(pressed(solver=SPRINGS, **ON_SPRINGS[name]))
    assert 0 < apart <= step.law_error < 2e-3  # cells of a quarter, in 3D of half the depth, over 1000
    assert step.contacts["base"].slip_area > 0 or name not in ("held by friction", "driven obstacle")


@pytest.mark.parametrize("dim", [*slow(2), 3])
def test_the_stated_error_holds_between_bodies(dim: int) -> None:
    ((step, _, apart),) = differences(on_a_block(dim))
    assert 0 < apart <= step.law_error < 1e-3


def test_a_stuck_block_does_not_creep() -> None:
    """Held still for four steps after it was pressed in one: nothing moves, no error is added."""
    held = {"top": {"boundary": "block.top", "displacement": {"x": [[0, 0], [1, 0.02]], "y": [[0, 0], [1, -0.1]]}}}
    steps = {"end": 5.0, "count": 5}
    scene = pressed(solver=SPRINGS, supports=held, steps=steps, obstacles=FLAT)
    first, *others = prepare(scene).steps()
    assert first.contacts["base"].stick_area > 0
    for step in others:
        assert_allclose(step.displacement, first.displacement, atol=1e-9)
        assert step.law_error == pytest.approx(first.law_error, rel=1e-4)


def test_the_error_is_that_of_springs_where_no_status_changes() -> None:
    """All stuck, the system is linear, and the bound is the error itself."""
    ((step, _, apart),) = differences(pressed(solver=SPRINGS, normal="tied", friction=None))
    assert apart == pytest.approx(step.law_error, rel=2 * apart)  # each is relative to its own energy


def test_the_line_search_shortens_a_step_that_leads_away() -> None:
    """The block pushed sideways, from where it is pressed, with stiff springs at once."""
    simulation = prepare(coarse("block"))
    stepper, omega = simulation.stepper, penalties(simulation.system, 1000.0)
    pushed = stepper.reach(stepper.reach(stepper.start(), 1.0, lambda row: None).state, 2.0, lambda row: None)
    problem, p = pushed.problem, pushed.substep_start.p
    newton = Newton(problem, 100, ignore, problem.contact_displacement(p), problem.surface.W * p)
    elements = ContactElements.of(problem, omega, held_from(problem, p))
    u_c, Sigma = newton.u_c, newton.Sigma
    step = newton_step(elements, elements.answer(elements.gaps(u_c)), u_c, Sigma)
    before = newton._size(elements, u_c, Sigma)
    assert newton._size(elements, u_c + step[0], Sigma + step[1]) > before
    newton._advance(elements)
    assert newton._size(elements, newton.u_c, newton.Sigma) < before


def test_penalties_follow_the_stiffness_and_the_mesh() -> None:
    """E/h and G/h, 1000 times: of 0.25 m and nu = 0.3."""
    system = prepare(pressed(solver=SPRINGS)).system
    n = len(system.contacts[0].W_n)
    omega = penalties(system, 1000.0)
    assert_allclose(omega[:n], 1000 / 0.25)
    assert_allclose(omega[n:], 1000 / 2.6 / 0.25)
    twice = on_a_block(2)  # two bodies give in series, cells of 0.2 and about 0.16
    assert_allclose(penalties(prepare(twice).system, 1000.0)[0], 1000 / 0.36, rtol=0.05)
    assert_allclose(100 * penalties(prepare(twice).system, 10.0), penalties(prepare(twice).system, 1000.0))


def test_penalties_are_those_of_the_facets_at_each_point() -> None:
    """Cells of 1 mm where a ball touches, of 1 m elsewhere: of one h for all, springs would be far too soft there."""
    scene = read("sphere")
    simulation = prepare(replace(scene, solver=Solver(method="perturbed-lagrangian", augment=False)))
    (c,) = simulation.system.contacts
    omega_n, pole = (penalties(simulation.system, 1000.0)[: len(c.W_n)], np.argmin(c.surface.points[:, 0]))
    first = np.sort(np.linalg.norm(c.surface.points - c.surface.points[pole], axis=1))
    cell = first[2]  # of order 2: the node at its middle lies between
    assert omega_n.max() == pytest.approx(1000 * scene.bodies["disc"].E / cell, rel=0.2)
    assert omega_n.max() > 300 * omega_n.min()
    (step,) = simulation.steps()
    assert 0 < step.law_error < 2e-4  # with the mean of all facets: 1.5e-2


def test_a_level_is_put_between_where_it_stalls(monkeypatch: pytest.MonkeyPatch) -> None:
    """With levels that are too far apart; without the ones between, the step is halved."""
    scene = read("block", ["geometry.cells=tensor", "geometry.mesh_size=0.2", "geometry.contact_mesh_size=0.1"])
    scene = replace(scene, solver=Solver(method="perturbed-lagrangian", augment=False, tolerance=1e-11))
    monkeypatch.setattr(on_springs, "FACTOR", 1e3)
    assert [step.substeps for step in prepare(scene).steps()] == [1, 1]
    monkeypatch.setattr(on_springs, "DETOURS", 0)
    assert [step.substeps for step in prepare(scene).steps()] == [1, 2]


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "compliance": (
        {"normal": "linear"},
        r"contacts\.base\.normal\.law = compliance: solver\.method = perturbed-lagrangian works with unilateral",
    ),
    "matrix-free": (
        {"solver": {"method": "perturbed-lagrangian", "surface": "matrix-free"}},
        r"solver\.surface = matrix-free: solver\.method = perturbed-lagrangian needs the condensed form",
    ),
    "floating": (
        {"solver": SMOOTHED, "supports": {}},
        r"solver\.method = regularised: needs bodies that their",
    ),
}


@pytest.mark.parametrize(("tables", "words"), REFUSED.values(), ids=REFUSED)
def test_what_it_cannot_do_is_refused(tables: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        make_plan(pressed(**{"solver": SPRINGS} | tables))


def test_springs_say_when_newton_stalls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(on_springs, "NEWTON_STEPS", 1)
    with pytest.raises(StepError, match="the residual stopped falling"):
        list(prepare(coarse("cube")).steps())


def test_the_least_displacement_is_one_of_least_energy() -> None:
    """Any other with the same relative displacement has more."""
    problem = problem_of(prepare(pressed(solver=SPRINGS, friction=None)))[0]
    surface: Any = problem.surface
    w = np.random.default_rng(0).normal(size=len(surface.W))
    N = surface.N.toarray()
    some = np.linalg.lstsq(N, w, rcond=None)[0]
    least = least_energy(problem, w)
    assert least < float(np.sqrt(some @ surface.S @ some))
    free = np.linalg.svd(N)[2][len(w) :].T  # motions that no row sees
    best = some - free @ np.linalg.solve(free.T @ surface.S @ free, free.T @ surface.S @ some)
    assert least == pytest.approx(float(np.sqrt(best @ surface.S @ best)), rel=1e-9)


def test_a_floating_body_under_a_given_bound_is_solved() -> None:
    """Where all of it slips, Tresca's bound gives the tangent no stiffness: the search passes by singular ones."""
    floating = {"supports": {}, "loads": {"top": {"boundary": "block.top", "traction": [0.005, -0.1]}}}
    scene = pressed(solver=SPRINGS, friction={"law": "tresca", "bound": 0.01}, **floating)
    (step,) = prepare(scene).steps()
    base = step.contacts["base"]
    assert_allclose(base.force, [-0.01, 0.2], atol=1e-9)  # of 2 m; the line is in balance
    assert abs(step.displacement).max() < 1.0  # a part sticks
    assert base.slip_area > 0
    assert base.stick_area > 0


def test_a_body_that_is_let_go_has_the_error_that_it_had() -> None:
    """Relative to nothing it would be without bounds."""
    lifted = {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": [[0, 0], [1, -0.1], [2, 0.1]]}}}
    pressed_, let_go = prepare(pressed(solver=SPRINGS, supports=lifted, steps={"end": 2.0, "count": 2})).steps()
    assert let_go.energy.stored < 1e-12 * pressed_.energy.stored
    assert 0 < let_go.law_error < 1e-2


def test_a_compliance_at_nodes_of_curved_sides_is_refused() -> None:
    """The form has it at points, where a law that is softer than the cells has it too."""
    data = tomllib.loads((READY / "shaft.toml").read_text()) | {"solver": {"method": "regularised"}}
    data["contacts"]["bore"]["normal"] = {"law": "compliance", "c_n": 1.0}
    prepare(from_dict(data))
    data["contacts"]["bore"]["normal"]["c_n"] = 1e4
    with pytest.raises(SceneError, match=r"contacts\.bore\.normal\.law = compliance: .*flat sides alone"):
        prepare(from_dict(data))
