"""All bodies with each other: pairs are found as bodies come near, in any step."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit, solved
from shared.histories import Stop
from shared.travel import travel
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import from_dict


def forces(steps: list[StepResult]) -> list[float]:
    return [step.contacts["any.sledge.wall"].normal_force for step in steps]


@pytest.mark.parametrize(
    ("dim", "order", "sliding", "method"),
    [(2, 1, False, "auto"), (2, 2, True, "auto"), (3, 1, False, "auto"), (2, 1, False, "tangent-cg")],
)
def test_a_body_that_travels_meets_a_third_one_in_the_third_step(
    dim: int, order: int, sliding: bool, method: str, tmp_path: Path
) -> None:
    scene = travel(tmp_path, dim, order, contacts={"any": {"between": "all", "sliding": sliding}})
    simulation, steps = solved(from_dict(scene | {"solver": {"method": method, "tolerance": 1e-9}}, tmp_path))
    gap, step = (0.75, 0.3) if dim == 2 else (1.6, 0.6)
    # two bodies in a row, E = 1, of length 1 and area 1 each
    assert_allclose(forces(steps), [0, 0, (3 * step - gap) / 2, (4 * step - gap) / 2], rtol=1e-7, atol=1e-12)
    assert_allclose([each.contacts["any.sledge.roof"].normal_force for each in steps], 0.0, atol=1e-9)
    assert_allclose(steps[-1].sums["any"].normal_force, steps[-1].contacts["any.sledge.wall"].normal_force, rtol=1e-7)
    if method == "auto":
        assert max(audit(simulation, steps[-1]).values()) < 1e-9


def test_new_pairs_cost_a_volume_solve_for_each_new_dof_and_no_factor(tmp_path: Path) -> None:
    simulation, steps = solved(from_dict(travel(tmp_path), tmp_path))
    counters = simulation.counters
    assert counters.factorisations == 1
    assert counters.added_dofs > 0
    others = sum(step.volume_solves for step in steps) - counters.added_dofs
    assert others < 40  # those of each step's load, whose part at new dofs is held by a second one
    found = {c.name: c for c in simulation.stepper.system.contacts}
    meeting = found["any.sledge.wall"]
    near = meeting.points[meeting.near][:, 0]
    assert near.min() >= 0.5  # far skins never enter the dense block
    assert near.max() < 2.5
    assert not found["any.wall.roof"].near.any()
    assert counters.schur_size == len(simulation.stepper.system.interface.dofs)


def test_a_body_that_only_passes_by_is_seen_however_long_the_step(tmp_path: Path) -> None:
    scene = travel(tmp_path, steps={"end": 1.0, "count": 1})
    scene["supports"]["push"]["displacement"] = {"x": 1.2}
    assert_allclose(forces(solved(from_dict(scene, tmp_path))[1]), [0.225], rtol=1e-9)


STACK = """SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 4, 1}; Rectangle(2) = {0.2, 1, 0, 1, 1};
Rectangle(3) = {1.8, 1, 0, 1.2, 1}; Rectangle(4) = {0.2, 2, 0, 3, 0.6};
Physical Surface("base") = {1}; Physical Surface("left") = {2}; Physical Surface("right") = {3};
Physical Surface("lid") = {4}; Physical Curve("base.under") = {1}; Physical Curve("lid.upper") = {15};
Physical Curve("base.upper") = {3}; Physical Curve("left.under") = {5};
MeshSize{PointsOf{Surface{1};}} = 0.25; MeshSize{PointsOf{Surface{2};}} = 0.23;
MeshSize{PointsOf{Surface{3};}} = 0.29; MeshSize{PointsOf{Surface{4};}} = 0.31;
"""
FRICTION = {"law": "coulomb", "mu": 0.3}


def stack(folder: Path, contacts: dict[str, Any]) -> dict[str, Any]:
    """Two blocks between a base and a lid that presses them."""
    (folder / "stack.geo").write_text(STACK)
    return {
        "model": "plane strain",
        "geometry": {"file": "stack.geo"},
        "bodies": {body: {"E": 1000.0, "nu": 0.3} for body in ("base", "left", "right", "lid")},
        "contacts": contacts,
        "supports": {
            "base": {"boundary": "base.under", "displacement": [0.0, 0.0]},
            "lid": {"boundary": "lid.upper", "displacement": [0.02, -0.02]},
        },
        "steps": {"count": 2},
        "solver": {"tolerance": 1e-12},
        "output": {"pictures": False, "error": False},
    }


def test_it_is_the_same_as_its_pairs_in_a_list(tmp_path: Path) -> None:
    pairs = {"left.lid": {"friction": {"law": "coulomb", "mu": 0.1}}, "left.right": {"off": True}}
    every = {"between": ["base", "left", "right", "lid"], "friction": FRICTION, "pairs": pairs}
    names = [("base", "left"), ("base", "right"), ("left", "lid"), ("right", "lid")]
    each = {
        f"{a}_{b}": {"surface": f"{a}.*", "against": f"{b}.*", "friction": pairs.get(f"{a}.{b}", every)["friction"]}
        for a, b in names
    }
    (_, found), (_, listed) = (solved(from_dict(stack(tmp_path, c), tmp_path)) for c in ({"any": every}, each))
    assert found[-1].contacts.keys() == {f"any.{a}.{b}" for a, b in names}
    for a, b in names:
        one, two = found[-1].contacts[f"any.{a}.{b}"], listed[-1].contacts[f"{a}_{b}"]
        assert_allclose([one.normal_force, *one.force], [two.normal_force, *two.force], rtol=1e-8)
    slides = found[-1].contacts["any.left.lid"]
    assert slides.tangential_force == pytest.approx(0.1 * slides.normal_force, rel=1e-6)


def test_whole_skins_touch_as_named_sides_do_where_they_are_flat(tmp_path: Path) -> None:
    sides = {"one": {"surface": "base.upper", "against": "left.under"}}
    skins = {"one": {"surface": "base.*", "against": "left.*"}}
    rest = {"between": "all", "pairs": {"base.left": {"off": True}}}
    listed, found = (solved(from_dict(stack(tmp_path, {**c, "any": rest}), tmp_path))[1] for c in (sides, skins))
    assert_allclose(found[-1].contacts["one"].normal_force, listed[-1].contacts["one"].normal_force, rtol=1e-8)


COG = """
R = 1; e = 0.02;
Point(1) = {0, 0, 0}; For k In {0:7}
  Point(10 + k) = {R * Cos(k * Pi / 4), R * Sin(k * Pi / 4), 0};
  Point(30 + k) = {(R + e) * Cos(k * Pi / 4 + 0.3), (R + e) * Sin(k * Pi / 4 + 0.3), 0};
EndFor
For k In {0:7}
  Circle(10 + k) = {10 + k, 1, 10 + (k + 1) % 8};
  Circle(30 + k) = {30 + k, 1, 30 + (k + 1) % 8};
EndFor
Curve Loop(1) = {10:17}; Plane Surface(1) = {1};
Point(50) = {-2, -2, 0}; Point(51) = {2, -2, 0}; Point(52) = {2, 2, 0}; Point(53) = {-2, 2, 0};
Line(50) = {50, 51}; Line(51) = {51, 52}; Line(52) = {52, 53}; Line(53) = {53, 50};
Curve Loop(2) = {30:37}; Curve Loop(3) = {50:53}; Plane Surface(2) = {3, 2};
Transfinite Curve {10:17} = 2; Transfinite Curve {30:37} = 2;
Physical Surface("pin") = {1}; Physical Surface("plate") = {2}; Physical Curve("plate.left") = {53};
Physical Curve("pin.round") = {10:17}; Physical Curve("plate.hole") = {30:37};
Mesh.MeshSizeMax = 1;
"""


def test_coarse_facets_of_round_faces_face_each_other_as_those_of_named_sides(tmp_path: Path) -> None:
    """Chords of 45 degrees: facets that touch lean by more than faces that meet at an edge may."""
    (tmp_path / "cog.geo").write_text(COG)
    scene = {
        "model": "plane strain",
        "geometry": {"file": "cog.geo"},
        "bodies": {body: {"E": 1000.0, "nu": 0.3} for body in ("pin", "plate")},
        "supports": {"plate": {"boundary": "plate.left", "displacement": [0.0, 0.0]}},
        "gravity": {"acceleration": [0.0, -1.0]},
        "output": {"pictures": False, "error": False},
    }
    scene["bodies"]["pin"]["density"] = 1.0
    sides = [("pin.round", "plate.hole"), ("pin.*", "plate.*")]
    areas = []
    for one, other in sides:
        contacts = {"fit": {"surface": one, "against": other, "normal": {"law": "tied"}}}
        (_, steps) = solved(from_dict(scene | {"contacts": contacts}, tmp_path))
        areas.append(steps[-1].contacts["fit"].weight.sum())
    assert_allclose(*areas, rtol=1e-9)


def test_a_run_that_was_stopped_before_a_pair_is_found_or_after_ends_the_same(tmp_path: Path) -> None:
    scene = from_dict(travel(tmp_path), tmp_path)
    _, whole = run(scene, tmp_path / "whole")
    for after in (2, 3):
        out = tmp_path / f"stopped_{after}"
        run(scene, out, Watch(on_step=Stop(after)))
        outcome, again = run(scene, out, resume=True)
        assert outcome.status == "converged"
        for one, two in zip(whole["steps"], again["steps"], strict=True):
            for name, contact in one["contacts"].items():
                assert_allclose(two["contacts"][name]["normal_force"], contact["normal_force"], rtol=1e-12, atol=1e-15)


REFUSED = {
    "no such body; did you mean left?": {"any": {"between": ["base", "lefft"]}},
    "name two bodies or more, once": {"any": {"between": ["base"]}},
    "`between` names the bodies": {"any": {"between": "all", "surface": "base.under"}},
    'pairs."base.lidd" = base.lidd: no such pair of its bodies': {
        "any": {"between": "all", "pairs": {"base.lidd": {"off": True}}}
    },
    'pairs."base.base" = base.base: no such pair': {"any": {"between": "all", "pairs": {"base.base": {"off": True}}}},
    'pairs."lid.left" = left.lid: is the same pair; keep one': {
        "any": {"between": "all", "pairs": {"lid.left": {"off": True}, "left.lid": {"off": True}}}
    },
    'pairs."base.left".gap = -0.1: a tied surface closes none': {
        "any": {"between": "all", "pairs": {"base.left": {"normal": {"law": "tied"}, "gap": -0.1}}}
    },
    "contacts.any pairs the two; keep one, or set": {
        "any": {"between": "all"},
        "seat": {"surface": "base.upper", "against": "left.under"},
    },
    "contacts.more pairs them too": {"any": {"between": "all"}, "more": {"between": ["base", "lid"]}},
    "contacts.any.surface: missing, it has no default": {"any": {"friction": FRICTION}},
    "contacts.any.operator = node-to-face: there is none in 2D": {
        "any": {"between": "all", "operator": "node-to-face"}
    },
}


@pytest.mark.parametrize("said", REFUSED)
def test_wrong_input_is_refused_with_one_line(said: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError) as error:
        from_dict(stack(tmp_path, REFUSED[said]), tmp_path)
    assert said in error.value.lines[0]
    assert len(error.value.lines) == 1


def test_a_finer_mesh_knows_the_skins_of_a_run_of_order_2(tmp_path: Path) -> None:
    scene = stack(tmp_path, {"any": {"between": "all"}})
    scene["geometry"]["order"] = 2
    simulation, steps = solved(from_dict(scene, tmp_path))
    errors = simulation.mesh_errors(steps)[-1]
    found = {str(q): parts.mesh for q, parts in errors.items() if parts.mesh is not None}
    assert any("base.left" in name for name in found), found


def test_goals_know_pairs_and_their_sum(tmp_path: Path) -> None:
    scene = from_dict(stack(tmp_path, {"any": {"between": "all"}}), tmp_path)
    assert {"any.base.left.normal_force", "any.normal_force"} <= {*scene.quantities()}
    assert np.array_equal([*scene.sums["any"]], [*scene.pairs])
