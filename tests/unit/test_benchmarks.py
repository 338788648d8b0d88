"""Benchmarks measure prices, memory and scaling, and say what could not be measured."""

import json
import math
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from scipy import sparse

import stickslip
from shared.discrete import ONE, local, random_problem, write
from shared.problems import SceneOf, SystemOf
from shared.ranks import mpirun
from stickslip import Scene, SceneError, read
from stickslip.geometry.amplitude import value_at
from stickslip.solvers.interface.discrete import DiscreteProblem, discrete_problem
from stickslip.solvers.linear.multigrid import HYPRE
from stickslip.solvers.results import linear_reference as module
from stickslip.solvers.results.linear_reference import linear_reference
from stickslip.workflows.formats.csv_tables import read_steps_table
from stickslip.workflows.lab.benchmarks import (
    adaptive,
    assemblies,
    auto,
    discrete,
    history,
    platforms,
    price,
    price_run,
    tangent_cg,
    time_to_accuracy,
)
from stickslip.workflows.lab.benchmarks.auto import Case, Run
from stickslip.workflows.lab.benchmarks.peers import calculix_peer, programs
from stickslip.workflows.lab.benchmarks.peers.programs import OURS, write_problem
from stickslip.workflows.lab.benchmarks.price_run import REFERENCE
from stickslip.workflows.lab.benchmarks.price_run import Case as Peer
from stickslip.workflows.lab.benchmarks.price_run import Case as Price
from stickslip.workflows.lab.benchmarks.scaling import LEAST, MOST, PAGE
from stickslip.workflows.lab.benchmarks.scaling import page as scaling_page
from stickslip.workflows.lab.benchmarks.scaling import ratios as scaling_ratios
from stickslip.workflows.lab.benchmarks.scaling_model import (
    EACH,
    ONCE,
    PHASES,
    Machine,
    Memory,
    Size,
    Traffic,
    fit,
    fitted,
    predicted,
    seconds_of,
    size_of,
)
from stickslip.workflows.lab.benchmarks.scaling_run import Case as Scaling
from stickslip.workflows.lab.benchmarks.time_to_accuracy import OURS as OUR_LADDER
from stickslip.workflows.lab.benchmarks.time_to_accuracy import PROBLEMS, Curve, Ladder
from stickslip.workflows.lab.benchmarks.work_precision import Point, draw, points
from stickslip.workflows.pictures.performance_profile import ratios


def test_every_method_solves_a_scene_in_few_and_in_many_steps() -> None:
    counts = (2, 4)
    few, many = (auto.row(Case("two_blocks", 6.0, tied=True), count, limit=60.0) for count in counts)
    assert (few.size.steps, many.size.steps) == counts
    for row in (few, many):
        assert {run.status for run in row.runs.values()} == {"converged"}
        assert row.ratio >= 1.0
        assert row.line().split()[0] == "two_blocks"


def test_a_run_that_takes_too_long_is_extended_by_the_second_half_of_its_steps() -> None:
    run = Run(prepared=5.0, steps=(4.0, 3.0, 1.0, 1.0), iterations=(1,) * 4, linear=0, count=32, status=auto.LONG)
    assert run.seconds == pytest.approx(5.0 + 9.0 + 28 * 1.0)


def test_a_run_that_solves_no_step_or_fails_is_never_the_best() -> None:
    run = Run(prepared=5.0, steps=(), iterations=(), linear=0, count=2, status=auto.LONG)
    assert run.seconds == np.inf
    assert Run(5.0, (1.0,), (1,), 0, 2, "the step failed").seconds == np.inf


def test_the_limit_ends_a_run() -> None:
    row = auto.row(Case("cube", 4.0), 2, limit=1e-9)
    assert {(run.status, run.seconds) for run in row.runs.values()} == {(auto.LONG, np.inf)}
    assert np.isnan(row.ratio)


def problem_of(case: str = "slips") -> DiscreteProblem:
    return discrete_problem(sparse.identity(3, format="csr"), np.array(ONE[case][0]), np.array([0.5]))


def test_an_answer_counts_only_if_our_residual_says_so() -> None:
    problem = problem_of()
    right = np.array(ONE["slips"][1]) / problem.units[0]
    assert discrete.measure(problem, lambda *_: (0.25, right), 1e-8) == 0.25
    for wrong in (1.001 * right, np.full(3, np.nan), None):
        assert discrete.measure(problem, lambda *_, wrong=wrong: (0.25, wrong), 1e-8) == math.inf
    assert math.isfinite(discrete.measure(problem, discrete.ours("auto"), 1e-8))


def test_a_line_compares_the_default_with_the_fastest_of_siconos() -> None:
    line = discrete.line("some", {"ours: auto": 0.2, "NSGS": 0.1, "ADMM": math.inf})
    assert line.split() == ["some", "0.2000", "0.1000", "-", "2"]
    assert discrete.line("some", {"ours: auto": 0.2, "NSGS": math.inf}).endswith("Siconos: none")
    assert discrete.line("some", {"ours: auto": 1e-5, "NSGS": 1e-6}).endswith("  1")  # both below the clock


def test_a_method_that_solves_nothing_has_no_share() -> None:
    found = ratios({"a": [0.5, math.inf], "b": [math.inf, math.inf]})
    assert list(found["a"]) == [1.0, math.inf]
    assert list(found["b"]) == [math.inf, math.inf]


def test_without_siconos_our_methods_are_measured_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(discrete, "installed", lambda: None)
    path = write(tmp_path / "six.hdf5", local(*random_problem(0)))
    discrete.main([path], method=["auto", "nsgs"], picture=tmp_path / "p.png")
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Siconos is not installed (Debian: python3-siconos): our methods alone"
    assert lines[2].split()[0] == "six"
    assert (tmp_path / "p.png").exists()
    with pytest.raises(SystemExit, match="gram-uzawa: needs the bodies"):
        discrete.main([path], method=["gram-uzawa"])


@pytest.mark.parametrize("dim", [2, 3])
def test_siconos_and_we_find_the_same(dim: int) -> None:
    numerics: Any = pytest.importorskip("siconos.numerics", reason="Debian's python3-siconos is not installed")
    W, q, mu = random_problem(3, dim=dim, bodies=40)  # of full rank: one r
    problem = discrete_problem(sparse.csr_matrix(W), q, 0.3 * mu)
    _, theirs = discrete.siconos(numerics, *discrete.SICONOS["NSGS"])(problem, 1e-9)
    _, ours = discrete.ours("auto")(problem, 1e-9)
    assert theirs is not None
    assert ours is not None
    np.testing.assert_allclose(theirs, ours, atol=1e-6)


STEPS, POINTS = 4 * history.CYCLES + 1, 9


def test_a_line_tells_of_each_phase_of_a_history_to_and_fro(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "CYCLES", 1)
    cost = history.measure(5, POINTS, "auto", tmp_path / "run")
    assert cost.points == POINTS
    assert set(cost.seconds) >= {*history.PHASES, "mesh", "prepare", "iterate", "other", "total"}
    lines = list(cost.lines())
    assert [line.split()[0] for line in lines[2 : 2 + len(cost.seconds)]] == [p.split()[0] for p in cost.seconds]
    slip = read_steps_table(tmp_path / "run")["base.slip.x"]
    assert min(slip) < 0 < max(slip)


@pytest.mark.parametrize("steps", [STEPS, 1000])
def test_the_history_goes_to_and_fro_in_whole_steps(steps: int) -> None:
    scene = history.scene(steps, POINTS)
    assert len(scene.requested_times()) == steps
    shear = scene.supports["grip"].displacement["x"]
    values = [value_at(shear, time, scene.steps.end) for time in scene.requested_times()]
    turns = sum(abs(value) == pytest.approx(history.AMPLITUDE) for value in values)
    assert turns == 2 * history.CYCLES


SECONDS = ((0.9, 0.3), (0.6, 0.1), (0.8, 0.1))  # of both steps, of the reference; the first one is cold


def test_a_price_is_the_median_of_ratios_taken_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    left = iter(SECONDS)

    def solve(case: Price, only: str = "") -> dict[str, Any]:
        seconds, reference = next(left)
        step = {"residual": 0.0, "iterations": 1, "volume_solves": 1, "linear_iterations": 0}
        steps = [step | {"seconds": s * seconds} for s in (0.5, 0.3, 0.1)]
        solved = {"prepare": 0.2 * seconds, "steps": steps, "reference": {"seconds": reference}}
        return solved | {"case": vars(case), "status": "converged", "memory": 1.0}

    monkeypatch.setattr(price_run, "_solve", solve)
    found = price_run.measure(Price(2, 16))
    assert found["repeated"] == len(SECONDS)  # 0.9 + 0.6 + 0.8 s fill two
    assert found["price"] == pytest.approx(median(s / r for s, r in SECONDS))
    assert found["further_price"] == pytest.approx(0.1 * found["price"])
    row = price._row(found, [found])
    assert (row["price"], row["reference"]) == (found["price"], 0.1)


def test_the_memory_of_the_reference_is_that_of_its_fastest_solver_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(case: Price, limit: float, *solver: str) -> dict[str, Any]:
        return {"status": "converged", "memory": 1.0 if solver else 3.0, "reference": {"fastest": "".join(solver)}}

    def of_all(case: Price, limit: float, *solver: str) -> dict[str, Any]:
        return answer(case, limit, *solver) | {"reference": {"fastest": "cg+gamg"}}

    monkeypatch.setattr(price, "_child", of_all)
    assert price.run(Price(2, 16, REFERENCE), 1.0)["memory"] == 1.0
    assert price.run(Price(2, 16), 1.0)["memory"] == 3.0


def test_one_solver_of_the_reference_is_solved_alone() -> None:
    alone = price_run.measure(Price(2, 8, REFERENCE), "cg+gamg")
    assert list(alone["reference"]["solvers"]) == ["cg+gamg"]
    assert 1e-2 < alone["memory"] < 10.0  # GB, of this very process
    assert alone["price"] is None


def test_the_reference_is_measured_on_every_mesh() -> None:
    done = {"case": vars(Price(2, 16, REFERENCE)), "status": "converged", "two_steps": None}
    assert price.expected(Price(2, 512, REFERENCE), [done]) == 0.0


def test_growth_is_the_slope_of_counts_that_are_powers_of_n() -> None:
    kind = {"method": "uzawa", "surface": "auto", "tolerance": 1e-8, "price": 1.0}
    rows = [kind | {"n": n, "volume_solves": 3 * n**1.5} for n in (8, 16, 64)]
    stopped = kind | {"n": 128, "price": None, "volume_solves": 7}
    assert price.growth([*rows, stopped]) == {("uzawa", "auto", 1e-8): pytest.approx(1.5)}
    assert price.growth(rows[:1]) == {}


def test_a_page_of_which_nothing_was_measured_is_a_page(tmp_path: Path) -> None:
    stopped = {"case": vars(Price(3, 64)), "status": "not run: 900 s expected"}
    page = price.write_page(tmp_path, [stopped])
    assert "not run: 900 s expected" in page.read_text()
    assert (tmp_path / "price.png").stat().st_size > 1000


BY_HAND = programs.HERE / "dolfinx_by_hand.py"
N = {2: 8, 3: 4}  # cells over the height
SHIFTED = 1  # index of the second step
CLOSED = 0.05  # [m] least of the compressions


@pytest.mark.parametrize(("dim", "solver"), [(2, "lu"), pytest.param(3, "lu", marks=pytest.mark.slow), (3, "gamg")])
def test_dolfinx_by_hand_has_our_forces_up_to_its_penalty(tmp_path: Path, dim: int, solver: str) -> None:
    problem = write_problem(replace(Peer(dim, N[dim]).scene(), steps=programs.TWO), tmp_path)
    found = programs.child([sys.executable, str(BY_HAND), str(problem), solver], 60.0)
    assert found["status"] == "converged"
    exact = [
        step.contacts["base"] for step, _ in zip(stickslip.steps(Peer(dim, N[dim]).scene()), range(2), strict=False)
    ]
    for theirs, ours in zip(found["steps"], exact, strict=True):
        assert theirs["normal_force"] == pytest.approx(ours.normal_force, rel=1e-3)
        assert 0 < theirs["penetration"] < 1e-3 * CLOSED
    shifted = exact[SHIFTED]
    assert found["steps"][SHIFTED]["tangential_force"] == pytest.approx(shifted.tangential_force, rel=1e-3)
    assert shifted.slip_area > 0  # so the figure depends on mu
    assert shifted.stick_area > 0


def test_two_plates_by_hand_have_our_bolt_load_up_to_their_penalty(tmp_path: Path) -> None:
    problem, ladder = PROBLEMS["bolted_plates"], Ladder(program="dolfinx by hand, MUMPS", cells="simplex")
    penalty = replace(ladder, settings={"penalty": 1e4})
    found = time_to_accuracy._peer(problem, penalty, 4.0, tmp_path)
    *_, last = stickslip.steps(problem.on(1, "simplex", 4.0))
    for goal, theirs in found["found"].items():
        assert theirs == pytest.approx(time_to_accuracy.number_of(last, goal), rel=1e-3)
    assert last.contacts["joint"].slip_area > 0
    assert set(found["found"]) == set(problem.goals.values())


def test_the_base_and_the_top_of_the_files_are_those_of_the_mesh(tmp_path: Path) -> None:
    problem = write_problem(replace(Peer(3, 4).scene(), steps=programs.TWO), tmp_path)
    data = np.load(tmp_path / "mesh.npz")
    assert data["points"].shape == (125, 3)
    assert data["cells"].shape == (64, 8)
    assert data["facets"].shape == (16, 4)
    assert set(data["base"]) == set(np.flatnonzero(data["points"][:, 2] == 0))
    assert set(data["top"]) == set(np.flatnonzero(data["points"][:, 2] == 1))
    assert json.loads(problem.read_text()) == {
        "dim": 3, "order": 1, "E": 1.0, "nu": 0.3, "mu": 0.3, "height": 1.0, "radius": 0.0,
        "base": "block.bottom", "top": "block.top", "motion": [[0.0, 0.0, -0.05], [0.02, 0.01, -0.05]],
    }  # fmt: skip


def test_a_peer_that_is_missing_is_said_to_be_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = [
        replace(programs.PROGRAMS[0], name="a module", needs="no_such_module_anywhere", install="Debian: nothing"),
        replace(programs.PROGRAMS[0], name="a program", needs="no-such-program", executable=True),
    ]
    answer = {"status": "converged", "seconds": 1.0}
    monkeypatch.setattr(programs, "PROGRAMS", missing)
    monkeypatch.setattr(programs, "child", lambda command, limit: answer)
    ours, *others = programs.measured(tmp_path, 3, [2], 1.0)
    assert (ours["name"], ours["status"]) == (OURS, "converged")
    assert [run["status"] for run in others] == ["not installed: Debian: nothing", "not installed: is ours too"]
    assert "not installed: Debian: nothing" in price.write_page(tmp_path, [], [ours, *others]).read_text()


def test_a_peer_that_would_take_too_long_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(programs, "PROGRAMS", [replace(programs.PROGRAMS[0], growth=(1.0, 3.0))])
    monkeypatch.setattr(programs, "child", lambda command, limit: {"status": "converged", "seconds": 10.0})
    found = [run["status"] for run in programs.measured(tmp_path, 3, [2, 4], 50.0) if run["name"] != OURS]
    assert found == ["converged", "not run: 80 s expected"]


def test_a_program_that_fails_says_why() -> None:
    found = programs.child([sys.executable, "-c", "raise SystemExit('it does not converge')"], 10.0)
    assert found == {"status": "it does not converge"}


def test_a_row_has_the_price_in_our_unit_and_the_errors_of_the_forces(tmp_path: Path) -> None:
    common = {"dim": 3, "n": 8, "status": "converged", "version": "1", "dofs": 9, "memory": 0.5}
    step = {"iterations": 4, "normal_force": 2.0, "tangential_force": 0.5, "penetration": 0.0}
    ours = common | {"name": OURS, "seconds": 1.0, "unit": 0.5, "steps": [step, step]}
    wrong = step | {"normal_force": 2.02, "tangential_force": 0.49, "iterations": 6}
    peer = common | {"name": "GetFEM", "seconds": 6.0, "steps": [step, wrong]}
    found = price.row(peer, [ours, peer])
    assert (found["price"], found["iterations"]) == (12.0, 10)
    assert found["error of N"] == pytest.approx(0.01)
    assert found["error of T"] == pytest.approx(-0.02)
    text = price.write_page(tmp_path, [], [ours, peer]).read_text()
    assert "<td>GetFEM<td>1<td>9<td>12<td>6<td>10<td>0.50<td>1.0e-02<td>-2.0e-02" in text
    assert "Peers on the same meshes" not in price.write_page(tmp_path, []).read_text()


def test_a_deck_of_calculix_has_the_nodes_of_the_sides(tmp_path: Path) -> None:
    problem = write_problem(replace(Peer(3, 2).scene(), steps=programs.TWO), tmp_path)
    data = np.load(tmp_path / "mesh.npz")
    top = calculix_peer.deck(json.loads(problem.read_text()), data).split("NSET=TOP\n")[1].split("*")[0]
    assert sorted(map(int, top.split())) == sorted(data["top"] + 1)


def of_ladder(errors: list[float]) -> Curve:
    """Return a ladder of GetFEM whose runs take 1, 2, ... s, and whose truth is 1."""
    found = [{"seconds": 1.0 + k, "found": {"force": 1 + error}} for k, error in enumerate(errors)]
    return Curve("GetFEM", "grid of order 1", tuple(found))


@pytest.mark.parametrize(
    ("errors", "seconds"),
    [([0.1, -0.009, 0.008], 2.0), ([0.001, 0.02, -0.005], 3.0), ([0.1, 0.001, -0.02], None), ([], None)],
)
def test_an_accuracy_is_reached_where_all_finer_meshes_have_it(errors: list[float], seconds: float | None) -> None:
    found = of_ladder(errors).reached("force", 1.0, 1e-2)
    assert (found and found["seconds"]) == seconds


@pytest.mark.parametrize(("offset", "meshes"), [(0.1, 5), (0.0, 4), (None, 1)])
def test_a_ladder_ends_where_its_number_is_right_or_settles_or_fails(
    offset: float | None, meshes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def peer(problem: object, ladder: Ladder, size: float, folder: Path) -> dict[str, object]:
        number = {"tangential_force": 1 + (offset or 0) + 0.1 * 0.08 ** int(folder.name)}
        return {"status": "?", "seconds": 1.0} | ({} if offset is None else {"found": number})

    monkeypatch.setattr(time_to_accuracy, "_peer", peer)
    found = time_to_accuracy.climbed("block", Ladder(program="GetFEM"), {"tangential_force": 1.0}, tmp_path)
    assert [run["size"] for run in found] == pytest.approx([4.0 * 0.6**k for k in range(meshes)])


def test_rows_of_accuracies_take_the_soonest_ladder_and_say_where_one_ends() -> None:
    problem = replace(PROBLEMS["block"], goals={"friction force": "force", "area": "area"})
    slow, fast = of_ladder([0.1, 0.1, 0.004, 0.004]), of_ladder([0.02, 0.005])
    hand = replace(of_ladder([0.005]), program=OUR_LADDER)
    found = list(
        time_to_accuracy.rows(problem, [hand, slow, fast], {"force": 1.0, "area": 1.0}, {"force": 1e-4, "area": 1.0})
    )
    assert [(row["asked"], row["program"], row["times"], row["ladder"]) for row in found] == [
        (1e-2, OUR_LADDER, 1.0, "grid of order 1"), (1e-2, "GetFEM", 2.0, "grid of order 1"),
        (1e-3, OUR_LADDER, None, "ends at 0.5 %"), (1e-3, "GetFEM", None, "ends at 0.4 %"),
    ]  # fmt: skip


def test_every_ladder_is_of_a_program_that_is_known() -> None:
    names = {OUR_LADDER, *(program.name for program in programs.PROGRAMS)}
    assert {ladder.program for problem in PROBLEMS.values() for ladder in problem.ladders} <= names


COSTS = {name: np.array([1e-6, 1e-5, 1e-3]) for name in PHASES}
TRAFFIC = Traffic(messages=10.0, halo=400.0, gathered=100.0, collectives=20.0, objects=8.0)
RANKS = (64, 256, 1024, 4096)


def made(unknowns: int, points: int, ranks: int = 1) -> dict[str, object]:
    """A run as the model would have it, on a machine where messages cost nothing."""
    size = Size(unknowns, points, ranks)
    foreseen = predicted(COSTS, None, size, Machine())
    memory = 1e8 + 4e3 * unknowns / ranks + 2e3 * points + 3e3 * size.touching
    side = round(points**0.5) - 1
    each = sum(foreseen.iteration.values())
    parts = {name: 20 * foreseen.iteration[name] for name in EACH if name != "vectors"}
    return {
        "case": {"n": side, "layers": round(unknowns / 3 / points) - 1 if unknowns != 3 * points**1.5 else 0},
        "unknowns": unknowns,
        "points": points,
        "ranks": ranks,
        "iterations": [10, 10],
        "seconds": dict(foreseen.once) | {"iterate": 20 * each + 2 * foreseen.step, "gmsh": 1.0},
        "parts": parts | {"iterations": 20 * each},
        "memory": [{"iterate": memory, "gmsh": 1e8 + 500.0 * unknowns}] * ranks,
        "objects": [1e3 * points + 100.0 * unknowns / ranks] * ranks,
        "sent": {key: [1e3, 1e3] for key in ("messages", "bytes", "collectives", "collective_bytes")},
        "calls": {"allreduce": 160},
        "events": {"VecScatterBegin": {"messages": [100.0, 50.0], "bytes": [1e5, 5e4]}},
    }


RUNS = [made(3 * m**3, m**2) for m in (10, 20, 30, 40)] + [made(3 * 900 * 9, 900), made(3 * 2500 * 9, 2500)]
TWO = [made(3 * m**3, m**2, 2) for m in (20, 30)]


def test_costs_add_up() -> None:
    run = predicted(COSTS, TRAFFIC, Size(1e6, 1e4, 16), Machine())
    each = sum(run.iteration.values())
    assert run.total(2, 30) == pytest.approx(sum(run.once.values()) + 2 * run.step + 30 * each)
    assert run.total(2, 31) - run.total(2, 30) == pytest.approx(each)
    assert {*run.once} == {*ONCE}
    assert {*run.iteration} == {*EACH, "messages", "collectives"}


def test_shared_work_falls_with_the_ranks_and_replicated_work_does_not() -> None:
    runs = [predicted(COSTS, None, Size(1e8, 1e6, ranks), Machine()) for ranks in RANKS]
    for before, after in pairwise(runs):
        assert after.iteration["cycle"] == pytest.approx(before.iteration["cycle"] / 4)
        assert after.iteration["contact"] < before.iteration["contact"]
        assert after.once["coordinates"] == before.once["coordinates"] > 0
        assert after.once["mesh"] == before.once["mesh"] > 0


def test_messages_and_neighbours_grow_with_the_ranks() -> None:
    sizes = [Size(1e8, 1e6, ranks) for ranks in (1, 2, 8, *RANKS)]
    neighbours = [size.neighbours for size in sizes]
    assert neighbours == sorted(neighbours)
    assert neighbours[0] == 0
    assert TRAFFIC.seconds(sizes[0], Machine()) == {"messages": 0.0, "collectives": 0.0}
    waits = [TRAFFIC.seconds(size, Machine())["collectives"] for size in sizes]
    assert waits == sorted(waits)
    gathers = {TRAFFIC.gather(size, Machine()) for size in sizes[1:]}  # all points reach every rank
    assert gathers == {100 * 1e6 / Machine().bandwidth}
    assert TRAFFIC.gather(sizes[0], Machine()) == 0


def test_more_of_everything_costs_more() -> None:
    small = predicted(COSTS, TRAFFIC, Size(1e6, 1e4, 16), Machine())
    for larger in (Size(2e6, 1e4, 16), Size(1e6, 4e4, 16)):
        assert predicted(COSTS, TRAFFIC, larger, Machine()).total(2, 30) > small.total(2, 30)


def test_the_fit_finds_the_costs_that_runs_were_made_of_and_foresees_two_ranks() -> None:
    found = fit(RUNS)
    for run in (*RUNS, *TWO):
        foreseen = predicted(found, None, size_of(run), Machine())
        for name, seconds in seconds_of(run).items():
            both = {**foreseen.once, **foreseen.iteration, "step": foreseen.step}
            assert both[name] == pytest.approx(seconds, rel=1e-6), name
    assert scaling_ratios(found, Traffic(0, 0, 0, 0, 0), TWO)["coordinates"] == pytest.approx([1.0, 1.0])


def test_costs_are_never_negative() -> None:
    assert fitted(np.array([[1.0, 1.0], [2.0, 1.0]]), np.array([3.0, 1.0])).min() >= 0.0


def test_memory_is_that_of_which_peaks_were_made() -> None:
    memory = Memory.of(RUNS, [*TWO, made(3 * 2500 * 9, 2500, 8)], RUNS)
    assert memory.point == pytest.approx(2e3)
    assert memory.own == pytest.approx(3e3)
    assert memory.objects == pytest.approx(1e3)
    assert memory.unknown == pytest.approx(4e3)
    assert memory.meshed == pytest.approx(500.0)
    large = [memory.of_rank(Size(1e8, 1e6, ranks)) for ranks in RANKS]
    assert [one["contact"] for one in large] == pytest.approx([2e9] * len(RANKS))
    assert large[0]["bodies"] == pytest.approx(64 * large[-1]["bodies"])


def test_the_page_has_a_table_of_each_kind() -> None:
    text = scaling_page(RUNS, TWO, RUNS)
    heads = [line for line in text.splitlines() if line.startswith("## ")]
    assert heads[0] == "## Strong scaling"
    assert {"## Messages", "## Memory", "## Model", "## Check on two ranks"} < {*heads}
    assert "| seconds | 64 ranks | 256 ranks | 1024 ranks | 4096 ranks |" in text
    assert "nan" not in text


def test_the_page_states_ratios_within_the_bounds_that_it_states() -> None:
    table = PAGE.read_text(encoding="utf-8").split("## Check on two ranks")[1].split("## ")[0]
    rows = [line.split("|")[1:-1] for line in table.splitlines() if line.startswith("| ")]
    found = [float(row[3]) for row in rows if "×" in row[0]]
    assert len(found) >= 6
    assert min(found) >= LEAST
    assert max(found) <= MOST


def test_the_page_of_adaptive_rounds_says_how_many_times_fewer_they_take() -> None:
    ways = (*adaptive.WAYS, adaptive.HALVED)
    others = {way: adaptive.Price(4000.0, 6.0, 0.01, measured=way != ways[1]) for way in ways}
    row = adaptive.Row("punch", "face.normal_force", 0.01, 0.008, adaptive.Price(1000.0, 2.0, 0.005), 3, 2, others)
    head, divider, line, _, *saved = adaptive.page([row]).splitlines()[-7:]
    assert head.count("|") == divider.count("|") == line.count("|") == 17
    told = "| punch: normal_force | 1 % | 3 | 2 | 0.8 % | 0.5 % | 1000 | 2 | 4000 | 6 | ~4000 | ~6 | 4000 | 6 |"
    assert line.startswith(told)
    assert saved[-1] == "| punch: normal_force | 1 % | 4 | 3 | 3 |"


def test_the_page_of_tangent_cg_has_a_row_for_each_case_and_tolerance(tmp_path, monkeypatch) -> None:
    measured = tangent_cg.Measured(30, (3, 4, 5), 1.5, 0.25, 1e-9, (10, 5, 0.5))
    monkeypatch.setattr(tangent_cg, "run", lambda *case: measured if case[2] == "tangent-cg" else "failed")
    tangent_cg.main("8,64", tmp_path / "page.md")
    cubes, others = (tmp_path / "page.md").read_text(encoding="utf-8").split("## Cubes")[1].split("## Other scenes")
    assert "| n = 8, μ = 0.3, 0.0001 | 3 + 4 + 5 | 3.0, 6.0 | 3.0, 0.50 | 1e-09 | failed |  |  |  |\n" in cubes
    assert (
        "| n = 64, μ = 0.3, 0.0001 | 3 + 4 + 5 | 3.0, 6.0 | 3.0, 0.50 | 1e-09 |\n" in cubes
    )  # too large for the other
    assert others.count("| spheres, ") == len(tangent_cg.TOLERANCES)


def test_two_ranks_measure_a_small_cube(tmp_path) -> None:
    words = [json.dumps({"n": 4})]
    done = mpirun(2, words, tmp_path, ("-m", "stickslip.workflows.lab.benchmarks.scaling_run"))
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["ranks"], found["unknowns"], found["points"]) == (2, Scaling(4).unknowns, Scaling(4).points)
    assert len(found["memory"]) == len(found["objects"]) == 2
    assert found["events"]["VecScatterBegin"]["messages"][0] > 0
    assert found["calls"]["allgather"] > 0
    assert 0 < sum(seconds_of(found)[name] for name in EACH) < found["seconds"]["iterate"]


NAME = "base.tangential_force"


def test_stated_errors_are_beside_true_ones_and_fall_with_the_mesh(tmp_path: Path) -> None:
    scene, said = read("raous"), list[str]()
    coarse, fine = points(scene, NAME, (4.0, 2.0), said.append)
    assert len(said) == 2
    for found in (coarse, fine):
        assert 0.7 < found.stated / found.true < 3
        assert found.corrected < 0.5 * found.true
    assert fine.true < 0.4 * coarse.true
    assert fine.unknowns > 3 * coarse.unknowns
    pixels = imread(draw(tmp_path / "drawn.png", scene, NAME, [coarse, fine]))[..., :3]
    for colour in ((0, 114, 178), (213, 94, 0), (0, 158, 115)):  # one curve each
        assert (np.abs(pixels - np.array(colour) / 255).max(axis=-1) < 0.02).sum() > 100


def test_only_what_the_scene_knows_exactly_is_compared() -> None:
    with pytest.raises(SceneError, match=r"exact.values.base.stick_area: the scene does not know it"):
        list(points(read("raous"), "base.stick_area", (4.0,), print))


def test_a_line_says_all_errors() -> None:
    found = Point(unknowns=152, seconds=0.5, stated=0.057, true=0.061, corrected=0.026)
    assert str(found) == ("152 unknowns, 0.50 s: stated by the run 5.7 %, true 6.1 %, of the corrected number 2.6 %")


MULTIGRID = "cg+boomeramg" if HYPRE else "cg+gamg"
BASE = {"base": {"surface": "block.bottom", "against": "foundation"}}


def scene(make: SceneOf, dim: int, pressure: float = 0.1) -> Scene:
    """Held by contact alone: with its contact surface fixed it is held all the same."""
    loads: dict[str, Any] = {"push": {"boundary": "block.top", "pressure": pressure}}
    return make(
        dim, {"cells": "tensor"}, contacts=BASE | {"base": BASE["base"] | {"friction": {"law": "stick"}}}, loads=loads
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_every_solver_solves_and_the_fastest_is_the_unit(dim: int, scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(scene(scene_of, dim))
    found = linear_reference(system)
    assert set(found.solvers) == {"mumps", "cg+gamg", MULTIGRID}
    for timing in found.solvers.values():
        assert timing.residual <= 2e-8
        assert timing.seconds >= found.seconds > 0
    assert found.solvers[found.fastest].seconds == found.seconds
    assert found.solvers[MULTIGRID].iterations > found.solvers["mumps"].iterations
    assert system.counters.volume_solves == 0  # kept apart


def test_a_factorisation_that_would_take_far_longer_is_not_tried(
    scene_of: SceneOf, system_of: SystemOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "QUADRATIC", 1.0)
    found = linear_reference(system_of(scene(scene_of, 3)))
    assert found.solvers["mumps"].note.startswith("not tried")
    assert found.solvers["mumps"].setup is None
    assert found.fastest != "mumps"
    assert np.isfinite(found.seconds)


def test_without_a_load_another_one_is_taken(scene_of: SceneOf, system_of: SystemOf) -> None:
    found = linear_reference(system_of(scene(scene_of, 2, pressure=0.0)))
    assert found.solvers[MULTIGRID].iterations > 1


def test_a_looser_solve_is_timed_too(scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(scene(scene_of, 2))
    loose, tight = (linear_reference(system, MULTIGRID, rtol) for rtol in (1e-3, 1e-8))
    assert 1e-8 < loose.solvers[MULTIGRID].residual <= 1e-3
    assert 0 < loose.seconds < np.inf
    assert loose.solvers[MULTIGRID].iterations < tight.solvers[MULTIGRID].iterations


def test_a_solver_that_fails_is_said(scene_of: SceneOf, system_of: SystemOf, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_ITERATIONS", 1)
    found = linear_reference(system_of(scene(scene_of, 2)))
    assert found.fastest == "mumps"
    assert found.solvers["cg+gamg"].seconds == np.inf
    assert found.solvers["cg+gamg"].note.startswith("failed: residual")


def test_figures_repeat_and_a_difference_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(platforms, "SCENES", ["block"])
    monkeypatch.setattr(platforms, "TIMED", "block")
    assert [platforms.main(tmp_path, name) for name in ("first", "second")] == [0, 0]
    found = json.loads((tmp_path / "second.json").read_text(encoding="utf-8"))
    force = found["figures"]["block"]["force"]
    for wrong in (force[0] + 1e-8 * max(force), np.nan):
        found["figures"]["block"]["force"] = [wrong, *force[1:]]
        (tmp_path / "third.json").write_text(json.dumps(found), encoding="utf-8")
        assert platforms.main(tmp_path) == 1
    assert "largest difference from first: nan" in capsys.readouterr().out


LARGER = [("clevis", 0.2, 1.0, 1, 15), ("rings", 0.2, 1.0, 1, 14)]  # of their kind: a coarser copy of each runs always


@pytest.mark.parametrize(
    ("name", "mu", "coarser", "order", "most"),
    [("clevis", 0.1, 2.0, 1, 20), ("ball", 0.1, 1.0, 1, 16), ("wedge", 0.2, 1.0, 1, 8),
     *(pytest.param(*row, marks=pytest.mark.slow) for row in LARGER)],
)  # fmt: skip
def test_assemblies_take_a_dozen_iterations(name: str, mu: float, coarser: float, order: int, most: int) -> None:
    """Friction alone keeps pins and balls from turning, which travel far on ten points; plain Newton hops about."""
    work = assemblies.measure(assemblies.Case(name, mu, coarser, order, method="condensed-newton"))
    assert work["iterations"][0] <= most


COARSE = {  # most iterations of the first step, and of further ones
    "arch": (2, 1), "ball": (18, 6), "blade": (8, 12), "clevis": (14, 7), "cone": (23, 9), "drum": (20, 9),
    "gears": (9, 2), "logs": (44, 2), "rings": (8, 4), "wedge": (6, 7),
}  # fmt: skip


@pytest.mark.parametrize(("name", "most"), COARSE.items())
def test_coarse_copies_of_assemblies_have_answers(name: str, most: tuple[int, int]) -> None:
    """So few points touch that which stick decides nearly all; some pairs of skins have no point at all.

    Of the blade points slip that rows press on which had no room from the beginning; gears hardly hold each other; logs
    roll 200 000 times as far as they are deformed.
    """
    case = next(case for case in assemblies.copies([name]) if case.mu == 0.5)
    found = assemblies.measure(case)
    assert found["told"] == ""
    assert len(found["iterations"]) == 3
    assert found["iterations"][0] <= most[0]
    assert max(found["iterations"][1:]) <= most[1]


def test_links_of_a_chain_turn_by_their_own_thickness_until_they_find_hold() -> None:
    """In how many iterations, rounding decides."""
    found = assemblies.measure(next(case for case in assemblies.copies(["chain"]) if case.mu == 0.1))
    assert found["told"] == ""
    assert len(found["iterations"]) == 3


@pytest.mark.parametrize(("name", "most"), [("clevis", (16, 9)), ("hinge", (16, 12)), ("ball", (16, 20))])
def test_points_that_close_and_pairs_that_change_cost_little(name: str, most: tuple[int, int]) -> None:
    """Of clevis and hinge points close in a further step; of the ball the first one ends with other pairs."""
    found = assemblies.measure(next(case for case in assemblies.copies([name]) if case.mu == 0.1))
    assert found["iterations"][0] <= most[0]
    assert max(found["iterations"][1:]) <= most[1]
