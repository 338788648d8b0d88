"""Tangent conjugate gradients find the answer, and their tangent solves are what they say."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose, assert_array_equal, assert_equal
from petsc4py import PETSc
from scipy import sparse

from shared.cases import slow
from shared.cells import REFERENCE, Cell, largest, reference, refused, solved
from shared.problems import SceneOf, SimulationOf, march
from stickslip import MachineError, NoEquilibriumError, Scene, Simulation, SolverError
from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import PC, Mat
from stickslip.solvers.classical.contact_element import SLIP, penalties
from stickslip.solvers.interface.prepare import Form
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.linear import multigrid
from stickslip.solvers.methods.tangent_cg import GROWN, Iteration, OnTangent
from stickslip.solvers.parallel.serialise import serialise
from stickslip.solvers.results.linear_reference import linear_reference
from stickslip.solvers.stepping import method_chain
from stickslip.solvers.system.system import System
from stickslip.solvers.tangent import operator as operator_module
from stickslip.solvers.tangent.coordinates import ContactCoordinates
from stickslip.solvers.tangent.laws import Tangent
from stickslip.solvers.tangent.operator import TangentOperator
from stickslip.workflows.lab.studies.published import contact
from stickslip.workflows.lab.studies.published.tangent import (
    ILU,
    SlipTangent,
    condition,
    dropped_fill,
    gauss_seidel,
    gmres,
    mumps,
    unsymmetry,
)
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import read

SAME = 1e-7  # two decades above the tolerance: friction's condition
CELLS = [
    Cell("tangent-cg", model="3d"),  # lifts off when it is relieved
    Cell("tangent-cg", friction=None, model="3d"),
    Cell("tangent-cg", friction="capped_coulomb", operator="mortar", model="3d"),
    Cell("tangent-cg", normal="compliance", operator="mortar", model="3d"),
    Cell("tangent-cg", model="3d", more="order 2"),
    Cell("tangent-cg", operator="mortar", model="3d", more="floating"),
    Cell("tangent-cg", operator="node-to-segment", more="k_T"),
]
MATRIX_FREE = ["solver.surface=matrix-free", "output.error=false"]
METHOD = ['solver={ method = "tangent-cg", tolerance = 1e-8 }', "output.error=false"]
BACK = "supports.top.displacement={ x = [[0, 0], [1, 0], [2, 0.02], [3, -0.01]], y = 0.0, z = [[0, 0], [1, -0.05]] }"


def cube(*settings: str) -> Scene:
    return read("cube", [*METHOD, *settings])


def ran(scene: Scene) -> tuple[Simulation, list[np.ndarray]]:
    """The simulation, and the forces of all steps."""
    simulation = prepare(scene, MPI.COMM_SELF)
    contact = next(iter(simulation.problem.pairs))
    return simulation, [step.contacts[contact].force for step in simulation.steps()]


@pytest.mark.parametrize("cell", CELLS, ids=str)
def test_the_answer_is_that_of_newton(cell: Cell) -> None:
    assert largest(solved(cell.scene(1e-9))[1], reference(replace(cell, method=REFERENCE), 1e-9)) < SAME


@pytest.mark.parametrize(
    "scene",
    [
        ("cube", "geometry.mesh_size=0.25", BACK, "steps={ end = 3.0, count = 3 }"),  # slip that turns back
        ("half_ball", "geometry.contact_mesh_size=0.1", "steps.count=2"),
    ],
    ids=lambda scene: scene[0],
)
def test_ready_scenes_have_the_forces_of_newton(scene: tuple[str, ...]) -> None:
    name, *settings = scene
    found = ran(read(name, [*METHOD, *settings]))[1]
    expected = ran(read(name, ["solver.method=condensed-newton", "output.error=false", *settings]))[1]
    assert_allclose(found, expected, rtol=0, atol=SAME * np.abs(expected).max())


@pytest.mark.parametrize("operator", ["rigid", "mortar"])
def test_relative_displacements_are_coordinates(operator: str) -> None:
    simulation = prepare(Cell("tangent-cg", operator=operator, model="3d").scene(1e-9), MPI.COMM_SELF)
    surface, system = simulation.stepper.surface, simulation.system
    coordinates = ContactCoordinates.of(system, surface)
    at = TangentOperator(system, coordinates)
    u = system.K_B.createVecRight()
    u.array[:] = np.random.default_rng(1).standard_normal(u.getLocalSize())
    v = at.coordinates(u)
    rows = coordinates.at >= 0
    assert_allclose(v[coordinates.at[rows]], (surface.N @ u.array[system.interface.dofs])[rows], atol=1e-12)
    assert_allclose(at.displacement(v).array, u.array, atol=1e-12)  # T T^-1
    K_u = at.forces(system.K_B * u)
    assert_allclose(at.product(v), K_u, atol=1e-12)  # (T^T K T) T^-1 u
    for columns in (at.slaves, at.around):
        alone = columns.whole(v[columns.at], at.count)
        moved, K_moved = np.zeros((2, at.count))
        columns.move(v[columns.at], moved, K_moved)
        assert np.array_equal(moved, alone)
        assert_allclose(K_moved, at.product(alone), atol=1e-12)
        assert_allclose(columns.block(v[columns.at]), K_moved[columns.at], atol=1e-12)
    assert coordinates.alone == (operator == "rigid")


def test_nodes_around_are_the_two_layers_at_the_contact() -> None:
    operator = ready_of(prepare(cube("geometry.mesh_size=0.25"), MPI.COMM_SELF)).operator
    assert (len(operator.at), len(operator.around.at)) == (3 * 25, 3 * 50)


def test_sweeps_know_the_largest_eigenvalue_of_the_nodes_around() -> None:
    simulation = prepare(Cell("tangent-cg", operator="mortar", model="3d").scene(1e-9), MPI.COMM_SELF)
    around = ready_of(simulation).operator.around
    K = np.column_stack([around.block(unit) for unit in np.eye(len(around.at))])
    of_nodes = np.kron(np.eye(len(around.diagonal)), np.ones((3, 3))) * K
    largest_one = np.linalg.eigvals(np.linalg.solve(of_nodes, K)).real.max()
    assert 0.9 * largest_one < around.largest_eigenvalue() <= largest_one * (1 + 1e-12)


def test_corrections_are_conjugate_while_contact_does_not_change(monkeypatch: pytest.MonkeyPatch) -> None:
    """To all that came after the last change, not only to the one before."""
    advance, taken = Iteration._advance, list[tuple[bool, np.ndarray, np.ndarray]]()

    def kept(self: Iteration, tangent: Tangent, *others: Any) -> tuple[np.ndarray, np.ndarray]:
        changed = self.free is None or not np.array_equal(self.free, tangent.free)
        taken.append((changed, *advance(self, tangent, *others)))
        return taken[-1][1:]

    monkeypatch.setattr(Iteration, "_advance", kept)
    ran(cube("geometry.mesh_size=0.125", "contacts.base.friction.mu=10.0", "steps={ end = 1.0, count = 1 }"))
    last = max(k for k, (changed, *_) in enumerate(taken) if changed)
    assert last > 0
    D, K_D = (np.array(each) for each in zip(*(step[1:] for step in taken[last:]), strict=True))
    G = D @ K_D.T
    sizes = np.sqrt(np.diag(G))
    assert len(D) > 5
    assert np.abs(G / sizes / sizes[:, None] - np.eye(len(D))).max() < 1e-6


@pytest.mark.parametrize("of_nodes", ["all", "normal"])  # of their motions
@pytest.mark.parametrize("operator", ["rigid", "mortar"])
def test_multigrid_has_no_stiffness_of_held_ways(operator: str, of_nodes: str, monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = prepare(Cell("tangent-cg", operator=operator, model="3d").scene(1e-9), MPI.COMM_SELF)
    surface, system = simulation.stepper.surface, simulation.system
    every = ContactCoordinates.of(system, surface)
    some = every.blocks[::2].ravel()
    some = some if of_nodes == "all" else np.intersect1d(some, every.normal)
    given: list[Mat] = []
    made: list[PC] = []

    def kept(K: Mat, *others: Any, **options: Any) -> PC:
        given.append(K.copy())
        made.append(multigrid.multigrid(K, *others, **options))
        return made[-1]

    monkeypatch.setattr(operator_module, "multigrid", kept)
    before = system.K_B.copy()
    at = TangentOperator(system, every)
    part = ContactCoordinates.of(system, surface, some)
    at.hold(part, some)
    assert [bool(each) for each in made] == [False, True]  # the first is destroyed: there is memory for one
    assert system.K_B.equal(before)
    for found, coordinates, held in zip(given, (every, part), (every.blocks.ravel(), some), strict=True):
        expected = before.PtAP(coordinates.T)
        expected.zeroRowsColumns(held.astype(PETSc.IntType))
        found.zeroRowsColumns(held.astype(PETSc.IntType))  # their diagonal is a mean
        expected.axpy(-1.0, found, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        assert expected.norm() < 1e-14 * before.norm()


def ready_of(simulation: Simulation) -> OnTangent:
    """What the chain of methods has prepared."""
    ready = simulation.stepper.method_after.__self__
    assert isinstance(ready, OnTangent)
    return ready


def test_other_contact_rows_take_over_what_multigrid_holds() -> None:
    simulation = prepare(Cell("tangent-cg", operator="mortar", model="3d").scene(1e-9), MPI.COMM_SELF)
    stepper, before = simulation.stepper, ready_of(simulation)
    some = before.coordinates.blocks[::2].ravel()
    for numbers in (some, np.intersect1d(some, before.coordinates.normal)):
        before.hold(numbers)
        before.make_coarse()
        stepper.method_after = stepper.chain.method(simulation.system, stepper.surface)
        after = ready_of(simulation)
        assert after is not before
        assert after.held is not None
        assert_array_equal(after.held, np.sort(numbers))
        assert after.coarse is not None
        assert after.operator.sliding == (len(numbers) < len(some))
        before = after


def test_multigrid_that_was_released_is_set_up_again() -> None:
    simulation = prepare(Cell("tangent-cg", operator="mortar", model="3d").scene(1e-9), MPI.COMM_SELF)
    operator = ready_of(simulation).operator
    r = np.random.default_rng(1).standard_normal(simulation.system.K_B.getLocalSize()[0])
    before, count = operator.cycle(r), simulation.counters.factorisations
    operator.release()
    assert_array_equal(operator.cycle(r), before)
    assert simulation.counters.factorisations == count + 1


@pytest.mark.parametrize("mu", [*slow(1e-6), 0.1])
def test_bodies_that_slide_on_each_other_cost_two_linear_solves_a_step(mu: float) -> None:
    """Multigrid cycles; the meshes do not match, all points slip."""
    shape = "length=1.0, width=1.0, height=1.0, lower_length=2.0, mesh_size=0.17, lower_mesh_size=0.14"
    scene = read(
        "two_blocks",
        [
            *METHOD,
            "model=3d",
            f'geometry={{ builder = "two_blocks", {shape} }}',
            "supports.base.displacement={ x = 0.0, y = 0.0, z = 0.0 }",
            "supports.top.displacement={ x = [[0, 0], [1, 0.1]], y = 0.0, z = [[0, 0], [1, -0.02]] }",
            "steps={ end = 1.0, count = 2 }",
            f"contacts.joint.friction.mu={mu}",
        ],
    )
    simulation = prepare(scene, MPI.COMM_SELF)
    for step in simulation.steps():
        found = step.contacts["joint"]
        assert found.stick_area < 0.01 * found.contact_area
    solve = linear_reference(simulation.system, f"cg+{'boomeramg' if multigrid.HYPRE else 'gamg'}")
    (timing,) = solve.solvers.values()
    assert simulation.counters.linear_iterations <= 2 * 2 * timing.iterations


@pytest.mark.parametrize("n", [6, 12, *slow(24)])
def test_two_steps_cost_two_linear_solves_on_any_mesh(n: int) -> None:
    """Multigrid cycles; of a linear solve to 1e-8 as the price table counts them."""
    half = ["geometry.height=0.5", "contacts.base.friction.mu=0.15"]  # most points slip
    simulation, _ = ran(cube(f"geometry.mesh_size={1 / n}", *(half if n == 24 else [])))
    solve = linear_reference(simulation.system, f"cg+{'boomeramg' if multigrid.HYPRE else 'gamg'}")
    (timing,) = solve.solvers.values()
    assert simulation.counters.linear_iterations <= 2.5 * timing.iterations


@pytest.mark.parametrize("by", ["motion", "force"])
def test_a_step_like_the_one_before_begins_with_its_motion(by: str) -> None:
    """Under loads that grow in proportion, where all sticks."""
    drive = (
        ["supports.top.displacement={ x = [[0, 0], [1, 0.01]], y = 0.0, z = [[0, 0], [1, -0.05]] }"]
        if by == "motion"
        else [
            "supports={}",
            'loads.top={ boundary = "block.top", traction = [[[0, 0], [1, 1e-3]], 0.0, [[0, 0], [1, -0.05]]] }',
        ]
    )
    scene = cube("geometry.mesh_size=0.2", "contacts.base.friction.mu=10.0", *drive, "steps={ end = 1.0, count = 4 }")
    simulation = prepare(scene, MPI.COMM_SELF)
    iterations = [step.iterations for step in march(simulation)]
    assert iterations[0] > 10
    assert max(iterations[1:]) <= 3
    scale = by == "force"  # a cycle for the first load finds that of the tractions
    assert simulation.counters.linear_iterations == sum(iterations) + scale


def test_multigrid_follows_a_contact_that_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stickslip.solvers.methods.tangent_cg.SLOW", 0.0)
    more = ["geometry.contact_mesh_size=0.04", "geometry.order=1", "steps.count=6"]
    simulation = prepare(read("half_ball", [*METHOD, *more]), MPI.COMM_SELF)
    (*_, last) = simulation.steps()
    ready = ready_of(simulation)
    touching = np.count_nonzero(next(iter(last.contacts.values())).pressure > 0)
    assert touching > 20
    assert (1 - GROWN) * touching <= len(np.unique(ready.held // 3)) <= (1 + GROWN) * touching


def test_another_form_of_the_bodies_may_take_its_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    held: list[bool] = []
    fits = method_chain.fits

    def asked(system: System, form: Form) -> bool:
        if form == "condensed" and operators:
            held.append(bool(operators[-1]._multigrid))
        return fits(system, form)

    operators: list[TangentOperator] = []
    hold = TangentOperator.hold

    def made(self: TangentOperator, *arguments: Any) -> None:
        operators.append(self)
        hold(self, *arguments)

    monkeypatch.setattr(method_chain, "fits", asked)
    monkeypatch.setattr(TangentOperator, "hold", made)
    monkeypatch.setattr("stickslip.solvers.methods.tangent_cg.PATIENCE", 1)
    simulation, _ = ran(read("cube", ["output.error=false", "geometry.mesh_size=0.25", 'solver.surface="matrix-free"']))
    (switch,) = simulation.stepper.chain.switches
    assert (switch.before, switch.after) == ("tangent-cg (matrix-free)", "condensed-newton (condensed)")
    assert held == [False]
    assert not operators[-1]._multigrid


def test_gamg_stands_in_for_hypre(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = ran(cube("geometry.mesh_size=0.25"))[1]
    monkeypatch.setattr(multigrid, "HYPRE", False)
    assert_allclose(ran(cube("geometry.mesh_size=0.25"))[1], expected, rtol=0, atol=SAME * np.abs(expected).max())


def test_no_equilibrium_is_found_by_the_certificate(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    pushed = scene_of(
        base={"friction": {"law": "coulomb", "mu": 0.3}},
        supports={},
        loads={"top": {"boundary": "block.top", "traction": [0.0031, -0.01]}},
        solver={"method": "tangent-cg"},
    )
    with pytest.raises(NoEquilibriumError, match="cannot balance the loads"):
        list(simulation_of(pushed).steps())


def test_driven_obstacles_are_refused() -> None:
    sentence = refused(Cell("tangent-cg", more="driven"))
    assert sentence == "solver.method = tangent-cg: cannot move obstacles.other by a force; use condensed-newton"


def test_auto_goes_on_without_it_where_rows_depend_on_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = read("cube", ["geometry.mesh_size=0.25", *MATRIX_FREE])
    expected = ran(scene)

    def refuse(*_: object) -> ContactCoordinates:
        raise SolverError("the contact rows of a node are nearly the same")

    monkeypatch.setattr(ContactCoordinates, "of", refuse)
    found = ran(scene)
    assert_allclose(found[1], expected[1], rtol=0, atol=1e-5 * np.abs(expected[1]).max())
    (switch,) = found[0].stepper.chain.switches
    assert (switch.before, switch.after) == ("tangent-cg (matrix-free)", "surface-uzawa (matrix-free)")
    assert "nearly the same" in switch.because
    assert not expected[0].stepper.chain.switches


@pytest.mark.parametrize(
    "by", [*slow("motion"), "force"]
)  # by a force alone, the first step begins where nothing moves
def test_auto_goes_on_without_it_where_it_finds_no_numbers(by: str, monkeypatch: pytest.MonkeyPatch) -> None:
    push = ['loads.top={ boundary = "block.top", traction = [0.0, 0.0, -0.05] }', "steps={ end = 1.0, count = 1 }"]
    scene = read("cube", ["geometry.mesh_size=0.25", *MATRIX_FREE, *(["supports={}", *push] if by == "force" else [])])
    expected = ran(scene)
    direction, calls = Iteration._direction, list[None]()

    def once_none(self: Iteration, *arguments: Any) -> tuple[np.ndarray, np.ndarray]:
        calls.append(None)
        found = direction(self, *arguments)
        return (found[0] * np.nan, found[1] * np.nan) if len(calls) == 1 else found

    monkeypatch.setattr(Iteration, "_direction", once_none)
    found = ran(scene)
    assert_allclose(found[1], expected[1], rtol=0, atol=1e-5 * np.abs(expected[1]).max())
    (switch,) = found[0].stepper.chain.switches
    after = "surface-uzawa (matrix-free)" if by == "motion" else "condensed-newton (condensed)"  # the body floats
    assert (switch.before, switch.after) == ("tangent-cg (matrix-free)", after)
    assert "range of numbers" in switch.because


def test_its_residual_is_that_of_the_laws() -> None:
    """Not the error that it stops on, which is larger."""
    simulation = prepare(cube("geometry.mesh_size=0.25", "steps={ end = 1.0, count = 1 }"), MPI.COMM_SELF)
    (accepted,) = march(simulation)
    problem, state = accepted.problem, accepted.state
    assert accepted.residual == pytest.approx(problem.natural_residual(state.p, state.w), abs=1e-10)


def floating() -> Simulation:
    return prepare(Cell("tangent-cg", operator="mortar", model="3d", more="floating").scene(1e-9), MPI.COMM_SELF)


def test_coarse_motions_slide_the_sides_and_know_their_forces() -> None:
    ready = ready_of(floating())
    ready.make_coarse()
    operator, D, K_D = ready.operator, ready.coarse.D, ready.coarse.K_D
    assert len(D) > 2
    assert_allclose(D[:, operator.at] @ D[:, operator.at].T, np.eye(len(D)), atol=1e-12)
    for d, K_d in zip(D, K_D, strict=True):
        assert_allclose(K_d, operator.product(d), rtol=0, atol=1e-12 * np.abs(K_d).max())


def test_what_is_restored_was_counted_before() -> None:
    first, second = floating(), floating()
    before, after = ready_of(first), ready_of(second)
    before.make_coarse()
    after.restore(before.snapshot(), second.stepper.surface)
    assert_array_equal(after.coarse.D, before.coarse.D)
    assert first.counters.linear_iterations > 0
    assert second.counters.linear_iterations == 0


def test_a_body_that_floats_is_held_by_three_nodes() -> None:
    ready = ready_of(floating())
    count = len(ready.operator.at) // 3
    some = np.zeros((4, count), bool)
    some[1, :2], some[2, [0, 1, count - 1]], some[3] = True, True, True
    assert [ready.resists(nodes) for nodes in some] == [False, False, True, True]


def test_a_solver_apart_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    solve, asked = Iteration.solve, list[Iteration]()

    def kept(self: Iteration, *arguments: Any) -> Any:
        asked.append(self)
        return solve(self, *arguments)

    monkeypatch.setattr(Iteration, "solve", kept)
    simulation, _ = ran(cube("geometry.mesh_size=0.25", "contacts.base.friction.mu=0.05"))
    ready, problem, u = ready_of(simulation), asked[-1].problem, simulation.stepper.start().u
    before = serialise(ready.snapshot(), lambda own: own.values)
    assert ready.apart(u, 1e-3)(problem, np.zeros(len(problem.gap)), lambda step: None).history
    assert_equal(serialise(ready.snapshot(), lambda own: own.values), before)


@pytest.mark.parametrize(
    "supports", ["{}", '{ end = { boundary = "block.right", displacement = { x = 0.0, y = 0.0 } } }']
)
def test_a_complete_release_leaves_nothing(supports: str) -> None:
    scene = read(
        "block",
        [
            *METHOD,
            "geometry.mesh_size=0.25",
            "geometry.contact_mesh_size=0.25",
            f"supports={supports}",
            'loads={ top = { boundary = "block.top", pressure = [[0, 0], [1, 1e-3], [2, 0]] } }',
            "steps={ end = 2.0, count = 2 }",
        ],
    )
    pressed, released = prepare(scene, MPI.COMM_SELF).steps()
    assert pressed.contacts["base"].contact_area > 0
    assert released.contacts["base"].normal_force < 1e-9 * pressed.contacts["base"].normal_force
    assert np.abs(released.stress).max() < 1e-8 * np.abs(pressed.stress).max()
    assert (released.contacts["base"].contact_area, released.substeps) == (0.0, 1)


ILUS = [ILU(), ILU(relaxation=0.9), ILU(relaxation=1.0), ILU(shift=1e-2), ILU(levels=1)]


@pytest.fixture(scope="module")
def solved_by_tangents() -> tuple[SlipTangent, CondensedSurface]:
    """The block dragged until a part slips, and its bodies."""
    simulation, accepted, status = contact.march(contact.scene(2, 6, drag=0.07, method="perturbed-lagrangian"))
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


def test_slip_counts_from_touch_while_bodies_are_solved() -> None:
    """Where points touch, and where their slip turns, is found on the way: it costs less than a second solution."""
    sizes = ("geometry.mesh_size=0.56", "geometry.contact_mesh_size=0.056", "geometry.lower_mesh_size=0.4")

    def steps(method: str, surface: str) -> list[tuple[int, float, float]]:
        asked = (f"solver.method={method}", f"solver.surface={surface}", "steps.count=2")
        each = prepare(read("spheres", [*sizes, *asked])).steps()
        return [(x.iterations, x.contacts["pole"].dissipation, x.contacts["pole"].max_slip) for x in each]

    found, exact = steps("tangent-cg", "matrix-free"), steps("condensed-newton", "condensed")
    assert_allclose([x[1:] for x in found], [x[1:] for x in exact], rtol=1e-6)
    assert max(x[0] for x in found) <= 50


def test_the_condition_number_is_that_of_the_one_norm() -> None:
    A = upwind(4)
    assert condition(A) == pytest.approx(np.linalg.cond(A.toarray(), 1), rel=0.1)  # an estimate, rarely far below


def test_condensed_it_is_the_tangent_of_the_method(solved_by_tangents: tuple[SlipTangent, CondensedSurface]) -> None:
    """Schur complements on the contact dofs: (K^-1)_cc^-1 = S + N^T Σ*' N."""
    tangent, surface = solved_by_tangents
    K = tangent.of_displacements[0].toarray()
    contact = np.unique(tangent.N.tocoo().col)
    inverse = np.linalg.inv(K)[np.ix_(contact, contact)]
    expected = surface.S + (surface.N.T @ tangent.slope @ surface.N).toarray()
    assert_allclose(np.linalg.inv(inverse), expected, atol=1e-8 * np.abs(expected).max())


def test_displacements_are_the_same_with_forces_too(solved_by_tangents: tuple[SlipTangent, CondensedSurface]) -> None:
    (K, f), (whole, g) = solved_by_tangents[0].of_displacements, solved_by_tangents[0].of_both
    u = mumps(K, f).x
    assert np.abs(u).max() > 0
    assert_allclose(mumps(whole, g).x[: len(u)], u, atol=1e-10 * np.abs(u).max())


def test_it_is_unsymmetric_where_something_slides(solved_by_tangents: tuple[SlipTangent, CondensedSurface]) -> None:
    assert 0 < solved_by_tangents[0].share(SLIP) < 1
    assert unsymmetry(solved_by_tangents[0].of_displacements[0]) > 0.01
    assert unsymmetry(solved_by_tangents[0].K_B) < 1e-14
