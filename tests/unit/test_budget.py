"""Errors cost what their budget allows, and what is left out is said with its price."""

import time
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from shared.histories import Stop
from stickslip import prepare, read
from stickslip.solvers.accuracy import budget, histories, model_error
from stickslip.solvers.accuracy.budget import COARSER, PAIRS, TIME, Estimates
from stickslip.solvers.accuracy.histories import LOOSE, OtherHistory
from stickslip.solvers.interface.prepare import Form
from stickslip.solvers.parallel.counters import Clock, Row
from stickslip.solvers.results.step_result import Quantity, quantities
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.choice import Choice, Size, Stage
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch

LOST = Quantity("contacts", "base", "dissipation_total")
DEAR = Row(phase="iterate", part="", seconds=1000.0, calls=1, volume_solves=0)


def solved(*sets: str) -> tuple[Simulation, Estimates]:
    """A run of two steps, and its estimates to be found."""
    sizes = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25"]
    simulation = prepare(read("block", [*sizes, *sets]))
    return simulation, simulation.estimates([*simulation.steps()])


def test_what_the_budget_does_not_pay_for_is_lacking_with_its_price() -> None:
    simulation, estimates = solved("output.error_budget=0")
    before = simulation.counters.error_solves
    choice = estimates.choose()
    estimates.solve(choice)
    lost = estimates.errors[-1][LOST]
    assert simulation.counters.error_solves == before
    assert not choice.done
    assert lost.time_step is None
    assert lost.lacking["time_step"] == choice.prices[TIME] > 0
    assert lost.total > 0  # of what was found with the steps


@pytest.mark.parametrize(
    ("share", "factor", "done"), [(0.6, 2.0, {COARSER, TIME}), (0.2, 4.0, {COARSER, TIME}), (0.08, 4.0, {COARSER})]
)
def test_the_coarser_mesh_is_coarser_still_where_that_is_too_dear(
    share: float, factor: float, done: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run of an hour: a quarter of it for the coarser mesh, and a quarter for twice as many steps."""
    _, estimates = solved()
    monkeypatch.setattr(budget, "predicted", lambda size, stage=None: 9.0 * size.dofs * (2 + size.steps))
    hour = budget.predicted(estimates._size)
    monkeypatch.setattr(budget, "budget_of", lambda output, seconds: share * hour)
    choice = estimates.choose()
    assert (choice.factor, {COARSER, TIME} & {*choice.done}) == (factor, done)


@pytest.mark.parametrize("asked", ["output.error=full", "output.error_budget=inf", "output.error=rough"])
def test_no_clock_is_asked_where_the_budget_is_none(asked: str) -> None:
    simulation, estimates = solved(asked)
    choice = estimates.choose()
    assert {*choice.done} == ({COARSER} if "rough" in asked else {*choice.prices})
    simulation.clock.add([DEAR])
    assert estimates.choose() == choice


def test_pairs_that_are_left_have_a_price_and_their_error_is_lacking(monkeypatch: pytest.MonkeyPatch) -> None:
    _, estimates = solved("output.error_budget=0")
    monkeypatch.setattr("stickslip.solvers.accuracy.kept_pairs.leaves", lambda *given: True)
    choice = estimates.choose()
    estimates.solve(choice)
    assert 0.5 < choice.prices[PAIRS] < 1  # the same steps, and nothing to prepare
    assert estimates.errors[-1][LOST].lacking["geometry"] == choice.prices[PAIRS]


def test_the_model_is_judged_by_a_solution_at_turns_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of five steps to each turn it is not known of the others."""
    asked = list[float]()
    answer = model_error._answer
    monkeypatch.setattr(model_error, "_answer", lambda a, forces: asked.append(a.state.time) or answer(a, forces))
    simulation = prepare(read("block", ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25", "steps.count=10"]))
    steps = [*simulation.steps()]
    assert asked == [1.0, 2.0]
    assert [step.time for step in steps if step.errors[str(LOST)].model is not None] == asked


def test_a_run_that_is_stopped_says_what_its_errors_would_cost(tmp_path: Path) -> None:
    sizes = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25", "output.pictures=false"]
    outcome, result = run(read("block", sizes), tmp_path / "out", Watch(on_step=Stop(1)))
    told = result["steps"][0]["contacts"]["base"]["error"]["normal_force"]
    assert (outcome.status, told["mesh"]) == ("interrupted", None)
    assert told["lacking"]["mesh"] > 0
    assert told["lacking"]["time_step"] > 0


def test_order_2_has_the_cells_of_the_run_as_they_are() -> None:
    """As if they were meshed again, which takes longer than all else."""
    sizes = [f"geometry.{key}mesh_size={size}" for key, size in (("", 0.3), ("lower_", 0.4), ("contact_", 0.15))]
    simulation = prepare(read("two_blocks", [*sizes, "output.error=false", "probes.inside.point=[0.3, 0.2]"]))
    system, times = simulation.system, simulation.scene.requested_times()
    raised, again = OtherHistory.of_order(system, 2), OtherHistory.on(system, system.mesh.shape.of_order(2))
    assert raised.stepper.system.mesh.domain is system.mesh.domain
    for one, other in zip(raised(times), again(times), strict=True):
        found = quantities(one)
        for key, value in quantities(other).items():
            assert_allclose(found[key], value, rtol=1e-9, atol=1e-12, err_msg=str(key))


def test_a_busy_machine_makes_no_estimate_dearer() -> None:
    """Seconds that go by while processors work for others count for nothing."""
    clock = Clock()
    with clock.phase("iterate"):
        time.sleep(0.2)
    assert clock.seconds("iterate") > 0.15
    assert clock.worked("iterate") < 0.1
    clock.add([DEAR])
    assert clock.worked("iterate") >= DEAR.seconds


@pytest.mark.parametrize("form", ["condensed", "matrix-free"])
def test_order_2_is_solved_loosely_where_volume_solves_are_iterative(
    form: Form, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = prepare(read("cube", ["geometry.mesh_size=0.5", "output.error=false"]))
    exact = simulation.system.problem.solver.tolerance
    monkeypatch.setattr(histories, "choose", lambda system: Choice((Stage("surface-uzawa", form),), ""))
    better, coarser = OtherHistory.of_order(simulation.system, 2), OtherHistory.coarser(simulation.system, 2.0)
    assert better.stepper.system.problem.solver.tolerance == (LOOSE if form == "matrix-free" else exact)
    assert coarser.stepper.system.problem.solver.tolerance == exact


@pytest.mark.parametrize(("dim", "stage", "dofs", "follow"), [
    (2, Stage("condensed-newton", "condensed"), 47_000, False),  # order 2 takes a third as long
    (3, Stage("tangent-cg", "matrix-free"), 81_000, True),
])  # fmt: skip
def test_bubbles_follow_where_they_are_cheaper_than_better_cells(
    dim: int, stage: Stage, dofs: int, follow: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = prepare(read("block", ["geometry.mesh_size=0.5", "output.error=false"])).mesh
    monkeypatch.setattr(budget, "better_unknowns", lambda *mesh: 2.0**dim)
    size = Size(dim=dim, dofs=dofs, entries=80.0 * dofs, contact_dofs=1000, steps=16 if dim == 2 else 2)
    assert budget.bubbles_follow(Output(), size, stage, mesh, 1.0) == follow
