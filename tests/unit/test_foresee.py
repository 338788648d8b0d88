"""What accuracy will cost, from coarse versions that are made up, and from solved ones."""

from dataclasses import replace

import numpy as np
import pytest

from stickslip.geometry.errors import SceneError
from stickslip.solvers.simulation.simulation import prepare
from stickslip.workflows.cost.foresee import ASKED, Coarse, Known, coarse_versions, foresee, mesh_error, price, rows
from stickslip.workflows.cost.run_record import RATIO
from stickslip.workflows.scene_file.read import read

NAME = "base.normal_force"


def made_up(level: int, mesh: float, time_step: float = 0.0, setup: float | None = None) -> Coarse:
    cells = RATIO ** (2 * level)
    known = {NAME: Known(1.0, mesh, time_step)}
    return Coarse(level, int(1000 * cells), 2, 0.1 + cells if setup is None else setup, 0.01 + 0.1 * cells, known)


def test_errors_follow_the_observed_power_and_seconds_the_cells() -> None:
    found = [made_up(level, 0.1 * RATIO ** (-1.3 * level)) for level in range(-4, 3)]
    assert mesh_error(found, NAME, 6) == pytest.approx(0.1 * RATIO ** (-1.3 * 6))
    one = price(found, NAME, 0.01, dim=2)
    assert one is not None
    level = np.log(10) / (1.3 * np.log(RATIO))  # a tenth of the error at level 0
    assert one.factor == pytest.approx(RATIO**-level, rel=0.2)
    assert one.seconds == pytest.approx(1.2 / one.factor**2, rel=0.3)
    assert (one.splits, one.far) == (1, False)


def test_an_error_that_changes_its_sign_is_no_luck() -> None:
    errors = {-4: 0.1, -3: 0.08, -2: 1e-5, -1: 0.05, 0: 0.04}
    lucky = [made_up(level, error) for level, error in errors.items()]
    plain = [made_up(level, error if error > 1e-3 else 0.05) for level, error in errors.items()]
    assert mesh_error(lucky, NAME, 4) == mesh_error(plain, NAME, 4)


def test_steps_are_split_where_they_are_what_is_wrong() -> None:
    found = [made_up(level, 1e-5, time_step=0.018) for level in (-4, -3, -2)]
    one = price(found, NAME, 0.01, dim=2)
    assert one is not None
    assert (one.splits, one.factor) == (2, RATIO**4)


def test_what_is_far_or_beyond_all_is_said() -> None:
    found = [made_up(level, 0.02 * RATIO ** (-1.0 * level)) for level in (-4, -3, -2)]
    (row,) = rows(found, dim=2)
    assert [each is not None and each.far for each in row.prices] == [False, False, True]
    endless = [replace(one, numbers={NAME: Known(1.0, why_not="grows")}) for one in found]
    assert rows(endless, 2)[0].prices == (None,) * len(ASKED)
    assert price([made_up(-4, 1e-9, time_step=1e9)], NAME, 0.1, 2) is None


def test_the_block_is_as_accurate_as_was_foreseen() -> None:
    """Coarser versions are enough to tell with which mesh an error of .2 % is reached."""
    scene = read("block", ["output.pictures=false"])
    found = [one for one, _ in zip(coarse_versions(scene, 60.0), range(3), strict=False)]
    assert [one.level for one in found] == [-4, -3, -2]
    one = price(found, NAME, 0.002, dim=2)
    assert one is not None
    shape = replace(scene.geometry.refined(one.factor), order=1)  # type: ignore[type-var]
    simulation = prepare(replace(scene, geometry=shape))
    steps = list(simulation.steps())
    errors = {str(key): parts for key, parts in simulation.errors(steps)[-1].items()}
    reached = errors[f"contacts.{NAME}"].total / steps[-1].contacts["base"].normal_force
    assert 0.5 < reached / 0.002 < 1.5


def test_scenes_without_a_size_or_a_contact_are_refused() -> None:
    scene = read("block")
    with pytest.raises(SceneError, match="there is none, and of its numbers the prices are told"):
        foresee(replace(scene, contacts={}))
