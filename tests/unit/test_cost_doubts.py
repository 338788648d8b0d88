"""Studies of accuracy do not claim what they do not know: values that are mostly equal, and time steps."""

from dataclasses import replace

import pytest

from stickslip.workflows.cost.extrapolation import limit, rate_of
from stickslip.workflows.cost.progress import _of_steps
from stickslip.workflows.cost.run_record import PHASES, Run, Rung
from stickslip.workflows.cost.study import Study, Truth
from stickslip.workflows.cost.tables import _quantity, sentence

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
    assert rate is not None
    assert rate > 1.0


def study_of(time_steps: dict[str, float], exact: bool = False, error: float = 1e-3) -> Study:
    truth = Truth(NAME, 2.0, 1e-4, "a book", 2.0, exact=exact)
    phases = dict.fromkeys(PHASES, 1.0)
    told = {"status": "converged", "h": 0.1, "phases": phases, "quantities": {NAME: 2.0 * (1 + error)}}
    run = Run(rung=Rung(1, "newton", 0, 1e-8), time_steps=time_steps, **told)  # type: ignore[arg-type]
    return Study(truth, (run, replace(run, rung=Rung(1, "newton", 1, 1e-8), time_steps={})), 1e-8)


@pytest.mark.parametrize("error", [1e-3, 1e-5, 0.1])
def test_an_error_of_the_time_steps_that_nobody_measured_is_not_0(error: float) -> None:
    said = "the error of the time steps is not known"
    unknown = study_of({}, error=error)
    assert unknown.time_step is None
    assert _quantity(unknown)["time_step"] is None
    assert sentence(unknown).endswith(f"; {said}.")
    assert _of_steps(unknown) == "-"
    for known, shown in ((study_of({NAME: 0.0}, error=error), "0 %"), (study_of({NAME: 2e-4}, error=error), "0.01 %")):
        assert known.time_step == pytest.approx(known.runs[0].time_steps[NAME] / 2.0)
        assert said not in sentence(known)
        assert _of_steps(known) == shown
    exact = study_of({}, exact=True, error=error)
    assert exact.time_step == 0
    assert said not in sentence(exact)
