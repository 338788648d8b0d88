"""The block system: its blocks are what the condensed methods condense, and Uzawa's step size has a sharp bound."""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import every_nth, often
from shared.cells import Cell
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError
from stickslip.solvers.classical.block_system import BlockSystem
from stickslip.solvers.classical.block_uzawa import OnBlocks
from stickslip.solvers.interface.prepare import condensed, uncondensed
from stickslip.solvers.iteration import Status
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.stepper import StepError
from stickslip.workflows.lab.verification.prepared import prepare

CELLS = [
    Cell("block-uzawa"),
    Cell("block-uzawa", more="order 2"),
    Cell("block-uzawa", more="tensor"),
    Cell("block-uzawa", more="k_T"),
    Cell("block-uzawa", normal="bilateral", friction="tresca"),
    Cell("block-uzawa", normal="tied", friction=None),
    Cell("block-uzawa", normal="compliance", friction="compliance"),
    Cell("block-uzawa", model="axisymmetric"),
    Cell("block-uzawa", model="axisymmetric", more="order 2"),
    Cell("block-uzawa", model="3d"),
    Cell("block-uzawa", model="3d", more="order 2"),
    Cell("block-uzawa", model="3d", more="tensor"),
    Cell("block-uzawa", operator="mortar"),
    Cell("block-uzawa", operator="mortar", more="k_T"),
    Cell("block-uzawa", operator="node-to-segment"),
    Cell("block-uzawa", operator="mortar", normal="compliance", friction="stick"),
    Cell("block-uzawa", operator="node-to-face", model="3d"),
]
SEEN = [cell for cell in CELLS if not (cell.more and cell.model != "plane strain")]  # each feature once
TOLERANCE = 1e-10
ROUNDING = 1e-13  # relative to the largest entry


@lru_cache
def solved_by(cell: Cell) -> Simulation:
    """The cell's scene, prepared by this method and by the condensed one."""
    return prepare(cell.scene(TOLERANCE))


@lru_cache
def reference(cell: Cell) -> Simulation:
    return prepare(replace(cell, method="condensed-newton").scene(TOLERANCE))


def blocks_of(simulation: Simulation) -> BlockSystem:
    ready = simulation.stepper.chain._ready[simulation.stepper.chain.stage]
    assert isinstance(ready, OnBlocks)
    return ready.blocks


def dense(matrix: Any) -> Array:
    """A PETSc matrix of one rank, as an array."""
    from petsc4py import PETSc

    found = matrix.convert("dense", PETSc.Mat())  # named: petsc4py's array does not keep its matrix alive
    return np.array(found.getDenseArray())


def with_solver(scene: Scene, **keys: Any) -> Scene:
    return replace(scene, solver=replace(scene.solver, **keys))


@pytest.mark.parametrize("cell", often(CELLS, SEEN), ids=str)
def test_the_blocks_are_what_the_condensed_methods_condense(cell: Cell) -> None:
    blocks, surface = blocks_of(solved_by(cell)), condensed(reference(cell).stepper.surface)
    B, C, K = dense(blocks.B), dense(blocks.C), dense(blocks.system.K_B)
    rows, contact = blocks.multipliers.rows, blocks.system.interface.dofs
    expected = surface.N.toarray()[rows] * surface.W[rows, None]  # B = W N
    assert_allclose(B[:, contact], expected, atol=ROUNDING * np.abs(expected).max())
    assert not np.delete(B, contact, axis=1).any()
    softness = blocks.cone.softness[rows] * surface.W[rows]
    assert_allclose(C, np.diag(softness), atol=ROUNDING * max(softness.max(), 1e-300))
    assert (softness.max() > 0) == (cell.more == "k_T")
    inner = np.setdiff1d(np.arange(len(K)), contact)
    S = K[np.ix_(contact, contact)] - K[np.ix_(contact, inner)] @ np.linalg.solve(
        K[np.ix_(inner, inner)], K[np.ix_(inner, contact)]
    )
    assert_allclose(S, surface.S, atol=1e-11 * np.abs(surface.S).max())


@pytest.mark.parametrize("cell", [Cell("block-uzawa"), Cell("block-uzawa", operator="mortar", more="k_T")], ids=str)
def test_the_nest_has_the_four_blocks(cell: Cell) -> None:
    blocks = blocks_of(solved_by(cell))
    q = blocks.system.T.createVecRight()
    nest, K = blocks.nest(q), dense(blocks.system.K_B)
    B, C = dense(blocks.B), dense(blocks.C)
    assert nest.getType() == "nest"
    assert_allclose(dense(nest.convert("aij", type(nest)())), np.block([[K, B.T], [B, -C]]))


@pytest.mark.parametrize(
    "cell",
    [
        Cell("block-uzawa", normal="compliance"),
        Cell("block-uzawa", normal="compliance", model="3d"),
        Cell("block-uzawa", normal="compliance", model="axisymmetric"),
        Cell("block-uzawa", normal="compliance", operator="mortar"),
    ],
    ids=str,
)
def test_the_tangent_is_the_derivative_of_F(cell: Cell) -> None:
    """Central differences; at a random displacement some points touch and some do not."""
    simulation = solved_by(cell)
    for _ in simulation.steps():
        break  # the data of a step
    inner, q = blocks_of(simulation).inner, blocks_of(simulation).system.T.createVecRight()
    random = np.random.default_rng(5)
    q.array[:] = 0.05 * random.normal(size=q.getLocalSize())
    direction = q.duplicate()
    direction.array[:] = random.normal(size=q.getLocalSize())
    step = 1e-6
    expected = (inner.F(q + step * direction) - inner.F(q - step * direction)) / (2 * step)
    found = inner.tangent(q) * direction
    curved = found - inner.K * direction
    assert curved.norm() > 1e-2 * found.norm()  # j_n takes part
    assert (found - expected).norm() < 1e-7 * found.norm()  # m_n = 2: differences are exact but for kinks and rounding


def glued(alpha: float) -> Scene:
    """Every point is closed and sticks: a linear problem, in which nothing is projected."""
    scene = Cell("block-uzawa", normal="bilateral", friction="stick").scene(1e-6)
    return with_solver(scene, preconditioner="mass", alpha=alpha, max_iterations=6000)


@lru_cache
def exact_lambda_1() -> float:
    simulation = prepare(with_solver(glued(1.0), method="condensed-newton", preconditioner="gram", alpha=None))
    surface = condensed(simulation.stepper.surface)
    B = surface.N.toarray() * surface.W[:, None]
    on = simulation.stepper.cone.carrying
    delassus = (B @ surface.flexibility @ B.T / np.sqrt(np.outer(surface.W, surface.W)))[np.ix_(on, on)]
    return float(np.linalg.eigvalsh(delassus)[-1])


def test_alpha_below_two_over_lambda_1_converges() -> None:
    (first, *_) = prepare(glued(0.99 * 2 / exact_lambda_1())).steps()
    assert first.residual <= 1e-6
    assert first.substeps == 1


def test_alpha_above_two_over_lambda_1_diverges(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stickslip.solvers.stepping.halving.HALVINGS", 0)
    with pytest.raises(StepError) as failed:
        next(iter(prepare(glued(1.01 * 2 / exact_lambda_1())).steps()))
    residuals = [row.step.residual for row in failed.value.history if row.time == 1.0]
    assert residuals[-1] > 10 * min(residuals)  # it grows


def test_lambda_1_is_measured_to_a_per_cent() -> None:
    scene = with_solver(glued(1.0), alpha=None)
    (first, *_) = prepare(scene).steps()
    assert first.convergence is not None
    assert first.convergence.lambda_1 == pytest.approx(exact_lambda_1(), rel=0.01)
    assert first.convergence.alpha == pytest.approx(1.5 / first.convergence.lambda_1)


def test_the_theorem_bounds_what_happens() -> None:
    """Without projection the residual falls, at the end, by the factor max |1 - alpha lambda_i|."""
    (first, *_) = prepare(with_solver(glued(1.0), alpha=None, rates=True, tolerance=1e-12)).steps()
    theory = first.convergence
    assert theory is not None
    assert theory.bound is not None
    assert theory.observed is not None
    assert theory.bound - 0.2 * (1 - theory.bound) < theory.observed < theory.bound + 1e-3  # and not by far
    assert theory.residuals == tuple(row.residual for row in first.history)


def answers(scene: Scene) -> Iterator[tuple[Array, Array, int]]:
    for step in prepare(scene).steps():
        yield step.p, step.displacement, step.iterations


VARIANTS: dict[str, dict[str, Any]] = {
    "mass": {"preconditioner": "mass"},
    "inexact": {"inner_solves": "inexact"},
    "inexact, by the inner residual": {"inner_solves": "inexact", "inner_rule": "bramble-pasciak-vassilev"},
    "mass, inexact": {"preconditioner": "mass", "inner_solves": "inexact"},
    "nest": {"outer": "ksp"},
    "nest, fieldsplit": {
        "outer": "ksp",
        "petsc_options": "-ksp_type fgmres -pc_type fieldsplit -pc_fieldsplit_type schur "
        "-pc_fieldsplit_schur_precondition selfp -fieldsplit_u_ksp_type preonly -fieldsplit_u_pc_type cholesky "
        "-fieldsplit_lambda_ksp_type gmres -fieldsplit_lambda_pc_type lu",
    },
    "own inner solver": {"petsc_options": "-fieldsplit_u_ksp_type cg -fieldsplit_u_pc_type gamg"},
    "given friction": {"friction_update": "outer"},
}


@pytest.mark.parametrize(
    ("cell", "variant"), every_nth(2, [Cell("block-uzawa"), Cell("block-uzawa", normal="compliance")], VARIANTS)
)
def test_every_variant_finds_the_answer(cell: Cell, variant: str) -> None:
    expected = answers(replace(cell, method="condensed-newton").scene(TOLERANCE))
    found = answers(with_solver(cell.scene(TOLERANCE), **VARIANTS[variant]))
    for (p, u, _), (p_ref, u_ref, _) in zip(found, expected, strict=True):
        assert_allclose(p, p_ref, atol=1e-7 * np.abs(p_ref).max())
        assert_allclose(u, u_ref, atol=1e-8 * np.abs(u_ref).max())


@pytest.mark.parametrize("variant", ["exact", "inexact", "nest"])
def test_a_scene_without_contact_is_solved_too(variant: str) -> None:
    scene = Cell("block-uzawa").scene(TOLERANCE)
    alone = replace(scene, contacts={}, obstacles={})
    expected = answers(with_solver(alone, method="condensed-newton"))
    for (_, u, _), (_, u_ref, _) in zip(
        answers(with_solver(alone, **VARIANTS.get(variant, {}))), expected, strict=True
    ):
        assert_allclose(u, u_ref, atol=1e-11 * np.abs(u_ref).max())


@pytest.mark.parametrize(("variant", "c_n"), every_nth(2, ["exact", "inexact"], [1e12, 1e15]))
def test_a_body_far_above_its_compliant_face_is_pressed_onto_it(variant: str, c_n: float) -> None:
    """Its stiffness is singular until it touches, and a residual is rounding of K u long before it is small."""
    from stickslip.workflows.scene_file.read import read

    words = ["geometry.mesh_size=0.5", "contacts.base.gap_offset=0.1", "steps.count=2"]
    scene = with_solver(read("foundation", [*words, f"contacts.base.normal.c_n={c_n}"]), tolerance=1e-9)
    expected = answers(with_solver(scene, method="condensed-newton"))
    found = answers(with_solver(scene, method="block-uzawa", **VARIANTS.get(variant, {})))
    for (p, u, _), (p_ref, u_ref, _) in zip(found, expected, strict=True):
        assert_allclose(p, p_ref, atol=1e-6 * np.abs(p_ref).max())
        assert_allclose(u, u_ref, atol=1e-8 * np.abs(u_ref).max())


def test_the_nest_knows_the_displacement_of_a_step_that_needs_no_iteration() -> None:
    """The tractions that the second step starts from, extrapolated, are its answer: all sticks, all loads double."""
    scene = Cell("block-uzawa", normal="bilateral", friction="stick", operator="mortar").scene(TOLERANCE)
    held = scene.supports | {
        "top": replace(scene.supports["top"], displacement={"x": ((2, 0.01),), "y": ((2, -0.02),)})
    }
    first, second = prepare(with_solver(replace(scene, supports=held), outer="ksp")).steps()
    assert second.iterations == 0
    assert_allclose(second.displacement, 2 * first.displacement, atol=1e-12)


def test_without_friction_another_answer_is_found() -> None:
    """So that the agreement above is no matter of course."""
    rough, smooth = (list(answers(Cell("block-uzawa", friction=f).scene(TOLERANCE)))[-1][1] for f in ("coulomb", None))
    assert np.abs(rough - smooth).max() > 1e-3 * np.abs(rough).max()


def test_the_splits_have_names_that_petsc_shows(capfd: pytest.CaptureFixture[str]) -> None:
    scene = with_solver(Cell("block-uzawa").scene(TOLERANCE), **VARIANTS["nest, fieldsplit"])
    options = f"{scene.solver.petsc_options} -ksp_view"
    next(iter(prepare(with_solver(scene, petsc_options=options)).steps()))
    shown = capfd.readouterr().out
    assert "(block_fieldsplit_u_)" in shown
    assert "(block_fieldsplit_lambda_)" in shown


def test_inner_solves_follow_the_outer_residual() -> None:
    """Inexact solves take fewer conjugate gradients than exact ones by the same solver."""

    def iterations(**keys: Any) -> int:
        scene = with_solver(Cell("block-uzawa", model="3d").scene(TOLERANCE), inner_solves="inexact", **keys)
        simulation = prepare(scene)
        list(simulation.steps())
        return simulation.counters.linear_iterations

    assert iterations(inner_tolerance=0.3) < 0.5 * iterations(inner_tolerance=1e-9)


def test_a_factor_counts_once_where_F_is_linear() -> None:
    simulation = prepare(Cell("block-uzawa").scene(TOLERANCE))
    steps = list(simulation.steps())
    counters = simulation.counters
    assert counters.factorisations == 1  # of K_B
    # for the displacement without contact, for the start, then one an iteration
    assert [step.volume_solves for step in steps] == [step.iterations + 2 for step in steps]
    assert counters.lanczos_applications > 0


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"surface": "condensed"}, "solver.surface = condensed: .* leave it out"),
        ({"alpha": 1.0}, 'alpha = 1.0: .* the step of Q = W; use preconditioner = "mass"'),
        ({"method": "uzawa", "inner_solves": "inexact"}, "inner_solves = inexact: .* use block-uzawa"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(keys: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words) as refused:
        make_plan(with_solver(Cell("block-uzawa").scene(TOLERANCE), **keys))
    assert "\n" not in str(refused.value)


def test_a_body_that_contact_alone_holds_is_refused_but_not_one_on_a_compliant_face() -> None:
    with pytest.raises(SceneError, match="needs bodies that their supports or compliant pressures hold"):
        make_plan(Cell("block-uzawa", more="floating").scene(TOLERANCE))
    from stickslip.workflows.scene_file.read import read

    make_plan(with_solver(read("foundation"), method="block-uzawa"))


def test_it_ends_by_name_when_the_iterations_run_out() -> None:
    scene = with_solver(Cell("block-uzawa").scene(TOLERANCE), max_iterations=3)
    with pytest.raises(StepError, match=Status.MAX_IT.value[:20]):
        list(prepare(scene).steps())


def test_the_surface_knows_the_displacement_that_belongs_to_the_tractions() -> None:
    """K u = f - B^T p after the last inner solve, (2.6)."""
    simulation = prepare(Cell("block-uzawa").scene(TOLERANCE))
    for _ in simulation.steps():
        pass
    blocks = blocks_of(simulation)
    state = simulation.reported.state if simulation.reported else None
    assert state is not None
    q = uncondensed(simulation.stepper.surface).q
    left = blocks.problem.load.f_q - blocks.forces(state.p) - blocks.system.K_B * q
    assert left.norm() < 1e-12 * blocks.forces(state.p).norm()
