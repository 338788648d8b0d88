"""The price of the method as published: its measurements, its verdicts on rows that are made up, and its page."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_allclose

from stickslip.workflows.lab.studies.block_price import measure
from stickslip.workflows.lab.studies.block_price import page as verdicts
from stickslip.workflows.lab.studies.block_price.__main__ import measured
from stickslip.workflows.lab.studies.block_price.measure import (
    EXACTLY,
    INEXACT,
    LIKE,
    METHODS,
    REFERENCE,
    SMALL,
    Case,
    Sizes,
    tables,
)
from stickslip.workflows.lab.studies.block_price.page import CLAIMS, NAME, SIDE_BY_SIDE, conditions, verdict, write_page
from stickslip.workflows.lab.studies.published.finding import HOLDS, HOLDS_NOT, UNKNOWN, Finding, Row, Rows, chosen

MASS, COMPLETE, DROP, IC0 = EXACTLY
TINY = Sizes(meshes=((2, 4),), at=(), methods=(REFERENCE, "uzawa", MASS), parts=(1.1,), inner_at=(), bound_at=(2, 4))
LIMIT = 60.0  # s


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("price") / "block_price"


@pytest.fixture(scope="module")
def rows(folder: Path) -> Rows:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measure, "TIMES", 1)  # nothing here depends on seconds
        return measured(folder, TINY, LIMIT)


def test_the_page_shows_every_measurement_and_every_verdict(folder: Path, rows: Rows) -> None:
    text = write_page(folder / NAME, rows).read_text()
    for claim in CLAIMS:
        assert f"| {claim.says} | **{verdict(claim.judge(rows))}** |" in text
    for row in rows["h"]:
        assert f"| {row['method']} | {row['iterations']} | {row['volume_solves']} |" in text
    assert "### 2D, n = 4, 72 unknowns, 9 nodes that can touch" in text


def test_errors_are_those_of_a_tolerance_and_the_same_iteration_is_seen_in_both_forms(rows: Rows) -> None:
    newton, condensed, whole = rows["h"]
    assert [row["method"] for row in rows["h"]] == [REFERENCE, "uzawa", MASS]
    assert abs(whole["iterations"] - condensed["iterations"]) <= 2  # rounding decides the last one
    assert condensed["iterations"] > 50 * newton["iterations"]
    for row in (condensed, whole):
        assert 1e-9 < row["u_error"] < 1e-7  # both stop just below 1e-8
        assert 1e-8 < row["lam_l2"] <= row["lam_max"] < 1e-5
    assert whole["lam_max"] == pytest.approx(condensed["lam_max"], rel=0.1)
    assert newton["u_error"] < 1e-9


def test_above_the_bound_a_glued_base_diverges_and_the_row_says_so(rows: Rows) -> None:
    glued, slipping = rows["alpha"]
    assert glued["sticks"]
    assert "residual" in glued["status"]
    assert "iterations" not in glued
    assert slipping["status"] == "converged"  # projected and damped by friction
    assert verdicts.bound(rows).verdict == HOLDS


def test_what_was_measured_is_not_measured_again(folder: Path, rows: Rows, monkeypatch: pytest.MonkeyPatch) -> None:
    lost = tables(TINY)["h"][1]
    (folder / "rows" / f"{lost.name}.json").unlink()
    called: list[Case] = []
    monkeypatch.setattr(measure, "measure", lambda case, limit: called.append(case) or {"status": "none"})
    found = measured(folder, TINY, LIMIT)
    assert called == [lost]
    assert [row["status"] for row in found["h"]] == ["converged", "none", "converged"]
    assert found["alpha"] == rows["alpha"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # within a callback it comes again
def test_a_measurement_that_takes_too_long_is_a_row_that_says_so() -> None:
    case = Case(dim=2, n=8, method=MASS)
    row = measure.measure(case, 0.01)
    assert row["status"] == "stopped after 0.01 s"
    assert "seconds" not in row
    assert row["stopped"] == 0.01
    assert measure.measure(replace(case, n=4), LIMIT)["status"] == "converged"  # nothing is left of the limit


def test_what_was_stopped_is_tried_again_only_with_more_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limits: list[float] = []

    def stopped(case: Case, limit: float) -> Row:
        limits.append(limit)
        return {"status": f"stopped after {limit:g} s", "stopped": limit}

    monkeypatch.setattr(measure, "measure", stopped)
    for limit in (5.0, 5.0, 2.0, 60.0, 30.0):
        measure.row_of(Case(dim=2, n=4, method=MASS), tmp_path, limit)
    assert limits == [5.0, 60.0]


def test_no_two_measurements_share_a_file() -> None:
    for sizes in (Sizes(), SMALL):
        cases = {case for table in tables(sizes).values() for case in table}
        assert len({case.name for case in cases}) == len(cases)


@pytest.mark.parametrize(("dim", "axes"), [(2, "xy"), (3, "xyz")])
def test_one_big_step_ends_where_two_do(dim: int, axes: str) -> None:
    case = Case(dim=dim, n=4, method=MASS, mu=0.05, c_n=10.0)
    one, two = replace(case, steps=1).scene(), case.scene()
    assert (one.requested_times(), two.requested_times()) == ((1.0,), (1.0, 2.0))
    ends = [{axis: table[-1][1] for axis, table in s.supports["top"].displacement.items()} for s in (one, two)]  # type: ignore[index]
    assert ends[0] == ends[1]
    assert set(ends[0]) == set(axes)
    normal, height = two.contacts["base"].normal, {2: 2.0, 3: 1.0}[dim]
    assert_allclose(normal.c_n * height, 10.0)  # type: ignore[attr-defined]  # E = 1 Pa


def test_a_name_stands_for_its_keys() -> None:
    solver = Case(dim=2, n=4, method=DROP + INEXACT, rule="bramble-pasciak-vassilev", share=0.1).scene().solver
    told = (solver.method, solver.preconditioner, solver.gram.factor, solver.inner_solves)  # type: ignore[attr-defined]
    assert told == ("block-uzawa", "gram", "drop", "inexact")
    assert (solver.inner_rule, solver.inner_tolerance) == ("bramble-pasciak-vassilev", 0.1)  # type: ignore[attr-defined]
    assert len({Case(dim=2, n=4, method=method).scene().solver for method in METHODS}) == len(METHODS)


# --- verdicts on rows that are made up


def made_up(method: str, n: int = 8, dim: int = 2, iterations: int = 100, seconds: float = 1.0, **more: Any) -> Row:
    case = {"dim": dim, "n": n, "method": method, "mu": 0.3, "c_n": None, "steps": 2, "sticks": False, "part": None}
    case |= {"rule": "elman-golub", "share": 0.3, "status": "converged", "dofs": 10 * n, "points": n, "lambda_1": 1.0}
    counts = {"iterations": iterations, "volume_solves": iterations + 6, "linear_iterations": 0, "for_lambda_1": 9}
    times = {"seconds": seconds, "prepare": 0.1 * seconds, "iterate": 0.9 * seconds, "wall": seconds, "cpu": seconds}
    return case | counts | times | {"lam_max": 1e-7, "lam_l2": 1e-8, "u_error": 1e-9} | more


def failed(row: Row, status: str = "the residual stopped falling") -> Row:
    return {key: row[key] for key in list(row)[:10]} | {"status": status}


def laid(h: list[Row], **others: list[Row]) -> Rows:
    return {name: [] for name in tables(Sizes(meshes=(), at=()))} | {"h": h} | others


def family(growth: dict[str, float], meshes: tuple[int, ...] = (8, 16, 32)) -> Iterator[Row]:
    """Iterations of each method grow like a power of n."""
    for n in meshes:
        for method, power in growth.items():
            yield made_up(method, n, iterations=round(1000 * (n / 8) ** power))


def test_independence_of_h_is_the_slope_between_the_finest_meshes() -> None:
    rows = laid(list(family({MASS: 1.0, COMPLETE: 0.0, DROP: 0.05, IC0: 0.9})))
    assert verdicts.mass_grows(rows).verdict == HOLDS
    assert verdicts.complete_is_free_of_h(rows).verdict == HOLDS
    assert verdicts.incomplete_is_free_of_h(rows).cases == {"gram drop, 2D": True, "gram ic0, 2D": False}
    levelled = [row | {"iterations": 1000} if row["method"] == MASS and row["n"] > 8 else row for row in rows["h"]]
    assert verdicts.mass_grows(laid(levelled)).verdict == HOLDS_NOT


def test_what_a_preconditioner_saves_is_judged_on_the_finest_mesh_that_both_solve() -> None:
    h = [made_up(MASS, 8, iterations=100, seconds=1.0), made_up(IC0, 8, iterations=200, seconds=0.5)]
    h += [made_up(MASS, 16, iterations=400, seconds=1.0), made_up(IC0, 16, iterations=200, seconds=3.0)]
    h += [made_up(MASS, 32), failed(made_up(IC0, 32), "stopped after 60 s")]
    assert verdicts.gram_saves_iterations(laid(h)).cases == {"2D n = 16, gram ic0": True}
    assert verdicts.gram_saves_seconds(laid(h)).cases == {"2D n = 16, gram ic0": False}


def test_direct_solvers_are_judged_by_seconds_and_a_failure_is_no_victory() -> None:
    h = [made_up(REFERENCE, seconds=2.0), made_up(MASS, seconds=5.0), made_up(MASS + INEXACT, seconds=3.0)]
    h += [made_up(IC0, seconds=9.0), failed(made_up(IC0 + INEXACT))]
    assert verdicts.factor_is_slow(laid(h)).cases == {"2D n = 8, mass": True, "2D n = 8, gram ic0": False}
    assert verdicts.direct_is_slow(laid(h)).cases == {"2D n = 8": False}
    h[2] = made_up(MASS + INEXACT, seconds=1.0)
    assert verdicts.direct_is_slow(laid(h)).verdict == HOLDS
    assert verdicts.condensing_saves(laid(h)).verdict == HOLDS_NOT


def test_inexact_solves_must_take_no_more_iterations_on_any_mesh() -> None:
    h = [row for n in (8, 16) for row in (made_up(MASS, n), made_up(MASS + INEXACT, n, iterations=105))]
    assert verdicts.inexact_is_as_fast(laid(h)).cases == {"mass": True}
    more = [*h[:-1], made_up(MASS + INEXACT, 16, iterations=120)]
    assert verdicts.inexact_is_as_fast(laid(more)).cases == {"mass": False}
    found = verdicts.inexact_is_as_fast(laid([*h[:-1], failed(h[-1])]))
    assert found.cases == {"mass": False}
    assert found.figure.endswith("fails: mass, 2D n = 16")


def test_conjugate_gradients_are_compared_with_solves_to_rounding() -> None:
    whole = made_up(MASS + INEXACT, rule="bramble-pasciak-vassilev", share=1e-8, linear_iterations=900)
    usual = made_up(MASS + INEXACT, linear_iterations=90)
    found = verdicts.inexact_saves(laid([], inner=[whole, usual]))
    assert found.cases == {"2D n = 8, mass": True}
    assert "90 for 900" in found.figure
    assert verdicts.inexact_saves(laid([], inner=[whole, usual | {"linear_iterations": 901}])).verdict == HOLDS_NOT
    assert verdicts.inexact_saves(laid([], inner=[whole, failed(usual)])).verdict == HOLDS_NOT
    assert verdicts.any_delta(laid([], inner=[whole, usual])).verdict == HOLDS
    assert verdicts.any_delta(laid([], inner=[whole, failed(usual)])).verdict == HOLDS_NOT


def test_the_bound_is_sharp_only_if_no_run_above_it_converges() -> None:
    below, above = made_up(MASS, sticks=True, part=0.99), failed(made_up(MASS, sticks=True, part=1.02))
    assert verdicts.bound(laid([], alpha=[below, above])).verdict == HOLDS
    assert not verdicts.bound(laid([], alpha=[below, made_up(MASS, sticks=True, part=1.02)])).cases["αλ₁/2 = 1.02"]
    coulomb = [made_up(COMPLETE, part=0.9), made_up(MASS, part=1.1), failed(made_up(MASS, part=0.99))]
    found = verdicts.bound_with_friction(laid([], alpha=coulomb))
    assert found.cases == {"gram complete, αλ₁/2 = 0.9": True, "mass, αλ₁/2 = 0.99": False}
    assert found.figure.endswith("1.1")


def test_the_condensed_form_must_be_the_same_iteration() -> None:
    h = [made_up("uzawa", iterations=100, seconds=1.0), made_up(LIKE["uzawa"], iterations=101, seconds=4.0)]
    assert verdicts.twins_agree(laid(h)).verdict == HOLDS
    h[1] |= {"iterations": 110}
    assert verdicts.twins_agree(laid(h)).cases == {"uzawa: as many iterations": False, "uzawa: less time": True}


def test_methods_that_end_elsewhere_or_nowhere_are_named() -> None:
    assert verdicts.all_agree(laid([made_up(MASS), made_up(IC0)])).verdict == HOLDS
    found = verdicts.all_agree(laid([made_up(MASS), made_up(IC0, lam_max=0.1)]))
    assert found.cases == {"λ": False, "u": True}
    assert "1.0e-01 (block-uzawa, gram ic0, 2D)" in found.figure
    spread = [made_up(MASS, mu=1.0), failed(made_up(MASS, mu=0.05))]
    assert verdicts.always_converges(laid([made_up(MASS)], mu=spread)).cases == {"mass": False}
    assert len(verdicts.side_by_side(laid([made_up(MASS)], mu=[made_up(MASS), *spread]))) == 3


def test_nothing_measured_is_no_verdict() -> None:
    for claim in CLAIMS:
        assert claim.judge(laid([])).verdict == UNKNOWN, claim.says


def test_a_busy_machine_is_admitted() -> None:
    assert "busy" not in conditions(laid([made_up(MASS)]))
    assert "the runs got 50% of a core" in conditions(laid([made_up(MASS, cpu=0.5)]))


def test_few_exceptions_are_named_as_such() -> None:
    assert verdict(Finding({"a": True, "b": True, "c": False}, "")) == "holds, but not for c"
    assert verdict(Finding({"a": True, "b": False, "c": False}, "")) == "holds only for a"


def test_a_failure_is_told_below_its_table(tmp_path: Path) -> None:
    rows = laid(
        [
            made_up(REFERENCE, seconds=2.0),
            made_up(MASS, seconds=9.0),
            failed(made_up(IC0)),
            failed(made_up(DROP), "stopped after 60 s"),
        ]
    )
    text = write_page(tmp_path / NAME, rows).read_text()
    assert "| block-uzawa, mass | 100 | 106 | 9 | 0 | 0.9 | 8.1 | 4.5 |" in text
    assert "| block-uzawa, gram ic0 | fails |" in text
    assert "* block-uzawa, gram ic0 fails: the residual stopped falling" in text
    assert "| block-uzawa, gram drop | stopped after 60 s |" in text
    assert set(SIDE_BY_SIDE) <= set(rows)
    assert chosen(rows["h"], method=MASS)
