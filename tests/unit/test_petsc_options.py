"""solver.petsc_options: what a user gives PETSc reaches the solvers of that simulation, and no others."""

import logging
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from petsc4py import PETSc

from shared.cases import slow
from shared.cells import Cell
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.stepper import StepError
from stickslip.workflows.lab.verification.prepared import prepare

CG = "-fieldsplit_u_ksp_type cg -fieldsplit_u_pc_type gamg"
SCHUR = (
    "-ksp_type fgmres -pc_type fieldsplit -pc_fieldsplit_type schur -pc_fieldsplit_schur_precondition selfp "
    "-fieldsplit_u_ksp_type preonly -fieldsplit_u_pc_type cholesky "
    "-fieldsplit_lambda_ksp_type gmres -fieldsplit_lambda_pc_type lu"
)


PLAIN = Cell("block-uzawa")


def scene(options: str = "", tolerance: float = 1e-9, cell: Cell = PLAIN, **keys: Any) -> Scene:
    made = cell.scene(tolerance)
    return replace(made, solver=replace(made.solver, petsc_options=options, **keys))


def solved(made: Scene) -> tuple[Simulation, list[StepResult]]:
    simulation = prepare(made)
    return simulation, list(simulation.steps())


@pytest.mark.parametrize("options", [*slow("-fieldsplit_u_pc_type gamg"), "-fieldsplit_u_pc_type jacobi"])
def test_a_preconditioner_alone_is_used_inside_conjugate_gradients(options: str) -> None:
    """As if it were a solver, each solve would be one cycle of it, and the answer wrong by tens of per cents."""
    (simulation, found), (_, expected) = solved(scene(options)), solved(scene())
    assert simulation.counters.linear_iterations > simulation.counters.volume_solves
    assert_allclose(found[-1].p, expected[-1].p, atol=1e-6 * np.abs(expected[-1].p).max())


def test_a_preconditioner_alone_is_used_inside_gmres_on_the_nest() -> None:
    found, expected = solved(scene(SCHUR.removeprefix("-ksp_type fgmres "), outer="ksp"))[1], solved(scene())[1]
    assert_allclose(found[-1].p, expected[-1].p, atol=1e-6 * np.abs(expected[-1].p).max())


def test_options_belong_to_the_simulation_that_they_were_given_to() -> None:
    """Also where another one is prepared in between."""
    first = prepare(scene(CG))
    second = prepare(scene())
    list(first.steps())
    list(second.steps())
    assert first.counters.linear_iterations > 0
    assert second.counters.linear_iterations == 0
    assert not [name for name in PETSc.Options().getAll() if name.startswith("block_")]


def test_options_of_a_sliding_contact_are_not_called_unused(caplog: pytest.LogCaptureFixture) -> None:
    """Each search makes new blocks, with the solver of the bodies as it was."""
    with caplog.at_level(logging.WARNING):
        solved(scene(CG + " -foo", cell=Cell("block-uzawa", more="sliding")))
    assert [record.getMessage() for record in caplog.records] == [
        "solver.petsc_options: PETSc does not use -foo with outer = uzawa"
    ]


def test_an_inner_solver_that_is_not_exact_states_its_error() -> None:
    def stated(options: str, **keys: Any) -> float:
        return max(step.linear_error for step in solved(scene(options, 1e-6, **keys))[1])

    assert stated("") == stated("", outer="ksp") == 0.0
    loose = f"{CG} -fieldsplit_u_ksp_rtol"
    assert 1e-13 < stated(f"{loose} 1e-8") < 1e-6
    assert stated(f"{loose} 1e-12") < 1e-3 * stated(f"{loose} 1e-8")
    rough = SCHUR.replace("preonly -fieldsplit_u_pc_type cholesky", "cg -fieldsplit_u_pc_type gamg")
    assert 1e-14 < stated(f"{rough} -fieldsplit_u_ksp_rtol 1e-5 -ksp_rtol 1e-8", outer="ksp") < 1e-5


def test_a_ksp_that_does_not_converge_is_named_as_such(caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(StepError), caplog.at_level(logging.WARNING):
        solved(scene(f"{SCHUR} -ksp_max_it 1 -fieldsplit_lambda_pc_type none", outer="ksp"))
    assert "fgmres with fieldsplit ended with DIVERGED" in caplog.records[0].getMessage()


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"petsc_options": "fieldsplit"}, "petsc_options = fieldsplit: is not an option; write for example"),
        ({"petsc_options": '-a "b'}, "No closing quotation"),
        ({"petsc_options": "-fieldsplit_u_pc_type nonsense"}, "PETSc refuses it"),
        ({"petsc_options": "-ksp_type nonsense", "outer": "ksp"}, "PETSc refuses it"),
        ({"outer": "ksp", "alpha": 1.0}, 'solver.alpha = 1.0: .* use outer = "uzawa"'),
        ({"outer": "ksp", "rates": True}, 'solver.rates = True: .* use outer = "uzawa"'),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line_before_anything_is_solved(keys: dict[str, Any], words: str) -> None:
    made = Cell("block-uzawa").scene(1e-8)
    with pytest.raises(SceneError, match=words) as refused:
        make_plan(replace(made, solver=replace(made.solver, **keys)))
    assert "\n" not in str(refused.value)
