"""The cost of an accuracy: runs climb meshes, their errors are extrapolated, the cheapest is named."""

from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.problems import scene_of
from stickslip.geometry.errors import MachineError, SceneError, SolverError
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Exact
from stickslip.workflows.cost import ladder as climbing
from stickslip.workflows.cost import measure
from stickslip.workflows.cost.extrapolation import SAFETY, TRUSTED, limit, rate_of
from stickslip.workflows.cost.ladder import COARSEST, Budget, Ladder, climb, ladder_of, retry
from stickslip.workflows.cost.pictures import draw_methods
from stickslip.workflows.cost.progress import Teller, _of_steps
from stickslip.workflows.cost.run_record import PHASES, RATIO, Run, Rung, from_plain, with_estimates
from stickslip.workflows.cost.study import Study, Truth, check, chosen, front, truth_of
from stickslip.workflows.cost.tables import _quantity, comparison, explained, headline, lines, plain, sentence
from stickslip.workflows.scene_file.read import from_dict, read

TIGHT = 1e-8
ROOMY = Budget(seconds=60.0, memory=1e12, dim=2)


def made_up(
    rung: Rung, value: float = 1.0, seconds: float = 1.0, start: float = 1.0, share: float = 0.1, **more: Any
) -> Run:
    """A run of so many seconds, of which the iteration takes a share."""
    phases = dict.fromkeys(PHASES, 0.0) | {"mesh": (1 - share) * seconds, "iterate": share * seconds}
    told = {"status": "converged", "h": 0.1 * rung.factor, "spent": seconds + start, "residual": 1e-9, "memory": 1e8}
    return Run(rung=rung, phases=phases, quantities={"base.max_pressure": value}, **(told | more))


def converging(order: int, method: str = "newton", limit: float = 2.0, levels: range = range(-4, 4)) -> list[Run]:
    """Errors fall as h^order, work grows as h^-2."""
    rungs = [Rung(order, method, level, TIGHT) for level in levels]
    return [made_up(r, limit * (1 + 0.1 * r.factor**order), seconds=r.factor**-2) for r in rungs]


def study_of(runs: list[Run], exact: Exact | None = None) -> Study:
    truth = truth_of("base.max_pressure", runs, exact or Exact(), TIGHT)
    assert truth is not None
    return Study(truth, tuple(runs), TIGHT)


# --- limits


@pytest.mark.parametrize("rate", [0.7, 1.0, 1.5, 2.0, 3.0])
def test_limit_and_power_of_a_clean_sequence_are_found(rate: float) -> None:
    h = 0.3 * RATIO ** -np.arange(5.0)
    found = limit(h.tolist(), (5.0 - 2.0 * h**rate).tolist())
    assert found.rate == pytest.approx(rate, abs=1e-3)
    assert found.value == pytest.approx(5.0, abs=1e-6)
    assert found.uncertainty == pytest.approx(SAFETY * TRUSTED * 2.0 * h[-1] ** rate, rel=0.01)


def test_the_uncertainty_covers_noise_and_what_a_second_power_adds() -> None:
    """q = 1 + h + 3 h² is no single power: the limit is missed, by less than is admitted."""
    h = 0.2 * RATIO ** -np.arange(8.0)
    noise = np.array([1, -1, 1, 1, -1, 1, -1, 1]) * 1e-3
    for q, most in (((1 + h + 3 * h**2)[:6], 0.05), (1 + h**2 + noise, 0.02)):
        found = limit(h[: len(q)].tolist(), q.tolist())
        assert 0 < abs(found.value - 1.0) <= found.uncertainty < most


@pytest.mark.parametrize("astray", [0, 2, 4])
def test_a_mesh_on_which_something_went_wrong_does_not_count(astray: int) -> None:
    h = 0.2 * RATIO ** -np.arange(6.0)
    q = 1 + h**2
    q[astray] = 20.0
    found = limit(h.tolist(), q.tolist())
    assert abs(found.value - 1.0) <= found.uncertainty < 1e-3


@pytest.mark.parametrize("power", [-0.3, 0.0])
def test_a_quantity_that_grows_for_ever_has_no_limit(power: float) -> None:
    h = 0.2 * RATIO ** -np.arange(6.0)
    grows = np.log(1 / h) if power == 0 else h**power
    assert not limit(h.tolist(), grows.tolist()).converges


def test_few_meshes_are_admitted_to_say_little() -> None:
    assert limit([0.1], [3.0]).uncertainty == 3.0
    assert limit([0.2, 0.1], [3.5, 3.0]) == replace(limit([0.1], [3.0]), uncertainty=0.5)
    three = limit([0.4, 0.2, 0.1], [2 + 0.4, 2 + 0.2, 2 + 0.1])
    assert (three.value, three.uncertainty) == (pytest.approx(2.0), pytest.approx(0.15, rel=1e-3))  # 1.5 times .1


def test_a_quantity_that_is_exact_on_every_mesh_needs_no_extrapolation() -> None:
    found = limit([0.4, 0.2, 0.1], [7.0, 7.0 + 1e-12, 7.0], floor=1e-9)
    assert (found.value, found.uncertainty, found.rate) == (7.0, 1e-9, None)


def test_rate_is_the_slope_of_the_finest_meshes() -> None:
    h = [0.8, 0.4, 0.2, 0.1, 0.05]
    assert rate_of(h, [9.0, *(size**2 for size in h[1:])]) == pytest.approx(2.0)  # the coarsest does not count
    assert rate_of([0.2, 0.1], [0.2, 0.1]) is None  # two meshes always lie on a line
    assert rate_of([], []) is None


# --- truth


def test_the_surest_order_is_extrapolated_and_disagreement_is_admitted() -> None:
    runs = converging(1) + converging(2)
    truth = study_of(runs).truth
    assert_allclose(truth.value, 2.0, rtol=1e-8)
    apart = study_of(converging(1, limit=2.1) + converging(2)).truth
    admitted = SAFETY * TRUSTED * 0.1 * 2.1 * RATIO**-3  # by order 1, whose finest mesh is that of level 3
    assert apart.uncertainty == pytest.approx((0.1 - admitted) / 2.0, rel=1e-3)


def test_what_the_scene_knows_exactly_is_not_extrapolated() -> None:
    exact = Exact(values={"base.max_pressure": 1.9}, source="a book", accuracy=1e-3)
    study = study_of(converging(2), exact)
    assert (study.truth.value, study.truth.uncertainty) == (1.9, 1e-3)
    assert "a book" in study.truth.source
    assert study.errors[Rung(2, "newton", 0, TIGHT)] == pytest.approx(2.2 / 1.9 - 1)


def test_a_method_that_solves_other_laws_does_not_define_the_truth() -> None:
    other = [replace(run, law_error=1e-3) for run in converging(1, "regularised", limit=3.0)]
    assert_allclose(study_of(other + converging(1)).truth.value, 2.0, rtol=1e-6)


def test_a_sequence_that_grows_for_ever_is_hidden_neither_by_few_meshes_nor_by_an_order_that_settles() -> None:
    """One or two numbers of order 1 must not look surer."""
    grows = [made_up(Rung(2, "newton", level, TIGHT), 1.0 + 0.2 * level) for level in range(6)]
    few = [made_up(Rung(1, "newton", level - 4, TIGHT), 1.0 + 0.01 * level) for level in range(2)]
    for others in (few[:1], few, converging(1)):
        assert not study_of([*others, *grows]).truth.converges


def test_three_meshes_do_not_prove_growth_without_end() -> None:
    """Peak pressure of two cylinders: it falls by about as much from mesh to mesh, and settles at 9.37."""
    found = limit([0.2, 0.1, 0.05], [9.623, 9.531, 9.440])
    assert found.converges
    assert abs(found.value - 9.37) <= found.uncertainty < 0.5


def test_runs_that_contradict_the_exact_value_are_a_warning() -> None:
    wrong, right = (study_of(converging(2), Exact(values={"base.max_pressure": v})).truth for v in (1.9, 2.0))
    assert wrong.warning.startswith("warning: base.max_pressure settles at 2 ")
    assert not right.warning


def test_one_mesh_has_no_reference() -> None:
    study = study_of(converging(1, levels=range(1)))
    assert "one mesh only" in sentence(study)
    assert study.cheapest(1.0) is None


def test_an_accuracy_is_promised_only_beyond_doubt() -> None:
    """Error .9 %, reference sure to .7 %: nobody knows of 1 %."""
    exact = Exact(values={"base.max_pressure": 2.0}, accuracy=7e-3)
    runs = [made_up(Rung(1, "newton", 0, TIGHT), 2.018), made_up(Rung(1, "newton", 2, TIGHT), 2.004, seconds=9.0)]
    found = study_of(runs, exact).cheapest(1e-2)
    assert found.rung.level == 2


def test_an_error_of_nothing_is_on_the_front() -> None:
    runs = [made_up(Rung(1, "newton", level, TIGHT), 2.0, seconds=2.0**level) for level in range(4)]
    assert [run.rung.level for run in study_of(runs).front] == [0]


def test_errors_below_the_uncertainty_are_not_known() -> None:
    exact = Exact(values={"base.max_pressure": 2.0}, accuracy=0.04)
    runs = converging(2)
    study = study_of(runs, exact)
    assert [study.known(run.rung) for run in runs] == [0.1 * run.rung.factor**2 > 0.04 for run in runs]
    assert min(study.sturdy.values()) == 0.04


def test_observed_orders_are_those_of_the_sequences() -> None:
    rates = study_of(converging(1) + converging(2), Exact(values={"base.max_pressure": 2.0})).rates
    assert rates == {(1, "newton"): pytest.approx(1.0), (2, "newton"): pytest.approx(2.0)}


# --- the front


def test_the_front_is_what_a_search_over_all_pairs_finds() -> None:
    points = [tuple(p) for p in np.random.default_rng(1).integers(0, 12, (60, 2)).astype(float)]
    beaten = [any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in points) for p in points]
    best = {p for p, lost in zip(points, beaten, strict=True) if not lost}
    found = [points[i] for i in front(points)]
    assert found == sorted(best)


def test_a_lucky_crossing_is_no_accuracy() -> None:
    """A coarse mesh that hits the truth, while finer ones miss it by 3 %, has not earned its error."""
    rungs = [Rung(1, "newton", level, TIGHT) for level in range(4)]
    found = zip(rungs, (2.0, 2.06, 2.01, 2.01), (1.0, 2.0, 4.0, 8.0), strict=True)
    runs = [made_up(r, v, seconds=s) for r, v, s in found]
    study = study_of(runs, Exact(values={"base.max_pressure": 2.0}))
    assert study.sturdy[rungs[0]] == pytest.approx(0.03)
    assert study.sturdy[rungs[2]] == pytest.approx(0.015)  # h²: half of what the mesh before has
    assert study.cheapest(0.01) == runs[3]


@pytest.mark.parametrize("crossing", [2, 3, 4])
def test_the_next_digit_is_not_reached_where_the_error_changes_its_sign(crossing: int) -> None:
    """4 h - 4 h² at order 1 passes through zero, on the finest mesh or before it."""
    rungs = [Rung(1, "newton", level, TIGHT) for level in range(-4, crossing + 1)]
    zero = rungs[-1].factor if crossing < 4 else rungs[-2].factor
    runs = [made_up(r, 2 * (1 + 0.02 * (r.factor - r.factor**2 / zero)), seconds=r.factor**-2) for r in rungs]
    lucky = next(run for run in runs if run.rung.factor == zero)
    study = study_of(runs, Exact(values={"base.max_pressure": 2.0}))
    assert study.errors[lucky.rung] < 1e-12
    assert study.sure[lucky.rung] > 0.001
    assert study.cheapest(1e-3) is None


def test_what_the_time_steps_leave_is_part_of_the_error() -> None:
    runs = converging(2, levels=range(-4, 8))
    measured = [replace(run, time_steps={"base.max_pressure": 0.1}) if run.rung.level == 0 else run for run in runs]
    whole, without = study_of(measured), study_of(runs)
    assert whole.time_step == pytest.approx(0.05, rel=1e-3)
    finest = runs[-1].rung
    assert whole.sure[finest] == pytest.approx(without.sure[finest] + whole.time_step)
    assert whole.cheapest(0.01) is None
    assert without.cheapest(0.01) is not None
    assert "the time steps alone leave 5 %, it takes more of them (steps.count)" in sentence(whole)
    assert study_of(measured, Exact(values={"base.max_pressure": 2.0})).time_step == 0  # errors have it in them


# --- the sentence


def test_seconds_in_which_forms_were_compiled_are_no_price() -> None:
    runs = converging(1)
    plain = study_of(runs)
    cheapest, first = plain.cheapest(0.07), plain.front[0]
    compiled = study_of([replace(r, compiled=True) if r in (cheapest, first) else r for r in runs])
    assert compiled.errors == plain.errors  # the answers count
    assert not any(run.compiled for run in compiled.front)
    instead = compiled.cheapest(0.07)
    assert instead.seconds > cheapest.seconds


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (SolverError("conjugate gradients broke down"), "not_converged"),
        (MachineError("MUMPS failed with INFOG(1) = -9; -9 and -13 mean too little memory"), "out_of_memory"),
        (MachineError("PETSc error 76 in MatGetFactor"), "failed"),
        (MemoryError(), "out_of_memory"),
    ],
)
def test_a_child_tells_why(error: Exception, status: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(scene: Scene) -> None:
        raise error

    monkeypatch.setattr(measure, "prepare", fail)
    found = measure.solve(scene_of())
    assert found["status"] == status
    assert str(error) in found["sentence"]


def test_a_child_measures_the_time_steps_beside_its_seconds() -> None:
    sizes = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5", "output.error=false"]
    plain, measured = (measure.solve(read("block", sizes), errors=each) for each in (False, True))
    assert "time_steps" not in plain
    assert "estimate" not in plain
    assert 0 < measured["estimate"] < measured["lasted"]
    name = "base.dissipation_total"
    assert 0.05 < measured["time_steps"][name] / measured["quantities"][name] < 1.0  # one step of slip
    assert measured["quantities"] == plain["quantities"]
    assert measured["phases"]["error"] == 0.0
    assert measured["volume_solves"] == plain["volume_solves"]


def test_the_sentence_names_the_cheapest_run_of_each_digit() -> None:
    study = study_of(converging(1) + converging(2), Exact(values={"base.max_pressure": 2.0}))
    # .1 h² is 1 % at level 7 - which nobody ran - for order 1, and at level 3.3 for order 2
    assert sentence(study).startswith(
        "1 % of base.max_pressure was not reached: the best is 1.3 % for 8.0 s with order 2"
    )
    exact = Exact(values={"base.max_pressure": 2.0})
    finer = study_of(converging(1, levels=range(-4, 10)) + converging(2, levels=range(-4, 10)), exact)
    assert sentence(finer) == (
        "1 % of base.max_pressure costs 16 s with order 2, h = 0.025, newton; "
        "the next digit costs 128 s with h = 0.00884."
    )


def test_the_sentence_says_when_the_reference_is_not_sure_enough() -> None:
    exact = Exact(values={"base.max_pressure": 2.0}, accuracy=5e-3)
    said = sentence(study_of(converging(2, levels=range(0, 14)), exact))
    assert "the next digit was not reached: the reference itself is sure to 0.5 % only" in said


def test_the_sentence_says_what_has_no_limit() -> None:
    runs = [made_up(Rung(1, "newton", level, TIGHT), 1.0 + 0.2 * level) for level in range(6)]
    study = study_of(runs)
    assert "does not settle" in sentence(study)
    settled = study_of(converging(2, levels=range(-4, 10)))
    assert headline([study, settled]) == sentence(settled)  # the first that has one
    assert headline([]).startswith("No run")


# --- predictions


def test_seconds_are_predicted_by_the_power_of_the_finest_runs_and_are_no_longer_for_a_looser_tolerance() -> None:
    runs = converging(1)
    ahead = Rung(1, "newton", 6, TIGHT)
    # h^-2, and the second in which a process starts
    assert climbing.expected_seconds(ahead, runs, dim=2) == pytest.approx(ahead.factor**-2 + 1.0)
    assert climbing.expected_seconds(Rung(1, "newton", 3, 1e-2), runs, dim=2) == pytest.approx(runs[-1].seconds + 1.0)
    several = [replace(run, rung=replace(run.rung, tolerance=t)) for t in (1e-2, TIGHT) for run in runs[-1:]]
    assert climbing.expected_memory(Rung(1, "newton", 4, TIGHT), several, dim=2) == pytest.approx(1e8)  # on one mesh


def test_an_untried_chain_is_judged_by_its_neighbours_on_the_same_mesh() -> None:
    runs = [made_up(Rung(1, "newton", COARSEST, TIGHT), seconds=8.0)]
    assert climbing.expected_seconds(Rung(2, "newton", COARSEST, TIGHT), runs, dim=2) == 1.0 + climbing.ANOTHER * 8.0
    assert climbing.expected_seconds(Rung(1, "newton", COARSEST, TIGHT), [], dim=2) == climbing.START + climbing.UNTRIED


# --- the ladder, climbed by a solver whose time is known


def climbed(
    budget: Budget, ladder: Ladder, runs: list[Run] | None = None, **solver: Any
) -> tuple[list[Run], list[str]]:
    runs = [] if runs is None else runs

    def solve(rung: Rung, seconds: float) -> Run | None:
        run = made_up(rung, seconds=0.5 * rung.factor**-2 * rung.order, **solver)
        return run if run.spent <= seconds else Run(rung=rung, status="out_of_time", spent=seconds)

    whole, left_out = climb(ladder, runs, budget, solve, lambda run: None)
    assert whole
    return runs, left_out


def test_the_budget_is_kept_and_what_did_not_fit_is_said() -> None:
    runs, left_out = climbed(ROOMY, Ladder((1, 2), ("newton", "uzawa"), TIGHT))
    assert 30.0 < sum(run.spent for run in runs) <= 60.0
    assert len(left_out) == 4  # each chain ends somewhere
    assert all("would take" in line and "are left" in line for line in left_out)
    chains = {run.rung.chain for run in runs}
    assert chains == {(order, method) for order in (1, 2) for method in ("newton", "uzawa")}


def test_the_cheapest_run_comes_first() -> None:
    runs, _ = climbed(ROOMY, Ladder((1,), ("newton",), TIGHT))
    levels = [run.rung.level for run in runs]
    assert levels[0] == COARSEST
    assert levels == sorted(levels)
    # h^2 < 2 below level 2: starting takes longer than solving, and the strides are double
    assert {b - a for a, b in pairwise(levels) if b <= 2} == {2}
    assert {b - a for a, b in pairwise(levels) if a > 2} <= {1}


def test_looser_tolerances_are_tried_where_the_iteration_takes_the_time() -> None:
    ladder = Ladder((1,), ("newton",), TIGHT)
    assert {run.rung.tolerance for run in climbed(ROOMY, ladder, share=0.1)[0]} == {TIGHT}
    assert {run.rung.tolerance for run in climbed(ROOMY, ladder, share=0.5, residual=1e-3)[0]} == {1e-2, 1e-4, TIGHT}
    # a last iteration that jumps over all tolerances makes them one
    jumps = [run.rung.tolerance for run in climbed(ROOMY, ladder, share=0.5, residual=1e-12)[0]]
    assert sum(tolerance > TIGHT for tolerance in jumps) == 1


def test_a_mesh_beyond_the_memory_is_not_tried() -> None:
    small = replace(ROOMY, memory=0.9e8)
    runs, left_out = climbed(small, Ladder((1,), ("newton",), TIGHT))
    assert len(runs) == 1  # of the first run nothing is known
    assert "would not fit into the memory" in left_out[0]


def test_a_chain_ends_after_two_failures() -> None:
    runs, left_out = climbed(ROOMY, Ladder((1,), ("newton",), TIGHT), status="not_converged")
    assert (len(runs), left_out) == (2, [])


@pytest.mark.parametrize("status", ["out_of_time", "out_of_memory"])
def test_what_was_killed_is_not_followed_by_something_larger(status: str) -> None:
    killed = [made_up(Rung(1, "newton", COARSEST, TIGHT)), Run(rung=Rung(1, "newton", -2, TIGHT), status=status)]
    assert climbed(ROOMY, Ladder((1,), ("newton",), TIGHT), runs=list(killed)) == (killed, [])


def test_meshes_too_coarse_to_exist_do_not_end_a_chain() -> None:
    coarse = [Run(rung=Rung(1, "newton", level, TIGHT), status="refused") for level in (-4, -3, -2)]
    runs, _ = climbed(ROOMY, Ladder((1,), ("newton",), TIGHT), runs=list(coarse))
    assert any(run.converged for run in runs)


def test_a_run_that_was_cut_off_is_tried_again_only_with_more_time() -> None:
    late = Run(rung=Rung(1, "newton", 4, TIGHT), status="out_of_time", spent=30.0)
    done = [made_up(Rung(1, "newton", 3, TIGHT), seconds=29.0)]
    assert retry([*done, late], ROOMY) == [*done, late]
    assert retry([*done, late], replace(ROOMY, seconds=120.0)) == done
    assert climbing.MORE > 1


def test_a_run_survives_its_file() -> None:
    run = converging(2)[0]
    assert from_plain(asdict(run)) == run


# --- what is asked of a scene


def test_methods_that_cannot_solve_the_scene_are_left_out_with_the_reason() -> None:
    ladder, left_out = ladder_of(read("cylinders"))
    assert "condensed-newton" in ladder.methods
    assert "regularised" not in ladder.methods
    assert any("regularised" in line and "rigid obstacles" in line for line in left_out)
    named, _ = ladder_of(read("block", ["solver.method=uzawa"]))
    assert named.methods == ("uzawa",)


def test_a_geometry_without_a_mesh_size_is_refused(tmp_path: Path) -> None:
    square = "Point(1)={0,0,0,.2}; Point(2)={1,0,0,.2}; Point(3)={1,1,0,.2}; Point(4)={0,1,0,.2};\n"
    square += "Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,4}; Line(4)={4,1}; Line Loop(1)={1,2,3,4};\n"
    square += 'Plane Surface(1)={1}; Physical Surface("part")={1}; Physical Line("part.base")={1};\n'
    (tmp_path / "square.geo").write_text(square)
    plain = {
        "model": "plane strain",
        "geometry": {"file": "square.geo"},
        "bodies": {"part": {"E": 1.0, "nu": 0.3}},
        "supports": {"base": {"boundary": "part.base", "displacement": {"x": 0.0, "y": 0.0}}},
    }
    with pytest.raises(SceneError, match=r"geometry\.mesh_size: there is none to refine, missing; name one, in metres"):
        ladder_of(from_dict(plain, tmp_path))
    sized = from_dict(plain | {"geometry": {"file": "square.geo", "mesh_size": 0.3}}, tmp_path)
    assert sized.geometry.refined(0.5).mesh_size == 0.15


def test_every_size_of_a_builder_is_refined() -> None:
    fine = Rung(2, "uzawa", 2, 1e-4).scene(read("cylinders"))
    coarse = read("cylinders").geometry
    for key in ("mesh_size", "lower_mesh_size", "contact_mesh_size"):
        assert getattr(fine.geometry, key) == pytest.approx(getattr(coarse, key) / 2)
    assert (fine.geometry.order, fine.solver.method, fine.solver.tolerance) == (2, "uzawa", 1e-4)
    assert fine.geometry.radius == coarse.radius
    strip = read("strip").geometry
    assert strip.refined(0.5).layers == 2 * strip.layers


def test_a_wrong_quantity_is_refused_with_the_nearest_name() -> None:
    scene = read("block")
    with pytest.raises(SceneError, match=r"base\.norml_force: no such quantity; did you mean base\.normal_force\?"):
        check(["base.norml_force"], scene)
    check(["probe.corner.displacement.x", "energy.stored", "obstacle.foundation.force.y"], scene)


def test_the_usual_quantities_are_those_that_are_not_zero() -> None:
    scene = read("block")
    numbers = {"base.max_pressure": 2.0, "base.normal_force": 3.0, "base.tangential_force": 1e-17}
    run = replace(converging(1)[0], quantities=numbers)
    assert chosen([], scene, [run]) == ("base.max_pressure", "base.normal_force")
    assert chosen(["energy.stored"], scene, [run]) == ("energy.stored",)


def test_an_exact_value_of_nothing_is_refused() -> None:
    table = {"contacts": {"base": {"surface": "block.bottom", "against": "foundation"}}}
    with pytest.raises(SceneError, match=r"exact\.values = base\.norml_force: no such quantity; did you mean"):
        scene_of(**table, exact={"values": {"base.norml_force": 1.0}})
    assert scene_of(**table, exact={"values": {"base.normal_force": 1.0}}).exact.values == {"base.normal_force": 1.0}
    with pytest.raises(SceneError, match=r"exact\.accuracy = 2\.0: must lie between"):
        scene_of(**table, exact={"accuracy": 2.0})


NAME = "base.slip_area"
H = [0.4, 0.2, 0.1, 0.05, 0.025]


@pytest.mark.parametrize(
    ("values", "least"), [([0, 0, 0, 0.01, 0.03], 0.03), ([1, 1.2, 1, 1.2, 1], 0.1), ([1, 1, 1, 1, 1.2], 0.2)]
)
def test_values_that_differ_from_equal_ones_count(values: list[float], least: float) -> None:
    """Slip that only fine meshes show: that coarse ones agree on none of it does not make it a stray."""
    found = limit(H, values, floor=1e-8)
    assert found.uncertainty >= least


def test_the_finest_mesh_always_counts() -> None:
    """Whether it alone is right, no finer one says."""
    found = limit(H, [1.16, 1.04, 1.01, 1.0025, 20.0])
    assert found.value == 20.0
    assert found.uncertainty > 19.0
    coarser = limit(H, [1.16, 20.0, 1.01, 1.0025, 1.000625])
    assert abs(coarser.value - 1.0) <= coarser.uncertainty < 1e-3


def test_an_error_that_falls_on_the_finest_mesh_alone_has_a_rate() -> None:
    rate = rate_of(H, [1e-2, 1e-2, 1e-2, 1e-2, 1e-4])
    assert rate > 1.0


def doubted(time_steps: dict[str, float], exact: bool = False, error: float = 1e-3) -> Study:
    truth = Truth(NAME, 2.0, 1e-4, "a book", 2.0, exact=exact)
    phases = dict.fromkeys(PHASES, 1.0)
    told = {"status": "converged", "h": 0.1, "phases": phases, "quantities": {NAME: 2.0 * (1 + error)}}
    run = Run(rung=Rung(1, "newton", 0, 1e-8), time_steps=time_steps, **told)
    return Study(truth, (run, replace(run, rung=Rung(1, "newton", 1, 1e-8), time_steps={})), 1e-8)


@pytest.mark.parametrize("error", [1e-3, 1e-5, 0.1])
def test_an_error_of_the_time_steps_that_nobody_measured_is_not_0(error: float) -> None:
    said = "the error of the time steps is not known"
    unknown = doubted({}, error=error)
    assert unknown.time_step is None
    assert _quantity(unknown)["time_step"] is None
    assert sentence(unknown).endswith(f"; {said}.")
    assert _of_steps(unknown) == "-"
    for known, shown in ((doubted({NAME: 0.0}, error=error), "0 %"), (doubted({NAME: 2e-4}, error=error), "0.01 %")):
        assert known.time_step == pytest.approx(known.runs[0].time_steps[NAME] / 2.0)
        assert said not in sentence(known)
        assert _of_steps(known) == shown
    exact = doubted({}, exact=True, error=error)
    assert exact.time_step == 0
    assert said not in sentence(exact)


def test_a_user_waits_for_the_start_and_the_estimate_too() -> None:
    coarse, fine, late = (made_up(Rung(1, "newton", level, TIGHT), seconds=20.0) for level in (-1, 0, 1))
    known = [
        replace(coarse, start=2.0, estimate=40.0),
        replace(fine, start=2.0, estimate=5.0),
        replace(late, start=2.0),
    ]
    assert [run.waited for run in with_estimates(known)] == [62.0, 27.0, 27.0]  # as beside the finest
    dear = [replace(fine, estimate=60.0), late]
    assert with_estimates(dear)[1].estimate == 20.0  # no more than its budget, as long as the run
    assert with_estimates([late]) == [late]  # nothing is known of it
    study = study_of([replace(run, start=3.0) for run in converging(1)])
    assert [run.waited for run in study.front] == [run.seconds + 3.0 for run in study.front]


def test_the_front_is_explained_in_words() -> None:
    runs = [replace(run, start=1.0) for run in converging(1) + converging(2)]
    said = explained(study_of(runs))
    for words in (
        "order 1 with newton (",
        "then order 2 with newton (",
        "A tenth of the error costs ",
        "larger --budget",
    ):
        assert words in said
    first = study_of(runs).front[0]
    assert f"start and estimate of errors are {100 / first.waited:.0f} %" in said
    steps = [replace(run, time_steps={"base.max_pressure": 0.1} if run.rung.level <= 0 else {}) for run in runs]
    assert "which the time steps leave" in explained(study_of(steps))
    assert explained(study_of(runs[:2])) == ""


BOTH = ("newton", "uzawa")


def rung(method: str, level: int = 0, order: int = 1, tolerance: float = TIGHT) -> Rung:
    return Rung(order, method, level, tolerance)


def climbed_together(ladder: Ladder, slow: float, seconds: float = 200.0) -> list[Run]:
    """Runs by a solver whose `uzawa` takes so many times as long as its `newton`."""
    runs: list[Run] = []

    def solve(each: Rung, left: float) -> Run:
        return made_up(each, seconds=0.3 * each.factor**-2 * (slow if each.method == "uzawa" else 1.0))

    climb(ladder, runs, Budget(seconds=seconds, memory=1e12, dim=2), solve, lambda run: None)
    return runs


def levels(runs: list[Run], method: str) -> list[int]:
    return [run.rung.level for run in runs if run.rung.method == method and run.rung.tolerance == TIGHT]


@pytest.mark.parametrize("slow", [1.0, 7.0, 40.0])
def test_methods_side_by_side_are_on_the_same_meshes(slow: float) -> None:
    runs = climbed_together(Ladder((1,), BOTH, TIGHT, together=True), slow)
    quick, late = levels(runs, "newton"), levels(runs, "uzawa")
    assert len(late) >= 3
    assert late == quick[: len(late)]  # the slow one is the first that no longer fits
    for line in lines(runs, BOTH, TIGHT)[: len(late)]:
        assert all(line.runs)


def test_methods_climb_by_themselves_without_the_option_and_none_waits_for_one_that_does_not_fit() -> None:
    """Strides of each are its own: a slow method leaves no coarse mesh out, a fast one does."""
    alone = climbed_together(Ladder((1,), BOTH, TIGHT), 7.0)
    assert levels(alone, "uzawa")[:4] != levels(alone, "newton")[:4]
    runs = climbed_together(Ladder((1,), BOTH, TIGHT, together=True), 40.0)
    assert len(levels(runs, "newton")) > len(levels(runs, "uzawa"))


def test_a_mesh_is_finished_before_the_next_one() -> None:
    order = [run.rung.level for run in climbed_together(Ladder((1, 2), BOTH, TIGHT, together=True), 7.0, 60.0)]
    fitting = order[: order.index(max(order))]
    assert fitting == sorted(fitting)


def test_named_methods_are_taken_whatever_the_scene_names() -> None:
    scene = read("block", ["solver.method=surface-uzawa"])
    ladder, _ = ladder_of(scene, ["block-uzawa", "condensed-newton", "block-uzawa"])
    assert (ladder.methods, ladder.together) == (("block-uzawa", "condensed-newton"), True)
    alone, _ = ladder_of(scene)
    assert (alone.methods, alone.together) == (("surface-uzawa",), False)
    contending, _ = ladder_of(read("block"))
    assert "block-uzawa" not in contending.methods


def test_a_wrong_name_or_a_method_that_cannot_solve_the_scene_is_refused() -> None:
    with pytest.raises(SceneError, match=r"^--methods block-uzava: no such method; did you mean block-uzawa\?$"):
        ladder_of(read("block"), ["uzawa", "block-uzava"])
    with pytest.raises(SceneError, match=r"^--methods regularised: .*works with rigid obstacles only"):
        ladder_of(read("cylinders"), ["condensed-newton", "regularised"])


def test_one_method_is_laid_beside_itself_with_other_keys() -> None:
    inexact = "block-uzawa+preconditioner=mass+inner_solves=inexact+inner_tolerance=0.1"
    ladder, _ = ladder_of(read("block"), ["block-uzawa", inexact])
    assert ladder.methods == ("block-uzawa", inexact)
    plain, varied = (Rung(1, method, 0, 1e-6).scene(read("block")).solver for method in ladder.methods)
    assert (plain.method, plain.preconditioner, plain.tolerance) == ("block-uzawa", "gram", 1e-6)
    assert (varied.method, varied.preconditioner, varied.tolerance) == ("block-uzawa", "mass", 1e-6)
    assert (varied.inner_solves, varied.inner_tolerance) == ("inexact", 0.1)
    assert Rung(1, inexact, 0, 1e-6).name != Rung(1, "block-uzawa", 0, 1e-6).name


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("block-uzawa+preconditioner=mas", 'preconditioner = "mas"'),
        ("block-uzawa+precondition=mass", "solver.precondition: unknown key"),
        ("uzawa+preconditioner=mass", "use block-uzawa"),
        ("uzawa+mass", "expected KEY=VALUE"),
    ],
)
def test_keys_of_a_method_are_checked(name: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        ladder_of(read("block"), ["condensed-newton", name])


def some_runs() -> list[Run]:
    """Level 0: both; level 2: uzawa fails; level 4: newton alone. A loose tolerance does not count."""
    return [
        made_up(rung("newton"), seconds=0.5, share=1.0, volume_solves=8),
        made_up(rung("uzawa"), seconds=2.0, share=1.0, volume_solves=240),
        made_up(rung("uzawa", tolerance=1e-2), seconds=0.1, share=1.0, volume_solves=5),
        made_up(rung("newton", 2), seconds=1.0, share=1.0, volume_solves=8),
        Run(rung=rung("uzawa", 2), status="out_of_time", h=0.05, spent=30.0),
        made_up(rung("newton", 4), seconds=4.0, share=1.0, volume_solves=8),
        made_up(rung("nsgs", 4), seconds=1.0, share=1.0, volume_solves=8),
    ]


def test_one_line_for_each_mesh_coarse_to_fine() -> None:
    found = lines(some_runs(), BOTH, TIGHT)
    assert [line.h for line in found] == pytest.approx([0.1, 0.05, 0.025])
    assert [tuple(run and run.status for run in line.runs) for line in found] == [
        ("converged", "converged"),
        ("converged", "out_of_time"),
        ("converged", None),
    ]
    told = plain(found, BOTH)
    assert told[0]["methods"]["uzawa"]["volume_solves"] == 240
    assert told[0]["methods"]["uzawa"]["seconds"] == 2.0
    assert told[1]["methods"]["uzawa"] == {
        "status": "out_of_time", "seconds": None, "volume_solves": None, "linear_iterations": None, "dofs": None,
        "memory": None,
    }  # fmt: skip
    assert told[2]["methods"]["uzawa"] is None


def test_the_sentence_compares_on_the_finest_mesh_that_all_have_solved() -> None:
    assert comparison(lines(some_runs(), BOTH, TIGHT), BOTH) == (
        "On the finest mesh that all solved (order 1, h = 0.1) newton takes 0.5 s and 8 volume solves; "
        "uzawa 4 times the seconds, 30 times the volume solves."
    )
    turned = tuple(reversed(BOTH))
    assert comparison(lines(some_runs(), turned, TIGHT), turned).startswith("On the finest mesh that all solved (order")
    assert comparison(lines(some_runs(), ("newton",), TIGHT), ("newton",)) == ""
    assert comparison(lines(some_runs()[3:], BOTH, TIGHT), BOTH) == ""


def test_table_and_picture_show_every_method(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = lines(some_runs(), BOTH, TIGHT)
    Teller(60.0, quiet=False).methods(found, BOTH)
    out = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in out.splitlines() if line.startswith("│")]
    assert rows[:2] == [["1", "0.1", "newton", "0.5", "8"], ["", "", "uzawa", "2", "240"]]
    assert rows[3] == ["", "", "uzawa", "out of time", "-"]
    Teller(60.0, quiet=True).methods(found, BOTH)
    assert not capsys.readouterr().out
    assert draw_methods(tmp_path, "a scene", found, BOTH, "said").read_bytes().startswith(b"\x89PNG")
