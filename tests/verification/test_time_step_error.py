"""The error that the time steps leave, as it is stated, against the true one: the same scene in 16 times the steps."""

from dataclasses import replace

import numpy as np
import pytest

from shared.histories import PUSHED
from stickslip.solvers.results.step_result import Quantity, quantities
from stickslip.solvers.scene.settings import Steps
from stickslip.solvers.simulation.simulation import prepare
from stickslip.workflows.scene_file.read import read

SIZES = ["geometry.order=1", "geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.01"]
CASES = {
    "half_disc": (
        "half_disc",
        [*SIZES, *PUSHED, "steps.count=10"],
    ),  # 5 steps and 5: the first three of each become one
    "axisymmetric": (
        "axisymmetric",
        [*SIZES[:2], "geometry.contact_mesh_size=0.02", "steps.count=4"],
    ),  # dissipation is 1.7 times too large
    "hysteresis": ("hysteresis", ["geometry.mesh_size=0.1", "steps.end=6", "steps.count=12"]),  # 2, 2, 4, 4 steps
    "alone": ("hysteresis", ["geometry.mesh_size=0.1", "steps.end=6", "steps.count=3"]),  # one step between two turns
}
LOST, STUCK, WORK = "dissipation_total", "stick_area", "external"
EXPECTED = {"half_disc": (LOST, STUCK), "axisymmetric": (LOST, STUCK, WORK)}  # a strip's friction is exact
LARGE = 0.01  # of the largest value; smaller errors are those of single nodes that slip a step earlier or later


LONG = ("half_disc", "hysteresis")


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in LONG else n for n in CASES])
def test_stated_errors_are_of_the_size_of_the_true_ones(name: str) -> None:
    scene = read(*CASES[name])
    simulation = prepare(scene)
    finer = prepare(replace(scene, steps=Steps(end=scene.steps.end, count=16 * scene.steps.count)))
    steps, exact = [*simulation.steps()], {round(step.time, 9): quantities(step) for step in finer.steps()}
    (contact,) = scene.contacts
    touching = Quantity("contacts", contact, "contact_area")
    turns, judged = scene.timeline().turns, dict.fromkeys((LOST, STUCK, WORK), 0)
    for step, its in zip(steps, simulation.time_step_errors(steps), strict=True):
        found = quantities(step)
        for what in (LOST, WORK, STUCK) if step.time in turns else (LOST, WORK):  # areas jump by nodes
            key = Quantity("energy", "", what) if what == WORK else Quantity("contacts", contact, what)
            known = [values[touching if what == STUCK else key] for values in exact.values()]
            true = abs(found[key] - exact[round(step.time, 9)][key])
            if true > LARGE * np.abs(known).max():
                assert 0.7 * true < its[key].time_step < 3 * true, (step.time, what)
                judged[what] += 1
    assert {what for what, count in judged.items() if count} >= set(EXPECTED.get(name, (WORK,)))
