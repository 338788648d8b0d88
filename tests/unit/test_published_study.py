"""The study of the published methods: its rows against what is known elsewhere, and its page."""

import csv
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_allclose

from stickslip.workflows.lab.studies.published import claims as u
from stickslip.workflows.lab.studies.published.__main__ import measured
from stickslip.workflows.lab.studies.published.contact import LEARNING, PLAIN, march, scene
from stickslip.workflows.lab.studies.published.finding import HOLDS, HOLDS_NOT, Row, Rows, chosen
from stickslip.workflows.lab.studies.published.measurements import MEASURED, Measurement, Sizes, measurements
from stickslip.workflows.lab.studies.published.page import CLAIMS, claims, write_page

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
    for claim in CLAIMS:
        assert f"| {claim.says} | **{claim.judge(rows).verdict}** |" in page
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
    assert claims(found) in (folder / "published.md").read_text()


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
    assert u.gram_iterations(rows).cases["2D"]


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
    assert u.bound(rows).verdict == HOLDS
    assert u.richardson(rows).verdict == HOLDS
    assert u.inexact_bound(rows).verdict == HOLDS_NOT  # the least favourable delta_k of .3 diverges


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
