"""What straight facets leave out of bodies with curved surfaces, against closed forms: volumes, weights, areas."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import every_nth
from shared.drawn import scene_data
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.solvers.accuracy.facet_volume_correction import LeftOut, rim_of
from stickslip.solvers.accuracy.two_level import MeshCorrection
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import prepare
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict, read

R, H, HOLE = 1.0, 0.5, 0.4
Draw = Callable[[Any], None]
DOWN = 3.0


def disc(occ: Any) -> None:
    occ.addCylinder(0, 0, 0, 0, 0, H, R)


def holed(occ: Any) -> None:
    """A block with a hole through it from the top to the bottom."""
    box, hole = occ.addBox(-1, -1, 0, 2, 2, H), occ.addCylinder(0, 0, 0, 0, 0, H, HOLE)
    occ.cut([(3, box)], [(3, hole)])


def plate(occ: Any) -> None:
    """A plane body with a round hole."""
    occ.cut([(2, occ.addRectangle(-1, 0, 0, 2, 2))], [(2, occ.addDisk(0, 1, 0, HOLE, HOLE))])


def dome(occ: Any) -> None:
    """A quarter of a disc, whose revolution is half a ball on its flat side."""
    occ.intersect([(2, occ.addRectangle(0, 0, 0, R, R))], [(2, occ.addDisk(0, 0, 0, R, R))])


SHAPES: dict[str, tuple[Draw, str, float, float, float]] = {  # model; volume; area of the base, of the top
    "disc": (disc, "3d", np.pi * R**2 * H, np.pi * R**2, np.pi * R**2),
    "holed": (holed, "3d", (4 - np.pi * HOLE**2) * H, 4 - np.pi * HOLE**2, 4 - np.pi * HOLE**2),
    "plate": (plate, "plane strain", 4 - np.pi * HOLE**2, 2.0, 2.0),
    "dome": (dome, "axisymmetric", 2 / 3 * np.pi * R**3, np.pi * R**2, 0.0),
}


def scene(shape: str, tmp_path: Path, **tables: Any) -> Scene:
    """A body under its weight on a frictionless floor, held against moving sideways only."""
    draw, model, *_ = SHAPES[shape]
    dim = 3 if model == "3d" else 2
    with gmsh_session() as gmsh:
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "b.brep"))
    low, high = [-2.0, -1e-3, -1.0], [2.0, 1e-3, 1.0]
    if dim == 3:
        low, high = [-2.0, -2.0, -1e-3], [2.0, 2.0, 1e-3]
    top = [*low[: dim - 1], (H if dim == 3 else 2.0) - 1e-3, *low[dim:]], [*high[: dim - 1], 2.1, *high[dim:]]
    names = {"part.base": {"box": [*low, *high]}} | (
        {"part.top": {"box": [*top[0], *top[1]]}} if shape != "dome" else {}
    )
    size = 0.3 if shape == "holed" else 0.4
    data = scene_data(tmp_path / "b.brep", dim, "part", mesh_size=size, names=names)
    data["contacts"]["base"] = {"surface": "part.base", "against": "foundation"}
    data |= {"model": model, "supports": {}, "bodies": {"part": {"E": 1e4, "nu": 0.3, "density": 1.0}}}
    data["gravity"] = {"acceleration": [0.0] * (dim - 1) + [-DOWN]}
    if model != "axisymmetric":
        data["contacts"]["base"]["friction"] = {"law": "coulomb", "mu": 0.3}
    return from_dict(data | tables)


def base_of(found: Scene, folder: Path) -> dict[str, Any]:
    """The contact after the last step, as result.json has it."""
    return dict(run(found, folder)[1]["steps"][-1]["contacts"]["base"])


@pytest.mark.parametrize("shape", every_nth(2, SHAPES))
def test_weight_and_area_are_off_by_what_is_stated(shape: str, tmp_path: Path) -> None:
    _, model, volume, area, _ = SHAPES[shape]
    base = base_of(scene(shape, tmp_path), tmp_path / "out")
    for name, exact in (("normal_force", DOWN * volume), ("contact_area", area)):
        off, error = abs(base[name] - exact), base["error"][name]
        if model != "3d" and name == "contact_area":
            assert off < 1e-9  # its ends are nodes
            continue
        assert off > 0.002 * exact
        assert 1.3 * off < error["total"] < 2 * off
        assert error["geometry"] > 0.99 * error["total"]
        assert abs(error["corrected"] - exact) < 0.1 * off


@pytest.mark.parametrize(("shape", "load"), every_nth(2, ["disc", "holed"], ["pressure", "traction", "force"]))
def test_pressure_acts_on_the_rim_too_and_a_force_is_what_it_is(shape: str, load: str, tmp_path: Path) -> None:
    top = SHAPES[shape][4]
    value = {"pressure": 7.0}.get(load, {"z": -7.0})
    still = {"gravity": {"acceleration": [0.0, 0.0, 0.0]}}
    base = base_of(
        scene(shape, tmp_path, loads={"lid": {"boundary": "part.top", load: value}}, **still), tmp_path / "out"
    )
    error = base["error"]["normal_force"]
    if load == "force":
        assert_allclose([base["normal_force"], error["corrected"]], 7.0, rtol=1e-6)
        assert error["total"] < 1e-6
    else:
        off = abs(base["normal_force"] - 7.0 * top)
        assert off > 0.01 * 7.0
        assert abs(error["corrected"] - 7.0 * top) < 0.1 * off


def test_a_body_without_curved_sides_pays_nothing() -> None:
    simulated = prepare(read("block", ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=0.5"]))
    assert not simulated.mesh.bulging
    assert isinstance(simulated.stepper.companion, MeshCorrection)
    assert simulated.stepper.companion._left_out is None


def test_rims_fill_the_circle_and_empty_the_hole(tmp_path: Path) -> None:
    for shape in ("disc", "holed"):
        system = prepare(scene(shape, tmp_path)).system
        (rows,) = system.contacts
        rim = rim_of(rows.surface, system.mesh.bulging)
        area = float(rows.surface.node_weights().sum())
        exact = SHAPES[shape][3]
        assert abs(area + rim.sum() - exact) < 0.05 * abs(area - exact)


def test_stiffness_and_weight_grow_by_what_is_left_out(tmp_path: Path) -> None:
    system = prepare(scene("disc", tmp_path)).system
    left_out, whole = LeftOut(system), system.load(1.0)
    weight, more = (float(f.array[2::3].sum()) for f in (whole, left_out.load(1.0)))
    exact = -DOWN * SHAPES["disc"][2]
    assert abs(weight + more - exact) < 0.05 * abs(weight - exact)
    stretched = system.vector()
    stretched.array[2::3] = system.nodes.points[: system.nodes.owned, 2]  # eps_zz = 1
    energy, added = stretched.dot(system.K * stretched), stretched.dot(left_out.inner(stretched, np.zeros(0)))
    assert_allclose(added / energy, more / weight, rtol=1e-9)


def test_drawn_bolts_have_the_section_of_their_mesh(tmp_path: Path) -> None:
    bolt = {"body": "part", "shank": [[0.0, 0.0, 0.1], [0.0, 0.0, 0.4]], "force": 1.0}
    system = prepare(scene("disc", tmp_path, bolts={"stud": bolt})).system
    stretched = system.vector()
    stretched.array[2::3] = system.nodes.points[: system.nodes.owned, 2]
    assert LeftOut(system).inner(stretched, np.ones(1)).norm() == 0
