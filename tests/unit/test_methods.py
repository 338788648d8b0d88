"""What a method's class says is all that the program knows of it: one new file is a new method, with its keys."""

import os
import pickle
import shutil
import subprocess
import sys
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import pytest

import stickslip
import stickslip.solvers
from stickslip.geometry.errors import SceneError
from stickslip.solvers.method_registry import METHODS, Solver, method_of
from stickslip.solvers.methods.method import keys_of
from stickslip.solvers.scene import settings
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.stepping.choice import Size, chain
from stickslip.workflows.scene_file.read import read, to_dict

ROOT = Path(stickslip.solvers.__file__).parents[2]
NEW = '''
"""Halving: a method that a test adds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.solvers.methods.method import Applicability
from stickslip.solvers.methods.method import Ready, Setup, Turn
from stickslip.solvers.classical.uzawa import Uzawa


@dataclass(frozen=True, kw_only=True)
class Halving(Uzawa):
    NAME: ClassVar = "halving"
    WHEN: ClassVar = "to be tested"
    WORKS_WITH: ClassVar = Applicability(floating=False, matrix_free=False)
    TURNS: ClassVar = (Turn("condensed", 2),)
    ROW: ClassVar = 50

    part: Annotated[float, Key("-", "of a half")] = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.part > 0, "part", self.part, "must be positive")

    def build(self, setup: Setup) -> Ready:
        assert self.part == 0.25
        return super().build(setup)
'''
ASKED = """
import stickslip
from stickslip.solvers.stepping.choice import Size, chain
from stickslip.workflows.lab.pages.method_table import PAGE, renewed
from stickslip.workflows.lab.pages.scene_page import reference
from stickslip.workflows.scene_file.read import to_dict

small = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5", "output.error=false"]
scene = stickslip.read("block", [*small, "solver.method=halving", "solver.part=0.25", "solver.relaxation=1.9"])
first = next(iter(stickslip.prepare(scene).steps()))
assert {row[-1] for row in first.history} == {"halving"}
assert to_dict(scene)["solver"]["part"] == 0.25
assert "| `part` | number | - | 0.5 | of a half |" in reference()
assert "| `halving` | to be tested | all | all | all | held by supports | condensed |" in renewed(PAGE.read_text())
assert "halving (condensed)" in [str(stage) for stage in chain("condensed", Size(2, 1000, 8e4, 100))]
for words, text in (
    (["solver.part=-1"], "solver.part = -1.0: must be positive"),
    (["solver.part=2"], "solver.part = 2.0: solver.method = auto does not use it; use halving"),
):
    try:
        stickslip.prepare(stickslip.read("block", [*small, *words]))
    except stickslip.StickslipError as error:
        assert text in str(error), error
    else:
        raise AssertionError(words)
"""


def test_a_new_method_with_a_key_of_its_own_is_one_new_file(tmp_path: Path) -> None:
    for package in ("geometry", "solvers", "workflows"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "stickslip", tmp_path / "stickslip", symlinks=True)
    shutil.copytree(ROOT / "docs" / "theory", tmp_path / "docs" / "theory")
    (tmp_path / "solvers/methods/halving.py").write_text(NEW)
    done = subprocess.run(
        [sys.executable, "-c", ASKED],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", METHODS)
def test_a_method_is_found_under_its_name_in_a_file_of_its_name(name: str) -> None:
    method = METHODS[name]
    assert name == method.NAME
    assert method.__module__.split(".")[-1] == name.replace("-", "_")
    assert is_dataclass(method)
    assert method.__doc__
    assert {f.name for f in fields(method)} == {"rtol", "max_it", *keys_of(method)}


def test_the_order_is_fixed() -> None:
    assert list(METHODS)[:2] == ["auto", "condensed-newton"]
    assert list(METHODS) == sorted(METHODS, key=lambda name: (METHODS[name].ROW, name))


def test_auto_goes_by_the_turns_of_the_classes() -> None:
    size = Size(2, 1000, 8e4, 100)
    newton = ["condensed-newton (condensed)", "surface-uzawa (condensed)"]
    assert [str(stage) for stage in chain("condensed", replace(size, floating=True))] == newton
    assert [str(stage) for stage in chain("condensed", size)] == [*newton, "nsgs (condensed)"]
    uzawa = ["surface-uzawa (matrix-free)", "surface-uzawa (matrix-free, safer metric)"]
    assert [str(stage) for stage in chain("matrix-free", size)] == uzawa
    body = replace(size, dim=3, floating=True)
    assert [str(stage) for stage in chain("matrix-free", body)] == ["tangent-cg (matrix-free)", *uzawa]
    assert [str(stage) for stage in chain("matrix-free", replace(body, driven=True))] == uzawa


def test_a_method_has_the_settings_of_the_scene() -> None:
    solver = stickslip.Solver(method="uzawa", relaxation=1.9, tolerance=1e-5, max_iterations=7)
    method: Any = method_of(solver)
    assert (method.relaxation, method.rtol, method.max_it, method.alpha) == (1.9, 1e-5, 7, None)


def test_settings_without_keys_of_methods_mean_the_defaults() -> None:
    assert method_of(settings.Solver(method="uzawa")) == method_of(Solver(method="uzawa"))
    scene = replace(read("block"), solver=settings.Solver(method="condensed-newton"))
    assert make_plan(scene)


def test_settings_keep_their_class_when_sent_to_other_ranks() -> None:
    scene = read("block", ["solver.method=uzawa", "solver.relaxation=1.9"])
    again = pickle.loads(pickle.dumps(scene))
    assert again == scene
    assert type(again.solver) is Solver
    assert Solver.__doc__ == settings.Solver.__doc__


def test_a_scene_has_the_keys_of_all_methods_by_default() -> None:
    scene = read("block")
    same = stickslip.Scene(model=scene.model, geometry=scene.geometry, bodies=scene.bodies)
    assert same.solver == Solver()
    assert replace(same.solver, method="regularised", smoothing=1e-3).smoothing == 1e-3
    keys = {key for method in METHODS.values() for key in keys_of(method)}
    assert keys - {"alpha"} <= set(to_dict(scene)["solver"])  # absent by default


def test_unknown_methods_are_refused_by_the_nearest_name() -> None:
    with pytest.raises(SceneError, match=r"method = usawa: did you mean uzawa\?"):
        Solver(method="usawa")
    with pytest.raises(SceneError, match=r"method = usawa: did you mean uzawa\?"):
        make_plan(replace(read("block"), solver=settings.Solver(method="usawa")))
