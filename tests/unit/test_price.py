"""The price of friction: ratios of what was measured side by side, and the memory of one linear solver."""

from pathlib import Path
from statistics import median
from typing import Any

import pytest

from stickslip.workflows.lab.benchmarks import price, price_run
from stickslip.workflows.lab.benchmarks.price_run import REFERENCE, Case

SECONDS = ((0.9, 0.3), (0.6, 0.1), (0.8, 0.1))  # of both steps, of the reference; the first one is cold


def test_a_price_is_the_median_of_ratios_taken_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    left = iter(SECONDS)

    def solve(case: Case, only: str = "") -> dict[str, Any]:
        seconds, reference = next(left)
        step = {"residual": 0.0, "iterations": 1, "volume_solves": 1, "linear_iterations": 0}
        steps = [step | {"seconds": s * seconds} for s in (0.5, 0.3, 0.1)]
        solved = {"prepare": 0.2 * seconds, "steps": steps, "reference": {"seconds": reference}}
        return solved | {"case": vars(case), "status": "converged", "memory": 1.0}

    monkeypatch.setattr(price_run, "_solve", solve)
    found = price_run.measure(Case(2, 16))
    assert found["repeated"] == len(SECONDS)  # 0.9 + 0.6 + 0.8 s fill two
    assert found["price"] == pytest.approx(median(s / r for s, r in SECONDS))
    assert found["further_price"] == pytest.approx(0.1 * found["price"])
    row = price._row(found, [found])
    assert (row["price"], row["reference"]) == (found["price"], 0.1)


def test_the_memory_of_the_reference_is_that_of_its_fastest_solver_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(case: Case, limit: float, *solver: str) -> dict[str, Any]:
        return {"status": "converged", "memory": 1.0 if solver else 3.0, "reference": {"fastest": "".join(solver)}}

    def of_all(case: Case, limit: float, *solver: str) -> dict[str, Any]:
        return answer(case, limit, *solver) | {"reference": {"fastest": "cg+gamg"}}

    monkeypatch.setattr(price, "_child", of_all)
    assert price.run(Case(2, 16, REFERENCE), 1.0)["memory"] == 1.0
    assert price.run(Case(2, 16), 1.0)["memory"] == 3.0


def test_one_solver_of_the_reference_is_solved_alone() -> None:
    alone = price_run.measure(Case(2, 8, REFERENCE), "cg+gamg")
    assert list(alone["reference"]["solvers"]) == ["cg+gamg"]
    assert 1e-2 < alone["memory"] < 10.0  # GB, of this very process
    assert alone["price"] is None


def test_the_reference_is_measured_on_every_mesh() -> None:
    done = {"case": vars(Case(2, 16, REFERENCE)), "status": "converged", "two_steps": None}
    assert price.expected(Case(2, 512, REFERENCE), [done]) == 0.0


def test_growth_is_the_slope_of_counts_that_are_powers_of_n() -> None:
    kind = {"method": "uzawa", "surface": "auto", "tolerance": 1e-8, "price": 1.0}
    rows = [kind | {"n": n, "volume_solves": 3 * n**1.5} for n in (8, 16, 64)]
    stopped = kind | {"n": 128, "price": None, "volume_solves": 7}
    assert price.growth([*rows, stopped]) == {("uzawa", "auto", 1e-8): pytest.approx(1.5)}
    assert price.growth(rows[:1]) == {}


def test_a_page_of_which_nothing_was_measured_is_a_page(tmp_path: Path) -> None:
    stopped = {"case": vars(Case(3, 64)), "status": "not run: 900 s expected"}
    page = price.write_page(tmp_path, [stopped])
    assert "not run: 900 s expected" in page.read_text()
    assert (tmp_path / "price.png").stat().st_size > 1000
