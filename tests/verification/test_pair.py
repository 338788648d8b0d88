"""Two bodies with friction, turned as a whole: nothing that has no direction changes."""

import numpy as np
import pytest

from stickslip.geometry.arrays import Array
from stickslip.solvers.results.step_result import SLIP, STICK
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.system.system import System
from stickslip.workflows.lab.verification.cases import pair as pair_case
from stickslip.workflows.lab.verification.cases.pair import GRADED, SCENES, steps_of, turned
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.prepared import system_of


@pytest.mark.parametrize("name", SCENES)
def test_turning_two_bodies_changes_nothing_without_a_direction(name: str) -> None:
    assert not failures(turned(name, "condensed-newton"))


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in SCENES if name not in GRADED])
def test_turning_changes_nothing_for_uzawa_either(name: str) -> None:
    assert not failures(turned(name, "uzawa"))


@pytest.mark.parametrize("name", [name for name in SCENES if name != "balls"])
def test_scenes_have_parts_that_stick_and_parts_that_slip(name: str) -> None:
    status = steps_of(SCENES[name]("condensed-newton"), np.eye(3))[1].contacts["joint"].status
    assert {SLIP, STICK} <= set(status.tolist())


def test_checks_notice_a_drive_that_was_not_turned(monkeypatch: pytest.MonkeyPatch) -> None:
    def only_nodes(scene: Scene, Q: Array) -> System:
        return system_of(scene, lambda points: points @ Q.T)

    monkeypatch.setattr(pair_case, "turned_system", only_nodes)
    checks = turned("blocks", "condensed-newton")
    assert len(failures(checks)) == len(checks)
