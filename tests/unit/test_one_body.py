"""Contact of a body with itself: cracks, whose ends both sides have, slots, and one side with itself."""

import tomllib
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit, solved
from shared.command import READY
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.surfaces.faces import halves
from stickslip.geometry.surfaces.overlap import overlap
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.stepping import pairs
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.proposal import assembly, scene_text
from stickslip.workflows.scene_file.read import from_dict, read

ROCK = {"E": 25e9, "nu": 0.25}
PRESSED, SHEARED = 10e6, 8e6  # [Pa]

SLOT = """
Point(1) = {0, 0, 0, 2}; Point(2) = {40, 0, 0, 2}; Point(3) = {40, 20, 0, 2}; Point(4) = {0, 20, 0, 2};
Point(5) = {0, 10.005, 0, 1}; Point(6) = {30, 10.005, 0, 1}; Point(7) = {30, 9.995, 0, 1}; Point(8) = {0, 9.995, 0, 1};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5};
Line(5) = {5, 6}; Line(6) = {6, 7}; Line(7) = {7, 8}; Line(8) = {8, 1};
Curve Loop(1) = {1:8}; Plane Surface(1) = {1}; Physical Surface("c") = {1}; Physical Curve("c.bottom") = {1};
Physical Curve("c.top") = {3}; Physical Curve("c.upper") = {5}; Physical Curve("c.lower") = {7};
"""  # 40 mm x 20 mm, with a slot of 30 mm from the left that is 0.01 mm high


def squares(a: Array, b: Array) -> Array:
    """Corners of squares between two lines of nodes."""
    return np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=-1)


def cracked(folder: Path, dim: int, n: int = 8, one_side: bool = False) -> Path:
    """A block [-2, 2]² of squares, in 3D of two layers of cubes, with a crack on y = 0 from x = -1 to 1."""
    x, z = np.linspace(-2, 2, n + 1), np.linspace(0, 8 / n, 3)[: 2 * dim - 3]
    points = np.stack(np.meshgrid(x, x, z, indexing="ij")).transpose(3, 2, 1, 0).reshape(-1, 3)
    number = np.arange(len(points)).reshape(len(z), n + 1, n + 1)
    twice = np.flatnonzero((points[:, 1] == 0) & (np.abs(points[:, 0]) < 1))
    above = np.arange(len(points))
    above[twice] = len(points) + np.arange(len(twice))
    layers = [np.concatenate([squares(*(k if j < n // 2 else above[k])[j : j + 2]) for j in range(n)]) for k in number]

    def side(lines: Array) -> Array:
        flat = np.stack([lines[0][:-1], lines[0][1:]], axis=-1)
        return np.concatenate([squares(*pair) for pair in pairwise(lines)]) if dim == 3 else flat

    crack = number[:, n // 2, n // 4 : 3 * n // 4 + 1]
    sides = {"below": side(crack), "above": side(above[crack]), "bottom": side(number[:, 0])}
    if one_side:
        sides["lips"] = np.concatenate([sides.pop("below"), sides.pop("above")])
    sides |= {"top": side(number[:, -1]), "left": side(number[:, :, 0]), "right": side(number[:, :, -1])}
    cells = np.concatenate([np.concatenate(pair, axis=1) for pair in pairwise(layers)]) if dim == 3 else layers[0]
    if dim == 3:
        sides |= {"front": layers[0], "back": layers[-1]}
    groups = {"block": (dim, {2: 3, 3: 5}[dim], cells)}
    groups |= {f"block.{name}": (dim - 1, {2: 1, 3: 3}[dim], facets) for name, facets in sides.items()}
    with gmsh_session() as gmsh:
        for name, (k, kind, corners) in groups.items():
            entity = gmsh.model.addDiscreteEntity(k)
            if k == dim:
                points = np.concatenate([points, points[twice]])
                gmsh.model.mesh.addNodes(k, entity, 1 + np.arange(len(points)), points.ravel())
            gmsh.model.mesh.addElementsByType(entity, kind, [], 1 + corners.ravel())
            gmsh.model.setPhysicalName(k, gmsh.model.addPhysicalGroup(k, [entity]), name)
        gmsh.write(str(folder / f"block{dim}.msh"))
    return folder / f"block{dim}.msh"


def block(path: Path, dim: int, shear: float = 0.0, **tables: Any) -> dict[str, Any]:
    still = [0.0] * (dim - 2)
    data: dict[str, Any] = {
        "model": "3d" if dim == 3 else "plane strain",
        "geometry": {"file": str(path)},
        "bodies": {"block": ROCK},
        "contacts": {
            "crack": {
                "surface": "block.below", "against": "block.above", "friction": {"law": "coulomb", "mu": 0.3},
            },
        },
        "loads": {
            "top": {"boundary": "block.top", "traction": [shear, -PRESSED, *still]},
            "bottom": {"boundary": "block.bottom", "traction": [-shear, 0.0, *still]},
            "right": {"boundary": "block.right", "traction": [0.0, shear, *still]},
            "left": {"boundary": "block.left", "traction": [0.0, -shear, *still]},
        },
        "supports": {"bottom": {"boundary": "block.bottom", "displacement": {"y": 0.0}},
                     "corner": {"point": [-2.0, -2.0, *still], "displacement": {"x": 0.0}}},
    }  # fmt: skip
    if dim == 3:
        flat = {name: {"boundary": f"block.{name}", "displacement": {"z": 0.0}} for name in ("front", "back")}
        data["supports"] |= flat
    return data | tables


def last(data: dict[str, Any]) -> tuple[Any, StepResult]:
    simulation, steps = solved(from_dict(data))
    return simulation, steps[-1]


@pytest.mark.parametrize("method", ["condensed-newton", "tangent-cg", "surface-uzawa", "perturbed-lagrangian"])
def test_a_closed_crack_passes_a_uniform_pressure_on(method: str, tmp_path: Path) -> None:
    data = block(cracked(tmp_path, 2), 2, solver={"method": method, "tolerance": 1e-11})
    simulation, step = last(data)
    crack = step.contacts["crack"]
    assert_allclose(crack.pressure[crack.weight > 0], PRESSED, rtol=1e-8)
    assert_allclose(crack.contact_area, 2.0)
    assert simulation.system.contacts[0].ends.sum() == 2
    assert len(simulation.system.contacts[0].W_n) == len(crack.pressure) - 2


def test_a_crack_through_a_slice_in_3d_is_that_in_plane_strain(tmp_path: Path) -> None:
    found = []
    for dim, method in ((2, "condensed-newton"), (3, "condensed-newton"), (3, "tangent-cg")):
        data = block(cracked(tmp_path, dim), dim, SHEARED, solver={"method": method, "tolerance": 1e-10})
        simulation, step = last(data)
        crack = step.contacts["crack"]
        assert max(value for name, value in audit(simulation, step).items() if name != "fields") < 1e-7
        assert crack.slip_area > 1.4
        found.append([crack.normal_force, crack.tangential_force, 1e9 * crack.max_slip])
    assert_allclose(found[1:], [found[0]] * 2, rtol=1e-6)


@pytest.mark.parametrize(("order", "fine"), [(1, 0.2), (1, 0.1), (2, 0.2)])
def test_what_the_ends_of_a_crack_leave_is_stated(order: int, fine: float, tmp_path: Path) -> None:
    scene = read("crack", [f"geometry.order={order}", f"geometry.fine={fine}", "geometry.coarse=4.0"])
    crack = run(scene, tmp_path / "out")[1]["steps"][-1]["contacts"]["crack"]
    for name, exact in (("normal_force", 23395556.0), ("tangential_force", 13507430.0), ("max_slip", 3.8078e-3)):
        assert abs(crack[name] - exact) < 1.1 * crack["error"][name]["total"]
    assert crack["error"]["normal_force"]["total"] < 0.05 * crack["normal_force"]


@pytest.mark.parametrize("law", [{"law": "unilateral"}, {"law": "compliance", "c_n": 1e9, "m_n": 1.5}])
def test_a_slot_closes_from_its_open_end(law: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "slot.geo").write_text(SLOT)
    data = {
        "model": "plane strain", "units": "mm-N-MPa", "geometry": {"file": str(tmp_path / "slot.geo")},
        "bodies": {"c": {"E": 200_000.0, "nu": 0.3}},
        "contacts": {"slot": {"surface": "c.upper", "against": "c.lower", "normal": law,
                              "friction": {"law": "coulomb", "mu": 0.2}}},
        "supports": {"bottom": {"boundary": "c.bottom", "displacement": [0.0, 0.0]}},
        "loads": {"top": {"boundary": "c.top", "traction": [0.0, -100.0]}},
    }  # fmt: skip
    simulation, step = last(data)
    slot = step.contacts["slot"]
    assert 2500 < slot.normal_force < 2600
    assert slot.pressure.max() < 125
    assert slot.pressure[np.argmin(simulation.system.contacts[0].surface.points[:, 0])] > 50
    assert not simulation.system.contacts[0].ends.any()
    assert max(value for name, value in audit(simulation, step).items() if name != "fields") < 1e-7


def needle(n: int, m: int) -> str:
    """A plate of 40 m with a hole of 2 m x 2 mm, an ellipse of n lines above and m below."""
    angles = np.concatenate([np.linspace(0, np.pi, n + 1), np.linspace(np.pi, 2 * np.pi, m + 1)[1:-1]])
    angles = np.concatenate([angles[:n], [np.pi], angles[n + 1 :]])
    lines = [f"Point({k}) = {{{np.cos(a)}, {1e-3 * np.sin(a)}, 0, 0.1}};" for k, a in enumerate(angles, 1)]
    hole = range(1, len(angles) + 1)
    lines += [f"Line({k}) = {{{k}, {k % len(angles) + 1}}};" for k in hole]
    corners = [(-20, -20), (20, -20), (20, 20), (-20, 20)]
    lines += [f"Point({1000 + k}) = {{{x}, {y}, 0, 4}};" for k, (x, y) in enumerate(corners)]
    lines += [f"Line({1000 + k}) = {{{1000 + k}, {1000 + (k + 1) % 4}}};" for k in range(4)]
    listed = ", ".join(map(str, hole))
    lines += [f"Transfinite Curve {{{listed}}} = 2;", f"Curve Loop(1) = {{{listed}}};", "Curve Loop(2) = {1000:1003};"]
    lines += ["Plane Surface(1) = {2, 1};", 'Physical Surface("p") = {1};', f'Physical Curve("p.hole") = {{{listed}}};']
    lines += ['Physical Curve("p.bottom") = {1000};', 'Physical Curve("p.top") = {1002};', ""]
    return "\n".join(lines)


@pytest.mark.parametrize(("order", "method"), [(1, "condensed-newton"), (1, "tangent-cg"), (2, "condensed-newton")])
def test_a_flat_hole_closes_on_itself_at_the_pressure_of_its_closed_form(
    order: int, method: str, tmp_path: Path
) -> None:
    (tmp_path / "needle.geo").write_text(needle(30, 37))
    data = {
        "model": "plane stress", "geometry": {"file": str(tmp_path / "needle.geo"), "order": order},
        "bodies": {"p": {"E": 1000.0, "nu": 0.3}},
        "contacts": {"hole": {"surface": "p.hole", "against": "p.hole"}},
        "loads": {"top": {"boundary": "p.top", "pressure": 2.0}},
        "supports": {"bottom": {"boundary": "p.bottom", "displacement": {"y": 0.0}},
                     "corner": {"point": [-20.0, -20.0], "displacement": {"x": 0.0}}},
        "solver": {"method": method},
    }  # fmt: skip
    scene = from_dict(data)
    hole = run(scene, tmp_path / "out")[1]["steps"][-1]["contacts"]["hole"]
    assert abs(hole["normal_force"] - 3.0) < 1.1 * hole["error"]["normal_force"]["total"] < 0.25  # 2 a (p - E b / 2 a)
    if order == 1:  # at the sharp ends of the hole those of order 2 waver
        assert_allclose(hole["max_pressure"], 1.5, rtol=0.03)


def test_a_side_of_itself_in_3d_has_the_numbers_of_its_two_parts(tmp_path: Path) -> None:
    numbers = []
    for lips in (("below", "above"), ("lips", "lips")):
        data = block(cracked(tmp_path, 3, one_side=lips[0] == "lips"), 3, SHEARED)
        data["contacts"]["crack"] |= {"surface": f"block.{lips[0]}", "against": f"block.{lips[1]}"}
        simulation, step = last(data | {"solver": {"method": "condensed-newton", "tolerance": 1e-12}})
        crack = step.contacts["crack"]
        assert max(value for name, value in audit(simulation, step).items() if name != "fields") < 1e-7
        numbers.append([crack.normal_force, crack.tangential_force, 1e9 * crack.max_slip])
    assert_allclose(numbers[1], numbers[0], rtol=1e-9)


def test_the_whole_skin_of_a_body_touches_itself_in_its_slot_alone(tmp_path: Path) -> None:
    found = []
    for name, sides in (("skin", ("skin", "skin")), ("two", ("upper", "lower"))):
        text = SLOT if name == "two" else SLOT.partition('Physical Curve("c.bottom")')[0]
        (tmp_path / f"{name}.geo").write_text(text + ("" if name == "two" else 'Physical Curve("c.skin") = {1:8};\n'))
        data = {
            "model": "plane strain", "units": "mm-N-MPa", "geometry": {"file": str(tmp_path / f"{name}.geo")},
            "bodies": {"c": {"E": 200_000.0, "nu": 0.3, "density": 1.0}},
            "contacts": {"slot": {"surface": f"c.{sides[0]}", "against": f"c.{sides[1]}"}},
            "gravity": {"acceleration": [0.0, -5.0]},
            "supports": {"one": {"point": [0.0, 0.0], "displacement": {"x": 0.0, "y": 0.0}},
                         "other": {"point": [40.0, 0.0], "displacement": {"y": 0.0}}},
        }  # fmt: skip
        simulation, step = last(data)
        rows = simulation.system.contacts[0]
        assert rows.node_distance[rows.node_weights > 0].min() > 0.009
        assert rows.surface.points[rows.node_weights > 0][:, 1].min() > 9.9
        found.append(step.contacts["slot"].normal_force)
    assert_allclose(found[0], found[1], rtol=5e-3)


def ring(n: int) -> Surface:
    """A hole's wall: facets of a circle that look inward."""
    angles, k = 2 * np.pi * np.arange(n) / n, np.arange(n)
    points = np.stack([np.cos(angles), 0.5 * np.sin(angles)], axis=1)
    facets = np.stack([k, (k + 1) % n], axis=1)
    return Surface("interval", 1, k, k, points, facets, -np.ones(n), False, depth=np.full(n, 0.05))


@pytest.mark.parametrize("n", [16, 31])
def test_a_hole_has_two_halves_that_face_each_other_across_its_short_axis(n: int) -> None:
    parts = halves(ring(n), 3.0)
    heights = [part.points[part.facets].mean(axis=1)[:, 1] for part in parts]
    assert sum(map(len, heights)) == n
    flat = [height[np.abs(height) > 0.15] for height in heights]
    assert min(len(flat[0]), len(flat[1])) > n // 4
    assert (np.sign(flat[0]) == np.sign(flat[0][0])).all()
    assert (np.sign(flat[1]) == -np.sign(flat[0][0])).all()


def test_what_lies_behind_a_facet_in_the_body_does_not_face_it() -> None:
    sheet = block_of_two_lines(thick=0.1)
    assert not len(overlap(sheet, sheet, 1.0, 2).weights)
    assert len(overlap(replace(sheet, depth=None), sheet, 1.0, 2).weights)


def block_of_two_lines(thick: float) -> Surface:
    """Top and bottom of a sheet."""
    x, k = np.linspace(0, 1, 5), np.arange(4)
    points = np.concatenate([np.stack([x, 0 * x], axis=1), np.stack([x, thick + 0 * x], axis=1)])
    facets = np.concatenate([np.stack([k, k + 1], axis=1), np.stack([k, k + 1], axis=1) + 5])
    outward, numbers = np.repeat([1.0, -1.0], 4), np.arange(10)
    return Surface("interval", 1, numbers, numbers, points, facets, outward, False, depth=np.full(8, thick / 3))


def test_only_mortar_cuts_a_side_into_two(tmp_path: Path) -> None:
    data = block(cracked(tmp_path, 2), 2)
    data["contacts"]["crack"] |= {"against": "block.below", "operator": "node-to-segment"}
    with pytest.raises(SceneError, match="a side that touches itself needs mortar"):
        from_dict(data)


SPLIT = """
def build(model, parameters):
    occ = model.occ
    corners = [(0, 0), (40, 0), (40, 20), (0, 20), (0, 10.5), (30, 10), (0, 9.5)]
    points = [occ.addPoint(x, 0, z) for x, z in corners]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1])]
    base = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    out = occ.extrude([(2, base)], 0, 10, 0)
    occ.synchronize()
    walls = [tag for dim, tag in out if dim == 2][1:]
    sides = {"skin": [base, out[0][1], *walls]} if parameters["skin"] else {"upper": [walls[4]], "lower": [walls[5]]}
    for name, tags in sides.items():
        model.setPhysicalName(2, model.addPhysicalGroup(2, tags), f"c.{name}")
    model.setPhysicalName(3, model.addPhysicalGroup(3, [out[1][1]]), "c")
"""  # 40 mm x 10 mm x 20 mm, with a wedge of 30 mm cut out that is 1 mm wide at its mouth


@pytest.mark.parametrize("sliding", [False, True])
def test_the_skin_of_a_split_block_touches_itself_in_3d_as_the_sides_of_its_split(
    sliding: bool, tmp_path: Path
) -> None:
    (tmp_path / "split.py").write_text(SPLIT)
    found = []
    for sides in (("upper", "lower"), ("skin", "skin")):
        skin = int(sides[0] == "skin")
        still = {"a": [0.0, 0.0], "b": [40.0, 0.0], "c": [40.0, 10.0], "d": [0.0, 10.0]}
        supports = {k: {"point": [*at, 0.0], "displacement": {"z": 0.0}} for k, at in still.items()}
        supports["a"]["displacement"] = {"x": 0.0, "y": 0.0, "z": 0.0}
        supports["b"]["displacement"] = {"y": 0.0, "z": 0.0}
        data = {
            "model": "3d", "units": "mm-N-MPa",
            "geometry": {"file": str(tmp_path / "split.py"), "mesh_size": 3.0, "parameters": {"skin": skin}},
            "bodies": {"c": {"E": 2000.0, "nu": 0.3, "density": 1.0}},
            "contacts": {"slot": {"surface": f"c.{sides[0]}", "against": f"c.{sides[1]}", "sliding": sliding}},
            "gravity": {"acceleration": [0.0, 0.0, -0.3]}, "supports": supports,
            "solver": {"method": "condensed-newton"},
        }  # fmt: skip
        simulation, step = last(data)
        assert audit(simulation, step)["equilibrium"] < 1e-9
        found.append(step.contacts["slot"].normal_force)
    assert found[0] > 400
    assert_allclose(found[1], found[0], rtol=0.01)


KNIFE = """
Point(1) = {0, 0, 0}; Point(2) = {10, 0, 0}; Point(3) = {10, 1, 0}; Point(4) = {2, 0.003, 0}; Point(5) = {5, 0.003, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 5}; Line(4) = {5, 4}; Line(5) = {4, 1};
Curve Loop(1) = {1:5}; Plane Surface(1) = {1}; Physical Surface("c") = {1};
"""  # a sharp edge, and a sheet thinner than what is near


@pytest.mark.parametrize(
    ("name", "text", "sides", "gap"),
    [
        ("slot.geo", SLOT, ("c.upper", "c.lower"), 0.01),
        ("crack.geo", (READY / "crack.geo").read_text(), ("plate.below", "plate.above"), 0.0),
        ("needle.geo", needle(30, 37), ("p.hole", "p.hole"), None),
        ("wedge.py", SPLIT.replace("10.5", "10.02").replace("9.5", "9.98"), ("c.upper", "c.lower"), None),
        ("knife.geo", KNIFE, None, None),
    ],
)
def test_a_body_that_may_touch_itself_is_proposed_to(
    name: str, text: str, sides: tuple[str, str] | None, gap: float | None, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text.replace('parameters["skin"]', "0"))
    found = assembly(tmp_path / name, None, None)
    if sides is None:
        assert found.pairs == ()
        return
    scene = tomllib.loads(scene_text(found, tmp_path / "of.toml"))
    (contact,) = scene["contacts"].values()
    assert {contact["surface"], contact["against"]} == {*sides}
    if gap is None:
        assert "gap" not in contact
    else:
        assert_allclose(contact["gap"], gap, atol=1e-9)
    assert from_dict(scene, tmp_path).request().facing == ((contact["surface"], contact["against"]),)


def test_a_search_takes_over_bodies_whose_form_has_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    adopted = list[str]()
    other = SimpleNamespace(surface=SimpleNamespace(adopt=adopted.append))
    monkeypatch.setattr(pairs, "SubstepSolver", lambda system, chain: other)
    system = SimpleNamespace(
        searched=lambda moved: SimpleNamespace(contacts=()), contacts=(), problem=SimpleNamespace(pairs={})
    )
    solver: Any = SimpleNamespace(system=system, chain=None, surface="before", volume=None, latest=None, bolts=None)
    solver.widen = lambda system: None
    solver.follow_bodies = lambda: setattr(solver, "surface", "now")
    assert pairs.PairSearch(solver).found({"moved": np.zeros(1)}) is other
    assert adopted == ["now"]
