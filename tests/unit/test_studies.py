"""Studies measure each claim of the literature once, and a verdict follows from the rows."""

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from inspect import isfunction
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.workflows.lab.studies.block_price import claims as verdicts
from stickslip.workflows.lab.studies.block_price import measure
from stickslip.workflows.lab.studies.block_price.__main__ import NAME, conditions
from stickslip.workflows.lab.studies.block_price.__main__ import measured as measured_prices
from stickslip.workflows.lab.studies.block_price.__main__ import write_page as write_price_page
from stickslip.workflows.lab.studies.block_price.claims import SIDE_BY_SIDE, verdict
from stickslip.workflows.lab.studies.block_price.measure import (
    EXACTLY,
    INEXACT,
    LIKE,
    METHODS,
    REFERENCE,
    SMALL,
    Case,
    tables,
)
from stickslip.workflows.lab.studies.block_price.measure import Sizes as PriceSizes
from stickslip.workflows.lab.studies.finding import HOLDS, HOLDS_NOT, UNKNOWN, Finding, Row, Rows, chosen, escaped
from stickslip.workflows.lab.studies.published import claims as c
from stickslip.workflows.lab.studies.published.__main__ import measured, write_page
from stickslip.workflows.lab.studies.published.contact import LEARNING, PLAIN, march, scene
from stickslip.workflows.lab.studies.published.measurements import MEASURED, Measurement, Sizes, measurements

TINY = Sizes(
    meshes=((2, 4), (2, 8)),
    spectra=((2, 4), (2, 8)),
    tangents=((2, 4),),
    at=(2, 4),
    mu=(0.3,),
    omega=(1e2, 1e3),
    inner=(0.3,),
    parts=(0.9, 1.1),
    methods=("condensed-newton", "uzawa", "gram-uzawa"),
    rules=("exact", "worst residual, .3"),
)


def judges(module: ModuleType) -> list[Callable[[Rows], Finding]]:
    """Return the functions that judge a claim."""
    own = [f for f in vars(module).values() if isfunction(f) and f.__module__ == module.__name__]
    return [f for f in own if f.__name__[0] != "_" and f.__annotations__ == {"rows": "Rows", "return": "Finding"}]


def cells(found: Finding, verdict: str) -> str:
    return f"| **{verdict}** | {escaped(found.figure)} |"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("published") / "page"


@pytest.fixture(scope="module")
def rows(folder: Path) -> Rows:
    found = measured(folder, TINY)
    write_page(folder, found)
    return found


def test_the_page_shows_every_study_and_every_claim(folder: Path, rows: Rows) -> None:
    page = (folder / "published.md").read_text()
    for judge in judges(c):
        assert cells(judge(rows), judge(rows).verdict) in page
    assert page.count("\n## ") == 1 + len(MEASURED)
    for name in ("h", "mu", "omega", "spectrum", "tangent"):
        assert f"]({name}.png)" in page
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    for name, found in rows.items():
        with (folder / f"{name}.csv").open() as file:
            assert len(list(csv.DictReader(file))) == len(found) > 0


def test_what_was_measured_is_not_measured_again(folder: Path, rows: Rows, monkeypatch: pytest.MonkeyPatch) -> None:
    lost = next(iter(measurements(TINY)))
    (folder / "rows" / f"{lost.name}.json").unlink()
    called: list[str] = []

    def counting(name: str, whole: Callable[..., list[Row]]) -> Callable[..., list[Row]]:
        return lambda **keys: called.append(name) or whole(**keys)

    again: Mapping[str, Any] = {name: counting(name, whole) for name, whole in MEASURED.items()}
    monkeypatch.setattr("stickslip.workflows.lab.studies.published.measurements.MEASURED", again)
    found = measured(folder, TINY)
    assert called == [lost.study]
    assert found == rows
    page = (folder / "published.md").read_text()
    assert write_page(folder, found).read_text() == page


def test_no_two_measurements_share_a_file() -> None:
    names = [m.name for m in measurements(Sizes())]
    assert len(set(names)) == len(names)


def test_condition_numbers_are_those_of_the_gram_study(rows: Rows) -> None:
    """Orders in h: W^-1 S like 1/h, of the multipliers' Gram matrix h^-3, bounded of the volume's complete factor."""

    def grown(metric: str) -> float:
        small, large = (row["condition"] for row in chosen(rows["spectrum"], metric=metric))
        return float(large / small)

    assert grown(PLAIN) == pytest.approx(2, rel=0.1)
    assert grown("multiplier") == pytest.approx(8, rel=0.15)
    assert grown("volume, complete") < 1.1
    assert grown(LEARNING) < 1.1
    assert grown("volume, IC(0)") > 1.5
    for row in rows["spectrum"]:
        assert row["condition"] == pytest.approx(row["values"][-1] / row["values"][0])
        assert row["values"] == sorted(row["values"])


def test_methods_that_solve_the_same_problem_need_different_effort(rows: Rows) -> None:
    count = {row["method"]: row["iterations"] for row in chosen(rows["h"], dim=2, n=8)}
    assert count["condensed-newton"] < count["gram-uzawa"] < count["uzawa"]
    assert c.gram_iterations(rows).cases["2D"]


def test_the_stated_error_bounds_the_true_one_and_both_fall_like_one_over_omega(rows: Rows) -> None:
    soft, stiff = rows["omega"]
    assert soft["stated"] > soft["error"] > 0
    assert stiff["stated"] > stiff["error"] > 0
    assert soft["error"] / stiff["error"] == pytest.approx(10, rel=0.1)
    # K_C = -W/ω is added to every eigenvalue: the softer the springs, the better the condition
    (rigid,) = chosen(rows["spectrum"], dim=2, n=4, metric=PLAIN)
    assert 1 < soft["condition"] < stiff["condition"] < rigid["condition"] * 1.5


def test_mumps_is_exact_and_gmres_as_exact_as_asked(rows: Rows) -> None:
    for row in rows["tangent"]:
        if row["solver"] == "MUMPS":
            assert row["residual"] < 1e-12
            assert row["ratio"] == 1.0
            assert row["unsymmetry"] > 0 < row["sliding"]
        elif row["status"] == "converged":
            assert row["residual"] <= 1e-7
        else:
            assert row["ratio"] is None


def test_the_bound_of_the_source_is_seen(rows: Rows) -> None:
    assert c.bound(rows).verdict == HOLDS
    assert c.richardson(rows).verdict == HOLDS
    assert c.inexact_bound(rows).verdict == HOLDS_NOT  # the least favourable delta_k of .3 diverges


def test_the_cube_is_dragged_along_both_axes() -> None:
    _, accepted, status = march(scene(3, 2, drag=0.03, method="condensed-newton"))
    assert status == "converged"
    moved = accepted[-1].state.u_s.array.reshape(-1, 3)
    assert_allclose(moved[moved[:, 2] < 0][0], [0.03, 0.015, -0.05])


def test_a_method_that_fails_is_a_row_with_its_words(tmp_path: Path) -> None:
    keys = {"dim": 2, "n": 4, "method": "uzawa", "max_iterations": 3}
    (row,) = Measurement("h", keys).rows(tmp_path)
    assert "the iterations ran out" in row["status"]
    assert "iterations" not in row


MASS, COMPLETE, DROP, IC0 = EXACTLY
TINY_PRICES = PriceSizes(
    meshes=((2, 4),), at=(), methods=(REFERENCE, "uzawa", MASS), parts=(1.1,), inner_at=(), bound_at=(2, 4)
)
LIMIT = 60.0  # s


@pytest.fixture(scope="module")
def prices(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("price") / "block_price"


@pytest.fixture(scope="module")
def price_rows(prices: Path) -> Rows:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measure, "TIMES", 1)  # nothing here depends on seconds
        return measured_prices(prices, TINY_PRICES, LIMIT)


def test_the_page_shows_every_measurement_and_every_verdict(prices: Path, price_rows: Rows) -> None:
    text = write_price_page(prices / NAME, price_rows).read_text()
    for judge in judges(verdicts):
        assert cells(judge(price_rows), verdict(judge(price_rows))) in text
    for row in price_rows["h"]:
        assert f"| {row['method']} | {row['iterations']} | {row['volume_solves']} |" in text
    assert "### 2D, n = 4, 72 unknowns, 9 nodes that can touch" in text


def test_errors_are_those_of_a_tolerance_and_the_same_iteration_is_seen_in_both_forms(price_rows: Rows) -> None:
    newton, condensed, whole = price_rows["h"]
    assert [row["method"] for row in price_rows["h"]] == [REFERENCE, "uzawa", MASS]
    assert abs(whole["iterations"] - condensed["iterations"]) <= 2  # rounding decides the last one
    assert condensed["iterations"] > 50 * newton["iterations"]
    for row in (condensed, whole):
        assert 1e-9 < row["u_error"] < 1e-7  # both stop just below 1e-8
        assert 1e-8 < row["lam_l2"] <= row["lam_max"] < 1e-5
    assert whole["lam_max"] == pytest.approx(condensed["lam_max"], rel=0.1)
    assert newton["u_error"] < 1e-9


def test_above_the_bound_a_glued_base_diverges_and_the_row_says_so(price_rows: Rows) -> None:
    glued, slipping = price_rows["alpha"]
    assert glued["sticks"]
    assert "residual" in glued["status"]
    assert "iterations" not in glued
    assert slipping["status"] == "converged"  # projected and damped by friction
    assert verdicts.bound(price_rows).verdict == HOLDS


def test_measured_prices_are_measured_once(prices: Path, price_rows: Rows, monkeypatch: pytest.MonkeyPatch) -> None:
    lost = tables(TINY_PRICES)["h"][1]
    (prices / "rows" / f"{lost.name}.json").unlink()
    called: list[Case] = []
    monkeypatch.setattr(measure, "measure", lambda case, limit: called.append(case) or {"status": "none"})
    found = measured_prices(prices, TINY_PRICES, LIMIT)
    assert called == [lost]
    assert [row["status"] for row in found["h"]] == ["converged", "none", "converged"]
    assert found["alpha"] == price_rows["alpha"]


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


def test_no_two_measurements_of_prices_share_a_file() -> None:
    for sizes in (PriceSizes(), SMALL):
        cases = {case for table in tables(sizes).values() for case in table}
        assert len({case.name for case in cases}) == len(cases)


@pytest.mark.parametrize(("dim", "axes"), [(2, "xy"), (3, "xyz")])
def test_one_big_step_ends_where_two_do(dim: int, axes: str) -> None:
    case = Case(dim=dim, n=4, method=MASS, mu=0.05, c_n=10.0)
    one, two = replace(case, steps=1).scene(), case.scene()
    assert (one.requested_times(), two.requested_times()) == ((1.0,), (1.0, 2.0))
    ends = [{axis: table[-1][1] for axis, table in s.supports["top"].displacement.items()} for s in (one, two)]
    assert ends[0] == ends[1]
    assert set(ends[0]) == set(axes)
    normal, height = two.contacts["base"].normal, {2: 2.0, 3: 1.0}[dim]
    assert_allclose(normal.c_n * height, 10.0)  # E = 1 Pa


def test_a_name_stands_for_its_keys() -> None:
    solver = Case(dim=2, n=4, method=DROP + INEXACT, rule="bramble-pasciak-vassilev", share=0.1).scene().solver
    told = (solver.method, solver.preconditioner, solver.gram.factor, solver.inner_solves)
    assert told == ("block-uzawa", "gram", "drop", "inexact")
    assert (solver.inner_rule, solver.inner_tolerance) == ("bramble-pasciak-vassilev", 0.1)
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
    return {name: [] for name in tables(PriceSizes(meshes=(), at=()))} | {"h": h} | others


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
    for judge in judges(verdicts):
        assert judge(laid([])).verdict == UNKNOWN, judge


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
    text = write_price_page(tmp_path / NAME, rows).read_text()
    assert "| block-uzawa, mass | 100 | 106 | 9 | 0 | 0.9 | 8.1 | 4.5 |" in text
    assert "| block-uzawa, gram ic0 | fails |" in text
    assert "* block-uzawa, gram ic0 fails: the residual stopped falling" in text
    assert "| block-uzawa, gram drop | stopped after 60 s |" in text
    assert set(SIDE_BY_SIDE) <= set(rows)
    assert chosen(rows["h"], method=MASS)


EMPTY: Rows = {name: [] for name in MEASURED}


def part(value: float, measured: float, exact: bool = True) -> Row:
    inner = "exact" if exact else "inexact"
    return {"C": "0", "inner": inner, "exact": exact, "part": value, "measured": measured, "theory": 0.98}


def mesh(n: int, **more: Any) -> Row:
    return {"dim": 2, "n": n, "status": "converged"} | more


def counted(method: str, *iterations: int) -> list[Row]:
    return [mesh(4 * 2**i, method=method, iterations=count) for i, count in enumerate(iterations)]


def spectra(metric: str, *conditions: float) -> Rows:
    return {"spectrum": [mesh(4 * 2**i, metric=metric, condition=c) for i, c in enumerate(conditions)]}


def inner(iterations: int) -> Rows:
    keys = {"method": "inexact-uzawa", "inner_rule": "elman-golub", "inner_tolerance": 0.3}
    counts = {"iterations": iterations, "linear_iterations": 5, "volume_solves": 10}
    return {"inner": [mesh(4, **keys, **counts)], "h": counted("uzawa", 100)}


def falling(*factors: float) -> Rows:
    history = np.cumprod(np.repeat([1.0, *factors], 20)).tolist()
    return {"chen": [mesh(4, outer_metric="jacobian", iterations=len(history), history=history)]}


def system(solver: str, n: int = 8, **more: Any) -> Row:
    found = mesh(n, mu=0.3, omega_factor=1e3, form="displacements", solver=solver, iterations=10, ratio=1.0, error=1e-6)
    about = dict(condition=1e5, unsymmetry=0.1, fill=3.0, error=1e-10, residual=1e-15, iterations=None)
    return found | (about if solver == c.DIRECT else {}) | more


def systems(*found: Row) -> Rows:
    return {"tangent": list(found)}


def beside(first: str, solver: str, *ways: Row) -> list[Rows]:
    """One system, solved in two ways, each time by the first solver and by another one."""
    return [systems(system(first), system(solver, **way)) for way in ways]


def two(solver: str, key: str, name: str, *pairs: tuple[Any, Any]) -> list[Rows]:
    """Two systems that differ in n or ω, and in a number."""
    at = (8, 16) if key == "n" else (1e2, 1e4)
    return [systems(*(system(solver, **{key: at[i], name: pair[i]}) for i in (0, 1))) for pair in pairs]


def bounded(below: str, above: str, friction: str) -> Rows:
    found = [{"friction": friction, "part": 0.9, "status": below}, {"friction": friction, "part": 1.1, "status": above}]
    return {"step": found, "linear": []}


def springs(*errors: float, stated: float = 1.0) -> Rows:
    rows = [{"omega_factor": 10.0 ** (i + 1), "status": "converged", "error": e} for i, e in enumerate(errors)]
    return {"omega": [row | {"stated": stated} for row in rows]}


def ended(key: str, status: str) -> Rows:
    return {key: [mesh(8, method="uzawa", mu=0.3, iterations=3) | {"status": status}]}


OK, BAD = "converged", "the iterations ran out"
RELAXED, STABILISED = f"{c.RELAXED}0.9", f"{c.STABILISED}0.01"
FLIPS: list[tuple[Callable[[Rows], Finding], Rows, Rows]] = [
    (c.bound, {"linear": [part(0.99, 0.98), part(1.01, 1.02)], "step": []}, {"linear": [part(0.99, 1.02)], "step": []}),
    (c.bound, bounded(OK, BAD, "stick"), bounded(OK, OK, "stick")),
    (c.bound_with_friction, bounded(OK, OK, "coulomb"), bounded(BAD, OK, "coulomb")),
    (c.richardson, {"linear": [part(0.99, 0.981)]}, {"linear": [part(0.99, 0.9)]}),
    (c.inexact_bound, {"linear": [part(0.9, 0.99, False)]}, {"linear": [part(0.9, 1.01, False)]}),
    (c.inexact_contact, inner(105), inner(120)),
    (c.superlinear, falling(0.9, 0.4), falling(0.9, 0.9)),
    (c.condition_grows, spectra(PLAIN, 10, 20, 40), spectra(PLAIN, 10, 11, 10)),
    (c.gram_is_free_of_h, spectra("volume, complete", 9.4, 9.5), spectra("volume, complete", 9.4, 12)),
    (c.gram_iterations, {"h": counted("gram-uzawa", 80, 82)}, {"h": counted("gram-uzawa", 80, 120)}),
    (
        c.gram_saves,
        {"h": [*counted("gram-uzawa", 50), *counted("uzawa", 100)]},
        {"h": [*counted("gram-uzawa", 150), *counted("uzawa", 100)]},
    ),
    (c.any_friction, ended("mu", OK), ended("mu", BAD)),
    (c.given_friction, ended("given", OK), ended("given", BAD)),
    (c.quadratic, {"newton": [mesh(4, history=[1, 1e-4, 1e-7])]}, {"newton": [mesh(4, history=[1, 1e-4, 1e-5])]}),
    (c.first_order, springs(1e-1, 1e-2), springs(1e-1, 3e-2)),
    (c.stated, springs(0.9, 0.1), springs(1.1, 1.2)),
    (c.unsymmetric, systems(system(c.DIRECT)), systems(system(c.DIRECT, unsymmetry=1e-17))),
    (c.ill_conditioned, *two(c.DIRECT, "n", "condition", (1e5, 4e5), (1e5, 1.1e5))),
    (c.direct_is_slow, *beside(c.DIRECT, c.INCOMPLETE, {"ratio": 0.5}, {"ratio": 2.0})),
    (c.direct_is_wrong, systems(system(c.DIRECT, error=1e-3)), systems(system(c.DIRECT))),
    (c.classical_is_slow, *beside(c.DIRECT, c.CLASSICAL, {"status": "diverged"}, {})),
    (c.relaxed, *beside(c.INCOMPLETE, RELAXED, {"iterations": 9}, {"iterations": 11})),
    (c.stabilised, *beside(c.INCOMPLETE, STABILISED, {"iterations": 9}, {"status": "broke down"})),
    (c.ilu_is_free_of_h, *two(c.INCOMPLETE, "n", "iterations", (20, 20), (20, 40))),
    (c.ilu_stands_penalties, *two(c.INCOMPLETE, "omega_factor", "iterations", (20, 19), (20, 30))),
    (c.ilu_stands_penalties, *two(c.INCOMPLETE, "omega_factor", "error", (1e-6, 1e-4), (1e-6, 1e-2))),
    (
        c.quadratic,
        {"newton": [mesh(4, history=[1e-5, 1e-11, 1e-16])]},
        {"newton": [mesh(4, history=[1e-5, 2e-7, 1e-9])]},
    ),
]


@pytest.mark.parametrize(("judge", "so", "otherwise"), FLIPS, ids=lambda x: getattr(x, "__name__", ""))
def test_a_verdict_follows_from_the_rows(judge: Callable[[Rows], Finding], so: Rows, otherwise: Rows) -> None:
    assert judge({**EMPTY, **so}).verdict == HOLDS
    assert judge({**EMPTY, **otherwise}).verdict == HOLDS_NOT


def test_every_claim_is_tried_both_ways_and_none_is_decided_without_rows() -> None:
    assert set(judges(c)) == {judge for judge, *_ in FLIPS}
    assert {judge(EMPTY).verdict for judge in judges(c)} == {UNKNOWN}


def test_a_claim_that_holds_in_some_cases_says_in_which() -> None:
    both: Rows = {**EMPTY, "mu": [*ended("mu", OK)["mu"], *({"method": "other", **ended("mu", BAD)["mu"][0]},)]}
    both["mu"][1]["method"] = "other"
    assert c.any_friction(both).verdict == "holds only for uzawa"
