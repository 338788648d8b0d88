"""Sides that a box selects: those that lie wholly inside, in every version of gmsh and wherever the body is."""

from pathlib import Path

import pytest

from shared.drawn import GEO, scene_data
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.user_files.parts import find_parts
from stickslip.workflows.scene_file.read import from_dict


def cut_ball(gmsh: Gmsh) -> int:
    """A cap of the unit ball, above z = 1/2, whose dome has no edge but its rim; returns the tag of the flat face."""
    gmsh.model.occ.addSphere(0, 0, 0, 1)
    gmsh.model.occ.rotate([(3, 1)], 0, 0, 0, 1, 0, 0, 1.5707963267948966)  # the sphere's seam goes below
    gmsh.model.occ.addBox(-2, -2, 0.5, 4, 4, 4)
    gmsh.model.occ.intersect([(3, 1)], [(3, 2)])
    gmsh.model.occ.synchronize()
    (flat,) = (tag for _, tag in gmsh.model.getEntities(2) if gmsh.model.getType(2, tag) == "Plane")
    return int(flat)


RIM = {"part.flat": {"box": [-1.0, -1.0, 0.4, 1.0, 1.0, 0.6]}}


def test_a_curved_face_that_leaves_the_box_is_not_taken_though_its_rim_lies_inside() -> None:
    with gmsh_session() as gmsh:
        flat = cut_ball(gmsh)
        assert find_parts(gmsh, 3, True, RIM, 1.0).sides == {"part.flat": [flat]}


@pytest.mark.parametrize("newer", [False, True])
def test_parameters_are_given_to_gmsh_as_such(newer: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """gmsh 4.13 takes coordinates where 4.8 takes parameters, unless it is told."""

    def older_one(dim: int, tag: int, parametricCoord: list[float]) -> int:
        return len(parametricCoord) == dim

    def newer_one(dim: int, tag: int, coord: list[float], parametric: bool = False) -> int:
        return len(coord) == dim if parametric else 0

    with gmsh_session() as gmsh:
        flat = cut_ball(gmsh)
        monkeypatch.setattr(gmsh.model, "isInside", newer_one if newer else older_one)
        assert find_parts(gmsh, 3, True, RIM, 1.0).sides == {"part.flat": [flat]}


def test_a_box_is_as_sharp_far_from_the_origin() -> None:
    with gmsh_session() as gmsh:
        gmsh.model.occ.addBox(1e6, 0, 0, 4, 2, 2)
        gmsh.model.occ.synchronize()
        names = {"part.bottom": {"box": [0.0, -1.0, -1.0, 2e6, 3.0, 1.5]}}
        assert find_parts(gmsh, 3, True, names, 1.0).sides == {"part.bottom": [5]}  # the others end at z = 2


def test_an_axisymmetric_file_does_not_reach_beyond_the_axis_wherever_it_lies(tmp_path: Path) -> None:
    (tmp_path / "b.geo").write_text(GEO.replace("{0, 0, 0, length", "{-1e-4, 1e6, 0, length"))
    with pytest.raises(SceneError, match=r"reaches x = -0\.0001; x is the radius"):
        from_dict(scene_data(tmp_path / "b.geo") | {"model": "axisymmetric"})
