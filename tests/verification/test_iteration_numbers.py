"""What the iteration leaves in each number is stated in the number's own unit, wherever the bodies are."""

from pathlib import Path

import numpy as np
import pytest

from stickslip.solvers.results.step_result import Quantity, StepResult, quantities
from stickslip.solvers.scene.record import Value
from stickslip.solvers.simulation.simulation import prepare
from stickslip.workflows.scene_file.read import read

FAR = """
h = 0.5;
Point(1) = {X, 0, 0, h}; Point(2) = {X + 4, 0, 0, h}; Point(3) = {X + 4, 2, 0, h}; Point(4) = {X, 2, 0, h};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Physical Surface("block") = {1}; Physical Curve("block.bottom") = {1}; Physical Curve("block.top") = {3};
"""
LOOSE = ('solver.method="surface-uzawa"', "solver.tolerance=1e-2")
EXACT = ('solver.method="condensed-newton"', "solver.tolerance=1e-12")


def steps_of(scene: str, words: tuple[str, ...]) -> list[StepResult]:
    return list(prepare(read(scene, words)).steps())


def stated_and_true(scene: str, words: tuple[str, ...]) -> list[tuple[Quantity, Value, Value]]:
    """Of each number of each step, its name, the stated and the true error of a loose tolerance."""
    found = []
    for loose, exact in zip(steps_of(scene, (*words, *LOOSE)), steps_of(scene, (*words, *EXACT)), strict=True):
        expected = quantities(exact)
        for key, value in quantities(loose).items():
            stated = loose.errors[str(key)].iteration
            assert stated is not None
            found.append((key, stated, np.abs(value - expected[key])))
    return found


@pytest.mark.parametrize(
    ("scene", "words", "kind", "quantity", "most"),
    [
        ("lap_joint", ("geometry.mesh_size=0.005", "steps.count=4"), "bolts", "tension", 3e5),
        ("sledge", ("geometry.mesh_size=0.04", "steps.count=2"), "remote_points", "rotation", 1e-4),
    ],
)
def test_tensions_and_rotations_are_no_energies(
    scene: str, words: tuple[str, ...], kind: str, quantity: str, most: float
) -> None:
    found = [case for case in stated_and_true(scene, words) if (case[0].kind, case[0].quantity) == (kind, quantity)]
    assert len(found) > 1
    for key, stated, true in found:
        assert np.all(stated >= true), key
        assert np.all(stated < most), key  # not far too large


@pytest.mark.parametrize("x", [0.0, 1000.0])
def test_moments_about_a_far_origin_have_the_lever_of_the_bodies(x: float, tmp_path: Path) -> None:
    (tmp_path / "far.geo").write_text(FAR.replace("X", str(x)))
    (tmp_path / "far.toml").write_text(
        'model = "plane strain"\n[geometry]\nfile = "far.geo"\n[bodies.block]\nE = 1.0\nnu = 0.3\n'
        '[obstacles.ground]\nshape = "plane"\npoint = [0.0, 0.0]\nnormal = [0.0, 1.0]\n'
        '[contacts.base]\nsurface = "block.bottom"\nagainst = "ground"\nfriction = { law = "coulomb", mu = 0.3 }\n'
        '[supports.top]\nboundary = "block.top"\ndisplacement = { x = [[0, 0], [1, 0], [2, 0.05]], y = -0.1 }\n'
        "[steps]\nend = 2.0\ncount = 2\n"
    )
    found = [case for case in stated_and_true(str(tmp_path / "far.toml"), ()) if case[0].quantity == "moment"]
    assert {key.kind for key, *_ in found} == {"contacts", "supports", "obstacles"}
    for key, stated, true in found:
        assert np.all(stated >= true), key
