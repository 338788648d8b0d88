"""The benchmark of discrete problems: our methods, and Siconos's solvers where they are installed."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from shared.discrete import ONE, local, random_problem, write
from stickslip.solvers.interface.discrete import DiscreteProblem, discrete_problem
from stickslip.workflows.lab.benchmarks import discrete
from stickslip.workflows.pictures.performance_profile import ratios


def problem_of(case: str = "slips") -> DiscreteProblem:
    return discrete_problem(sparse.identity(3, format="csr"), np.array(ONE[case][0]), np.array([0.5]))


def test_an_answer_counts_only_if_our_residual_says_so() -> None:
    problem = problem_of()
    right = np.array(ONE["slips"][1]) / problem.scales[0]
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
