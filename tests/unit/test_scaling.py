"""The model of scaling: its costs add up, fall with the ranks where work is shared, and it finds what it is made of."""

import json
from itertools import pairwise

import numpy as np
import pytest

from shared.ranks import mpirun
from stickslip.workflows.lab.benchmarks.scaling import LEAST, MOST, PAGE, page, ratios
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
from stickslip.workflows.lab.benchmarks.scaling_run import Case

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
    assert ratios(found, Traffic(0, 0, 0, 0, 0), TWO)["coordinates"] == pytest.approx([1.0, 1.0])


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
    text = page(RUNS, TWO, RUNS)
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


def test_two_ranks_measure_a_small_cube(tmp_path) -> None:
    words = [json.dumps({"n": 4})]
    done = mpirun(2, words, tmp_path, ("-m", "stickslip.workflows.lab.benchmarks.scaling_run"))
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["ranks"], found["unknowns"], found["points"]) == (2, Case(4).unknowns, Case(4).points)
    assert len(found["memory"]) == len(found["objects"]) == 2
    assert found["events"]["VecScatterBegin"]["messages"][0] > 0
    assert found["calls"]["allgather"] > 0
    assert 0 < sum(seconds_of(found)[name] for name in EACH) < found["seconds"]["iterate"]
