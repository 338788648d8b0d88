"""Bodies of a file that lie in each other are told: how deep, in what volume, and where."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.geometry.errors import SceneError
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.simulation.plan import make_plan, warnings
from stickslip.workflows.commands._contacts import list_contacts, write_scene
from stickslip.workflows.scene_file.read import from_dict

BOXES = """SetFactory("OpenCASCADE"); DefineConstant[ turned = 0 ];
Box(1) = {0, 0, 0, 4, 4, 1}; Box(2) = {0, 0, 0.8, 4, 4, 1};
If (turned > 0)
  Rotate{{1, 1, 0}, {0, 0, 0}, turned} {Volume{1, 2};}
EndIf
"""
BALL = 'SetFactory("OpenCASCADE"); Box(1) = {-2, -2, -1, 4, 4, 1}; Sphere(2) = {0.3, 0.2, 0.8, 1};\n'
FIT = """SetFactory("OpenCASCADE"); DefineConstant[ bore = 1 ];
Cylinder(1) = {0, 0, 0, 0, 0, 4, 1}; Cylinder(2) = {0, 0, 1, 0, 0, 1, 2}; Cylinder(3) = {0, 0, 1, 0, 0, 1, bore};
BooleanDifference(4) = { Volume{2}; Delete; }{ Volume{3}; Delete; };
"""
FEET = """SetFactory("OpenCASCADE");
Box(3) = {0, 0, 0, 10, 10, 1}; Box(4) = {0, 0, 0, 1, 10, 6}; Box(5) = {2, 0, 5, 8, 10, 1};
Box(6) = {4.6, 3.1, 0.97, 0.2, 0.3, 4.5}; Box(7) = {8.6, 7.1, 0.98, 0.2, 0.2, 4.5};
BooleanUnion(1) = { Volume{3}; Delete; }{ Volume{4}; Delete; };
BooleanUnion(2) = { Volume{5}; Delete; }{ Volume{6, 7}; Delete; };
"""
FOOT = """SetFactory("OpenCASCADE"); Rectangle(3) = {0, 0, 0, 10, 1}; Rectangle(4) = {0, 0, 0, 1, 6};
Rectangle(5) = {2, 5, 0, 8, 1}; Rectangle(6) = {4.6, 0.98, 0, 0.05, 4.5};
BooleanUnion(1) = { Surface{3}; Delete; }{ Surface{4}; Delete; };
BooleanUnion(2) = { Surface{5}; Delete; }{ Surface{6}; Delete; };
"""
SHEETS = """SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 4, 1}; Rectangle(2) = {0, 0.9, 0, 4, 1};
Rotate{{0, 0, 1}, {0, 0, 0}, Pi/6} {Surface{1, 2};}
"""


def of(folder: Path, script: str, dim: int = 3, **parameters: Any) -> UserFile:
    word, last = ("Volume", 4 if "bore" in script else 2) if dim == 3 else ("Surface", 2)
    path = folder / "two.geo"
    path.write_text(f'{script}Physical {word}("one") = {{1}};\nPhysical {word}("other") = {{{last}}};\n')
    return UserFile(file=str(path), parameters=parameters)


def test_two_boxes_lie_in_each_other_by_a_slab(tmp_path: Path) -> None:
    (found,) = of(tmp_path, BOXES).overlaps(3)
    assert found.bodies == ("one", "other")
    assert_allclose([found.depth, found.volume], [0.2, 3.2], rtol=1e-6)
    assert_allclose(found.place, [2, 2, 0.9], atol=0.3)
    assert found.said("mm").startswith("one and other lie in each other, up to about 0.2 mm deep at (")
    assert found.said("mm").endswith("), in a volume of about 3.2 mm³")


@pytest.mark.parametrize(
    ("script", "dim", "parameters", "depth", "volume", "within"),
    [
        (
            BOXES,
            3,
            {"turned": 0.5},
            0.2,
            3.2,
            0.15,
        ),  # a way straight through a slab lies 20 degrees off the nearest one
        (BALL, 3, {}, 0.2, np.pi * 0.2**2 * 2.8 / 3, 0.3),  # a cap of facets as an outline has them
        (FIT, 3, {"bore": 0.8}, 0.2, 0.36 * np.pi, 0.15),
        (SHEETS, 2, {}, 0.1, 0.4, 0.05),
        (FEET, 3, {}, 0.03, 0.03 * 0.06 + 0.02 * 0.04, 0.05),  # far smaller than what both boxes have in common
        (FOOT, 2, {}, 0.02, 0.001, 0.05),
        (
            SHEETS.replace("Rectangle(2) = {0, 0.9, 0, 4, 1}", "Disk(2) = {2, 0.5, 0, 0.3}"),
            2,
            {},
            0.6,
            0.09 * np.pi,
            0.05,
        ),
    ],
)
def test_depth_and_volume_are_about_right(
    script: str, dim: int, parameters: dict[str, float], depth: float, volume: float, within: float, tmp_path: Path
) -> None:
    (found,) = of(tmp_path, script, dim, **parameters).overlaps(dim)
    assert_allclose([found.depth, found.volume], [depth, volume], rtol=within)


@pytest.mark.parametrize(
    ("script", "parameters"),
    [
        (FIT, {}),  # a shaft in a bore of its size: only facets lie in each other
        (BOXES.replace("0.8, 4, 4", "1, 4, 4"), {}),  # they touch
        (BOXES + "BooleanFragments{ Volume{1, 2}; Delete; }{}\n", {}),  # in three pieces that share faces
    ],
)
def test_bodies_that_fit_do_not_lie_in_each_other(script: str, parameters: dict[str, float], tmp_path: Path) -> None:
    assert not of(tmp_path, script, **parameters).overlaps(3)


def scene_data(file: str, **tables: Any) -> dict[str, Any]:
    faces = {"one.base": ["face 5"], "one.top": ["face 6"], "other.base": ["face 11"], "other.top": ["face 12"]}
    still = {"x": 0.0, "y": 0.0, "z": 0.0}
    return {
        "model": "3d",
        "geometry": {"file": file, "names": faces},
        "bodies": {"one": {"E": 1.0, "nu": 0.3}, "other": {"E": 1.0, "nu": 0.3}},
        "supports": {"base": {"boundary": "one.base", "displacement": still}},
    } | tables


@pytest.mark.parametrize(
    ("gap", "surface", "says"),
    [
        (None, "base", "; contact pushes them apart"),
        (None, "top", "no contact pushes them apart"),  # which looks the same way as what it is paired with
        (-0.05, "base", "of which the gap of their contact leaves 0.05"),
        (0.0, "base", ""),
    ],
)
def test_plan_and_run_warn_of_what_contact_leaves(gap: float | None, surface: str, says: str, tmp_path: Path) -> None:
    contact = {"surface": f"other.{surface}", "against": "one.top", "friction": {"law": "coulomb", "mu": 0.3}}
    contact |= {} if gap is None else {"gap": gap}
    data = scene_data(of(tmp_path, BOXES).file, contacts={"both": contact})
    data["supports"]["top"] = {"boundary": "other.top", "displacement": {"x": 0.0, "y": 0.0, "z": 0.0}}
    lines = [line for line in warnings(from_dict(data)) if "lie in each other" in line]
    assert len(lines) == bool(says)
    assert all(line.startswith("geometry.file: one and other lie") and line.endswith(says) for line in lines)


def test_a_body_that_nothing_holds_is_told_to_lie_in_another(tmp_path: Path) -> None:
    said = r"nothing resists the translation along x of bodies.other; .*; one and other lie in each other, .*no contact"
    with pytest.raises(SceneError, match=said):
        make_plan(from_dict(scene_data(of(tmp_path, BOXES).file)))


def test_contacts_and_new_tell_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = of(tmp_path, BOXES).file
    list_contacts(file, None, None, None, tmp_path / "pictures")
    assert "one and other lie in each other, up to about 0.2 m deep" in capsys.readouterr().out
    write_scene(Path(file), None, None, None, tmp_path / "two.toml")
    assert "warning: one and other lie in each other, up to about 0.2 m deep" in capsys.readouterr().out
