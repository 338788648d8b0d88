"""Relatives of users' geometries, of other dimensions, orders and methods, with closed forms and patch tests."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit, solved
from shared.cases import slow
from stickslip import StepResult
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.workflows.scene_file.read import from_dict

Tables = dict[str, Any]
COULOMB = {"law": "coulomb", "mu": 0.2}


def last(data: Tables, folder: Path) -> StepResult:
    """The last step, in balance."""
    simulation, steps = solved(from_dict(data, folder))
    defects = audit(simulation, steps[-1])
    assert max(value for name, value in defects.items() if name != "fields") < 1e-6, defects
    return steps[-1]


RING = """
DefineConstant[ a = 0.05 ];
Point(1) = {0, 0, 0}; Point(2) = {a, 0, 0}; Point(3) = {0, a, 0}; Point(4) = {1, 0, 0}; Point(5) = {0, 1, 0};
Circle(1) = {2, 1, 3}; Circle(2) = {4, 1, 5}; Line(3) = {2, 4}; Line(4) = {3, 5};
Curve Loop(1) = {3, 2, -4, -1}; Plane Surface(1) = {1}; Physical Surface("ring") = {1};
Physical Curve("ring.bore") = {1}; Physical Curve("ring.x") = {3}; Physical Curve("ring.y") = {4};
"""  # of gmsh's own kernel, with an arc that is small against the whole


@pytest.mark.parametrize("size", [0.02, *slow(0.01, 0.005)])
def test_a_small_bore_on_a_rigid_pin_has_the_pressure_of_lame(size: float, tmp_path: Path) -> None:
    (tmp_path / "ring.geo").write_text(RING)
    planes = {side: {"boundary": f"ring.{side}", "displacement": {axis: 0.0}} for side, axis in ("xy", "yx")}
    scene = {
        "model": "plane stress",
        "geometry": {"file": "ring.geo", "mesh_size": 0.2, "contact_mesh_size": size, "order": 2},
        "bodies": {"ring": {"E": 1e5, "nu": 0.3}},
        "obstacles": {"pin": {"shape": "cylinder", "point": [0.0, 0.0], "radius": 0.0501}},
        "contacts": {"fit": {"surface": "ring.bore", "against": "pin"}}, "supports": planes,
    }  # fmt: skip
    fit = last(scene, tmp_path).contacts["fit"]
    force = 1e5 * 1e-4 / 0.05 / ((1 + 0.05**2) / (1 - 0.05**2) + 0.3) * 0.05 * np.pi / 2
    assert_allclose(fit.normal_force, force, rtol=2e-3)


PENNY = """
Point(1) = {0, 0, 0, h}; Point(2) = {1, 0, 0, h}; Point(3) = {3, 0, 0, 1}; Point(4) = {3, 3, 0, 1};
Point(5) = {0, 3, 0, 1}; Point(6) = {3, -3, 0, 1}; Point(7) = {0, -3, 0, 1}; Point(8) = {0, 0, 0, h};
Line(1) = {1, 2}; Line(2) = {8, 2}; Line(3) = {2, 3}; Line(4) = {3, 4}; Line(5) = {4, 5}; Line(6) = {5, 1};
Line(7) = {3, 6}; Line(8) = {6, 7}; Line(9) = {7, 8};
Curve Loop(1) = {1, 3, 4, 5, 6}; Plane Surface(1) = {1}; Curve Loop(2) = {2, 3, 7, 8, 9}; Plane Surface(2) = {2};
Physical Surface("rock") = {1, 2}; Physical Curve("rock.above") = {1}; Physical Curve("rock.below") = {2};
Physical Curve("rock.top") = {5}; Physical Curve("rock.bottom") = {8};
"""  # a cylinder with a crack across its axis, which reaches to half a third of its radius


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("h", [0.3, *slow(0.15, 0.08)])
@pytest.mark.parametrize(
    "solver",
    [{"method": "condensed-newton"}, {"method": "surface-uzawa", "surface": "matrix-free"}, {"method": "tangent-cg"}],
)
def test_a_crack_of_the_shape_of_a_penny_passes_a_pressure_on(
    solver: Tables, h: float, order: int, tmp_path: Path
) -> None:
    (tmp_path / "penny.geo").write_text(f"h = {h};{PENNY}")
    step = last({
        "model": "axisymmetric", "geometry": {"file": "penny.geo", "order": order},
        "bodies": {"rock": {"E": 1e3, "nu": 0.2}},
        "contacts": {"crack": {"surface": "rock.above", "against": "rock.below", "friction": COULOMB}},
        "supports": {"bottom": {"boundary": "rock.bottom", "displacement": {"y": 0.0}}},
        "loads": {"top": {"boundary": "rock.top", "pressure": 2.0}},
        "solver": solver | {"tolerance": 1e-11},
    }, tmp_path)  # fmt: skip
    crack = step.contacts["crack"]
    assert_allclose(crack.normal_force, 2.0 * np.pi, rtol=1e-6)
    assert_allclose(crack.pressure[crack.weight > 0], 2.0, rtol=1e-5)


GLUED = """
SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 2, 2, 1}; Box(2) = {0, 0, 1, 2, 2, 1}; BooleanFragments{ Volume{1, 2}; Delete; }{}
Physical Volume("low") = {1}; Physical Volume("high") = {2};
b() = Surface In BoundingBox {-1, -1, -0.1, 3, 3, 0.1}; Physical Surface("low.bottom") = {b()};
t() = Surface In BoundingBox {-1, -1, 1.9, 3, 3, 2.1}; Physical Surface("high.top") = {t()};
"""


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("size", [1.0, *slow(0.7, 0.5)])
def test_solids_glued_by_fragments_press_on_a_floor_as_one(size: float, order: int, tmp_path: Path) -> None:
    (tmp_path / "glued.geo").write_text(GLUED)
    step = last({
        "model": "3d", "geometry": {"file": "glued.geo", "mesh_size": size, "order": order},
        "bodies": {"low": {"E": 100.0, "nu": 0.0}, "high": {"E": 400.0, "nu": 0.0}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0] * 3, "normal": [0.0, 0.0, 1.0]}},
        "contacts": {"c": {"surface": "low.bottom", "against": "floor", "friction": COULOMB}},
        "supports": {"top": {"boundary": "high.top", "displacement": {"x": 0.0, "y": 0.0, "z": -0.0125}}},
    }, tmp_path)  # fmt: skip
    assert_allclose(step.contacts["c"].normal_force, 4.0, rtol=1e-8)
    assert_allclose(step.contacts["c"].max_pressure, 1.0, rtol=1e-7)


TUBES = """
SetFactory("OpenCASCADE");
Rectangle(1) = {1, 0, 0, 1, 3}; Rectangle(2) = {1.9, 0, 0, 1, 3};
Physical Surface("inner") = {1}; Physical Surface("outer") = {2};
Physical Curve("inner.outside") = {2}; Physical Curve("outer.inside") = {8};
Physical Curve("inner.base") = {1}; Physical Curve("outer.base") = {5};
"""  # a press fit drawn with its interference, .1


def test_tubes_that_overlap_are_told_and_pushed_apart_to_the_pressure_of_lame(tmp_path: Path) -> None:
    (tmp_path / "tubes.geo").write_text(TUBES)
    (found,) = UserFile(file=str(tmp_path / "tubes.geo")).overlaps(2)
    assert_allclose([found.depth, found.volume], [0.1, 0.3], rtol=1e-6)
    assert_allclose(found.place, [1.95, 1.5], atol=0.2)
    for size in (0.5, 0.25):
        step = last({
            "model": "axisymmetric", "geometry": {"file": "tubes.geo", "mesh_size": size, "order": 2},
            "bodies": {"inner": {"E": 1.0, "nu": 0.0}, "outer": {"E": 1.0, "nu": 0.0}},
            "contacts": {"fit": {"surface": "outer.inside", "against": "inner.outside"}},
            "supports": {body: {"boundary": f"{body}.base", "displacement": {"y": 0.0}} for body in ("inner", "outer")},
        }, tmp_path)  # fmt: skip
        fit = step.contacts["fit"]
        # the gap closes where both are: u_outer(1.9) - u_inner(2) = .1; Lamé, nu = 0, long tubes
        yields = 1.9 * (2.9**2 + 1.9**2) / (2.9**2 - 1.9**2) + 1.9 * (2.0**2 + 1.0**2) / (2.0**2 - 1.0**2)
        assert_allclose(fit.normal_force / (2 * np.pi * 1.9 * 3), 0.1 / yields, rtol=0.005)


BLOCK = {"builder": "block", "length": 2.0, "width": 1.0, "height": 1.0}
MAP = {"over": ["x"], "rows": [[0.0, 0.1], [2.0, 0.3]]}


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("size", [0.5, *slow(0.34, 0.25)])
def test_friction_of_a_map_adds_up_in_3d(size: float, order: int, tmp_path: Path) -> None:
    """Pressed by .01 and dragged far: all slips, and nu = 0 keeps the pressure even where shear does not lift it."""
    step = last({
        "model": "3d", "geometry": BLOCK | {"mesh_size": size, "order": order},
        "bodies": {"block": {"E": 100.0, "nu": 0.0}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0] * 3, "normal": [0.0, 0.0, 1.0]}},
        "contacts": {"c": {"surface": "block.bottom", "against": "floor", "friction": {"law": "coulomb", "mu": MAP}}},
        "supports": {"top": {"boundary": "block.top", "displacement": {"x": 1.0, "y": 0.0, "z": -0.01}}},
    }, tmp_path)  # fmt: skip
    base = step.contacts["c"]
    mu = 0.1 + 0.1 * base.points[:, 0]
    assert_allclose(base.bound, mu * base.pressure, atol=1e-6 * base.pressure.max())
    assert_allclose(np.abs(base.force[0]), (base.weight * base.bound).sum(), rtol=1e-3)
    assert 0.15 < -base.force[0] / base.normal_force < 0.25


@pytest.mark.parametrize("time", [0.5, 1.0])
@pytest.mark.parametrize("size", [0.2, *slow(0.1, 0.05)])
def test_an_interference_grows_in_an_axisymmetric_shrink_fit(size: float, time: float, tmp_path: Path) -> None:
    """Lamé's rings between planes of symmetry."""
    steps = solved(from_dict({
        "model": "axisymmetric",
        "geometry": {"file": "tubes.geo", "mesh_size": size, "order": 2},
        "bodies": {"inner": {"E": 1.0, "nu": 0.3}, "outer": {"E": 1.0, "nu": 0.3}},
        "contacts": {
            "fit": {"surface": "outer.inside", "against": "inner.outside", "gap_offset": [[0, 0], [1, -1e-3]]}
        },
        "supports": {body: {"boundary": f"{body}.base", "displacement": {"y": 0.0}} for body in ("inner", "outer")},
        "steps": {"count": 2},
    }, write(tmp_path, "tubes.geo", TUBES.replace("1.9, 0, 0", "2, 0, 0"))))[1]  # fmt: skip
    step = next(step for step in steps if step.time == time)
    yields = 2 * (3**2 + 2**2) / (3**2 - 2**2) + 2 * (2**2 + 1) / (2**2 - 1)
    assert_allclose(step.contacts["fit"].normal_force / (2 * np.pi * 2 * 3), time * 1e-3 / yields, rtol=2e-3)


def write(folder: Path, name: str, text: str) -> Path:
    """The folder, with a file of that name."""
    (folder / name).write_text(text)
    return folder


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("size", [0.5, *slow(0.34, 0.25)])
def test_a_graph_that_moves_drags_as_the_plane_that_it_is(size: float, dim: int, tmp_path: Path) -> None:
    normal, found = [0.0] * (dim - 1) + [1.0], []
    flat = {key: value for key, value in BLOCK.items() if dim == 3 or key != "width"}
    for floor in ({"shape": "plane", "point": [0.0] * dim, "normal": normal}, {"shape": "graph", "height": "0*x"}):
        step = last({
            "model": "3d" if dim == 3 else "plane strain", "geometry": flat | {"mesh_size": size},
            "bodies": {"block": {"E": 100.0, "nu": 0.3}},
            "obstacles": {"floor": floor | {"displacement": {"x": [[0, 0], [1, 0.01]], "xyz"[dim - 1]: 0.005}}},
            "contacts": {"c": {"surface": "block.bottom", "against": "floor", "friction": COULOMB, "sliding": True}},
            "supports": {"top": {"boundary": "block.top", "displacement": [0.0] * dim}}, "steps": {"count": 2},
        }, tmp_path)  # fmt: skip
        base = step.contacts["c"]
        found.append([base.normal_force, base.tangential_force, base.max_slip, base.stick_area])
    assert found[0][1] > 0
    assert_allclose(found[1], found[0], rtol=1e-6)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("size", [0.5, *slow(0.34, 0.25)])
def test_a_pad_that_has_travelled_far_is_in_balance_where_it_is(size: float, dim: int, tmp_path: Path) -> None:
    """Dragged by ten times its length: friction, weight and what drags it act there."""
    flat = {key: value for key, value in BLOCK.items() if dim == 3 or key != "width"}
    dragged = {"x": [[1, 0], [2, 20.0]]} | ({"y": 0.0} if dim == 3 else {})
    step = last({
        "model": "3d" if dim == 3 else "plane strain", "geometry": flat | {"mesh_size": size},
        "bodies": {"block": {"E": 1e6, "nu": 0.0}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}},
        "contacts": {"c": {"surface": "block.bottom", "against": "floor", "friction": COULOMB}},
        "supports": {"top": {"boundary": "block.top", "displacement": dragged}},
        "loads": {"top": {"boundary": "block.top", "pressure": 3.0}}, "steps": {"end": 2.0, "count": 2},
    }, tmp_path)  # fmt: skip
    base, top, weight = step.contacts["c"], step.supports["top"], 6.0
    assert_allclose(base.force[[0, -1]], [-0.2 * weight, weight], rtol=1e-7)
    load = np.array([-21.0 * weight]) if dim == 2 else np.array([-0.5, 21.0, 0.0]) * weight
    assert_allclose(base.moment + top.moment + load, 0.0, atol=3e-5 * weight)


VALLEY = """
SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 2, 2}; Rotate {{0, 0, 1}, {0, 0, 0}, Pi / 4} { Surface{1}; }
MeshSize{:} = 0.7; Physical Surface("bar") = {1}; Physical Curve("bar.under") = {1, 4};
Physical Curve("bar.left") = {3}; Physical Curve("bar.right") = {2};
"""


@pytest.mark.parametrize("mu", [0.0, 0.3])
@pytest.mark.parametrize("order", [1, 2])
def test_a_bar_in_a_valley_of_two_planes_presses_on_both_as_statics_says(order: int, mu: float, tmp_path: Path) -> None:
    """Its corner is in the corner of the obstacles, each of which has the face that it reaches first."""
    (tmp_path / "valley.geo").write_text(VALLEY)
    planes = {
        name: {"shape": "plane", "point": [0.0, 0.0], "normal": [x, 1.0]} for name, x in (("r", -1.0), ("l", 1.0))
    }
    step = last({
        "model": "plane strain", "geometry": {"file": "valley.geo", "order": order},
        "bodies": {"bar": {"E": 100.0, "nu": 0.3}}, "obstacles": planes,
        "contacts": {"c": {"surface": "bar.under", "against": ["r", "l"], "friction": COULOMB | {"mu": mu}}},
        "loads": {side: {"boundary": f"bar.{side}", "pressure": 1.0} for side in ("left", "right")},
    }, tmp_path)  # fmt: skip
    one, other = step.contacts["c.r"], step.contacts["c.l"]
    assert_allclose([one.normal_force, other.normal_force], 2 / (1 + mu), rtol=1e-8)
    if not mu:
        assert_allclose(np.concatenate([c.pressure[c.weight > 0] for c in (one, other)]), 1.0, rtol=1e-8)
    assert_allclose(one.force + other.force, [0.0, 2 * np.sqrt(2)], atol=1e-8)


SEATS = """
SetFactory("OpenCASCADE"); Box(1) = {0, 0, 0, 2, 2, 1};
Box(2) = {0, 0, -1, 2, 0.9, 1}; Box(3) = {0, 0.9, -1, 1.1, 1.1, 1}; Box(4) = {1.1, 0.9, -1, 0.9, 1.1, 1};
Physical Volume("top") = {1}; Physical Volume("a") = {2}; Physical Volume("b") = {3}; Physical Volume("c") = {4};
Physical Surface("top.under") = {5}; Physical Surface("top.upper") = {6}; MeshSize{:} = 1;
Physical Surface("a.under") = {11}; Physical Surface("b.under") = {17}; Physical Surface("c.under") = {23};
Physical Surface("a.upper") = {12}; Physical Surface("b.upper") = {18}; Physical Surface("c.upper") = {24};
MeshSize{PointsOf{Volume{1};}} = 0.8;
"""


@pytest.mark.parametrize("order", [1, 2])
def test_a_uniform_pressure_goes_onto_three_blocks_that_meet_at_a_point(order: int, tmp_path: Path) -> None:
    (tmp_path / "seats.geo").write_text(SEATS)
    seats, still = ("a", "b", "c"), {"x": 0.0, "y": 0.0}
    uppers = [f"{seat}.upper" for seat in seats]
    step = last({
        "model": "3d", "geometry": {"file": "seats.geo", "order": order},
        "bodies": {body: {"E": 1.0, "nu": 0.0} for body in ("top", *seats)},
        "contacts": {"c": {"surface": "top.under", "against": uppers, "friction": COULOMB}},
        "supports": {seat: {"boundary": f"{seat}.under", "displacement": still | {"z": 0.0}} for seat in seats}
        | {"up": {"boundary": "top.upper", "displacement": still | {"z": -0.02}}}, "solver": {"tolerance": 1e-11},
    }, tmp_path)  # fmt: skip
    found = [step.contacts[f"c.{seat}"] for seat in seats]
    assert_allclose([c.normal_force for c in found], [0.018, 0.0121, 0.0099], rtol=1e-8)
    assert_allclose(np.concatenate([c.pressure[c.weight > 0] for c in found]), 0.01, rtol=1e-8)


NESTED = """
SetFactory("OpenCASCADE");
For k In {1:3}
  Rectangle(k) = {0.5 + 0.5 * k, 0, 0, 0.5, 0.5}; MeshSize{PointsOf{Surface{k};}} = 0.1 + 0.03 * k;
EndFor
Physical Surface("a") = {1}; Physical Surface("b") = {2}; Physical Surface("c") = {3};
Physical Curve("a.bore") = {4};
Physical Curve("a.low") = {1}; Physical Curve("b.low") = {5}; Physical Curve("c.low") = {9};
"""


def test_three_tubes_in_each_other_pass_a_pressure_on_as_one(tmp_path: Path) -> None:
    (tmp_path / "nested.geo").write_text(NESTED)
    step = last({
        "model": "axisymmetric", "geometry": {"file": "nested.geo", "order": 2},
        "bodies": {body: {"E": 1.0, "nu": 0.0} for body in "abc"}, "contacts": {"any": {"between": "all"}},
        "supports": {body: {"boundary": f"{body}.low", "displacement": {"y": 0.0}} for body in "abc"},
        "loads": {"oil": {"boundary": "a.bore", "pressure": 0.01}},
    }, tmp_path)  # fmt: skip
    for name, r in (("any.a.b", 1.5), ("any.b.c", 2.0)):
        pressure = 0.01 / (2.5**2 - 1) * ((2.5 / r) ** 2 - 1)  # Lamé
        assert_allclose(step.contacts[name].normal_force / (np.pi * r), pressure, rtol=1e-5)


CLIP = """
SetFactory("OpenCASCADE");
Point(1) = {1, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {2, 0.45, 0}; Point(4) = {1.3, 0.45, 0};
Point(5) = {1.3, 0.5, 0}; Point(6) = {2, 0.52, 0}; Point(7) = {2, 1, 0}; Point(8) = {1, 1, 0};
For k In {1:8}
  Line(k) = {k, k % 8 + 1};
EndFor
Curve Loop(1) = {1:8}; Plane Surface(1) = {1}; MeshSize{:} = 0.12; Physical Surface("clip") = {1};
Physical Curve("clip.low") = {1}; Physical Curve("clip.up") = {7};
"""


@pytest.mark.parametrize("order", [1, 2])
def test_a_slot_that_is_one_side_closes_as_its_two_lips_do(order: int, tmp_path: Path) -> None:
    """Its end, between two hollow corners, belongs to one of the halves that the side is cut into."""
    lips = 'Physical Curve("clip.one") = {3}; Physical Curve("clip.two") = {5};\n'
    found = []
    for names, one, other in ((lips, "one", "two"), ('Physical Curve("clip.slot") = {3:5};\n', "slot", "slot")):
        (tmp_path / "clip.geo").write_text(CLIP + names)
        step = last({
            "model": "axisymmetric", "geometry": {"file": "clip.geo", "order": order},
            "bodies": {"clip": {"E": 1.0, "nu": 0.3}},
            "contacts": {"c": {"surface": f"clip.{one}", "against": f"clip.{other}", "friction": COULOMB}},
            "supports": {"low": {"boundary": "clip.low", "displacement": [0.0, 0.0]},
                         "up": {"boundary": "clip.up", "displacement": {"y": -0.1}}},
        }, tmp_path)  # fmt: skip
        found.append((step.contacts["c"].normal_force, step.contacts["c"].max_pressure, step.supports["up"].force[-1]))
    assert found[0][0] > 0
    assert_allclose(found[1], found[0], rtol=1e-7)
