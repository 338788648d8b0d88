"""The picture of stated and true errors over seconds."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from stickslip.geometry.errors import SceneError
from stickslip.workflows.lab.benchmarks.work_precision import Point, draw, points
from stickslip.workflows.scene_file.read import read

NAME = "base.tangential_force"


def test_stated_errors_are_beside_true_ones_and_fall_with_the_mesh(tmp_path: Path) -> None:
    scene, said = read("raous"), list[str]()
    coarse, fine = points(scene, NAME, (4.0, 2.0), said.append)
    assert len(said) == 2
    for found in (coarse, fine):
        assert 0.7 < found.stated / found.true < 3
        assert found.corrected < 0.5 * found.true
    assert fine.true < 0.4 * coarse.true
    assert fine.unknowns > 3 * coarse.unknowns
    pixels = imread(draw(tmp_path / "drawn.png", scene, NAME, [coarse, fine]))[..., :3]
    for colour in ((0, 114, 178), (213, 94, 0), (0, 158, 115)):  # one curve each
        assert (np.abs(pixels - np.array(colour) / 255).max(axis=-1) < 0.02).sum() > 100


def test_only_what_the_scene_knows_exactly_is_compared() -> None:
    with pytest.raises(SceneError, match=r"exact.values.base.stick_area: the scene does not know it"):
        list(points(read("raous"), "base.stick_area", (4.0,), print))


def test_a_line_says_all_errors() -> None:
    found = Point(unknowns=152, seconds=0.5, stated=0.057, true=0.061, corrected=0.026)
    assert str(found) == ("152 unknowns, 0.50 s: stated by the run 5.7 %, true 6.1 %, of the corrected number 2.6 %")
